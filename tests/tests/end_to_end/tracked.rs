//! A pendulum filmed at 120 frames a second, as such records come: smoothed, with a mark that was
//! lost for a frame, let go by hand while the camera runs. The plant is written out here.

use std::fmt::Write;

use rand::{RngExt, SeedableRng};
use serde_json::Value;

use super::program::{json, whirl};

const RATE_HZ: f64 = 120.0;
/// Gravity and friction over the inertia.
const GRAVITY: f64 = 41.923;
const VISCOUS: f64 = 0.0678;
const RIG: &str = "name = \"tracked\"\nmodel = \"single-pendulum\"\n[[channel]]\nname = \"angle_deg\"\nmeasures = \"theta1\"\nunit = \"deg\"\n";

/// A further acceleration by angle and rate, beside gravity and viscous friction.
type Law = fn(f64, f64) -> f64;

/// Angles of 20 s, deg, without noise; a hand holds and drags the pendulum for so many seconds.
fn motion(law: Law, hand_s: f64) -> Vec<f64> {
    let acceleration = |x: f64, v: f64| -GRAVITY * x.sin() - VISCOUS * v + law(x, v);
    let (mut x, mut v) = (1.75_f64, 0.0_f64);
    let h = 1.0 / (RATE_HZ * 50.0);
    let mut out = Vec::new();
    for i in 0..(20.0 * RATE_HZ) as usize {
        out.push(x.to_degrees());
        for k in 0..50 {
            if (i * 50 + k) as f64 * h < hand_s {
                // It is drawn out a little more, and let go.
                v = 0.3 * (1.0 - ((i * 50 + k) as f64 * h / hand_s - 0.5).abs());
                x += h * v;
                continue;
            }
            let half = v + 0.5 * h * acceleration(x, v);
            let middle = acceleration(x + 0.5 * h * v, half);
            (x, v) = (x + h * half, v + h * middle);
        }
    }
    out
}

/// The same with noise of 0.05°.
fn seen(angles: &[f64], seed: u64) -> Vec<f64> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
    angles.iter().map(|x| x + 0.05 * normal()).collect()
}

/// A running parabola over eleven frames (Savitzky and Golay 1964).
fn smoothed(x: &[f64]) -> Vec<f64> {
    const WEIGHTS: [f64; 11] = [-36.0, 9.0, 44.0, 69.0, 84.0, 89.0, 84.0, 69.0, 44.0, 9.0, -36.0];
    x.windows(11).map(|w| w.iter().zip(WEIGHTS).map(|(x, w)| x * w).sum::<f64>() / 429.0).collect()
}

/// What `explain` says of it, with status 0.
fn explained(angles: &[f64]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let mut text = "t,angle_deg\n".to_owned();
    for (i, x) in angles.iter().enumerate() {
        writeln!(text, "{:.5},{x:.4}", i as f64 / RATE_HZ).unwrap();
    }
    std::fs::write(folder.path().join("r.csv"), text).unwrap();
    std::fs::write(folder.path().join("rig.toml"), RIG).unwrap();
    let run = whirl(folder.path(), "explain r.csv --rig rig.toml --json e.json");
    assert!(run.status < 2, "{run:?}");
    json(&folder.path().join("e.json"))
}

fn warned(found: &Value, id: &str) -> Option<Value> {
    found["warnings"].as_array().unwrap().iter().find(|w| w["id"] == id).cloned()
}

/// Gravity and friction within four standard errors.
fn right(found: &Value) {
    for (name, truth) in [("q_sin", GRAVITY), ("c_r", VISCOUS)] {
        let own = found["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
        let (value, error) = (own["value"].as_f64().unwrap(), own["std_error"].as_f64().unwrap());
        assert!((value - truth).abs() < 4.0 * error, "{name}: {value} ± {error}, {truth}");
    }
}

#[test]
fn what_a_filter_left_of_the_noise_is_the_noise() {
    let clean = explained(&smoothed(&seen(&motion(|_, _| 0.0, 0.0), 1)));
    assert_eq!(clean["verdict"], "nothing-missing", "{clean}");
    let told = warned(&clean, "smoothed").unwrap();
    // A third of the band is left of 0.05°.
    let (noise, corner_hz) = (told["value"].as_f64().unwrap(), told["corner_hz"].as_f64().unwrap());
    assert!((0.02..0.035).contains(&noise) && (8.0..22.0).contains(&corner_hz), "{told}");
    right(&clean);
    let dry = explained(&smoothed(&seen(&motion(|_, v| -0.17 * v.signum(), 0.0), 2)));
    assert_eq!((&dry["verdict"], &dry["effects"][0]["id"]), (&"explained".into(), &"coulomb-friction".into()), "{dry}");
    assert!(warned(&dry, "smoothed").is_some());
    // As it was seen there is nothing to be said of a filter.
    assert!(warned(&explained(&seen(&motion(|_, _| 0.0, 0.0), 1)), "smoothed").is_none());
}

/// A magnet below the pivot, which the list does not have, is not taken for noise.
#[test]
fn what_has_no_name_is_not_taken_for_the_noise_of_a_smoothed_record() {
    let magnet: Law = |x, _| -3.0 * x / (0.01 + x * x).powi(2) * 1e-3;
    let found = explained(&smoothed(&seen(&motion(magnet, 0.0), 3)));
    assert!(found["verdict"] != "nothing-missing", "{found}");
}

#[test]
fn a_mark_that_was_lost_for_a_frame_decides_nothing() {
    let mut angles = seen(&motion(|_, _| 0.0, 0.0), 4);
    angles[583] += 1.2;
    let found = explained(&angles);
    assert_eq!(found["verdict"], "nothing-missing", "{found}");
    let told = warned(&found, "spike").unwrap();
    assert_eq!((&told["row"], &told["left_out"]), (&585.into(), &1.into()), "{told}");
    assert!((told["value"].as_f64().unwrap() - 1.2).abs() < 0.2, "{told}");
    right(&found);
}

#[test]
fn a_hand_in_the_first_frames_decides_nothing() {
    let found = explained(&seen(&motion(|_, _| 0.0, 0.2), 5));
    assert_eq!(found["verdict"], "nothing-missing", "{found}");
    right(&found);
}
