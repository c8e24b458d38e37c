//! The base's own motion as what moves the arms: its acceleration, m/s², from a channel that shows
//! its position or its acceleration.
//!
//! A **position** is differentiated twice by a low-pass whose slope is exact in its pass band
//! ([`Kernel`]): flat up to a quarter beyond where the position stands above its noise, at least
//! four times the drive's frequency. Noise of σ m leaves √(2/5 · f/f_s) σ (2πf)² m/s² behind a
//! low-pass that ends at f. An offset makes no difference. The samples within the reach of the
//! low-pass at both ends of a stretch are spent; where they would be many (a sloshing tank of 1 Hz
//! over 20 s: half of all) the pass band is wider, while its noise stays small beside the
//! acceleration.
//!
//! An **acceleration** stands as it was measured, less its mean with sin⁴ as weights: what comes
//! and goes leaves no mean there, and what an accelerometer shows of gravity and of its own offset
//! is one. Of a base that is displaced by y in a stretch of T seconds at most 20 y/T² m/s² are
//! taken for an offset.
//!
//! A gain that is off stands with the coefficients: terms of the measured base have one of their
//! own (B16 and B26, or the system file's `scale`).
//!
//! Its noise is part of what the sensors' noise leaves: a record that is measured again
//! ([`super::remeasured`]) has its base measured again, with white noise that goes the same way.

use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::signal::low_pass::Kernel;
use crate::signal::noise::{self, Noise};
use core::f64::consts::TAU;

/// The pass band beyond the end of the signal, and the least of it in multiples of the drive's
/// frequency.
const BEYOND: f64 = 1.25;
const LEAST: f64 = 4.0;
/// The same at most, as a share of the sampling rate; the pass band of a free system where nothing
/// stands above the noise.
const MOST: f64 = 0.25;
const UNKNOWN: f64 = 0.1;

/// Most of the longest stretch that is spent at its ends, and the noise that is taken for it as a
/// share of the acceleration's rms (by hand: errors of what acts bend coefficients by its square).
const SPENT: f64 = 0.1;
const NOISY: f64 = 0.03;
/// Steps in which the pass band is widened.
const WIDER: f64 = 1.25;

/// The noise of a channel of the base.
#[derive(Clone, Debug)]
pub struct BaseNoise {
    /// Which of the model's inputs it is.
    pub input: usize,
    /// Standard deviation of what is measured, m or m/s².
    sigma: f64,
    /// What differentiates a position.
    kernel: Option<Kernel>,
}

impl BaseNoise {
    /// Noise of as many samples of the acceleration, m/s²; uniform before it is differentiated.
    pub fn series(&self, samples: usize, seed: u64, stream: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(stream);
        let width = 2.0 * 3f64.sqrt() * self.sigma;
        let mut white = |n: usize| -> Vec<f64> { (0..n).map(|_| width * (rng.random::<f64>() - 0.5)).collect() };
        match &self.kernel {
            None => white(samples),
            Some(kernel) => twice(kernel, &white(samples + 4 * kernel.reach())),
        }
    }
}

/// The base's acceleration over the segments of a record.
pub(super) struct BaseMotion {
    /// Of each segment; shorter than it by [`Self::trimmed`] at either end.
    pub(super) accelerations: Vec<Vec<f64>>,
    /// Samples of a segment that are spent at either end.
    pub(super) trimmed: usize,
    /// Its noise.
    pub(super) noise: Arc<BaseNoise>,
}

/// From the channel that shows it; none where no input of the model is the base.
pub(super) fn of(record: &Record, rig: &Rig, bound: &ObservedModel) -> Option<BaseMotion> {
    let input = bound.base?;
    let &channel = bound.inputs.get(input)?;
    let shown: Vec<Vec<f64>> =
        record.segments.iter().map(|s| s.columns[channel].angle(&record.channels[channel])).collect();
    let step_s = 1.0 / rig.sample_rate_hz;
    let noise = noise::estimate(shown.iter().map(Vec::as_slice), step_s);
    let of = |kernel| Arc::new(BaseNoise { input, sigma: noise.map_or(0.0, |n| n.sigma), kernel });
    if record.channels[channel].unit == "m/s2" {
        let mean = mean(&shown);
        let accelerations = shown.into_iter().map(|x| x.into_iter().map(|x| x - mean).collect()).collect();
        return Some(BaseMotion { accelerations, trimmed: 0, noise: of(None) });
    }
    let kernel = kernel(noise, rig, step_s, &shown);
    let accelerations = shown.iter().map(|x| twice(&kernel, x)).collect();
    Some(BaseMotion { accelerations, trimmed: 2 * kernel.reach(), noise: of(Some(kernel)) })
}

/// The low-pass that differentiates what the channel showed.
fn kernel(noise: Option<Noise>, rig: &Rig, step_s: f64, shown: &[Vec<f64>]) -> Kernel {
    let rate = 1.0 / step_s;
    let least = rig.drive.map_or(0.0, |d| LEAST * d.frequency_hz);
    let end = noise.map_or(UNKNOWN * rate, |n| n.signal_end_hz);
    let design = |pass: f64| Kernel::design(step_s, pass, (1.6 * pass).min(0.45 * rate));
    let mut pass = (BEYOND * end).max(least).min(MOST * rate);
    let mut kernel = design(pass);
    let longest = shown.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let spends_much = |kernel: &Kernel| 4.0 * kernel.reach() as f64 > SPENT * longest;
    let Some(noise) = noise.filter(|_| spends_much(&kernel)) else { return kernel };
    let acceleration = |kernel: &Kernel| -> f64 {
        let all: Vec<f64> = shown.iter().flat_map(|x| twice(kernel, x)).collect();
        // Where nothing is left, all is to be gained.
        if all.is_empty() { f64::INFINITY } else { (all.iter().map(|a| a * a).sum::<f64>() / all.len() as f64).sqrt() }
    };
    while spends_much(&kernel) && WIDER * pass < MOST * rate {
        let end = 1.6 * WIDER * pass;
        let left = (0.4 * end / rate).sqrt() * noise.sigma * (TAU * end).powi(2);
        if left > NOISY * acceleration(&kernel) {
            break;
        }
        pass *= WIDER;
        kernel = design(pass);
    }
    kernel
}

/// The second derivative.
fn twice(kernel: &Kernel, x: &[f64]) -> Vec<f64> {
    let (mut smooth, mut slope, mut second) = (Vec::new(), Vec::new(), Vec::new());
    kernel.apply(x, &mut smooth, &mut slope);
    kernel.apply(&slope, &mut smooth, &mut second);
    second
}

/// The mean over all segments, each weighed with sin⁴ over its length.
fn mean(segments: &[Vec<f64>]) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for x in segments {
        // The longest ends count for all: short ones leave more of what comes and goes.
        let length = x.len() as f64;
        for (i, x) in x.iter().enumerate() {
            let w = length * (core::f64::consts::PI * (i as f64 + 0.5) / length).sin().powi(4);
            sum += w * x;
            weights += w;
        }
    }
    if weights > 0.0 { sum / weights } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_gives_the_acceleration_of_every_harmonic() {
        let step = 1.0 / 500.0;
        let kernel = Kernel::design(step, 25.0, 40.0);
        let position = |t: f64| 0.0155 * (TAU * 5.0 * t).cos() + 0.002 * (TAU * 10.3 * t + 1.0).sin() + 0.3 + 0.1 * t;
        let acceleration = |t: f64| {
            -0.0155 * (TAU * 5.0_f64).powi(2) * (TAU * 5.0 * t).cos()
                - 0.002 * (TAU * 10.3_f64).powi(2) * (TAU * 10.3 * t + 1.0).sin()
        };
        let x: Vec<f64> = (0..3_000).map(|i| position(f64::from(i) * step)).collect();
        let found = twice(&kernel, &x);
        assert_eq!(found.len(), 3_000 - 4 * kernel.reach());
        for (i, a) in found.iter().enumerate() {
            let t = (i + 2 * kernel.reach()) as f64 * step;
            // Of 15 and 8 m/s².
            assert!((a - acceleration(t)).abs() < 2e-3, "{i}: {a} {}", acceleration(t));
        }
    }

    /// White noise of a position becomes √(∫ (2πf)⁴ df) of its density below the low-pass's end.
    #[test]
    fn noise_goes_the_way_of_the_signal() {
        let noise = BaseNoise { input: 0, sigma: 5e-6, kernel: Some(Kernel::design(1.0 / 500.0, 20.0, 32.0)) };
        let x = noise.series(50_000, 1, 0);
        assert_eq!((x.len(), x[..5].to_vec()), (50_000, noise.series(5_000, 1, 0)[..5].to_vec()));
        let rms = (x.iter().map(|x| x * x).sum::<f64>() / 50_000.0).sqrt();
        let of = |f: f64| (2.0 * TAU.powi(4) * f.powi(5) / 5.0 / 500.0).sqrt() * 5e-6;
        assert!(rms > of(20.0) && rms < of(32.0), "{rms} {} {}", of(20.0), of(32.0));
        let plain = BaseNoise { kernel: None, sigma: 0.02, ..noise };
        let x = plain.series(50_000, 1, 0);
        let rms = (x.iter().map(|x| x * x).sum::<f64>() / 50_000.0).sqrt();
        assert!((rms / 0.02 - 1.0).abs() < 0.01, "{rms}");
    }

    /// A tank of 1.1 Hz for 20 s at 25 samples a second: the low-pass that ends just above it would
    /// reach over half of the record. One that hides in noise keeps it, and so does a long record.
    #[test]
    fn a_short_record_is_not_spent_at_its_ends() {
        let text = include_str!("../../../rigs/measured-base.toml");
        let mut rig = Rig::parse(text, std::path::Path::new("../rigs/measured-base.toml")).unwrap();
        (rig.drive, rig.sample_rate_hz) = (None, 25.0);
        let spent = |seconds: usize, sigma: f64| {
            let position = |i: usize| 0.014 * (TAU * 1.1 * i as f64 / 25.0).sin();
            let x: Vec<f64> = (0..25 * seconds).map(position).collect();
            let (signal_end_hz, square_error) = (1.5, 0.1);
            let noise = Noise { sigma, square_error, signal_end_hz, clear_end_hz: 1.4, acceleration_99_hz: 1.2 };
            4.0 * kernel(Some(noise), &rig, 0.04, &[x]).reach() as f64 / (25 * seconds) as f64
        };
        assert!(spent(20, 1e-5) < 0.3, "{}", spent(20, 1e-5));
        assert!(spent(20, 1e-3) > 0.4 && spent(600, 1e-5) < 0.05, "{} {}", spent(20, 1e-3), spent(600, 1e-5));
    }

    #[test]
    fn an_offset_is_told_from_a_motion_that_comes_and_goes() {
        let wave = |n: usize, offset: f64| -> Vec<f64> {
            (0..n).map(|i| offset + 15.0 * (TAU * 5.0 * i as f64 / 500.0 + 0.7).cos()).collect()
        };
        assert!((mean(&[wave(10_037, 9.81), wave(513, 9.81)]) - 9.81).abs() < 1e-4);
        assert_eq!(mean(&[]), 0.0);
    }
}
