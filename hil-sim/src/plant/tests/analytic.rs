//! Closed solutions: one pendulum's period, two small oscillations, a linear pendulum with Coulomb
//! friction.

use core::f64::consts::{PI, TAU};

use super::*;

/// Arm 2 without a mass moment: arm 1 is a single pendulum with J_o1 and S1.
fn single() -> Parameters {
    Parameters { e2: 0.0, ..frictionless() }
}

/// Arithmetic–geometric mean: a pendulum's period is 2π/(ω0 agm(1, cos(θ0/2))).
fn agm(mut a: f64, mut b: f64) -> f64 {
    for _ in 0..30 {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    a
}

/// A free motion in steps as short as a rig's.
fn in_ticks(plant: &mut Plant, seconds: f64) {
    for _ in 0..2_500 {
        plant.advance(&BaseMotion::REST, seconds / 2_500.0).unwrap();
    }
}

#[test]
fn a_large_swing_has_the_period_of_the_elliptic_integral() {
    let parameters = single();
    for theta in [0.1f64, 1.5, 3.0] {
        let period = TAU / (parameters.s1() * parameters.g / parameters.j_o1).sqrt() / agm(1.0, (theta / 2.0).cos());
        let mut plant = plant(&parameters, &[], [theta, 0.0, 0.0, 0.0]);
        in_ticks(&mut plant, 3.0 * period);
        let state = plant.state();
        // At the turning point the rate is zero: its error is the error in time times the
        // acceleration.
        assert!((state[0] - theta).abs() < 1e-9, "{theta}: {state:?}");
        assert!(state[2].abs() < 2e-8, "{theta}: {state:?}");
    }
}

#[test]
fn small_oscillations_are_the_sum_of_two_modes() {
    let parameters = frictionless();
    let (j1, j2, h) = (parameters.j_o1, parameters.j_o2, parameters.h());
    let (k1, k2) = (parameters.s1() * parameters.g, parameters.s2() * parameters.g);
    // det(K − λM) = 0.
    let (a, b, c) = (j1 * j2 - h * h, -(j1 * k2 + j2 * k1), k1 * k2);
    let root = (b * b - 4.0 * a * c).sqrt();
    let lambdas = [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)];
    let size = 1e-6;
    for lambda in lambdas {
        let shape = [size, size * (k1 - lambda * j1) / (lambda * h)];
        let mut plant = plant(&parameters, &[], [shape[0], shape[1], 0.0, 0.0]);
        let t = 7.3;
        plant.advance(&BaseMotion::REST, t).unwrap();
        let cos = (lambda.sqrt() * t).cos();
        for i in 0..2 {
            assert!((plant.state()[i] - shape[i] * cos).abs() < 1e-9 + 1e-5 * shape[i].abs(), "{lambda}");
        }
    }
}

#[test]
fn coulomb_friction_takes_the_same_from_every_swing_and_then_holds() {
    // Linear: x'' + w² x = −w² d sign x', d = τ/(S1 g); every half period ends at |x| less by 2d,
    // and the arm stops for good once |x| <= d at a turning point.
    let parameters = Parameters { tau_c1: 0.0, ..single() };
    let stiffness = parameters.s1() * parameters.g;
    let (x0, d) = (1e-4, 1.15e-5);
    let parameters = Parameters { tau_c1: d * stiffness, ..parameters };
    let half = PI / (stiffness / parameters.j_o1).sqrt();
    let mut plant = plant(&parameters, &[], [x0, 0.0, 0.0, 0.0]);
    for n in 1..=4 {
        in_ticks(&mut plant, half);
        let expected = (x0 - 2.0 * d * f64::from(n)) * if n % 2 == 0 { 1.0 } else { -1.0 };
        assert!((plant.state()[0] - expected).abs() < 1e-11, "half swing {n}: {:?}", plant.state());
    }
    // 100 − 4·23 = 8 µrad is within d: it holds there, exactly.
    plant.advance(&BaseMotion::REST, half).unwrap();
    let held = plant.state();
    assert_eq!(plant.friction()[0], Some(Dry::Stick));
    assert!((held[0] - 8e-6).abs() < 1e-11, "{held:?}");
    plant.advance(&BaseMotion::REST, 10.0).unwrap();
    assert_eq!((plant.state()[0], plant.state()[2]), (held[0], 0.0));
}

#[test]
fn samples_are_right_to_1e_8_over_a_drive_period() {
    let mut drive = Drive::new(0.015_525);
    let mut plant = plant(&Parameters::PRINTED, &[], [0.3, 2.0, 0.0, 0.0]);
    let mut worst = 0.0f64;
    for _ in 0..20 {
        let mut fine = plant.clone();
        fine.tolerance = 1e-14;
        for _ in 0..100 {
            let motion = drive.next();
            plant.advance(&motion, TICK).unwrap();
            for part in 0..4 {
                fine.advance(&motion.later(0.25 * TICK * f64::from(part)), 0.25 * TICK).unwrap();
            }
            for i in 0..2 {
                worst = worst.max((plant.state()[i] - fine.state()[i]).abs());
            }
        }
    }
    assert!(worst < 1e-8, "{worst:e}");
}

#[test]
fn the_driven_motion_is_that_of_another_integrator() {
    // scipy.integrate.solve_ivp (SciPy 1.17, DOP853, rtol = atol = 1e-12) on the equations of
    // method section 1.2 with numpy.linalg.solve, without Coulomb friction, from (0.3, 2, 0, 0):
    // states every 0.2 s.
    let reference = [
        [0.09793146074746739, -1.9834603746968187, -6.738981076144318, -34.24682228663681],
        [-0.4181225237544358, -10.119909037109574, -1.8228612203595518, -34.24058047285996],
        [0.2576519864604138, -13.988486457939032, 3.7760453594244754, -0.16996562236845447],
        [0.13828884666227495, -10.431374623829274, -2.055867711927135, 27.387511543952115],
        [-0.21768228498569028, -2.9559326539929374, 1.9133252945892223, 34.72220300356502],
    ];
    let mut plant = plant(&Parameters { tau_c1: 0.0, ..Parameters::PRINTED }, &[], [0.3, 2.0, 0.0, 0.0]);
    let mut drive = Drive::new(0.015_525);
    for expected in reference {
        for _ in 0..100 {
            plant.advance(&drive.next(), TICK).unwrap();
        }
        for i in 0..4 {
            assert!((plant.state()[i] - expected[i]).abs() < 1e-7, "{:?} {expected:?}", plant.state());
        }
    }
}
