//! Parameters of systems from bodies from exact coefficients, and what is left open.

use super::*;
use crate::system::library;
use crate::system::mechanism::at;

pub(crate) const TRUTH: [(&str, f64); 12] = [
    ("m1", 0.1362),
    ("e1", 0.0127),
    ("J_1", 5.0e-4),
    ("l1", 0.0635),
    ("m2", 0.04),
    ("e2", 0.0267),
    ("J_2", 4.033e-5),
    ("a_c", 0.0155),
    ("a_s", -0.004),
    ("g", 9.81),
    ("coulomb-friction@joint1", 6e-4),
    ("viscous-friction@joint2", 6.1e-5),
];

/// Exact coefficients of a double pendulum, each with a thousandth of it as standard error.
fn exact(known: &[&str]) -> TiesFit {
    exact_of(known, |values| DMatrix::from_diagonal(&values.map(|v| (1e-3 * v).powi(2))))
}

fn exact_of(known: &[&str], covariance: impl Fn(&DVector<f64>) -> DMatrix<f64>) -> TiesFit {
    let text = library::text("double-pendulum").unwrap();
    let model = library::read("double-pendulum", text).unwrap().model(None, 31.4).unwrap();
    let mechanism = model.mechanism.clone().unwrap();
    let of = |n: &str| TRUTH.iter().find(|t| t.0 == n).map(|t| t.1);
    let truth: Vec<f64> = mechanism.parameters.iter().map(|p| of(&p.name).unwrap()).collect();
    let names: Vec<String> = mechanism.coefficients.iter().map(|c| c.name.clone()).collect();
    let values = DVector::from_iterator(names.len(), names.iter().map(|n| mechanism.value(n, &truth).unwrap()));
    let covariance = covariance(&values);
    let known = known
        .iter()
        .map(|n| {
            let quantity = mechanism.quantities.iter().find(|q| q.name == *n).map(|q| at(&q.value, &truth));
            (*n, of(n).or(quantity).unwrap())
        })
        .collect();
    let b = Identified { names: &names, values: &values, covariance: &covariance, metric: &covariance };
    fit(&mechanism, &b, &known).unwrap()
}

#[test]
fn exact_coefficients_give_back_the_parameters() {
    let fit = exact(&["m2", "e2", "l1", "g"]);
    let get = |n: &str| fit.found.iter().find(|p| p.name == n).unwrap_or_else(|| panic!("{n}: {fit:?}"));
    for (name, truth) in [
        ("J_o1", 5.0e-4 + 0.04 * 0.0635 * 0.0635),
        ("J_o2", 4.033e-5),
        ("J_2", 4.033e-5),
        ("m1e1", 0.1362 * 0.0127),
        ("coulomb-friction@joint1", 6e-4),
        ("viscous-friction@joint2", 6.1e-5),
        ("a", 0.0155_f64.hypot(0.004)),
        ("psi", (-0.004_f64).atan2(0.0155)),
    ] {
        assert!((get(name).value / truth - 1.0).abs() < 1e-6, "{name} {}", get(name).value);
    }
    // As the built-in fit: eleven coefficients, seven unknowns.
    assert!(fit.misfit < 1e-8 && fit.freedom == 4, "{} {}", fit.misfit, fit.freedom);
    assert!(get("J_o1").std_error / get("J_o1").value <= 1.001e-3);
    assert_eq!(fit.undetermined, ["m1", "e1"]);
    assert_eq!(get("J_o1").unit, "kg m²");
}

/// What was tied before has fewer directions than coefficients; rounding decides whether their
/// covariance is positive.
#[test]
fn a_singular_covariance_gives_back_the_parameters() {
    let fit = exact_of(&["m2", "e2", "l1", "g"], |values| {
        let mut out = DMatrix::from_diagonal(&values.map(|v| (1e-3 * v).powi(2)));
        let both = 1e-6 * (values[0] * values[1]).abs() * (1.0 + 1e-12);
        (out[(0, 1)], out[(1, 0)]) = (both, both);
        assert!(out.clone().cholesky().is_none());
        out
    });
    let found = fit.found.iter().find(|p| p.name == "J_2").unwrap();
    assert!((found.value / 4.033e-5 - 1.0).abs() < 1e-6, "{found:?}");
}

/// Lengths follow from gravity; masses need one that is known, a quantity is as good as a
/// parameter.
#[test]
fn what_is_not_fixed_is_said_to_be_open() {
    let fit = exact(&["g"]);
    assert!((fit.found.iter().find(|p| p.name == "l1").unwrap().value - 0.0635).abs() < 1e-6, "{fit:?}");
    assert!(fit.undetermined.iter().any(|n| n == "J_o2") && fit.undetermined.iter().any(|n| n == "m2"), "{fit:?}");
    let (name, follow) = fit.wanted.clone().unwrap();
    assert!(follow.len() >= 4, "{name} {follow:?}");
    let with = exact(&["g", "J_o2"]);
    let damping = with.found.iter().find(|p| p.name == "viscous-friction@joint2").unwrap();
    assert!((damping.value / 6.1e-5 - 1.0).abs() < 1e-5, "{with:?}");
}
