//! A rotor with dry friction and an unbalance, turned by a measured torque: it sticks now and then. The
//! plant is integrated here.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

use super::program::{are, done, json};
use super::sticking::{Law, Sticking};

const MODEL: &str = r#"name = "rotor"
coordinates = [{ name = "th", space = "S1" }]
inputs = ["u"]
[[equation]]
balance = "u"
terms = { J = "th''", c = "th'", tc = "sign(th')", G = "sin(th)", o = "1" }
"#;

const RIG: &str = r#"name = "rotor"
model = "rotor.toml"
sample_rate_hz = 500.0
channel = [
    { name = "th", measures = "th", unit = "count", counts_per_turn = 4000 },
    { name = "u", measures = "u", unit = "N m" },
]
"#;

const J: f64 = 1.2e-3;
const C: f64 = 1.5e-3;
const COULOMB: f64 = 8e-3;
const G: f64 = 0.05;
const OFFSET: f64 = -4e-3;
/// Steps of the integration to a sample.
const STEPS: usize = 10;

fn torque(t: f64) -> f64 {
    let tones = [(0.03, 0.11, 0.0), (0.03, 0.37, 1.0), (0.025, 0.83, 2.0), (0.02, 1.41, 3.0), (0.02, 2.17, 4.0)];
    tones.iter().map(|(a, f, p)| a * (TAU * f * t + p).sin()).sum()
}

fn record(at: &Path) {
    let pull = |t: f64, q: f64| torque(t) - G * q.sin() - OFFSET;
    let acceleration = |t: f64, q: f64, v: f64, sign: f64| (pull(t, q) - C * v - sign * COULOMB) / J;
    let law = Law { acceleration: &acceleration, pull: &pull, holds: COULOMB };
    let (dt, mut rotor) = (1.0 / 500.0, Sticking::default());
    let h = dt / STEPS as f64;
    let mut text = String::from("t,th,u\n");
    for i in 0..20_000 {
        let t = i as f64 * dt;
        writeln!(text, "{t:.3},{},{:.9}", (rotor.x / TAU * 4000.0).floor(), torque(t)).unwrap();
        (0..STEPS).for_each(|k| rotor.step(&law, t + k as f64 * h, h));
    }
    std::fs::write(at.join("r.csv"), text).unwrap();
}

/// A piece that begins while the rotor sticks has a rate that finds no rest: one alone had kept the
/// parameters, which did not move any more, from being taken, and those of the weak form were told.
#[test]
fn a_piece_that_begins_at_rest_keeps_no_fit_from_being_taken() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("rotor.toml"), MODEL).unwrap();
    std::fs::write(at.join("rig.toml"), RIG).unwrap();
    record(at);
    done(at, "identify r.csv --rig rig.toml --json i.json");
    let found = json(&at.join("i.json"));
    assert_eq!(found["method"], "shooting", "{}", found["not_by_shooting"]);
    are(&found, &[("J", J), ("c", C), ("tc", COULOMB), ("G", G), ("o", OFFSET)]);
}
