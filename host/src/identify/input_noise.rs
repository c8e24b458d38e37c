//! The noise of measured inputs: white, read off the top of the band, above the input's own signal.
//!
//! An input's noise reaches the coordinates through the system, where no sensor's noise is, so that
//! what it leaves in the equations would be taken for a missing effect. A record that is measured
//! again ([`super::remeasured`]) has its inputs disturbed by as much once more.
//!
//! Where an input changes by one step of its converter at a time, its noise is that step's, q/√12.
//!
//! Limits: an input that fills the band, or is held between changes, does not show its noise
//! ([`Level::Hidden`]).

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::stretches::Stretch;
use crate::model::model_file::ModelFile;
use crate::signal::noise;

/// Share of the top of the band, from half the sampling rate's 0.6 on, that a noise's level is read
/// off: an input's own signal must end below it.
const TOP: f64 = 0.3;
/// Most noise over an input's rms: an input that is white by itself is no noise.
const MOST: f64 = 0.1;
/// Least: that of numbers which are written with six digits.
const LEAST: f64 = 1e-6;
/// Share of samples alike their neighbours from which an input is held between changes, whose steps
/// reach up to the top of the band.
const HELD: f64 = 0.2;
/// Most of them of an input that a converter reads in few steps: a staircase stands longer. Share of
/// the changes that are one step (by hand).
const MOST_HELD: f64 = 0.9;
const ONE_STEP: f64 = 0.9;

/// The noise of one input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Level {
    /// Its standard deviation; 0 where there is none, or where it is known with the base's channel.
    Known(f64),
    /// The input hides it.
    Hidden,
}

impl Level {
    /// Standard deviation of what is known of it.
    pub fn sigma(self) -> f64 {
        if let Self::Known(sigma) = self { sigma } else { 0.0 }
    }
}

/// The noise of each measured input. That of a base is known by its own channel.
pub(super) fn of(stretches: &[Stretch]) -> Vec<Level> {
    let Some(first) = stretches.first() else { return Vec::new() };
    let base = first.base.as_ref().map(|b| b.input);
    let of = |k: usize| {
        let all = || stretches.iter().filter_map(move |s| s.inputs.get(k).map(Vec::as_slice));
        if base == Some(k) { Level::Known(0.0) } else { level(all, first.step_s) }
    };
    (0..first.inputs.len()).map(of).collect()
}

/// The same of one input.
fn level<'a, I: Iterator<Item = &'a [f64]> + Clone>(all: impl Fn() -> I, step_s: f64) -> Level {
    let Some(found) = noise::estimate(all(), step_s) else { return Level::Hidden };
    let count = all().map(<[f64]>::len).sum::<usize>().max(1) as f64;
    let mean = all().flatten().sum::<f64>() / count;
    let rms = (all().flatten().map(|u| (u - mean).powi(2)).sum::<f64>() / count).sqrt();
    let alike = all().flat_map(|u| u.windows(2)).filter(|w| w[0] == w[1]).count() as f64;
    if found.sigma <= LEAST * rms {
        return Level::Known(0.0);
    }
    if (HELD * count..MOST_HELD * count).contains(&alike)
        && let Some(step) = converter_step(all)
    {
        let sigma = step / 12f64.sqrt();
        return if sigma < MOST * rms { Level::Known(sigma) } else { Level::Hidden };
    }
    let shows = found.sigma < MOST * rms && found.signal_end_hz * step_s < TOP && alike < HELD * count;
    if shows { Level::Known(found.sigma) } else { Level::Hidden }
}

/// The step by which nearly all changes of an input go; none where they are of any size.
fn converter_step<'a, I: Iterator<Item = &'a [f64]>>(all: impl Fn() -> I) -> Option<f64> {
    let changes = || all().flat_map(|u| u.windows(2)).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 0.0);
    let step = changes().fold(f64::INFINITY, f64::min);
    let (one, every) = changes().fold((0.0, 0.0), |(one, n), d| (one + f64::from(u8::from(d < 1.01 * step)), n + 1.0));
    (one > ONE_STEP * every).then_some(step)
}

/// Names of the inputs that hide their noise.
pub(super) fn hidden(model: &ModelFile, levels: &[Level]) -> Vec<String> {
    model.inputs.iter().zip(levels).filter(|(_, l)| **l == Level::Hidden).map(|(name, _)| name.clone()).collect()
}

/// Adds noise of these standard deviations to the inputs of a stretch, uniform, times `sign`.
pub fn disturb(s: &mut Stretch, levels: &[Level], sign: f64, seed: u64, stream: u64) {
    for (k, (input, level)) in s.inputs.iter_mut().zip(levels).enumerate().filter(|(_, (_, l))| l.sigma() > 0.0) {
        let mut rng = ChaCha8Rng::seed_from_u64(0x1_9057 + seed);
        rng.set_stream((stream << 8) + k as u64);
        let width = sign * 2.0 * 3f64.sqrt() * level.sigma();
        input.iter_mut().for_each(|u| *u += width * (rng.random::<f64>() - 0.5));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_input(samples: &[f64]) -> Level {
        level(|| std::iter::once(samples), 0.005)
    }

    #[test]
    fn noise_is_read_above_the_inputs_band_and_hidden_within_it() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut white = |sigma: f64| sigma * 12f64.sqrt() * (rng.random::<f64>() - 0.5);
        let wave = |i: usize| 10.0 * (0.03 * i as f64).sin() + 5.0 * (0.071 * i as f64).cos();
        let noisy: Vec<f64> = (0..8_000).map(|i| wave(i) + white(0.1)).collect();
        let Level::Known(sigma) = of_input(&noisy) else { panic!("{:?}", of_input(&noisy)) };
        assert!((sigma / 0.1 - 1.0).abs() < 0.1, "{sigma}");
        let clean: Vec<f64> = (0..8_000).map(wave).collect();
        assert_eq!(of_input(&clean), Level::Known(0.0));
        let all: Vec<f64> = (0..8_000).map(|_| white(3.0)).collect();
        assert_eq!(of_input(&all), Level::Hidden);
        let held: Vec<f64> = all.iter().step_by(10).flat_map(|x| [*x; 10]).collect();
        assert_eq!(of_input(&held), Level::Hidden);
        assert_eq!(of_input(&[1.0; 10]), Level::Hidden);
        let coarse: Vec<f64> = (0..8_000).map(|i| 0.8 * (wave(i) / 0.8).round()).collect();
        let Level::Known(sigma) = of_input(&coarse) else { panic!("{:?}", of_input(&coarse)) };
        assert!((sigma / 0.8 * 12f64.sqrt() - 1.0).abs() < 1e-9, "{sigma}");
        let two: Vec<f64> = all.iter().step_by(10).flat_map(|x| [x.signum(); 10]).collect();
        let stairs: Vec<f64> = (0..8_000).map(|i| (i / 200 % 20) as f64).collect();
        assert!([two, stairs].iter().all(|u| of_input(u) == Level::Hidden));
    }
}
