//! Mean and covariance of a record of any length, a block at a time: n² numbers of memory, one
//! pass.
//!
//! Blocks are combined by the pairwise update of T. F. Chan, G. H. Golub, R. J. LeVeque (*The
//! American Statistician* 37, 1983): C ← C_a + C_b + δδᵀ m_a m_b/(m_a + m_b), δ the difference of
//! the means, so that a large mean costs no digits.

use nalgebra::{DMatrix, DVector};

use super::gram::gram;
use super::proper_orthogonal_decomposition::{Pod, from_covariance};

/// Accumulates snapshots.
#[derive(Clone, Debug)]
pub struct Accumulator {
    count: u64,
    mean: DVector<f64>,
    scatter: DMatrix<f64>,
}

impl Accumulator {
    /// Nothing yet, for n channels.
    pub fn new(n: usize) -> Self {
        Self { count: 0, mean: DVector::zeros(n), scatter: DMatrix::zeros(n, n) }
    }

    /// Samples seen.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Mean of each channel.
    pub fn mean(&self) -> &[f64] {
        self.mean.as_slice()
    }

    /// Covariance of the channels, n × n.
    pub fn covariance(&self) -> DMatrix<f64> {
        &self.scatter / (self.count.max(1) as f64)
    }

    /// Adds a block: one slice for each channel, all of one length (longer ones are cut to the
    /// shortest).
    pub fn add(&mut self, channels: &[&[f64]]) {
        let n = self.mean.len().min(channels.len());
        let m = channels.iter().map(|c| c.len()).min().unwrap_or(0);
        if m == 0 || n < self.mean.len() {
            return;
        }
        let mut x = DMatrix::zeros(m, n);
        let mut mean = DVector::zeros(n);
        for (k, c) in channels[..n].iter().enumerate() {
            mean[k] = c[..m].iter().sum::<f64>() / m as f64;
            for (to, from) in x.column_mut(k).iter_mut().zip(&c[..m]) {
                *to = from - mean[k];
            }
        }
        let delta = &mean - &self.mean;
        let (a, b) = (self.count as f64, m as f64);
        self.scatter += gram(&x) + &delta * delta.transpose() * (a * b / (a + b));
        self.mean += delta * (b / (a + b));
        self.count += m as u64;
    }

    /// The decomposition of all that was added.
    pub fn finish(self, masses: Option<&[f64]>) -> Pod {
        from_covariance(self.mean().to_vec(), self.covariance(), masses)
    }
}

#[cfg(test)]
mod tests {
    use super::super::proper_orthogonal_decomposition::{Route, decompose};
    use super::*;

    #[test]
    fn blocks_of_any_size_give_the_whole_records_modes() {
        let x: Vec<Vec<f64>> = (0..4)
            .map(|c| (0..1000).map(|i| 1e4 + ((i * (c + 2)) as f64 * 0.013).sin() * (1.0 + c as f64)).collect())
            .collect();
        let all: Vec<&[f64]> = x.iter().map(Vec::as_slice).collect();
        let whole = decompose(&all, None, Route::Svd);
        let mut parts = Accumulator::new(4);
        let mut from = 0;
        for length in [1, 7, 300, 2, 690] {
            parts.add(&x.iter().map(|c| &c[from..from + length]).collect::<Vec<_>>());
            from += length;
        }
        assert_eq!(parts.count(), 1000);
        let parts = parts.finish(None);
        for k in 0..4 {
            assert!((parts.values[k] / whole.values[k] - 1.0).abs() < 1e-9, "{k}");
            assert!(parts.modes[k].iter().zip(&whole.modes[k]).all(|(a, b)| (a - b).abs() < 1e-8));
        }
    }
}
