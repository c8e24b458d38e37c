//! Eigenvalues and eigenvectors of a symmetric matrix, largest value first.
//!
//! faer's solver: reduction to three diagonals, divide and conquer. What it shares out among
//! threads it adds up part by part, so that the number of parts, not that of threads, decides the
//! last digits: always four, whatever does them.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::{Mat, Par};
use nalgebra::DMatrix;

/// Parts into which work on large matrices is cut.
const PARTS: usize = 4;

use super::gram::view;

/// Values, largest first, and unit vectors as columns in that order. None where the matrix holds
/// what is not finite.
pub fn symmetric(a: &DMatrix<f64>) -> Option<(Vec<f64>, DMatrix<f64>)> {
    let n = a.nrows();
    if n == 0 {
        return Some((Vec::new(), DMatrix::zeros(0, 0)));
    }
    if !a.iter().all(|x| x.is_finite()) {
        return None;
    }
    let (mut values, mut vectors) = (Diag::<f64>::zeros(n), Mat::<f64>::zeros(n, n));
    let (par, settings) = (Par::rayon(PARTS), Default::default());
    let mut room = MemBuffer::new(self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, par, settings));
    let stack = MemStack::new(&mut room);
    self_adjoint_evd(view(a), values.as_mut(), Some(vectors.as_mut()), par, stack, settings).ok()?;
    // faer answers in rising order.
    let sorted = (0..n).rev().map(|k| values[k]).collect();
    Some((sorted, DMatrix::from_fn(n, n, |i, k| vectors[(i, n - 1 - k)])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_are_those_of_the_matrix() {
        let x = DMatrix::from_fn(60, 60, |i, j| ((i * 37 + j * 11) as f64 * 0.71).sin());
        let a = &x + x.transpose();
        let (values, vectors) = symmetric(&a).unwrap();
        assert!(values.windows(2).all(|w| w[0] >= w[1]));
        for (k, value) in values.iter().enumerate() {
            let v = vectors.column(k);
            assert!((&a * v - v * *value).amax() < 1e-11 && (v.norm() - 1.0).abs() < 1e-12, "{k}");
        }
        let other = a.symmetric_eigenvalues();
        assert!((values[0] - other.max()).abs() < 1e-11 && (values[59] - other.min()).abs() < 1e-11);
    }

    #[test]
    fn the_number_of_threads_changes_no_digit() {
        let x = DMatrix::from_fn(500, 500, |i, j| ((i * 37 + j * 11) as f64 * 0.71).sin());
        let a = &x + x.transpose();
        let on =
            |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| symmetric(&a));
        let (one, three) = (on(1), on(3));
        assert!(one.is_some() && one == three && three == on(8));
    }

    #[test]
    fn what_is_not_finite_has_no_eigenvectors() {
        assert!(symmetric(&DMatrix::from_element(2, 2, f64::NAN)).is_none());
        assert!(symmetric(&DMatrix::from_element(2, 2, f64::INFINITY)).is_none());
        assert_eq!(symmetric(&DMatrix::zeros(0, 0)).unwrap().0.len(), 0);
    }
}
