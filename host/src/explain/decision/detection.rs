//! How large an effect would have been named: its detection limit in a record that does not show
//! it.
//!
//! An effect of strength k, of which the record gives the standard error s, is named where k̂/s is
//! above the quantile t of what chance gives over all that were tried, and where its gain in blocks
//! that were not fitted, (k/s)² with the standard error 2 k/s, is clear of nothing by so many of
//! these. Each of both is met in 95 of 100 records from k = max(t + 1.645, 2 (least + 1.645)) s on,
//! a detection limit as Currie's (1968, Analytical Chemistry 40, 586) with these two tests. Of an
//! effect with several strengths s is that of their direction that is known worst. Limits: near it
//! another effect may have the name (of 48 records at four limits 47 had one, 41 the right one).

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};

use super::{Field, OF_A_FAMILY, Score};
use crate::explain::ranking;

/// Quantile of the normal distribution below which 95 of 100 are.
const MOST: f64 = 1.645;

impl Field<'_> {
    /// Strengths of each candidate without a shape from which on it would have been named, by their
    /// numbers.
    pub(super) fn detection_limits(&self) -> Vec<(usize, DVector<f64>)> {
        let plain = self.scores.iter().filter(|s| self.offers[s.index].shapes == 0);
        plain.filter_map(|s| Some((s.index, self.detection_limit(s)?))).collect()
    }

    fn detection_limit(&self, s: &Score) -> Option<DVector<f64>> {
        let d = self.places[s.index].1;
        let from = s.fit.all.len() - d;
        let by_blocks = s.fit.covariance.view((from, from), (d, d)).into_owned();
        let chance = OF_A_FAMILY / self.tests();
        let (blocks, freedom) = ranking::freedom(&s.fit, d);
        let f = FisherSnedecor::new(d as f64, freedom).ok().filter(|_| freedom >= 1.0)?.inverse_cdf(1.0 - chance);
        let blocks = self.least(&by_blocks, (f * d as f64 * (blocks - 1.0) / freedom).sqrt())?;
        let Some(even) = &s.fit.even else { return Some(blocks) };
        let from = even.nrows().checked_sub(d)?;
        let quantile = ChiSquared::new(d as f64).ok()?.inverse_cdf(1.0 - chance).sqrt();
        let even = self.least(&even.view((from, from), (d, d)).into_owned(), quantile)?;
        // Both tests have to find it.
        Some(if even.norm_squared() > blocks.norm_squared() { even } else { blocks })
    }

    /// The limit for strengths with a covariance, of which chance gives up to `quantile` standard
    /// errors.
    fn least(&self, covariance: &DMatrix<f64>, quantile: f64) -> Option<DVector<f64>> {
        let errors = covariance.clone().symmetric_eigen();
        let worst = errors.eigenvalues.imax();
        let error = errors.eigenvalues[worst].sqrt();
        let gains = 2.0 * (self.evidence.least_deviations() + MOST);
        let limit = f64::max(quantile + MOST, gains) * error;
        (limit.is_finite() && limit > 0.0).then(|| errors.eigenvectors.column(worst) * limit)
    }
}
