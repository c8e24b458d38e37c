//! Forces that no entry of the list is: never dressed up as one, however little they leave.

use std::path::Path;

use serde_json::Value;
use whirl_tests::repository;

use super::program::{done, json};

const LAWS: &str = r#"
[[effect]]
id = "one-sided"
at = "joint"
strengths = ["m"]
force = "-m*exp(2*x)"

[[effect]]
id = "magnet"
at = "joint"
strengths = ["m"]
force = "-m*x/(0.05 + x^2)^2"
"#;

/// Simulates Duffing's oscillator with an effect that only the simulation knows, and explains the
/// record.
fn explained(at: &Path, effect: &str) -> Value {
    let rig = std::fs::read_to_string(repository("rigs").join("duffing.toml")).unwrap();
    let rig = rig.replace("../models", &repository("models").display().to_string());
    std::fs::write(at.join("rig.toml"), &rig).unwrap();
    std::fs::write(at.join("laws.toml"), LAWS).unwrap();
    let with = rig.replacen("model = ", "effects = [\"laws.toml\"]\nmodel = ", 1);
    std::fs::write(at.join("with.toml"), with).unwrap();
    done(at, &format!("simulate --rig with.toml {effect} --seconds 60 --seed 5 -o r.csv --force"));
    done(at, "explain r.csv --rig rig.toml --json out.json --force");
    json(&at.join("out.json"))
}

#[test]
fn a_force_without_a_name_is_unexplained_at_its_place_even_where_the_gap_is_small() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for effect in ["--effect one-sided@x=0.05", "--effect magnet@x=0.001"] {
        let out = explained(at, effect);
        assert_eq!(out["verdict"], "unexplained", "{effect}: {}", out["reason"]);
        let gap = out["gap"]["steps"].as_array().unwrap().last().unwrap()["value"].as_f64().unwrap();
        assert!(gap < 1.3, "{effect}: the gap alone would not tell: {gap}");
        let unknown = &out["unknown"];
        assert_eq!((unknown["at"].as_str(), unknown["against"].as_str()), (Some("x"), Some("position of x")), "{out}");
    }
    let clean = explained(at, "");
    assert_eq!(clean["verdict"], "nothing-missing", "{}", clean["reason"]);
    // One value for the one sensor, whose noise is 0.1 mm.
    let [noise] = &clean["details"]["noise_rad"].as_array().unwrap()[..] else { panic!("{}", clean["details"]) };
    assert!((5e-5..2e-4).contains(&noise.as_f64().unwrap()), "{noise}");
    let by = &clean["decided_by"];
    assert!(by["limit"].as_f64().unwrap() < 1.31 && by["value"].as_f64() < by["limit"].as_f64(), "{by}");
}
