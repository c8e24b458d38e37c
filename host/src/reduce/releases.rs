//! Releases gathered from records: every unbroken stretch, all channels in SI units, arms' angles
//! absolute.

use std::path::Path;

use serde::Serialize;

use super::decay;
use super::release_fit::{self, ReleaseFit};
use crate::error::{BadInput, Result};
use crate::record::Record;
use crate::rig::Rig;
use crate::signal::noise;
use crate::warning::Warning;

/// Residual beyond the noise, relative to the motion, up to which a release counts as a periodic motion of the
/// family.
pub const PERIODIC: f64 = 0.05;
/// Residual up to which a record is close to periodic at all.
const NEARLY: f64 = 0.3;
/// Share of even harmonics or sine parts that is told.
const NOTABLE: f64 = 0.01;

/// All stretches of all records.
#[derive(Clone, Debug)]
pub struct Gathered {
    /// `[release][channel][sample]`.
    pub releases: Vec<Vec<Vec<f64>>>,
    /// File and stretch of each.
    pub sources: Vec<(String, usize)>,
    /// Sampling step, s.
    pub step: f64,
    /// Coordinates.
    pub names: Vec<String>,
    /// SI units.
    pub units: Vec<String>,
    /// Whether an angle turns over.
    pub whirling: bool,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

impl Gathered {
    /// All releases one after the other, one vector a channel.
    pub fn whole(&self) -> Vec<Vec<f64>> {
        (0..self.names.len()).map(|c| self.releases.iter().flat_map(|r| r[c].iter().copied()).collect()).collect()
    }
}

/// A release as the result tells of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Release {
    /// File.
    pub file: String,
    /// Stretch in it.
    pub segment: usize,
    /// Periods in it.
    pub periods: f64,
    /// Amplitude: first harmonic of the major coordinate.
    pub amplitude: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Its standard error, Hz.
    pub frequency_std_error: f64,
    /// What harmonics of one frequency leave, relative to the motion.
    pub residual: f64,
    /// The same beyond the sensors' noise.
    #[serde(skip)]
    pub beyond_noise: f64,
    /// Even harmonics relative to odd ones.
    pub even_harmonics: f64,
    /// Parts out of phase relative to those in phase.
    pub out_of_phase: f64,
    /// Greatest Floquet multiplier of the full system's mode at this energy, where its equations
    /// are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floquet: Option<f64>,
    /// Energy, of the full system where known, of the model otherwise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub energy: Option<f64>,
    /// Whether the model was made with it.
    pub used: bool,
    /// What is remarkable about it: `off-mode`, `unstable`, `asymmetric`, `not-in-phase`,
    /// `growing`, `decaying` (a window of a decay).
    pub remarks: Vec<&'static str>,
}

/// Gathers.
///
/// # Errors
/// No samples; records of different rates.
pub fn gather(records: &[Record], rig: &Rig) -> Result<Gathered> {
    let Some(first) = records.first() else { return Err(BadInput::new("no record", "at least one record")) };
    let step = 1.0 / first.sample_rate_hz;
    let mut out = Gathered {
        releases: Vec::new(),
        sources: Vec::new(),
        step,
        names: names(rig),
        units: units(rig),
        whirling: false,
        warnings: Vec::new(),
    };
    let (absolute, shown) = (Absolute::of(rig), shown(rig));
    let mut short = 0;
    for record in records {
        if (record.sample_rate_hz * step - 1.0).abs() > 1e-3 {
            return Err(other_rate(&record.path, record.sample_rate_hz, &first.path, first.sample_rate_hz));
        }
        out.warnings.extend(record.warnings.iter().cloned());
        for (i, segment) in record.segments.iter().enumerate() {
            // A single sample between two gaps tells nothing of motion.
            if segment.len() < 2 {
                short += 1;
                continue;
            }
            let pairs = segment.columns.iter().zip(&record.channels).enumerate();
            let mut x: Vec<Vec<f64>> =
                pairs.filter(|(i, _)| shown.contains(i)).map(|(_, (c, ch))| c.angle(ch)).collect();
            absolute.make(&mut x);
            out.releases.push(x);
            out.sources.push((record.path.display().to_string(), i));
        }
    }
    if short > 0 {
        out.warnings.push(short_stretches(short));
    }
    if out.releases.is_empty() {
        return Err(no_stretch(&first.path));
    }
    out.whirling = out.units.iter().enumerate().any(|(c, u)| {
        // More than a whole turn between the ends of a swing.
        u == "rad"
            && out.releases.iter().any(|r| {
                let (low, high) =
                    r[c].iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
                high - low > std::f64::consts::TAU
            })
    });
    Ok(out)
}

/// The second arm's angle, where it is measured relative to the first, as an absolute one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Absolute(Option<(usize, usize)>);

impl Absolute {
    /// Of a rig's channels.
    pub(super) fn of(rig: &Rig) -> Self {
        let shown = shown(rig);
        let measures = |name: &str| shown.iter().position(|c| rig.channel[*c].measures == name);
        Self(measures("theta2").zip(measures("theta1").or_else(|| measures("phi1"))))
    }

    /// Adds the first arm's angle.
    pub(super) fn make(self, x: &mut [Vec<f64>]) {
        let Some((r, b)) = self.0 else { return };
        let arm = std::mem::take(&mut x[b]);
        x[r].iter_mut().zip(&arm).for_each(|(t, a)| *t += a);
        x[b] = arm;
    }
}

/// Channels that show coordinates: what moves a system from outside is no part of its modes.
pub(super) fn shown(rig: &Rig) -> Vec<usize> {
    let inputs = rig.inputs();
    (0..rig.channel.len()).filter(|c| !inputs.contains(c)).collect()
}

/// Coordinates.
pub(super) fn names(rig: &Rig) -> Vec<String> {
    let absolute = Absolute::of(rig).0.is_some();
    let name = |m: &str| if absolute { m.replace("theta", "phi") } else { m.to_owned() };
    shown(rig).into_iter().map(|c| name(&rig.channel[c].measures)).collect()
}

/// SI unit of each.
pub(super) fn units(rig: &Rig) -> Vec<String> {
    shown(rig).into_iter().map(|c| rig.channel[c].si_unit().to_owned()).collect()
}

/// The error for records of different rates.
pub(super) fn other_rate(path: &Path, rate: f64, first: &Path, first_rate: f64) -> BadInput {
    BadInput::new(format!("{rate} Hz"), format!("{first_rate} Hz, the rate of {}", first.display()))
        .in_file(path)
        .at("column t")
        .remedy("Reduce records of one rate together")
}

/// Stretches that are left out.
pub(super) fn short_stretches(count: usize) -> Warning {
    Warning::new(
        "short-stretches",
        format!("{count} stretches of a single sample are left out"),
        "Find out why samples are missing",
    )
}

/// The error for records without motion's least.
pub(super) fn no_stretch(path: &Path) -> BadInput {
    BadInput::new("no stretch of two samples or more", "a record of motion").in_file(path).remedy("Record again")
}

/// A periodic motion found in the records: a whole release, or a window of one that decays.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Index of the release.
    pub release: usize,
    /// Whether it is a window of a decay.
    pub decaying: bool,
    /// The fit.
    pub fit: ReleaseFit,
    /// What it leaves beyond the sensors' noise, relative to the motion.
    pub beyond_noise: f64,
}

impl Entry {
    /// A fit beside the mean square of the channels' noise, all together.
    fn new(release: usize, decaying: bool, fit: ReleaseFit, noise: f64) -> Self {
        let beyond_noise = (fit.residual.powi(2) - share_of(noise, &fit).powi(2)).max(0.0).sqrt();
        Self { release, decaying, fit, beyond_noise }
    }
}

/// The rms of the noise over that of a motion.
fn share_of(noise: f64, fit: &ReleaseFit) -> f64 {
    let square = |harmonics: &[Vec<f64>]| harmonics.iter().skip(1).flatten().map(|c| 0.5 * c * c).sum::<f64>();
    (noise / (square(&fit.cosine) + square(&fit.sine)).max(f64::MIN_POSITIVE)).sqrt()
}

/// Fits every release that swings, as a whole or, where it decays, window by window. `major`:
/// weights of the channels.
pub fn entries(gathered: &Gathered, major: &[f64]) -> Vec<Entry> {
    let mut out = Vec::new();
    for (release, x) in gathered.releases.iter().enumerate() {
        let channels: Vec<&[f64]> = x.iter().map(Vec::as_slice).collect();
        let Some(fit) = release_fit::fit(&channels, gathered.step, major).filter(|f| f.residual.is_finite()) else {
            continue;
        };
        let levels = channels.iter().filter_map(|x| noise::estimate(core::iter::once(*x), gathered.step));
        let noise: f64 = levels.map(|n| n.sigma * n.sigma).sum();
        let whole = Entry::new(release, false, fit, noise);
        if whole.beyond_noise >= PERIODIC {
            let windows = decay::windows(&channels, gathered.step, whole.fit.omega, major);
            // Where noise alone would be as much as what is off a mode, a decay tells nothing.
            let heard = windows.into_iter().take_while(|w| share_of(noise, w) < PERIODIC);
            let windows: Vec<Entry> = heard.map(|fit| Entry::new(release, true, fit, noise)).collect();
            let amplitude = |e: &Entry| e.fit.cosine[1].iter().zip(major).map(|(x, p)| x * p).sum::<f64>().abs();
            let falls = windows.windows(2).all(|w| amplitude(&w[1]) < amplitude(&w[0]));
            if windows.len() >= 3 && falls && windows.iter().all(|w| w.beyond_noise < PERIODIC) {
                out.extend(windows);
                continue;
            }
        }
        out.push(whole);
    }
    out
}

/// Whether the records as a whole are close to periodic: every motion that can be fitted is, and
/// one is so closely.
pub fn periodic(entries: &[Entry]) -> bool {
    entries.iter().any(|e| e.beyond_noise < PERIODIC) && entries.iter().all(|e| e.beyond_noise < NEARLY)
}

/// What to tell of a release.
pub fn describe(gathered: &Gathered, entry: &Entry, major: &[f64]) -> Release {
    let Entry { release, fit, beyond_noise, .. } = entry;
    let (file, segment) = gathered.sources[*release].clone();
    let mut remarks = Vec::new();
    if *beyond_noise >= PERIODIC {
        remarks.push("off-mode");
    }
    if fit.residual >= 0.01 && fit.residual_thirds[1] > 2.0 * fit.residual_thirds[0] {
        remarks.push("growing");
    }
    if fit.even_share() > NOTABLE && fit.even_share() > 3.0 * fit.sine_share() {
        remarks.push("asymmetric");
    }
    if fit.sine_share() > NOTABLE {
        remarks.push("not-in-phase");
    }
    let per_turn = std::f64::consts::TAU;
    Release {
        file,
        segment,
        periods: fit.periods,
        amplitude: fit.cosine[1].iter().zip(major).map(|(x, p)| x * p).sum(),
        frequency_hz: fit.omega / per_turn,
        frequency_std_error: fit.omega_error / per_turn,
        residual: fit.residual,
        beyond_noise: *beyond_noise,
        even_harmonics: fit.even_share(),
        out_of_phase: fit.sine_share(),
        floquet: None,
        energy: None,
        used: *beyond_noise < PERIODIC,
        remarks,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gathered(x: Vec<f64>, step: f64) -> Gathered {
        let mut state = 1_u32;
        let mut noise = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24) - 0.5
        };
        let noisy = x.into_iter().map(|x| x + 0.034 * noise()).collect();
        Gathered {
            releases: vec![vec![noisy]],
            sources: vec![("r.csv".to_owned(), 0)],
            step,
            names: vec!["x".to_owned()],
            units: vec!["m".to_owned()],
            whirling: false,
            warnings: Vec::new(),
        }
    }

    /// Noise of 0.01 on 0.2 leaves 7 % that is not periodic.
    #[test]
    fn noise_alone_puts_no_release_off_the_mode() {
        let swing =
            |off: f64| (0..2000).map(move |i| 0.2 * (0.05 * f64::from(i)).cos() + off * (0.083 * f64::from(i)).cos());
        let used = |off: f64| {
            let g = gathered(swing(off).collect(), 0.05);
            let all = entries(&g, &[1.0]);
            let release = describe(&g, &all[0], &[1.0]);
            assert!(release.residual > PERIODIC, "{release:?}");
            (release.used, release.remarks.contains(&"off-mode"))
        };
        assert_eq!(used(0.0), (true, false));
        assert_eq!(used(0.03), (false, true));
    }

    /// x″ + 0.01 x′ + x + x³ = 0 from 2, whose frequency falls from 0.31 to 0.17 Hz.
    #[test]
    fn a_long_decay_is_followed_from_the_frequency_of_its_beginning() {
        let rate = |[x, v]: [f64; 2]| [v, -0.01 * v - x - x * x * x];
        let along = |s: [f64; 2], k: [f64; 2], h: f64| [s[0] + h * k[0], s[1] + h * k[1]];
        let (mut s, h) = ([2.0, 0.0], 0.04);
        let x: Vec<f64> = (0..8000)
            .map(|_| {
                let now = s[0];
                let a = rate(s);
                let b = rate(along(s, a, 0.5 * h));
                let c = rate(along(s, b, 0.5 * h));
                let d = rate(along(s, c, h));
                s = core::array::from_fn(|i| s[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
                now
            })
            .collect();
        let all = entries(&gathered(x, h), &[1.0]);
        assert!(periodic(&all) && all.len() > 10 && all.iter().all(|e| e.decaying), "{}", all.len());
        let hz = |e: &Entry| e.fit.omega / core::f64::consts::TAU;
        assert!(hz(&all[0]) > 0.27 && hz(&all[all.len() - 1]) < 0.2, "{} {}", hz(&all[0]), hz(&all[all.len() - 1]));
    }
}
