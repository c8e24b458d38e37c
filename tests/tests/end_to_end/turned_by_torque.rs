//! A rotor with dry friction and an unbalance, turned by a measured torque: it sticks now and then. The
//! plant is integrated here.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

use super::program::{done, json};

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

/// The rotor: at rest while what turns it stays within the friction, and in the sense of its motion
/// otherwise; a reversal lies within a step of 200 µs and ends it.
struct Rotor {
    q: f64,
    v: f64,
    /// Sense of the motion; 0 at rest.
    sign: f64,
}

impl Rotor {
    fn step(&mut self, t: f64, h: f64) {
        let free = |t: f64, q: f64| torque(t) - G * q.sin() - OFFSET;
        if self.sign == 0.0 {
            let turned = free(t, self.q);
            if turned.abs() <= COULOMB {
                return;
            }
            self.sign = turned.signum();
        }
        let sign = self.sign;
        let rate = |t: f64, q: f64, v: f64| (v, (free(t, q) - C * v - sign * COULOMB) / J);
        let (a1, b1) = rate(t, self.q, self.v);
        let (a2, b2) = rate(t + 0.5 * h, self.q + 0.5 * h * a1, self.v + 0.5 * h * b1);
        let (a3, b3) = rate(t + 0.5 * h, self.q + 0.5 * h * a2, self.v + 0.5 * h * b2);
        let (a4, b4) = rate(t + h, self.q + h * a3, self.v + h * b3);
        let next = self.v + h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4);
        if next * sign < 0.0 {
            // To the instant of the reversal along a straight line, and on from rest there.
            let share = self.v / (self.v - next);
            self.q += 0.5 * share * h * self.v;
            (self.v, self.sign) = (0.0, 0.0);
            if share > 0.0 {
                self.step(t + share * h, (1.0 - share) * h);
            }
            return;
        }
        self.q += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
        self.v = next;
    }
}

fn record(at: &Path) {
    let (dt, mut rotor) = (1.0 / 500.0, Rotor { q: 0.0, v: 0.0, sign: 0.0 });
    let h = dt / STEPS as f64;
    let mut text = String::from("t,th,u\n");
    for i in 0..20_000 {
        let t = i as f64 * dt;
        writeln!(text, "{t:.3},{},{:.9}", (rotor.q / TAU * 4000.0).floor(), torque(t)).unwrap();
        (0..STEPS).for_each(|k| rotor.step(t + k as f64 * h, h));
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
    for (name, truth) in [("J", J), ("c", C), ("tc", COULOMB), ("G", G), ("o", OFFSET)] {
        let p = found["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
        let (value, error) = (p["value"].as_f64().unwrap(), p["std_error"].as_f64().unwrap());
        assert!((value - truth).abs() < 5.0 * error, "{name}: {value} ± {error}");
        assert!(error < 2e-4 * truth.abs(), "{name}: {value} ± {error}");
    }
}
