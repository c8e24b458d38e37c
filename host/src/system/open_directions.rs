//! Directions of a system's parameters that nothing fixes: the null space of a Jacobian with exact
//! derivatives, what has a part in it, and what would have to be known.

use nalgebra::{DMatrix, DVector};

/// Singular values below this share of the largest are null: the Jacobian's rows and columns have
/// unit norm, its derivatives are exact, and rounding leaves some 1e-15.
pub const NULL: f64 = 1e-9;
/// Share of a gradient in the null space from which it is undetermined.
const OPEN: f64 = 1e-6;
/// Scales columns to unit norm; the factors by which they were divided.
pub fn unit_columns(j: &mut DMatrix<f64>) -> Vec<f64> {
    j.column_iter_mut()
        .map(|mut c| {
            let norm = c.norm();
            if norm > 0.0 && norm.is_finite() {
                c /= norm;
                norm
            } else {
                1.0
            }
        })
        .collect()
}

/// Directions that nothing fixes, in unknowns whose columns have unit norm; with the columns'
/// norms.
pub fn null_space(mut j: DMatrix<f64>) -> Option<(DMatrix<f64>, Vec<f64>)> {
    for mut row in j.row_iter_mut() {
        let norm = row.norm();
        if norm > 0.0 {
            row /= norm;
        }
    }
    let n = j.ncols();
    let scale = unit_columns(&mut j);
    // As many rows as columns at least, so that the decomposition holds every direction.
    let rows = j.nrows().max(n);
    let j = j.resize_vertically(rows, 0.0);
    let svd = j.svd(false, true);
    let v_t = svd.v_t?;
    let cut = NULL * svd.singular_values.max().max(f64::MIN_POSITIVE);
    let open: Vec<usize> = (0..n).filter(|&i| svd.singular_values[i] <= cut).collect();
    Some((DMatrix::from_fn(n, open.len(), |r, c| v_t[(open[c], r)]), scale))
}

/// Whether a gradient has a part in the null space.
pub fn is_open(open: &DMatrix<f64>, gradient: &DVector<f64>) -> bool {
    open.ncols() > 0 && (open.transpose() * gradient).norm() > OPEN * gradient.norm()
}

/// What would fix most of what is open if it were known: the null space without its gradient's
/// direction.
pub fn wanted(open: &DMatrix<f64>, gradients: &[(String, DVector<f64>)]) -> Option<(String, Vec<String>)> {
    let mut best: Option<(String, Vec<String>)> = None;
    for (name, gradient) in gradients {
        let along = open.transpose() * gradient;
        let norm = along.norm();
        if norm <= OPEN * gradient.norm() {
            continue;
        }
        let along = along / norm;
        let left = open - open * &along * along.transpose();
        let follow: Vec<String> =
            gradients.iter().filter(|(n, g)| n != name && !is_open(&left, g)).map(|(n, _)| n.clone()).collect();
        if best.as_ref().is_none_or(|b| follow.len() > b.1.len()) {
            best = Some((name.clone(), follow));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows x + y and z of (x, y, z): the direction (1, −1, 0) is open, and known y fixes x.
    #[test]
    fn open_directions_are_found() {
        let j = DMatrix::from_row_slice(2, 3, &[1.0, 1.0, 0.0, 0.0, 0.0, 5.0]);
        let (open, scale) = null_space(j).unwrap();
        assert_eq!((open.ncols(), scale[2]), (1, 1.0));
        let along = |v: [f64; 3]| DVector::from_row_slice(&v);
        assert!(is_open(&open, &along([1.0, 0.0, 0.0])) && !is_open(&open, &along([1.0, 1.0, 3.0])));
        let gradients = [("x".to_owned(), along([1.0, 0.0, 0.0])), ("y".to_owned(), along([0.0, 1.0, 0.0]))];
        assert_eq!(wanted(&open, &gradients), Some(("x".to_owned(), vec!["y".to_owned()])));
    }
}
