//! Dahl's friction against its differential equation, and where it is Coulomb's.

use super::*;

/// A free swing over `seconds` in steps of `h`: states and energies.
fn swing(effects: &[&str], h: f64, seconds: f64) -> Vec<(State, f64)> {
    let mut plant = plant(&frictionless(), effects, [1.2, 0.9, 0.0, 0.0]);
    let count = (seconds / h) as usize;
    (0..count)
        .map(|_| {
            let now = (plant.state(), plant.energy());
            plant.advance(&BaseMotion::REST, h).unwrap();
            now
        })
        .collect()
}

/// What the energy loses is the work of F z, z from dz/dt = (v − |v| z)/d along the motion by small steps.
#[test]
fn dahls_friction_takes_the_work_of_its_law() {
    let (h, f, d) = (5e-5, 4e-4, 0.05);
    for joint in ["joint1", "joint2"] {
        let all = swing(&[&format!("dahl-friction@{joint}={f},d={d}")], h, 2.0);
        let v = |y: &State| if joint == "joint1" { y[2] } else { y[3] - y[2] };
        let (mut z, mut work, mut least, mut reversals) = (0.0_f64, 0.0, 1.0_f64, 0);
        for pair in all.windows(2) {
            let (a, b) = (v(&pair[0].0), v(&pair[1].0));
            // The implicit midpoint rule.
            let m = 0.5 * (a + b);
            let next = (z + h / d * (m - 0.5 * m.abs() * z)) / (1.0 + 0.5 * h / d * m.abs());
            work += f * 0.5 * (z + next) * m * h;
            z = next;
            least = least.min(z);
            reversals += u32::from(a * b < 0.0);
        }
        let lost = all[0].1 - all[all.len() - 1].1;
        assert!(reversals > 2 && least < -0.9, "{reversals} {least}");
        assert!((lost - work).abs() < 1e-4 * lost, "{joint}: {lost} {work}");
    }
}

/// With a presliding distance far below the motion it is Coulomb's friction; whole turns do not matter.
#[test]
fn a_short_presliding_distance_is_coulombs_friction() {
    let coulomb = swing(&["coulomb-friction@joint2=2e-4"], 0.01, 1.0);
    let dahl = swing(&["dahl-friction@joint2=2e-4,d=1e-5"], 0.01, 1.0);
    for ((a, _), (b, _)) in coulomb.iter().zip(&dahl) {
        assert!((a[1] - b[1]).abs() < 2e-3, "{a:?} {b:?}");
    }
    let turned = |turns: f64| {
        let start = [0.3 + turns * core::f64::consts::TAU, 0.1, 40.0, -3.0];
        let mut plant = plant(&frictionless(), &["dahl-friction@joint1=1e-3,d=0.3"], start);
        plant.advance(&BaseMotion::REST, 0.5).unwrap();
        plant.state()
    };
    let (a, b) = (turned(0.0), turned(3.0));
    assert!((a[2] - b[2]).abs() + (a[3] - b[3]).abs() < 1e-5, "{a:?} {b:?}");
}
