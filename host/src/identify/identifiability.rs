//! Which coefficients a record does not tell apart.
//!
//! A set of coefficients is named where the correlation of two of them exceeds 0.9 in size (chains
//! of such pairs make one set) or where a standard error exceeds 20 % of the value. The two parts
//! of the base's amplitude, B_i3 and B_i4, are components of one vector whose direction depends on
//! where τ starts: their standard errors are compared with its length B_i5. So are the coefficients
//! of a function series: n and p, the drive's two parts, with the size of both together, q with its
//! own.

use nalgebra::{DMatrix, DVector};

/// Correlation from which two coefficients count as inseparable.
pub const CORRELATION: f64 = 0.9;
/// Relative standard error from which a coefficient counts as not determined.
pub const RELATIVE_ERROR: f64 = 0.2;

/// Correlation matrix of a covariance.
pub fn correlation(covariance: &DMatrix<f64>) -> Vec<Vec<f64>> {
    let n = covariance.nrows();
    let at = |i: usize, j: usize| {
        let d = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
        if d > 0.0 { covariance[(i, j)] / d } else { f64::from(u8::from(i == j)) }
    };
    (0..n).map(|i| (0..n).map(|j| at(i, j)).collect()).collect()
}

/// The sets, each in the coefficients' order.
pub fn groups_not_separable(names: &[String], values: &DVector<f64>, covariance: &DMatrix<f64>) -> Vec<Vec<String>> {
    let n = names.len();
    let mut set: Vec<usize> = (0..n).collect();
    let deviation = |i: usize| covariance[(i, i)].max(0.0).sqrt();
    for i in 0..n {
        for j in 0..i {
            let scale = deviation(i) * deviation(j);
            if scale > 0.0 && covariance[(i, j)].abs() > CORRELATION * scale {
                let (from, to) = (set[i].max(set[j]), set[i].min(set[j]));
                set.iter_mut().filter(|s| **s == from).for_each(|s| *s = to);
            }
        }
    }
    (0..n)
        .filter_map(|first| {
            let members: Vec<usize> = (0..n).filter(|&i| set[i] == first).collect();
            let undetermined =
                members.iter().any(|&i| deviation(i) > RELATIVE_ERROR * size(names, values.as_slice(), i));
            (members.len() > 1 || (!members.is_empty() && undetermined))
                .then(|| members.into_iter().map(|i| names[i].clone()).collect())
        })
        .collect()
}

/// What a coefficient's standard error is compared with.
pub fn size(names: &[String], values: &[f64], i: usize) -> f64 {
    let name = &names[i];
    let series = |name: &str| ["n_", "p_", "q_"].iter().position(|s| name.starts_with(s)).map(|f| f / 2);
    if let Some(of) = series(name) {
        let own = names.iter().zip(values).filter(|(other, _)| series(other) == Some(of));
        return own.map(|(_, v)| v.powi(2)).sum::<f64>().sqrt();
    }
    let partner = match name.chars().last() {
        Some('3') if name.starts_with('B') => format!("{}4", &name[..2]),
        Some('4') if name.starts_with('B') => format!("{}3", &name[..2]),
        _ => return values[i].abs(),
    };
    names.iter().position(|x| *x == partner).map_or(values[i].abs(), |k| values[i].hypot(values[k]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlated_pairs_and_weak_values_are_named() {
        let names: Vec<String> = ["B13", "B14", "B12", "C11", "C12"].iter().map(|s| (*s).to_owned()).collect();
        let values = DVector::from_vec(vec![1.0, 0.0, 1.0, 0.01, 0.5]);
        let mut c = DMatrix::from_diagonal(&DVector::from_vec(vec![1e-4, 1e-4, 1e-4, 1e-4, 1e-4]));
        c[(0, 2)] = 0.95e-4;
        c[(2, 0)] = 0.95e-4;
        let groups = groups_not_separable(&names, &values, &c);
        // B14 = 0 is not weak: its vector is long.
        assert_eq!(groups, vec![vec!["B13".to_owned(), "B12".to_owned()], vec!["C11".to_owned()]]);
    }
}
