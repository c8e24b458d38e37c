//! Whether what blocks of a record leave depends on their order in time: they are put into other
//! orders, and the best cut in time is held against the best cuts of these (a permutation test of a
//! change at an unknown time; Zeileis and Hothorn 2013).
//!
//! Blocks whose motion is alike are exchanged with one another and no others, so that what depends
//! on the motion, and by it on time (a swing that dies, a force that grows), does not tell.

use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::explain::decision::OF_A_FAMILY;
use crate::explain::ranking::{FOLDS, solve, squares};

/// Orders that are tried: five of a thousand may do as well at a probability of 0.005.
const ORDERS: usize = 999;

/// Most blocks that are exchanged with one another as being alike. Where the order by motion is that
/// by time, a cut goes through one such group at most, and 1 of C(8, 4) = 70 orders of it does as
/// well as that by time: never a rare one.
const ALIKE: usize = 8;

/// Most cuts that are tried, evenly spread.
const CUTS: usize = 16;

/// What a cut is to leave little of.
pub enum Measure<'a> {
    /// A number of each block, about the mean of its part.
    Levels(&'a [f64]),
    /// Squares that coefficients of its own leave of each part: Gram matrices of blocks, the target
    /// last.
    Coefficients(&'a [DMatrix<f64>]),
}

/// What the best coefficients leave of the target of a Gram matrix.
pub fn left(gram: &DMatrix<f64>) -> Option<f64> {
    Some(squares(gram, &solve(gram)?))
}

impl Measure<'_> {
    /// Blocks.
    fn count(&self) -> usize {
        match self {
            Self::Levels(all) => all.len(),
            Self::Coefficients(all) => all.len(),
        }
    }

    /// What is left of blocks in an order, cut before each of some places; none where a part does not
    /// tell its coefficients.
    fn cut(&self, order: &[usize], cuts: &[usize]) -> Vec<Option<f64>> {
        match self {
            Self::Levels(all) => {
                let sums = |part: &[usize]| {
                    let sum: f64 = part.iter().map(|k| all[*k]).sum();
                    part.iter().map(|k| all[*k] * all[*k]).sum::<f64>() - sum * sum / part.len() as f64
                };
                cuts.iter().map(|&at| Some(sums(&order[..at]) + sums(&order[at..]))).collect()
            }
            Self::Coefficients(all) => {
                let sum = |part: &[usize]| -> Option<DMatrix<f64>> {
                    let first = all[*part.first()?].clone();
                    Some(part[1..].iter().fold(first, |sum, k| sum + &all[*k]))
                };
                let ends = cuts.iter().copied().chain([order.len()]);
                let pieces: Option<Vec<DMatrix<f64>>> =
                    core::iter::once(0).chain(cuts.iter().copied()).zip(ends).map(|(a, b)| sum(&order[a..b])).collect();
                let Some(pieces) = pieces else { return vec![None; cuts.len()] };
                let both = |at: usize| {
                    let part = |of: &[DMatrix<f64>]| left(&of[1..].iter().fold(of[0].clone(), |sum, g| sum + g));
                    Some(part(&pieces[..at])? + part(&pieces[at..])?)
                };
                (1..=cuts.len()).map(both).collect()
            }
        }
    }

    /// The best of some cuts, and what it leaves.
    fn best(&self, order: &[usize], cuts: &[usize]) -> Option<(usize, f64)> {
        let all = cuts.iter().copied().zip(self.cut(order, cuts));
        all.filter_map(|(at, left)| Some((at, left?))).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The block before which the record is cut best, and what that leaves, where at most a few of a
    /// thousand other orders can be cut as well; `groups` are ways to sort the blocks into groups,
    /// those of one being alike: each must say so.
    pub fn in_time(&self, groups: &[Vec<Vec<usize>>]) -> Option<(usize, f64)> {
        let n = self.count();
        // Each part has to hold a block of every fold.
        let places: Vec<usize> = (FOLDS..=n.checked_sub(FOLDS)?).collect();
        let step = places.len().div_ceil(CUTS).max(1);
        let some: Vec<usize> =
            places.iter().copied().skip((places.len().max(1) - 1) % step / 2).step_by(step).collect();
        let order: Vec<usize> = (0..n).collect();
        let found = self.best(&order, &some)?.1;
        // Sums of the same blocks in another order differ by rounding.
        let whole = self.cut(&order, &[n / 2]).first().copied().flatten().unwrap_or(found).abs();
        let as_good = found + 1e-9 * whole.max(found.abs());
        groups.iter().all(|of| self.is_rare(of, &some, as_good)).then(|| self.best(&order, &places)).flatten()
    }

    /// Whether hardly an order within groups leaves so little.
    fn is_rare(&self, groups: &[Vec<usize>], cuts: &[usize], as_good: f64) -> bool {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut order: Vec<usize> = (0..self.count()).collect();
        let mut good = 1;
        for _ in 0..ORDERS {
            for group in groups {
                let mut other = group.clone();
                for i in (1..other.len()).rev() {
                    other.swap(i, rng.random_range(0..=i));
                }
                group.iter().zip(other).for_each(|(place, block)| order[*place] = block);
            }
            good += usize::from(self.best(&order, cuts).is_some_and(|b| b.1 <= as_good));
            if good as f64 > OF_A_FAMILY * (ORDERS + 1) as f64 {
                return false;
            }
        }
        true
    }
}

/// All blocks in one group.
pub fn together(count: usize) -> Vec<Vec<usize>> {
    vec![(0..count).collect()]
}

/// Groups of blocks that are alike in something.
pub fn alike(by: &[f64]) -> Vec<Vec<usize>> {
    let mut sorted: Vec<usize> = (0..by.len()).collect();
    sorted.sort_by(|a, b| by[*a].total_cmp(&by[*b]));
    let count = by.len().div_ceil(ALIKE);
    (0..count).map(|g| sorted[g * by.len() / count..(g + 1) * by.len() / count].to_vec()).collect()
}

/// What coefficients leave that go evenly with time; none where the blocks do not tell them.
pub fn left_by_drift(grams: &[DMatrix<f64>], times: &[f64]) -> Option<f64> {
    let p = grams.first()?.nrows() - 1;
    let (low, high) = (times.first()?, times.last()?);
    let mut total = DMatrix::zeros(2 * p + 1, 2 * p + 1);
    for (gram, t) in grams.iter().zip(times) {
        let along = (2.0 * t - low - high) / (high - low);
        // Every column once more, by time.
        let of = |k: usize| match k {
            k if k < p => (k, 1.0),
            k if k < 2 * p => (k - p, along),
            _ => (p, 1.0),
        };
        total += DMatrix::from_fn(2 * p + 1, 2 * p + 1, |i, j| {
            let ((i, a), (j, b)) = (of(i), of(j));
            a * b * gram[(i, j)]
        });
    }
    left(&total)
}

#[cfg(test)]
#[path = "order_tests.rs"]
mod tests;
