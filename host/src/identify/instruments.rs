//! Instruments from even and odd samples, for heavy noise.
//!
//! Noise in the regressors biases least squares, AᵀA λ = Aᵀb, because the noise of a column meets itself. The samples of even and of
//! odd number hold the same motion with independent noise; rows E from the even and O from the odd samples of the same windows give
//!
//! (EᵀO + OᵀE) λ = Eᵀb_O + Oᵀb_E,
//!
//! in which no noise meets itself (instrumental variables; Söderström and Stoica 1983). What is left is attenuation: noise n inside a harmonic gives
//! E cos k(θ + n) = κ_k cos kθ, κ_k = E cos kn = exp(−k²σ²/2) (exact for Gaussian noise; for uniform noise of σ = 0.18 rad 6e-5 off),
//! so that the fit, which multiplies the shrunken column, finds λ/κ: λ_j = κ_k λ̂_j. σ² is the sensor's, from the top of its spectrum
//! ([`crate::signal::noise`]).
//!
//! Standard errors: delete-one-block jackknife as in [`super::regression`], and the uncertainty of σ² in κ.
//! Half the sampling rate must still resolve the motion: from some ten samples a drive period on.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::windows::{Kernels, WindowRows, Windows, frequency_of_row, rows};
use crate::model::weak::WeakModel;
use crate::signal::angles::{AngleSegment, Phase};
use crate::signal::low_pass::Kernel;

/// Loss 1 − κ from which instruments are used.
const WANTED: f64 = 1e-4;
/// Fewest blocks for a jackknife.
const FEWEST_BLOCKS: usize = 6;

/// What was done.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Instruments {
    /// Standard deviation of the noise, rad.
    pub noise_rad: f64,
    /// κ of first-order harmonics.
    pub attenuation: f64,
    /// Windows of which both halves were used.
    pub windows: usize,
}

/// Coefficients with covariance.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Coefficients, equation by equation.
    pub coefficients: Vec<DVector<f64>>,
    /// Joint covariance.
    pub covariance: DMatrix<f64>,
    /// What was done.
    pub done: Instruments,
}

/// κ of a harmonic of order k under noise of standard deviation σ, rad.
pub fn attenuation(order: f64, sigma: f64) -> f64 {
    (-0.5 * (order * sigma).powi(2)).exp()
}

/// Whether noise of standard deviation `sigma` is heavy for a model that says how noise shrinks its columns.
pub fn wanted(model: &WeakModel, sigma: f64) -> bool {
    !model.attenuation.is_empty() && 1.0 - attenuation(1.0, sigma) > WANTED
}

/// Every other sample from `first` on.
fn half(s: &AngleSegment, first: usize) -> AngleSegment {
    let pick = |x: &Vec<f64>| x.iter().skip(first).step_by(2).copied().collect::<Vec<f64>>();
    AngleSegment {
        start_s: s.time(first),
        step_s: 2.0 * s.step_s,
        phi: [pick(&s.phi[0]), pick(&s.phi[1])],
        phase: match &s.phase {
            Phase::Device(turns) => Phase::Device(turns.iter().skip(first).step_by(2).copied().collect()),
            Phase::Clock(omega) => Phase::Clock(*omega),
        },
        relative: s.relative,
        count_rad: s.count_rad,
    }
}

/// Normal matrix and right-hand side of some windows.
fn normal(
    even: &[WindowRows],
    odd: &[WindowRows],
    e: usize,
    p: usize,
    weights: &[f64],
) -> (DMatrix<f64>, DVector<f64>) {
    let (mut matrix, mut right) = (DMatrix::zeros(p, p), DVector::zeros(p));
    for (a, b) in even.iter().zip(odd) {
        let pairs = a.equations[e].chunks_exact(p + 1).zip(b.equations[e].chunks_exact(p + 1));
        for (r, (x, y)) in pairs.enumerate() {
            let w = weights[frequency_of_row(r)];
            for i in 0..p {
                for j in 0..p {
                    matrix[(i, j)] += w * (x[i] * y[j] + y[i] * x[j]);
                }
                right[i] += w * (x[i] * y[p] + y[i] * x[p]);
            }
        }
    }
    (matrix, right)
}

/// Solves (columns scaled by the diagonal's size).
fn solve_normal(matrix: &DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let p = right.len();
    let scale: Vec<f64> = (0..p).map(|i| 1.0 / matrix[(i, i)].abs().sqrt()).collect();
    if scale.iter().any(|s| !s.is_finite()) {
        return None;
    }
    let scaled = DMatrix::from_fn(p, p, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let x = scaled.lu().solve(&DVector::from_fn(p, |i, _| right[i] * scale[i]))?;
    let x = DVector::from_fn(p, |i, _| x[i] * scale[i]);
    x.iter().all(|v| v.is_finite()).then_some(x)
}

/// Solves all equations with instruments; `None` where there are too few windows or nothing determines a coefficient.
pub fn solve(
    segments: &[AngleSegment],
    model: &WeakModel,
    kernels: &Kernels,
    windows: &Windows,
    sigma: f64,
) -> Option<Solution> {
    let step = 2.0 * segments.first()?.step_s;
    let narrow = |k: &Kernel| {
        let pass = k.pass_hz.min(0.2 / step);
        Kernel::design(step, pass, (pass + k.stop_hz - k.pass_hz).min(0.45 / step))
    };
    let kernels = Kernels { full: narrow(&kernels.full), clear: narrow(&kernels.clear) };
    let halves = [0, 1].map(|first| {
        let half: Vec<AngleSegment> = segments.iter().map(|s| half(s, first)).collect();
        rows(&half, model, &kernels, windows)
    });
    // The odd half may be one sample shorter and have one window less.
    let [even, odd] = &halves;
    let (even, odd): (Vec<WindowRows>, Vec<WindowRows>) = even
        .iter()
        .filter_map(|a| Some((a.clone(), odd.iter().find(|b| (b.run, b.index) == (a.run, a.index))?.clone())))
        .unzip();
    let n = even.len();
    let block = 2.max(n.div_ceil(200));
    let blocks: Vec<(usize, usize)> = (0..n).step_by(block).map(|a| (a, (a + block).min(n))).collect();
    if blocks.len() < FEWEST_BLOCKS {
        return None;
    }
    let total: usize = model.equations.iter().map(|e| e.terms.len()).sum();
    let mut coefficients = Vec::new();
    let mut changes = vec![DVector::zeros(total); blocks.len()];
    let mut slopes = DVector::zeros(total);
    let mut offset = 0;
    for (e, equation) in model.equations.iter().enumerate() {
        let p = equation.terms.len();
        let mut weights = vec![1.0; windows.frequencies + 1];
        let mut found = DVector::zeros(p);
        for round in 0..3 {
            let parts: Vec<(DMatrix<f64>, DVector<f64>)> =
                blocks.iter().map(|(a, b)| normal(&even[*a..*b], &odd[*a..*b], e, p, &weights)).collect();
            let (matrix, right) =
                parts.iter().fold((DMatrix::zeros(p, p), DVector::zeros(p)), |(m, r), part| (m + &part.0, r + &part.1));
            found = solve_normal(&matrix, &right)?;
            if round == 2 {
                for (change, part) in changes.iter_mut().zip(&parts) {
                    let rest = solve_normal(&(&matrix - &part.0), &(&right - &part.1))?;
                    change.rows_mut(offset, p).copy_from(&(rest - &found));
                }
            } else {
                // Mean square residual at each frequency, over both halves.
                let mut sums = vec![(0.0, 0.0); windows.frequencies + 1];
                for w in even.iter().chain(&odd) {
                    for (r, row) in w.equations[e].chunks_exact(p + 1).enumerate() {
                        let predicted: f64 = row[..p].iter().zip(found.iter()).map(|(a, b)| a * b).sum();
                        let sum = &mut sums[frequency_of_row(r)];
                        *sum = (sum.0 + (row[p] - predicted).powi(2), sum.1 + 1.0);
                    }
                }
                weights = sums.iter().map(|(s, n)| n / s.max(f64::MIN_POSITIVE)).collect();
            }
        }
        for (j, term) in equation.terms.iter().enumerate() {
            let Some((_, order)) = model.attenuation.iter().find(|a| a.0 == term.name) else { continue };
            // The fit multiplies a column that noise has shrunk by κ: it finds λ/κ.
            let kappa = attenuation(*order, sigma);
            found[j] *= kappa;
            changes.iter_mut().for_each(|c| c[offset + j] *= kappa);
            slopes[offset + j] = 0.5 * order * order * found[j];
        }
        coefficients.push(found);
        offset += p;
    }
    let g = blocks.len() as f64;
    let stretch = StudentsT::new(0.0, 1.0, g - 1.0).map_or(1.0, |t| t.inverse_cdf(0.975) / 1.959_964);
    let spread = changes.iter().fold(DMatrix::zeros(total, total), |s, d| s + d * d.transpose());
    // σ² from the top third of the spectrum: a relative error of √(2/(N/3)).
    let samples: usize = segments.iter().map(AngleSegment::len).sum();
    let variance = 6.0 / samples.max(1) as f64 * sigma.powi(4);
    let covariance = spread * ((g - 1.0) / g * stretch * stretch) + &slopes * slopes.transpose() * variance;
    let done = Instruments { noise_rad: sigma, attenuation: attenuation(1.0, sigma), windows: n };
    Some(Solution { coefficients, covariance, done })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::single_pendulum::weak_model;

    #[test]
    fn heavy_noise_calls_for_instruments_and_counts_do_not() {
        let single = weak_model(1.0, true, &["c_r"], 1);
        assert!(wanted(&single, 0.18) && !wanted(&single, core::f64::consts::TAU / 1024.0 / 12f64.sqrt()));
        assert!(!wanted(&WeakModel::default(), 0.18));
        // A uniform noise of ± 0.314 rad: sin(x)/x.
        let uniform = 0.1 * core::f64::consts::PI;
        assert!((attenuation(1.0, uniform / 3f64.sqrt()) - uniform.sin() / uniform).abs() < 6e-5);
    }

    #[test]
    fn halves_hold_every_sample_once_at_its_time() {
        let s = AngleSegment {
            start_s: 1.0,
            step_s: 0.1,
            phi: [(0..7).map(f64::from).collect(), vec![0.0; 7]],
            phase: Phase::Device((0..7).collect()),
            relative: false,
            count_rad: [None; 2],
        };
        let (even, odd) = (half(&s, 0), half(&s, 1));
        assert_eq!((even.phi[0].as_slice(), odd.phi[0].as_slice()), (&[0.0, 2.0, 4.0, 6.0][..], &[1.0, 3.0, 5.0][..]));
        assert!((odd.time(1) - s.time(3)).abs() < 1e-12 && (odd.tau(1) - s.tau(3)).abs() < 1e-12);
    }
}
