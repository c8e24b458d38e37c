//! What decisions rest on: fits of some columns, their held-out scores, and what counts as a gain;
//! here from the rows of the weak form.

use rayon::prelude::*;

use crate::explain::engine::design::Design;
use crate::explain::ranking::{self, Fit, Weights};

/// What candidates are judged by: rows whose columns are the model's own and every candidate's.
pub(in crate::explain) trait Evidence: Sync {
    /// The fit of some columns; none where they are singular.
    fn fit(&self, columns: &[usize]) -> Option<Fit>;

    /// The same with the last `d` of either sign, where a fit holds those of a law at nothing that
    /// come out with the sign of none.
    fn fit_of_either_sign(&self, columns: &[usize], d: usize) -> Option<Fit>;

    /// A lower bound, quickly found, of [`ranking::p_value`] of the last `d` of some columns; none
    /// where there is no fit.
    fn least_p(&self, columns: &[usize], d: usize) -> Option<f64>;

    /// Held-out scores of the strongest candidates by weights from their own fits, infinite for the
    /// others, where weights rest on the fit. `scores`: each one's gain, first column and number of
    /// columns.
    fn rescored(&self, own: &[usize], most: usize, scores: &[(f64, (usize, usize))]) -> Option<Vec<f64>>;

    /// Least gain that is not as good as nothing, for a held-out sum of squares without it.
    fn least_gain(&self, total: f64) -> f64;

    /// Least gain in standard errors between blocks: where a model misses more than noise, a
    /// strength may be significant that predicts nothing better.
    fn least_deviations(&self) -> f64;

    /// Whether a gain is clear of what noise makes of it, where a held-out sum of squares without it
    /// is noise: what one part of a motion shows scatters from block to block however clear it is.
    fn is_above_noise(&self, gain: f64, total: f64) -> bool;

    /// Difference between what two candidates leave where they were not fitted, below which they are
    /// not told apart, however little it scatters.
    fn least_apart(&self) -> f64;
}

/// Rows of the weak form, weighted by equation and frequency.
pub(in crate::explain) struct Rows<'a> {
    pub(in crate::explain) design: &'a Design,
    pub(in crate::explain) weights: &'a Weights,
}

impl Evidence for Rows<'_> {
    fn fit(&self, columns: &[usize]) -> Option<Fit> {
        ranking::fit(self.design, columns, self.weights)
    }

    fn fit_of_either_sign(&self, columns: &[usize], _d: usize) -> Option<Fit> {
        self.fit(columns)
    }

    fn least_p(&self, _columns: &[usize], _d: usize) -> Option<f64> {
        Some(0.0)
    }

    fn rescored(&self, own: &[usize], most: usize, scores: &[(f64, (usize, usize))]) -> Option<Vec<f64>> {
        Some(reranked(self.design, own, self.weights, most, scores))
    }

    fn least_gain(&self, _total: f64) -> f64 {
        0.0
    }

    fn least_deviations(&self) -> f64 {
        0.0
    }

    fn is_above_noise(&self, _gain: f64, _total: f64) -> bool {
        false
    }

    fn least_apart(&self) -> f64 {
        0.0
    }
}

/// Held-out score of the strongest candidates with weights from their own fits, infinite for the
/// others: Σ n ln s² over equations and frequencies, the concentrated likelihood when the variance
/// of each frequency is unknown. Smaller is better.
fn reranked(
    design: &Design,
    own: &[usize],
    weights: &Weights,
    most: usize,
    scores: &[(f64, (usize, usize))],
) -> Vec<f64> {
    let mut gains: Vec<f64> = scores.iter().map(|s| s.0).collect();
    gains.sort_by(|a, b| b.total_cmp(a));
    let least = gains.get(most - 1).or(gains.last()).copied().unwrap_or(f64::INFINITY);
    scores
        .par_iter()
        .map(|&(gain, (from, d))| {
            if gain < least {
                return f64::INFINITY;
            }
            let columns: Vec<usize> = own.iter().copied().chain(from..from + d).collect();
            let mut w = weights.clone();
            for _ in 0..3 {
                let Some(fit) = ranking::fit_some(design, &columns, &w, |_| true) else { return f64::INFINITY };
                w = ranking::weights(design, &columns, &fit);
            }
            ranking::held_out_likelihood(design, &columns, &w).unwrap_or(f64::INFINITY)
        })
        .collect()
}
