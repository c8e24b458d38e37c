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
        assert!(warnings.is_empty(), "{warnings:?}");
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

fn reversed(folder: &TempDir) {
    assert_eq!(named(folder, "sign-reversed")["channels"], serde_json::json!(["count1", "count2"]));
}

#[test]
fn the_sign_of_channel_1_reversed() {
    reversed(&rows(record().iter().map(|(a, b)| (-a - 1, *b))));
}

#[test]
fn the_sign_of_channel_2_reversed() {
    reversed(&rows(record().iter().map(|(a, b)| (*a, -b - 1))));
}

#[test]
fn a_relative_angle_declared_absolute() {
    let w = named(&stated(&[("\"theta2\"", "\"phi2\"")]), "relative-absolute");
    assert_eq!(w["channel"], "count2");
}

#[test]
fn an_absolute_angle_declared_relative() {
    let w = named(&rows(record().iter().map(|(a, b)| (*a, a + b))), "relative-absolute");
    assert!(w["advice"].as_str().unwrap().contains("\"phi2\""), "{w}");
}

const COUNTS: &str = "counts_per_turn = 4096";
const COUNTS_2: &str = "measures = \"theta2\"\nunit = \"count\"\ncounts_per_turn = 4096";

/// A rig file with other counts a turn, of all channels or of the second.
fn counts(all: bool, number: &str) -> TempDir {
    let from = if all { COUNTS } else { COUNTS_2 };
    stated(&[(from, &from.replace("4096", number))])
}

fn is_4096(w: &Value) {
    assert!((number(w, "value") - 4096.0).abs() < 1.0, "{w}");
}

#[test]
fn a_quarter_of_the_counts_a_turn() {
    is_4096(&named(&counts(true, "1024"), "counts-per-turn"));
}

#[test]
fn half_of_the_counts_a_turn() {
    is_4096(&named(&counts(true, "2048"), "counts-per-turn"));
}

#[test]
fn half_of_the_counts_a_turn_in_channel_2() {
    is_4096(&named(&counts(false, "2048"), "counts-per-turn"));
}

#[test]
fn counts_of_4000_for_4096() {
    is_4096(&identified(&counts(true, "4000"), "counts-per-turn"));
}

#[test]
fn counts_of_4000_for_4096_in_channel_2() {
    let folder = counts(false, "4000");
    is_4096(&identified(&folder, "counts-per-turn"));
    explained(&folder, "counts-per-turn", "scale-error");
    assert_eq!(run(folder.path(), "inspect", "counts-per-turn").0, 1);
}

/// 5 Hz under another number in the rig file.
fn frequency(stated_hz: &str) -> TempDir {
    let folder = stated(&[("frequency_hz = 5.0", &format!("frequency_hz = {stated_hz}"))]);
    let w = identified(&folder, "drive-frequency");
    assert!((number(&w, "value_hz") - 5.0).abs() < 1e-5, "{w}");
    folder
}

#[test]
fn a_drive_frequency_that_is_a_thousandth_off() {
    let folder = frequency("5.005");
    explained(&folder, "drive-frequency", "frequency-offset");
    let (status, warning, _) = run(folder.path(), "inspect", "drive-frequency");
    assert!(status == 1 && (number(&warning.unwrap(), "value_hz") - 5.0).abs() < 1e-5);
}

#[test]
fn a_drive_frequency_that_is_a_hundredth_off() {
    frequency("5.05");
}

#[test]
fn twice_the_drive_frequency() {
    frequency("10.0");
}

/// The rig file's rate is wrong, and the record's own times are right.
#[test]
fn a_sampling_rate_that_is_not_the_records() {
    let folder = stated(&[("sample_rate_hz = 500.0", "sample_rate_hz = 499.0")]);
    for command in ["inspect", "identify", "explain"] {
        let (status, warning, result) = run(folder.path(), command, "rate-differs");
        assert_eq!(status, 0, "{command}");
        let w = warning.unwrap_or_else(|| panic!("{command}: {}", result["warnings"]));
        assert!((number(&w, "value_hz") - 500.0).abs() < 1e-3, "{w}");
    }
}

/// The record's times are wrong: the drive shows it.
#[test]
fn times_of_another_sampling_rate() {
    let folder = self::folder(499.0, record().iter().copied(), &[]);
    let w = identified(&folder, "drive-frequency");
    assert!((number(&w, "value_hz") - 5.0 * 499.0 / 500.0).abs() < 1e-5, "{w}");
    assert!((number(&w, "sample_rate_hz") - 500.0 * 500.0 / 499.0).abs() < 1e-3, "{w}");
}

/// Channel 2 late by so many samples.
fn late(by: usize) -> TempDir {
    let all = record();
    let folder = rows((by..all.len()).map(|i| (all[i].0, all[i - by].1)));
    let w = identified(&folder, "channel-delay");
    assert_eq!(w["channel"], "count2");
    assert!((number(&w, "samples") - by as f64).abs() < 0.02, "{w}");
    folder
}

#[test]
fn channel_2_late_by_one_sample() {
    let folder = late(1);
    explained(&folder, "channel-delay", "channel-delay");
    assert_eq!(run(folder.path(), "inspect", "channel-delay").0, 1);
}

#[test]
fn channel_2_late_by_five_samples() {
    late(5);
}

/// Channel 2 by a clock that is so much too fast, and what is said of it.
fn clock(fast: f64, told: impl Fn(&TempDir, &str) -> Value) {
    let all = record();
    let at = |i: usize| {
        let x = i as f64 * (1.0 + fast);
        let (k, u) = (x as usize, x.fract());
        let [a, b] = [*all.get(k)?, *all.get(k + 1)?].map(|row| f64::from(row.1) + 0.5);
        Some((all[i].0, ((1.0 - u) * a + u * b).floor() as i32))
    };
    let w = told(&rows((0..all.len()).map_while(at)), "channel-clock");
    assert_eq!(w["channel"], "count2");
    assert!((number(&w, "value") / fast - 1.0).abs() < 0.01, "{w}");
}

#[test]
fn channel_2_by_a_clock_that_is_a_thousandth_fast() {
    clock(1e-3, identified);
}

#[test]
fn channel_2_by_a_clock_that_is_a_ten_thousandth_fast() {
    clock(1e-4, named);
}

#[test]
fn time_reversed() {
    let w = named(&rows(record().iter().rev().copied()), "time-reversed");
    assert!(w["parameters"].as_array().unwrap().len() >= 3, "{w}");
}

/// Angles of so many units a turn, declared as another one.
fn unit(turn: f64, declared: &str, true_unit: &str) {
    let angle = |c: i32| (f64::from(c) + 0.5) * turn / 4096.0;
    let count = "unit = \"count\"\ncounts_per_turn = 4096";
    let declared = format!("unit = \"{declared}\"");
    let folder = folder(500.0, record().iter().map(|(a, b)| (angle(*a), angle(*b))), &[(count, &declared)]);
    assert_eq!(named(&folder, "channel-unit")["unit"], true_unit);
}

#[test]
fn degrees_declared_radians() {
    unit(360.0, "rad", "deg");
}

#[test]
fn radians_declared_degrees() {
    unit(core::f64::consts::TAU, "deg", "rad");
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

/// Of the built-in system and of one from bodies: a length that gravity contradicts, or a clock.
#[test]
fn a_length_that_the_record_contradicts() {
    let folder = stated(&[]);
    // Or a clock by which accelerations, and so gravity, are 1.6 times what they are.
    let agrees = |w: &Value| {
        let w = &w["would_agree"];
        let clock = number(w, "time-base") * (0.1016_f64 / 0.0635).sqrt();
        (number(w, "l1") / 0.0635 - 1.0).abs() < 2e-3 && (clock - 1.0).abs() < 1e-3
    };
    let wrong = [("l1 = 0.0635", "l1 = 0.1016")];
    rig_file(folder.path(), "double-pendulum-from-bodies.toml", "rig.toml", &wrong);
    let w = identified(&folder, "known-contradicted");
    assert!(agrees(&w), "{w}");
    rig_file(folder.path(), "chaotic.toml", "rig.toml", &wrong);
    let w = named(&folder, "known-contradicted");
    assert!(agrees(&w), "{w}");
}

/// An amplitude that the base did not have: gravity tells, and nothing is computed from it. A time
/// base that is off moves it and l1 alike: a known l1 tells which.
fn twice_the_amplitude(known: &[(&str, &str)], commands: &[&str]) -> Value {
    let drive = ("frequency_hz = 5.0", "frequency_hz = 5.0\namplitude_m = 0.03105");
    let folder = stated(&[&[drive], known].concat());
    for command in commands {
        let (status, warning, _) = run(folder.path(), command, "drive-amplitude");
        assert!(status == 0 && warning.is_some(), "{command}: {status} {warning:?}");
    }
    let (status, warning, result) = run(folder.path(), "identify", "drive-amplitude");
    let w = warning.unwrap_or_else(|| panic!("{}", result["warnings"]));
    assert!(status == 0 && (number(&w, "value_m") / 0.015_525 - 1.0).abs() < 2e-3, "{w}");
    w
}

#[test]
fn twice_the_drive_amplitude() {
    let w = twice_the_amplitude(&[], &["inspect", "explain"]);
    assert!(!w["advice"].as_str().unwrap().contains("time base"), "{w}");
}

#[test]
fn twice_the_drive_amplitude_where_no_length_is_known() {
    let w = twice_the_amplitude(&[("l1 = 0.0635\n", "")], &["inspect"]);
    assert!(w["advice"].as_str().unwrap().contains("l1 under [known] tells which"), "{w}");
}

#[test]
fn a_mass_that_no_body_has() {
    let folder = stated(&[("m2 = 0.040", "m2 = 40.0")]);
    assert_eq!(identified(&folder, "known-contradicted")["quantity"], "m2");
}
