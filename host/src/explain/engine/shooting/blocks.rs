//! Least squares over windows whose Gram matrices are known: coefficients, jackknife covariance,
//! and the residual of each window when it is not fitted.
//!
//! Gram matrices are of increments from the coefficients that the columns were taken at: where
//! motion is chaotic columns grow so large that what is left would be the small difference of large
//! numbers otherwise.
//!
//! A window, or a part of one ([`super::cut`]), is a block; every third is one fold, as in
//! [`crate::explain::ranking`]. Each has a Gram matrix for every horizon that it is predicted over,
//! with a weight of its own. Coefficients of laws that take energy away may not come out with the
//! sign of laws that give it: one that would is held at zero and the others are fitted again.

mod apart;
mod even_noise;

use nalgebra::{DMatrix, DVector};

use super::gram::Gram;
use crate::explain::engine::prediction::Range;
use crate::explain::ranking::{FOLDS, Fit, solve, squares};

/// Least share of the square of a candidate's column that the model's own columns leave over (by
/// hand). Where a coordinate does not move about its zero, powers of it are nearly alike: of a
/// pendulum on a spring, about where its bob hangs, a cubic stiffness leaves 3·10⁻⁴ beside what the
/// model has, a quadratic one 3·10⁻⁵.
const SEPARABLE: f64 = 1e-6;

/// A window over one horizon.
#[derive(Clone, Debug)]
pub struct Part {
    /// Gram matrix of the columns and the target, in units of the noise.
    pub gram: Gram,
    /// Degrees of freedom: rows less the states that were eliminated.
    pub freedom: f64,
}

/// Windows, each over every horizon, the longest first.
#[derive(Clone, Debug)]
pub struct Blocks {
    windows: Vec<Vec<Part>>,
    /// Weight of each part.
    weights: Vec<Vec<f64>>,
    /// Sign that each column's coefficient keeps; 0 for either.
    signs: Vec<f64>,
    /// Coefficients that the first columns were taken at; zero for the others.
    origin: Vec<f64>,
    /// Columns of increments, which have settled: a fit to two thirds of the blocks, whose
    /// predictions are not made with them, leaves them at nothing.
    pub still: Vec<bool>,
    /// Where each lies.
    pub places: Vec<Range>,
    /// Whether each is a part of a window.
    pub are_parts: bool,
}

/// The least-squares increments with the signs of coefficients kept (0: any), which are those of
/// `origin` before, and what is held at zero.
fn solve_signed(total: &DMatrix<f64>, signs: &[f64], origin: &[f64]) -> Option<(DVector<f64>, Vec<bool>)> {
    let p = signs.len();
    let mut held = vec![false; p];
    loop {
        let x = solve_free(total, &held, origin)?;
        // The one that is furthest on the wrong side, in units of what it adds.
        let wrong = |i: usize| -signs[i] * (origin[i] + x[i]) * total[(i, i)].max(0.0).sqrt();
        match (0..p).filter(|&i| !held[i] && wrong(i) > 0.0).max_by(|&a, &b| wrong(a).total_cmp(&wrong(b))) {
            Some(i) => held[i] = true,
            None => return Some((x, held)),
        }
    }
}

/// The solution of a Gram matrix, some coefficients held at zero.
fn solve_free(total: &DMatrix<f64>, held: &[bool], origin: &[f64]) -> Option<DVector<f64>> {
    let p = held.len();
    let free: Vec<usize> = (0..p).filter(|i| !held[*i]).chain([p]).collect();
    let mut part = DMatrix::from_fn(free.len(), free.len(), |i, j| total[(free[i], free[j])]);
    let last = free.len() - 1;
    for k in (0..p).filter(|k| held[*k]) {
        (0..last).for_each(|i| part[(i, last)] += total[(free[i], k)] * origin[k]);
    }
    let found = solve(&part)?;
    let mut x = DVector::from_fn(p, |i, _| if held[i] { -origin[i] } else { 0.0 });
    free.iter().zip(found.iter()).for_each(|(&i, v)| x[i] = *v);
    Some(x)
}

/// What brings the columns of a Gram matrix, whose last is the target, to a diagonal of ones, and
/// the matrix of these.
fn to_unit_diagonal(gram: &DMatrix<f64>) -> (DVector<f64>, DMatrix<f64>) {
    let p = gram.nrows() - 1;
    let scale = DVector::from_fn(p, |i, _| gram[(i, i)].max(f64::MIN_POSITIVE).sqrt().recip());
    let unit = DMatrix::from_fn(p, p, |i, j| gram[(i, j)] * scale[i] * scale[j]);
    (scale, unit)
}

impl Blocks {
    /// Blocks of equal weight.
    pub fn new(windows: Vec<Vec<Part>>, signs: Vec<f64>, origin: Vec<f64>) -> Self {
        let weights = windows.iter().map(|w| vec![1.0; w.len()]).collect();
        Self { windows, weights, signs, origin, still: Vec::new(), places: Vec::new(), are_parts: false }
    }

    /// Adds the candidates' columns of others about the same windows; whether these are the same.
    pub fn join(&mut self, others: &Self) -> bool {
        let first = |b: &Self| b.windows.first().and_then(|w| w.first()).map(|p| p.gram.layout().clone());
        let (Some(own), Some(more), true) = (first(self), first(others), self.places == others.places) else {
            return false;
        };
        let layout = own.joined(&more);
        for (parts, others) in self.windows.iter_mut().zip(&others.windows) {
            parts.iter_mut().zip(others).for_each(|(p, o)| p.gram = p.gram.joined(&o.gram, &layout));
        }
        let behind = others.signs.get(own.own..).unwrap_or_default();
        self.signs.resize(own.columns, 0.0);
        self.signs.extend_from_slice(behind);
        true
    }

    /// Mean square residual of each part in units of the noise, for coefficients of the first
    /// columns.
    pub fn misfits(&self, x: &DVector<f64>) -> Vec<Vec<f64>> {
        let places: Vec<usize> = (0..x.len()).collect();
        let step = x - DVector::from_vec(self.origin_of(&places));
        let of = |p: &Part| squares(&p.gram.chosen(&places), &step) / p.freedom.max(1.0);
        self.windows.iter().map(|w| w.iter().map(of).collect()).collect()
    }

    /// The sum of squares that is left of each block over its longest horizon, and its degrees of
    /// freedom.
    pub fn squares_left(&self, x: &DVector<f64>) -> Vec<(f64, f64)> {
        let both = self.misfits(x).into_iter().zip(&self.windows);
        both.map(|(misfit, parts)| (misfit[0] * parts[0].freedom.max(1.0), parts[0].freedom)).collect()
    }

    /// The same with some of the own columns' coefficients at nothing: columns that are not fitted
    /// then count as taken away.
    #[must_use]
    pub fn without(&self, gone: core::ops::Range<usize>) -> Self {
        let mut out = self.clone();
        for column in gone {
            let Some(at) = out.origin.get_mut(column).map(core::mem::take) else { continue };
            out.windows.iter_mut().flatten().for_each(|p| p.gram.retarget(column, at));
        }
        out
    }

    /// Weights 1/e², e² the mean square residual where it is above the noise: what a model lacks
    /// where the motion is large does not tell on what is small, and what adds up over a long
    /// horizon not on a short one.
    ///
    /// Of windows that were cut into blocks the longest horizon tells all there is where nothing but
    /// noise is left of it; shorter ones then add their noise alone, and count as far as it misses
    /// more.
    pub fn weigh(&mut self, misfits: &[Vec<f64>]) {
        let longest = misfits.iter().map(|w| w[0]).sum::<f64>() / misfits.len().max(1) as f64;
        let missed = 1.0 - 1.0 / longest.max(1.0);
        let share = |horizon: usize| if horizon > 0 && self.are_parts { missed } else { 1.0 };
        let of = |w: &Vec<f64>| w.iter().enumerate().map(|(k, e)| share(k) / e.max(1.0)).collect();
        self.weights = misfits.iter().map(of).collect();
    }

    fn parts(&self) -> impl Iterator<Item = (&Part, f64)> {
        self.windows.iter().flatten().zip(self.weights.iter().flatten().copied())
    }

    /// The weighted sum of squares that the sensors' noise alone gives.
    pub fn noise(&self) -> f64 {
        self.parts().map(|(p, w)| p.freedom * w).sum()
    }

    /// The parts by which one model is held against another, whatever they leave.
    fn counted<'a>(&self, block: &'a [Part]) -> &'a [Part] {
        if self.are_parts { &block[..1] } else { block }
    }

    /// What is left of the parts when they are not fitted, whatever the weights: the geometric mean
    /// of the mean square residuals.
    pub fn held_out(&self, columns: &[usize]) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0.0_f64);
        let (grams, p) = (self.grams(columns), columns.len());
        let (signs, origin) = (self.signs_of(columns), self.origin_of(columns));
        for fold in 0..FOLDS {
            let kept = grams.iter().enumerate().filter(|(k, _)| k % FOLDS != fold);
            let total = kept.fold(DMatrix::zeros(p + 1, p + 1), |s, (_, g)| s + g);
            let step = solve_signed(&total, &signs, &origin)?.0;
            for window in self.windows.iter().skip(fold).step_by(FOLDS) {
                for p in self.counted(window) {
                    let left = squares(&p.gram.chosen(columns), &step) / p.freedom.max(1.0);
                    sum += p.freedom * left.max(f64::MIN_POSITIVE).ln();
                    count += p.freedom;
                }
            }
        }
        Some((sum / count.max(1.0)).exp())
    }

    /// Coefficients from some windows, increments left at nothing; none where they are few.
    pub fn of_some(&self, columns: &[usize], keep: impl Fn(&Range) -> bool) -> Option<DVector<f64>> {
        let p = columns.len();
        let grams = self.grams(columns);
        let kept: Vec<&DMatrix<f64>> =
            grams.iter().zip(&self.places).filter(|(_, place)| keep(place)).map(|(g, _)| g).collect();
        if kept.len() < FOLDS {
            return None;
        }
        let total = kept.into_iter().fold(DMatrix::zeros(p + 1, p + 1), |s, g| s + g);
        let origin = self.origin_of(columns);
        let held = solve_signed(&total, &self.signs_of(columns), &origin)?.1;
        let still = |i: usize| self.still.get(columns[i]).copied().unwrap_or(false);
        let held: Vec<bool> = (0..p).map(|i| held[i] || still(i)).collect();
        Some(solve_free(&total, &held, &origin)? + DVector::from_vec(origin))
    }

    fn signs_of(&self, columns: &[usize]) -> Vec<f64> {
        columns.iter().map(|c| self.signs.get(*c).copied().unwrap_or(0.0)).collect()
    }

    fn origin_of(&self, columns: &[usize]) -> Vec<f64> {
        columns.iter().map(|c| self.origin.get(*c).copied().unwrap_or(0.0)).collect()
    }

    /// The same with a ridge on some columns: each adds its entry times their mean square to the
    /// normal matrix.
    pub fn fit_ridge(&self, columns: &[usize], ridge: &[f64]) -> Option<Fit> {
        let p = columns.len();
        let total = self.grams(columns).iter().fold(DMatrix::<f64>::zeros(p + 1, p + 1), |s, g| s + g);
        let on: Vec<usize> = (0..p).filter(|&i| ridge[i] > 0.0).collect();
        let mean = on.iter().map(|&i| total[(i, i)]).sum::<f64>() / on.len().max(1) as f64;
        let share = 1.0 / self.windows.len().max(1) as f64;
        let stiffer: Vec<(usize, f64)> = on.into_iter().map(|i| (i, ridge[i] * mean * share)).collect();
        self.fit_of(columns, &self.stiff_grams(columns, &stiffer), &self.signs_of(columns))
    }

    /// Weighted Gram matrices of some columns, window by window.
    fn grams(&self, columns: &[usize]) -> Vec<DMatrix<f64>> {
        self.stiff_grams(columns, &[])
    }

    /// The same with something added to the squares of some columns, by their place among these:
    /// over the longest horizon, so that it has the same weight in all windows.
    fn stiff_grams(&self, columns: &[usize], stiffer: &[(usize, f64)]) -> Vec<DMatrix<f64>> {
        let p = columns.len();
        let both = self.windows.iter().zip(&self.weights);
        both.map(|(window, weights)| {
            let parts = window.iter().zip(weights).enumerate();
            parts.fold(DMatrix::zeros(p + 1, p + 1), |sum, (horizon, (part, w))| {
                let mut gram = part.gram.chosen(columns);
                stiffer.iter().filter(|_| horizon == 0).for_each(|&(i, by)| gram[(i, i)] += by / w);
                sum + gram * *w
            })
        })
        .collect()
    }

    /// Whether columns behind the own ones can be told from what these do together: a share of each
    /// is left that they do not explain.
    pub fn separable(&self, own: usize, total: &DMatrix<f64>) -> bool {
        let Some(factor) = to_unit_diagonal(total).1.cholesky() else { return false };
        (own..total.nrows() - 1).all(|i| factor.l_dirty()[(i, i)].powi(2) > SEPARABLE)
    }

    /// Fits some columns; none where they are singular or the blocks too few. What is held at zero
    /// has the standard error of a fit without bounds.
    pub fn fit(&self, columns: &[usize]) -> Option<Fit> {
        self.fit_of(columns, &self.grams(columns), &self.signs_of(columns))
    }

    /// The same with either sign of the last `d`.
    pub fn fit_of_either_sign(&self, columns: &[usize], d: usize) -> Option<Fit> {
        let mut signs = self.signs_of(columns);
        signs.iter_mut().rev().take(d).for_each(|s| *s = 0.0);
        self.fit_of(columns, &self.grams(columns), &signs)
    }

    /// The same from their weighted Gram matrices, window by window, with signs that are kept.
    fn fit_of(&self, columns: &[usize], parts: &[DMatrix<f64>], signs: &[f64]) -> Option<Fit> {
        let p = columns.len();
        let own = columns.iter().filter(|c| **c < self.still.len()).count();
        let n = parts.len();
        if n < FOLDS {
            return None;
        }
        let zero = || DMatrix::<f64>::zeros(p + 1, p + 1);
        let total = parts.iter().fold(zero(), |s, g| s + g);
        if own > 0 && p > own && !self.separable(own, &total) {
            return None;
        }
        let origin = self.origin_of(columns);
        let (all, held) = solve_signed(&total, signs, &origin)?;
        // What shows at one time of the record only, as what rang when it began, is less than what is
        // left in the windows of other times, and nothing to them.
        let freedom: f64 = self.parts().map(|(p, _)| p.freedom).sum();
        let left = squares(&total, &all) / freedom.max(1.0);
        let is_absent = |i: usize, kept: f64| i >= own && (all[i] + origin[i]).powi(2) * kept < left;
        let mut held_out = vec![0.0; n];
        let mut train = None;
        for fold in 0..FOLDS {
            let kept = parts.iter().enumerate().filter(|(k, _)| k % FOLDS != fold).fold(zero(), |s, (_, g)| s + g);
            let held: Vec<bool> = (0..p).map(|i| held[i] || is_absent(i, kept[(i, i)])).collect();
            let x = solve_free(&kept, &held, &origin)?;
            (fold..n).step_by(FOLDS).for_each(|k| held_out[k] = squares(&parts[k], &x));
            if fold == 0 {
                let still = |i: usize| self.still.get(columns[i]).copied().unwrap_or(false);
                let without: Vec<bool> = (0..p).map(|i| held[i] || still(i)).collect();
                train = Some(if without == held { x } else { solve_free(&kept, &without, &origin)? });
            }
        }
        let jackknife = |held: &[bool], all: &DVector<f64>| -> Option<DMatrix<f64>> {
            let mut covariance = DMatrix::zeros(p, p);
            for part in parts {
                let change = solve_free(&(&total - part), held, &origin)? - all;
                covariance += &change * change.transpose() * ((n - 1) as f64 / n as f64);
            }
            Some(covariance)
        };
        // What some window alone shows has no scatter between windows: it counts as its own error.
        let is_alone = |i: usize| parts.iter().any(|part| is_absent(i, total[(i, i)] - part[(i, i)]));
        let alone: Vec<bool> = (0..p).map(|i| !held[i] && is_alone(i)).collect();
        let mut covariance = if alone.contains(&true) {
            let without: Vec<bool> = (0..p).map(|i| held[i] || alone[i]).collect();
            jackknife(&without, &solve_free(&total, &without, &origin)?)?
        } else {
            jackknife(&held, &all)?
        };
        (0..p).filter(|i| alone[*i]).for_each(|i| covariance[(i, i)] = (all[i] + origin[i]).powi(2));
        if held.contains(&true) {
            let free = vec![false; p];
            let plain = jackknife(&free, &solve_free(&total, &free, &origin)?)?;
            (0..p).filter(|i| held[*i]).for_each(|i| covariance[(i, i)] = plain[(i, i)]);
        }
        let even = self.even_covariance(columns, own, &total, &all);
        // Windows weigh alike: those in which a friction shows most are those that miss most
        // without it.
        let origin = DVector::from_vec(origin);
        let (all, train) = (all + &origin, train? + origin);
        Some(Fit { all, train, covariance, blocks: n, effective: vec![n as f64; p], held_out, even })
    }
}

#[cfg(test)]
#[path = "blocks_tests.rs"]
mod tests;
