//! Records that look plausible and are not: each fault is named with its row, and the parameters
//! are right or the status says that they are not.

use std::sync::OnceLock;

use serde_json::Value;

use super::program::{done, json, rig_file, whirl};

/// 60 s of the chaotic rig: counts of both channels, and the folder with its rig file.
fn base() -> &'static (tempfile::TempDir, Vec<[i64; 2]>) {
    static BASE: OnceLock<(tempfile::TempDir, Vec<[i64; 2]>)> = OnceLock::new();
    BASE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        rig_file(folder.path(), "chaotic.toml", "rig.toml", &[]);
        done(folder.path(), "simulate --rig rig.toml --seconds 60 --seed 1 -o base.csv");
        let text = std::fs::read_to_string(folder.path().join("base.csv")).unwrap();
        let row = |line: &str| {
            let cells: Vec<&str> = line.split(',').collect();
            [cells[1].parse().unwrap(), cells[2].parse().unwrap()]
        };
        let rows = text.lines().skip(1).map(row).collect();
        (folder, rows)
    })
}

fn write(name: &str, rows: &[[i64; 2]]) {
    let mut text = "t,count1,count2\n".to_owned();
    for (i, [a, b]) in rows.iter().enumerate() {
        text += &format!("{},{a},{b}\n", i as f64 / 500.0);
    }
    std::fs::write(base().0.path().join(format!("{name}.csv")), text).unwrap();
}

/// The warning of this id in a result.
fn warning<'a>(result: &'a Value, id: &str) -> &'a Value {
    let warnings = result["warnings"].as_array().unwrap();
    let found = warnings.iter().find(|w| w["id"] == id).unwrap_or_else(|| panic!("no {id} in {warnings:?}"));
    // What is wrong with a channel is told once, what is cut off once for each end.
    let told = warnings.iter().filter(|w| w["id"] == id && w["channel"] == found["channel"]).count();
    assert_eq!(told, if id == "clipped" { 2 } else { 1 }, "{id}: {warnings:?}");
    found
}

/// Identifies a changed record; checks its warning, row and status, and with status 0 the
/// parameters. inspect must name the same.
fn named(name: &str, change: impl Fn(&mut Rows), id: &str, row: Option<u64>, status: i32) {
    let (folder, clean) = base();
    let mut rows = clean.clone();
    change(&mut rows);
    write(name, &rows);
    for command in ["identify", "inspect"] {
        let run = whirl(folder.path(), &format!("{command} {name}.csv --rig rig.toml --json {name}-{command}.json"));
        assert!(run.status < 2 && (command == "inspect" || run.status == status), "{name} {command}: {run:?}");
        let result = json(&folder.path().join(format!("{name}-{command}.json")));
        let told = warning(&result, id);
        if let Some(row) = row {
            assert_eq!(told["row"], row, "{name}: {told}");
        }
        if command == "identify" && status == 0 {
            right(name, &result);
        }
    }
}

/// Every parameter within 3 standard errors of the truth (3.4) of the rig's plant.
fn right(name: &str, result: &Value) {
    let (coupling, j1, j2, omega) = (0.040 * 0.0267 * 0.0635, 5.99e-4, 4.033e-5, 10.0 * core::f64::consts::PI);
    let truth = [
        ("B11", coupling / j1),
        ("B21", coupling / j2),
        ("C11", 6.03e-4 / j1 / (omega * omega)),
        ("C2", 6.145e-5 / j2 / omega),
    ];
    for (parameter, value) in truth {
        let of = result["parameters"].as_array().unwrap().iter().find(|p| p["name"] == parameter).unwrap();
        let (found, error) = (of["value"].as_f64().unwrap(), of["std_error"].as_f64().unwrap());
        assert!((found - value).abs() < 3.0 * error, "{name}: {parameter} {found} ± {error}, true {value}");
    }
}

#[test]
fn a_clean_record_has_none_of_these_warnings() {
    let (folder, rows) = base();
    write("clean", rows);
    done(folder.path(), "identify clean.csv --rig rig.toml --json clean.json");
    let result = json(&folder.path().join("clean.json"));
    assert_eq!(result["warnings"], Value::Array(vec![]), "{}", result["warnings"]);
    right("clean", &result);
}

/// One test a row of the table: what is done to the record, the warning, the row that it names
/// (where it names one), the status of `identify`.
macro_rules! faults {
    ($($(#[$about:meta])* $name:ident: $change:expr => $id:literal, $row:expr, $status:literal;)+) => {$(
        $(#[$about])*
        #[test]
        fn $name() {
            named(stringify!($name), $change, $id, $row, $status);
        }
    )+};
}

type Rows = Vec<[i64; 2]>;

/// A step of one channel that stays from a row on.
fn slip(x: &mut Rows, size: i64) {
    x[15_000..].iter_mut().for_each(|r| r[1] += size);
}

/// Channel 2 cut off at 600 counts on either side of where it began.
fn clip(x: &mut Rows) {
    let start = x[0][1];
    x.iter_mut().for_each(|r| r[1] = r[1].clamp(start - 600, start + 600));
}

/// Channel 2 stands from half way on.
fn stop(x: &mut Rows) {
    let last = x[15_000][1];
    x[15_000..].iter_mut().for_each(|r| r[1] = last);
}

/// Channel 1 stands from half way on, where it turns round.
fn stop_slow(x: &mut Rows) {
    let last = x[15_000][0];
    x[15_000..].iter_mut().for_each(|r| r[0] = last);
}

faults! {
    channel_2_is_constant: |x| x.iter_mut().for_each(|r| r[1] = 40) => "dead-channel", Some(2), 1;
    channel_2_is_constant_from_half_way: stop => "channel-stopped", Some(15_002), 0;
    /// Slow, it stops as a joint that is held; but arm 2 would not let friction hold it.
    channel_1_is_constant_from_half_way: stop_slow => "channel-stopped", None, 0;
    one_spike_of_500: |x| x[12_345][1] += 500 => "spike", Some(12_347), 0;
    one_spike_of_a_million: |x| x[12_345][0] += 1_000_000 => "spike", Some(12_347), 0;
    /// From 45 counts on: 15 and 30 lie within what the motion around them allows, stay in, and move
    /// C2 by 3.4 standard errors.
    five_spikes: |x| (1..=5).for_each(|k| x[5000 * k + 7][1] += 45 + 50 * (k as i64 - 1)) => "spike", Some(5009), 0;
    /// Every 2.8 s one: without them no window of 4 s is left, so that the answer cannot stand.
    twenty_spikes: |x| (1..=20).for_each(|k| x[1400 * k + 7][1] += 45 + 13 * (k as i64 - 1)) => "spike", Some(1409), 1;
    /// The samples show it as 18, the equations what that is off.
    one_slip_of_17: |x| x[15_000..].iter_mut().for_each(|r| r[0] += 17) => "count-slip", Some(15_002), 0;
    one_slip_of_200: |x| slip(x, 200) => "count-slip", Some(15_002), 0;
    bit_2_is_stuck_at_1: |x| x.iter_mut().for_each(|r| r[1] |= 4) => "stuck-bit", None, 1;
    bit_6_is_stuck_at_1: |x| x.iter_mut().for_each(|r| r[0] |= 64) => "stuck-bit", None, 1;
    bit_0_is_stuck_at_0: |x| x.iter_mut().for_each(|r| r[1] &= !1) => "stuck-bit", None, 0;
    channel_1_is_new_at_every_second_sample: |x| (0..x.len()).for_each(|i| x[i][0] = x[i / 2 * 2][0]) => "held-samples", None, 1;
    one_per_cent_of_rows_doubled: |x| *x = (0..29_000).map(|i| x[i - i / 101]).collect() => "rows-doubled", None, 1;
    five_per_cent_of_rows_missing: |x| *x = (0..28_000).map(|i| x[i + i / 19]).collect() => "rows-missing", None, 1;
    clipped_at_600_counts: clip => "clipped", None, 1;
    two_records_joined: |x| drop(x.drain(10_000..14_000)) => "record-joined", Some(10_002), 1;
    /// Count 1 goes on there by chance within four counts, and nearly at rest.
    two_records_that_meet: |x| drop(x.drain(12_000..17_000)) => "record-joined", Some(12_002), 1;
}

/// Without the first angle nothing determines the first equation: that too is told with its reason.
fn channel_1_dead(name: &str, of: impl Fn(&[i64; 2]) -> [i64; 2]) {
    let (folder, clean) = base();
    write(name, &clean.iter().map(of).collect::<Rows>());
    for command in ["inspect", "identify"] {
        let run = whirl(folder.path(), &format!("{command} {name}.csv --rig rig.toml --json {name}.json"));
        assert_eq!(run.status, 1, "{command}: {run:?}");
        assert_eq!(warning(&json(&folder.path().join(format!("{name}.json"))), "dead-channel")["channel"], "count1");
    }
}

#[test]
fn channel_1_is_constant() {
    channel_1_dead("dead1", |r| [40, r[1]]);
}

#[test]
fn both_channels_are_constant() {
    channel_1_dead("dead", |_| [40, 41]);
}

/// Slips of one count lie below the noise of any sample: the equations show them, to a few rows.
fn slips_of_one(name: &str, every: usize, commands: &[&str]) {
    let (folder, clean) = base();
    let mut rows = clean.clone();
    rows.iter_mut().enumerate().for_each(|(i, r)| r[1] += (i / every) as i64);
    write(name, &rows);
    let wanted: Vec<i64> = (1..=29_999 / every).map(|k| (k * every) as i64 + 2).collect();
    for command in commands {
        done(folder.path(), &format!("{command} {name}.csv --rig rig.toml --json {name}-{command}.json"));
        let result = json(&folder.path().join(format!("{name}-{command}.json")));
        let told = warning(&result, "count-slip");
        assert_eq!(told["channel"], "count2");
        let list = |key: &str| told[key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect::<Vec<_>>();
        let (at, sizes) = (list("rows"), list("sizes"));
        let near = |row: &i64| at.iter().zip(&sizes).any(|(a, s)| (*a - *row as f64).abs() <= 8.0 && *s == 1.0);
        let found = wanted.iter().filter(|row| near(row)).count();
        assert!(found * 10 >= wanted.len() * 9 && at.len() == found, "{name} {command}: {told}");
        if *command == "identify" {
            right(name, &result);
        }
    }
}

#[test]
fn one_slip_of_1() {
    slips_of_one("one", 15_000, &["identify", "inspect", "explain"]);
}

/// Looking for effects takes its time: once is enough.
#[test]
fn thirty_slips_of_1() {
    slips_of_one("thirty", 970, &["identify", "inspect"]);
}

/// In a short record the piece that holds a slip of some counts is a good part of what is left.
#[test]
fn one_slip_of_6_in_a_short_record() {
    let (folder, clean) = base();
    let mut rows = clean[..8_000].to_vec();
    rows[2_000..].iter_mut().for_each(|r| r[0] += 6);
    write("six", &rows);
    done(folder.path(), "identify six.csv --rig rig.toml --json six.json");
    let result = json(&folder.path().join("six.json"));
    let told = warning(&result, "count-slip");
    assert_eq!((&told["channel"], &told["sizes"]), (&"count1".into(), &serde_json::json!([6.0])), "{told}");
    assert!(told["rows"][0].as_f64().is_some_and(|row| (row - 2_002.0).abs() <= 8.0), "{told}");
    right("six", &result);
}

/// What the equations miss is no slip, although single pieces of it look like one.
#[test]
fn a_missing_effect_is_not_told_as_slips() {
    let (folder, _) = base();
    let effect = "stribeck-friction@joint2=2e-4,v_s=1";
    done(folder.path(), &format!("simulate --rig rig.toml --effect {effect} --seconds 40 --seed 57 -o stribeck.csv"));
    let run = whirl(folder.path(), "identify stribeck.csv --rig rig.toml --json stribeck.json");
    assert!(run.status < 2, "{run:?}");
    let result = json(&folder.path().join("stribeck.json"));
    let ids: Vec<&str> = result["warnings"].as_array().unwrap().iter().map(|w| w["id"].as_str().unwrap()).collect();
    assert!(!ids.contains(&"count-slip"), "{ids:?}");
    assert!(
        result["not_by_shooting"].as_str().unwrap().contains("times the sensors' noise"),
        "{}",
        result["not_by_shooting"]
    );
}

#[test]
fn explain_names_them_too() {
    let folder = base().0.path();
    named("explained", |x| x[12_345][1] += 500, "spike", Some(12_347), 0);
    let run = whirl(folder, "explain explained.csv --rig rig.toml --json explain.json");
    assert!(run.status < 2, "{run:?}");
    assert_eq!(warning(&json(&folder.join("explain.json")), "spike")["row"], 12_347);
}

#[test]
fn one_typo_in_a_file_is_named_and_left_out() {
    let (folder, clean) = base();
    let mut rows = clean[..6000].to_vec();
    rows[2617][0] += 700;
    write("typo", &rows);
    done(folder.path(), "identify typo.csv --rig rig.toml --json typo.json");
    let result = json(&folder.path().join("typo.json"));
    let told = warning(&result, "spike");
    assert!(told["row"] == 2619 && told["value"] == 700.0 && told["left_out"] == 1, "{told}");
    right("typo", &result);
}
