//! Least squares over blocks of a record: coefficients, jackknife covariance, and the residual of each block when it is not fitted.
//!
//! A block is a stretch of consecutive windows, at least as long as what a model lacks stays the same for (4 s, or a twelfth of the
//! record if that is shorter). Every third block is one fold, as in [`crate::explain::ranking`].

use nalgebra::DMatrix;

use crate::explain::ranking::{FOLDS, Fit, solve, squares};
use crate::identify::windows::{WindowRows, frequency_of_row};

/// The Gram matrices of all columns and the target over each block, weighted.
#[derive(Clone, Debug)]
pub struct Blocks {
    grams: Vec<DMatrix<f64>>,
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

    /// Number of blocks.
    pub fn len(&self) -> usize {
        self.grams.len()
    }

    /// Fits some columns; none where they are singular or the blocks too few.
    pub fn fit(&self, columns: &[usize]) -> Option<Fit> {
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
        let all = solve(&total)?;
        let mut held_out = vec![0.0; n];
        let mut train = None;
        for fold in 0..FOLDS {
            let kept = parts.iter().enumerate().filter(|(k, _)| k % FOLDS != fold).fold(zero(), |s, (_, g)| s + g);
            let x = solve(&kept)?;
            (fold..n).step_by(FOLDS).for_each(|k| held_out[k] = squares(&parts[k], &x));
            if fold == 0 {
                train = Some(x);
            }
        }
        let mut covariance = DMatrix::zeros(p, p);
        for part in &parts {
            let change = solve(&(&total - part))? - &all;
            covariance += &change * change.transpose() * ((n - 1) as f64 / n as f64);
        }
        Some(Fit { all, train: train?, covariance, blocks: n, effective: vec![n as f64; p], held_out })
    }
}
