//! A motor and a load on an elastic shaft, both turning over and over: the twist is one angle,
//! whether the system is written as bodies or as equations. The plant is integrated here.

use core::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

use super::own_systems::parameter;
use super::program::{done, json};

const BODIES: &str = r#"name = "drive line"
coordinates = { q1 = "angle", q2 = "angle" }
inputs = { torque = "N m" }
parameters = { J1 = "kg m^2", J2 = "kg m^2", k = "N m/rad", n = "N m/rad^3", c = "N m s/rad", b = "N m s/rad" }
kinetic = "J1*q1'^2/2 + J2*q2'^2/2"
potential = "k*(q2 - q1)^2/2 + n*(q2 - q1)^4/4"
[[force]]
does_work_on = "q1"
value = "torque"
[[force]]
does_work_on = "q2 - q1"
value = "-c*(q2' - q1')"
[[force]]
does_work_on = "q2"
value = "-b*q2'"
"#;

const EQUATIONS: &str = r#"name = "drive line"
coordinates = [{ name = "q1", space = "S1" }, { name = "q2", space = "S1" }]
inputs = ["torque"]
[[equation]]
balance = "torque"
terms = { J1 = "q1''", k = "q1 - q2", n = "(q1 - q2)^3", c = "q1' - q2'" }
[[equation]]
balance = "-q2''"
terms = { k_load = "q2 - q1", n_load = "(q2 - q1)^3", c_load = "q2' - q1'", b = "q2'" }
"#;

const RIG: &str = r#"name = "drive line"
sample_rate_hz = 500.0
[[channel]]
name = "q1"
measures = "q1"
unit = "count"
counts_per_turn = 20000
[[channel]]
name = "q2"
measures = "q2"
unit = "count"
counts_per_turn = 20000
[[channel]]
name = "torque"
measures = "torque"
unit = "N m"
"#;

/// J1, J2, k, n, c, b.
const TRUE: [f64; 6] = [2e-3, 5e-3, 8.0, 40.0, 5e-3, 0.01];

fn torque(t: f64) -> f64 {
    [(0.3, 0.13), (0.6, 3.1), (0.5, 6.9)].iter().map(|(a, f)| a * (TAU * f * t + f).sin()).sum()
}

fn rates(t: f64, [q1, q2, v1, v2]: [f64; 4]) -> [f64; 4] {
    let [j1, j2, k, n, c, b] = TRUE;
    let twist = q2 - q1;
    let shaft = k * twist + n * twist.powi(3) + c * (v2 - v1);
    [v1, v2, (torque(t) + shaft) / j1, (-shaft - b * v2) / j2]
}

/// A step of the classical method of Runge and Kutta.
fn step(t: f64, y: [f64; 4], h: f64) -> [f64; 4] {
    let at = |k: [f64; 4], share: f64| core::array::from_fn(|i| y[i] + share * h * k[i]);
    let k1 = rates(t, y);
    let k2 = rates(t + h / 2.0, at(k1, 0.5));
    let k3 = rates(t + h / 2.0, at(k2, 0.5));
    let k4 = rates(t + h, at(k3, 1.0));
    core::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
}

/// 30 s of counts; how far the motor turned, in turns.
fn write(at: &Path) -> f64 {
    let (mut y, mut text, mut extent) = ([0.0; 4], "t,q1,q2,torque\n".to_owned(), [0.0_f64; 2]);
    for i in 0..15_000 {
        let t = f64::from(i) * 0.002;
        let [a, b] = [y[0], y[1]].map(|q| (q / TAU * 20_000.0).floor());
        writeln!(text, "{t:.3},{a},{b},{:.9}", torque(t)).unwrap();
        extent = [extent[0].min(y[0]), extent[1].max(y[0])];
        for k in 0..10 {
            y = step(t + f64::from(k) * 2e-4, y, 2e-4);
        }
    }
    std::fs::write(at.join("r.csv"), text).unwrap();
    (extent[1] - extent[0]) / TAU
}

#[test]
fn a_shaft_between_two_inertias_twists_as_one_angle() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    assert!(write(at) > 2.0, "both ends turn over");
    let [j1, j2, k, n, c, b] = TRUE;
    let of_bodies = [("J1", j1), ("J2", j2), ("k", k), ("n", n), ("c", c), ("b", b)];
    let of_equations =
        [("J1", j1), ("k", k), ("n", n), ("c", c), ("k_load", k / j2), ("n_load", n / j2), ("b", b / j2)];
    for (model, wanted) in [(BODIES, &of_bodies[..]), (EQUATIONS, &of_equations[..])] {
        std::fs::write(at.join("line.toml"), model).unwrap();
        std::fs::write(at.join("rig.toml"), RIG.replacen('\n', "\nmodel = \"line.toml\"\n", 1)).unwrap();
        done(at, "identify r.csv --rig rig.toml --json i.json --force");
        let found = json(&at.join("i.json"));
        for (name, value) in wanted {
            let x = parameter(&found, name);
            assert!((x / value - 1.0).abs() < 2e-3, "{name}: {x} for {value}");
        }
    }
}
