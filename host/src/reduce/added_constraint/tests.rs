//! Models of a known form come back; ones that run away are none.

use super::super::release_fit;
use super::*;

/// Orbits of ÿ = −y − 0.2 y³ with z = 0.3 y³ + 0.1 y ẏ², by the model's own integration.
fn records(amplitudes: &[f64], step: f64) -> Vec<[Vec<f64>; 2]> {
    let truth = ConstraintModel {
        constraint: vec![],
        equation: vec![
            Term { of: Function::power(1), value: -1.0, std_error: 0.0 },
            Term { of: Function::power(3), value: -0.2, std_error: 0.0 },
        ],
        time_unit: 1.0,
        modes: vec![vec![1.0, 0.0], vec![0.0, 1.0]],
    };
    amplitudes
        .iter()
        .map(|a| {
            let s = truth.simulate(*a, step, 900);
            [
                s.iter().map(|s| s[0]).collect(),
                s.iter().map(|s| 0.3 * s[0].powi(3) + 0.1 * s[0] * s[1] * s[1]).collect(),
            ]
        })
        .collect()
}

#[test]
fn a_model_of_the_right_form_comes_back_and_terms_odd_in_velocity_go() {
    let modes = vec![vec![1.0, 0.0], vec![0.0, 1.0]];
    let fits: Vec<ReleaseFit> = records(&[0.3, 0.8, 1.3], 0.05)
        .iter()
        .map(|r| release_fit::fit(&[&r[0], &r[1]], 0.05, &modes[0]).unwrap())
        .collect();
    let refs: Vec<&ReleaseFit> = fits.iter().collect();
    let (orbits, unit) = orbits(&refs, &modes, true);
    let model = fit(&orbits, &modes, unit, &seed_constraint(), &type1_equation()).unwrap();
    let c = &model.constraint[0];
    assert!((c[2].value - 0.3).abs() < 1e-4 && (c[5].value / (unit * unit) - 0.1).abs() < 1e-3, "{c:?}");
    assert!((model.equation[1].value * unit * unit + 0.2).abs() < 1e-4, "{:?}", model.equation);
    let at = model.behaviour(0.8).unwrap();
    assert!((at.omega / fits[1].omega - 1.0).abs() < 1e-4 && at.drift < 1e-5, "{at:?}");
    // A damping term among the candidates is thrown out.
    let mut candidates = type1_equation();
    candidates.push(Function::Monomial { y: 0, velocity: 1, z: 0 });
    let (chosen, s) = select(&orbits, &modes, unit, &[Function::power(3)], &candidates).unwrap();
    assert!(s < 0.02 && chosen.equation.len() <= 3, "{s} {chosen:?}");
}

#[test]
fn a_model_that_runs_away_is_no_model() {
    let model = ConstraintModel {
        constraint: vec![],
        equation: vec![Term { of: Function::power(1), value: 1.0, std_error: 0.0 }],
        time_unit: 1.0,
        modes: vec![vec![1.0]],
    };
    assert!(model.behaviour(1.0).is_none());
    assert!(model.simulate(1.0, 1.0, 100).len() < 10);
}
