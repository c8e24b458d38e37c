//! Least squares (2.17), (3.21), (3.22) and the optimisation of the set of sub-harmonics (section
//! 3.4.5).
//!
//! With e = A λ − q and q̂ = A λ, the identification error is ε = ‖e‖∞/‖q̂‖∞. A round of the
//! optimisation drops the rows with
//! |e| > (1 − β) e_max and solves again, until ε is below its bound.
//!
//! Dropping what fits badly makes any fit look good. So the whole optimisation is repeated with a
//! fifth of the orbits left out, and what it gives is judged on all rows of these, none dropped
//! ([`HeldOut`]).

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::Serialize;

use super::rows::{RowId, Rows};
use super::settings::Optimisation;

/// One round of the optimisation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Round {
    /// ε with the rows of this round.
    pub error: f64,
    /// Rows used.
    pub rows: usize,
    /// Rows dropped after it.
    pub dropped: Vec<RowId>,
}

/// What the optimisation did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trail {
    /// Rounds.
    pub rounds: Vec<Round>,
    /// Whether ε came below the bound.
    pub reached: bool,
}

/// How well left-out orbits are predicted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HeldOut {
    /// Orbits were left out in so many groups, one after the other.
    pub groups: usize,
    /// ε and ‖e‖₂/‖q‖₂ on rows left out, from all other rows.
    pub plain: [f64; 2],
    /// The same from the rows that the optimisation kept.
    pub optimised: [f64; 2],
}

/// Solution of one equation.
#[derive(Clone, Debug)]
pub struct EquationFit {
    /// Coefficients.
    pub coefficients: DVector<f64>,
    /// Inverse of the normal matrix.
    pub inverse: DMatrix<f64>,
    /// Condition number of the matrix, columns scaled.
    pub condition: f64,
    /// Rows kept.
    pub kept: Vec<bool>,
    /// ε over the rows kept.
    pub error: f64,
    /// Trail of the optimisation; empty without one.
    pub trail: Trail,
}

/// Normal matrix of the rows that `use_row` accepts.
fn solve(rows: &Rows, use_row: impl Fn(usize) -> bool) -> Result<(DVector<f64>, DMatrix<f64>, f64), usize> {
    let p = rows.columns;
    let mut matrix = DMatrix::<f64>::zeros(p, p);
    let mut right = DVector::<f64>::zeros(p);
    for r in (0..rows.len()).filter(|r| use_row(*r)) {
        let row = rows.row(r);
        for i in 0..p {
            for j in 0..=i {
                matrix[(i, j)] += row[i] * row[j];
            }
            right[i] += row[i] * row[p];
        }
    }
    matrix.fill_upper_triangle_with_lower_triangle();
    let scale: Vec<f64> =
        (0..p).map(|i| if matrix[(i, i)] > 0.0 { 1.0 / matrix[(i, i)].sqrt() } else { 0.0 }).collect();
    if let Some(i) = scale.iter().position(|s| *s == 0.0 || !s.is_finite()) {
        return Err(i);
    }
    if p == 0 {
        return Ok((right, matrix, 1.0));
    }
    let eigen = SymmetricEigen::new(DMatrix::from_fn(p, p, |i, j| matrix[(i, j)] * scale[i] * scale[j]));
    let (least, greatest) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
    if least.is_nan() || least <= 1e-13 * greatest {
        return Err(eigen.eigenvectors.column(eigen.eigenvalues.imin()).iamax());
    }
    let inverse = &eigen.eigenvectors
        * DMatrix::from_diagonal(&eigen.eigenvalues.map(|x| 1.0 / x))
        * eigen.eigenvectors.transpose();
    let inverse = DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    Ok((&inverse * right, inverse, (greatest / least).sqrt()))
}

/// Prediction q̂ and residual e = q̂ − q of a row.
pub fn residual(row: &[f64], coefficients: &DVector<f64>) -> (f64, f64) {
    let p = coefficients.len();
    let predicted: f64 = row[..p].iter().zip(coefficients.iter()).map(|(a, b)| a * b).sum();
    (predicted, predicted - row[p])
}

/// ‖e‖∞ and ‖q̂‖∞ over the rows that `use_row` accepts.
fn extremes(rows: &Rows, coefficients: &DVector<f64>, use_row: impl Fn(usize) -> bool) -> (f64, f64) {
    (0..rows.len()).filter(|r| use_row(*r)).fold((0.0, 0.0), |(e, q): (f64, f64), r| {
        let (predicted, residual) = residual(rows.row(r), coefficients);
        (e.max(residual.abs()), q.max(predicted.abs()))
    })
}

/// Solves one equation, with the optimisation if asked; `allowed`: rows that may be used at all.
///
/// # Errors
/// The column that vanishes or depends on the others.
pub fn fit(
    rows: &Rows,
    optimisation: Option<&Optimisation>,
    allowed: &dyn Fn(usize) -> bool,
) -> Result<EquationFit, usize> {
    let mut kept: Vec<bool> = (0..rows.len()).map(allowed).collect();
    let mut trail = Trail { rounds: Vec::new(), reached: false };
    loop {
        let (coefficients, inverse, condition) = solve(rows, |r| kept[r])?;
        let (worst, largest) = extremes(rows, &coefficients, |r| kept[r]);
        let error = if largest > 0.0 { worst / largest } else { f64::INFINITY };
        let used = kept.iter().filter(|k| **k).count();
        let done = |trail, kept| EquationFit {
            coefficients: coefficients.clone(),
            inverse: inverse.clone(),
            condition,
            kept,
            error,
            trail,
        };
        let Some(o) = optimisation else {
            return Ok(done(trail, kept));
        };
        let mut round = Round { error, rows: used, dropped: Vec::new() };
        trail.reached = error < o.bound;
        // Twice as many rows as unknowns must stay.
        if trail.reached || trail.rounds.len() + 1 >= o.rounds || used <= 2 * rows.columns + 1 {
            trail.rounds.push(round);
            return Ok(done(trail, kept));
        }
        let before = kept.clone();
        for r in 0..rows.len() {
            if kept[r] && residual(rows.row(r), &coefficients).1.abs() > (1.0 - o.beta) * worst {
                kept[r] = false;
                round.dropped.push(rows.ids[r]);
            }
        }
        if solve(rows, |r| kept[r]).is_err() {
            // Without these rows nothing can be solved: they stay.
            round.dropped.clear();
            trail.rounds.push(round);
            return Ok(done(trail, before));
        }
        trail.rounds.push(round);
    }
}

/// Coefficients from the kept rows of all orbits but one.
pub fn without(rows: &Rows, kept: &[bool], group: &dyn Fn(usize) -> usize, left_out: usize) -> Option<DVector<f64>> {
    solve(rows, |r| kept[r] && group(rows.ids[r].orbit) != left_out).ok().map(|s| s.0)
}

/// Judges plain and optimised fits on orbits left out; `None` with fewer than four orbits.
pub fn held_out(rows: &Rows, orbits: usize, optimisation: &Optimisation) -> Option<HeldOut> {
    if orbits < 4 {
        return None;
    }
    let groups = orbits.min(5);
    let judge = |optimisation: Option<&Optimisation>| -> Option<[f64; 2]> {
        let (mut worst, mut largest, mut square, mut power) = (0.0_f64, 0.0_f64, 0.0, 0.0);
        for g in 0..groups {
            let inside = |r: usize| rows.ids[r].orbit % groups == g;
            let found = fit(rows, optimisation, &|r| !inside(r)).ok()?;
            for r in (0..rows.len()).filter(|r| inside(*r)) {
                let (predicted, e) = residual(rows.row(r), &found.coefficients);
                worst = worst.max(e.abs());
                largest = largest.max(predicted.abs());
                square += e * e;
                power += rows.row(r)[rows.columns].powi(2);
            }
        }
        (largest > 0.0 && power > 0.0).then(|| [worst / largest, (square / power).sqrt()])
    };
    Some(HeldOut { groups, plain: judge(None)?, optimised: judge(Some(optimisation))? })
}

#[cfg(test)]
mod tests {
    use super::super::rows::Part;
    use super::*;

    /// Rows with a known solution; three of them spoilt.
    fn rows() -> Rows {
        let mut rows = Rows { columns: 2, ..Rows::default() };
        for r in 0..60_usize {
            let a = [(r as f64).sin(), (1.7 * r as f64).cos()];
            let spoilt = if [7, 22, 41].contains(&r) { 0.8 + 0.02 * r as f64 } else { 0.0 };
            rows.ids.push(RowId { orbit: r / 10, subharmonic: r % 10, periods: 10, part: Part::Cos });
            rows.values.extend([a[0], a[1], 2.0 * a[0] - 0.5 * a[1] + spoilt]);
        }
        rows
    }

    #[test]
    fn the_optimisation_drops_what_is_spoilt_and_says_so() {
        let rows = rows();
        let plain = fit(&rows, None, &|_| true).unwrap();
        assert!(plain.error > 0.3 && plain.trail.rounds.is_empty());
        let fit = fit(&rows, Some(&Optimisation::default()), &|_| true).unwrap();
        assert!(fit.trail.reached && fit.error < 1e-9);
        assert!((fit.coefficients[0] - 2.0).abs() < 1e-12 && (fit.coefficients[1] + 0.5).abs() < 1e-12);
        let mut dropped: Vec<usize> =
            fit.trail.rounds.iter().flat_map(|r| &r.dropped).map(|d| 10 * d.orbit + d.subharmonic).collect();
        dropped.sort_unstable();
        assert_eq!(dropped, [7, 22, 41]);
        assert!(fit.trail.rounds.windows(2).all(|w| w[1].rows + w[0].dropped.len() == w[0].rows));
    }

    #[test]
    fn left_out_orbits_are_not_flattered() {
        let rows = rows();
        let held = held_out(&rows, 6, &Optimisation::default()).unwrap();
        // The spoilt rows are still judged.
        assert!(held.optimised[0] > 0.3 && held.groups == 5, "{held:?}");
        assert!(held_out(&rows, 3, &Optimisation::default()).is_none());
    }

    #[test]
    fn a_bound_out_of_reach_is_told() {
        let mut rows = rows();
        rows.values.iter_mut().skip(2).step_by(3).enumerate().for_each(|(r, q)| *q = (r % 5) as f64);
        let fit = fit(&rows, Some(&Optimisation::default()), &|_| true).unwrap();
        assert!(!fit.trail.reached && fit.kept.iter().filter(|k| **k).count() >= 3);
    }

    #[test]
    fn a_column_of_zeros_is_named() {
        let mut rows = rows();
        rows.values.iter_mut().skip(1).step_by(3).for_each(|x| *x = 0.0);
        assert_eq!(fit(&rows, None, &|_| true).unwrap_err(), 1);
    }
}
