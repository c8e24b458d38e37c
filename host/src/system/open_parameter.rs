//! A system's parameters with one of those that stay open at another value, where its coefficients
//! are the same: m of a mass whose moment of inertia with another's is known alone.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::mechanism::Mechanism;
use super::ties::{self, Identified, TiesFit};

/// Share of a coefficient by which it may be off.
const ALIKE: f64 = 1e-6;
/// The same where parameters are no longer taken for those of the same coefficients.
const APART: f64 = 1e-4;

/// Factor by which a parameter moves in a step: what the coefficients leave of the others follows.
const STEP: f64 = 2.0;

/// Parameters that have the same coefficients of these names as `parameters`, with `name` at a value
/// and what is known as it is, by steps from where it is; none where there are none.
pub fn moved(
    mechanism: &Mechanism,
    coefficients: &[String],
    parameters: &[f64],
    known: &BTreeMap<String, f64>,
    (name, value): (&str, f64),
) -> Option<TiesFit> {
    let place = mechanism.parameters.iter().position(|p| p.name == name)?;
    let mut all = parameters.to_vec();
    all.resize(mechanism.parameters.len(), 0.0);
    let own = |n: &String| Some((n.clone(), mechanism.value(n, &all).filter(|b| *b != 0.0)?));
    let (names, values): (Vec<String>, Vec<f64>) = coefficients.iter().filter_map(own).unzip();
    let values = DVector::from_vec(values);
    let covariance = DMatrix::from_diagonal(&values.map(|b| (ALIKE * b).powi(2)));
    let b = Identified { names: &names, values: &values, covariance: &covariance, metric: &covariance };
    let known: BTreeMap<&str, f64> = known.iter().map(|(k, v)| (k.as_str(), *v)).collect();
    loop {
        let ratio = value / all[place];
        if !(ratio > 0.0 && ratio.is_finite()) {
            return None;
        }
        let next =
            if (1.0 / STEP..=STEP).contains(&ratio) { value } else { all[place] * STEP.powf(ratio.ln().signum()) };
        let with: BTreeMap<&str, f64> = known.iter().map(|(k, v)| (*k, *v)).chain([(name, next)]).collect();
        let fit = ties::fit_from(mechanism, &b, &with, &all)?;
        if fit.misfit > (APART / ALIKE).powi(2) {
            return None;
        }
        if next == value {
            return Some(fit);
        }
        all.clone_from(&fit.parameters);
    }
}
