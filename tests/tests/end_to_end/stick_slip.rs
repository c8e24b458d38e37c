//! A mass on a rough table, in metres, whose friction falls within some centimetres a second: far
//! below the motion's own velocities. The plant is integrated here.

use std::fmt::Write;
use std::path::Path;

use super::program::{done, json};
use super::sticking::{Law, Sticking};

const MODEL: &str = r#"name = "mass on a table"
coordinates = [{ name = "x", space = "R" }]
inputs = ["f"]
[[equation]]
balance = "f"
terms = { m = "x''", c = "x'", k = "x", fc = "sign(x')" }
"#;

const RIG: &str = r#"name = "mass on a table"
model = "table.toml"
sample_rate_hz = 500.0
channel = [
    { name = "x", measures = "x", unit = "m" },
    { name = "f", measures = "f", unit = "N" },
]
"#;

const M: f64 = 1.0;
const C: f64 = 0.4;
const K: f64 = 66.7;
const COULOMB: f64 = 0.5;
const STRIBECK: f64 = 0.35;
const FALLS_WITHIN: f64 = 0.06;
/// Steps of the integration to a sample.
const STEPS: usize = 40;

fn force(t: f64) -> f64 {
    let tones = [(1.5, 0.61, 0.2), (1.2, 1.13, 1.1), (0.9, 1.87, 2.3), (0.7, 2.71, 0.7)];
    tones.iter().map(|(a, f, p)| a * (std::f64::consts::TAU * f * t + p).sin()).sum()
}

/// Friction at a velocity that goes in the direction of `sign`.
fn friction(v: f64, sign: f64) -> f64 {
    sign * (COULOMB + STRIBECK * (-(v / FALLS_WITHIN).powi(2)).exp())
}

fn record(at: &Path) {
    let acceleration = |t: f64, x: f64, v: f64, sign: f64| (force(t) - C * v - K * x - friction(v, sign)) / M;
    let pull = |t: f64, x: f64| force(t) - K * x;
    let law = Law { acceleration: &acceleration, pull: &pull, holds: COULOMB + STRIBECK };
    let (dt, mut mass) = (1.0 / 500.0, Sticking::default());
    let h = dt / STEPS as f64;
    let mut text = String::from("t,x,f\n");
    for i in 0..30_000 {
        let t = i as f64 * dt;
        // Steps of 2 µm, as of a scale.
        let x = (mass.x / 2e-6).round() * 2e-6;
        writeln!(text, "{t:.3},{x:.6},{:.6}", force(t)).unwrap();
        (0..STEPS).for_each(|k| mass.step(&law, t + k as f64 * h, h));
    }
    std::fs::write(at.join("r.csv"), text).unwrap();
}

/// At velocities of about one what falls within 6 cm/s is nothing, and was taken for a multiple of
/// the dry friction that the equation has.
#[test]
fn a_friction_that_falls_within_a_small_velocity_is_found_beside_a_dry_one() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("table.toml"), MODEL).unwrap();
    std::fs::write(at.join("rig.toml"), RIG).unwrap();
    record(at);
    done(at, "explain r.csv --rig rig.toml --json e.json");
    let e = json(&at.join("e.json"));
    let effects = e["effects"].as_array().unwrap();
    assert_eq!(effects.len(), 1, "{}", e["reason"]);
    let f = &effects[0];
    assert_eq!((f["id"].as_str(), e["verdict"].as_str()), (Some("stribeck-friction"), Some("explained")), "{f}");
    let (value, error) = (f["value"].as_f64().unwrap(), f["std_error"].as_f64().unwrap());
    assert!((value - STRIBECK).abs() < 4.0 * error && error < 0.02 * STRIBECK, "{value} ± {error}");
    let within = f["parameters"]["v_s"].as_f64().unwrap();
    assert!((within / FALLS_WITHIN - 1.0).abs() < 0.02, "{within}");
    for (name, truth) in [("m", M), ("c", C), ("k", K), ("fc", COULOMB)] {
        let p = e["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
        let (value, error) = (p["value"].as_f64().unwrap(), p["std_error"].as_f64().unwrap());
        assert!((value - truth).abs() < 4.0 * error, "{name}: {value} ± {error}");
    }
}
