//! The directions in which the neighbours of a point really spread, and planes within them.
//!
//! A state of more delays than the motion has dimensions is bent into directions in which no motion
//! goes: there neighbours lie as far as their sheet is curved, and a gradient along such a direction
//! is that curvature's. Of the principal directions of a neighbourhood, the widest first, each one
//! counts whose spread no quadratic form of those before explains; the first that one does is the
//! sheet's thickness, as are all behind.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Share of a direction's variance that a quadratic form of the directions before must leave (by
/// hand: of two tori, Lorenz's and Rössler's attractors and two conservative chaotic motions 0.1 and
/// 0.3 gave exponents within their errors).
const OWN: f64 = 0.3;

/// Slopes (components × targets) of the weighted least-squares planes of `targets` (neighbours ×
/// targets) over `rows` (neighbours × components), within the directions of their sheet; none where
/// they are singular.
pub fn slopes(rows: &DMatrix<f64>, weights: &DVector<f64>, targets: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let (count, components) = rows.shape();
    let roots = weights.map(f64::sqrt);
    let mean = rows.tr_mul(weights) / weights.sum();
    let centred = DMatrix::from_fn(count, components, |i, j| rows[(i, j)] - mean[j]);
    let scaled = weighted(&centred, &roots);
    let eigen = SymmetricEigen::try_new(scaled.tr_mul(&scaled), f64::EPSILON, 1000)?;
    let mut order: Vec<usize> = (0..components).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let along: Vec<DVector<f64>> = order.iter().map(|k| &centred * eigen.eigenvectors.column(*k)).collect();
    let own = (1..components).take_while(|&j| is_own(&along[..j], &along[j], &roots)).count() + 1;
    let plane = DMatrix::from_fn(count, own + 1, |i, k| if k == 0 { 1.0 } else { along[k - 1][i] });
    let plane = weighted(&plane, &roots);
    let solution = plane.tr_mul(&plane).cholesky()?.solve(&plane.tr_mul(&weighted(targets, &roots)));
    let basis = DMatrix::from_fn(components, own, |i, k| eigen.eigenvectors[(i, order[k])]);
    Some(basis * solution.rows(1, own))
}

/// Rows times square roots of weights.
fn weighted(rows: &DMatrix<f64>, roots: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(rows.nrows(), rows.ncols(), |i, j| rows[(i, j)] * roots[i])
}

/// Whether a quadratic form of some directions leaves of another's spread what is its own; so too
/// where neighbours are too few to tell.
fn is_own(before: &[DVector<f64>], next: &DVector<f64>, roots: &DVector<f64>) -> bool {
    let counted = roots.iter().filter(|r| **r > 0.0).count();
    let mut columns = vec![roots.clone()];
    columns.extend(before.iter().map(|u| u.component_mul(roots)));
    for (k, u) in before.iter().enumerate() {
        columns.extend(before[k..].iter().map(|v| u.component_mul(v).component_mul(roots)));
    }
    let target = next.component_mul(roots);
    let (all, mean) = (target.norm_squared(), counted as f64);
    let Some(freedom) = counted.checked_sub(columns.len()).filter(|f| *f > 0) else { return true };
    // Orthogonalised twice, against rounding.
    let mut left = target;
    let mut basis: Vec<DVector<f64>> = Vec::with_capacity(columns.len());
    for mut column in columns {
        let length = column.norm();
        for _ in 0..2 {
            basis.iter().for_each(|b| column.axpy(-b.dot(&column), b, 1.0));
        }
        if column.norm() > 1e-9 * length {
            column.normalize_mut();
            left.axpy(-column.dot(&left), &column, 1.0);
            basis.push(column);
        }
    }
    left.norm_squared() / freedom as f64 > OWN * all / mean
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bent sheet in three dimensions: slopes lie in its plane, and a sheet of some thickness has
    /// all three.
    #[test]
    fn a_curved_sheet_has_two_directions() {
        let at = |i: usize| ((i as f64 * 0.37).sin(), 0.7 * (i as f64 * 0.83).cos(), 0.2 * (i as f64 * 1.91).sin());
        let rows = |thickness: f64| {
            DMatrix::from_fn(60, 3, |i, j| {
                let (u, v, w) = at(i);
                [u, v, 0.1 * (u * u - u * v) + thickness * w][j]
            })
        };
        let weights = DVector::from_element(60, 1.0);
        let of = |thickness: f64| {
            let rows = rows(thickness);
            // What moves with the third direction as well.
            let target = DMatrix::from_fn(60, 1, |i, _| 2.0 * rows[(i, 0)] - rows[(i, 1)] + 5.0 * rows[(i, 2)]);
            slopes(&rows, &weights, &target).unwrap()
        };
        assert!(of(0.0)[2].abs() < 0.5 && (of(0.0)[0] - 2.0).abs() < 0.5, "{}", of(0.0));
        assert!((of(1.0)[2] - 5.0).abs() < 1e-6, "{}", of(1.0));
    }
}
