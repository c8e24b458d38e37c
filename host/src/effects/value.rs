//! What is reported of an effect: its value and further parameters from strengths and shape, with
//! standard errors by the gradient, s² = gᵀ C g.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::entry::{Entry, Form};
use crate::model::model_file::parser::{Mistake, parse};
use crate::system::derivative::partial;
use crate::system::polynomial::{Atom, Polynomial};
use crate::system::words::{Scope, Scoped, Value as Word, Words};

/// A value with its standard error and what else is reported.
#[derive(Clone, Debug, PartialEq)]
pub struct Reported {
    /// Value.
    pub value: f64,
    /// Standard error.
    pub std_error: f64,
    /// Further parameters, shapes among them.
    pub parameters: BTreeMap<String, f64>,
    /// Standard errors of those that are no whole numbers and were fitted.
    pub std_errors: BTreeMap<String, f64>,
}

/// An expression over strengths, then shape parameters.
fn expression(entry: &Entry, text: &str) -> Result<Polynomial, Mistake> {
    let shapes = entry.shapes.iter().map(|s| s.name.clone());
    let words = Words { parameters: entry.strengths.iter().cloned().chain(shapes).collect(), ..Words::default() };
    match parse(text, &Scoped(&words, Scope::Parameters))? {
        Word::Scalar(p) => Ok(p),
        Word::Vector(_) => Ok(Polynomial::default()),
    }
}

/// An expression over strengths and shapes at values of both.
pub fn at(entry: &Entry, text: &str, strengths: &[f64], form: &Form) -> f64 {
    let values: Vec<f64> = strengths.iter().copied().chain(form.iter().map(|s| s.1)).collect();
    let of = |a: &Atom| if let Atom::Parameter(i) = a { values.get(*i).copied().unwrap_or(f64::NAN) } else { f64::NAN };
    expression(entry, text).map_or(f64::NAN, |p| p.value(&of))
}

/// Refuses a value that is no expression over strengths and shapes: the key and the mistake.
///
/// # Errors
/// The first one.
pub fn check(entry: &Entry) -> Result<(), (String, Mistake)> {
    if let Some(text) = &entry.value {
        expression(entry, text).map_err(|m| ("value".to_owned(), m))?;
    }
    for (_, text) in &entry.also {
        expression(entry, text).map_err(|m| ("also".to_owned(), m))?;
    }
    Ok(())
}

/// Value at strengths `k` with their covariance; `scale` is what a strength of one is in the unit
/// that is told (values that are shapes or angles between strengths do not have it). `moved`: shape
/// parameters that were refined, by name, with the variance of each.
pub fn report(
    entry: &Entry,
    form: &Form,
    k: &[f64],
    covariance: &DMatrix<f64>,
    scale: f64,
    moved: &BTreeMap<String, f64>,
) -> Reported {
    let d = k.len();
    let values: Vec<f64> = k.iter().map(|x| x * scale).chain(form.iter().map(|s| s.1)).collect();
    let at = |p: &Polynomial| {
        p.value(&|a| if let Atom::Parameter(i) = a { values.get(*i).copied().unwrap_or(f64::NAN) } else { f64::NAN })
    };
    let text = entry.value.clone().unwrap_or_else(|| entry.strengths[0].clone());
    let value = expression(entry, &text).unwrap_or_default();
    let error = |of: &Polynomial| {
        let slope = |i: usize| partial(of, &Atom::Parameter(i)).map_or(0.0, |g| at(&g));
        let gradient = DVector::from_fn(d, |i, _| slope(i) * scale);
        let mut variance = (gradient.transpose() * covariance * &gradient)[(0, 0)];
        for (i, (name, _)) in form.iter().enumerate() {
            variance += slope(d + i).powi(2) * moved.get(name).copied().unwrap_or(0.0);
        }
        variance.max(0.0).sqrt()
    };
    let mut parameters: BTreeMap<String, f64> =
        form.iter().filter(|s| entry.value.as_deref() != Some(&s.0)).cloned().collect();
    let mut std_errors: BTreeMap<String, f64> = moved
        .iter()
        .filter(|m| parameters.contains_key(m.0))
        .map(|(name, v)| (name.clone(), v.max(0.0).sqrt()))
        .collect();
    for (name, text) in &entry.also {
        let of = expression(entry, text);
        parameters.insert(name.clone(), of.as_ref().map_or(f64::NAN, at));
        std_errors.extend(of.ok().map(|of| (name.clone(), error(&of))));
    }
    Reported { value: at(&value), std_error: error(&value), parameters, std_errors }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::catalogue;

    #[test]
    fn amplitudes_and_phases_follow_from_strengths() {
        let e = catalogue().iter().find(|e| e.id == "cogging").unwrap();
        let covariance = DMatrix::from_diagonal(&DVector::from_vec(vec![0.01, 0.04]));
        let form = vec![("n".to_owned(), 7.0)];
        let r = report(e, &form, &[3.0, 4.0], &covariance, 2.0, &BTreeMap::new());
        assert!((r.value - 10.0).abs() < 1e-12);
        assert!((r.std_error - 2.0 * (0.36 * 0.01_f64 + 0.64 * 0.04).sqrt()).abs() < 1e-12, "{r:?}");
        assert!((r.parameters["psi"] - 4.0_f64.atan2(3.0)).abs() < 1e-12 && r.parameters["n"] == 7.0);
        // ∂ψ/∂(C, S) = (−S, C)/A².
        let expected = (0.16_f64.powi(2) * 0.01 + 0.12_f64.powi(2) * 0.04).sqrt();
        assert!((r.std_errors["psi"] - expected).abs() < 1e-9 && r.std_errors.len() == 1, "{r:?}");
    }

    #[test]
    fn a_shape_may_be_the_value() {
        let e = catalogue().iter().find(|e| e.id == "backlash").unwrap();
        let moved = BTreeMap::from([("b".to_owned(), 0.0004)]);
        let r = report(e, &vec![("b".to_owned(), 0.3)], &[5.0], &DMatrix::identity(1, 1), 0.1, &moved);
        assert!(
            (r.value - 0.3).abs() < 1e-15
                && (r.std_error - 0.02).abs() < 1e-12
                && (r.parameters["k"] - 0.5).abs() < 1e-12,
            "{r:?}"
        );
    }
}
