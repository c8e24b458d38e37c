//! Whole records, as they are read: what is named, and what is left of them.

use std::path::Path;

use crate::record::{Column, ReadOptions, Record};
use crate::rig::Rig;

const RIG: &str = "name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n\
    [[channel]]\nname = \"a\"\nmeasures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = 4096\n\
    [[channel]]\nname = \"b\"\nmeasures = \"theta2\"\nunit = \"count\"\ncounts_per_turn = 4096\n";

fn motion() -> Vec<[i32; 2]> {
    (0..12_000)
        .map(|i| {
            let t = f64::from(i);
            [
                (400.0 * (0.03 * t).sin() + 90.0 * (0.07 * t).cos()).floor() as i32,
                (900.0 * (0.021 * t).sin() + 200.0 * (0.05 * t).cos()).floor() as i32,
            ]
        })
        .collect()
}

/// Reads rows as a CSV file would hold them; `blank` puts an empty line in front of that row.
fn read(rows: &[[i32; 2]], blank: usize) -> Record {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.csv");
    let mut text = "t,a,b\n".to_owned();
    for (i, [a, b]) in rows.iter().enumerate() {
        if i == blank {
            text.push('\n');
        }
        text += &format!("{},{a},{b}\n", i as f64 * 0.002);
    }
    std::fs::write(&path, text).unwrap();
    Record::read(&path, &Rig::parse(RIG, Path::new("rig.toml")).unwrap(), &ReadOptions::default()).unwrap()
}

#[test]
fn a_clean_record_passes_as_it_is() {
    let rows = motion();
    let record = read(&rows, usize::MAX);
    assert!(record.warnings.is_empty(), "{:?}", record.warnings);
    assert_eq!(record.segments[0].columns[1], Column::Counts(rows.iter().map(|r| r[1]).collect()));
}

#[test]
fn a_spike_is_left_out_filled_again_and_its_line_is_named() {
    let mut rows = motion();
    rows[7000][0] += 700;
    for (blank, line) in [(usize::MAX, 7002), (100, 7003)] {
        let record = read(&rows, blank);
        let ids: Vec<&str> = record.warnings.iter().map(|w| w.id).collect();
        assert_eq!(ids, ["spike", "gaps-filled"], "{:?}", record.warnings);
        let w = &record.warnings[0];
        assert!(
            w.id == "spike" && !w.invalidates && w.text.contains(&format!("line {line} (t = 14 s) by +700")),
            "{w:?}"
        );
        assert_eq!(
            (&w.details["row"], &w.details["channel"], &w.details["left_out"]),
            (&line.into(), &"a".into(), &1.into())
        );
        let clean = read(&motion(), usize::MAX);
        let (filled, whole) = (&record.segments[0], &clean.segments[0]);
        assert_eq!((record.segments.len(), filled.len(), filled.filled.len()), (1, 12_000, 1));
        assert_eq!(filled.filled[0], 7000..7001);
        let (Column::Counts(a), Column::Counts(b)) = (&filled.columns[0], &whole.columns[0]) else { panic!("counts") };
        assert!(a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) <= 1));
    }
}

#[test]
fn a_slip_is_taken_back() {
    let clean = motion();
    let mut rows = clean.clone();
    rows[5000..].iter_mut().for_each(|r| r[1] += 17);
    let record = read(&rows, usize::MAX);
    let w = &record.warnings[0];
    assert!(
        record.warnings.len() == 1 && w.id == "count-slip" && w.text.contains("line 5002 (t = 10 s) by +17 counts"),
        "{w:?}"
    );
    assert_eq!(record.segments.len(), 1);
    let Column::Counts(b) = &record.segments[0].columns[1] else { panic!() };
    assert!(b.iter().zip(&clean).all(|(b, r)| (b - r[1]).abs() <= 1));
}

#[test]
fn a_dead_channel_takes_the_answer_its_standing_and_a_stopped_one_only_its_rows() {
    let mut rows = motion();
    rows.iter_mut().for_each(|r| r[1] = 3);
    let record = read(&rows, usize::MAX);
    assert!(record.warnings.len() == 1 && record.warnings[0].id == "dead-channel" && record.warnings[0].invalidates);
    let mut rows = motion();
    let last = rows[6010][1];
    rows[6010..].iter_mut().for_each(|r| r[1] = last);
    let record = read(&rows, usize::MAX);
    let w = &record.warnings[0];
    assert!(record.warnings.len() == 1 && w.id == "channel-stopped" && !w.invalidates, "{:?}", record.warnings);
    assert!(record.samples().abs_diff(6010) <= 1 && w.text.contains("line 601"), "{w:?}");
}

#[test]
fn a_count_whose_lowest_bits_are_stuck_is_read_in_the_middle_of_its_steps() {
    let clean = read(&motion(), usize::MAX);
    for (keep, set) in [(!1, 0), (!3, 0), (!0, 1), (!3, 2)] {
        let rows: Vec<[i32; 2]> = motion().iter().map(|r| [r[0] & keep | set, r[1]]).collect();
        let record = read(&rows, usize::MAX);
        assert!(
            record.warnings.len() == 1 && record.warnings[0].id == "stuck-bit" && !record.warnings[0].invalidates,
            "{:?}",
            record.warnings
        );
        let [of, truth] = [&record, &clean].map(|r| r.segments[0].columns[0].angle(&r.channels[0]));
        let count = record.channels[0].scale();
        let mean = of.iter().zip(&truth).map(|(a, b)| (a - b) / count).sum::<f64>() / of.len() as f64;
        // Quantisation of some thousand samples, against half a count and more.
        assert!(mean.abs() < 0.05, "{keep} {set}: {mean}");
    }
}

#[test]
fn a_line_that_was_filled_in_is_left_out() {
    let noise = |i: usize| 1e-4 * (43_758.545 * (12.9898 * i as f64).sin()).fract();
    let mut x: Vec<f64> = (0..12_000).map(|i| (0.02 * i as f64).sin() + noise(i)).collect();
    let (a, b) = (x[5000], x[5150]);
    (5000..5150).for_each(|i| x[i] = a + (b - a) * (i - 5000) as f64 / 150.0);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.csv");
    let line = |(i, x): (usize, &f64)| format!("{},{x},{}\n", i as f64 * 0.002, 0.3 * (0.05 * i as f64).sin());
    std::fs::write(&path, "t,a,b\n".to_owned() + &x.iter().enumerate().map(line).collect::<String>()).unwrap();
    let rig = RIG.replace("unit = \"count\"\ncounts_per_turn = 4096\n", "unit = \"rad\"\n");
    let record =
        Record::read(&path, &Rig::parse(&rig, Path::new("rig.toml")).unwrap(), &ReadOptions::default()).unwrap();
    let [w] = &record.warnings[..] else { panic!("{:?}", record.warnings) };
    assert!(w.id == "filled-in" && !w.invalidates && w.details["channel"] == "a", "{w:?}");
    assert!(w.text.contains("line 5002 (t = 10 s)") && w.text.contains("line 5152 (t = 10.3 s)"), "{w:?}");
    let lengths: Vec<usize> = record.segments.iter().map(crate::record::Segment::len).collect();
    assert_eq!(lengths, [5000, 12_000 - 5151]);
}
