//! How much a candidate explains: least squares on two thirds of the record, judged on the last,
//! three times over.
//!
//! *Held-out gain*: the weighted sum of squared residuals, on blocks of one window's length that
//! were not fitted, without the candidate minus with it, the nominal coefficients refitted both
//! times so that they cannot hide it. *Significance*: Wald's statistic kᵀ C⁻¹ k of its strengths
//! with the jackknife's covariance over blocks of consecutive windows, against Student's t or
//! Fisher's F with the number of blocks that the strengths effectively rest on, since those are
//! few.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};

use super::engine::design::{Design, Window};

/// Folds of the cross-validation.
pub const FOLDS: usize = 3;

/// Fewest blocks that a coefficient counts as resting on: the jackknife's variance is itself too
/// large where leverage is uneven, so that fewer would punish twice.
const LEAST_EFFECTIVE: f64 = 8.0;

/// Share of the mean below which what is left of a block is nothing.
const RELATIVE_FLOOR: f64 = 1e-6;

/// Weights of rows, by equation and frequency.
pub type Weights = Vec<Vec<f64>>;

/// Normal matrix of some columns and the target over a window: (p + 1) × (p + 1).
fn gram(design: &Design, window: &Window, columns: &[usize], weights: &Weights) -> DMatrix<f64> {
    let width = design.columns + 1;
    let p = columns.len();
    let mut out = DMatrix::zeros(p + 1, p + 1);
    let mut row = vec![0.0; p + 1];
    for r in 0..design.rows {
        let (e, m) = design.place_of_row(r);
        let w = weights[e][m].sqrt();
        let values = &window.values[r * width..(r + 1) * width];
        row.iter_mut().zip(columns).for_each(|(x, &c)| *x = w * values[c]);
        row[p] = w * values[design.columns];
        for i in 0..=p {
            if row[i] != 0.0 {
                for j in 0..=i {
                    out[(i, j)] += row[i] * row[j];
                }
            }
        }
    }
    out.fill_upper_triangle_with_lower_triangle();
    out
}

/// Solves the normal equations held in a Gram matrix; none where they are singular.
pub(super) fn solve(gram: &DMatrix<f64>) -> Option<DVector<f64>> {
    let p = gram.nrows() - 1;
    let scale: Vec<f64> = (0..p).map(|i| gram[(i, i)]).map(|d| if d > 0.0 { d.sqrt().recip() } else { 0.0 }).collect();
    if scale.contains(&0.0) {
        return None;
    }
    let a = DMatrix::from_fn(p, p, |i, j| gram[(i, j)] * scale[i] * scale[j]);
    let b = DVector::from_fn(p, |i, _| gram[(i, p)] * scale[i]);
    let factor = a.cholesky()?;
    // A pivot this small: the column is a combination of the others.
    if factor.l_dirty().diagonal().iter().any(|d| *d < 1e-6) {
        return None;
    }
    Some(factor.solve(&b).component_mul(&DVector::from_vec(scale)))
}

/// Sum of squares of a solution over the rows behind a Gram matrix.
pub(super) fn squares(gram: &DMatrix<f64>, x: &DVector<f64>) -> f64 {
    let p = x.len();
    let a = gram.view((0, 0), (p, p));
    let b = gram.view((0, p), (p, 1));
    gram[(p, p)] - 2.0 * x.dot(&b.column(0)) + (a * x).dot(x)
}

/// A fit of chosen columns.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Coefficients from all windows.
    pub all: DVector<f64>,
    /// Coefficients from the windows that do not touch fold 0.
    pub train: DVector<f64>,
    /// Jackknife covariance.
    pub covariance: DMatrix<f64>,
    /// Blocks of the jackknife.
    pub blocks: usize,
    /// Blocks that each coefficient effectively rests on (Bell and McCaffrey 2002).
    pub effective: Vec<f64>,
    /// Held-out sum of squares of each block, in order of time.
    pub held_out: Vec<f64>,
    /// Covariance of the last coefficients, those that the model does not have yet, if what is left
    /// is noise alike everywhere. The jackknife's comes out too small where a few blocks decide.
    pub even: Option<DMatrix<f64>>,
}

/// Fits columns and judges them on held-out blocks; none where they are singular or the windows too
/// few.
pub fn fit(design: &Design, columns: &[usize], weights: &Weights) -> Option<Fit> {
    fit_ridge(design, columns, weights, &[])
}

/// The same with a ridge: each column's mean square over the fitted windows times its entry in
/// `ridge` is added to the normal matrix.
pub fn fit_ridge(design: &Design, columns: &[usize], weights: &Weights, ridge: &[f64]) -> Option<Fit> {
    let solve = |gram: &DMatrix<f64>| {
        if ridge.is_empty() {
            return solve(gram);
        }
        let mut stiff = gram.clone();
        let (sum, count) = ridge
            .iter()
            .enumerate()
            .filter(|(_, r)| **r > 0.0)
            .fold((0.0, 0.0), |t, (i, _)| (t.0 + gram[(i, i)], t.1 + 1.0));
        let mean = sum / f64::max(count, 1.0);
        ridge.iter().enumerate().for_each(|(i, r)| stiff[(i, i)] += r * mean);
        solve(&stiff)
    };
    let grams: Vec<DMatrix<f64>> = design.windows.iter().map(|w| gram(design, w, columns, weights)).collect();
    let p = columns.len();
    let zero = || DMatrix::<f64>::zeros(p + 1, p + 1);
    let total = grams.iter().fold(zero(), |s, g| s + g);
    let all = solve(&total)?;
    let mut held_out = vec![0.0; design.windows.len()];
    let mut train = None;
    for fold in 0..FOLDS {
        let touches = |w: &Window| {
            let (a, b) = w.blocks();
            a % FOLDS == fold || b % FOLDS == fold
        };
        let kept = design.windows.iter().zip(&grams).filter(|(w, _)| !touches(w)).fold(zero(), |s, (_, g)| s + g);
        let x = solve(&kept)?;
        for (k, (w, g)) in design.windows.iter().zip(&grams).enumerate() {
            // Even windows are whole blocks.
            if w.index % 2 == 0 && w.blocks().0 % FOLDS == fold {
                held_out[k] = squares(g, &x);
            }
        }
        if fold == 0 {
            train = Some(x);
        }
    }
    let held_out = design.windows.iter().zip(held_out).filter(|(w, _)| w.index % 2 == 0).map(|(_, h)| h).collect();
    let size = 2.max(design.windows.len().div_ceil(120));
    let blocks: Vec<&[DMatrix<f64>]> = grams.chunks(size).collect();
    let n = blocks.len();
    let mut covariance = DMatrix::zeros(p, p);
    for block in &blocks {
        let rest = block.iter().fold(total.clone(), |s, g| s - g);
        let change = solve(&rest)? - &all;
        covariance += &change * change.transpose() * ((n - 1) as f64 / n as f64);
    }
    let effective = effective_blocks(&total, &blocks);
    Some(Fit { all, train: train?, covariance, blocks: n, effective, held_out, even: None })
}

/// Blocks that each coefficient rests on: (Σ h_b)²/Σ h_b², h_b = vᵀ G_b v the share of block b's
/// rows in the coefficient's variance, v the coefficient's row of the inverse normal matrix. A
/// force that shows in a few events only (friction at reversals) rests on the few blocks that hold
/// them, and its jackknife variance is known no better than that (Bell and McCaffrey 2002; Imbens
/// and Kolesár 2016).
fn effective_blocks(total: &DMatrix<f64>, blocks: &[&[DMatrix<f64>]]) -> Vec<f64> {
    let p = total.nrows() - 1;
    (0..p)
        .map(|j| {
            let mut unit = total.clone();
            for i in 0..p {
                unit[(i, p)] = f64::from(u8::from(i == j));
            }
            let Some(v) = solve(&unit) else { return 1.0 };
            let (sum, squares) = blocks.iter().fold((0.0, 0.0), |(sum, squares), block| {
                let h: f64 = block.iter().map(|g| (g.view((0, 0), (p, p)) * &v).dot(&v)).sum();
                (sum + h, squares + h * h)
            });
            if squares > 0.0 { sum * sum / squares } else { 1.0 }
        })
        .collect()
}

/// Coefficients from the windows that `keep` picks by their number; none where they are singular.
pub fn fit_some(
    design: &Design,
    columns: &[usize],
    weights: &Weights,
    keep: impl Fn(usize) -> bool,
) -> Option<DVector<f64>> {
    let p = columns.len();
    let total = design
        .windows
        .iter()
        .enumerate()
        .filter(|(k, _)| keep(*k))
        .fold(DMatrix::zeros(p + 1, p + 1), |s, (_, w)| s + gram(design, w, columns, weights));
    solve(&total)
}

/// Σ n ln s² over equations and frequencies, s² the mean square residual on held-out blocks; none
/// where a fit is singular.
pub fn held_out_likelihood(design: &Design, columns: &[usize], weights: &Weights) -> Option<f64> {
    let mut sums = vec![vec![0.0; design.frequencies + 1]; design.equations()];
    let mut counts = sums.clone();
    let width = design.columns + 1;
    for fold in 0..FOLDS {
        let x = fit_some(design, columns, weights, |k| {
            let (a, b) = design.windows[k].blocks();
            a % FOLDS != fold && b % FOLDS != fold
        })?;
        for w in design.windows.iter().filter(|w| w.index % 2 == 0 && w.blocks().0 % FOLDS == fold) {
            for r in 0..design.rows {
                let (e, m) = design.place_of_row(r);
                let row = &w.values[r * width..(r + 1) * width];
                let residual =
                    row[design.columns] - columns.iter().zip(x.iter()).map(|(&c, k)| k * row[c]).sum::<f64>();
                sums[e][m] += residual * residual;
                counts[e][m] += 1.0;
            }
        }
    }
    let both = sums.iter().flatten().zip(counts.iter().flatten());
    Some(both.filter(|(s, n)| **s > 0.0 && **n > 0.0).map(|(s, n)| n * (s / n).ln()).sum())
}

/// Probability that strengths of zero give a Wald statistic as large, for the last `d` coefficients
/// of a fit: the larger of that by the jackknife's covariance and that by the one of even noise.
pub fn p_value(fit: &Fit, d: usize) -> f64 {
    let even = fit.even.as_ref().map_or(Some(0.0), |covariance| p_of_even_noise(&fit.all, covariance, d));
    p_of_blocks(fit, d).max(even.unwrap_or(1.0))
}

/// The same of coefficients `all` by the covariance of even noise, whose freedom is that of all
/// samples; none where it is singular.
pub fn p_of_even_noise(all: &DVector<f64>, covariance: &DMatrix<f64>, d: usize) -> Option<f64> {
    let from = covariance.nrows().checked_sub(d)?;
    let strengths = all.rows(all.len() - d, d).into_owned();
    let factor = covariance.view((from, from), (d, d)).into_owned().cholesky()?;
    let wald = strengths.dot(&factor.solve(&strengths));
    ChiSquared::new(d as f64).ok().filter(|_| wald.is_finite()).map(|of| of.sf(wald))
}

/// Blocks that the last `d` coefficients of a fit effectively rest on, and the degrees of freedom
/// of their variance.
pub(super) fn freedom(fit: &Fit, d: usize) -> (f64, f64) {
    let last = &fit.effective[fit.all.len() - d..];
    let blocks = last.iter().fold(fit.blocks as f64, |least, e| least.min(e.max(LEAST_EFFECTIVE)));
    (blocks, blocks - d as f64)
}

/// The same by the jackknife's covariance.
fn p_of_blocks(fit: &Fit, d: usize) -> f64 {
    let p = fit.all.len();
    let k = fit.all.rows(p - d, d).into_owned();
    let covariance = fit.covariance.view((p - d, p - d), (d, d)).into_owned();
    let Some(factor) = covariance.cholesky() else { return 1.0 };
    let wald = k.dot(&factor.solve(&k));
    let (blocks, freedom) = freedom(fit, d);
    if freedom < 1.0 || !wald.is_finite() {
        return 1.0;
    }
    // Hotelling: W (n − d)/(d (n − 1)) follows F(d, n − d).
    let f = wald * freedom / (d as f64 * (blocks - 1.0));
    FisherSnedecor::new(d as f64, freedom).map_or(1.0, |dist| dist.sf(f))
}

/// Mean gain over blocks and its standard error.
pub fn gain(without: &[f64], with: &[f64]) -> (f64, f64) {
    let d: Vec<f64> = without.iter().zip(with).map(|(a, b)| a - b).collect();
    let n = d.len() as f64;
    let mean = d.iter().sum::<f64>() / n;
    let variance = d.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n * (n - 1.0)).max(1.0);
    (mean, variance.sqrt())
}

/// The gain in standard errors between blocks: that of the sums of squares, or that of their
/// logarithms where it is more, to which a block that one model misses by far counts no more than
/// any other.
pub fn deviations(without: &[f64], with: &[f64]) -> f64 {
    let of = |(mean, error): (f64, f64)| mean / error.max(f64::MIN_POSITIVE);
    let least = RELATIVE_FLOOR * without.iter().sum::<f64>() / without.len().max(1) as f64;
    let logarithms = |x: &[f64]| x.iter().map(|x| x.max(least).max(f64::MIN_POSITIVE).ln()).collect::<Vec<f64>>();
    of(gain(without, with)).max(of(gain(&logarithms(without), &logarithms(with))))
}

/// Equal weights.
pub fn equal_weights(design: &Design) -> Weights {
    vec![vec![1.0; design.frequencies + 1]; design.equations()]
}

/// Weights 1/s² by equation and frequency from the residuals of some columns' coefficients.
pub fn weights(design: &Design, columns: &[usize], x: &DVector<f64>) -> Weights {
    let smoothed = |s: &Vec<f64>| {
        let top = s.iter().fold(0.0_f64, |m, v| m.max(*v));
        (0..s.len())
            .map(|m| {
                let near = &s[m.saturating_sub(2)..=(m + 2).min(s.len() - 1)];
                let mean = near.iter().sum::<f64>() / near.len() as f64;
                1.0 / mean.max(1e-18 * top).max(f64::MIN_POSITIVE)
            })
            .collect()
    };
    mean_squares(design, columns, x).iter().map(smoothed).collect()
}

/// Mean square residual by equation and frequency.
pub fn mean_squares(design: &Design, columns: &[usize], x: &DVector<f64>) -> Vec<Vec<f64>> {
    let width = design.columns + 1;
    let mut out = vec![vec![0.0; design.frequencies + 1]; design.equations()];
    let mut count = out.clone();
    for window in &design.windows {
        for r in 0..design.rows {
            let (e, m) = design.place_of_row(r);
            let row = &window.values[r * width..(r + 1) * width];
            let residual = row[design.columns] - columns.iter().zip(x.iter()).map(|(&c, k)| k * row[c]).sum::<f64>();
            out[e][m] += residual * residual;
            count[e][m] += 1.0;
        }
    }
    for (s, n) in out.iter_mut().zip(&count) {
        s.iter_mut().zip(n).for_each(|(s, n)| *s /= f64::max(*n, 1.0));
    }
    out
}
