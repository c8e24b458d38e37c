//! The length of windows that is asked for.

use std::path::Path;

use serde_json::Value;
use whirl_tests::repository;

use super::program::{done, json};

/// Duffing's oscillator at 200 Hz, whose motion ends at 13 Hz.
fn explained(folder: &Path, effect: &str, options: &str) -> Value {
    let rig = repository("rigs/duffing.toml").display().to_string();
    done(folder, &format!("simulate --rig {rig} {effect} --seconds 60 --seed 6 -o r.csv --force"));
    done(folder, &format!("explain r.csv --rig {rig} {options} --json out.json --force"));
    json(&folder.join("out.json"))
}

/// Windows of a length that is given are those that decide; without it they are longer here.
#[test]
fn windows_have_the_length_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    for (options, length_s) in [("--window-s 1", 1.0), ("--window-s 2.5", 2.5)] {
        let out = explained(folder.path(), "--effect coulomb-friction@x=0.1", options);
        let found = out["details"]["window_s"].as_f64().unwrap();
        assert!((found - length_s).abs() < 0.01, "{options}: {found}");
        assert_eq!((&out["verdict"], &out["effects"][0]["id"]), (&"explained".into(), &"coulomb-friction".into()));
    }
}
