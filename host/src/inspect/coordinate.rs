//! What one coordinate does: range, turns, speed, resolution, noise, spectrum with named lines.
//!
//! The spectrum is that of the velocity for an angle (rad²/s²/Hz; [`Motion::increments`] divided by
//! their response), so that whirling leaves no ramp in it, and of the quantity itself otherwise.
//! Frequency resolution: pieces of 60 drive periods where the record gives at least eight
//! half-overlapping ones, shorter pieces otherwise; in a free record a ninth of it twice, 16 384
//! samples at most.

use serde::Serialize;
use std::f64::consts::{PI, TAU};

use super::drive_check;
use super::motion::{Motion, Space};
use super::strongest::{self, Strongest};
use crate::signal::angles::wrap;
use crate::signal::spectrum::{self, Density};

/// A named line of a spectrum.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NamedLine {
    /// Interpolated frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude of that sinusoid, in the spectrum's unit (rad/s for angles).
    pub amplitude: f64,
    /// Its density over the median of its surroundings.
    pub prominence: f64,
    /// `f_e`, `2 f_e`, `f_e/2`, … where it belongs to the drive.
    pub name: Option<String>,
}

/// Spectrum of a coordinate, for reading and for plotting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spectrum {
    /// What it is of: `velocity` or `value`.
    pub of: &'static str,
    /// Unit of the density.
    pub unit: String,
    /// Spacing of the bins, Hz.
    pub bin_hz: f64,
    /// Samples in a piece.
    pub piece: usize,
    /// Pieces averaged.
    pub averages: usize,
    /// Frequency below which 99 % of the power lies that exceeds the sensor's noise, Hz.
    pub band_hz: f64,
    /// Strongest lines, the greatest amplitude first.
    pub lines: Vec<NamedLine>,
    /// Where most of the motion is; none where nothing stands above the sensor's noise.
    pub strongest: Option<Strongest>,
    /// Frequencies of the plotted points, Hz: the first 1000 bins, then means over bands that widen
    /// by 1 % each.
    pub frequency_hz: Vec<f32>,
    /// Densities at these.
    pub density: Vec<f32>,
}

/// One coordinate's numbers. SI units; `unit` names that of the values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coordinate {
    /// The model's name of it.
    pub name: String,
    /// Column it was measured in; none for a derived one.
    pub channel: Option<String>,
    /// Whether it is a measured input rather than a coordinate.
    #[serde(skip)]
    pub input: bool,
    /// Whether its sensor counts: q is then its own, not the last digit of a file.
    #[serde(skip)]
    pub counts: bool,
    /// SI unit of the values.
    pub unit: String,
    /// Circle or line.
    pub space: Space,
    /// Least value (unwrapped).
    pub least: f64,
    /// Greatest value (unwrapped).
    pub greatest: f64,
    /// Mean (unwrapped for angles: of little meaning when it whirls).
    pub mean: f64,
    /// Root mean square of the velocity, unit/s.
    pub rms_speed: f64,
    /// Greatest speed, unit/s.
    pub greatest_speed: f64,
    /// Net turns over all segments (angles).
    pub turns: Option<f64>,
    /// Net turns a drive period (driven angles).
    pub turns_per_period: Option<f64>,
    /// Share of the time beyond ±90° of hanging down (angles).
    pub beyond_90: Option<f64>,
    /// Quantisation step q, 0 where there is none.
    pub step: f64,
    /// q/√12.
    pub quantisation_noise: f64,
    /// Estimated white noise of the displacement, standard deviation.
    pub noise: f64,
    /// Half width m of the slope that velocities are taken with, samples.
    pub slope_half_width: usize,
    /// Its spectrum; none where it does not move.
    pub spectrum: Option<Spectrum>,
}

/// Chooses the length of a piece.
fn piece_length(longest: usize, samples_per_period: Option<f64>) -> usize {
    let eight = (2 * longest / 9).max(8);
    let wanted = match samples_per_period {
        Some(t) => eight.min((60.0 * t).round() as usize),
        None => eight.min(16_384),
    };
    spectrum::fast_length(wanted.clamp(8, longest.max(8)))
}

/// Welch's density of the increments.
fn density(motion: &Motion, rate_hz: f64, drive_hz: Option<f64>) -> Option<Density> {
    let series = motion.increments(rate_hz);
    let longest = series.iter().map(Vec::len).max().unwrap_or(0);
    let piece = piece_length(longest, drive_hz.map(|f| rate_hz / f));
    let parts: Vec<&[f64]> = series.iter().map(Vec::as_slice).collect();
    spectrum::welch(&parts, rate_hz, piece).ok()
}

/// Describes one coordinate. `denominator`: lines are named by fractions of the drive's frequency
/// up to this denominator.
pub fn describe(
    motion: &Motion,
    channel: Option<&str>,
    rate_hz: f64,
    drive_hz: Option<f64>,
    denominator: u32,
) -> Coordinate {
    let angle = motion.space == Space::S1;
    let all = || motion.stretches.iter().flatten();
    let count = all().count().max(1) as f64;
    let (least, greatest) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, g), &x| (l.min(x), g.max(x)));
    let noise = motion.noise();
    let density = if greatest > least { density(motion, rate_hz, drive_hz) } else { None };
    let spectrum = density.map(|d| summarise(d, motion, noise, rate_hz, drive_hz, denominator));
    let band = spectrum.as_ref().map_or(rate_hz / 20.0, |s| s.band_hz);
    let m = ((0.1 * rate_hz / band).round() as usize).clamp(2, 50);
    let velocities = motion.velocities(rate_hz, m);
    let squares: f64 = velocities.iter().flatten().map(|v| v * v).sum();
    let rms_speed = (squares / velocities.iter().flatten().count().max(1) as f64).sqrt();
    let greatest_speed = velocities.iter().flatten().fold(0.0, |g: f64, v| g.max(v.abs()));
    let net: f64 = motion.stretches.iter().filter_map(|x| Some(x.last()? - x.first()?)).sum::<f64>() / TAU;
    let seconds: f64 = motion.stretches.iter().map(|x| x.len().saturating_sub(1) as f64 / rate_hz).sum();
    let beyond = all().filter(|x| wrap(**x).abs() > PI / 2.0).count() as f64 / count;
    Coordinate {
        name: motion.name.clone(),
        channel: channel.map(str::to_owned),
        input: false,
        counts: false,
        unit: motion.unit.clone(),
        space: motion.space,
        least,
        greatest,
        mean: all().sum::<f64>() / count,
        rms_speed,
        greatest_speed,
        turns: angle.then_some(net),
        turns_per_period: drive_hz.filter(|_| angle && seconds > 0.0).map(|f| net / (seconds * f)),
        beyond_90: angle.then_some(beyond),
        step: motion.step,
        quantisation_noise: motion.quantisation_noise,
        noise,
        slope_half_width: m,
        spectrum,
    }
}

/// Corrects the density for the increments' response, names its lines, finds the band that holds
/// the motion.
fn summarise(
    mut d: Density,
    motion: &Motion,
    noise: f64,
    rate_hz: f64,
    drive_hz: Option<f64>,
    denominator: u32,
) -> Spectrum {
    for m in 0..d.density.len() {
        d.density[m] /= motion.response(d.frequency(m), rate_hz).powi(2);
    }
    let angle = motion.space == Space::S1;
    // Noise of standard deviation σ in x has the one-sided density 2σ²/f_s, in its velocity (2πf)²
    // times that.
    let noise_at = |f: f64| 2.0 * noise * noise / rate_hz * if angle { (TAU * f).powi(2) } else { 1.0 };
    let above: Vec<f64> =
        d.density.iter().enumerate().map(|(m, p)| (p - 3.0 * noise_at(d.frequency(m))).max(0.0)).collect();
    let total: f64 = above.iter().sum();
    let mut sum = 0.0;
    let band = above.iter().position(|p| {
        sum += p;
        sum >= 0.99 * total
    });
    let mut lines = spectrum::lines(&d, 12);
    // A line between two bins has less density than one of its amplitude on a bin.
    lines.sort_by(|a, b| b.amplitude.total_cmp(&a.amplitude));
    let lines = lines
        .into_iter()
        .map(|l| NamedLine {
            frequency_hz: l.frequency_hz,
            amplitude: l.amplitude,
            prominence: l.prominence,
            name: drive_hz.and_then(|f| drive_check::name(l.frequency_hz, f, 0.35 * d.bin_hz, denominator)),
        })
        .collect();
    let (frequency_hz, density) = thin(&d);
    Spectrum {
        of: if angle { "velocity" } else { "value" },
        unit: if angle { "rad²/s²/Hz".to_owned() } else { format!("{}²/Hz", motion.unit) },
        bin_hz: d.bin_hz,
        piece: d.piece,
        averages: d.averages,
        band_hz: band.map_or(rate_hz / 2.0, |m| d.frequency(m)).max(d.bin_hz),
        lines,
        strongest: strongest::find(motion, noise, rate_hz, d.piece, drive_hz, denominator),
        frequency_hz,
        density,
    }
}

/// The first 1000 bins, then means over bands that widen by 1 %.
fn thin(d: &Density) -> (Vec<f32>, Vec<f32>) {
    let mut points = (Vec::new(), Vec::new());
    let mut m = 0;
    while m < d.density.len() {
        let width = if m < 1000 { 1 } else { m / 100 };
        let end = (m + width).min(d.density.len());
        let mean = d.density[m..end].iter().sum::<f64>() / (end - m) as f64;
        points.0.push((0.5 * (d.frequency(m) + d.frequency(end - 1))) as f32);
        points.1.push(mean as f32);
        m = end;
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(x: Vec<f64>) -> Motion {
        Motion {
            name: "phi1".into(),
            unit: "rad".into(),
            space: Space::S1,
            derived: false,
            step: 0.0,
            quantisation_noise: 0.0,
            stretches: vec![x],
        }
    }

    #[test]
    fn a_whirl_with_a_wobble_has_its_numbers() {
        let (rate, f) = (500.0, 5.0);
        let x = (0..40_000)
            .map(|i| {
                let t = f64::from(i) / rate;
                TAU * f * t + 0.2 * (TAU * 2.5 * t).sin()
            })
            .collect();
        let c = describe(&motion(x), Some("count1"), rate, Some(f), 4);
        assert!((c.turns_per_period.unwrap() - 1.0).abs() < 1e-3);
        assert!((c.beyond_90.unwrap() - 0.5).abs() < 0.03);
        let want = ((TAU * f).powi(2) + 0.5 * (0.2 * TAU * 2.5).powi(2)).sqrt();
        assert!((c.rms_speed / want - 1.0).abs() < 1e-4, "{} {want}", c.rms_speed);
        let line = &c.spectrum.as_ref().unwrap().lines[0];
        assert_eq!(line.name.as_deref(), Some("f_e/2"));
        assert!((line.amplitude / (0.2 * TAU * 2.5) - 1.0).abs() < 1e-3, "{line:?}");
        assert!(c.spectrum.as_ref().unwrap().band_hz < 3.0);
    }

    #[test]
    fn a_fast_line_is_not_shrunk_by_the_increments() {
        let rate = 100.0;
        let x = (0..5000).map(|i| 0.01 * (TAU * 40.0 * f64::from(i) / rate).sin()).collect();
        let c = describe(&motion(x), None, rate, None, 4);
        let line = &c.spectrum.unwrap().lines[0];
        assert!((line.amplitude / (0.01 * TAU * 40.0) - 1.0).abs() < 1e-2, "{line:?}");
    }

    #[test]
    fn what_does_not_move_has_no_spectrum() {
        let c = describe(&motion(vec![0.5; 3000]), None, 100.0, Some(5.0), 4);
        assert!(c.spectrum.is_none() && c.rms_speed == 0.0 && c.noise == 0.0);
    }

    #[test]
    fn a_hump_that_stands_above_every_line_is_what_is_strongest() {
        // Noise through a damped resonance at 12 Hz; a faint tone at 30 Hz is all that is a line.
        let (rate, f, damping) = (500.0, 12.0, 2.0);
        let (omega, mut seed, mut p, mut v) = (TAU * f / rate, 1_u64, 0.0, 0.0);
        let mut step = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let noise = (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5;
            v += -omega * omega * p - omega / damping * v + noise * omega;
            p += v;
            p / 0.725
        };
        let shaken: Vec<f64> = (0..20_000).map(|_| step()).collect();
        let of = |hump: f64, tone: f64| {
            let tones = (0..20_000).map(|i| tone * (TAU * 30.0 * f64::from(i) / rate).sin());
            let x = shaken.iter().zip(tones).map(|(x, tone)| hump * x + tone).collect();
            describe(&Motion { unit: "m".into(), space: Space::R, ..motion(x) }, None, rate, None, 4).spectrum.unwrap()
        };
        let s = of(1.0, 0.06);
        assert!((s.lines[0].frequency_hz - 30.0).abs() < 0.1, "{:?}", s.lines);
        let hump = s.strongest.unwrap();
        assert!(hump.broad && (9.0..15.0).contains(&hump.frequency_hz), "{hump:?}");
        let line = of(1e-3, 0.06).strongest.unwrap();
        assert!(!line.broad && (line.frequency_hz - 30.0).abs() < 0.1, "{line:?}");
    }

    #[test]
    fn the_first_line_has_the_greatest_amplitude_wherever_it_falls_between_bins() {
        let rate = 500.0;
        let bin = rate / piece_length(40_000, None) as f64;
        // On a bin a line has up to 1.4 dB more density than halfway to the next.
        let (on, between) = (100.0 * bin, 300.5 * bin);
        let x = (0..40_000).map(|i| f64::from(i) / rate);
        let x = x.map(|t| 0.95 * (TAU * on * t).sin() + (TAU * between * t).sin()).collect();
        let m = Motion { unit: "m".into(), space: Space::R, ..motion(x) };
        let s = describe(&m, None, rate, None, 4).spectrum.unwrap();
        assert!((s.lines[0].frequency_hz - between).abs() < 0.1 * bin, "{:?}", s.lines);
        let strongest = s.strongest.unwrap();
        assert!((strongest.frequency_hz - between).abs() < 0.1 * bin && !strongest.broad, "{strongest:?}");
    }
}
