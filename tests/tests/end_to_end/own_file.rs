//! A file from one's own rig, whatever it looks like, to an answer.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use parquet::data_type::{DoubleType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use serde_json::Value;
use whirl_tests::repository;

use super::program::{done, json, rig_file, whirl};

/// The columns of a CSV as numbers, without its header row.
fn rows(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().skip(1).map(|l| l.split(',').map(|c| c.parse().unwrap()).collect()).collect()
}

/// A free pendulum's swing from 2 rad, every 2 ms: a sum of no sines, by small steps.
fn swing(n: usize) -> Vec<f64> {
    let (mut x, mut v) = (2.0_f64, 0.0_f64);
    let h = 1e-4;
    let mut out = Vec::with_capacity(n);
    for _ in 0..n {
        out.push(x);
        for _ in 0..20 {
            let a = |x: f64, v: f64| -45.0 * x.sin() - 0.05 * v;
            let (k, m) = (v + 0.5 * h * a(x, v), a(x + 0.5 * h * v, v + 0.5 * h * a(x, v)));
            (x, v) = (x + h * k, v + h * m);
        }
    }
    out
}

const SINGLE: &str =
    "name = \"x\"\nmodel = \"single-pendulum\"\n[[channel]]\nname = \"NAME\"\nmeasures = \"theta1\"\nunit = \"deg\"\n";

/// q_sin, which is 45 s⁻² of what [`swing`] gives.
fn stiffness(out: &Value) -> f64 {
    let list = out["parameters"].as_array().unwrap();
    list.iter().find(|p| p["name"] == "q_sin").unwrap_or_else(|| panic!("{list:?}"))["value"].as_f64().unwrap()
}

fn identified(folder: &Path, arguments: &str) -> f64 {
    let run = whirl(folder, &format!("identify {arguments} --json i.json"));
    assert!(run.status < 2, "{arguments}: {run:?}");
    stiffness(&json(&folder.join("i.json")))
}

#[test]
fn every_dialect_gives_the_same_answer() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let angle = swing(10_000);
    let deg: Vec<String> = angle.iter().map(|x| format!("{:.4}", x.to_degrees())).collect();
    let s = |i: usize| format!("{:.3}", i as f64 * 0.002);
    let mut files: Vec<(&str, &str, String)> = Vec::new();
    let mut text = "Time (s);Winkel 1 (deg)\n".to_owned();
    deg.iter()
        .enumerate()
        .for_each(|(i, x)| writeln!(text, "{};{}", s(i).replace('.', ","), x.replace('.', ",")).unwrap());
    files.push(("german.csv", "Winkel 1 (deg)", text));
    let mut text = "# from the bench\ntime_ms\tangle\n".to_owned();
    deg.iter().enumerate().for_each(|(i, x)| writeln!(text, "{}\t{x}", 2 * i).unwrap());
    files.push(("bench.tsv", "angle", text));
    let mut text = "Device 7\nstarted;today\nwhen;Angle\n".to_owned();
    deg.iter().enumerate().for_each(|(i, x)| writeln!(text, "{};{x}", 2 * i).unwrap());
    files.push(("device.csv --time when:ms", "Angle", text));
    let mut text = String::new();
    deg.iter().enumerate().for_each(|(i, x)| writeln!(text, "{},{x}", s(i)).unwrap());
    files.push(("bare.csv --time c1", "c2", text));
    let mut text = "Timestamp,angle\n".to_owned();
    deg.iter().enumerate().for_each(|(i, x)| {
        let (seconds, milliseconds) = (2 * i / 1000, 2 * i % 1000);
        writeln!(text, "2026-11-23T12:00:{seconds:02}.{milliseconds:03},{x}").unwrap();
    });
    files.push(("dates.csv", "angle", text));
    for (file, column, text) in &files {
        std::fs::write(at.join(file.split(' ').next().unwrap()), text).unwrap();
        std::fs::write(at.join("rig.toml"), SINGLE.replace("NAME", column)).unwrap();
        let found = identified(at, &format!("{file} --rig rig.toml"));
        assert!((found / 45.0 - 1.0).abs() < 2e-3, "{file}: {found}");
    }
    // The same by --map, whatever the rig file calls the column.
    std::fs::write(at.join("rig.toml"), SINGLE.replace("NAME", "elsewhere")).unwrap();
    let found = identified(at, "bench.tsv --rig rig.toml --map theta1=angle");
    assert!((found / 45.0 - 1.0).abs() < 2e-3, "{found}");
    let run = whirl(at, "identify bench.tsv --rig rig.toml");
    assert_eq!(run.status, 2);
    assert!(run.stderr.contains("a column elsewhere") && run.stderr.contains("--map"), "{}", run.stderr);
    // A gain in the rig file: radians told as degrees over 57.3.
    let rig = SINGLE.replace("NAME", "angle").replace("unit = \"deg\"", "unit = \"rad\"\ngain = 0.017453292519943295");
    std::fs::write(at.join("rig.toml"), rig).unwrap();
    let found = identified(at, "bench.tsv --rig rig.toml");
    assert!((found / 45.0 - 1.0).abs() < 2e-3, "{found}");
}

#[test]
fn arrays_and_data_frames_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let angle = swing(10_000);
    let mut header = "{'descr': '<f8', 'fortran_order': False, 'shape': (10000, 2), }".to_owned();
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    angle
        .iter()
        .enumerate()
        .for_each(|(i, x)| bytes.extend([i as f64 * 0.002, x.to_degrees()].iter().flat_map(|v| v.to_le_bytes())));
    std::fs::write(at.join("r.npy"), bytes).unwrap();
    std::fs::write(at.join("rig.toml"), SINGLE.replace("NAME", "c2")).unwrap();
    let found = identified(at, "r.npy --rig rig.toml --time c1");
    assert!((found / 45.0 - 1.0).abs() < 2e-3, "{found}");

    // As pandas writes a frame with a column of dates.
    let schema = "message schema { optional int64 timestamp (TIMESTAMP(MICROS,false)); optional double angle_deg; }";
    let file = std::fs::File::create(at.join("frame.parquet")).unwrap();
    let schema = Arc::new(parse_message_type(schema).unwrap());
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(WriterProperties::builder().build())).unwrap();
    let mut group = writer.next_row_group().unwrap();
    let there = vec![1_i16; angle.len()];
    let mut column = group.next_column().unwrap().unwrap();
    let times: Vec<i64> = (0..angle.len() as i64).map(|i| 1_795_435_200_000_000 + 2000 * i).collect();
    column.typed::<Int64Type>().write_batch(&times, Some(&there), None).unwrap();
    column.close().unwrap();
    let mut column = group.next_column().unwrap().unwrap();
    let values: Vec<f64> = angle.iter().map(|x| x.to_degrees()).collect();
    column.typed::<DoubleType>().write_batch(&values, Some(&there), None).unwrap();
    column.close().unwrap();
    group.close().unwrap();
    writer.close().unwrap();
    std::fs::write(at.join("rig.toml"), SINGLE.replace("NAME", "angle_deg")).unwrap();
    let found = identified(at, "frame.parquet --rig rig.toml");
    assert!((found / 45.0 - 1.0).abs() < 2e-3, "{found}");
    // And from nothing but the file.
    done(at, "init frame.parquet -o drafted.toml");
    let found = identified(at, "frame.parquet --rig drafted.toml");
    assert!((found / 45.0 - 1.0).abs() < 2e-3, "{found}");
}

#[test]
fn counts_of_a_driven_double_pendulum_need_no_word_of_the_rig() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "truth.toml", &[]);
    done(at, "simulate --rig truth.toml --seconds 120 --seed 4 -o own.csv");
    stripped(at, "time,enc_a,enc_b");
    let said = done(at, "init run.csv -o rig.toml --json init.json");
    let rig = std::fs::read_to_string(at.join("rig.toml")).unwrap();
    for part in [
        "model = \"double-pendulum\"",
        "frequency_hz = 5.0\n",
        "sample_rate_hz = 500.0\n",
        "measures = \"theta1\"",
        "measures = \"theta2\"",
    ] {
        assert!(rig.contains(part), "{part}: {rig}\n{said}");
    }
    assert_eq!(rig.matches("counts_per_turn = 4096").count(), 2, "{rig}");
    done(at, "inspect run.csv --rig rig.toml");
    done(at, "identify run.csv --rig rig.toml --json i.json");
    let out = json(&at.join("i.json"));
    let b22 =
        out["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "B22").unwrap()["value"].as_f64().unwrap();
    // m2 g e2/(J_o2 Ω²) of the rig's own [plant].
    let truth = 0.040 * 9.81 * 0.0267 / (4.033e-5 * (10.0 * std::f64::consts::PI).powi(2));
    assert!((b22 / truth - 1.0).abs() < 5e-3, "{b22} {truth}");
}

/// Time and counts of own.csv as another program would write them, in run.csv.
fn stripped(at: &Path, names: &str) {
    let columns = header(&at.join("own.csv"));
    let place = |name: &str| columns.iter().position(|c| c == name).unwrap();
    let places = ["t", "count1", "count2"].map(place);
    let mut text = format!("{names}\n");
    rows(&at.join("own.csv")).iter().for_each(|r| {
        let [t, a, b] = places.map(|k| r[k]);
        writeln!(text, "{t},{a},{b}").unwrap();
    });
    std::fs::write(at.join("run.csv"), text).unwrap();
}

#[test]
fn a_drive_that_leaves_no_clear_line_is_found_by_the_equations() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "truth.toml", &[]);
    // Of the first the motion has no clear line at 5 Hz, of the second its highest is at 20 Hz.
    for (seed, rest) in [(1, "--seconds 40"), (5, "--seconds 24 --effect quadratic-drag@arm2=2e-6")] {
        done(at, &format!("simulate --rig truth.toml --seed {seed} {rest} -o own.csv --force"));
        stripped(at, "time,enc_a,enc_b");
        let said = done(at, "init run.csv -o rig.toml --force");
        let rig = std::fs::read_to_string(at.join("rig.toml")).unwrap();
        assert!(rig.contains("frequency_hz = 5.0\n"), "{seed}: {rig}\n{said}");
    }
    done(at, "init run.csv -o rig.toml --force --drive-hz 4.5");
    let rig = std::fs::read_to_string(at.join("rig.toml")).unwrap();
    assert!(rig.contains("frequency_hz = 4.5\n") && rig.contains("--drive-hz says so"), "{rig}");
    done(at, "init run.csv -o rig.toml --force --drive-hz 0");
    assert!(!std::fs::read_to_string(at.join("rig.toml")).unwrap().contains("\n[drive]"));
    let wrong = whirl(at, "init run.csv -o rig.toml --force --drive-hz 300");
    assert_eq!(wrong.status, 2, "{wrong:?}");
}

#[test]
fn a_model_goes_on_from_a_record_whose_time_has_another_name() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "truth.toml", &[]);
    done(at, "simulate --rig truth.toml --seed 1 --seconds 40 -o own.csv");
    done(at, "identify own.csv --rig truth.toml -o model.toml");
    stripped(at, "clock,count1,count2");
    let command = "simulate --model model.toml --rig truth.toml --from run.csv --seconds 0.5 -o out.csv";
    assert_eq!(whirl(at, command).status, 2);
    done(at, &format!("{command} --time clock:s"));
    let out = rows(&at.join("out.csv"));
    assert!(out.len() == 250 && out[0][0] == 0.0, "{:?}", out[0]);
    let alone = whirl(at, "simulate --model model.toml --time clock:s --seconds 1 -o none.csv");
    assert!(alone.status == 2 && alone.stderr.contains("--from"), "{alone:?}");
}

/// An arm that whirls goes far in radians too: how far says nothing of the unit.
#[test]
fn an_angle_of_no_known_unit_is_what_the_equations_fit() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let written = |names: &[&str], per_count: f64, uneven: f64| {
        let columns = header(&at.join("own.csv"));
        let heads: Vec<String> = (1..=names.len()).map(|k| format!("angle{k}")).collect();
        let mut text = format!("time,{}\n", heads.join(","));
        for (i, r) in rows(&at.join("own.csv")).iter().enumerate() {
            write!(text, "{}", r[0]).unwrap();
            for (k, name) in names.iter().enumerate() {
                let count = r[columns.iter().position(|c| c == name).unwrap()];
                // Noise, so that no steps are left (one that repeats would be a line of a drive).
                let off = (43_758.545 * (12.9898 * (i + 7919 * k) as f64).sin()).fract().abs() - 0.5;
                write!(text, ",{:.6}", (count + 0.5 + uneven * off) * per_count).unwrap();
            }
            text.push('\n');
        }
        std::fs::write(at.join("run.csv"), text).unwrap();
        let said = done(at, "init run.csv -o rig.toml --force");
        (std::fs::read_to_string(at.join("rig.toml")).unwrap(), said)
    };
    let turn = std::f64::consts::TAU;
    rig_file(at, "seed.toml", "truth.toml", &[]);
    done(at, "simulate --rig truth.toml --seconds 60 --seed 8 -o own.csv");
    let (rig, said) = written(&["count1", "count2"], turn / 1024.0, 0.0);
    assert_eq!(rig.matches("unit = \"rad\"").count(), 2, "{rig}\n{said}");
    assert!(rig.contains("frequency_hz = 5.0\n"), "{rig}\n{said}");
    let first = rig.split("[[channel]]").nth(1).unwrap();
    assert!(first.contains("measures = \"theta1\""), "{rig}\n{said}");
    rig_file(at, "single-pendulum.toml", "truth.toml", &[]);
    done(at, "simulate --rig truth.toml --seconds 60 --seed 3 -o own.csv --force");
    for (unit, of_turn) in [("rad", turn), ("deg", 360.0)] {
        let (rig, said) = written(&["count1"], of_turn / 4096.0, 3.0);
        assert!(rig.contains(&format!("unit = \"{unit}\"")) && rig.contains("frequency_hz = 2.5\n"), "{rig}\n{said}");
        // Some degrees a row are no radians.
        assert_eq!(said.contains("the equations of motion its unit"), unit == "rad", "{said}");
    }
}

fn header(path: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().next().unwrap().split(',').map(str::to_owned).collect()
}

#[test]
fn degrees_of_a_pendulum_and_a_record_of_ones_own() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut text = "t,angle\n".to_owned();
    let step = 360.0 / 4096.0;
    swing(10_000).iter().enumerate().for_each(|(i, x)| {
        writeln!(text, "{:.3},{:.5}", i as f64 * 0.002, (x.to_degrees() / step).round() * step).unwrap();
    });
    std::fs::write(at.join("run.csv"), text).unwrap();
    let said = done(at, "init run.csv -o rig.toml");
    assert!(said.contains("1/4096 of a turn in deg"), "{said}");
    assert!(done(at, "inspect run.csv").contains("single-pendulum"));
    let found = identified(at, "run.csv --rig rig.toml");
    assert!((found / 45.0 - 1.0).abs() < 5e-3, "{found}");
    // One that is there is not replaced unasked.
    let run = whirl(at, "init run.csv -o rig.toml");
    assert_eq!(run.status, 2);
    assert!(run.stderr.contains("--force"), "{}", run.stderr);
    // whirl's own carries its rig file, whose truth stays out.
    rig_file(at, "single-pendulum.toml", "truth.toml", &[]);
    done(at, "simulate --rig truth.toml --seconds 30 --seed 1 -o own.parquet");
    done(at, "init own.parquet -o carried.toml");
    let carried = std::fs::read_to_string(at.join("carried.toml")).unwrap();
    assert!(carried.contains("frequency_hz = 2.5") && !carried.contains("[plant]"), "{carried}");
    assert!(done(at, "inspect own.parquet").contains("2.5 Hz"));
}

#[test]
fn what_a_file_leaves_open_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let told = |name: &str, text: &str| {
        std::fs::write(at.join(name), text).unwrap();
        let run = whirl(at, &format!("init {name} -o rig-{name}.toml"));
        assert_eq!((run.status, run.stderr.lines().count()), (2, 1), "{name}: {run:?}");
        assert!(!at.join(format!("rig-{name}.toml")).exists());
        run.stderr
    };
    let rows = |f: &dyn Fn(f64) -> String| (0..3000).map(|i| f(f64::from(i) * 0.01) + "\n").collect::<String>();
    let three = rows(&|t| format!("{t:.2},{:.4},{:.4},{:.4}", t.sin(), (1.3 * t).sin(), (1.7 * t).sin()));
    let e = told("three.csv", &format!("t,phi1,phi2,phi3\n{three}"));
    assert!(e.contains("--system") && e.contains("triple-pendulum"), "{e}");
    // Of two that are called a time the one that is one.
    std::fs::write(at.join("two.csv"), format!("time,timestamp,phi1,phi2\n{three}")).unwrap();
    let said = done(at, "init two.csv -o two.toml");
    assert!(said.contains("more than one column is called a time"), "{said}");
    let e = told("none.csv", &format!("a,b\n{}", rows(&|t| format!("{:.4},{:.4}", t.sin(), t.cos()))));
    assert!(e.contains("--time \"a\""), "{e}");
    let e = told("still.csv", &format!("t,angle\n{}", rows(&|t| format!("{t:.2},1"))));
    assert!(e.contains("does not change"), "{e}");
    done(at, "init three.csv --system triple-pendulum -o triple.toml");
    done(at, "inspect three.csv");
}

#[test]
fn a_measured_record_needs_no_rig_file() {
    let Some(records) = std::env::var_os("WHIRL_RECORDS").map(std::path::PathBuf::from) else {
        use std::io::Write as _;
        let _ = writeln!(
            std::io::stderr(),
            "own file, measured: did not run, WHIRL_RECORDS is not set; see README, \"Measured records\""
        );
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let record = records.join("multiarm/double.csv.gz");
    done(at, &format!("init {} -o rig.toml", record.display()));
    let rig = std::fs::read_to_string(at.join("rig.toml")).unwrap();
    for part in ["sample_rate_hz = 1000.0", "measures = \"phi1\"", "measures = \"phi2\"", "unit = \"rad\""] {
        assert!(rig.contains(part), "{part}: {rig}");
    }
    assert!(!rig.contains("\n[drive]"), "{rig}");
    let run = whirl(at, &format!("identify {} --rig rig.toml --json i.json", record.display()));
    assert!(run.status < 2, "{run:?}");
    let shipped = repository("rigs/measured-double-pendulum.toml");
    let run = whirl(at, &format!("identify {} --rig {} --json s.json", record.display(), shipped.display()));
    assert!(run.status < 2, "{run:?}");
    // B21: equation 2 has the same damping in both, equation 1 another.
    let value = |file: &str| {
        let out = json(&at.join(file));
        let all = out["parameters"].as_array().unwrap();
        all.iter().find(|p| p["name"] == "B21").unwrap()["value"].as_f64().unwrap()
    };
    assert!((value("i.json") / value("s.json") - 1.0).abs() < 1e-6);
}

/// A coefficient of which each record has its own, before those that all share: what is told of each
/// is its own.
#[test]
fn a_coefficient_of_each_record_is_told_beside_those_of_all() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let shipped = repository("rigs/duffing.toml");
    let own = std::fs::read_to_string(repository("models/duffing.toml")).unwrap();
    let own = own.replace("terms = { ", "terms = { offset = { of = \"1\", each = \"record\" }, ");
    std::fs::write(at.join("own.toml"), own).unwrap();
    let rig = std::fs::read_to_string(&shipped).unwrap().replace("../models/duffing.toml", "own.toml");
    std::fs::write(at.join("rig.toml"), &rig[..rig.find("[plant]").unwrap()]).unwrap();
    for (k, offset) in [(1, 0.8), (2, -0.5)] {
        let effect = format!("input-offset@force={offset}");
        let how = format!("--seconds 40 --seed {k} --effect {effect} -o r{k}.parquet");
        done(at, &format!("simulate --rig {} {how}", shipped.display()));
    }
    done(at, "identify r1.parquet r2.parquet --rig rig.toml --method weak --json i.json");
    done(at, "explain r1.parquet r2.parquet --rig rig.toml --json e.json");
    let told = |file: &str| -> Vec<(String, f64, f64)> {
        let out = json(&at.join(file));
        let all = out["parameters"].as_array().unwrap().clone();
        let number = |p: &serde_json::Value, key: &str| p[key].as_f64().unwrap();
        all.iter().map(|p| (p["name"].as_str().unwrap().into(), number(p, "value"), number(p, "std_error"))).collect()
    };
    let (weak, explained) = (told("i.json"), told("e.json"));
    assert_eq!(json(&at.join("e.json"))["verdict"], "nothing-missing", "{}", json(&at.join("e.json"))["reason"]);
    let names: Vec<&str> = explained.iter().map(|p| p.0.as_str()).collect();
    assert_eq!(names, ["offset_1", "offset_2", "m", "c", "k", "k3"]);
    for (name, value, error) in &explained {
        let (_, other, its) = weak.iter().find(|p| p.0 == *name).unwrap();
        assert!((value - other).abs() < 4.0 * error.hypot(*its), "{name}: {value} ± {error}, {other} ± {its}");
    }
}
