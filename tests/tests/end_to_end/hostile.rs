//! Files that no program should stumble over: one test a row of what is wrong with them. Each ends
//! with one message, before time or memory is taken for it, or gives what is whole.

use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;

use super::program::{done, json, rig_file, whirl};

/// Twelve seconds of the chaotic rig (`r.csv`) with its rig file.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let made = || {
        let folder = tempfile::tempdir().unwrap();
        rig_file(folder.path(), "chaotic.toml", "rig.toml", &[]);
        done(folder.path(), "simulate --rig rig.toml --seconds 12 --seed 1 -o r.csv");
        folder
    };
    FOLDER.get_or_init(made).path()
}

/// Refused at once, within 20 s where the machine has other work, by one line that holds these
/// parts.
fn refused(command: &str, parts: &[&str]) {
    let begun = Instant::now();
    let run = whirl(folder(), command);
    assert!(begun.elapsed() < Duration::from_secs(20), "{command}: {:?}", begun.elapsed());
    assert!(run.status == 2 && run.stderr.lines().count() == 1, "{command}: {run:?}");
    parts.iter().for_each(|part| assert!(run.stderr.contains(part), "{command}: no {part} in {}", run.stderr));
}

/// Numbers that no rig has: what stands in the rig file, what is put there, and the place that is
/// named.
macro_rules! rigs {
    ($($name:ident: $from:literal => $to:literal, $place:literal;)+) => {$(
        #[test]
        fn $name() {
            let rig = concat!(stringify!($name), ".toml");
            rig_file(folder(), "chaotic.toml", rig, &[($from, $to)]);
            refused(&format!("identify r.csv --rig {rig}"), &[rig, $place, "expected"]);
        }
    )+};
}

rigs! {
    a_drive_of_1e_20_hz: "frequency_hz = 5.0" => "frequency_hz = 1e-20", "drive.frequency_hz";
    a_drive_of_1e_5_hz: "frequency_hz = 5.0" => "frequency_hz = 1e-5", "drive.frequency_hz";
    a_rate_of_1e_300_hz: "sample_rate_hz = 500.0" => "sample_rate_hz = 1e-300", "sample_rate_hz";
    a_rate_of_the_least_number: "sample_rate_hz = 500.0" => "sample_rate_hz = 5e-324", "sample_rate_hz";
    a_length_of_1e_310_m: "e2 = 0.0267\nl1" => "e2 = 1e-310\nl1", "known.e2";
    a_mass_of_1e300_kg: "m2 = 0.040\ne2" => "m2 = 1e300\ne2", "known.m2";
}

/// The first 512 times squeezed together.
fn squeezed(command: &str) {
    let at = folder();
    let lines = std::fs::read_to_string(at.join("r.csv")).unwrap();
    let row = |(i, line): (usize, &str)| {
        let cells: Vec<&str> = line.split(',').collect();
        let t = if (1..=512).contains(&i) { format!("{i}e-190") } else { cells[0].to_owned() };
        format!("{t},{},{}", cells[1], cells[2])
    };
    let rows: Vec<String> = lines.lines().enumerate().map(row).collect();
    let name = format!("squeezed-{command}.csv");
    std::fs::write(at.join(&name), rows.join("\n") + "\n").unwrap();
    refused(&format!("{command} {name} --rig rig.toml"), &[&name, "line 3, column t", "2e-190 after 1e-190"]);
}

#[test]
fn times_near_1e_190_s_are_refused_by_identify() {
    squeezed("identify");
}

#[test]
fn times_near_1e_190_s_are_refused_by_inspect() {
    squeezed("inspect");
}

#[test]
fn times_near_1e_190_s_are_refused_by_explain() {
    squeezed("explain");
}

#[test]
fn times_near_1e_190_s_are_refused_by_reduce() {
    squeezed("reduce");
}

/// Plants that cannot be integrated.
macro_rules! plants {
    ($($name:ident: $from:literal => $to:literal;)+) => {$(
        #[test]
        fn $name() {
            let rig = concat!(stringify!($name), ".toml");
            rig_file(folder(), "chaotic.toml", rig, &[($from, $to)]);
            for command in ["simulate", "capture --from sim"] {
                let out = concat!(stringify!($name), ".csv");
                refused(
                    &format!("{command} --rig {rig} --seconds 5 -o {out} --force"),
                    &["[plant]: the simulated rig failed at"],
                );
                let _ = std::fs::remove_file(folder().join(format!("{out}.frames")));
            }
        }
    )+};
}

plants! {
    a_plant_of_1e6_kg: "m1 = 0.1362" => "m1 = 1e6";
    a_plant_with_a_damping_of_1e18: "c_r2 = 6.145e-5" => "c_r2 = 1e18";
    a_plant_that_begins_at_1e8_rad_s: "initial = [0.3, 2.0, 0.0, 0.0]" => "initial = [0.3, 2.0, 1e8, 0.0]";
}

/// One flipped bit costs the rows of its row group, whatever of the other ones stands behind it.
#[test]
fn one_flipped_bit_costs_one_row_group() {
    let at = folder();
    done(at, "simulate --rig rig.toml --seconds 60 --seed 1 -o flipped.parquet");
    let mut bytes = std::fs::read(at.join("flipped.parquet")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(at.join("flipped.parquet"), bytes).unwrap();
    refused("identify flipped.parquet --rig rig.toml", &["flipped.parquet", "row group", "--recover"]);
    done(at, "identify flipped.parquet --rig rig.toml --recover --json flipped.json");
    let result = json(&at.join("flipped.json"));
    let told = result["warnings"].as_array().unwrap().iter().find(|w| w["id"] == "damaged-rows").unwrap();
    assert_eq!((told["rows"].as_u64(), told["stretches"].as_array().unwrap().len()), (Some(2500), 1), "{told}");
    let rig = Rig::read(at.join("rig.toml")).unwrap();
    let options = ReadOptions { recover: true, ..ReadOptions::default() };
    let record = Record::read(at.join("flipped.parquet"), &rig, &options).unwrap();
    assert_eq!((record.samples(), record.segments.len()), (27_500, 2));
}
