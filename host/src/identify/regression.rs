//! Weighted least squares over the rows of many windows, with a covariance that holds for
//! correlated residuals.
//!
//! *Weights.* The sensors' noise enters a row through ∫ ẅ φ and grows with frequency. Each
//! frequency m is weighted by 1/s_m², s_m² the mean square residual of its rows over all windows
//! (two rounds, starting from equal weights).
//!
//! *Covariance.* Rows of one window share the same noise and neighbouring windows overlap, so
//! residuals are taken as independent only between blocks of consecutive windows. The covariance is
//! the delete-one-block jackknife C = (G−1)/G Σ_g (λ₍₋g₎ − λ)(λ₍₋g₎ − λ)ᵀ over all equations at
//! once (Efron and Stein 1981; for clustered regression it is the CR3 estimator of Bell and
//! McCaffrey 2002, valid with few clusters). Standard errors are stretched by t₀.₉₇₅(G−1)/1.96, so
//! that ± 1.96 of them is a 95 % interval.
//!
//! *Repeating records.* On a periodic orbit the quantisation error repeats from window to window
//! and does not average out. The greatest mean correlation ρ of weighted residuals between windows
//! that do not overlap measures it. Where ρ > 0.2, ρ times the covariance that a single window
//! would give is added (and what [`super::noise_bias`] finds), C₁ = (N/n)⁻¹ · 2.63, N the normal
//! matrix over n windows and 2.63 = Σ corr² of sin⁴ rows at neighbouring frequencies.

mod normal_equations;
mod residuals;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use self::normal_equations::Normal;
pub use self::residuals::{MOST_DOTS, frequency_dots, identification_error, residual_dots};
pub(crate) use self::residuals::{noise_alone, weighted_rms};
use self::residuals::{repetition, rms_by_frequency};
use super::jackknife::widening;
use super::windows::{WindowRows, row_count};

/// Σ corr² over the rows of one window: sin⁴ rows at neighbouring frequencies are not independent.
pub(super) const ROW_DEPENDENCE: f64 = 2.63;
/// Correlation of residuals between windows, or pieces, from which a record counts as repeating.
pub(super) const REPEATING: f64 = 0.2;
/// Fewest blocks for a jackknife.
pub(super) const FEWEST_BLOCKS: usize = 6;

/// Solution of all equations.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Coefficients, equation by equation.
    pub coefficients: Vec<DVector<f64>>,
    /// Joint covariance over the concatenated coefficients.
    pub covariance: DMatrix<f64>,
    /// Covariance that independent residuals with the weights' variances would give: less true than
    /// `covariance` but free of its scatter, so the better metric for combining coefficients.
    pub metric: DMatrix<f64>,
    /// Weighted, column-scaled condition number of each equation's normal matrix (square root of
    /// the ratio of eigenvalues).
    pub condition: Vec<f64>,
    /// ε = ‖e‖∞/‖q̂‖∞ of each equation.
    pub error: Vec<f64>,
    /// Rms residual at each frequency, equation by equation.
    pub residual_rms: Vec<Vec<f64>>,
    /// Greatest mean correlation of residuals between windows that do not overlap.
    pub repetition: f64,
    /// Whether that correlation marks the record as repeating.
    pub repeating: bool,
    /// Blocks of the jackknife (0: too few windows, rows taken as independent).
    pub blocks: usize,
    /// Weight of each frequency, equation by equation.
    pub weights: Vec<Vec<f64>>,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsolvable {
    /// A column (equation, column) vanishes or depends on the others.
    Dependent {
        /// Equation.
        equation: usize,
        /// Column with the largest share in the dependence.
        column: usize,
    },
    /// A row is not a finite number.
    NotFinite,
}

/// Solves all equations; `terms[e]` is the number of coefficients of equation e.
///
/// # Errors
/// Where a column vanishes or depends on others, or a row is not finite.
pub fn solve(windows: &[WindowRows], terms: &[usize], frequencies: usize) -> Result<Solution, Unsolvable> {
    solve_with(windows, terms, frequencies, &Options::default())
}

/// Departures from the defaults of [`solve`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Options<'a> {
    /// Weights of each equation and frequency, instead of those from the residuals; empty for an
    /// equation that has none.
    pub weights: Option<&'a [Vec<f64>]>,
    /// Windows that a block of the jackknife spans at least (a twelfth of all at most).
    pub block: usize,
}

/// As [`solve`], with weights given beforehand or longer blocks.
///
/// # Errors
/// As [`solve`].
pub fn solve_with(
    windows: &[WindowRows],
    terms: &[usize],
    frequencies: usize,
    options: &Options<'_>,
) -> Result<Solution, Unsolvable> {
    if windows.iter().any(|w| w.equations.iter().flatten().any(|x| !x.is_finite())) {
        return Err(Unsolvable::NotFinite);
    }
    let n = windows.len();
    let block_len = 2.max(n.div_ceil(200)).max(options.block.min(n / 12));
    let blocks: Vec<&[WindowRows]> = windows.chunks(block_len).collect();
    let total: usize = terms.iter().sum();
    let mut coefficients = Vec::new();
    let mut condition = Vec::new();
    let mut error = Vec::new();
    let mut residual_rms = Vec::new();
    let mut weights_of = Vec::new();
    let mut single = DMatrix::zeros(total, total);
    let mut left_out: Vec<DVector<f64>> = vec![DVector::zeros(total); blocks.len()];
    let mut offset = 0;
    for (e, &p) in terms.iter().enumerate() {
        let dependent = |column| Unsolvable::Dependent { equation: e, column };
        let given = options.weights.and_then(|w| w.get(e)).filter(|w| w.len() == frequencies + 1);
        let mut weights = given.cloned().unwrap_or_else(|| vec![1.0; frequencies + 1]);
        let mut rms = vec![0.0; frequencies + 1];
        for round in 0..3 {
            let parts: Vec<Normal> = blocks
                .par_iter()
                .map(|block| {
                    let mut part = Normal::zeros(p);
                    block.iter().for_each(|w| part.add(&w.equations[e], &weights));
                    part.complete()
                })
                .collect();
            let whole = Normal::sum(parts.iter(), p);
            let (solution, inverse, kappa) = whole.solve().map_err(dependent)?;
            if round == 2 {
                parts.par_iter().zip(&mut left_out).for_each(|(part, left_out)| {
                    let rest = Normal { matrix: &whole.matrix - &part.matrix, right: &whole.right - &part.right };
                    // A block without which nothing can be solved says nothing about the spread.
                    let without = if blocks.len() > 1 { rest.solution() } else { None };
                    let change = without.map_or_else(|| DVector::zeros(p), |x| x - &solution);
                    left_out.rows_mut(offset, p).copy_from(&change);
                });
                single.view_mut((offset, offset), (p, p)).copy_from(&(inverse * (n as f64 * ROW_DEPENDENCE)));
                error.push(identification_error(windows, e, &solution));
                coefficients.push(solution);
                condition.push(kappa);
            } else {
                rms = rms_by_frequency(windows, e, &solution, frequencies);
                let level = rms.iter().fold(0.0_f64, |m, x| m.max(*x));
                if given.is_none() {
                    weights = rms.iter().map(|s| 1.0 / s.max(1e-9 * level).max(f64::MIN_POSITIVE).powi(2)).collect();
                }
            }
        }
        residual_rms.push(rms);
        weights_of.push(weights);
        offset += p;
    }
    let repetition = repetition(windows, &coefficients, &weights_of, options.block.max(2));
    let repeating = repetition > REPEATING;
    let g = blocks.len();
    let mut covariance = if g >= FEWEST_BLOCKS {
        let freedom = (g - 1) as f64;
        let stretch = widening(g);
        let sum = left_out.iter().fold(DMatrix::zeros(total, total), |sum, d| sum + d * d.transpose());
        sum * (freedom / g as f64 * stretch * stretch)
    } else {
        &single / n as f64
    };
    if repeating {
        covariance += &single * repetition;
    }
    let blocks = if g >= FEWEST_BLOCKS { g } else { 0 };
    Ok(Solution {
        coefficients,
        covariance,
        metric: &single / n as f64,
        condition,
        error,
        residual_rms,
        repetition,
        repeating,
        blocks,
        weights: weights_of,
    })
}

/// Coefficients of all equations for given weights, without a covariance.
///
/// # Errors
/// As [`solve`].
pub fn solve_weighted<'a>(
    windows: impl Iterator<Item = &'a WindowRows> + Clone,
    terms: &[usize],
    weights: &[Vec<f64>],
) -> Result<Vec<DVector<f64>>, Unsolvable> {
    terms
        .iter()
        .enumerate()
        .map(|(e, &p)| {
            let mut normal = Normal::zeros(p);
            windows.clone().for_each(|w| normal.add(&w.equations[e], &weights[e]));
            normal.complete().solve().map(|s| s.0).map_err(|column| Unsolvable::Dependent { equation: e, column })
        })
        .collect()
}

/// Normal equations of windows that belong to runs, so that runs can be left out of a solution.
pub(crate) struct RunSums {
    /// Run by run, equation by equation.
    runs: Vec<Vec<Normal>>,
}

impl RunSums {
    /// Sums over each of `runs` runs (a window's `run` says which it is in) with given weights.
    pub(crate) fn new(windows: &[WindowRows], runs: usize, terms: &[usize], weights: &[Vec<f64>]) -> Self {
        let mut sums: Vec<Vec<Normal>> = (0..runs).map(|_| terms.iter().map(|p| Normal::zeros(*p)).collect()).collect();
        for window in windows {
            if let Some(sums) = sums.get_mut(window.run) {
                sums.iter_mut().enumerate().for_each(|(e, sum)| sum.add(&window.equations[e], &weights[e]));
            }
        }
        Self { runs: sums.into_iter().map(|run| run.into_iter().map(Normal::complete).collect()).collect() }
    }

    /// Coefficients of all equations, concatenated, from all runs but one (or from all). None where
    /// the rest does not determine them.
    pub(crate) fn solve(&self, without: Option<usize>) -> Option<DVector<f64>> {
        let equations = self.runs.first()?.len();
        let mut out = Vec::new();
        for e in 0..equations {
            let kept = self.runs.iter().enumerate().filter(|(g, _)| Some(*g) != without).map(|(_, run)| &run[e]);
            let p = self.runs[0][e].right.len();
            out.extend(Normal::sum(kept, p).solution()?.iter());
        }
        Some(DVector::from_vec(out))
    }
}

/// Rows that a solution used.
pub fn rows_used(windows: &[WindowRows], equations: usize, frequencies: usize) -> usize {
    windows.len() * equations * row_count(frequencies)
}

#[cfg(test)]
#[path = "regression_tests.rs"]
mod tests;
