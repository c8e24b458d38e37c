//! Coefficients that stand in several equations: one value for all of them.
//!
//! Equations are solved one by one; with θ their coefficients, C what ties them to the shared ones
//! p (θ = C p) and W the inverse of the metric, p = (CᵀWC)⁻¹CᵀW θ: the generalised least squares
//! that solving all equations at once would give. Its covariance is A Σ Aᵀ.

use nalgebra::{DMatrix, DVector};

/// Values and covariance of the coefficients named in `names`, each name once, in order of first
/// appearance. The metric is the covariance of independent residuals; where nothing is shared
/// everything stays as it is.
pub fn tie(
    names: &[String],
    values: &DVector<f64>,
    covariance: &DMatrix<f64>,
    metric: &DMatrix<f64>,
) -> (Vec<String>, DVector<f64>, DMatrix<f64>) {
    let mut own: Vec<String> = Vec::new();
    for n in names {
        if !own.contains(n) {
            own.push(n.clone());
        }
    }
    if own.len() == names.len() {
        return (own, values.clone(), covariance.clone());
    }
    let c = DMatrix::from_fn(names.len(), own.len(), |i, j| f64::from(u8::from(names[i] == own[j])));
    // Scaled to unit diagonal, since coefficients differ by orders of magnitude.
    let scale = DVector::from_fn(names.len(), |i, _| metric[(i, i)].max(f64::MIN_POSITIVE).sqrt());
    let scaled = DMatrix::from_fn(names.len(), names.len(), |i, j| metric[(i, j)] / (scale[i] * scale[j]));
    let weight = scaled.try_inverse().unwrap_or_else(|| DMatrix::identity(names.len(), names.len()));
    let weight = DMatrix::from_fn(names.len(), names.len(), |i, j| weight[(i, j)] / (scale[i] * scale[j]));
    let right = c.transpose() * weight;
    let Some(inverse) = (&right * &c).try_inverse() else {
        return (names.to_vec(), values.clone(), covariance.clone());
    };
    let a = inverse * right;
    let tied = &a * values;
    let spread = &a * covariance * a.transpose();
    (own, tied, spread)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shared_coefficient_is_the_weighted_mean() {
        let names: Vec<String> = ["a", "c", "c"].iter().map(|s| (*s).to_owned()).collect();
        let values = DVector::from_vec(vec![5.0, 1.0, 4.0]);
        let metric = DMatrix::from_diagonal(&DVector::from_vec(vec![1.0, 1.0, 0.5]));
        let (own, tied, covariance) = tie(&names, &values, &metric, &metric);
        assert_eq!(own, ["a", "c"]);
        // Weights 1 and 2.
        assert!((tied[0] - 5.0).abs() < 1e-12 && (tied[1] - 3.0).abs() < 1e-12, "{tied}");
        assert!((covariance[(1, 1)] - 1.0 / 3.0).abs() < 1e-12);
    }
}
