//! Eigenvalues and eigenvectors of a symmetric matrix, largest value first.
//!
//! faer's solver: blocked reduction to three diagonals, divide and conquer. It is built without its feature `rayon`, so that it runs on one thread
//! and the result does not depend on their number.

use faer::Side;
use nalgebra::DMatrix;

use super::gram::view;

/// Values, largest first, and unit vectors as columns in that order. None where the matrix holds what is not finite.
pub fn symmetric(a: &DMatrix<f64>) -> Option<(Vec<f64>, DMatrix<f64>)> {
    let n = a.nrows();
    if n == 0 {
        return Some((Vec::new(), DMatrix::zeros(0, 0)));
    }
    if !a.iter().all(|x| x.is_finite()) {
        return None;
    }
    let eigen = view(a).self_adjoint_eigen(Side::Lower).ok()?;
    let (values, vectors) = (eigen.S(), eigen.U());
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
    fn what_is_not_finite_has_no_eigenvectors() {
        assert!(symmetric(&DMatrix::from_element(2, 2, f64::NAN)).is_none());
        assert!(symmetric(&DMatrix::from_element(2, 2, f64::INFINITY)).is_none());
        assert_eq!(symmetric(&DMatrix::zeros(0, 0)).unwrap().0.len(), 0);
    }
}
