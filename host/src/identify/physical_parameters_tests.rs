//! Physical parameters from exact coefficients, and what is left open.

use super::*;

const TRUTH: [f64; 14] =
    [5.99e-4, 4.033e-5, 1.73e-3, 0.0635, 0.04, 0.0267, 9.81, 0.0150, -0.004, 6e-4, 6.1e-5, 0.0, 0.0, 1.0];

fn setup() -> (Vec<String>, DVector<f64>, DMatrix<f64>, f64) {
    let omega = 31.4;
    let names: Vec<String> = ["B11", "B12", "B13", "B14", "C11", "C12", "B21", "B22", "B23", "B24", "C2"]
        .iter()
        .map(|s| (*s).to_owned())
        .collect();
    let values = DVector::from_iterator(names.len(), names.iter().map(|n| coefficient(n, &TRUTH, omega).unwrap()));
    let covariance = DMatrix::from_diagonal(&values.map(|v| (1e-3 * v).powi(2)));
    (names, values, covariance, omega)
}

fn identified<'a>(names: &'a [String], values: &'a DVector<f64>, covariance: &'a DMatrix<f64>) -> Identified<'a> {
    Identified { names, values, covariance, metric: covariance }
}

fn known(list: &[(&str, f64)]) -> BTreeMap<String, f64> {
    list.iter().map(|(k, v)| ((*k).to_owned(), *v)).collect()
}

#[test]
fn exact_coefficients_give_back_the_parameters() {
    let (names, values, covariance, omega) = setup();
    let k = known(&[("m2", 0.04), ("e2", 0.0267), ("l1", 0.0635), ("g", 9.81)]);
    let fit = fit(&identified(&names, &values, &covariance), &k, omega).unwrap();
    let get = |n: &str| fit.parameters.iter().find(|p| p.name == n).unwrap();
    for (name, truth) in [("J_o1", 5.99e-4), ("J_o2", 4.033e-5), ("m1e1", 1.73e-3), ("tau_c1", 6e-4), ("c_r2", 6.1e-5)]
    {
        assert!((get(name).value / truth - 1.0).abs() < 1e-6, "{name} {}", get(name).value);
    }
    assert!((get("a").value - 0.015f64.hypot(0.004)).abs() < 1e-8);
    assert!((get("psi").value - (-0.004f64).atan2(0.015)).abs() < 1e-6);
    assert!(fit.misfit < 1e-8 && fit.freedom == 4, "{} {}", fit.misfit, fit.freedom);
    // Ties make the physical parameters at least as precise as the coefficients.
    assert!(get("J_o1").std_error / 5.99e-4 <= 1.001e-3);
}

#[test]
fn what_is_not_fixed_is_said_to_be_open() {
    let (names, values, covariance, omega) = setup();
    let fit = fit(&identified(&names, &values, &covariance), &known(&[("m2", 0.04), ("g", 9.81)]), omega).unwrap();
    // l1 follows from B21/B22 alone; e2 only ever appears with the moments of inertia.
    let l1 = fit.parameters.iter().find(|p| p.name == "l1").unwrap();
    assert!((l1.value - 0.0635).abs() < 1e-6);
    assert!(fit.undetermined.contains(&"e2"), "{:?}", fit.undetermined);
}

#[test]
fn without_a_mass_there_is_no_scale() {
    let (names, values, covariance, omega) = setup();
    assert!(fit(&identified(&names, &values, &covariance), &known(&[("l1", 0.0635), ("g", 9.81)]), omega).is_none());
}
