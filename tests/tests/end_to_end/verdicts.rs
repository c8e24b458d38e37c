//! What a record contradicts is named, and the exit status says whether the answer stands: one a
//! line.

use std::path::Path;

use super::program::{done, json, rig_file, whirl};

/// A minute of the chaotic rig: `base.csv`, and with changes to it.
fn folder() -> tempfile::TempDir {
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
    let run = whirl(at, &format!("identify {arguments} --json out.json"));
    assert_eq!(run.status, status, "{arguments}: {run:?}");
    let warnings = json(&at.join("out.json"))["warnings"].as_array().unwrap().clone();
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

#[test]
fn what_cannot_be_is_named() {
    let folder = folder();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "longer.toml", &[("l1 = 0.0635", "l1 = 0.06477")]);
    rig_file(at, "chaotic.toml", "millimetres.toml", &[("l1 = 0.0635", "l1 = 63.5")]);
    rig_file(at, "chaotic.toml", "heavy.toml", &[("m2 = 0.040", "m2 = 40.0")]);
    done(at, "simulate --rig rig.toml --seconds 60 --seed 1 --effect quadratic-drag@arm2=1e-6 -o drag.csv");
    identified(at, "base.csv --rig rig.toml", 0, &[]);
    identified(at, "reversed.csv --rig rig.toml", 1, &["negative-damping"]);
    // Of a dead channel nothing is said but that.
    identified(at, "dead.csv --rig rig.toml", 1, &[]);
    let run = whirl(at, "explain dead.csv --rig rig.toml --json e.json");
    let e = json(&at.join("e.json"));
    assert_eq!((run.status, e["verdict"].as_str()), (1, Some("not-decidable")), "{run:?}");
    let ids: Vec<&str> = e["warnings"].as_array().unwrap().iter().map(|w| w["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["dead-channel"]);
    identified(at, "base.csv --rig longer.toml", 1, &["known-contradicted"]);
    identified(at, "base.csv --rig millimetres.toml", 1, &["known-contradicted"]);
    identified(at, "base.csv --rig heavy.toml", 1, &["known-contradicted"]);
    rig_file(at, "chaotic.toml", "heavier.toml", &[("[known]", "[known]\nm1 = 136.2\ne1 = 0.0127")]);
    identified(at, "base.csv --rig heavier.toml", 1, &["known-contradicted"]);
    rig_file(at, "chaotic.toml", "redundant.toml", &[("[known]", "[known]\nm1 = 0.1362\ne1 = 0.0127")]);
    identified(at, "base.csv --rig redundant.toml", 0, &[]);
    let run = whirl(at, "inspect base.csv --rig longer.toml");
    assert!(run.status == 1 && run.stderr.contains("instead of 64.77 mm"), "{run:?}");
    identified(at, "drag.csv --rig rig.toml", 1, &["tie-violated"]);
}

#[test]
fn a_fit_that_diverged_explains_nothing() {
    let folder = folder();
    let at = folder.path();
    let run = whirl(at, "explain dead.csv --rig rig.toml --json out.json");
    assert_eq!(run.status, 1, "{run:?}");
    let out = json(&at.join("out.json"));
    assert_eq!(out["verdict"], "not-decidable", "{}", out["reason"]);
    assert!(out["effects"].as_array().unwrap().is_empty());
    assert!(out["gap"]["steps"].as_array().unwrap().iter().all(|s| s["value"].is_number()), "{}", out["gap"]);
    assert!(!run.stdout.contains("NaN"), "{}", run.stdout);
}

#[test]
fn an_explained_model_is_taken_by_explain_and_validate() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[]);
    // A drift is told over the record's length, wherever its times begin.
    done(at, "simulate --rig rig.toml --seconds 60 --seed 1 --effect amplitude-drift@drive=0.1 -o drift.parquet");
    done(at, "explain drift.parquet --rig rig.toml -o drift.toml");
    let text = done(at, "validate drift.parquet --rig rig.toml --model drift.toml --json v.json");
    let median = json(&at.join("v.json"))["horizon"]["measured"]["quantiles_s"][2].as_f64().unwrap();
    assert!(median > 1.0, "{text}");
    done(at, "explain drift.parquet --rig rig.toml --model drift.toml");
}
