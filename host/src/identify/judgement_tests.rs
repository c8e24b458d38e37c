//! Signs and ties that no rig has, by their standard errors and covariance.

use std::path::Path;

use super::*;
use crate::identify::{Details, Parameter};

const TRUE: [(&str, f64); 11] = [
    ("B11", 0.113),
    ("B12", 0.0708),
    ("B13", -0.11),
    ("B14", 0.02),
    ("C11", 0.001),
    ("C12", 0.0033),
    ("B21", 1.68),
    ("B22", 0.263),
    ("B23", -0.110 * 0.263 / 0.0708),
    ("B24", 0.02 * 0.263 / 0.0708),
    ("C2", 0.0033 * 1.68 / 0.113),
];

/// An identification with these coefficients, each known to a thousandth, all independent.
pub(crate) fn identified(change: &[(&str, f64)]) -> Identification {
    let value = |n: &str, v: f64| change.iter().find(|c| c.0 == n).map_or(v, |c| c.1);
    Identification {
        parameters: TRUE
            .iter()
            .map(|(n, v)| Parameter {
                name: (*n).to_owned(),
                value: value(n, *v),
                std_error: 1e-3 * v.abs(),
                unit: "1".to_owned(),
            })
            .collect(),
        correlation: (0..TRUE.len()).map(|i| (0..TRUE.len()).map(|j| f64::from(u8::from(i == j))).collect()).collect(),
        correlation_names: TRUE.iter().map(|t| t.0.to_owned()).collect(),
        details: Details { jackknife_blocks: 29, ..Details::default() },
        ..Identification::default()
    }
}

fn ids(change: &[(&str, f64)]) -> Vec<&'static str> {
    let result = identified(change);
    let c = Coefficients::of(&result);
    let mut found = signs(&c);
    found.extend(ties(&c).filter(|t| t.chance < CHANCE).into_iter().flat_map(|t| t.warnings()));
    assert!(found.iter().all(|w| w.invalidates));
    found.iter().map(|w| w.id).collect()
}

#[test]
fn signs_that_no_rig_has_are_named() {
    assert!(ids(&[]).is_empty());
    assert_eq!(ids(&[("C11", -0.001)]), ["negative-damping"]);
    // Three standard errors are chance.
    assert!(ids(&[("C11", -3e-6)]).is_empty());
    assert_eq!(ids(&[("B11", -1.0002)])[0], "negative-inertia");
    assert!(ids(&[("B11", 0.9)]).contains(&"negative-inertia"));
    assert_eq!(ids(&[("B22", -0.263)])[0], "negative-gravity");
}

#[test]
fn frictions_of_a_system_from_bodies_brake() {
    let rig =
        Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/double-pendulum-from-bodies.toml")).unwrap();
    let mechanism = rig.bound.unwrap().model.mechanism.clone().unwrap();
    let names: Vec<String> = mechanism.coefficients.iter().map(|c| c.name.clone()).collect();
    let strengths = vec![1.0; mechanism.parameters.len()];
    let n = names.len();
    let of = |changed: &str, factor: f64| {
        let value = |n: &String| mechanism.value(n, &strengths).unwrap() * if n == changed { factor } else { 1.0 };
        let c = Coefficients {
            names: &names,
            values: DVector::from_iterator(n, names.iter().map(value)),
            covariance: DMatrix::identity(n, n) * 1e-2,
            blocks: 0,
        };
        dampings_of(&mechanism, &c).iter().map(|w| w.details["parameter"].clone()).collect::<Vec<_>>()
    };
    assert!(of("", 1.0).is_empty());
    let dampings: Vec<&String> = names.iter().filter(|n| n.contains("friction")).collect();
    assert_eq!(dampings.len(), 3, "{names:?}");
    for name in dampings {
        assert_eq!(of(name, -1.0), [serde_json::Value::from(name.clone())]);
        // A third of a standard error is chance, the wrong sign of gravity another matter.
        assert!(of(name, -0.03).is_empty());
    }
}

/// Frictions in the second joint act on both arms with one strength.
#[test]
fn ties_of_a_system_from_bodies_are_judged_whatever_is_known() {
    let rig =
        Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/double-pendulum-from-bodies.toml")).unwrap();
    let mechanism = rig.bound.unwrap().model.mechanism.clone().unwrap();
    let strengths = vec![1.0; mechanism.parameters.len()];
    let names: Vec<String> = mechanism.coefficients.iter().map(|c| c.name.clone()).collect();
    let n = names.len();
    let twice = names.iter().filter(|n| n.contains("friction_joint2")).count();
    assert_eq!(twice, 2, "{names:?}");
    let of = |factor: f64, blocks: usize| {
        let mut values = DVector::from_iterator(n, names.iter().map(|n| mechanism.value(n, &strengths).unwrap()));
        let changed = names.iter().position(|n| n.contains("friction_joint2")).unwrap();
        values[changed] *= factor;
        let covariance = DMatrix::from_diagonal(&values.map(|x| (1e-3 * x).powi(2).max(1e-12)));
        known_of_system::ties(&mechanism, &Coefficients { names: &names, values, covariance, blocks })
    };
    let right = of(1.0, 30).unwrap();
    assert!(right.chance > 0.01 && right.freedom > 0, "{} of {}", right.statistic, right.freedom);
    let wrong = of(1.05, 30).unwrap();
    assert!(wrong.chance < CHANCE && wrong.warnings()[0].id == "tie-violated", "{}", wrong.statistic);
    assert!(of(1.05, 2).is_none());
}

#[test]
fn ties_are_judged_by_their_covariance() {
    let shifted = |by: f64| ids(&[("B13", -0.11 * (1.0 + by))]);
    assert!(shifted(0.004).is_empty());
    assert_eq!(shifted(0.03), ["tie-violated"]);
    let opposed = identified(&[("C12", -0.0033)]);
    let found = ties(&Coefficients::of(&opposed)).unwrap();
    assert!(found.opposed.is_some() && found.warnings()[0].text.contains("brake one arm and drive the other"));
    // Too few blocks: nothing is said.
    let mut few = identified(&[("C12", -0.0033)]);
    few.details.jackknife_blocks = 0;
    assert!(ties(&Coefficients::of(&few)).is_none());
}

#[test]
fn a_misfit_names_what_failed() {
    let told = |error: f64, ratio: f64| {
        let mut result = identified(&[]);
        result.identification_error = vec![error];
        result.details.expected_error = vec![0.03];
        result.details.residual_over_noise = Some(ratio);
        misfit(&result).map(|w| w.text)
    };
    assert_eq!(told(0.024, 1.5), None);
    let by_rows = told(0.024, 2.5).unwrap();
    assert!(by_rows.contains("leave 2.50 times the power") && by_rows.contains("up to 2.0 would"), "{by_rows}");
    assert!(told(0.05, 2.5).unwrap().contains("the identification error is 5.0 %, where its sensors explain 3.0 %"));
    assert!(told(0.15, 1.5).unwrap().contains("the identification error is 15 %"));
}
