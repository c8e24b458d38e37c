use std::path::Path;

use super::*;
use crate::identify::{Identification, Settings, best};
use crate::record::{Column, ReadOptions, Record};

fn simulated(rig: &str, seconds: f64) -> (Rig, Record) {
    let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(rig)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("record.parquet");
    crate::simulate::record(&rig, &[], seconds, 7, &file, &indicatif::ProgressBar::hidden()).unwrap();
    let record = Record::read(&file, &rig, &ReadOptions::default()).unwrap();
    (rig, record)
}

/// The record as one whose encoders began to count elsewhere.
fn turned(record: &Record, by: [i32; 2]) -> Record {
    let mut out = record.clone();
    for segment in &mut out.segments {
        for (column, by) in segment.columns.iter_mut().zip(by) {
            if let Column::Counts(counts) = column {
                counts.iter_mut().for_each(|c| *c += by);
            }
        }
    }
    out
}

/// The record as of a device that saw both index marks, at these counts.
fn seen(record: &Record, indices: [Option<u32>; 2]) -> Record {
    use crate::record::DeviceBoot;
    use crate::record::device_boot::EncoderZero;
    let mut out = record.clone();
    let zeros = indices.map(|index| EncoderZero { index, ..EncoderZero::default() });
    out.metadata.as_mut().unwrap().device = vec![DeviceBoot { zeros: zeros.to_vec(), ..DeviceBoot::default() }];
    out
}

/// No parameter is 5 % less sure than where both zeros are known beforehand.
fn assert_cheap(rig: &Rig, record: &Record, sought: &Identification) {
    let mut marked = rig.clone();
    for (channel, at) in marked.channel.iter_mut().zip([700.0, 800.0]) {
        channel.index_at = Some(at);
    }
    let known = found(&[seen(record, [Some(700), Some(800)])], &marked);
    assert!(known.zeros.len() == 2 && known.zeros.iter().all(|z| z.from == INDEX), "{:?}", known.zeros);
    for (a, b) in sought.parameters.iter().zip(&known.parameters) {
        assert!(a.name == b.name && a.std_error < DEAR * b.std_error, "{a:?} {b:?} {:?}", sought.zeros);
    }
}

fn found(records: &[Record], rig: &Rig) -> Identification {
    let (weak, choices) = (Settings::default(), super::super::Settings::default());
    best::best(records, rig, &weak, &choices, &indicatif::ProgressBar::hidden()).unwrap()
}

/// Nine counts, where friction may hold the arm, and as many of the other encoder: found, and
/// the parameters are those of the record that counts from the right place.
#[test]
fn zeros_that_are_off_are_found_and_spoil_nothing() {
    let (rig, record) = simulated("chaotic.toml", 40.0);
    let count = core::f64::consts::TAU / 4096.0;
    let right = found(core::slice::from_ref(&record), &rig);
    let off = found(&[turned(&record, [9, -4])], &rig);
    assert_eq!(off.method, "shooting", "{:?}", off.not_by_shooting);
    for (z, by) in off.zeros.iter().zip([9.0, -4.0]) {
        assert_eq!((z.from.as_str(), z.record), (IDENTIFIED, 1));
        assert!((z.value - by * count).abs() < 4.0 * z.std_error && z.std_error < 0.2 * count, "{z:?}");
    }
    assert!(right.zeros.iter().all(|z| z.value.abs() < 4.0 * z.std_error), "{:?}", right.zeros);
    assert_cheap(&rig, &record, &right);
    let told = |of: &Identification| of.warnings.iter().filter(|w| w.id == "zero-off").count();
    assert_eq!((told(&right), told(&off)), (0, 2));
    for (a, b) in right.parameters.iter().zip(&off.parameters) {
        assert!((a.value - b.value).abs() < 0.1 * a.std_error, "{a:?} {b:?}");
    }
}

/// Where the index mark's place is known it tells the zero of a record that says at which count
/// it was seen, and the first record tells the mark's place.
#[test]
fn an_index_mark_tells_the_zero() {
    let (rig, record) = simulated("chaotic.toml", 40.0);
    let first = found(&[seen(&record, [None, Some(800)])], &rig);
    let at = first.zeros.iter().find_map(|z| z.index_at).unwrap();
    assert!((at - 800.0).abs() < 0.5, "{at}");
    // After another power-up, 30 counts off.
    let mut marked = rig.clone();
    marked.channel[1].index_at = Some(at);
    let second = found(&[seen(&turned(&record, [0, 30]), [None, Some(830)])], &marked);
    let zero = second.zeros.iter().find(|z| z.channel == "count2").unwrap();
    let count = core::f64::consts::TAU / 4096.0;
    assert!(zero.from == INDEX && (zero.value - (830.0 - at) * count).abs() < 1e-12, "{zero:?}");
    for (a, b) in first.parameters.iter().zip(&second.parameters) {
        assert!((a.value - b.value).abs() < a.std_error, "{a:?} {b:?}");
    }
}

/// Each record has zeros of its own.
#[test]
fn records_count_from_places_of_their_own() {
    let (rig, record) = simulated("chaotic.toml", 30.0);
    let all = found(&[record.clone(), turned(&record, [0, 6])], &rig);
    let zero = |record: usize, channel: &str| all.zeros.iter().find(|z| z.is_of(record, channel)).unwrap();
    let (first, second) = (zero(0, "count2"), zero(1, "count2"));
    let by = 6.0 * core::f64::consts::TAU / 4096.0;
    assert!((second.value - first.value - by).abs() < 3.0 * first.std_error, "{first:?} {second:?}");
}

/// A locked motion does not tell a zero from other parameters: it is held, which is said, and
/// the parameters are as precise as ever.
#[test]
fn a_locked_motion_holds_them() {
    let (rig, record) = simulated("seed.toml", 40.0);
    let all = found(core::slice::from_ref(&record), &rig);
    assert!(all.zeros.iter().any(|z| z.from == HELD && z.value == 0.0), "{:?}", all.zeros);
    assert!(all.warnings.iter().any(|w| w.id == "zeros-held"), "{:?}", all.warnings);
    // One seemed to be off while the other was sought, too.
    assert_cheap(&rig, &record, &all);
}

/// Equations that hold their zero themselves, since sin φ and cos φ are both in them, are not asked
/// for another.
#[test]
fn equations_that_hold_their_zero_have_no_other() {
    let (rig, record) = simulated("single-pendulum.toml", 30.0);
    let all = found(core::slice::from_ref(&record), &rig);
    assert!(all.zeros.is_empty() && all.warnings.iter().all(|w| w.id != "zeros-held"), "{:?}", all.warnings);
}
