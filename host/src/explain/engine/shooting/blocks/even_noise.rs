//! What a fit is worth where what is left is noise alike everywhere, beside its scatter from window
//! to window.

use nalgebra::{DMatrix, DVector};

use super::{Blocks, Fit, solve_signed, to_unit_diagonal};
use crate::explain::ranking::{self, squares};
use crate::identify::jackknife::widening;

impl Blocks {
    /// Covariance of the columns behind the own ones where what is left is noise alike everywhere:
    /// s² m (N₂₂ − N₂₁ N₁₁⁻¹ N₁₂)⁻¹, N the normal matrix, s² what is left by its degrees of
    /// freedom. The horizons t of a window are of the same samples: by Cauchy and Schwarz's
    /// inequality they tell at least m = (Σ √N_t)²/Σ N_t times less than independent ones would.
    pub(super) fn even_covariance(
        &self,
        columns: &[usize],
        own: usize,
        total: &DMatrix<f64>,
        x: &DVector<f64>,
    ) -> Option<DMatrix<f64>> {
        let p = columns.len();
        let freedom = self.noise() - p as f64;
        if freedom < 1.0 || own >= p {
            return None;
        }
        let (scale, unit) = to_unit_diagonal(total);
        // The last rows of Cholesky's factor are that of what the own columns leave.
        let factor = unit.cholesky()?.l().view((own, own), (p - own, p - own)).into_owned();
        let square = &factor * factor.transpose();
        let inverse = square.cholesky()?.inverse();
        let shared = squares(total, x) / freedom * self.overlap(&columns[own..]);
        Some(DMatrix::from_fn(p - own, p - own, |i, j| shared * inverse[(i, j)] * scale[own + i] * scale[own + j]))
    }

    /// Variances of coefficients `x` of some columns where what is left is noise alike everywhere;
    /// see [`Self::even_covariance`]. None where columns are singular.
    fn even_variances(&self, columns: &[usize], x: &DVector<f64>) -> Option<Vec<f64>> {
        let p = columns.len();
        let total = self.grams(columns).into_iter().fold(DMatrix::zeros(p + 1, p + 1), |s, g| s + g);
        let freedom = self.noise() - p as f64;
        let x = x - DVector::from_vec(self.origin_of(columns));
        let (scale, unit) = to_unit_diagonal(&total);
        let inverse = unit.cholesky()?.inverse();
        let shared = squares(&total, &x) / freedom;
        let variance = |i: usize| shared * self.overlap(&columns[i..=i]) * inverse[(i, i)] * scale[i] * scale[i];
        (freedom >= 1.0).then(|| (0..p).map(variance).collect())
    }

    /// The covariance of a fit of some columns that is told: that of the scatter between windows, as
    /// wide as their number makes it, at least that of even noise. Where a few windows decide, their
    /// scatter comes out too small.
    pub fn covariance(&self, columns: &[usize], fit: &Fit) -> DMatrix<f64> {
        let mut out = &fit.covariance * widening(fit.blocks).powi(2);
        let Some(even) = self.even_variances(columns, &fit.all) else { return out };
        let factor = |(i, even): (usize, &f64)| match (even / out[(i, i)]).max(1.0).sqrt() {
            f if f.is_finite() => f,
            _ => 1.0,
        };
        let wider: Vec<f64> = even.iter().enumerate().map(factor).collect();
        out.iter_mut().enumerate().for_each(|(k, c)| *c *= wider[k % wider.len()] * wider[k / wider.len()]);
        out
    }

    /// m of [`Self::even_covariance`], the largest of some columns.
    fn overlap(&self, columns: &[usize]) -> f64 {
        let of = |column: usize| {
            let mut by_horizon: Vec<f64> = Vec::new();
            for (window, weights) in self.windows.iter().zip(&self.weights) {
                by_horizon.resize(by_horizon.len().max(window.len()), 0.0);
                let parts = window.iter().zip(weights);
                by_horizon.iter_mut().zip(parts).for_each(|(sum, (p, w))| *sum += w * p.gram.square(column));
            }
            let roots: f64 = by_horizon.iter().map(|x| x.max(0.0).sqrt()).sum();
            let sum: f64 = by_horizon.iter().sum();
            if sum > 0.0 { roots * roots / sum } else { 1.0 }
        };
        columns.iter().map(|&c| of(c)).fold(1.0, f64::max)
    }

    /// Probability that strengths of zero of the last `d` of some columns give a Wald statistic as
    /// large where what is left is noise alike everywhere, one of two of which [`ranking::p_value`]
    /// is the larger; none where a fit has none. It needs no fit without each of the windows.
    pub fn p_of_even_noise(&self, columns: &[usize], d: usize) -> Option<f64> {
        let (own, parts) = (columns.iter().filter(|c| **c < self.still.len()).count(), self.grams(columns));
        let total = parts.iter().fold(DMatrix::zeros(columns.len() + 1, columns.len() + 1), |s, g| s + g);
        let origin = self.origin_of(columns);
        let all = solve_signed(&total, &self.signs_of(columns), &origin)?.0;
        let covariance = self.even_covariance(columns, own, &total, &all);
        covariance.map_or(Some(0.0), |even| ranking::p_of_even_noise(&(all + DVector::from_vec(origin)), &even, d))
    }
}
