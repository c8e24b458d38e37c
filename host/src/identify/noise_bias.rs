//! The bias that sensor noise puts into least squares, measured by simulation and taken off.
//!
//! Noise in the regressors shrinks a coefficient by the ratio of noise to signal in its column, and
//! jumping laws (Coulomb friction) react to it in their own way. The bias is a property of motion
//! and sensor, so it is measured by measuring a known motion again: the record θ̂, smoothed to the
//! band in which it stands clear of noise, is taken as the truth, the sensors are applied to it R
//! times, and
//!
//! δ = (1/R) Σ_r λ(sensor_r(θ̂)) − λ(θ̂),   corrected λ − δ
//!
//! (a parametric bootstrap estimate of bias, Efron and Tibshirani 1993, ch. 10). An encoder counts
//! θ̂ on a grid shifted by r/R of a count: over the shifts the quantisation errors cancel to first
//! order (their mean is the sawtooth of a count R times finer), and what is left is the bias. This
//! keeps what no independent noise has: at a reversal the count stands still. Other sensors get
//! white noise of the size found in the spectrum, in pairs of opposite sign, whose first order
//! cancels too.
//!
//! The noise of a sensor that does not count comes from the spectrum, where the tail of a motion
//! sampled coarsely looks like noise. Noise so large would leave larger residuals than the record
//! has: where the weighted rms of the repeats' is ρ > 2 times that of the record's, the bias is
//! measured again with the noise divided by ρ.
//!
//! The bias does not depend on the record's length: it is measured on at most 64 windows spread
//! over the record, so that a long record costs no more. The noise is seeded: the same record gives
//! the same bytes.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::regression::{RunSums, Solution, noise_alone, weighted_rms};
use super::windows::{Kernels, WindowRows, Windows, samples_needed};
use crate::statistics::Z95;

/// Number of repeats with independent-looking errors.
pub(crate) const REPEATS: usize = 4;
/// t₀.₉₇₅(3)/1.96 for four repeats.
const STRETCH_T: f64 = 3.182 / Z95;
/// Most windows on which the bias is measured.
const MOST_WINDOWS: usize = 64;
/// Windows taken together, so that they share their smoothed samples.
pub(crate) const STRETCH: usize = 8;

/// The bias of all coefficients, concatenated over the equations.
#[derive(Clone, Debug, PartialEq)]
pub struct Bias {
    /// What to take off: δ, shrunk by 1 − var δ/δ² (to 0 where δ is not larger than its scatter).
    pub value: DVector<f64>,
    /// Covariance of δ, from leaving out one stretch at a time: it belongs to what is known of the
    /// coefficients.
    pub covariance: DMatrix<f64>,
    /// Covariance of the coefficients over the repeats, stretched by t₀.₉₇₅(R−1)/1.96: what a
    /// motion that repeats cannot average out, since it meets the encoders' grids at the same
    /// points each time, and where these lie is not known.
    pub spread: DMatrix<f64>,
    /// Weighted rms residual over the repeats: that of the record where the noise assumed is its
    /// own.
    pub residual: f64,
    /// The same where the equations hold: of repeats of a solution, or what the repeats' residuals
    /// have beside those of the motion as it is.
    pub noise: f64,
    /// The largest square of the noise that is chance, over its mean square: the repeats' scatter
    /// with t₀.₉₇₅(R−1). A friction that sticks meets the noise of a joint at rest, and scatters
    /// most.
    pub by_chance: f64,
    /// ε of each equation that this gives.
    pub error: Vec<f64>,
}

impl Bias {
    /// Takes the bias off a solution, whose covariance gains what is not known of the bias.
    pub(crate) fn take_off(&self, solution: &mut Solution) {
        let coefficients = solution.coefficients.iter_mut().flat_map(DVector::iter_mut);
        coefficients.zip(self.value.iter()).for_each(|(c, d)| *c -= d);
        solution.covariance += &self.covariance;
        if solution.repeating {
            solution.covariance += &self.spread;
        }
    }
}

/// ρ above which the assumed noise is not the record's.
const TOO_MUCH: f64 = 2.0;

/// The bias with the noise `sigma` of each sensor, or, where such noise leaves residuals larger
/// than the record's (`left`, weighted rms), with as much less. `sigma` then becomes what it was
/// measured with. `counted`: for each sensor whether its noise is known from its counts.
pub(crate) fn with_noise_that_fits(
    sigma: &mut [f64],
    counted: &[bool],
    left: f64,
    measure: impl Fn(&[f64]) -> Option<Bias>,
) -> Option<Bias> {
    let bias = measure(sigma)?;
    let uncertain = sigma.iter().zip(counted).any(|(s, counted)| *s > 0.0 && !counted);
    let ratio = bias.residual / left;
    if !(uncertain && ratio.is_finite() && ratio > TOO_MUCH) {
        return Some(bias);
    }
    sigma.iter_mut().zip(counted).filter(|(_, counted)| !**counted).for_each(|(s, _)| *s /= ratio);
    measure(sigma)
}

/// The bias from the rows of known motions, as they are (`plain`) and measured again
/// (`repeats_rows`, [`REPEATS`] times); their `run` is the stretch. `solutions`: whether the motions
/// are solutions of the equations.
pub(crate) fn from_rows(
    solutions: bool,
    stretches: usize,
    plain_rows: &[WindowRows],
    repeats_rows: &[Vec<WindowRows>],
    terms: &[usize],
    weights: &[Vec<f64>],
) -> Option<Bias> {
    let sums = |rows: &[WindowRows]| RunSums::new(rows, stretches, terms, weights);
    let (plain, repeats): (RunSums, Vec<RunSums>) =
        (sums(plain_rows), repeats_rows.par_iter().map(|r| sums(r)).collect());
    // δ from all stretches but one (or from all).
    let delta = |without: Option<usize>| {
        let mut mean = -plain.solve(without)?;
        for rows in &repeats {
            mean += rows.solve(without)? / repeats.len() as f64;
        }
        Some(mean)
    };
    let all = delta(None)?;
    let each: Vec<DVector<f64>> = repeats.iter().filter_map(|rows| rows.solve(None)).collect();
    let mean = each.iter().fold(DVector::zeros(all.len()), |s, x| s + x) / each.len().max(1) as f64;
    let mut spread = DMatrix::zeros(all.len(), all.len());
    for x in &each {
        let d = x - &mean;
        spread += &d * d.transpose() * (STRETCH_T * STRETCH_T / (REPEATS - 1) as f64);
    }
    let n = stretches;
    let mut covariance = DMatrix::zeros(all.len(), all.len());
    if n > 1 {
        for change in (0..n).filter_map(|g| delta(Some(g))).map(|d| d - &all) {
            covariance += &change * change.transpose() * ((n - 1) as f64 / n as f64);
        }
    }
    let value = DVector::from_fn(all.len(), |i, _| {
        let square = all[i] * all[i];
        if square > 0.0 { all[i] * (1.0 - covariance[(i, i)] / square).max(0.0) } else { 0.0 }
    });
    let squares = repeats_rows.iter().map(|rows| weighted_rms(rows, terms, weights, &mean).powi(2));
    let residual = (squares.sum::<f64>() / repeats_rows.len().max(1) as f64).sqrt();
    let left = noise_alone((!solutions).then_some(plain_rows), repeats_rows, terms, weights, &mean);
    let by_chance = by_chance(&left.squares);
    Some(Bias { value, covariance, spread, residual, noise: left.rms, by_chance, error: left.error })
}

/// Largest of one more, over the mean, by t₀.₉₇₅.
fn by_chance(squares: &[f64]) -> f64 {
    let n = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / n;
    let variance = squares.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let share = Z95 * STRETCH_T * (variance * (1.0 + 1.0 / n)).sqrt() / mean;
    1.0 + if share.is_finite() { share } else { 0.0 }
}

/// Where stretches of `together` windows lie in segments of these lengths: segment, first sample,
/// end.
pub(crate) fn places(
    lengths: &[usize],
    kernels: &Kernels,
    windows: &Windows,
    step: f64,
    together: usize,
) -> Vec<(usize, usize, usize)> {
    // The smoothing takes its reach on either side once more.
    let one = samples_needed(windows, kernels, step) + 2 * kernels.clear.reach();
    let hop = windows.hop_s / step;
    let long = one + ((together - 1) as f64 * hop).ceil() as usize;
    let stride = (together as f64 * hop).round() as usize;
    let mut all: Vec<(usize, usize, usize)> = Vec::new();
    for (i, &length) in lengths.iter().enumerate() {
        let mut first = 0;
        while first + one <= length {
            all.push((i, first, (first + long).min(length)));
            first += stride.max(1);
        }
    }
    let count = all.len().min(MOST_WINDOWS / together);
    (0..count).map(|k| all[k * all.len() / count]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_scatters_more_may_be_more_by_chance() {
        assert!((by_chance(&[2.0; 4]) - 1.0).abs() < 1e-12);
        // Mean 1, variance 0.01: 1 + 3.182 · 0.1 · √1.25.
        let by = 0.1 * 0.75f64.sqrt();
        assert!((by_chance(&[1.0 - by, 1.0 + by, 1.0 - by, 1.0 + by]) - 1.3558).abs() < 1e-4);
        assert!((by_chance(&[0.0; 4]) - 1.0).abs() < 1e-12);
    }
}
