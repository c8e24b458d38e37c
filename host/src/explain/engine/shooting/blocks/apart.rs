//! Blocks by themselves: what they tell and leave with an initial state of their own, whatever others
//! do.

use nalgebra::{DMatrix, DVector};

use super::{Blocks, Part, solve};

impl Blocks {
    /// The first part of a block that has an initial state of its own.
    fn alone(&self, block: &[Part]) -> usize {
        usize::from(self.are_parts && block.len() > 1)
    }

    /// Weighted Gram matrices of some columns, block by block, of increments from the coefficients
    /// that they were taken at.
    pub fn grams_alone(&self, columns: &[usize]) -> Vec<DMatrix<f64>> {
        let p = columns.len() + 1;
        let of = |(block, weights): (&Vec<Part>, &Vec<f64>)| {
            let own = block.iter().zip(weights).skip(self.alone(block));
            own.fold(DMatrix::zeros(p, p), |sum, (part, w)| sum + part.gram.chosen(columns) * *w)
        };
        self.windows.iter().zip(&self.weights).map(of).collect()
    }

    /// Coefficients of some columns from the sum of some of these Gram matrices; none where that does
    /// not tell them.
    pub fn solved_alone(&self, columns: &[usize], grams: &[DMatrix<f64>]) -> Option<DVector<f64>> {
        let p = columns.len() + 1;
        let total = grams.iter().fold(DMatrix::zeros(p, p), |sum, g| sum + g);
        Some(solve(&total)? + DVector::from_vec(self.origin_of(columns)))
    }

    /// Power of what coefficients of the first columns leave of each block over that of the noise.
    pub fn powers_alone(&self, x: &DVector<f64>) -> Vec<f64> {
        self.misfits(x).iter().zip(&self.windows).map(|(misfit, block)| misfit[self.alone(block)]).collect()
    }

    /// What each block counts in a fit: its degrees of freedom over every horizon, by its weights.
    pub fn weights_of_blocks(&self) -> Vec<f64> {
        let of = |(block, weights): (&Vec<Part>, &Vec<f64>)| {
            block.iter().zip(weights).map(|(p, w)| p.freedom * w).sum::<f64>()
        };
        self.windows.iter().zip(&self.weights).map(of).collect()
    }
}
