//! True sticking: what holds does not creep, what is let go moves, and both joints can hold at
//! once.

use super::*;

#[test]
fn what_the_friction_can_hold_does_not_move_at_all() {
    // S1 g sin φ1 with both arms in line: 0.0418 N m · sin φ.
    let state = [0.2, 0.2, 0.0, 0.0];
    let mut plant = plant(&frictionless(), &["coulomb-friction@joint1=0.02", "coulomb-friction@joint2=0.01"], state);
    plant.advance(&BaseMotion::REST, 100.0).unwrap();
    assert_eq!(plant.state(), state);
    assert_eq!(plant.friction(), [Some(Dry::Stick), Some(Dry::Stick)]);
}

#[test]
fn what_it_cannot_hold_falls() {
    let state = [0.2, 0.2, 0.0, 0.0];
    let mut plant = plant(&frictionless(), &["coulomb-friction@joint1=1e-3", "coulomb-friction@joint2=1e-4"], state);
    plant.advance(&BaseMotion::REST, 0.05).unwrap();
    assert!(plant.state()[2] < -0.1, "{:?}", plant.state());
}

#[test]
fn a_locked_second_joint_makes_one_rigid_body() {
    let parameters = frictionless();
    let (start, delta) = (0.9, 0.6);
    let mut plant = plant(&parameters, &["coulomb-friction@joint2=1.0"], [start, start + delta, 0.0, 0.0]);
    let energy = plant.energy();
    for _ in 0..2_000 {
        plant.advance(&BaseMotion::REST, TICK).unwrap();
        let y = plant.state();
        assert!((y[1] - y[0] - delta).abs() < 1e-13 && y[2] == y[3], "{y:?}");
    }
    // The rigid body's own energy, from its own inertia.
    let inertia = parameters.j_o1 + parameters.j_o2 + 2.0 * parameters.h() * f64::cos(delta);
    let y = plant.state();
    let potential = |phi: f64| -parameters.g * (parameters.s1() * phi.cos() + parameters.s2() * (phi + delta).cos());
    assert!((0.5 * inertia * y[2] * y[2] + potential(y[0]) - energy).abs() < 1e-9);
    assert_eq!(plant.friction(), [None, Some(Dry::Stick)]);
}

#[test]
fn a_drive_that_is_switched_on_breaks_the_hold() {
    let mut plant = plant(&frictionless(), &["coulomb-friction@joint1=9e-3"], [0.2, 0.2, 0.0, 0.0]);
    plant.advance(&BaseMotion::REST, 1.0).unwrap();
    assert_eq!(plant.friction()[0], Some(Dry::Stick));
    let mut drive = Drive::new(0.015);
    let mut slipped = 0;
    for _ in 0..500 {
        plant.advance(&drive.next(), TICK).unwrap();
        slipped += u32::from(plant.friction()[0] != Some(Dry::Stick));
    }
    assert!((20..480).contains(&slipped), "{slipped} of 500 ticks ended slipping");
}

#[test]
fn the_least_pull_over_the_level_moves_it_and_the_least_under_it_does_not() {
    let parameters = Parameters { e2: 0.0, ..frictionless() };
    let torque = parameters.s1() * parameters.g * f64::sin(0.3);
    for (share, moves) in [(1.0 + 1e-9, false), (1.0 - 1e-9, true)] {
        let held = Parameters { tau_c1: torque * share, ..parameters };
        let mut plant = plant(&held, &[], [0.3, 0.0, 0.0, 0.0]);
        plant.advance(&BaseMotion::REST, 0.5).unwrap();
        assert_eq!(plant.state()[0] != 0.3, moves, "{share}");
    }
}

#[test]
fn no_friction_level_makes_it_chatter_or_hang() {
    for level in ["1e-5", "1e-4", "1e-3", "5e-3", "1e-2", "0.03", "0.3"] {
        for stribeck in ["0", "1e-3"] {
            let effects = [
                format!("coulomb-friction@joint1={level}"),
                format!("coulomb-friction@joint2={level}"),
                format!("stribeck-friction@joint1={stribeck},v_s=0.05"),
                "load-dependent-friction@joint1=1e-4".to_owned(),
                "load-dependent-friction@joint2=1e-4".to_owned(),
                "torsion-spring@joint2=1e-3".to_owned(),
            ];
            let effects: Vec<&str> = effects.iter().map(String::as_str).collect();
            let mut plant = plant(&Parameters::PRINTED, &effects, [0.3, 2.0, 0.0, 0.0]);
            let mut drive = Drive::new(0.0155);
            for tick in 0..1_000 {
                plant.advance(&drive.next(), TICK).unwrap_or_else(|e| panic!("level {level}, tick {tick}: {e}"));
            }
        }
    }
}

#[test]
fn corners_are_found_after_a_hundred_thousand_turns() {
    let far = 1e5 * core::f64::consts::TAU;
    let effects = ["torsion-spring@joint1=1e-3", "backlash@joint2=0.5,k=2e-3", "coulomb-friction@joint2=1e-5"];
    let mut plant = plant(&Parameters::PRINTED, &effects, [far + 0.3, 2.0 - 3.0 * far, 30.0, -40.0]);
    let mut drive = Drive::new(0.0155);
    for _ in 0..2_000 {
        plant.advance(&drive.next(), TICK).unwrap();
    }
    let (state, within) = (plant.state(), plant.within_turn());
    assert!((state[0] - far).abs() < 1e4 && (state[1] + 3.0 * far).abs() < 1e4, "{state:?}");
    assert!(within[0].abs() < 10.0 && within[1].abs() < 10.0, "{within:?}");
    for i in 0..2 {
        assert!((state[i].sin() - within[i].sin()).abs() < 1e-8);
    }
}
