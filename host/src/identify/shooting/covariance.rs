//! Standard errors of a shooting fit, and the bound that they are compared with.
//!
//! With H_s and g_s a piece's normal matrix and gradient after its state is eliminated, H = Σ H_s:
//! leaving block b out moves the parameters by d_b = (H − H_b)⁻¹ g_b, and the covariance is the
//! jackknife's, (G−1)/G Σ (d_b − d̄)(d_b − d̄)ᵀ, stretched by Student's t for G − 1 degrees of
//! freedom. It assumes nothing of the residuals inside a block. Where chance makes it smaller than
//! the bound below, the bound is taken. The bound of Cramér and Rao for these pieces is H⁻¹ times
//! the residuals' mean square: what white Gaussian noise of that size allows an unbiased estimate.
//!
//! On a motion that repeats, quantisation errors repeat too: then the correlation ρ of residuals
//! between pieces times the covariance that one piece alone would give is added.

use nalgebra::{DMatrix, DVector};

use super::problem::Share;
use super::solve::{reduce, solve_scaled};
use crate::identify::jackknife::widening;
use crate::identify::regression::FEWEST_BLOCKS;

/// Most blocks of the jackknife.
const MOST_BLOCKS: usize = 400;

/// Covariances of the parameters.
#[derive(Clone, Debug)]
pub struct Covariance {
    /// Of the estimate.
    pub estimate: DMatrix<f64>,
    /// Bound for white noise of the residuals' size.
    pub bound: DMatrix<f64>,
    /// Blocks of the jackknife; 0 where there are too few pieces and the bound was taken.
    pub blocks: usize,
    /// Mean square of the residuals, in units of the noise's variance.
    pub mean_square: f64,
    /// Condition number of the normal matrix scaled to unit diagonal (square root of the ratio of
    /// eigenvalues).
    pub condition: f64,
}

/// Inverse of a normal matrix with the held parameters' rows left zero; None where it is singular.
fn inverse(normal: &DMatrix<f64>, held: &[bool]) -> Option<DMatrix<f64>> {
    let n = normal.nrows();
    let mut out = DMatrix::zeros(n, n);
    for i in (0..n).filter(|i| !held[*i]) {
        let unit = DVector::from_fn(n, |k, _| f64::from(u8::from(k == i)));
        out.set_column(i, &solve_scaled(normal, &unit, 0.0, held)?);
    }
    Some(out)
}

/// What unit noise allows at best, H⁻¹, some parameters being held. `states`: unknowns of each
/// piece. None where it is singular.
pub fn least(shares: &[Share], states: usize, held: &[bool]) -> Option<DMatrix<f64>> {
    let p = held.len();
    let mut total = DMatrix::zeros(p, p);
    for share in shares {
        total += &reduce(share, states, 0.0)?.normal;
    }
    inverse(&total, held)
}

/// Covariances at a minimum. `states`: unknowns of each piece; `repetition`: correlation of
/// residuals between pieces, 0 where they do not repeat. None where a parameter is not determined.
pub fn covariance(shares: &[Share], states: usize, held: &[bool], repetition: f64) -> Option<Covariance> {
    let reduced: Vec<_> = shares.iter().map(|s| reduce(s, states, 0.0)).collect::<Option<_>>()?;
    let p = held.len();
    let size = reduced.len().div_ceil(MOST_BLOCKS).max(1);
    let blocks: Vec<(DMatrix<f64>, DVector<f64>)> = reduced
        .chunks(size)
        .map(|block| {
            block.iter().fold((DMatrix::zeros(p, p), DVector::zeros(p)), |(h, g), r| (h + &r.normal, g + &r.gradient))
        })
        .collect();
    let total = blocks.iter().fold(DMatrix::zeros(p, p), |sum, b| sum + &b.0);
    let freedom: f64 = shares.iter().map(|s| (s.samples * s.squares.len()) as f64 - states as f64).sum::<f64>()
        - held.iter().filter(|h| !**h).count() as f64;
    let mean_square = shares.iter().map(Share::cost).sum::<f64>() / freedom.max(1.0);
    let bound = inverse(&total, held)? * mean_square;
    let g = blocks.len();
    let mut estimate = if g >= FEWEST_BLOCKS {
        let changes: Vec<DVector<f64>> =
            blocks.iter().filter_map(|(h, gradient)| solve_scaled(&(&total - h), gradient, 0.0, held)).collect();
        let mean = changes.iter().fold(DVector::zeros(p), |s, d| s + d) / changes.len().max(1) as f64;
        let freedom = (g - 1) as f64;
        let stretch = widening(g);
        let sum = changes.iter().fold(DMatrix::zeros(p, p), |sum, d| {
            let d = d - &mean;
            sum + &d * d.transpose()
        });
        sum * (freedom / g as f64 * stretch * stretch)
    } else {
        bound.clone()
    };
    // The scatter of few influential pieces may come out below the bound by chance; no estimate is
    // better than that.
    let widen = DVector::from_fn(p, |i, _| {
        let (found, least) = (estimate[(i, i)], bound[(i, i)]);
        if found > 0.0 && least > found { (least / found).sqrt() } else { 1.0 }
    });
    estimate = DMatrix::from_fn(p, p, |i, j| estimate[(i, j)] * widen[i] * widen[j]);
    estimate += &bound * (repetition.max(0.0) * shares.len() as f64);
    let scaled = DMatrix::from_fn(p, p, |i, j| {
        let d = (total[(i, i)] * total[(j, j)]).sqrt();
        if d > 0.0 { total[(i, j)] / d } else { f64::from(u8::from(i == j)) }
    });
    let eigen = scaled.symmetric_eigenvalues();
    let condition = (eigen.max() / eigen.min().max(f64::MIN_POSITIVE)).sqrt();
    let blocks = if g >= FEWEST_BLOCKS { g } else { 0 };
    Some(Covariance { estimate, bound, blocks, mean_square, condition })
}
