//! A crane whose load is a mass at a point: what a frame's tilt, and the air, do to it.

use super::program::{done, json};

const CRANE: &str = r#"name = "crane"
coordinates = { x = "length", theta = "angle" }
inputs = { force = "N" }
gravity = "down"
parameters = { M = "kg", m = "kg", l = "m" }
[points]
trolley = "[x, 0]"
[[body]]
name = "trolley"
mass = "M"
centroid = "trolley"
[[body]]
name = "load"
mass = "m"
centroid = "trolley + l*along(theta)"
[[joint]]
name = "rail"
moves = "x"
[[joint]]
name = "sheave"
at = "trolley"
moves = "theta"
[[force]]
does_work_on = "x"
value = "force"
[nominal]
effects = ["viscous-friction@rail", "viscous-friction@sheave"]
"#;

const RIG: &str = r#"name = "crane"
model = "crane.toml"
sample_rate_hz = 50.0
[[channel]]
name = "x"
measures = "x"
unit = "m"
[[channel]]
name = "theta"
measures = "theta"
unit = "count"
counts_per_turn = 8192
[[channel]]
name = "force"
measures = "force"
unit = "N"
[known]
l = 0.8
[plant]
M = 2.0
m = 0.5
l = 0.8
"viscous-friction@rail" = 3.0
"viscous-friction@sheave" = 0.01
initial = [0.0, 0.2, 0.0, 0.0]
noise = { x = 2e-4 }
input.force = [{ kind = "random", rms = 6.0, to_hz = 1.5 }]
"#;

/// The one effect that is found of one that is put in, and its value and standard error.
fn found(effect: &str) -> (String, f64, f64) {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("crane.toml"), CRANE).unwrap();
    std::fs::write(at.join("rig.toml"), RIG).unwrap();
    done(at, &format!("simulate --rig rig.toml --effect {effect} --seconds 60 -o r.parquet"));
    done(at, "explain r.parquet --rig rig.toml --json e.json");
    let e = json(&at.join("e.json"));
    let effects = e["effects"].as_array().unwrap();
    assert!(effects.len() == 1 && e["verdict"] == "explained", "{effects:?}");
    let of = |key: &str| effects[0][key].as_f64().unwrap();
    let name = format!("{}@{}", effects[0]["id"].as_str().unwrap(), effects[0]["at"].as_str().unwrap());
    (name, of("value"), of("std_error"))
}

/// It acts on rail and rope alike: one name, not a constant force and a spring.
#[test]
fn a_tilted_frame_is_one_effect() {
    let (name, value, error) = found("frame-tilt@frame=0.005");
    assert_eq!(name, "frame-tilt@frame");
    assert!((value - 0.005).abs() < 4.0 * error && error < 1e-4, "{value} {error}");
}

/// The air that the load moves through brakes the trolley as well: one name, not a law in each joint.
#[test]
fn drag_on_a_load_is_one_effect() {
    let (name, value, error) = found("body-drag@load=0.08");
    assert_eq!(name, "body-drag@load");
    assert!((value - 0.08).abs() < 4.0 * error && error < 1e-4, "{value} {error}");
}
