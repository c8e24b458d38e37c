//! Every effect's torque against the product's table, written a second time here, and solved by
//! Cramer's rule.

use core::f64::consts::PI;

use super::*;
use crate::shaker::Moment;

const STATES: [State; 4] =
    [[0.4, 2.1, 3.0, -11.0], [-2.8, 0.3, -1.5, -0.4], [7.0, -12.5, 0.2, 19.0], [1.0, 0.9, -6.0, -5.0]];

/// Accelerations of a plant at a state, by the derivative of a short motion.
fn accelerations(parameters: &Parameters, effects: &[&str], y: &State, base: [f64; 2]) -> [f64; 2] {
    let effects: Vec<Effect> = effects.iter().map(|text| Effect::parse(text).unwrap()).collect();
    let mechanics = Mechanics::new(parameters, &combine(&effects).unwrap());
    mechanics.forces(base, y, &Mode::at(&mechanics, y)).alpha
}

/// M α for the change of acceleration that an effect makes.
fn torque(effects: &[&str], y: &State) -> [f64; 2] {
    let p = Parameters::PRINTED;
    let (with, without) = (accelerations(&p, effects, y, [0.0; 2]), accelerations(&p, &[], y, [0.0; 2]));
    let (d1, d2) = (with[0] - without[0], with[1] - without[1]);
    let coupling = p.h() * (y[1] - y[0]).cos();
    [p.j_o1 * d1 + coupling * d2, coupling * d1 + p.j_o2 * d2]
}

#[test]
fn joint_torques_are_those_of_the_table_and_act_on_both_arms() {
    type Law = fn(f64, f64) -> f64;
    let laws: [(&str, &str, Law); 15] = [
        ("viscous-friction", "3e-5", |_, v| -3e-5 * v),
        ("coulomb-friction", "2e-4", |_, v| -2e-4 * v.signum()),
        ("stribeck-friction", "1e-3,v_s=2", |_, v| -1e-3 * (-(v / 2.0) * (v / 2.0)).exp() * v.signum()),
        ("asymmetric-friction", "3e-4", |_, v| if v > 0.0 { -3e-4 } else { 0.0 }),
        ("amplitude-dependent-damping", "1e-5", |x, v| -1e-5 * x * x * v),
        ("torsion-spring", "2e-3", |x, _| -2e-3 * x),
        ("quadratic-stiffness", "2e-3", |x, _| -2e-3 * x * x),
        ("cubic-stiffness", "-2e-3", |x, _| 2e-3 * x * x * x),
        ("quintic-stiffness", "2e-3", |x, _| -2e-3 * x.powi(5)),
        ("cogging", "1e-3,n=7,psi=0.4", |x, _| -1e-3 * (7.0 * x + 0.4).sin()),
        ("backlash", "0.5,k=2e-3", |x, _| -2e-3 * (x.abs() - 0.5).max(0.0) * x.signum()),
        ("constant-force", "-4e-4", |_, _| -4e-4),
        ("power-law-damping", "3e-5,p=1.4", |_, v| -3e-5 * v.abs().powf(1.4) * v.signum()),
        ("local-force", "2e-3,x0=-2.9,d=0.5", |x, _| {
            let u = if x > 0.24 { x + 2.9 - 2.0 * PI } else { x + 2.9 };
            -2e-3 * u * (-(u / 0.5) * (u / 0.5)).exp()
        }),
        ("constant-force", "1e-4", |_, _| 1e-4),
    ];
    let wrap = |x: f64| x - 2.0 * PI * ((x + PI) / (2.0 * PI)).floor();
    for y in STATES {
        for (id, value, law) in laws {
            let t1 = law(wrap(y[0]), y[2]);
            let got = torque(&[&format!("{id}@joint1={value}")], &y);
            assert!((got[0] - t1).abs() + got[1].abs() < 1e-12, "{id}@joint1 at {y:?}: {got:?}, {t1}");
            let t2 = law(wrap(y[1] - y[0]), y[3] - y[2]);
            let got = torque(&[&format!("{id}@joint2={value}")], &y);
            assert!((got[0] + t2).abs() + (got[1] - t2).abs() < 1e-12, "{id}@joint2 at {y:?}: {got:?}, {t2}");
        }
        for (arm, i) in [("arm1", 0), ("arm2", 1)] {
            let got = torque(&[&format!("quadratic-drag@{arm}=2e-6")], &y);
            let w = y[2 + i];
            assert!((got[i] + 2e-6 * w * w.abs()).abs() + got[1 - i].abs() < 1e-12, "drag of {arm}: {got:?}");
        }
    }
}

/// On top of a level that it takes from, and refused where it would make friction push.
#[test]
fn a_ripple_of_friction_is_that_of_the_table() {
    for y in STATES {
        let (x, v) = (y[1] - y[0], y[3] - y[2]);
        let with = torque(&["coulomb-friction@joint2=2e-4", "friction-ripple@joint2=1e-4,n=3,psi=0.4"], &y);
        let wanted = -(2e-4 + 1e-4 * (3.0 * x + 0.4).sin()) * v.signum();
        assert!((with[0] + wanted).abs() + (with[1] - wanted).abs() < 1e-12, "{y:?}: {with:?}, {wanted}");
    }
    let effects = [Effect::parse("friction-ripple@joint2=1e-4").unwrap()];
    let refused = Mechanics::new(&Parameters::PRINTED, &combine(&effects).unwrap()).validate();
    assert!(refused.is_err_and(|e| e.to_string().contains("dry friction in joint 2")));
}

/// M α for the change of acceleration that an effect makes on a base that moves.
fn torque_at(effect: &str, y: &State, moment: Moment) -> [f64; 2] {
    let p = Parameters::PRINTED;
    let alpha = |effects: &[&str]| {
        let effects: Vec<Effect> = effects.iter().map(|text| Effect::parse(text).unwrap()).collect();
        let mechanics = Mechanics::new(&p, &combine(&effects).unwrap());
        mechanics.forces(moment, y, &Mode::at(&mechanics, y)).alpha
    };
    let (with, without) = (alpha(&[effect]), alpha(&[]));
    let (d1, d2) = (with[0] - without[0], with[1] - without[1]);
    let coupling = p.h() * (y[1] - y[0]).cos();
    [p.j_o1 * d1 + coupling * d2, coupling * d1 + p.j_o2 * d2]
}

/// Against the sum over many short pieces of the arm, each with its own point and velocity.
#[test]
fn drag_along_an_arm_is_the_sum_over_its_pieces() {
    const PIECES: i32 = 20_000;
    let l1 = Parameters::PRINTED.l1;
    let moment = Moment { velocity: [0.3, -0.8], ..Moment::default() };
    for y in STATES {
        for (arm, k, length) in [(0, 2e-2, 0.08), (1, 3e-2, 0.05)] {
            let mut wanted = [0.0; 2];
            let (t1, t2) = ([y[0].cos(), y[0].sin()], [y[1].cos(), y[1].sin()]);
            let across = if arm == 0 { t1 } else { t2 };
            for i in 0..PIECES {
                let s = length * (f64::from(i) + 0.5) / f64::from(PIECES);
                // Point and its derivatives by both angles.
                let by = if arm == 0 {
                    [[s * t1[0], s * t1[1]], [0.0; 2]]
                } else {
                    [[l1 * t1[0], l1 * t1[1]], [s * t2[0], s * t2[1]]]
                };
                let velocity = [0, 1].map(|c: usize| moment.velocity[c] + by[0][c] * y[2] + by[1][c] * y[3]);
                let v = velocity[0] * across[0] + velocity[1] * across[1];
                let force = -k * v * v.abs() * length / f64::from(PIECES);
                for (w, d) in wanted.iter_mut().zip(by) {
                    *w += force * (d[0] * across[0] + d[1] * across[1]);
                }
            }
            let got = torque_at(&format!("distributed-drag@arm{}={k},length={length}", arm + 1), &y, moment);
            let size = wanted[0].abs() + wanted[1].abs();
            assert!(
                (got[0] - wanted[0]).abs() + (got[1] - wanted[1]).abs() < 1e-6 * size,
                "{arm} {y:?}: {got:?} {wanted:?}"
            );
        }
    }
}

#[test]
fn drift_modulation_and_tones_follow_the_record_the_phase_and_the_time() {
    let y = STATES[0];
    let moment = Moment { phase: 0.7, share: 0.25, ..Moment::default() };
    let got = torque_at("friction-drift@joint2=4e-4", &y, moment);
    let wanted = 1e-4;
    // The joint turns backward in this state.
    assert!((got[0] + wanted).abs() + (got[1] - wanted).abs() < 1e-12, "{got:?}");
    let got = torque_at("stiffness-modulation@joint1=2e-3,psi=0.3", &y, moment);
    assert!((got[0] + 2e-3 * f64::cos(0.4) * y[0]).abs() + got[1].abs() < 1e-12, "{got:?}");
    let moment = Moment { time: 12.3, ..moment };
    let wanted = -2e-3 * f64::cos(2.0 * PI * 1.7 * 12.3 - 0.6);
    let got = torque_at("tone@joint1=2e-3,f=1.7,psi=0.6", &y, moment);
    assert!((got[0] - wanted).abs() + got[1].abs() < 1e-12, "{got:?} {wanted}");
    let got = torque_at("tone@joint2=2e-3,f=1.7,psi=0.6", &y, moment);
    assert!((got[0] + wanted).abs() + (got[1] - wanted).abs() < 1e-12, "{got:?} {wanted}");
    let pushes = combine(&[Effect::parse("friction-drift@joint2=-1e-5").unwrap()]).unwrap();
    assert!(Plant::new(&Parameters::PRINTED, &pushes, [0.0; 4], TOLERANCE).is_err());
}

#[test]
fn tilt_turns_gravity_and_not_the_drive() {
    let p = frictionless();
    let beta = 0.1;
    let effect = ["frame-tilt@frame=0.1"];
    // Hangs at rest where gravity points.
    let hanging = accelerations(&p, &effect, &[beta, beta, 0.0, 0.0], [0.0; 2]);
    assert!(hanging[0].abs() + hanging[1].abs() < 1e-12);
    // The base's acceleration acts as it does without tilt.
    for y in STATES {
        let drive = |effects: &[&str]| {
            let (moved, still) =
                (accelerations(&p, effects, &y, [3.0, -7.0]), accelerations(&p, effects, &y, [0.0; 2]));
            [moved[0] - still[0], moved[1] - still[1]]
        };
        let (tilted, plain) = (drive(&effect), drive(&[]));
        assert!((tilted[0] - plain[0]).abs() + (tilted[1] - plain[1]).abs() < 1e-9);
    }
}

#[test]
fn imbalance_moves_the_centroid_and_leaves_the_arms_line() {
    let p = frictionless();
    // Arm 1: only m1 e1 is turned. Arms at (0.3, 0.3): static torques of both centroids.
    let y = [0.3, 0.3, 0.0, 0.0];
    let got = torque(&["imbalance@arm1=0.2"], &y);
    let expected = -p.m1 * p.e1 * p.g * (f64::sin(0.5) - f64::sin(0.3));
    assert!((got[0] - expected).abs() + got[1].abs() < 1e-12);
    // Arm 2: as if its angle were greater by beta, everywhere.
    for y in STATES {
        let with = accelerations(&p, &["imbalance@arm2=0.2"], &y, [1.0, 2.0]);
        let turned = accelerations(&p, &[], &[y[0], y[1] + 0.2, y[2], y[3]], [1.0, 2.0]);
        assert!((with[0] - turned[0]).abs() + (with[1] - turned[1]).abs() < 1e-9);
    }
}

#[test]
fn the_load_is_the_force_that_moves_the_arms_below() {
    // Forces from second differences of the centroids' positions along a motion with load-dependent
    // friction.
    let p = frictionless();
    let effect = ["load-dependent-friction@joint1=1e-3", "load-dependent-friction@joint2=2e-4"];
    let position = |y: &State| {
        let joint2 = [p.l1 * y[0].sin(), -p.l1 * y[0].cos()];
        let c1 = [p.e1 * y[0].sin(), -p.e1 * y[0].cos()];
        [c1, [joint2[0] + p.e2 * y[1].sin(), joint2[1] - p.e2 * y[1].cos()]]
    };
    let h = 1e-4;
    let mut plant = plant(&p, &effect, [0.4, 2.1, 3.0, -11.0]);
    let mut states = vec![plant.state()];
    for _ in 0..2 {
        plant.advance(&BaseMotion::REST, h).unwrap();
        states.push(plant.state());
    }
    let [a, b, c] = [0, 1, 2].map(|i| position(&states[i]));
    let acceleration = |i: usize, k: usize| (a[i][k] - 2.0 * b[i][k] + c[i][k]) / (h * h);
    let f2 = [p.m2 * acceleration(1, 0), p.m2 * (acceleration(1, 1) + p.g)];
    let f1 = [f2[0] + p.m1 * acceleration(0, 0), f2[1] + p.m1 * (acceleration(0, 1) + p.g)];
    let forces = plant.mechanics.forces([0.0; 2], &states[1], &plant.mode);
    for (load, f) in forces.load.iter().zip([f1, f2]) {
        assert!((load - f[0].hypot(f[1])).abs() < 1e-4 * load, "{forces:?} {f1:?} {f2:?}");
    }
    assert!((forces.dry[0] + 1e-3 * forces.load[0]).abs() < 1e-12, "{forces:?}");
    assert!((forces.dry[1] - 2e-4 * forces.load[1]).abs() < 1e-12, "{forces:?}");
}

#[test]
fn friction_that_would_push_is_refused() {
    let effects = combine(&[Effect::parse("asymmetric-friction@joint2=-1e-5").unwrap()]).unwrap();
    let error = Plant::new(&Parameters::PRINTED, &effects, [0.0; 4], TOLERANCE).unwrap_err();
    assert!(error.to_string().contains("joint 2"), "{error}");
    let lighter = combine(&[Effect::parse("asymmetric-friction@joint1=-1e-5").unwrap()]).unwrap();
    assert!(Plant::new(&Parameters::PRINTED, &lighter, [0.0; 4], TOLERANCE).is_ok());
    let impossible = Parameters { j_o2: 1e-9, ..Parameters::PRINTED };
    assert!(Plant::new(&impossible, &Additions::default(), [0.0; 4], TOLERANCE).is_err());
    let nan = Parameters { g: f64::NAN, ..Parameters::PRINTED };
    assert!(Plant::new(&nan, &Additions::default(), [0.0; 4], TOLERANCE).is_err());
}
