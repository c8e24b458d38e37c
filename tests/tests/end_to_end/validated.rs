//! Identification by shooting, and the model that it writes, validated.

use std::path::Path;

use whirl_tests::coverage::{Method, tally};

use super::program::{done, json, rig_file, whirl};

/// A minute of the chaotic rig at 1024 counts, identified by shooting into `model.toml`.
fn identified(folder: &Path) {
    rig_file(folder, "chaotic.toml", "rig.toml", &[("counts_per_turn = 4096", "counts_per_turn = 1024")]);
    done(folder, "simulate --rig rig.toml --seconds 60 --seed 5 -o record.parquet");
    done(folder, "identify record.parquet --rig rig.toml --method shooting -o model.toml --json identified.json");
}

#[test]
fn a_model_by_shooting_passes_its_validation_and_a_wrong_one_fails_with_status_1() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    identified(folder);
    let out = json(&folder.join("identified.json"));
    assert_eq!(out["method"], "shooting");
    for ratio in out["shooting"]["noise_ratio"].as_array().unwrap() {
        assert!((ratio.as_f64().unwrap() - 1.0).abs() < 0.05, "{}", out["shooting"]);
    }
    let b21 =
        out["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "B21").unwrap()["value"].as_f64().unwrap();
    assert!((b21 / 1.681_582 - 1.0).abs() < 1e-3, "{b21}");

    let text = done(folder, "validate record.parquet --rig rig.toml --model model.toml --json v.json --report v.html");
    assert!(text.contains("validation passed"), "{text}");
    let v = json(&folder.join("v.json"));
    assert_eq!(v["verdict"], "passed");
    let own = v["horizon"]["simulated"]["quantiles_s"][2].as_f64().unwrap();
    let measured = v["horizon"]["measured"]["quantiles_s"][2].as_f64().unwrap();
    assert!(measured > 0.6 * own && own > 1.0, "{measured} {own}");
    let exponent = v["lyapunov"]["model"].as_f64().unwrap();
    assert!((exponent / 5.0 - 0.8).abs() < 0.15, "{exponent}");
    assert!(std::fs::read_to_string(folder.join("v.html")).unwrap().contains("<svg"));

    let model = std::fs::read_to_string(folder.join("model.toml")).unwrap();
    let wrong = model.replace(&format!("B21 = {{ value = {b21:?}"), &format!("B21 = {{ value = {:?}", 1.06 * b21));
    assert_ne!(model, wrong);
    std::fs::write(folder.join("wrong.toml"), wrong).unwrap();
    let run = whirl(folder, "validate record.parquet --rig rig.toml --model wrong.toml --json w.json");
    assert_eq!(run.status, 1, "{run:?}");
    assert!(
        run.stdout.contains("FAILED: prediction-horizon") && run.stderr.contains("fails its validation"),
        "{run:?}"
    );
    assert_eq!(json(&folder.join("w.json"))["verdict"], "failed");

    // What is wrong with a model file or an option is told in one message, with status 2.
    std::fs::write(folder.join("other.toml"), model.replace("drive_frequency_hz = 5.0", "drive_frequency_hz = 6.0"))
        .unwrap();
    for (arguments, told) in [
        (
            "validate record.parquet --rig rig.toml --model other.toml",
            "other.toml: drive_frequency_hz: found a drive of 6 Hz",
        ),
        ("validate record.parquet --rig rig.toml --model rig.toml", "rig.toml: this is a rig file"),
        ("validate record.parquet --rig rig.toml --model model.toml --tolerance-deg 0", "--tolerance-deg"),
        ("validate record.parquet --rig rig.toml --model model.toml --bifurcation X=0.5:1", "--bifurcation"),
        ("identify record.parquet --rig rig.toml --method shooting --segment-s 1e9", "--segment-s"),
        ("identify record.parquet --rig rig.toml --method shooting --bound X=0:1", "--bound"),
    ] {
        let run = whirl(folder, arguments);
        assert_eq!(run.status, 2, "{arguments}: {run:?}");
        assert!(run.stderr.contains(told) && run.stderr.lines().count() == 1, "{arguments}: {}", run.stderr);
    }
}

#[test]
fn shooting_gives_the_same_bytes_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    identified(folder);
    let arguments = "identify record.parquet --rig rig.toml --method shooting --json";
    done(folder, &format!("{arguments} one.json --threads 1"));
    done(folder, &format!("{arguments} three.json --threads 3"));
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    assert_eq!(read("one.json"), read("three.json"));
    assert_eq!(read("one.json"), read("identified.json"));
}

/// `--example coverage` prints the table over 200 records; here a few, over which intervals must
/// hold the truth most of the time.
#[test]
fn intervals_of_both_methods_hold_the_truth() {
    for (method, all) in tally(1024, 60.0, 1..=12, &[Method::Weak, Method::Shooting]).into_iter().enumerate() {
        let (within, records): (usize, usize) = all.iter().fold((0, 0), |s, t| (s.0 + t.within, s.1 + t.records));
        let share = within as f64 / records as f64;
        assert!((0.85..=1.0).contains(&share), "method {method}: {share} {all:?}");
        for t in &all {
            assert!(t.rms < 2.0, "method {method}: {t:?}");
            assert!(method == 0 || t.over_bound < 1.8, "{t:?}");
        }
    }
}
