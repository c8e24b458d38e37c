//! Where in the spectrum the motion lies: the band that test functions and low-passes must hold.
//!
//! A force that at most jumps gives motion that falls like f⁻⁶ in power, noise falls at most like
//! f⁻². Counts that change rarely leave a shelf of noise over decades, which weighed by ω⁴ would
//! look like motion: so noise is a power law, not the white top of the band.
//!
//! S(f) is Welch's density (1967) of the second difference under a sin⁴ taper over |2 sin(π f
//! Δt)|⁴, in bands a third of an octave wide, six an octave, with mean m and median. N(f) is the
//! power law through the medians above 3 f, slope in [−2, 0], its level that of the lowest third.
//! The motion begins at the band f0 with the greatest f² (m − N) among those with m > 10 N, and
//! goes on upward while the next band above noise is within 2.2 f0 or 1.3 times the last, or is an
//! island of m > 100 N with more than a hundredth of the greatest acceleration. The thresholds were
//! set on 12 measured records and 12 simulated systems.
//!
//! A density is the mean over eight pieces or more. Where a record is too short for that, or its
//! motion too slow to be seen in an eighth of it, four, two or one piece must do ([`AVERAGES`]):
//! the motion begins then where m > 100 N, which noise in one bin of one piece does not reach; if
//! it lies in the lowest bin that can be told from a trend, longer pieces are looked at.
//!
//! Limits: one sensor at a time; motion that returns more than an octave above the last, fainter
//! than an island, is taken for noise.

use core::f64::consts::PI;

use realfft::RealFftPlanner;

/// Fewest averages of a density: as wished, then of a short record or a slow motion.
pub const AVERAGES: [usize; 4] = [8, 4, 2, 1];
/// Most and fewest points of a piece.
const MOST_POINTS: usize = 65_536;
const FEWEST_POINTS: usize = 32;
/// Bins that the taper spreads a trend over.
const LEAKED: usize = 3;
/// Bands an octave.
const PER_OCTAVE: f64 = 6.0;
/// Motion over noise: where it is beyond doubt, where it ends, and in an island.
const CLEAR: f64 = 10.0;
const ABOVE: f64 = 2.0;
const ISLAND: f64 = 100.0;
/// Share of the greatest acceleration that an island must have.
const ISLAND_SHARE: f64 = 0.01;
/// How far above the first and the last band the next may be.
const FROM_FIRST: f64 = 2.2;
const FROM_LAST: f64 = 1.3;
/// Fewest bands that a power law of noise is laid through.
const FEWEST_BANDS: usize = 6;

/// The band of a motion, Hz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// Median frequency of the acceleration: the dominant one.
    pub dominant_hz: f64,
    /// Frequency below which lie 99 % of the acceleration's power.
    pub acceleration_99_hz: f64,
    /// Where the motion is ten times the noise's density for the last time.
    pub clear_end_hz: f64,
    /// Where it is twice.
    pub end_hz: f64,
}

impl Band {
    /// One that holds both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            dominant_hz: self.dominant_hz.max(other.dominant_hz),
            acceleration_99_hz: self.acceleration_99_hz.max(other.acceleration_99_hz),
            clear_end_hz: self.clear_end_hz.max(other.clear_end_hz),
            end_hz: self.end_hz.max(other.end_hz),
        }
    }
}

/// Mean and median density of a third of an octave.
struct Third {
    hz: f64,
    mean: f64,
    median: f64,
}

/// The band of the motion in unbroken stretches of one sensor, sampled every `step_s`, from a mean
/// over so many pieces at least (one of [`AVERAGES`]); none where nothing stands above noise, the
/// stretches are short for that, or longer pieces would show the motion better.
pub fn of<'a>(stretches: impl Iterator<Item = &'a [f64]> + Clone, step_s: f64, averages: usize) -> Option<Band> {
    let (band, is_resolved) = looked_at(stretches, step_s, averages)?;
    (averages >= AVERAGES[0] || is_resolved).then_some(band)
}

/// The same from the most pieces that hold three periods each; from one whatever it holds.
pub fn resolved<'a>(stretches: impl Iterator<Item = &'a [f64]> + Clone, step_s: f64) -> Option<Band> {
    let of = |averages| looked_at(stretches.clone(), step_s, averages).filter(|found| found.1);
    AVERAGES.into_iter().find_map(of).map(|found| found.0)
}

/// The band from so many pieces at least, and whether longer ones would show it no better.
fn looked_at<'a>(
    stretches: impl Iterator<Item = &'a [f64]> + Clone,
    step_s: f64,
    averages: usize,
) -> Option<(Band, bool)> {
    let (density, bin_hz) = density(stretches, step_s, averages)?;
    let begins = if averages >= AVERAGES[0] { CLEAR } else { ISLAND };
    let thirds = thirds(&density, bin_hz);
    let noise: Vec<f64> = thirds.iter().map(|t| noise_at(&thirds, t.hz)).collect();
    let first = (0..thirds.len())
        .filter(|&k| thirds[k].mean > begins * noise[k])
        .max_by(|&a, &b| speed(&thirds[a], noise[a]).total_cmp(&speed(&thirds[b], noise[b])))?;
    let peak = thirds.iter().zip(&noise).map(|(t, n)| acceleration(t, *n)).fold(0.0, f64::max);
    let end = |above: f64| {
        let mut last = thirds[first].hz;
        for (t, n) in thirds.iter().zip(&noise).skip(first + 1).filter(|(t, n)| t.mean > above * **n) {
            let near = t.hz <= (FROM_FIRST * thirds[first].hz).max(FROM_LAST * last);
            if near || (t.mean > ISLAND * n && acceleration(t, *n) > ISLAND_SHARE * peak) {
                last = t.hz;
            }
        }
        // The upper edge of the band.
        last * 2f64.powf(1.0 / PER_OCTAVE)
    };
    let (clear_end_hz, end_hz) = (end(CLEAR), end(ABOVE));
    let power: Vec<f64> = density
        .iter()
        .enumerate()
        .map(|(k, s)| {
            let hz = k as f64 * bin_hz;
            let n = noise_at(&thirds, hz);
            if k >= LEAKED && hz <= clear_end_hz && *s > 3.0 * n { hz.powi(4) * (s - n) } else { 0.0 }
        })
        .collect();
    let whole: f64 = power.iter().sum();
    let share = |part: f64| {
        let mut sum = 0.0;
        let found = power.iter().position(|p| {
            sum += p;
            sum >= part * whole
        });
        found.map_or(thirds[first].hz, |k| k as f64 * bin_hz)
    };
    let is_last = averages <= AVERAGES[AVERAGES.len() - 1];
    if whole.is_nan() || whole <= 0.0 {
        return None;
    }
    let dominant_hz = share(0.5);
    // Half a bin more: numbers of bins are whole.
    let is_resolved = dominant_hz > (LEAKED as f64 + 0.5) * bin_hz;
    let band = Band { dominant_hz, acceleration_99_hz: share(0.99), clear_end_hz, end_hz };
    Some((band, is_resolved || is_last))
}

fn speed(t: &Third, noise: f64) -> f64 {
    t.hz.powi(2) * (t.mean - noise)
}

fn acceleration(t: &Third, noise: f64) -> f64 {
    t.hz.powi(4) * (t.mean - noise)
}

/// Density of the sensor by bins, up to a factor, and their width, Hz.
fn density<'a>(
    stretches: impl Iterator<Item = &'a [f64]> + Clone,
    step_s: f64,
    averages: usize,
) -> Option<(Vec<f64>, f64)> {
    let longest = stretches.clone().map(<[f64]>::len).max()?;
    let total: usize = stretches.clone().map(<[f64]>::len).sum();
    // Half-overlapping pieces.
    let most = (2 * total / (averages + 1)).min(longest.saturating_sub(2)).min(MOST_POINTS);
    if most < FEWEST_POINTS {
        return None;
    }
    let size = 1 << most.ilog2();
    let fft = RealFftPlanner::<f64>::new().plan_fft_forward(size);
    let taper: Vec<f64> = (0..size).map(|i| (PI * i as f64 / size as f64).sin().powi(4)).collect();
    let (mut input, mut output) = (fft.make_input_vec(), fft.make_output_vec());
    let mut sums = vec![0.0; size / 2 + 1];
    let mut count = 0.0;
    // A few hundred pieces settle a density; more of a long record add nothing.
    let stride = (size / 2).max(total / 400);
    for x in stretches {
        for start in (0..(x.len() + 1).saturating_sub(size + 2)).step_by(stride) {
            for (i, (to, w)) in input.iter_mut().zip(&taper).enumerate() {
                let k = start + i;
                *to = (x[k] - 2.0 * x[k + 1] + x[k + 2]) * w;
            }
            fft.process(&mut input, &mut output).ok()?;
            sums.iter_mut().zip(&output).for_each(|(s, z)| *s += z.norm_sqr());
            count += 1.0;
        }
    }
    let of = |(k, s): (usize, f64)| s / count / (2.0 * (PI * k as f64 / size as f64).sin()).powi(4);
    let density: Vec<f64> = sums.into_iter().enumerate().map(|(k, s)| if k == 0 { 0.0 } else { of((k, s)) }).collect();
    (count > 0.0).then(|| (density, 1.0 / (size as f64 * step_s)))
}

/// Bands from above what leaks to below the Nyquist frequency.
fn thirds(density: &[f64], bin_hz: f64) -> Vec<Third> {
    let last = density.len() - 1;
    let mut out = Vec::new();
    let mut centre = LEAKED as f64;
    while centre < 0.95 * last as f64 {
        let half = 2f64.powf(1.0 / PER_OCTAVE);
        // Between LEAKED and the number of bins.
        let (from, to) = ((centre / half).ceil() as usize, ((centre * half).floor() as usize).min(last));
        let mut bins: Vec<f64> = density[from.max(LEAKED - 1)..=to].to_vec();
        if !bins.is_empty() {
            let mean = bins.iter().sum::<f64>() / bins.len() as f64;
            out.push(Third { hz: centre * bin_hz, mean, median: crate::statistics::median(&mut bins) });
        }
        centre *= 2f64.powf(1.0 / PER_OCTAVE);
    }
    out
}

/// Density of the noise at a frequency, from the bands above three times it.
fn noise_at(thirds: &[Third], hz: f64) -> f64 {
    let above: Vec<[f64; 2]> =
        thirds.iter().filter(|t| t.hz >= 3.0 * hz && t.median > 0.0).map(|t| [t.hz.ln(), t.median.ln()]).collect();
    if above.len() < FEWEST_BANDS {
        let mut top: Vec<f64> = thirds.iter().rev().take(FEWEST_BANDS / 2).map(|t| t.median).collect();
        return crate::statistics::median(&mut top);
    }
    let n = above.len() as f64;
    let mean = |k: usize| above.iter().map(|p| p[k]).sum::<f64>() / n;
    let (x, y) = (mean(0), mean(1));
    let product: f64 = above.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
    let square: f64 = above.iter().map(|p| (p[0] - x).powi(2)).sum();
    let slope = (product / square).clamp(-2.0, 0.0);
    let mut levels: Vec<f64> = above.iter().map(|p| p[1] - slope * p[0]).collect();
    levels.sort_by(f64::total_cmp);
    let lowest = &levels[..(levels.len() / 3).max(1)];
    (lowest.iter().sum::<f64>() / lowest.len() as f64 + slope * hz.ln()).exp()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// A decaying swing with its third harmonic, counted.
    fn swing(hz: f64, rate: f64, seconds: f64, count: f64) -> Vec<f64> {
        (0..(seconds * rate) as usize)
            .map(|i| {
                let t = i as f64 / rate;
                let (w, a) = (2.0 * PI * hz * t, (-t / seconds).exp());
                ((a * w.sin() + 0.02 * a.powi(3) * (3.0 * w).sin()) / count + 0.5).floor() * count
            })
            .collect()
    }

    #[test]
    fn the_band_scales_with_the_motion_over_seven_decades() {
        for period_s in [1e-4, 1e-2, 1.0, 30.0, 1e3] {
            for samples in [40.0, 2000.0] {
                let x = swing(1.0 / period_s, samples / period_s, 60.0 * period_s, 1e-3);
                let b = of(core::iter::once(&x[..]), period_s / samples, 8).unwrap();
                let cycles = [b.dominant_hz, b.acceleration_99_hz, b.clear_end_hz].map(|f| f * period_s);
                assert!((0.8..1.6).contains(&cycles[0]), "{period_s} {samples}: {b:?}");
                assert!((0.8..4.5).contains(&cycles[1]), "{period_s} {samples}: {b:?}");
                assert!((1.0..20.0).contains(&cycles[2]), "{period_s} {samples}: {b:?}");
            }
        }
    }

    #[test]
    fn a_quiet_swing_of_few_counts_is_not_its_shelf_of_noise() {
        // 40 counts at 1 kHz: each lasts for 8 ms at least.
        let x = swing(0.5, 1000.0, 120.0, 0.05);
        let b = of(core::iter::once(&x[..]), 1e-3, 8).unwrap();
        assert!((0.4..0.7).contains(&b.dominant_hz) && b.acceleration_99_hz < 6.0, "{b:?}");
    }

    #[test]
    fn noise_alone_has_no_band() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(2);
        let x: Vec<f64> = (0..20_000).map(|_| rng.random::<f64>()).collect();
        for averages in AVERAGES {
            for samples in [20_000, 250, 20] {
                assert!(of(core::iter::once(&x[..samples]), 1e-3, averages).is_none(), "{averages} {samples}");
            }
        }
    }

    /// Five seconds of a camera at 30 Hz: an eighth of them holds no period.
    #[test]
    fn a_short_record_is_looked_at_in_longer_pieces() {
        for (hz, within) in [(1.2, 0.9..1.5), (3.0, 2.4..3.6)] {
            let x = swing(hz, 30.0, 4.5, 1e-3);
            assert!(of(core::iter::once(&x[..]), 1.0 / 30.0, AVERAGES[0]).is_none(), "{hz}");
            let b = AVERAGES.into_iter().find_map(|a| of(core::iter::once(&x[..]), 1.0 / 30.0, a)).unwrap();
            assert!(within.contains(&b.dominant_hz), "{hz}: {b:?}");
            assert_eq!(resolved(core::iter::once(&x[..]), 1.0 / 30.0), Some(b), "{hz}");
        }
    }
}
