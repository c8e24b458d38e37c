//! Bad input ends with status 2, nothing on standard output, no result written, and one message
//! that names file, place, value and remedy.

use std::io::Write;
use std::path::Path;

use super::program::{done, json, rig_file, whirl};

/// Runs a command that must be refused with one line that has all of `parts` in it.
fn refused(folder: &Path, command: &str, parts: &[&str]) {
    let results = if command.starts_with("simulate") { "--json out.json" } else { "--json out.json --report out.html" };
    let run = whirl(folder, &format!("{command} {results}"));
    assert_eq!((run.status, run.stdout.as_str()), (2, ""), "{command}: {run:?}");
    assert_eq!(run.stderr.trim_end().lines().count(), 1, "{command}: {}", run.stderr);
    assert!(run.stderr.starts_with("whirl: ") && !run.stderr.contains("panicked"), "{command}: {}", run.stderr);
    for part in parts {
        assert!(run.stderr.contains(part), "{command}: no \"{part}\" in: {}", run.stderr);
    }
    for result in ["out.json", "out.html"] {
        assert!(!folder.join(result).exists(), "{command} wrote {result}");
    }
}

/// A folder with `rig.toml`, `good.csv` (12 s of the chaotic rig) and `good.parquet`.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 1.0")]);
    done(at, "simulate --rig rig.toml --seconds 12 --seed 1 -o good.csv");
    folder
}

fn good(folder: &Path) -> Vec<String> {
    std::fs::read_to_string(folder.join("good.csv")).unwrap().lines().map(str::to_owned).collect()
}

/// The good record with one cell changed (line from 1, column from 0).
fn with_cell(folder: &Path, name: &str, line: usize, column: usize, value: &str) {
    let mut lines = good(folder);
    let mut cells: Vec<&str> = lines[line - 1].split(',').collect();
    cells[column] = value;
    lines[line - 1] = cells.join(",");
    std::fs::write(folder.join(name), lines.join("\n") + "\n").unwrap();
}

#[test]
fn cells_and_columns() {
    let folder = folder();
    let at = folder.path();
    let header = good(at)[0].clone();
    assert_eq!(header, "t,count1,count2,tick,phase,amplitude_nm");
    with_cell(at, "column.csv", 1, 2, "velocity");
    with_cell(at, "time.csv", 1, 0, "clock");
    with_cell(at, "text.csv", 101, 2, "x7");
    with_cell(at, "type.csv", 101, 2, "99999999999");
    with_cell(at, "nan.csv", 101, 0, "NaN");
    with_cell(at, "back.csv", 101, 0, "0.01");
    std::fs::write(at.join("empty.csv"), "").unwrap();
    std::fs::write(at.join("header.csv"), format!("{header}\n")).unwrap();
    std::fs::write(at.join("short.csv"), good(at)[..400].join("\n")).unwrap();
    for command in ["inspect", "identify"] {
        let refused = |record: &str, parts: &[&str]| {
            refused(at, &format!("{command} {record} --rig rig.toml"), &[&[record], parts].concat());
        };
        refused("column.csv", &["header", "velocity", "count2", "rig file"]);
        refused("time.csv", &["header", "a column t"]);
        refused("text.csv", &["line 101, column count2", "\"x7\"", "a number", "Mend"]);
        refused("type.csv", &["line 101, column count2", "99999999999", "32 bits", "Mend"]);
        refused("nan.csv", &["line 101, column t", "NaN", "a time in seconds", "mend"]);
        refused("back.csv", &["line 101, column t", "0.01 after 0.196", "later", "Sort"]);
        refused("empty.csv", &["start of file", "0 bytes", "Record again"]);
        refused("header.csv", &["no row", "Record again"]);
        refused("short.csv", &["399 samples", "at least", "Record longer"]);
        refused("missing.csv", &["No such file", "Name a record"]);
    }
}

#[test]
fn nan_in_a_channel_is_filled_counted_and_warned_of() {
    let folder = folder();
    let at = folder.path();
    with_cell(at, "nan.csv", 3001, 1, "NaN");
    for command in ["inspect", "identify"] {
        let run = whirl(at, &format!("{command} nan.csv --rig rig.toml --json {command}.json"));
        assert_eq!(run.status, 0, "{run:?}");
        assert!(run.stderr.contains("line 3001 in count1"), "{}", run.stderr);
        let filled = "1 row that is missing or left out, in gaps of up to 1 row, was filled";
        assert!(run.stderr.contains(filled), "{}", run.stderr);
        let record = &json(&at.join(format!("{command}.json")))["record"];
        assert_eq!((&record["lost"], &record["segments"]), (&1.into(), &1.into()), "{record}");
    }
}

#[test]
fn truncated_files_and_their_recovery() {
    let folder = folder();
    let at = folder.path();
    // gzip
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    gzip.write_all(&std::fs::read(at.join("good.csv")).unwrap()).unwrap();
    let whole = gzip.finish().unwrap();
    std::fs::write(at.join("cut.csv.gz"), &whole[..whole.len() * 3 / 4]).unwrap();
    // Parquet, long enough for several row groups
    done(at, "simulate --rig rig.toml --seconds 120 --seed 1 -o whole.parquet");
    let whole = std::fs::read(at.join("whole.parquet")).unwrap();
    std::fs::write(at.join("cut.parquet"), &whole[..whole.len() * 3 / 4]).unwrap();
    for (record, rows) in [("cut.csv.gz", 6000), ("cut.parquet", 60_000)] {
        for command in ["inspect", "identify"] {
            refused(
                at,
                &format!("{command} {record} --rig rig.toml"),
                &[record, "truncated", "last whole row", "t = ", "--recover"],
            );
            done(at, &format!("{command} {record} --rig rig.toml --recover --json recovered.json"));
            let samples = json(&at.join("recovered.json"))["record"]["samples"].as_i64().unwrap();
            assert!(samples > rows / 2 && samples < rows, "{record}: {samples} of {rows}");
        }
    }
    // Cut within the first row group.
    std::fs::write(at.join("stub.parquet"), &whole[..1000]).unwrap();
    refused(at, "identify stub.parquet --rig rig.toml --recover", &["stub.parquet", "no row is whole", "again"]);
}

#[test]
fn rig_files() {
    let folder = folder();
    let at = folder.path();
    for (name, from, to, parts) in [
        (
            "unknown.toml",
            "sample_rate_hz",
            "sampel_rate_hz",
            &["line 5", "sampel_rate_hz", "sample_rate_hz", "Correct"][..],
        ),
        (
            "zero.toml",
            "counts_per_turn = 4096",
            "counts_per_turn = 0",
            &["counts_per_turn", "found 0", "1 or more", "Correct"],
        ),
        ("rate.toml", "sample_rate_hz = 500.0", "sample_rate_hz = -1.0", &["sample_rate_hz", "-1", "above 0"]),
        ("unit.toml", "unit = \"count\"", "unit = \"parsec\"", &["unit", "parsec", "one of"]),
        ("known.toml", "m2 = 0.040\ne2 = 0.0267\nl1 = 0.0635\n\n", "m3 = 0.040\n\n", &["known.m3", "one of"]),
        ("syntax.toml", "[drive]", "[drive", &["line"]),
        ("model.toml", "\"double-pendulum\"", "\"triple\"", &["model", "triple", "double-pendulum"]),
    ] {
        rig_file(at, "chaotic.toml", name, &[(from, to)]);
        refused(at, &format!("identify good.csv --rig {name}"), &[&[name], parts].concat());
    }
    refused(at, "identify good.csv --rig no.toml", &["no.toml", "No such file", "rigs/"]);
    rig_file(at, "measured-double-pendulum.toml", "free.toml", &[]);
    refused(at, "simulate --rig free.toml --seconds 1 -o s.csv", &["free.toml", "[plant]", "chaotic.toml"]);
    assert!(!at.join("s.csv").exists());
}

#[test]
fn wires_sources_and_options() {
    let folder = folder();
    let at = folder.path();
    // Noise of a small generator: 100 kB.
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let noise: Vec<u8> = (0..100_000)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 32) as u8
        })
        .collect();
    std::fs::write(at.join("noise.bin"), noise).unwrap();
    let capture =
        |from: &str| format!("capture --from {from} --rig rig.toml -o r.parquet --reconnect-s 0 --handshake-s 1");
    refused(
        at,
        &capture("file:noise.bin"),
        &["noise.bin", "no sample for a record in 100000 bytes", "0 good frames", "bytes of the wire"],
    );
    refused(at, &capture("file:none.bin"), &["none.bin", "No such file"]);
    refused(at, &capture("serial:/dev/no-such-port"), &["/dev/no-such-port", "dialout"]);
    refused(at, &capture("tcp:127.0.0.1:1"), &["127.0.0.1:1", "listens"]);
    refused(at, &capture("nowhere"), &["--from", "nowhere", "serial:", "tcp:"]);
    refused(at, "simulate --rig rig.toml --seconds 0 -o s.csv", &["--seconds", "found 0"]);
    refused(at, "simulate --rig rig.toml --seconds 1 --effect foo@joint1=1 -o s.csv", &["foo", "whirl list effects"]);
    refused(at, "simulate --rig rig.toml --seconds 1 -o no/folder/s.csv", &["no/folder/s.csv", "folder"]);
    refused(at, "identify good.csv --rig rig.toml --window-s 0", &["--window-s", "found 0"]);
    assert!(!at.join("r.parquet").exists() && !at.join("s.csv").exists());
}
