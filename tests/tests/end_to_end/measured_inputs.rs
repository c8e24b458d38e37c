//! Records of measured inputs: an input of the wrong sign, a term that is missing, an input's noise.

use std::path::Path;

use serde_json::Value;
use whirl_tests::repository;

use super::program::{done, json, rig_file, whirl};

/// Status and warnings of a command on `r.csv`.
fn warned(folder: &Path, command: &str, rig: &str) -> (i32, Vec<Value>) {
    let run = whirl(folder, &format!("{command} r.csv --rig {rig} --json out.json --force"));
    (run.status, json(&folder.join("out.json"))["warnings"].as_array().unwrap().clone())
}

/// The record again with one column negated.
fn negated(folder: &Path, name: &str) {
    let text = std::fs::read_to_string(folder.join("r.csv")).unwrap();
    let mut lines = text.lines();
    let head = lines.next().unwrap();
    let column = head.split(',').position(|n| n == name).unwrap();
    let row = |line: &str| {
        let of =
            |(k, x): (usize, &str)| if k == column { (-x.parse::<f64>().unwrap()).to_string() } else { x.to_owned() };
        line.split(',').enumerate().map(of).collect::<Vec<_>>().join(",")
    };
    let rows: Vec<String> = std::iter::once(head.to_owned()).chain(lines.map(row)).collect();
    std::fs::write(folder.join("r.csv"), rows.join("\n") + "\n").unwrap();
}

/// Equations written with the force for their balance, and a system from bodies.
#[test]
fn a_measured_input_of_the_wrong_sign_is_named() {
    for (rig, input) in [("duffing.toml", "force"), ("rotary-pendulum.toml", "current")] {
        let folder = tempfile::tempdir().unwrap();
        let rig = repository("rigs").join(rig).display().to_string();
        done(folder.path(), &format!("simulate --rig {rig} --seconds 20 --seed 3 -o r.csv"));
        negated(folder.path(), input);
        for command in ["inspect", "identify", "explain"] {
            let (status, warnings) = warned(folder.path(), command, &rig);
            let named = warnings.iter().find(|w| w["id"] == "sign-reversed");
            let named = named.unwrap_or_else(|| panic!("{command}: {warnings:?}"));
            assert_eq!((status, &named["channels"]), (1, &serde_json::json!([input])), "{command}");
        }
    }
}

#[test]
fn a_term_that_is_missing_under_a_measured_force_is_no_answer() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let rig = repository("rigs").join("duffing.toml").display().to_string();
    done(at, &format!("simulate --rig {rig} --seconds 25 --seed 3 -o r.csv"));
    for method in ["weak", "shooting"] {
        let (status, warnings) = warned(at, &format!("identify --method {method}"), &rig);
        assert!(status == 0 && warnings.iter().all(|w| w["id"] == "few-windows"), "{warnings:?}");
    }
    let model = std::fs::read_to_string(repository("models/duffing.toml")).unwrap();
    std::fs::write(at.join("model.toml"), model.replace("c = \"x'\", ", "")).unwrap();
    rig_file(at, "duffing.toml", "rig.toml", &[("../models/duffing.toml", "model.toml")]);
    for (method, id) in [("weak", "model-misses-something"), ("shooting", "more-than-noise")] {
        let (status, warnings) = warned(at, &format!("identify --method {method}"), "rig.toml");
        let found = warnings.iter().find(|w| w["id"] == id);
        assert!(status == 1 && found.is_some_and(|w| w["invalidates"] == true), "{method}: {warnings:?}");
    }
}

/// Noise of the force, and a friction that sticks: both are in what the sensors explain.
#[test]
fn the_noise_of_a_force_is_expected() {
    let folder = tempfile::tempdir().unwrap();
    let rig = repository("rigs").join("emps.toml").display().to_string();
    for seed in [1, 3] {
        done(folder.path(), &format!("simulate --rig {rig} --seconds 25 --seed {seed} -o r.csv --force"));
        let (status, warnings) = warned(folder.path(), "identify --method weak", &rig);
        assert!(status == 0 && warnings.iter().all(|w| w["id"] != "model-misses-something"), "{warnings:?}");
        let found = json(&folder.path().join("out.json"));
        let ratio = found["details"]["residual_over_noise"].as_f64().unwrap();
        assert!(ratio > 0.5 && ratio < 5.0, "{seed}: {ratio}");
    }
}

/// It goes through the system and adds up over long pieces as what a model misses does, which a
/// faint friction still does beside less of it.
#[test]
fn the_noise_of_a_measured_force_is_nothing_that_the_model_misses() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let model = repository("models/duffing.toml").display().to_string();
    let friction = " --effect coulomb-friction@x=0.0005";
    for (noise, effect, seed) in [(0.004, "", 1), (0.004, "", 3), (0.001, friction, 1)] {
        let noisy = format!("noise = {{ x = 1e-4, force = {noise} }}");
        let mended = [("noise = { x = 1e-4 }", noisy.as_str()), ("../models/duffing.toml", &model)];
        rig_file(at, "duffing.toml", "rig.toml", &mended);
        done(at, &format!("simulate --rig rig.toml --seconds 100 --seed {seed} -o r.csv --force{effect}"));
        let (_, warnings) = warned(at, "identify", "rig.toml");
        let is_told = warnings.iter().any(|w| w["id"] == "misses-over-long");
        assert_eq!(is_told, !effect.is_empty(), "{effect} {seed}: {warnings:?}");
    }
}
