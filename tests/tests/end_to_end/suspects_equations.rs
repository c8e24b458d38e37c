//! Records with one mistake in them, or in their rig file: named by `identify`, `inspect` and
//! `explain`, one test a mistake.

use std::fmt::Write;
use std::path::Path;
use std::sync::OnceLock;

use serde_json::Value;
use tempfile::TempDir;

use super::program::{done, json, rig_file, whirl};
use whirl_tests::repository;

/// Rows of a record of the chaotic rig: counts of both encoders, 500 a second.
fn record() -> &'static [(i32, i32)] {
    static RECORD: OnceLock<Vec<(i32, i32)>> = OnceLock::new();
    RECORD.get_or_init(|| {
        let folder = TempDir::new().unwrap();
        let rig = repository("rigs/chaotic.toml");
        done(folder.path(), &format!("simulate --rig {} --seconds 60 --seed 1 -o r.csv", rig.display()));
        let text = std::fs::read_to_string(folder.path().join("r.csv")).unwrap();
        let mut lines = text.lines();
        let header: Vec<&str> = lines.next().unwrap().split(',').collect();
        let at = |name: &str| header.iter().position(|h| *h == name).unwrap();
        let (first, second) = (at("count1"), at("count2"));
        lines
            .map(|line| {
                let cells: Vec<&str> = line.split(',').collect();
                (cells[first].parse().unwrap(), cells[second].parse().unwrap())
            })
            .collect()
    })
}

/// A folder with a record and a rig file.
fn folder<T: std::fmt::Display>(rate: f64, rows: impl Iterator<Item = (T, T)>, changes: &[(&str, &str)]) -> TempDir {
    let folder = TempDir::new().unwrap();
    let mut text = "t,count1,count2\n".to_owned();
    for (i, (a, b)) in rows.enumerate() {
        writeln!(text, "{},{a},{b}", i as f64 / rate).unwrap();
    }
    std::fs::write(folder.path().join("r.csv"), text).unwrap();
    rig_file(folder.path(), "chaotic.toml", "rig.toml", changes);
    folder
}

/// As recorded, with another rig file.
fn stated(changes: &[(&str, &str)]) -> TempDir {
    folder(500.0, record().iter().copied(), changes)
}

/// Other rows with the shipped rig file.
fn rows(rows: impl Iterator<Item = (i32, i32)>) -> TempDir {
    folder(500.0, rows, &[])
}

/// Runs a command and gives its status and the warning of that id.
fn run(folder: &Path, command: &str, id: &str) -> (i32, Option<Value>, Value) {
    let run = whirl(folder, &format!("{command} r.csv --rig rig.toml --json out.json"));
    let result = json(&folder.join("out.json"));
    let warning = result["warnings"].as_array().unwrap().iter().find(|w| w["id"] == id).cloned();
    assert!(warning.is_none() || run.stderr.contains("warning: "), "{run:?}");
    (run.status, warning, result)
}

/// All three commands name it, with status 1; the details as `identify` gives them.
fn named(folder: &TempDir, id: &str) -> Value {
    let mut out = None;
    for command in ["inspect", "identify", "explain"] {
        let (status, warning, result) = run(folder.path(), command, id);
        let warning = warning.unwrap_or_else(|| panic!("{command} does not say {id}: {}", result["warnings"]));
        assert_eq!(status, 1, "{command}: {warning}");
        if command == "explain" {
            assert_eq!(result["verdict"], "not-decidable");
            assert!(result["reason"].as_str().unwrap().starts_with(warning["text"].as_str().unwrap()), "{result}");
            assert_eq!(result["effects"].as_array().unwrap().len(), 0);
        }
        if command == "identify" {
            out = Some(warning);
        }
    }
    out.unwrap()
}

/// `explain` finds the effect that it is as well, or names it.
fn explained(folder: &TempDir, id: &str, effect: &str) {
    let (status, warning, result) = run(folder.path(), "explain", id);
    let found: Vec<&str> = result["effects"].as_array().unwrap().iter().filter_map(|e| e["id"].as_str()).collect();
    match warning {
        Some(_) => assert_eq!((status, found.len()), (1, 0), "{result}"),
        None => assert!(status == 0 && found.contains(&effect), "{status} {found:?} {}", result["reason"]),
    }
}

/// `identify` names it with status 1; the details.
fn identified(folder: &TempDir, id: &str) -> Value {
    let (status, warning, result) = run(folder.path(), "identify", id);
    assert_eq!(status, 1);
    warning.unwrap_or_else(|| panic!("identify does not say {id}: {}", result["warnings"]))
}

fn number(warning: &Value, key: &str) -> f64 {
    warning[key].as_f64().unwrap_or_else(|| panic!("no {key}: {warning}"))
}

#[test]
fn a_good_record_is_suspected_of_nothing() {
    let folder = stated(&[]);
    for command in ["inspect", "identify", "explain"] {
        let (status, _, result) = run(folder.path(), command, "");
        assert_eq!(status, 0, "{command}");
        let warnings = result["warnings"].as_array().unwrap();
        assert!(warnings.iter().all(|w| w["id"] == "weak-minima"), "{warnings:?}");
    }
}

#[test]
fn a_missing_effect_is_no_mistake() {
    for effect in ["quadratic-drag@arm2=2e-7", "eccentricity@encoder2=0.015"] {
        let folder = TempDir::new().unwrap();
        rig_file(folder.path(), "chaotic.toml", "rig.toml", &[]);
        let rig = "--rig rig.toml --seconds 60";
        done(folder.path(), &format!("simulate {rig} --seed 3 --effect {effect} -o r.csv"));
        let (_, _, result) = run(folder.path(), "identify", "");
        let warnings = result["warnings"].as_array().unwrap();
        // What is said is that an effect is missing, not that the rig file is wrong.
        let judged = ["tie-violated", "model-misses-something", "known-contradicted", "negative-damping"];
        assert!(warnings.iter().all(|w| judged.contains(&w["id"].as_str().unwrap())), "{effect}: {warnings:?}");
    }
}

#[test]
fn exchanged_channels() {
    let w = named(&rows(record().iter().map(|(a, b)| (*b, *a))), "channels-exchanged");
    assert_eq!(w["channels"], serde_json::json!(["count1", "count2"]));
}

#[test]
fn a_reversed_sign() {
    for folder in [rows(record().iter().map(|(a, b)| (-a - 1, *b))), rows(record().iter().map(|(a, b)| (*a, -b - 1)))] {
        let w = named(&folder, "sign-reversed");
        assert_eq!(w["channels"], serde_json::json!(["count1", "count2"]));
    }
}

#[test]
fn a_relative_angle_declared_absolute_and_the_reverse() {
    let w = named(&stated(&[("\"theta2\"", "\"phi2\"")]), "relative-absolute");
    assert_eq!(w["channel"], "count2");
    let w = named(&rows(record().iter().map(|(a, b)| (*a, a + b))), "relative-absolute");
    assert!(w["advice"].as_str().unwrap().contains("\"phi2\""), "{w}");
}

#[test]
fn another_number_of_counts() {
    let (all, second) = ("counts_per_turn = 4096", "measures = \"theta2\"\nunit = \"count\"\ncounts_per_turn = 4096");
    for (from, to) in [
        (all, "counts_per_turn = 1024".to_owned()),
        (all, "counts_per_turn = 2048".to_owned()),
        (second, second.replace("4096", "2048")),
    ] {
        let w = named(&stated(&[(from, &to)]), "counts-per-turn");
        assert!((number(&w, "value") - 4096.0).abs() < 1.0, "{to}: {w}");
    }
    for to in ["counts_per_turn = 4000".to_owned(), second.replace("4096", "4000")] {
        let folder = stated(&[(if to.len() > 30 { second } else { all }, &to)]);
        let w = identified(&folder, "counts-per-turn");
        assert!((number(&w, "value") - 4096.0).abs() < 1.0, "{to}: {w}");
    }
    let folder = stated(&[(second, &second.replace("4096", "4000"))]);
    explained(&folder, "counts-per-turn", "scale-error");
    assert_eq!(run(folder.path(), "inspect", "counts-per-turn").0, 1);
}

#[test]
fn another_drive_frequency() {
    for stated_hz in ["5.005", "5.05", "10.0"] {
        let folder = stated(&[("frequency_hz = 5.0", &format!("frequency_hz = {stated_hz}"))]);
        let w = identified(&folder, "drive-frequency");
        assert!((number(&w, "value_hz") - 5.0).abs() < 1e-5, "{stated_hz}: {w}");
        if stated_hz == "5.005" {
            explained(&folder, "drive-frequency", "frequency-offset");
            let (status, warning, _) = run(folder.path(), "inspect", "drive-frequency");
            assert!(status == 1 && (number(&warning.unwrap(), "value_hz") - 5.0).abs() < 1e-5);
        }
    }
}

#[test]
fn another_sampling_rate() {
    // The rig file's rate is wrong, and the record's own times are right.
    let folder = stated(&[("sample_rate_hz = 500.0", "sample_rate_hz = 499.0")]);
    for command in ["inspect", "identify", "explain"] {
        let (status, warning, result) = run(folder.path(), command, "rate-differs");
        assert_eq!(status, 0, "{command}");
        let w = warning.unwrap_or_else(|| panic!("{command}: {}", result["warnings"]));
        assert!((number(&w, "value_hz") - 500.0).abs() < 1e-3, "{w}");
    }
    // The record's times are wrong: the drive shows it.
    let folder = self::folder(499.0, record().iter().copied(), &[]);
    let w = identified(&folder, "drive-frequency");
    assert!((number(&w, "value_hz") - 5.0 * 499.0 / 500.0).abs() < 1e-5, "{w}");
    assert!((number(&w, "sample_rate_hz") - 500.0 * 500.0 / 499.0).abs() < 1e-3, "{w}");
}

#[test]
fn a_late_channel() {
    for late in [1_usize, 5] {
        let all = record();
        let folder = rows((late..all.len()).map(|i| (all[i].0, all[i - late].1)));
        let w = identified(&folder, "channel-delay");
        assert_eq!(w["channel"], "count2");
        assert!((number(&w, "samples") - late as f64).abs() < 0.02, "{w}");
        if late == 1 {
            explained(&folder, "channel-delay", "channel-delay");
            assert_eq!(run(folder.path(), "inspect", "channel-delay").0, 1);
        }
    }
}

#[test]
fn a_channel_with_a_clock_of_its_own() {
    for fast in [1e-3, 1e-4] {
        let all = record();
        let at = |i: usize| {
            let x = i as f64 * (1.0 + fast);
            let (k, u) = (x as usize, x.fract());
            let [a, b] = [*all.get(k)?, *all.get(k + 1)?].map(|row| f64::from(row.1) + 0.5);
            Some((all[i].0, ((1.0 - u) * a + u * b).floor() as i32))
        };
        let folder = rows((0..all.len()).map_while(at));
        let w = if fast > 5e-4 { identified(&folder, "channel-clock") } else { named(&folder, "channel-clock") };
        assert_eq!(w["channel"], "count2");
        assert!((number(&w, "value") / fast - 1.0).abs() < 0.01, "{w}");
    }
}

#[test]
fn time_reversed() {
    let w = named(&rows(record().iter().rev().copied()), "time-reversed");
    assert!(w["parameters"].as_array().unwrap().len() >= 3, "{w}");
}

#[test]
fn degrees_for_radians_and_the_reverse() {
    let count = "unit = \"count\"\ncounts_per_turn = 4096";
    for (turn, declared, true_unit) in
        [(360.0, "unit = \"rad\"", "deg"), (core::f64::consts::TAU, "unit = \"deg\"", "rad")]
    {
        let angle = |c: i32| (f64::from(c) + 0.5) * turn / 4096.0;
        let folder = folder(500.0, record().iter().map(|(a, b)| (angle(*a), angle(*b))), &[(count, declared)]);
        let w = named(&folder, "channel-unit");
        assert_eq!(w["unit"], true_unit);
    }
}

#[test]
fn a_direction_that_the_equations_do_not_have() {
    let folder = stated(&[("\"vertical\"", "\"horizontal\"")]);
    // Without equations there are no parameters; an explanation says why there is none.
    for (command, status) in [("identify", 2), ("explain", 1)] {
        let run = whirl(folder.path(), &format!("{command} r.csv --rig rig.toml"));
        assert_eq!(run.status, status, "{run:?}");
        assert!(run.stderr.contains("drive.direction") && run.stderr.contains("\"vertical\""), "{run:?}");
    }
    let (status, warning, _) = run(folder.path(), "inspect", "drive-direction");
    assert_eq!(status, 1);
    assert_eq!(warning.unwrap()["value"], "vertical");
}

#[test]
fn a_single_pendulum_driven_in_another_direction() {
    let folder = TempDir::new().unwrap();
    rig_file(folder.path(), "single-pendulum.toml", "true.toml", &[]);
    done(folder.path(), "simulate --rig true.toml --seconds 60 --seed 2 -o r.csv");
    let text = std::fs::read_to_string(folder.path().join("true.toml")).unwrap();
    let (here, there) =
        if text.contains("\"horizontal\"") { ("horizontal", "vertical") } else { ("vertical", "horizontal") };
    rig_file(folder.path(), "single-pendulum.toml", "rig.toml", &[(here, there)]);
    assert_eq!(named(&folder, "drive-direction")["value"], here);
}

/// Of the built-in system and of one from bodies: a length that gravity contradicts.
#[test]
fn a_length_that_the_record_contradicts() {
    let folder = stated(&[]);
    let agrees = |w: &Value| (number(&w["would_agree"], "l1") / 0.0635 - 1.0).abs() < 2e-3;
    let wrong = [("l1 = 0.0635", "l1 = 0.1016")];
    rig_file(folder.path(), "double-pendulum-from-bodies.toml", "rig.toml", &wrong);
    let w = identified(&folder, "known-contradicted");
    assert!(agrees(&w), "{w}");
    rig_file(folder.path(), "chaotic.toml", "rig.toml", &wrong);
    let w = named(&folder, "known-contradicted");
    assert!(agrees(&w), "{w}");
}

#[test]
fn a_mass_that_no_body_has() {
    let folder = stated(&[("m2 = 0.040", "m2 = 40.0")]);
    assert_eq!(identified(&folder, "known-contradicted")["quantity"], "m2");
}
