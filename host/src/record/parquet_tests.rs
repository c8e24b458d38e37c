//! Tests of Parquet records: round trip, recovery, foreign files, damage.

use std::path::PathBuf;

use std::fs::File;

use parquet::basic::Compression;
use parquet::data_type::{DoubleType, FloatType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;

use super::*;
use crate::record::{Column, RecordWriter, Segment, writer::Sample};

pub(super) const RIG: &str = "name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n\
    [[channel]]\nname = \"count1\"\nmeasures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = 4096\n\
    [[channel]]\nname = \"count2\"\nmeasures = \"theta2\"\nunit = \"count\"\ncounts_per_turn = 4096\n";

pub(super) fn rig() -> Rig {
    Rig::parse(RIG, Path::new("rig.toml")).unwrap()
}

pub(super) fn metadata() -> Metadata {
    Metadata {
        rig: RIG.to_owned(),
        firmware: "whirl-firmware 0.1.0".into(),
        board: "test".into(),
        started_at: Some("2026-01-02T03:04:05Z".into()),
        source: "sim".into(),
        written_by: "whirl 0.1.0".into(),
        sample_rate_hz: 500.0,
        boots: Vec::new(),
        device: Vec::new(),
        lines: Vec::new(),
        excitation: None,
        table: Vec::new(),
        level: None,
    }
}

pub(super) fn sample(i: i64) -> ([i32; 2], u32) {
    ([(2000.0 * (i as f64 * 0.01).sin()) as i32, (i * 31) as i32], (i as u32).wrapping_mul(42_949_673))
}

/// A record of ticks 1000.., without those in `gap`.
pub(super) fn write(path: &Path, n: i64, gap: std::ops::Range<i64>) -> Losses {
    let mut w = RecordWriter::create(path, &metadata(), &rig()).unwrap();
    for i in (0..n).filter(|i| !gap.contains(i)) {
        let (counts, phase) = sample(i);
        w.push(&Sample { tick: 1000 + i, counts: &counts, phase, amplitude_nm: 15_525_000 }).unwrap();
    }
    let losses = Losses { received: w.rows(), damaged: (gap.end - gap.start) as u64, gaps: 1, ..Default::default() };
    w.finish(&losses).unwrap();
    losses
}

pub(super) fn read_with(path: &Path, recover: bool) -> Result<Record> {
    Record::read(path, &rig(), &ReadOptions { recover, ..ReadOptions::default() })
}

pub(super) fn dir() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.parquet");
    (dir, path)
}

#[test]
fn a_record_comes_back_as_it_was_written() {
    let (_dir, path) = dir();
    let losses = write(&path, 9000, 4000..4010);
    let r = read_with(&path, false).unwrap();
    assert_eq!(r.metadata, Some(metadata()));
    assert_eq!(r.losses, losses);
    assert_eq!(r.segments.iter().map(Segment::len).collect::<Vec<_>>(), [4000, 4990]);
    let s = &r.segments[1];
    assert_eq!((s.first_tick, s.start_s, s.step_s), (5010, 10.02, 0.002));
    assert_eq!(s.columns[0], Column::Counts((4010..9000).map(|i| sample(i).0[0]).collect()));
    assert_eq!(s.phase.as_deref().unwrap()[5], sample(4015).1);
    assert_eq!(s.amplitude_nm.as_deref().unwrap()[0], 15_525_000);
}

#[test]
fn without_footer_the_record_is_read_up_to_its_last_whole_group() {
    let (_dir, path) = dir();
    write(&path, 9000, 0..0);
    let whole = std::fs::read(&path).unwrap();
    let footer = whole.len() - 2000;
    for cut in [whole.len() - 1, footer, whole.len() / 2] {
        std::fs::write(&path, &whole[..cut]).unwrap();
        let e = read_with(&path, false).unwrap_err().to_string();
        let r = read_with(&path, true).unwrap();
        let n = r.samples();
        assert!(n > 0 && (n.is_multiple_of(2500) || n == 9000), "{n}");
        assert!(e.contains(&format!("the last whole row is row {n} (t = ")) && e.contains("--recover"), "{e}");
        assert_eq!(r.segments[0].columns[1], Column::Counts((0..n as i64).map(|i| sample(i).0[1]).collect()));
        assert_eq!(r.metadata, Some(metadata()));
        assert!(r.warnings.iter().any(|w| w.id == "recovered"));
    }
    std::fs::write(&path, &whole[..300]).unwrap();
    let e = read_with(&path, true).unwrap_err().to_string();
    assert!(e.contains("no row is whole"), "{e}");
}

#[test]
fn a_crash_leaves_whole_groups() {
    let (_dir, path) = dir();
    let mut w = RecordWriter::create(&path, &metadata(), &rig()).unwrap();
    for i in 0..6000 {
        let (counts, phase) = sample(i);
        w.push(&Sample { tick: i, counts: &counts, phase, amplitude_nm: 0 }).unwrap();
    }
    // The process is gone: no finish.
    drop(w);
    assert_eq!(read_with(&path, true).unwrap().samples(), 5000);
}

#[test]
fn boots_are_kept_with_and_without_a_footer() {
    let (_dir, path) = dir();
    for whole in [true, false] {
        let mut w = RecordWriter::create(&path, &metadata(), &rig()).unwrap();
        // The second boot begins within the second row group, the third within the fourth.
        for i in (0..11_000).filter(|i| ![3000, 9000].contains(i)) {
            if [3001, 9001].contains(&i) {
                w.boot(i);
            }
            let (counts, phase) = sample(i);
            w.push(&Sample { tick: i, counts: &counts, phase, amplitude_nm: 0 }).unwrap();
        }
        if whole {
            w.finish(&Losses::default()).unwrap();
        } else {
            drop(w);
        }
        let r = read_with(&path, true).unwrap();
        let boots: Vec<_> = r.segments.iter().map(|s| (s.first_tick, s.boot)).collect();
        assert_eq!(boots, [(0, 0), (3001, 1), (9001, 2)], "whole {whole}");
        assert_eq!(r.metadata.unwrap().boots, [3001, 9001]);
    }
}

#[test]
fn another_encoder_is_refused() {
    let (_dir, path) = dir();
    write(&path, 3000, 0..0);
    let other = Rig::parse(&RIG.replacen("4096", "1024", 1), Path::new("other.toml")).unwrap();
    let e = Record::read(&path, &other, &ReadOptions::default()).unwrap_err().to_string();
    assert!(e.contains("1024") && e.contains("4096") && e.contains("other.toml"), "{e}");
    let missing = Rig::parse(&RIG.replacen("count1", "cuont1", 1), Path::new("other.toml")).unwrap();
    let e = Record::read(&path, &missing, &ReadOptions::default()).unwrap_err().to_string();
    assert!(e.contains("Did you mean count1?"), "{e}");
}

#[test]
fn a_rig_file_that_measures_something_else_or_cannot_be_compared_is_told() {
    let (_dir, path) = dir();
    write(&path, 3000, 0..0);
    let told = |rig: &Rig| {
        let r = Record::read(&path, rig, &ReadOptions::default()).unwrap();
        r.warnings.into_iter().filter(|w| w.id == "rig-metadata").map(|w| w.text).collect::<Vec<_>>()
    };
    assert_eq!(told(&rig()), Vec::<String>::new());
    let other = Rig::parse(&RIG.replacen("theta2", "phi2", 1), Path::new("other.toml")).unwrap();
    assert_eq!(told(&other), ["count2 measures phi2 in the rig file, and theta2 in the record"]);
    let mut w = RecordWriter::create(&path, &Metadata { rig: "no rig".into(), ..metadata() }, &rig()).unwrap();
    for i in 0..3000 {
        w.push(&Sample { tick: i, counts: &sample(i).0, phase: 0, amplitude_nm: 0 }).unwrap();
    }
    w.finish(&Losses::default()).unwrap();
    let told = told(&rig());
    assert!(told.len() == 1 && told[0].contains("cannot be read"), "{told:?}");
}

/// A Parquet file by another hand.
fn foreign(path: &Path, schema: &str, compression: Compression, t: impl Fn(usize) -> f64, nulls: bool) {
    let schema = Arc::new(parse_message_type(schema).unwrap());
    let properties = WriterProperties::builder().set_compression(compression).build();
    let file = File::create(path).unwrap();
    let mut w = SerializedFileWriter::new(file, schema, Arc::new(properties)).unwrap();
    let n = 1500;
    for k in 0..2 {
        let rows = k * n..(k + 1) * n;
        let mut g = w.next_row_group().unwrap();
        let mut c = g.next_column().unwrap().unwrap();
        let times: Vec<f64> = rows.clone().map(&t).collect();
        c.typed::<DoubleType>().write_batch(&times, None, None).unwrap();
        c.close().unwrap();
        let mut c = g.next_column().unwrap().unwrap();
        let levels: Vec<i16> = rows.clone().map(|i| i16::from(!(nulls && i == 700))).collect();
        let values: Vec<i64> = rows.clone().filter(|i| !(nulls && *i == 700)).map(|i| (i % 7) as i64).collect();
        c.typed::<Int64Type>().write_batch(&values, Some(&levels), None).unwrap();
        c.close().unwrap();
        let mut c = g.next_column().unwrap().unwrap();
        let values: Vec<f32> = rows.map(|i| (i * 5) as f32).collect();
        c.typed::<FloatType>().write_batch(&values, None, None).unwrap();
        c.close().unwrap();
        g.close().unwrap();
    }
    w.close().unwrap();
}

const FOREIGN: &str = "message m { required double t; optional int64 count1; required float count2; }";

#[test]
fn columns_that_are_no_numbers_say_what_they_are() {
    let (_dir, path) = dir();
    for (kind, told) in [
        ("binary count1 (UTF8)", "BYTE_ARRAY"),
        ("boolean count1", "BOOLEAN"),
        ("int32 count1 (DATE)", "(INT32)"),
        ("int64 count1 (DECIMAL(18,2))", "(INT64)"),
        ("int96 count1", "INT96"),
    ] {
        let schema = format!("message m {{ required double t; required {kind}; required float count2; }}");
        let schema = Arc::new(parse_message_type(&schema).unwrap());
        SerializedFileWriter::new(File::create(&path).unwrap(), schema, Default::default()).unwrap().close().unwrap();
        let e = read_with(&path, false).unwrap_err().to_string();
        assert!(e.contains("column count1: found the type ") && e.contains(told) && e.contains("float64"), "{e}");
    }
}

#[test]
fn foreign_files_are_read() {
    let (_dir, path) = dir();
    for compression in [
        Compression::UNCOMPRESSED,
        Compression::SNAPPY,
        Compression::ZSTD(Default::default()),
        Compression::GZIP(Default::default()),
        Compression::BROTLI(Default::default()),
        Compression::LZ4,
        Compression::LZ4_RAW,
    ] {
        foreign(&path, FOREIGN, compression, |i| 5.0 + i as f64 * 0.002, true);
        let r = read_with(&path, false).unwrap();
        assert_eq!(r.segments.iter().map(Segment::len).collect::<Vec<_>>(), [700, 2299]);
        assert_eq!((r.losses.nan_rows, r.metadata.is_none()), (1, true));
        assert_eq!(r.segments[1].columns[0], Column::Counts((701..3000).map(|i| i % 7).collect()));
        assert_eq!(r.segments[0].columns[1], Column::Counts((0..700).map(|i| i * 5).collect()));
        assert!(r.warnings[0].text.contains("row 701 in count1"), "{:?}", r.warnings);
    }
    foreign(&path, FOREIGN, Compression::SNAPPY, |i| if i == 900 { f64::NAN } else { i as f64 * 0.002 }, false);
    let e = read_with(&path, false).unwrap_err().to_string();
    assert!(e.contains("row 901, column t") && e.contains("NaN"), "{e}");
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let e = read_with(&path, true).unwrap_err().to_string();
    assert!(e.contains("truncated") && e.contains("only whirl's own"), "{e}");
}

#[test]
fn mutated_bytes_never_panic_nor_lie() {
    use rand::{Rng, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let (_dir, path) = dir();
    write(&path, 2600, 0..0);
    let own = std::fs::read(&path).unwrap();
    foreign(&path, FOREIGN, Compression::SNAPPY, |i| i as f64 * 0.002, true);
    let other = std::fs::read(&path).unwrap();
    let truth: Vec<i32> = (0..2600).map(|i| sample(i).0[0]).collect();
    let (mut good, mut bad) = (0, 0);
    for round in 0..1500 {
        let mut bytes = if round % 2 == 0 { own.clone() } else { other.clone() };
        // Footers are short and hold all structure: half of the damage goes there.
        let tail = rng.next_u32() % 2 == 0;
        for _ in 0..1 + rng.next_u32() % 3 {
            let n = bytes.len();
            let i = if tail { n - 1 - rng.next_u32() as usize % 900.min(n) } else { rng.next_u32() as usize % n };
            match rng.next_u32() % 5 {
                0 => bytes[i] ^= 1 << (rng.next_u32() % 8),
                1 => bytes[i] = 0xff,
                2 => bytes.truncate((i + 1).max(8)),
                3 => bytes.insert(i, rng.next_u32() as u8),
                _ => bytes[i] = rng.next_u32() as u8,
            }
        }
        std::fs::write(&path, &bytes).unwrap();
        match read_with(&path, round % 3 == 0) {
            Ok(r) => {
                good += 1;
                if round % 2 == 0 {
                    // Whatever is still read of whirl's own record is what was written, in its
                    // place.
                    for segment in &r.segments {
                        let Column::Counts(c) = &segment.columns[0] else { panic!("counts") };
                        let from = (segment.start_s * 500.0).round() as usize - 1000;
                        assert!(truth[from..].starts_with(c), "round {round}, row {from}: {:?}", r.warnings);
                    }
                }
            }
            Err(e) => bad += usize::from(!e.to_string().is_empty()),
        }
    }
    assert!(good > 100 && bad > 500, "{good} {bad}");
}
