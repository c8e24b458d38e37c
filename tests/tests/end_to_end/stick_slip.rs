//! A mass on a rough table, in metres, whose friction falls within some centimetres a second: far
//! below the motion's own velocities. The plant is integrated here.

use std::fmt::Write;
use std::path::Path;

use super::program::{done, json};

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

/// The mass: at rest while the force stays within the friction at rest, and in the sense of its
/// motion otherwise; a reversal lies within a step of 50 µs and ends it.
#[derive(Clone, Copy)]
struct Mass {
    x: f64,
    v: f64,
    /// Sense of the motion; 0 at rest.
    sign: f64,
}

impl Mass {
    fn step(&mut self, t: f64, h: f64) {
        if self.sign == 0.0 {
            let pull = force(t) - K * self.x;
            if pull.abs() <= COULOMB + STRIBECK {
                return;
            }
            self.sign = pull.signum();
        }
        let sign = self.sign;
        let rate = |t: f64, x: f64, v: f64| (v, (force(t) - C * v - K * x - friction(v, sign)) / M);
        let (a1, b1) = rate(t, self.x, self.v);
        let (a2, b2) = rate(t + 0.5 * h, self.x + 0.5 * h * a1, self.v + 0.5 * h * b1);
        let (a3, b3) = rate(t + 0.5 * h, self.x + 0.5 * h * a2, self.v + 0.5 * h * b2);
        let (a4, b4) = rate(t + h, self.x + h * a3, self.v + h * b3);
        let next = self.v + h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4);
        if next * sign < 0.0 {
            // To the instant of the reversal along a straight line, and on from rest there.
            let share = self.v / (self.v - next);
            self.x += 0.5 * share * h * self.v;
            (self.v, self.sign) = (0.0, 0.0);
            if share > 0.0 {
                self.step(t + share * h, (1.0 - share) * h);
            }
            return;
        }
        self.x += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
        self.v = next;
    }
}

fn record(at: &Path) {
    let (dt, mut mass) = (1.0 / 500.0, Mass { x: 0.0, v: 0.0, sign: 0.0 });
    let h = dt / STEPS as f64;
    let mut text = String::from("t,x,f\n");
    for i in 0..30_000 {
        let t = i as f64 * dt;
        // Steps of 2 µm, as of a scale.
        let x = (mass.x / 2e-6).round() * 2e-6;
        writeln!(text, "{t:.3},{x:.6},{:.6}", force(t)).unwrap();
        (0..STEPS).for_each(|k| mass.step(t + k as f64 * h, h));
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
