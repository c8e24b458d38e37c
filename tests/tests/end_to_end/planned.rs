//! The next experiment: planned from a record that cannot decide, run by a capture, decided.

use super::program::{done, json, rig_file, whirl};

/// A locked minute with an eccentric encoder, and the model of it.
fn locked(folder: &std::path::Path) {
    rig_file(folder, "seed.toml", "rig.toml", &[]);
    done(folder, "simulate --rig rig.toml --seconds 60 --effect eccentricity@encoder1=0.004 -o locked.parquet");
    whirl(folder, "identify locked.parquet --rig rig.toml -o model.toml");
}

#[test]
fn what_a_locked_record_cannot_tell_the_planned_one_tells() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    locked(folder);
    let run = whirl(folder, "explain locked.parquet --rig rig.toml --json e.json");
    assert_eq!(json(&folder.join("e.json"))["verdict"], "not-decidable", "{run:?}");

    let asked = "--tell eccentricity@encoder1=0.004,zero-offset@encoder1";
    let text = done(
        folder,
        &format!("plan --rig rig.toml --model model.toml {asked} --budget 6 -o plan.toml --json plan.json"),
    );
    assert!(text.contains("The next experiment: ") && text.contains("Motion over frequency and amplitude"), "{text}");
    let plan = json(&folder.join("plan.json"));
    assert_eq!(plan["best"]["decides"], true);
    let nearest = |p: &serde_json::Value| {
        let all = p["separations"].as_array().unwrap().iter().map(|s| s["deviations"].as_f64().unwrap());
        all.fold(f64::INFINITY, f64::min)
    };
    // Where it is locked the two are one and the same.
    assert!(nearest(&plan["best"]) > 4.99 && nearest(&plan["unchanged"]) < 1.0, "{plan:#}");

    let run = done(
        folder,
        "capture --from sim:3 --rig rig.toml --plan plan.toml --effect eccentricity@encoder1=0.004 -o next.parquet --json next.json",
    );
    assert!(run.contains("eccentricity@encoder1, zero-offset@encoder1: told apart"), "{run}");
    let next = json(&folder.join("next.json"));
    assert_eq!(next["decided"], true);
    let last = next["runs"].as_array().unwrap().last().unwrap();
    assert_eq!(last["effects"], serde_json::json!(["eccentricity@encoder1"]));
    // The record was driven at another frequency than the rig file says, and reading it with that
    // file says so and what to set.
    let record = last["record"].as_str().unwrap();
    let found = whirl(folder, &format!("inspect {record} --rig rig.toml"));
    assert!(found.status == 1 && found.stderr.contains("Set drive.frequency_hz = "), "{found:?}");
}

#[test]
fn threads_do_not_change_a_plan_within_a_short_limit() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    locked(folder);
    // Shorter than the records that are looked at, and than the one that was recorded.
    std::fs::write(folder.join("limits.toml"), "seconds = 20.0\n").unwrap();
    // Without a model that of the record is planned for.
    let [one, own] = [("1", "--model model.toml"), ("2", "")].map(|(n, model)| {
        let asked = "--precise C11=10% --budget 1 --record locked.parquet --limits limits.toml";
        let out = format!("-o plan{n}.toml --json plan{n}.json --threads {n}");
        done(folder, &format!("plan --rig rig.toml {model} {asked} {out}"));
        ["toml", "json"].map(|kind| std::fs::read_to_string(folder.join(format!("plan{n}.{kind}"))).unwrap())
    });
    assert!(one == own, "{one:?} {own:?}");
    let plan = json(&folder.join("plan1.json"));
    let seconds = plan["best"]["seconds"].as_f64().unwrap();
    assert!(seconds > 0.0 && seconds <= 20.0, "{plan:#}");
}

#[test]
fn what_cannot_be_planned_is_one_message() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    locked(folder);
    std::fs::write(folder.join("limits.toml"), "frequency_hz = [6.0, 4.0]\n").unwrap();
    std::fs::write(folder.join("plan.toml"), "format = 1\nrig = \"x\"\n[[run]]\nfrequency_hz = 5.0\nseconds = 5.0\n")
        .unwrap();
    rig_file(folder, "single-pendulum.toml", "single.toml", &[]);
    rig_file(folder, "measured-base.toml", "base.toml", &[]);
    for (arguments, told) in [
        ("plan --rig rig.toml", "--model: found no model and no record"),
        ("plan --rig base.toml --model model.toml", "found the measured input base"),
        ("plan --rig rig.toml --model model.toml --precise Q=1%", "--precise: found \"Q\""),
        (
            "plan --rig rig.toml --model model.toml --tell play@joint1",
            "--tell: found play@joint1 for a model with no effect",
        ),
        (
            "plan --rig rig.toml --model model.toml --tell nothing@joint1=1",
            "--tell: found \"nothing\", expected an effect of",
        ),
        ("plan --rig rig.toml --model model.toml --tell play", "ID@PLACE"),
        ("plan --rig rig.toml --model model.toml --limits limits.toml", "limits.toml: frequency_hz: found [6, 4]"),
        ("plan --rig single.toml --model model.toml", "expected a model of \"single-pendulum\""),
        ("capture --from sim --rig rig.toml --plan plan.toml -o r.parquet", "a run without amplitude_m"),
        ("capture --from sim --rig rig.toml --plan none.toml -o r.parquet", "none.toml"),
    ] {
        let run = whirl(folder, arguments);
        assert!(run.status == 2 && run.stderr.contains(told), "{arguments}: {run:?}");
    }
}
