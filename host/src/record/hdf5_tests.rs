use std::path::PathBuf;

use super::super::{Column, Record};
use super::*;

/// Files that h5py (as MATLAB's 7.3 and plain) and Octave wrote: see `make.py` beside them.
fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/records").join(name)
}

fn rig(first: &str, second: &str, more: &str) -> Rig {
    let channel = |name: &str, measures: &str| {
        format!("[[channel]]\nname = '{name}'\nmeasures = \"{measures}\"\nunit = \"count\"\ncounts_per_turn = 4096\n")
    };
    let head = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 500.0\n";
    let text = format!("{head}{more}{}{}", channel(first, "a"), channel(second, "b"));
    Rig::parse(&text, Path::new("rig.toml")).unwrap()
}

/// The counts that `make.py` puts into every file.
fn counts() -> [Column; 2] {
    let t = |i: i32| f64::from(i) / 500.0;
    let first = |t: f64| (900.0 * (5.1 * t).cos() + 260.0 * (11.3 * t + 0.4).cos()).floor() as i32;
    let second = |t: f64| (700.0 * (11.3 * t).cos() - 310.0 * (5.1 * t + 0.2).cos()).floor() as i32;
    [Column::Counts((0..400).map(|i| first(t(i))).collect()), Column::Counts((0..400).map(|i| second(t(i))).collect())]
}

#[test]
fn files_of_other_programs_are_read() {
    for (file, first, second, time) in [
        ("plain-7.3.mat", "count1", "count2", ""),
        ("nested-7.3.mat", "run.counts{1}", "run.counts{2}", ""),
        ("nested-7.3.mat", "m(:,2)", "m(:,3)", "time = 'm(:,1)'\n"),
        ("nested-7.3.mat", "m(:,2)", "m(:,3)", "time = 'many(2).x'\n"),
        ("h5py.h5", "run/counts[:,0]", "run/counts[:,1]", ""),
        ("octave.h5", "count1", "count2", ""),
        ("scipy-5.mat", "run.a", "run.deep.b", ""),
        ("scipy-5.mat", "a", "b", ""),
        ("scipy-5.mat", "m(:,2)", "m(:,3)", "time = 'm(:,1)'\n"),
        ("octave-5.mat", "run.c{1}", "run.c{2}", ""),
        ("octave-5.mat", "m(:,2)", "m(:,3)", "time = 'many(2).x'\n"),
    ] {
        let rig = rig(first, second, time);
        let record =
            Record::read(golden(file), &rig, &ReadOptions::default()).unwrap_or_else(|e| panic!("{file}: {e}"));
        assert_eq!((record.samples(), record.segments.len()), (400, 1), "{file}");
        assert_eq!(record.segments[0].columns, counts(), "{file}, {first}");
        assert!((record.segments[0].step_s - 0.002).abs() < 1e-12, "{file}");
    }
}

#[test]
fn what_is_no_vector_of_numbers_says_what_it_is() {
    for (file, name, parts) in [
        ("nested-7.3.mat", "run.note", &["array run.note", "a text"][..]),
        ("nested-7.3.mat", "m", &["400 × 3", "\"m(:,1)\""]),
        ("nested-7.3.mat", "speed", &["\"run.counts{1}\"", "a column speed"]),
        ("h5py.h5", "note", &["texts", "Save numbers"]),
        ("h5py.h5", "run/counts", &["400 × 2", "\"run/counts[:,0]\""]),
        ("octave-5.mat", "run.c{3}", &["a text"]),
        ("octave-5.mat", "z", &["a complex array", "real(x)"]),
        ("octave-5.mat", "s", &["a sparse array", "full(x)"]),
        ("octave-5.mat", "m", &["400 × 3", "\"m(:,1)\""]),
    ] {
        let mut rig = rig(name, "count2", "");
        rig.channel.truncate(1);
        let message = Record::read(golden(file), &rig, &ReadOptions::default()).unwrap_err().to_string();
        assert!(parts.iter().all(|p| message.contains(p)), "{file}: {parts:?}: {message}");
        assert!(message.contains(file), "{message}");
    }
}

#[test]
fn damage_is_told_and_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.mat");
    let whole = std::fs::read(golden("plain-7.3.mat")).unwrap();
    let rig = rig("count1", "count2", "");
    for cut in [200, 600, 2000, whole.len() / 2] {
        std::fs::write(&path, &whole[..cut]).unwrap();
        let message = Record::read(&path, &rig, &ReadOptions::default()).unwrap_err().to_string();
        assert!(message.contains("r.mat") && message.contains("Copy the file again"), "{cut}: {message}");
    }
    for k in (512..whole.len()).step_by(37) {
        let mut bytes = whole.clone();
        bytes[k] ^= 0x81;
        std::fs::write(&path, bytes).unwrap();
        let _ = Record::read(&path, &rig, &ReadOptions::default());
    }
}
