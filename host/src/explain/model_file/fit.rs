//! Least squares over blocks of a record: coefficients, jackknife covariance, and the residual of each block when it is not fitted.
//!
//! A block is a stretch of consecutive windows or pieces, at least as long as what a model lacks stays the same for (4 s, or a twelfth of the
//! record if that is shorter). Every third block is one fold, as in [`crate::explain::ranking`]. Coefficients of laws that take energy away
//! may not come out with the sign of laws that give it: one that would is held at zero and the others are fitted again.

use nalgebra::{DMatrix, DVector};

use crate::explain::ranking::{FOLDS, Fit, solve, squares};
use crate::identify::windows::{WindowRows, frequency_of_row};

/// The Gram matrices of all columns and the target over each block, weighted.
#[derive(Clone, Debug)]
pub struct Blocks {
    grams: Vec<DMatrix<f64>>,
}

/// A fit, and which of its coefficients are held at zero.
#[derive(Clone, Debug)]
pub struct Held {
    /// The fit; coefficients that are held are zero in it, their standard errors those of a fit without bounds.
    pub fit: Fit,
    /// Whether each is held.
    pub held: Vec<bool>,
}

/// The least-squares solution with signs kept (0: any), and what is held.
pub fn solve_signed(total: &DMatrix<f64>, signs: &[f64]) -> Option<(DVector<f64>, Vec<bool>)> {
    let p = signs.len();
    let mut held = vec![false; p];
    loop {
        let x = solve_free(total, &held)?;
        // The one that is furthest on the wrong side, in units of what it adds.
        let wrong = |i: usize| -signs[i] * x[i] * total[(i, i)].max(0.0).sqrt();
        match (0..p).filter(|&i| wrong(i) > 0.0).max_by(|&a, &b| wrong(a).total_cmp(&wrong(b))) {
            Some(i) => held[i] = true,
            None => return Some((x, held)),
        }
    }
}

/// The solution of a Gram matrix with some coefficients held at zero.
fn solve_free(total: &DMatrix<f64>, held: &[bool]) -> Option<DVector<f64>> {
    let p = held.len();
    let free: Vec<usize> = (0..p).filter(|i| !held[*i]).chain([p]).collect();
    let part = DMatrix::from_fn(free.len(), free.len(), |i, j| total[(free[i], free[j])]);
    let found = solve(&part)?;
    let mut x = DVector::zeros(p);
    free.iter().zip(found.iter()).for_each(|(&i, v)| x[i] = *v);
    Some(x)
}

impl Blocks {
    /// Blocks of `length_s` of the rows of one equation; its columns, then the target.
    pub fn new(rows: &[WindowRows], equation: usize, columns: usize, weights: &[f64], length_s: f64) -> Self {
        let mut grams: Vec<DMatrix<f64>> = Vec::new();
        let mut present = None;
        for window in rows {
            // Monotone and bounded by the record's length: the cast is exact enough to tell blocks apart.
            let block = (window.run, (window.start_s / length_s).floor() as i64);
            if present != Some(block) {
                grams.push(DMatrix::zeros(columns + 1, columns + 1));
                present = Some(block);
            }
            let Some(gram) = grams.last_mut() else { continue };
            for (r, row) in window.equations[equation].chunks_exact(columns + 1).enumerate() {
                let w = weights[frequency_of_row(r)];
                for i in 0..=columns {
                    let wi = w * row[i];
                    if wi != 0.0 {
                        for j in 0..=i {
                            gram[(i, j)] += wi * row[j];
                        }
                    }
                }
            }
        }
        grams.iter_mut().for_each(DMatrix::fill_upper_triangle_with_lower_triangle);
        Self { grams }
    }

    /// Blocks whose Gram matrices are known.
    pub fn of(grams: Vec<DMatrix<f64>>) -> Self {
        Self { grams }
    }

    /// Number of blocks.
    pub fn len(&self) -> usize {
        self.grams.len()
    }

    /// Fits some columns, each with the sign given (0: any); none where they are singular or the blocks too few.
    pub fn fit(&self, columns: &[usize], signs: &[f64]) -> Option<Held> {
        let p = columns.len();
        let last = self.grams.first()?.nrows() - 1;
        let places: Vec<usize> = columns.iter().copied().chain([last]).collect();
        let parts: Vec<DMatrix<f64>> =
            self.grams.iter().map(|g| DMatrix::from_fn(p + 1, p + 1, |i, j| g[(places[i], places[j])])).collect();
        let n = parts.len();
        if n < 2 * FOLDS {
            return None;
        }
        let zero = || DMatrix::<f64>::zeros(p + 1, p + 1);
        let total = parts.iter().fold(zero(), |s, g| s + g);
        let (all, held) = solve_signed(&total, signs)?;
        let mut held_out = vec![0.0; n];
        let mut train = None;
        for fold in 0..FOLDS {
            let kept = parts.iter().enumerate().filter(|(k, _)| k % FOLDS != fold).fold(zero(), |s, (_, g)| s + g);
            let x = solve_free(&kept, &held)?;
            (fold..n).step_by(FOLDS).for_each(|k| held_out[k] = squares(&parts[k], &x));
            if fold == 0 {
                train = Some(x);
            }
        }
        let jackknife = |held: &[bool], all: &DVector<f64>| -> Option<DMatrix<f64>> {
            let mut covariance = DMatrix::zeros(p, p);
            for part in &parts {
                let change = solve_free(&(&total - part), held)? - all;
                covariance += &change * change.transpose() * ((n - 1) as f64 / n as f64);
            }
            Some(covariance)
        };
        let mut covariance = jackknife(&held, &all)?;
        if held.contains(&true) {
            let free = vec![false; p];
            let plain = jackknife(&free, &solve_free(&total, &free)?)?;
            (0..p).filter(|i| held[*i]).for_each(|i| covariance[(i, i)] = plain[(i, i)]);
        }
        Some(Held {
            fit: Fit { all, train: train?, covariance, blocks: n, effective: vec![n as f64; p], held_out },
            held,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y = 2 a − b + c over blocks of random rows: free, all are found; with b ≥ 0 it is held, and the others are those of a fit without it.
    #[test]
    fn a_coefficient_of_the_wrong_sign_is_held_at_zero() {
        let mut seed = 7_u32;
        let mut random = move || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
        };
        let grams: Vec<DMatrix<f64>> = (0..12)
            .map(|_| {
                let mut gram = DMatrix::zeros(4, 4);
                for _ in 0..20 {
                    let (a, b, c) = (random(), random(), random());
                    let row = DVector::from_vec(vec![a, b, c, 2.0 * a - b + c + 0.01 * random()]);
                    gram += &row * row.transpose();
                }
                gram
            })
            .collect();
        let blocks = Blocks::of(grams);
        let free = blocks.fit(&[0, 1, 2], &[0.0; 3]).unwrap();
        assert!((free.fit.all[1] + 1.0).abs() < 0.01 && free.held == [false; 3], "{}", free.fit.all);
        let kept = blocks.fit(&[0, 1, 2], &[1.0, 1.0, 0.0]).unwrap();
        let without = blocks.fit(&[0, 2], &[0.0; 2]).unwrap();
        assert_eq!(kept.held, [false, true, false]);
        assert_eq!(kept.fit.all[1], 0.0);
        assert!((kept.fit.all[0] - without.fit.all[0]).abs() < 1e-12, "{}", kept.fit.all);
        assert!(kept.fit.covariance[(1, 1)] > 0.0 && kept.fit.held_out.iter().sum::<f64>() > 0.1);
    }
}
