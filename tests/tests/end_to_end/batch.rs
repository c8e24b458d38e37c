//! Many records, one table: shards, resumption, and the numbers of the single command.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use super::program::{Run, command, done, json, rig_file, whirl};

const RECORDS: &str = "r1.parquet r2.csv broken.csv r3.parquet r4.csv";

/// A folder with `rig.toml`, four short records and one that is none.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 1.0")]);
    for (seed, name) in (1..).zip(["r1.parquet", "r2.csv", "r3.parquet", "r4.csv"]) {
        done(at, &format!("simulate --rig rig.toml --seconds 24 --seed {seed} -o {name}"));
    }
    std::fs::write(at.join("broken.csv"), "t,count1,count2\n0,1,2\n0.002,x,3\n").unwrap();
    folder
}

/// `whirl batch identify` of all records, with options.
fn identify(at: &Path, options: &str) -> Run {
    whirl(at, &format!("batch identify {RECORDS} --rig rig.toml --method weak {options}"))
}

/// A table's cells by column, row by row; quotation marks are left out.
fn cells(at: &Path, table: &str) -> Vec<BTreeMap<String, String>> {
    let text = std::fs::read_to_string(at.join(table)).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let split = |line: &str| {
        let (mut out, mut quoted) = (vec![String::new()], false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => out.push(String::new()),
                c => out.last_mut().unwrap().push(c),
            }
        }
        out
    };
    lines
        .map(|line| {
            let cells = split(line);
            assert_eq!(cells.len(), names.len(), "{line}");
            names.iter().map(|n| (*n).to_owned()).zip(cells).collect()
        })
        .collect()
}

/// The number of `key` that follows `marker` in a JSON's text, to the bit: what reads JSON here may
/// be one off in the last.
fn number(text: &str, marker: &str, key: &str) -> f64 {
    let (_, after) = text.split_once(marker).unwrap_or_else(|| panic!("no {marker}"));
    let (_, after) = after.split_once(&format!("\"{key}\": ")).unwrap_or_else(|| panic!("no {key} behind {marker}"));
    after.split([',', '\n']).next().unwrap().parse().unwrap()
}

#[test]
fn merged_shards_have_the_bytes_of_one_run_whatever_the_threads() {
    let folder = folder();
    let at = folder.path();
    for table in ["csv", "parquet"] {
        let one = identify(at, &format!("--out one.{table} --threads 2"));
        // No terminal shows a bar here: a line for each record, one of which is broken.
        let lines: Vec<&str> = one.stderr.lines().collect();
        assert!(one.status == 1 && lines.len() == 5 && lines[4].starts_with("5 of 5: "), "{one:?}");
        assert!(one.stderr.contains(": broken.csv: error: ") && one.stderr.contains(" of 5: r2.csv: "), "{one:?}");
        let quiet = identify(at, &format!("--out one.{table} --threads 2 --quiet"));
        assert_eq!((quiet.status, quiet.stderr.as_str()), (1, ""), "{quiet:?}");
        assert!(one.stdout.contains("5 records in one.") && one.stdout.contains("1 error"), "{}", one.stdout);
        for shard in ["1/2", "2/2"] {
            let run = identify(at, &format!("--out {}.{table} --shard {shard} --threads 1", &shard[..1]));
            // The broken record is the third.
            assert_eq!(run.status, i32::from(shard == "1/2"), "{run:?}");
        }
        // A row that failed is one in the merged table as well.
        let merged = whirl(at, &format!("batch merge 2.{table} 1.{table} --out merged.{table}"));
        assert_eq!((merged.status, merged.stderr.as_str()), (1, ""), "{merged:?}");
        assert!(
            std::fs::read(at.join(format!("merged.{table}"))).unwrap()
                == std::fs::read(at.join(format!("one.{table}"))).unwrap(),
            "{table} differs"
        );
        let partly = whirl(at, &format!("batch merge 2.{table} --out part.{table}"));
        assert_eq!(partly.status, 1);
        assert!(partly.stderr.contains("no row for 3 of 5 records: 1, 3, 5"), "{partly:?}");
    }
    // One format into the other.
    assert_eq!(whirl(at, "batch merge 1.parquet 2.parquet --out merged.csv").status, 1);
    assert!(std::fs::read(at.join("merged.csv")).unwrap() == std::fs::read(at.join("one.csv")).unwrap());
    let other = identify(at, "--out other.csv --shard 2/2 --from 1");
    assert_eq!(other.status, 0, "{other:?}");
    let mixed = whirl(at, "batch merge 1.csv other.csv --out mixed.csv");
    assert!(mixed.status == 2 && mixed.stderr.contains("rows of another run"), "{mixed:?}");
    let twice = whirl(at, "batch merge 1.csv one.csv --out mixed.csv");
    assert!(twice.status == 2 && twice.stderr.contains("a second time"), "{twice:?}");
}

#[cfg(unix)]
#[test]
fn ctrl_c_says_what_is_done_and_how_to_go_on() {
    let folder = folder();
    let at = folder.path();
    let arguments = format!("batch identify {RECORDS} --rig rig.toml --method weak --out t.csv --threads 1");
    let run = command()
        .current_dir(at)
        .args(arguments.split_whitespace())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let journal = at.join("t.csv.journal");
    let lines = || std::fs::read_to_string(&journal).map_or(0, |text| text.lines().count());
    let begun = Instant::now();
    while lines() < 2 && begun.elapsed() < Duration::from_secs(300) {
        std::thread::sleep(Duration::from_millis(1));
    }
    let sent = std::process::Command::new("kill").args(["-INT", &run.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let output = run.wait_with_output().unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(130), "{told}");
    assert!(told.contains("interrupted: ") && told.contains(" of 5 done; go on with --resume"), "{told}");
    assert!(!at.join("t.csv").exists());
    assert_eq!(identify(at, "--out t.csv --resume").status, 1);
}

#[test]
fn a_killed_batch_goes_on_to_the_same_bytes() {
    let folder = folder();
    let at = folder.path();
    identify(at, "--out whole.csv");
    let arguments = format!("batch identify {RECORDS} --rig rig.toml --method weak --out t.csv --threads 1");
    let mut run = command().current_dir(at).args(arguments.split_whitespace()).spawn().unwrap();
    let journal = at.join("t.csv.journal");
    let lines = || std::fs::read_to_string(&journal).map_or(0, |text| text.lines().count());
    let begun = Instant::now();
    while lines() < 3 && begun.elapsed() < Duration::from_secs(300) {
        std::thread::sleep(Duration::from_millis(1));
    }
    run.kill().unwrap();
    run.wait().unwrap();
    assert!(!at.join("t.csv").exists() && (3..6).contains(&lines()), "killed in between: {} lines", lines());
    // As if it had been killed while it wrote.
    let text = std::fs::read_to_string(&journal).unwrap();
    std::fs::write(&journal, format!("{text}{{\"file\":\"r3")).unwrap();
    let forgotten = identify(at, "--out t.csv");
    assert!(forgotten.status == 2 && forgotten.stderr.contains("records are done"), "{forgotten:?}");
    assert!(forgotten.stderr.contains("--resume") && forgotten.stderr.contains("--force"), "{forgotten:?}");
    for (options, told) in [
        ("--from 1", "--from was not given, is 1"),
        ("--shard 1/2", "the shard was all records, is 1/2"),
        ("--window-s 2", "--window-s was not given, is 2"),
    ] {
        let run = identify(at, &format!("--out t.csv --resume {options}"));
        assert!(run.status == 2 && run.stderr.contains(told), "{run:?}");
    }
    let resumed = identify(at, "--out t.csv --resume");
    assert_eq!(resumed.status, 1, "{resumed:?}");
    assert!(std::fs::read(at.join("t.csv")).unwrap() == std::fs::read(at.join("whole.csv")).unwrap());
    // A record that has changed is done anew, the others are not.
    let before = std::fs::read_to_string(&journal).unwrap();
    std::fs::copy(at.join("r2.csv"), at.join("broken.csv")).unwrap();
    let mended = identify(at, "--out t.csv --resume");
    assert_eq!(mended.status, 0, "{mended:?}");
    let after = std::fs::read_to_string(&journal).unwrap();
    let added: Vec<&str> = after.strip_prefix(&before).expect("what was done stays").lines().collect();
    assert!(added.len() == 2 && added[0].contains("broken.csv") && added[1].contains("finished"), "{added:?}");
    let rows = cells(at, "t.csv");
    assert_eq!((&rows[1]["B11"], &rows[1]["hash"]), (&rows[2]["B11"], &rows[2]["hash"]));
}

#[test]
fn a_row_has_what_the_single_command_answers() {
    let folder = folder();
    let at = folder.path();
    assert_eq!(identify(at, "--out t.csv --json t.json --report t.html").status, 1);
    let rows = cells(at, "t.csv");
    for (row, file) in rows.iter().zip(RECORDS.split(' ')) {
        assert_eq!((row["file"].as_str(), row["format"].as_str(), row["of"].as_str()), (file, "1", "5"));
        let single = whirl(at, &format!("identify {file} --rig rig.toml --method weak --json one.json --force"));
        assert_eq!(row["exit_status"], single.status.to_string(), "{file}");
        if single.status == 2 {
            assert_eq!(format!("whirl: {}\n", row["error"]), single.stderr.replace('"', ""));
            assert_eq!((row["verdict"].as_str(), row["B11"].as_str(), row["seconds"].as_str()), ("error", "", ""));
            continue;
        }
        let answer = json(&at.join("one.json"));
        let text = std::fs::read_to_string(at.join("one.json")).unwrap();
        // The clock of a CSV record is its column t, as it was rounded.
        assert!((row["seconds"].parse::<f64>().unwrap() - 24.0).abs() < 1e-9, "{file}: {}", row["seconds"]);
        assert_eq!(row["samples"], "12000");
        for p in answer["parameters"].as_array().unwrap() {
            let name = p["name"].as_str().unwrap();
            let cell = |column: &str| row[column].parse::<f64>().unwrap();
            let marker = format!("\"name\": \"{name}\"");
            assert_eq!(cell(name), number(&text, &marker, "value"), "{file}, {name}");
            assert_eq!(cell(&format!("{name}_std_error")), number(&text, &marker, "std_error"), "{file}, {name}");
            assert!(row["units"].contains(&format!("{name} {}", p["unit"].as_str().unwrap())));
        }
    }
    let summary = json(&at.join("t.json"));
    assert_eq!(
        (&summary["format"], &summary["rows"], &summary["verdicts"]["identified"]),
        (&1.into(), &5.into(), &4.into())
    );
    assert_eq!(summary["negative"][0]["file"], "broken.csv");
    let page = std::fs::read_to_string(at.join("t.html")).unwrap();
    assert!(page.contains("broken.csv") && page.contains("identified"));

    done(at, "identify r1.parquet --rig rig.toml --method weak -o model.toml");
    assert!(std::fs::read_to_string(at.join("model.toml")).unwrap().starts_with("format = 1\n"));
    let options = "--rig rig.toml --model model.toml --starts 8";
    let run = whirl(at, &format!("batch validate r2.csv {options} --out v.csv"));
    let single = whirl(at, &format!("validate r2.csv {options} --json v.json"));
    assert_eq!(run.status, single.status, "{run:?} {single:?}");
    let (row, answer) = (&cells(at, "v.csv")[0], json(&at.join("v.json")));
    assert_eq!(row["verdict"], answer["verdict"].as_str().unwrap());
    let median = answer["horizon"]["measured"]["quantiles_s"][2].as_f64().unwrap();
    assert!((row["horizon_measured_s"].parse::<f64>().unwrap() / median - 1.0).abs() < 1e-15, "{median}");
}

#[test]
fn effects_are_columns() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 1.0")]);
    done(at, "simulate --rig rig.toml --effect quadratic-drag@arm2=2e-7 --seconds 40 --seed 1 -o r.csv");
    let run = whirl(at, "batch explain r.csv --rig rig.toml --most-effects 1 --out e.csv");
    let single = whirl(at, "explain r.csv --rig rig.toml --most-effects 1 --json e.json");
    assert_eq!(run.status, single.status, "{run:?} {single:?}");
    let (row, answer) = (&cells(at, "e.csv")[0], json(&at.join("e.json")));
    assert_eq!(answer["format"], 1);
    let text = std::fs::read_to_string(at.join("e.json")).unwrap();
    assert_eq!(row["effects"], "quadratic-drag@arm2");
    assert_eq!((row["effect1_id"].as_str(), row["effect1_at"].as_str()), ("quadratic-drag", "arm2"));
    for key in ["value", "std_error"] {
        let cell: f64 = row[&format!("effect1_{key}")].parse().unwrap();
        assert_eq!(cell, number(&text, "\"effects\": [", key), "{key}");
    }
    assert_eq!(row["verdict"], answer["verdict"].as_str().unwrap());
    let last = answer["gap"]["steps"].as_array().unwrap().last().unwrap();
    let (cell, last) = (row["gap_after"].parse::<f64>().unwrap(), last["value"].as_f64().unwrap());
    assert!((cell / last - 1.0).abs() < 1e-15, "{cell} {last}");
}

#[test]
fn what_makes_no_sense_is_refused_with_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[]);
    std::fs::write(at.join("r.csv"), "t,count1,count2\n0,1,2\n0.002,1,3\n").unwrap();
    for (arguments, told) in [
        ("identify r.csv --rig rig.toml --out t.xlsx", "--out"),
        ("identify r.csv --rig rig.toml --out r.csv", "a file that this command reads"),
        ("identify r.csv --rig rig.toml --out t.csv -o model.toml", "-o: found one file for many records"),
        ("identify r.csv --rig none.toml --out t.csv", "none.toml"),
        ("identify none/*.csv --rig rig.toml --out t.csv", "none/*.csv: found a pattern that no file matches"),
        ("explain r.csv --rig rig.toml --out t.csv --forecast 0", "--forecast"),
        ("validate r.csv --rig rig.toml --model none.toml --out t.csv", "none.toml"),
        ("merge r.csv --out t.csv", "r.csv: columns: found other columns"),
    ] {
        let run = whirl(at, &format!("batch {arguments}"));
        assert_eq!((run.status, run.stdout.as_str()), (2, ""), "{arguments}: {run:?}");
        assert!(run.stderr.contains(told) && run.stderr.lines().count() == 1, "{arguments}: {}", run.stderr);
        assert!(!at.join("t.csv").exists(), "{arguments}");
    }
    for usage in ["identify r.csv --rig rig.toml", "identify r.csv --rig rig.toml --out t.csv --shard 0/2"] {
        assert_eq!(whirl(at, &format!("batch {usage}")).status, 2, "{usage}");
    }
    // A row for each, and a failure is no end.
    let run = whirl(at, "batch identify r.csv gone.csv --rig rig.toml --out t.csv");
    assert_eq!(run.status, 1, "{run:?}");
    let rows = cells(at, "t.csv");
    assert_eq!((rows.len(), rows[1]["hash"].as_str(), rows[1]["exit_status"].as_str()), (2, "", "2"));
    // No row is lost unasked; the same records are made anew.
    let fewer = whirl(at, "batch identify r.csv --rig rig.toml --out t.csv");
    assert!(fewer.status == 2 && fewer.stderr.contains("a row of gone.csv") && fewer.stderr.contains("--force"));
    let part = whirl(at, "batch identify r.csv --rig rig.toml --out part.csv");
    let merged = whirl(at, "batch merge part.csv --out t.csv");
    assert!(part.status == 1 && merged.status == 2 && merged.stderr.contains("a row of gone.csv"), "{merged:?}");
    assert_eq!(cells(at, "t.csv").len(), 2);
    assert_eq!(whirl(at, "batch identify gone.csv r.csv --rig rig.toml --out t.csv").status, 1);
    assert_eq!(whirl(at, "batch identify r.csv --rig rig.toml --out t.csv --force").status, 1);
    assert_eq!(cells(at, "t.csv").len(), 1);
}
