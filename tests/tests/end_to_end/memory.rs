//! Effects with states: hidden, named with their values, written, read again; what is simpler is
//! named where it does as well.

use std::path::Path;

use serde_json::Value;
use whirl_tests::repository;

use super::program::{done, json, whirl};

fn rig(name: &str) -> String {
    repository("rigs").join(name).display().to_string()
}

/// Simulates a rig with an effect and explains the record; the JSON.
fn explained(folder: &Path, rig: &str, effect: &str, seconds: u32, seed: u32) -> Value {
    done(folder, &format!("simulate --rig {rig} {effect} --seconds {seconds} --seed {seed} -o r.csv --force"));
    done(folder, &format!("explain r.csv --rig {rig} --json out.json -o model.toml --force"));
    json(&folder.join("out.json"))
}

fn names(out: &Value) -> Vec<String> {
    let list = out["effects"].as_array().unwrap();
    list.iter().map(|e| format!("{}@{}", e["id"].as_str().unwrap(), e["at"].as_str().unwrap())).collect()
}

/// Value within three standard errors and a share of the truth, and the state's distance within a
/// share of its own.
fn close(out: &Value, value: f64, d: f64) {
    let e = &out["effects"][0];
    let (found, error) = (e["value"].as_f64().unwrap(), e["std_error"].as_f64().unwrap());
    assert!((found - value).abs() < 3.0 * error && error < 0.05 * value, "{e}");
    assert!((e["parameters"]["d"].as_f64().unwrap() / d - 1.0).abs() < 0.3, "{e}");
}

/// Dahl's friction on an oscillator of written equations: named, written, taken again, simulated
/// from the file; what cannot follow it says so.
#[test]
fn dahls_friction_on_an_oscillator_is_named_written_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rig = rig("duffing.toml");
    let out = explained(folder, &rig, "--effect dahl-friction@x=1.5,d=0.05", 60, 3);
    assert_eq!(names(&out), ["dahl-friction@x"], "{}", out["gap"]);
    assert_eq!(out["effects"][0]["unit"], "N");
    close(&out, 1.5, 0.05);
    // Its free run follows the state by itself.
    let steps = out["simulation"][0]["steps"].as_array().unwrap();
    assert!(steps.last().unwrap()["value"].as_f64().unwrap() < 1e-3, "{steps:?}");
    done(folder, &format!("explain r.csv --rig {rig} --model model.toml --json again.json"));
    let again = json(&folder.join("again.json"));
    assert_eq!(again["verdict"], "nothing-missing", "{} {}", again["reason"], again["gap"]);
    done(folder, &format!("simulate --model model.toml --rig {rig} --seconds 2 -o free.csv"));
    for command in ["export model.toml --to python -o m.py", "validate r.csv --model model.toml"] {
        let run = whirl(folder, &format!("{command} --rig {rig}"));
        assert!(run.status == 2 && run.stderr.contains("states of its own"), "{command}: {run:?}");
    }
}

/// A magnet whose reach lies between those that are tried: no grid is fine enough.
#[test]
fn a_magnet_that_reaches_farther_than_the_grid_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig("single-pendulum.toml");
    let out = explained(folder.path(), &rig, "--effect local-force@joint1=-0.01,x0=-2,d=0.55", 60, 1);
    assert_eq!((&out["verdict"], names(&out)), (&Value::from("explained"), vec!["local-force@joint1".to_owned()]));
    let (e, of) = (&out["effects"][0], |name: &str| out["effects"][0]["parameters"][name].as_f64().unwrap());
    let (found, error) = (e["value"].as_f64().unwrap(), e["std_error"].as_f64().unwrap());
    assert!((found + 0.01).abs() < 3.0 * error && error < 1e-4, "{e}");
    assert!((of("d") - 0.55).abs() < 0.01 && (of("x0") + 2.0).abs() < 0.01, "{e}");
    // It is told once, in one unit.
    let told = out["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "local-force@joint1");
    assert_eq!(told.unwrap()["value"], e["value"]);
}

/// A cart with a pendulum, from bodies; with a known mass values are physical.
const CART: &str = r#"
name = "cart"
model = "cart-pendulum"
sample_rate_hz = 200.0
channel = [
    { name = "x", measures = "x", unit = "mm" },
    { name = "theta", measures = "theta", unit = "count", counts_per_turn = 4096 },
    { name = "force", measures = "force", unit = "N" },
]
[plant]
M = 1.0
m = 0.2
e = 0.3
J = 0.024
k = 20.0
g = 9.81
"viscous-friction@rail" = 0.8
"viscous-friction@pivot" = 0.0012
initial = [0.0, 0.4, 0.0, 0.0]
noise = { x = 0.02 }
settle_s = 5.0
input.force = [{ kind = "random", rms = 4.0, from_hz = 0.2, to_hz = 3.0 }]
"#;

#[test]
fn dahls_friction_in_a_system_of_bodies_is_named() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cart.toml"), CART).unwrap();
    let out = explained(folder.path(), "cart.toml", "--effect dahl-friction@pivot=0.02,d=0.1", 60, 7);
    assert_eq!(names(&out), ["dahl-friction@pivot"], "{}", out["gap"]);
    assert_eq!(out["effects"][0]["unit"], "N m");
    close(&out, 0.02, 0.1);
}

/// A spring that relaxes, one that yields, and a tone whose frequency nobody told: each named with
/// its value and its shape.
#[test]
fn springs_that_remember_and_a_tone_are_named_with_their_shapes() {
    let folder = tempfile::tempdir().unwrap();
    for (name, value, shapes) in [
        ("relaxation@x", 3.0, &[("T_r", 0.1)][..]),
        ("hysteresis@x", 5.0, &[("b", 3.0), ("c", 0.3)]),
        ("tone@x", 0.3, &[("f", 2.73), ("psi", 0.4)]),
    ] {
        let all: Vec<String> = shapes.iter().map(|(n, x)| format!("{n}={x}")).collect();
        let effect = format!("--effect {name}={value},{}", all.join(","));
        let out = explained(folder.path(), &rig("duffing.toml"), &effect, 60, 6);
        assert_eq!(
            (names(&out), out["verdict"].as_str()),
            (vec![name.to_owned()], Some("explained")),
            "{}",
            out["reason"]
        );
        let e = &out["effects"][0];
        let (found, error) = (e["value"].as_f64().unwrap(), e["std_error"].as_f64().unwrap());
        // A tone's standard error is half of what it scatters by over eight seeds.
        assert!((found - value).abs() < f64::max(4.0 * error, 0.01 * value) && error < 0.01 * value, "{e}");
        for (n, x) in shapes {
            assert!((e["parameters"][n].as_f64().unwrap() / x - 1.0).abs() < 0.02, "{e}");
        }
    }
}

/// A spring that yields far within the motion is nearly Dahl's friction, which is tried first; the
/// spring takes its place with both shapes.
#[test]
fn a_spring_that_yields_early_takes_the_place_of_friction() {
    let folder = tempfile::tempdir().unwrap();
    for (b, c) in [(3.0, 0.8), (12.0, 0.3)] {
        let out =
            explained(folder.path(), &rig("duffing.toml"), &format!("--effect hysteresis@x=20,b={b},c={c}"), 60, 1);
        let verdict = (names(&out), out["verdict"].as_str());
        assert_eq!(verdict, (vec!["hysteresis@x".to_owned()], Some("explained")), "{}", out["reason"]);
        let e = &out["effects"][0];
        let (found, error) = (e["value"].as_f64().unwrap(), e["std_error"].as_f64().unwrap());
        assert!((found - 20.0).abs() < 4.0 * error && error < 0.01, "{e}");
        for (name, x) in [("b", b), ("c", c)] {
            assert!((e["parameters"][name].as_f64().unwrap() / x - 1.0).abs() < 0.01, "{e}");
        }
    }
}

/// A distance far below what the sensor resolves is Coulomb's friction to the record: one is named,
/// with the other listed as not told apart, or both share the level. Coulomb's own stays what it
/// is.
#[test]
fn what_follows_a_reversal_at_once_is_not_told_from_coulombs_friction() {
    let folder = tempfile::tempdir().unwrap();
    for (effect, alone) in [("dahl-friction@x=0.8,d=1e-5", false), ("coulomb-friction@x=0.8", true)] {
        let out = explained(folder.path(), &rig("duffing.toml"), &format!("--effect {effect}"), 60, 3);
        let found = names(&out);
        let e = &out["effects"][0];
        let twins = e["indistinguishable_from"].as_array().unwrap();
        let coulomb = "coulomb-friction@x";
        let one = found.len() == 1 && twins.iter().any(|t| t == coulomb);
        let shared = found == [coulomb, "dahl-friction@x"];
        assert!(found == [coulomb] || !alone && (one || shared), "{effect}: {found:?} {twins:?} {}", out["gap"]);
        let level: f64 = out["effects"].as_array().unwrap().iter().map(|e| e["value"].as_f64().unwrap()).sum();
        assert!((level / 0.8 - 1.0).abs() < 0.01, "{e}");
    } // One too short to be followed is refused.
    let rig = rig("duffing.toml");
    let run =
        whirl(folder.path(), &format!("simulate --rig {rig} --effect dahl-friction@x=0.8,d=1e-9 --seconds 5 -o s.csv"));
    assert!(run.status == 2 && run.stderr.contains("states of effects must take more than"), "{run:?}");
}

/// A sample that stands alone between missing ones has a state as well.
#[test]
fn a_sample_alone_between_missing_ones_is_no_stretch_to_stumble_over() {
    let folder = tempfile::tempdir().unwrap();
    let (at, rig) = (folder.path(), rig("duffing.toml"));
    done(at, &format!("simulate --rig {rig} --seconds 30 --seed 4 -o whole.csv"));
    let text = std::fs::read_to_string(at.join("whole.csv")).unwrap();
    let first = text.lines().position(|l| l.starts_with(|c: char| c.is_ascii_digit())).unwrap();
    let gone = |i: usize| [first + 1000, first + 1002].contains(&i);
    let kept: Vec<&str> = text.lines().enumerate().filter(|(i, _)| !gone(*i)).map(|l| l.1).collect();
    std::fs::write(at.join("r.csv"), kept.join("\n") + "\n").unwrap();
    done(at, &format!("explain r.csv --rig {rig} --json out.json"));
    assert_eq!(json(&at.join("out.json"))["verdict"], "nothing-missing");
}
