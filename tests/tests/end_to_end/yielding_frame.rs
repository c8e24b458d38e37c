//! A stand on springs under a driven double pendulum, which the model has fixed: named with its
//! frequency, damping and direction. The plant is the simulator's with three degrees of freedom,
//! written apart from what explains it.

use core::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

use whirl_hil_sim::plant_oscillator::record;
use whirl_hil_sim::plant_yielding_frame::{Frame, rig};

use super::program::{done, json};

/// Chaotic from a release at rest, from the time at which the frame is at rest under the arms.
fn write(at: &Path, frame: Frame, seconds: usize) {
    let plant = rig(Some(frame));
    let carried = plant.arms.map(|a| a.mass).iter().sum::<f64>() * plant.g;
    let rest = -carried * frame.direction.sin() / (frame.mass * (TAU * frame.frequency_hz).powi(2));
    let motion = record(&plant, [1.9, -0.7, rest, 0.0, 0.0, 0.0], 0.002, 500 * seconds).unwrap();
    let mut text = "t,count1,count2\n".to_owned();
    for (i, y) in motion.iter().enumerate() {
        let count = |angle: f64| (angle / TAU * 4096.0).floor();
        writeln!(text, "{:.3},{},{}", i as f64 * 0.002, count(y[0]), count(y[1] - y[0])).unwrap();
    }
    std::fs::write(at.join("r.csv"), text).unwrap();
}

const RIG: &str = r#"name = "double pendulum on a stand"
model = "double-pendulum"
sample_rate_hz = 500.0
[nominal]
effects = ["viscous-friction@joint1", "viscous-friction@joint2"]
[drive]
direction = "vertical"
frequency_hz = 5.0
[[channel]]
name = "count1"
measures = "theta1"
unit = "count"
counts_per_turn = 4096
[[channel]]
name = "count2"
measures = "theta2"
unit = "count"
counts_per_turn = 4096
"#;

#[test]
fn a_stand_on_springs_is_named_with_its_frequency() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let frame = Frame { mass: 14.0, frequency_hz: 11.3, damping: 0.03, direction: 0.0 };
    write(at, frame, 40);
    std::fs::write(at.join("rig.toml"), RIG).unwrap();
    done(at, "explain r.csv --rig rig.toml --json e.json");
    let e = json(&at.join("e.json"));
    assert_eq!(e["verdict"], "explained", "{}", e["reason"]);
    assert_eq!(e["effects"].as_array().unwrap().len(), 1, "{}", e["effects"]);
    let f = &e["effects"][0];
    assert!(f["id"] == "resonator" && f["at"] == "frame", "{f}");
    let shape = |key: &str| f["parameters"][key].as_f64().unwrap();
    assert!((shape("f") / 11.3 - 1.0).abs() < 3e-3 && (shape("zeta") - 0.03).abs() < 3e-3, "{f}");
    assert!(shape("angle").sin().abs() < 0.03, "{f}");
    // Over the mass of all, times J_o1.
    let arms = rig(None).arms;
    let inertia = arms[0].inertia + arms[0].mass * arms[0].centroid.powi(2) + arms[1].mass * 0.0635_f64.powi(2);
    let [value, error] = ["value", "std_error"].map(|key| f[key].as_f64().unwrap());
    assert!((value - inertia / frame.mass).abs() < 4.0 * error && error < 0.02 * value, "{value} ± {error}");
}
