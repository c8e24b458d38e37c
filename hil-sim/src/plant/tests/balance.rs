//! Energy: conserved where nothing takes or gives, balanced where something does.

use core::f64::consts::PI;

use super::*;

#[test]
fn a_free_frictionless_pendulum_keeps_its_energy() {
    for state in [[2.5, -1.0, 0.0, 3.0], [0.1, 3.0, 8.0, -40.0]] {
        let mut plant = plant(&frictionless(), &[], state);
        let start = plant.energy();
        let scale = frictionless().s1() * 9.81;
        for _ in 0..20_000 {
            plant.advance(&BaseMotion::REST, TICK).unwrap();
        }
        assert!((plant.energy() - start).abs() < 2e-8 * scale, "{:e}", plant.energy() / start - 1.0);
    }
}

/// Potential energy of the joints' springs in the conservation test.
fn springs(state: &State) -> f64 {
    let wrap = |x: f64| x - 2.0 * PI * ((x + PI) / (2.0 * PI)).floor();
    let (x1, x2) = (wrap(state[0]), wrap(state[1] - state[0]));
    let beyond = (x2.abs() - 0.7).max(0.0);
    0.5 * 2e-3 * x1 * x1 + 0.25 * 1e-4 * x1.powi(4) + 0.5 * 3e-3 * beyond * beyond - 1e-3 / 5.0 * (5.0 * x2 + 0.3).cos()
}

#[test]
fn springs_with_corners_keep_energy_through_every_turn() {
    let effects = [
        "torsion-spring@joint1=2e-3",
        "cubic-stiffness@joint1=1e-4",
        "backlash@joint2=0.7,k=3e-3",
        "cogging@joint2=1e-3,n=5,psi=0.3",
    ];
    let mut plant = plant(&frictionless(), &effects, [0.5, 1.0, 25.0, 20.0]);
    let start = plant.energy() + springs(&plant.state());
    for _ in 0..5_000 {
        plant.advance(&BaseMotion::REST, TICK).unwrap();
    }
    assert!(plant.state()[0].abs() > 3.0 * PI, "the arms must turn over: {:?}", plant.state());
    let end = plant.energy() + springs(&plant.state());
    assert!((end / start - 1.0).abs() < 1e-8, "{:e}", end / start - 1.0);
}

/// Integrates power over a tick by Simpson's rule on fine sub-steps, under the drive.
fn imbalance(effects: &[&str], dissipation: impl Fn(&State) -> f64) -> (f64, f64, u32) {
    let parameters = Parameters::PRINTED;
    let mut drive = Drive::new(0.015_525);
    let mut plant = plant(&parameters, effects, [0.3, 2.0, 0.0, 0.0]);
    let power = |state: &State, base: [f64; 2]| {
        let moments = parameters.s1() * state[0].sin() * state[2] + parameters.s2() * state[1].sin() * state[3];
        [-moments * base[1], dissipation(state)]
    };
    let start = plant.energy();
    let (mut given, mut taken, mut sticks) = (0.0, 0.0, 0);
    const PARTS: u32 = 8;
    let h = TICK / f64::from(PARTS);
    for _ in 0..2_000 {
        let motion = drive.next();
        for part in 0..PARTS {
            let here = motion.later(h * f64::from(part));
            let a = power(&plant.state(), here.acceleration(0.0));
            plant.advance(&here, 0.5 * h).unwrap();
            let b = power(&plant.state(), here.acceleration(0.5 * h));
            plant.advance(&here.later(0.5 * h), 0.5 * h).unwrap();
            let c = power(&plant.state(), here.acceleration(h));
            given += h / 6.0 * (a[0] + 4.0 * b[0] + c[0]);
            taken += h / 6.0 * (a[1] + 4.0 * b[1] + c[1]);
            sticks += u32::from(plant.friction().contains(&Some(Dry::Stick)));
        }
    }
    (plant.energy() - start - given + taken, taken, sticks)
}

#[test]
fn what_the_drive_gives_and_friction_takes_is_what_the_energy_changes_by() {
    let (gap, taken, _) = imbalance(&[], |y| 6.03e-4 * y[2].abs() + 6.145e-5 * (y[3] - y[2]).powi(2));
    assert!(taken > 0.01 && gap.abs() < 1e-8, "taken {taken} J, gap {gap:e} J");
}

#[test]
fn all_kinds_of_dry_friction_in_both_joints_balance_with_sticking() {
    let effects = [
        "coulomb-friction@joint1=0.006",
        "stribeck-friction@joint1=2e-3,v_s=0.8",
        "coulomb-friction@joint2=2e-3",
        "asymmetric-friction@joint2=5e-4",
        "quadratic-drag@arm2=2e-6",
    ];
    let (gap, taken, sticks) = imbalance(&effects, |y| {
        let v = y[3] - y[2];
        let joint1 = 6.603e-3 + 2e-3 * (-(y[2] / 0.8).powi(2)).exp();
        let joint2 = if v > 0.0 { 2.5e-3 } else { 2e-3 };
        joint1 * y[2].abs() + joint2 * v.abs() + 6.145e-5 * v * v + 2e-6 * y[3].abs().powi(3)
    });
    assert!(sticks > 100, "the joints must stick at times: {sticks}");
    assert!(taken > 0.01 && gap.abs() < 1e-7, "taken {taken} J, gap {gap:e} J");
}
