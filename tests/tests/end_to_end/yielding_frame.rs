//! A stand on springs under a driven pendulum, which the model has fixed: named with its frequency,
//! damping and direction. The plant is the simulator's with three degrees of freedom, written apart
//! from what explains it; its second arm weighs nothing.

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

/// Chaotic from a release at rest.
fn write(at: &Path, plant: &YieldingFrame, seconds: usize) {
    let motion = record(plant, [1.9, -0.7, 0.0, 0.0, 0.0, 0.0], 0.002, 500 * seconds).unwrap();
    let mut text = "t,count1\n".to_owned();
    for (i, y) in motion.iter().enumerate() {
        writeln!(text, "{:.3},{}", i as f64 * 0.002, (y[0] / TAU * 4096.0).floor()).unwrap();
    }
    std::fs::write(at.join("r.csv"), text).unwrap();
}

#[test]
fn a_stand_on_springs_is_named_with_its_frequency() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let frame = Frame { mass: 5.0, frequency_hz: 9.1, damping: 0.03, direction: 0.0 };
    let arm = Arm { mass: 0.15, centroid: 0.05, inertia: 1e-4 };
    let nothing = Arm { mass: 1e-12, centroid: 0.01, inertia: 1.0 };
    let drive = [0.03, TAU * 3.2];
    let plant = YieldingFrame { arms: [arm, nothing], viscous: [6e-5, 0.0], drive, ..rig(Some(frame)) };
    write(at, &plant, 30);
    std::fs::write(at.join("rig.toml"), RIG).unwrap();
    std::fs::write(at.join("pendulum.toml"), SYSTEM).unwrap();
    done(at, "explain r.csv --rig rig.toml --json e.json");
    let e = json(&at.join("e.json"));
    assert_eq!(e["verdict"], "explained", "{}", e["reason"]);
    assert_eq!(e["effects"].as_array().unwrap().len(), 1, "{}", e["effects"]);
    let f = &e["effects"][0];
    assert!(f["id"] == "resonator" && f["at"] == "frame", "{f}");
    let shape = |key: &str| f["parameters"][key].as_f64().unwrap();
    assert!((shape("f") / 9.1 - 1.0).abs() < 1e-3 && (shape("zeta") - 0.03).abs() < 1e-3, "{f}");
    assert!(shape("angle").sin().abs() < 0.01, "{f}");
    // Over the mass of all, times the inertia about the joint.
    let truth = (arm.inertia + arm.mass * arm.centroid.powi(2)) / frame.mass;
    let [value, error] = ["value", "std_error"].map(|key| f[key].as_f64().unwrap());
    assert!((value - truth).abs() < 4.0 * error && error < 0.01 * value, "{value} ± {error} for {truth}");
}
