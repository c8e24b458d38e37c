//! A stand on springs under a pendulum, which the model has fixed: named with its frequency, damping
//! and direction, where it rings under a driven one and where it only gives way under a free one.
//! The plant is the simulator's with three degrees of freedom, written apart from what explains it;
//! its second arm weighs nothing.

use core::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

use whirl_hil_sim::plant_oscillator::record;
use whirl_hil_sim::plant_yielding_frame::{Arm, Frame, YieldingFrame, rig};

use super::program::{done, json};

const SYSTEM: &str = include_str!("../../../host/src/system/library/single-pendulum.toml");
const RIG: &str = r#"name = "pendulum on a stand"
model = "pendulum.toml"
sample_rate_hz = 500.0
[drive]
direction = "vertical"
frequency_hz = 3.2
[[channel]]
name = "count1"
measures = "theta1"
unit = "count"
counts_per_turn = 4096
"#;

const HEAVY: &str = r#"name = "heavy pendulum"
coordinates = { phi = "angle" }
gravity = "down"
parameters = { m = "kg", e = "m", J = "kg m^2" }
[points]
axis = "[0, 0]"
[[body]]
name = "bob"
from = "axis"
angle = "phi"
mass = "m"
centroid = "e"
inertia = "J"
[[joint]]
name = "bearing"
at = "axis"
moves = "phi"
[nominal]
effects = ["viscous-friction@bearing"]
"#;
const FREE: &str = r#"name = "heavy pendulum on a stand"
model = "pendulum.toml"
sample_rate_hz = 200.0
[known]
m = 5.0
e = 0.25
[[channel]]
name = "count1"
measures = "phi"
unit = "count"
counts_per_turn = 20000
"#;

/// Counts of the first arm in a file, from angles of both arms at rest.
fn write(at: &Path, plant: &YieldingFrame, from: [f64; 2], (step_s, samples, turn): (f64, usize, f64)) {
    let motion = record(plant, [from[0], from[1], 0.0, 0.0, 0.0, 0.0], step_s, samples).unwrap();
    let mut text = "t,count1\n".to_owned();
    for (i, y) in motion.iter().enumerate() {
        writeln!(text, "{:.3},{}", i as f64 * step_s, (y[0] / TAU * turn).floor()).unwrap();
    }
    std::fs::write(at.join("r.csv"), text).unwrap();
}

/// The one effect that explains the record, the resonator of the frame: its value and standard
/// error.
fn resonator(at: &Path, [rig, system]: [&str; 2], frame: &Frame) -> [f64; 2] {
    std::fs::write(at.join("rig.toml"), rig).unwrap();
    std::fs::write(at.join("pendulum.toml"), system).unwrap();
    done(at, "explain r.csv --rig rig.toml --json e.json");
    let e = json(&at.join("e.json"));
    assert_eq!(e["verdict"], "explained", "{}", e["reason"]);
    assert_eq!(e["effects"].as_array().unwrap().len(), 1, "{}", e["effects"]);
    let f = &e["effects"][0];
    assert!(f["id"] == "resonator" && f["at"] == "frame", "{f}");
    let shape = |key: &str| f["parameters"][key].as_f64().unwrap();
    assert!((shape("f") / frame.frequency_hz - 1.0).abs() < 1e-3, "{f}");
    assert!((shape("zeta") - frame.damping).abs() < 1e-3 && shape("angle").sin().abs() < 0.01, "{f}");
    ["value", "std_error"].map(|key| f[key].as_f64().unwrap())
}

/// Chaotic from a release at rest.
#[test]
fn a_stand_on_springs_is_named_with_its_frequency() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let frame = Frame { mass: 5.0, frequency_hz: 9.1, damping: 0.03, direction: 0.0 };
    let arm = Arm { mass: 0.15, centroid: 0.05, inertia: 1e-4 };
    let nothing = Arm { mass: 1e-12, centroid: 0.01, inertia: 1.0 };
    let drive = [0.03, TAU * 3.2];
    let plant = YieldingFrame { arms: [arm, nothing], viscous: [6e-5, 0.0], drive, ..rig(Some(frame)) };
    write(at, &plant, [1.9, -0.7], (0.002, 15_000, 4096.0));
    let [value, error] = resonator(at, [RIG, SYSTEM], &frame);
    // Over the mass of all, times the inertia about the joint.
    let truth = (arm.inertia + arm.mass * arm.centroid.powi(2)) / frame.mass;
    assert!((value - truth).abs() < 4.0 * error && error < 0.01 * value, "{value} ± {error} for {truth}");
}

/// 60 kg on springs of 5 Hz under 5 kg that swing slower than 1 Hz: what is left has the lines of
/// the motion, and none at 5 Hz.
#[test]
fn a_stand_that_gives_way_under_a_free_swing_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (m, e, about_joint) = (5.0, 0.25, 0.36);
    let frame = Frame { mass: 65.0, frequency_hz: 5.0, damping: 0.01, direction: 0.0 };
    let arm = Arm { mass: m, centroid: e, inertia: about_joint - m * e * e };
    let nothing = Arm { mass: 1e-12, centroid: 0.01, inertia: 1.0 };
    let plant = YieldingFrame { arms: [arm, nothing], viscous: [0.01, 0.0], drive: [0.0, 1.0], ..rig(Some(frame)) };
    write(at, &plant, [2.2, 0.0], (0.005, 8000, 20_000.0));
    let [value, error] = resonator(at, [FREE, HEAVY], &frame);
    assert!((value - 1.0 / frame.mass).abs() < 4.0 * error && error < 0.01 * value, "{value} ± {error}");
}
