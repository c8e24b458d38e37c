//! What a record contradicts is named, and the exit status says whether the answer stands: one a
//! line.

use std::path::Path;
use std::sync::OnceLock;

use super::own_systems::rig;
use super::program::{done, json, rig_file, whirl};

/// A minute of the chaotic rig: `base.csv`, and with changes to it.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    FOLDER.get_or_init(made).path()
}

fn made() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[]);
    done(at, "simulate --rig rig.toml --seconds 60 --seed 1 -o base.csv");
    let text = std::fs::read_to_string(at.join("base.csv")).unwrap();
    let rows: Vec<[&str; 3]> = text.lines().map(|l| *l.split(',').collect::<Vec<_>>().first_chunk().unwrap()).collect();
    let write = |name: &str, row: &dyn Fn(usize) -> String| {
        let all: Vec<String> = (0..rows.len()).map(|i| if i == 0 { rows[0].join(",") } else { row(i) }).collect();
        std::fs::write(at.join(name), all.join("\n") + "\n").unwrap();
    };
    write("dead.csv", &|i| [rows[i][0], rows[i][1], "0"].join(","));
    write("reversed.csv", &|i| [rows[i][0], rows[rows.len() - i][1], rows[rows.len() - i][2]].join(","));
    folder
}

/// Runs `identify` and checks its status and that it warns of just the ids that are named, of those
/// that are judged here.
fn identified(at: &Path, arguments: &str, status: i32, ids: &[&str]) {
    // Tests run side by side.
    let out = format!("{}.json", arguments.replace([' ', '.'], ""));
    let run = whirl(at, &format!("identify {arguments} --json {out}"));
    assert_eq!(run.status, status, "{arguments}: {run:?}");
    let warnings = json(&at.join(out))["warnings"].as_array().unwrap().clone();
    let judged = [
        "negative-damping",
        "negative-inertia",
        "negative-gravity",
        "negative-quantity",
        "tie-violated",
        "known-contradicted",
        "model-misses-something",
    ];
    let found: Vec<&str> =
        warnings.iter().map(|w| w["id"].as_str().unwrap()).filter(|id| judged.contains(id)).collect();
    for id in ids {
        assert!(found.contains(id), "{arguments}: no {id} in {found:?}");
    }
    assert_eq!(found.is_empty(), ids.is_empty(), "{arguments}: {found:?}");
}

/// One test a row: a record, what is changed in the rig file, the status and the ids.
macro_rules! contradictions {
    ($($name:ident: $record:literal, $changes:expr => $status:literal, $ids:expr;)+) => {$(
        #[test]
        fn $name() {
            let rig = concat!(stringify!($name), ".toml");
            rig_file(folder(), "chaotic.toml", rig, &$changes);
            identified(folder(), concat!($record, " --rig ", stringify!($name), ".toml"), $status, &$ids);
        }
    )+};
}

contradictions! {
    a_good_record: "base.csv", [] => 0, [];
    time_reversed: "reversed.csv", [] => 1, ["negative-damping"];
    // Of a dead channel nothing is said but that.
    a_dead_channel: "dead.csv", [] => 1, [];
    a_length_of_2_per_cent_more: "base.csv", [("l1 = 0.0635", "l1 = 0.06477")] => 1, ["known-contradicted"];
    a_length_in_millimetres: "base.csv", [("l1 = 0.0635", "l1 = 63.5")] => 1, ["known-contradicted"];
    a_thousand_times_the_mass: "base.csv", [("m2 = 0.040", "m2 = 40.0")] => 1, ["known-contradicted"];
    a_thousand_times_the_first_mass: "base.csv", [("[known]", "[known]\nm1 = 136.2\ne1 = 0.0127")] => 1, ["known-contradicted"];
    more_that_is_known_and_right: "base.csv", [("[known]", "[known]\nm1 = 0.1362\ne1 = 0.0127")] => 0, [];
}

#[test]
fn of_a_dead_channel_explain_says_that_alone() {
    let at = folder();
    let run = whirl(at, "explain dead.csv --rig rig.toml --json e.json");
    let e = json(&at.join("e.json"));
    assert_eq!((run.status, e["verdict"].as_str()), (1, Some("not-decidable")), "{run:?}");
    assert!(e["effects"].as_array().unwrap().is_empty() && !run.stdout.contains("NaN"), "{}", run.stdout);
    let ids: Vec<&str> = e["warnings"].as_array().unwrap().iter().map(|w| w["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["dead-channel"]);
}

#[test]
fn inspect_names_a_length_that_the_record_contradicts() {
    let at = folder();
    rig_file(at, "chaotic.toml", "longer.toml", &[("l1 = 0.0635", "l1 = 0.06477")]);
    let run = whirl(at, "inspect base.csv --rig longer.toml");
    assert!(run.status == 1 && run.stderr.contains("instead of 64.77 mm"), "{run:?}");
}

#[test]
fn a_drag_violates_ties() {
    let at = folder();
    done(at, "simulate --rig rig.toml --seconds 60 --seed 1 --effect quadratic-drag@arm2=1e-6 -o drag.csv");
    identified(at, "drag.csv --rig rig.toml", 1, &["tie-violated"]);
}

/// A model that is handed in and explodes: no number of it is told, and what is found from there is
/// what was hidden.
#[test]
fn a_model_that_diverges_has_no_gap() {
    let at = folder();
    done(at, "identify base.csv --rig rig.toml -o model.toml");
    let text = std::fs::read_to_string(at.join("model.toml")).unwrap();
    let line = text.lines().find(|l| l.trim_start().starts_with("C2 ") || l.contains("\"C2\"")).unwrap().to_owned();
    let value = number_in(&line);
    std::fs::write(at.join("explodes.toml"), text.replace(&line, &line.replace(&value, "-40.0"))).unwrap();
    let run = whirl(at, "explain base.csv --rig rig.toml --model explodes.toml --json diverged.json");
    assert!(run.status < 2 && !run.stdout.contains("NaN") && !run.stdout.contains(" inf "), "{run:?}");
    let out = json(&at.join("diverged.json"));
    let steps = out["gap"]["steps"].as_array().unwrap();
    assert!(steps.iter().all(|s| s["value"].as_f64().is_some_and(|v| v < 1e4)), "{steps:?}");
    let told = out["warnings"].as_array().unwrap().iter().any(|w| w["id"] == "diverged");
    assert!(told || out["verdict"] == "not-decidable", "{out}");
    assert_ne!(out["verdict"], "explained");
}

/// The first number behind an equals sign, as it stands.
fn number_in(line: &str) -> String {
    let behind = line.split_once("value =").or_else(|| line.split_once('=')).unwrap().1.trim_start();
    behind.chars().take_while(|c| c.is_ascii_digit() || "+-.e".contains(*c)).collect()
}

#[test]
fn an_explained_model_is_taken_by_explain_and_validate() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[]);
    // A drift is told over the record's length, wherever its times begin. One record of a hundred has
    // sections that its model's own have by chance only: that of seed 1 is one.
    done(at, "simulate --rig rig.toml --seconds 24 --seed 2 --effect amplitude-drift@drive=0.1 -o drift.parquet");
    done(at, "explain drift.parquet --rig rig.toml -o drift.toml");
    let text = done(at, "validate drift.parquet --rig rig.toml --model drift.toml --json v.json");
    let median = json(&at.join("v.json"))["horizon"]["measured"]["quantiles_s"][2].as_f64().unwrap();
    assert!(median > 1.0, "{text}");
    done(at, "explain drift.parquet --rig rig.toml --model drift.toml");
}

/// A motion that is not chaotic is followed to its end whatever the model misses: what predictions
/// miss tells.
#[test]
fn a_model_without_a_friction_fails_its_validation_and_one_with_it_passes() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let rig = rig("duffing.toml");
    done(at, &format!("simulate --rig {rig} --seconds 40 --seed 1 --effect coulomb-friction@x=1.0 -o r.parquet"));
    assert_eq!(whirl(at, &format!("identify r.parquet --rig {rig} -o poor.toml")).status, 1);
    done(at, &format!("explain r.parquet --rig {rig} -o good.toml"));
    for (model, status, passed) in [("poor", 1, false), ("good", 0, true)] {
        let run = whirl(at, &format!("validate r.parquet --rig {rig} --model {model}.toml --json v.json"));
        assert_eq!(run.status, status, "{run:?}");
        let checks = json(&at.join("v.json"))["checks"].clone();
        let check = checks.as_array().unwrap().iter().find(|c| c["name"] == "prediction-error").unwrap().clone();
        assert_eq!(check["passed"], passed, "{check}");
    }
}
