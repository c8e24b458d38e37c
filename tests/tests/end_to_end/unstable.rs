//! A ball in the field of a coil: unstable, held in place by a controller whose current is measured.
//! The plant is integrated here.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

use super::program::{are, done, json};

const MODEL: &str = r#"name = "ball"
coordinates = [{ name = "z", space = "R" }]
inputs = ["i"]
[[equation]]
balance = "-z''"
terms = { G = "1", C = "(i/z)^2" }
"#;

const RIG: &str = r#"name = "ball"
model = "ball.toml"
sample_rate_hz = 2000.0
channel = [
    { name = "z", measures = "z", unit = "mm" },
    { name = "i", measures = "i", unit = "A" },
]
"#;

/// Gravity, and the coil's force at 10 mm and 1 A, which it is there, m/s².
const GRAVITY: f64 = 9.81;
const GAP_M: f64 = 0.01;
const COIL: f64 = GRAVITY * GAP_M * GAP_M;
const RATE_HZ: f64 = 2000.0;

/// Current of the controller, whose gap is moved.
fn current(t: f64, z: f64, v: f64) -> f64 {
    let tones = [(2.5e-4, 0.7, 0.0), (2e-4, 2.3, 1.0), (2e-4, 5.9, 2.0), (1e-4, 11.3, 3.0), (1e-4, 17.9, 4.0)];
    let moved: f64 = tones.iter().map(|(a, f, p)| a * (TAU * f * t + p).sin()).sum();
    1.0 + 260.0 * (z - GAP_M - moved) + 4.5 * v
}

fn record(at: &Path) {
    let rate = |t: f64, z: f64, v: f64| (v, GRAVITY - COIL * (current(t, z, v) / z).powi(2));
    let (h, mut z, mut v) = (1.0 / RATE_HZ, GAP_M, 0.0);
    // Noise of half a micrometre, from a congruential generator: the sum of four numbers has a variance
    // of a third of their width squared.
    let mut seed = 1_u64;
    let mut noise = || {
        let mut one = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        0.5e-6 * 3_f64.sqrt() * (one() + one() + one() + one())
    };
    let mut text = String::from("t,z,i\n");
    for k in 0..20_000 {
        let t = k as f64 * h;
        writeln!(text, "{t:.4},{:.8},{:.9}", 1e3 * (z + noise()), current(t, z, v)).unwrap();
        let (a1, b1) = rate(t, z, v);
        let (a2, b2) = rate(t + 0.5 * h, z + 0.5 * h * a1, v + 0.5 * h * b1);
        let (a3, b3) = rate(t + 0.5 * h, z + 0.5 * h * a2, v + 0.5 * h * b2);
        let (a4, b4) = rate(t + h, z + h * a3, v + h * b3);
        z += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
        v += h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4);
    }
    std::fs::write(at.join("r.csv"), text).unwrap();
}

/// Solutions from guessed states fall onto the coil, where no step is short enough: steps had been a
/// sixteenth of a sample, and states of pieces four times as long were sought to the last digit.
#[test]
fn an_unstable_motion_is_followed_in_steps_of_its_samples_or_so() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("ball.toml"), MODEL).unwrap();
    std::fs::write(at.join("rig.toml"), RIG).unwrap();
    record(at);
    done(at, "identify r.csv --rig rig.toml --json i.json");
    let found = json(&at.join("i.json"));
    assert_eq!(found["method"], "shooting", "{}", found["not_by_shooting"]);
    let step_s = found["shooting"]["step_s"].as_f64().unwrap();
    assert!(step_s > 0.25 / RATE_HZ, "{step_s}");
    are(&found, &[("G", -GRAVITY), ("C", COIL)]);
}
