//! A rig in which something changes while it is recorded: told as that, with the instant. The plant is
//! integrated here.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

use serde_json::Value;

use super::program::{done, json};

const MODEL: &str = r#"name = "oscillator"
coordinates = [{ name = "x", space = "R" }]
inputs = ["f"]
[[equation]]
balance = "f"
terms = { m = "x''", c = "x'", k = "x" }
"#;

const RIG: &str = r#"name = "oscillator"
model = "oscillator.toml"
sample_rate_hz = 50.0
channel = [
    { name = "x", measures = "x", unit = "m" },
    { name = "f", measures = "f", unit = "N" },
]
"#;

/// Seconds of a record.
const SECONDS: f64 = 120.0;
/// Steps of the integration to a sample: of 1 ms.
const STEPS: usize = 20;

/// Tones between 0.3 and 2.5 Hz, none a multiple of another.
fn force(t: f64) -> f64 {
    let one = |k: usize| {
        let frequency_hz = 0.31 + 0.1973 * k as f64;
        (TAU * frequency_hz * t + 2.4 * (k * k) as f64).sin()
    };
    (0..12).map(one).sum()
}

/// A record of ẍ = f − 0.5 ẋ − k(t, x) x, with noise of 0.1 mm.
fn write(path: &Path, stiffness: impl Fn(f64, f64) -> f64) {
    let rate = |t: f64, x: f64, v: f64| (v, force(t) - 0.5 * v - stiffness(t, x) * x);
    let (mut x, mut v) = (0.0, 0.0);
    let mut seed = 7_u32;
    let mut uniform = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
    };
    let mut text = "t,x,f\n".to_owned();
    let h = 0.02 / STEPS as f64;
    for i in 0..(50.0 * SECONDS) as usize {
        let noise = 1e-4 * (0..12).map(|_| uniform()).sum::<f64>();
        writeln!(text, "{:.2},{:.7},{:.9}", 0.02 * i as f64, x + noise, force(0.02 * i as f64)).unwrap();
        for j in 0..STEPS {
            // Runge and Kutta of fourth order: (2π · 2.5 Hz · 1 ms)⁴ is 6·10⁻⁸.
            let t = 0.02 * i as f64 + h * j as f64;
            let (x1, v1) = rate(t, x, v);
            let (x2, v2) = rate(t + 0.5 * h, x + 0.5 * h * x1, v + 0.5 * h * v1);
            let (x3, v3) = rate(t + 0.5 * h, x + 0.5 * h * x2, v + 0.5 * h * v2);
            let (x4, v4) = rate(t + h, x + h * x3, v + h * v3);
            x += h / 6.0 * (x1 + 2.0 * x2 + 2.0 * x3 + x4);
            v += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
        }
    }
    std::fs::write(path, text).unwrap();
}

/// What is said of such a record, and its JSON.
fn explained(at: &Path, options: &str, stiffness: impl Fn(f64, f64) -> f64) -> (String, Value) {
    write(&at.join("r.csv"), stiffness);
    std::fs::write(at.join("oscillator.toml"), MODEL).unwrap();
    std::fs::write(at.join("rig.toml"), RIG).unwrap();
    let told = done(at, &format!("explain r.csv --rig rig.toml --json e.json {options}"));
    (told, json(&at.join("e.json")))
}

#[test]
fn a_stiffness_that_changes_halfway_is_told_with_the_instant() {
    let folder = tempfile::tempdir().unwrap();
    let (told, out) = explained(folder.path(), "", |t, _| if t < 0.5 * SECONDS { 40.0 } else { 41.0 });
    assert_eq!(out["verdict"], "unexplained", "{}", out["reason"]);
    assert!(told.starts_with("What is missing depends on time: ") && told.contains("--from "), "{told}");
    assert_eq!(out["where"][0]["against"], "time", "{}", out["where"]);
    let warnings = out["warnings"].as_array().unwrap();
    let Some(warning) = warnings.iter().find(|w| w["id"] == "depends-on-time") else { panic!("{warnings:?}") };
    // To a window.
    let window_s = out["details"]["window_s"].as_f64().unwrap();
    let at_s = warning["time_s"].as_f64().unwrap();
    assert!((at_s - 0.5 * SECONDS).abs() <= window_s && warning["drifts"] == false, "{warning} {window_s}");
}

/// A law without a name that is there all the time does not depend on it.
#[test]
fn what_is_missing_all_along_is_no_change() {
    let folder = tempfile::tempdir().unwrap();
    let (told, out) = explained(folder.path(), "--most-effects 0", |_, x| 40.0 + 8.0 * (2.0 * (x / 0.2 - 1.0)).tanh());
    assert_eq!(out["verdict"], "unexplained", "{}", out["reason"]);
    assert!(!told.contains("depends on time"), "{told}");
    assert!(out["warnings"].as_array().unwrap().iter().all(|w| w["id"] != "depends-on-time"), "{}", out["warnings"]);
}
