//! Blocks are what a record read as a whole holds, for every format and every kind of gap.

use std::fmt::Write;

use super::super::values::write_values;
use super::super::{Record, Segment};
use super::*;

fn rig(channels: &[(&str, Option<u32>)]) -> Rig {
    let mut text = "name = \"t\"\nmodel = \"chain\"\nsample_rate_hz = 100.0\n".to_owned();
    for (k, (unit, counts)) in channels.iter().enumerate() {
        let _ = write!(text, "[[channel]]\nname = \"c{k}\"\nmeasures = \"x{k}\"\nunit = \"{unit}\"\n");
        if let Some(n) = counts {
            let _ = writeln!(text, "counts_per_turn = {n}");
        }
    }
    Rig::parse(&text, Path::new("rig.toml")).unwrap()
}

/// Stretches glued together from blocks.
fn glued(path: &Path, rig: &Rig) -> (Vec<Vec<Vec<f64>>>, Summary, usize) {
    let (mut out, mut blocks): (Vec<Vec<Vec<f64>>>, usize) = (Vec::new(), 0);
    let summary = read(path, rig, &ReadOptions::default(), &mut |b| {
        blocks += 1;
        // Memory stays that of a block.
        assert!(b.columns.iter().map(Vec::len).sum::<usize>() <= BLOCK + rig.channel.len());
        match out.last_mut() {
            Some(last) if !b.begins => last.iter_mut().zip(&b.columns).for_each(|(l, c)| l.extend(c)),
            _ => out.push(b.columns.clone()),
        }
    })
    .unwrap();
    (out, summary, blocks)
}

fn of(record: &Record) -> Vec<Vec<Vec<f64>>> {
    let columns = |s: &Segment| s.columns.iter().zip(&record.channels).map(|(c, ch)| c.angle(ch)).collect();
    record.segments.iter().map(columns).collect()
}

fn compare(path: &Path, rig: &Rig) -> usize {
    let whole = Record::read(path, rig, &ReadOptions::default()).unwrap();
    let (stretches, summary, blocks) = glued(path, rig);
    assert_eq!(stretches, of(&whole));
    assert_eq!(summary.losses, whole.losses);
    assert!((summary.sample_rate_hz / whole.sample_rate_hz - 1.0).abs() < 1e-9);
    let kinds = |w: &[Warning]| {
        let mut of: Vec<_> = w.iter().map(|w| (w.id, w.text.clone())).collect();
        of.sort_unstable();
        of
    };
    assert_eq!(kinds(&summary.warnings), kinds(&whole.warnings));
    blocks
}

#[test]
fn a_csv_file_with_gaps_holes_and_wraps_comes_in_the_same_stretches() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig(&[("rad", None), ("count", Some(4096)), ("mm", None)]);
    let mut text = "t,c0,c1,c2\n".to_owned();
    // 200 000 rows are several blocks of three channels. Gaps and holes at random places, two in a
    // row and at both ends too.
    for i in 0..200_000_i64 {
        if matches!(i, 777 | 778 | 90_000..90_010 | 120_001 | 120_003) || i % 40_001 == 5 {
            continue;
        }
        let angle = 0.004 * i as f64;
        let wrapped = angle.sin().atan2(angle.cos());
        let count = (i * 7).rem_euclid(4096);
        let hole = matches!(i, 0 | 50_000 | 50_001 | 120_005 | 199_999) || i % 87_380 < 3;
        let value = if hole { String::new() } else { format!("{}", (0.01 * i as f64).sin()) };
        let _ = writeln!(text, "{:.3},{wrapped:?},{count},{value}", 0.01 * i as f64 + 3.0);
    }
    let path = folder.path().join("a.csv");
    std::fs::write(&path, &text).unwrap();
    assert!(compare(&path, &rig) > 3);
    let size = size(&path, &rig).unwrap().unwrap();
    assert!((400_000..900_000).contains(&size), "{size}");
}

/// An angle that is counted on is left as it stands, and one modulo a turn beside it is not.
#[test]
fn an_angle_of_many_turns_comes_as_it_stands() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = rig(&[("deg", None), ("rad", None)]);
    rig.channel[1].gain = Some(-1.0);
    let mut text = "t,c0,c1\n".to_owned();
    let speed = |i: u32| 340.0 * f64::from(i) + 9e4 * (1e-3 * f64::from(i)).sin();
    let angle = |i: u32| 0.3 * f64::from(i);
    for i in 0..20_000 {
        let wrapped = angle(i).sin().atan2(angle(i).cos());
        let _ = writeln!(text, "{:.2},{:?},{wrapped:?}", 0.01 * f64::from(i), speed(i));
    }
    let path = folder.path().join("a.csv");
    std::fs::write(&path, &text).unwrap();
    let (stretches, summary, _) = glued(&path, &rig);
    let told: Vec<&str> = summary.warnings.iter().map(|w| &*w.text).collect();
    assert!(matches!(told[..], [one] if one.starts_with("c1 is recorded modulo")), "{told:?}");
    let last = stretches[0][0].last().unwrap().to_degrees();
    assert!((last / speed(19_999) - 1.0).abs() < 1e-9, "{last}");
}

#[test]
fn parquet_and_gzip_come_in_the_same_stretches() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig(&[("m", None), ("m", None), ("m", None), ("m", None)]);
    let columns: Vec<Column> = (0..4)
        .map(|c| Column::Values((0..150_000).map(|i| (0.01 * (c + 1) as f64 * i as f64).sin()).collect()))
        .collect();
    for name in ["a.parquet", "a.csv.gz"] {
        let path = folder.path().join(name);
        write_values(&path, &rig, &columns).unwrap();
        assert!(compare(&path, &rig) >= 3, "{name}");
    }
    assert_eq!(size(&folder.path().join("a.parquet"), &rig).unwrap(), Some(600_000));
}

#[test]
fn what_cannot_be_streamed_and_what_is_broken_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig(&[("m", None)]);
    let path = folder.path().join("a.csv");
    let tried = |text: &str, options: &ReadOptions| {
        std::fs::write(&path, text).unwrap();
        read(&path, &rig, options, &mut |_| {}).map_err(|e| e.to_string())
    };
    let plain = ReadOptions::default();
    for (text, says) in [
        ("t,c0\n", "no row"),
        ("t,c0\n0,\n0.01,\n", "no row with a value"),
        ("t,c0\n0,1\n0.01,2\n0.01,3\n", "a second time"),
        ("t,c0\n0,1\n0.5,2\n1.0,3\n", "sample_rate_hz"),
        ("t,c0\n0,1\n0.01,x\n", "a number in m"),
        ("t,c0\n0,1\n0.01,2\n0.02", "torn last line"),
    ] {
        let error = tried(text, &plain).unwrap_err();
        assert!(error.contains(says), "{error}");
    }
    let mended = tried("t,c0\n0,1\n0.01,2\n0.02", &ReadOptions { recover: true, ..plain }).unwrap();
    assert_eq!(mended.losses.received, 2);
    assert!(tried("t,c0\n0,1\n", &ReadOptions { resample: true, ..plain }).unwrap_err().contains("resample"));
    let npz = folder.path().join("a.npz");
    std::fs::write(&npz, b"PK\x03\x04").unwrap();
    assert!(read(&npz, &rig, &plain, &mut |_| {}).unwrap_err().to_string().contains("Parquet or CSV"));
}
