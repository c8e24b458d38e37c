//! Records of a few swings, as a camera gives them.

use std::fmt::Write;
use std::path::Path;

use super::program::{json, whirl};

const SYSTEM: &str = r#"
name = "mass on a spring"
time = "s"
coordinates = [{ name = "x", space = "R" }]

[[equation]]
balance = "-x''"
terms = { k = "x", c = "x'" }
"#;
const RIG: &str = r#"
name = "camera"
model = "spring.toml"
sample_rate_hz = 30.0
time = "t"
channel = [{ name = "x", measures = "x", unit = "m" }]
"#;
const STIFFNESS: f64 = 56.0;

/// Six seconds at 30 Hz of a mass on a spring under dry friction alone, until it stops: between
/// turning points a cosine about a rest that lies where friction and spring hold each other.
fn write(folder: &Path) {
    let (omega, rest, begin): (f64, f64, f64) = (STIFFNESS.sqrt(), 0.001, 0.03);
    let mut text = String::from("t,x\n");
    for i in 0..190_i32 {
        let t = f64::from(i) / 30.0;
        // It stops at the turning point that lies within the rest.
        let halves = (omega * t / core::f64::consts::PI).floor().min(((begin / rest - 1.0) / 2.0).ceil());
        let phase = (omega * t - halves * core::f64::consts::PI).min(core::f64::consts::PI);
        let stops = begin - 2.0 * rest * halves <= rest;
        let side = if halves % 2.0 == 0.0 { 1.0 } else { -1.0 };
        let top = begin - 2.0 * rest * halves;
        let x = if stops { side * top } else { side * ((top - rest) * phase.cos() + rest) };
        let noise = 1e-4 * (f64::from((i * 7919) % 1009) / 1009.0 - 0.5);
        writeln!(text, "{t:.6},{:.6}", x + noise).unwrap();
    }
    std::fs::write(folder.join("r.csv"), text).unwrap();
    std::fs::write(folder.join("spring.toml"), SYSTEM).unwrap();
    std::fs::write(folder.join("rig.toml"), RIG).unwrap();
}

/// Windows follow the motion: none of 4 s, which would have no room.
#[test]
fn a_few_swings_are_identified_and_validated_without_options() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let found = whirl(folder.path(), "identify r.csv --rig rig.toml --to 4.5 -o model.toml --json out.json");
    assert_ne!(found.status, 2, "{found:?}");
    let out = json(&folder.path().join("out.json"));
    let stiffness = out["parameters"][0]["value"].as_f64().unwrap();
    assert!((stiffness / STIFFNESS - 1.0).abs() < 0.05, "{stiffness}");
    let valid = whirl(folder.path(), "validate r.csv --rig rig.toml --to 4.5 --model model.toml");
    assert_ne!(valid.status, 2, "{valid:?}");
}

/// Too few to hold one back is no sign of a wrong unit.
#[test]
fn too_few_swings_are_not_told_as_swings_that_are_not_followed() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let run = whirl(folder.path(), "explain r.csv --rig rig.toml --to 2.2 --json out.json");
    let out = json(&folder.path().join("out.json"));
    let reason = out["reason"].as_str().unwrap();
    assert_eq!((run.status, &out["verdict"]), (1, &"not-decidable".into()), "{run:?}");
    assert!(reason.contains("too few to hold some back") && !reason.contains("units and signs"), "{reason}");
}

/// Blocks are half a swing long where nine of 32 samples find no room.
#[test]
fn a_swing_that_has_stopped_decides() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let run = whirl(folder.path(), "explain r.csv --rig rig.toml --json out.json");
    let out = json(&folder.path().join("out.json"));
    assert_ne!(out["verdict"], "not-decidable", "{}\n{run:?}", out["reason"]);
}
