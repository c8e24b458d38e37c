//! The amplitude of the base as it is measured, brought to what is wanted before a record begins.
//!
//! Over whole periods of the drive the base's channel is fitted by x₀ + p cos φ + q sin φ, φ the
//! device's phase, in groups of at least 16 samples; an accelerometer's amplitude is divided
//! by Ω². The mean of five groups or more and a second or more is held against the wanted
//! amplitude, their scatter gives its standard error s. They agree where they differ by
//! max(0.5 %, 3 s, half of the micrometre that can be commanded); else wanted/measured times what is
//! commanded is commanded next, along the device's ramp. One that needs less than half or more than
//! twice the wanted amplitude is given up, and so is what takes longer than 30 s (40 periods of a
//! slow drive) of the device's time.

use core::f64::consts::TAU;

use whirl_shared::block::samples;
use whirl_shared::excitation::amplitude_limit;
use whirl_shared::frame::{Hello, SampleBlock};
use whirl_shared::least_squares::LeastSquares;
use whirl_shared::waveform::{cos_sin, exact_frequency};

use super::CaptureSettings;
use super::drive::Target;
use super::excite::words;
use crate::error::{BadInput, Result};
use crate::record::Level;
use crate::rig::Rig;
use crate::rig::measures::BASE;
use crate::wording::format::rounded;

/// Fewest samples of a fit, and fewest fits of a mean.
const FEWEST: u32 = 16;
const GROUPS: usize = 5;
/// Least time of a mean, and time left to the shaker behind its ramp, s.
const MEAN_S: f64 = 1.0;
const CALM_S: f64 = 0.3;
/// Greatest difference that is good enough, whatever the noise, and greatest that noise may cause.
const GOOD: f64 = 0.005;
const NOISY: f64 = 0.05;
/// What may be commanded of what is wanted.
const GAINS: [f64; 2] = [0.5, 2.0];
/// Longest time, s, and in periods of the drive.
const LONGEST_S: f64 = 30.0;
const LONGEST_PERIODS: f64 = 40.0;

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// Go on.
    Waiting,
    /// Command this amplitude, µm.
    Command(u32),
    /// It is level.
    Level(Level),
}

/// What of a capture's settings stands against levelling.
///
/// # Errors
/// Names the option, and what is to be done.
pub(super) fn check(settings: &CaptureSettings, rig: &Rig, target: Option<Target>) -> Result<()> {
    const OPTION: &str = "--level-amplitude";
    let bad = |found: String, expected: &str, remedy: &str| {
        Err(BadInput::new(found, expected).in_file(&rig.path).at(OPTION).remedy(remedy))
    };
    if !rig.channel.iter().any(|c| c.measures == BASE) {
        return bad(
            "a rig whose base is not measured".to_owned(),
            "a channel with measures = \"base\"",
            "Add the base's sensor to the rig file (docs/rig-file.md), or leave the option out",
        );
    }
    let Some(target) = target else {
        return bad("no drive".to_owned(), "a drive with an amplitude", "Give --amplitude-m, or leave the option out");
    };
    let excitation = &target.0;
    if !excitation.is_constant() || excitation.on_trigger {
        return bad(
            words(excitation),
            "one sine of one amplitude, started at once",
            "Leave it out, or --sweep, --multisine, --table, --amplitude-steps, --on-trigger: the fundamental says nothing of the rest",
        );
    }
    if target.amplitude_micrometre() == 0 {
        return bad("an amplitude of 0".to_owned(), "one above 0", "Give --amplitude-m");
    }
    if settings.rows || !settings.wait_for_drive {
        let what = if settings.rows { "--rows" } else { "--from-first-sample" };
        return bad(format!("{OPTION} with {what}"), "one of them", "Leave one of them out");
    }
    Ok(())
}

/// Greatest amplitude that a device commands at a frequency, µm.
pub(super) fn most(hello: &Hello, target: Target) -> u32 {
    let limits = hello.limits;
    let still = amplitude_limit(limits.acceleration_millimetre_per_s2, target.frequency_millihertz(), &target.0.form);
    still.min(limits.amplitude_micrometre).min(hello.full_scale_micrometre)
}

/// A fit that grows.
#[derive(Debug)]
struct Group {
    fit: LeastSquares<f64, 3>,
    samples: u32,
    /// Of the first sample: a fit of small numbers is exact.
    from: i32,
}

/// Levels the amplitude.
#[derive(Debug)]
pub(super) struct Leveller {
    wanted: u32,
    commanded: u32,
    /// m or m/s² of a count, and whether it is m/s².
    count: f64,
    is_acceleration: bool,
    rate_millihertz: u32,
    /// The device's tick at which it began, that of the last sample and its phase.
    begun: Option<u32>,
    last: Option<(u32, u32)>,
    /// Samples since the amplitude was there.
    calm: u32,
    group: Option<Group>,
    groups: Vec<[f64; 2]>,
    samples: u32,
    measured: Option<f64>,
}

impl Leveller {
    /// Of a rig with a channel for its base; none otherwise.
    pub(super) fn new(rig: &Rig, target: Target) -> Option<Self> {
        let channel = rig.channel.iter().find(|c| c.measures == BASE)?;
        Some(Self {
            wanted: target.amplitude_micrometre(),
            commanded: target.amplitude_micrometre(),
            count: (channel.gain.unwrap_or(1.0) * channel.scale()).abs(),
            is_acceleration: channel.unit == "m/s2",
            rate_millihertz: (rig.sample_rate_hz * 1e3).round() as u32,
            begun: None,
            last: None,
            calm: 0,
            group: None,
            groups: Vec::new(),
            samples: 0,
            measured: None,
        })
    }

    fn rate_hz(&self) -> f64 {
        f64::from(self.rate_millihertz) / 1e3
    }

    fn again(&mut self) {
        (self.calm, self.samples, self.group) = (0, 0, None);
        self.groups.clear();
    }

    /// Takes a block; `most` is the greatest amplitude that may be commanded, µm.
    ///
    /// # Errors
    /// What cannot be levelled: see the module's text.
    pub(super) fn block(&mut self, block: &SampleBlock, most: u32) -> Result<Verdict> {
        let begun = *self.begun.get_or_insert(block.first_tick);
        let frequency = exact_frequency(block.phase_increment, self.rate_millihertz);
        let time_s = f64::from(block.first_tick.wrapping_sub(begun)) / self.rate_hz();
        let longest = if frequency > 0.0 { LONGEST_S.max(LONGEST_PERIODS / frequency) } else { LONGEST_S };
        if time_s > longest {
            return Err(self.failed(&format!("not level after {longest:.0} s"), None));
        }
        if block.phase_increment == 0 || block.amplitude_nanometre != self.commanded.saturating_mul(1_000) {
            self.again();
            self.last = None;
            return Ok(Verdict::Waiting);
        }
        for sample in samples(block) {
            let Some(&count) = sample.counts.last() else { continue };
            self.sample(sample.tick, sample.phase, count);
        }
        if self.groups.len() < GROUPS || f64::from(self.samples) < MEAN_S * self.rate_hz() {
            return Ok(Verdict::Waiting);
        }
        let worth = if self.is_acceleration { self.count / (TAU * frequency).powi(2) } else { self.count };
        self.decide(worth, most)
    }

    fn sample(&mut self, tick: u32, phase: u32, count: i32) {
        let last = self.last.replace((tick, phase));
        let Some((_, before)) = last.filter(|(before, _)| before.wrapping_add(1) == tick) else {
            // Samples are missing.
            return self.again();
        };
        self.calm = self.calm.saturating_add(1);
        if f64::from(self.calm) < CALM_S * self.rate_hz() {
            return;
        }
        if phase < before && self.group.as_ref().is_none_or(|group| group.samples >= FEWEST) {
            // A period ends.
            if let Some(group) = self.group.take() {
                self.samples += group.samples;
                self.groups.extend(group.fit.solve(1e-6).ok().map(|fit| [fit.values[1], fit.values[2]]));
            }
            self.group = Some(Group { fit: LeastSquares::new(), samples: 0, from: count });
        }
        if let Some(group) = &mut self.group {
            let (cos, sin) = cos_sin::<f64>(phase);
            group.fit.push([1.0, cos, sin], f64::from(count.wrapping_sub(group.from)));
            group.samples += 1;
        }
    }

    /// Holds the mean of the groups against what is wanted.
    fn decide(&mut self, worth: f64, most: u32) -> Result<Verdict> {
        let n = self.groups.len() as f64;
        let mean = [0, 1].map(|i| self.groups.iter().map(|g| g[i]).sum::<f64>() / n);
        let amplitude = mean[0].hypot(mean[1]);
        // Scatter along the mean, which is that of the amplitude.
        let along = |g: &[f64; 2]| (g[0] * mean[0] + g[1] * mean[1]) / amplitude.max(f64::MIN_POSITIVE) - amplitude;
        let scatter: f64 = self.groups.iter().map(|g| along(g).powi(2)).sum();
        let [measured, std_error] = [amplitude, (scatter / (n * (n - 1.0))).sqrt()].map(|counts| counts * worth);
        let [wanted, commanded] = [self.wanted, self.commanded].map(|micrometre| f64::from(micrometre) * 1e-6);
        let gain = measured / commanded;
        self.measured = Some(measured);
        let noise = 3.0 * std_error / wanted;
        if noise > NOISY {
            let what = format!("a channel whose noise makes it uncertain by {:.1} %", 100.0 * noise);
            return Err(self.failed(&what, None));
        }
        let good = GOOD.max(noise).max(0.5e-6 * gain / wanted);
        if (measured / wanted - 1.0).abs() <= good {
            // Short decimals, which JSON gives back to the last bit: a journal makes the same record.
            let [wanted_m, commanded_m, measured_m, std_error_m, gain] =
                [wanted, commanded, measured, std_error, gain].map(|x| rounded(x, 9));
            return Ok(Verdict::Level(Level { wanted_m, commanded_m, measured_m, std_error_m, gain }));
        }
        let next = commanded * wanted / measured * 1e6;
        let [least, greatest] = GAINS.map(|gain| f64::from(self.wanted) * gain);
        if !(least..=greatest.min(f64::from(most))).contains(&next.round()) {
            let why = if next > f64::from(most) && next <= greatest {
                "beyond the device's limits"
            } else {
                "not from half to twice the wanted amplitude"
            };
            let at = if next.is_finite() { millimetres(next * 1e-6) } else { "no amplitude".to_owned() };
            return Err(self.failed(&format!("level at {at}, which is {why}"), Some(gain)));
        }
        // From half to twice 32 bits' micrometres within the device's limits.
        self.commanded = next.round() as u32;
        self.again();
        self.last = None;
        Ok(Verdict::Command(self.commanded))
    }

    fn failed(&self, what: &str, gain: Option<f64>) -> BadInput {
        let [wanted, commanded] = [self.wanted, self.commanded].map(|micrometre| f64::from(micrometre) * 1e-6);
        let measured = self.measured.map_or_else(|| "nothing yet".to_owned(), millimetres);
        let gain = gain.map_or_else(String::new, |gain| format!(", gain {gain:.3}"));
        BadInput::new(
            format!("{what} (measured {measured} for {} commanded{gain})", millimetres(commanded)),
            format!("{} that the base's channel shows", millimetres(wanted)),
        )
        .at("--level-amplitude")
        .remedy(
            "See to the amplifier's gain and to the base's sensor (its gain and unit in the rig file); without the option the \
             amplitude is commanded as it is",
        )
    }
}

fn millimetres(metres: f64) -> String {
    format!("{:.3} mm", metres * 1e3)
}

/// In words, for people.
pub fn told(level: &Level) -> String {
    format!(
        "amplitude levelled: {} ± {:.4} mm measured of {} wanted, {} commanded (gain {:.4})",
        millimetres(level.measured_m),
        2.0 * level.std_error_m * 1e3,
        millimetres(level.wanted_m),
        millimetres(level.commanded_m),
        level.gain
    )
}

#[cfg(test)]
#[path = "level_tests.rs"]
mod tests;
