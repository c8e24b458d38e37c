//! Tests of CSV records: what is accepted, and one message for each kind of bad input.

use std::io::Write;
use std::path::PathBuf;

use super::*;
use crate::record::Column;
use crate::record::{Losses, Metadata, RecordWriter, writer::Sample};

const RIG: &str = "name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n\
    [[channel]]\nname = \"count1\"\nmeasures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = 4096\n\
    [[channel]]\nname = \"angle\"\nmeasures = \"theta2\"\nunit = \"rad\"\n";

fn rig() -> Rig {
    Rig::parse(RIG, Path::new("rig.toml")).unwrap()
}

struct Dir(tempfile::TempDir);

impl Dir {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

fn read(text: &str) -> Result<Record> {
    let dir = Dir::new();
    Record::read(dir.file("r.csv", text.as_bytes()), &rig(), &ReadOptions::default())
}

fn error(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

/// `n` good rows from t = 3 s.
fn rows(n: usize) -> String {
    let mut text = "t,count1,extra,angle\n".to_owned();
    for i in 0..n {
        text += &format!("{:.3},{},x,{}\n", 3.0 + i as f64 * 0.002, i * 3, 0.5 + i as f64 * 1e-3);
    }
    text
}

#[test]
fn a_plain_record_is_read_as_it_stands() {
    let r = read(&rows(400)).unwrap();
    assert_eq!((r.segments.len(), r.samples(), r.losses.received), (1, 400, 400));
    let s = &r.segments[0];
    assert!((s.start_s - 3.0).abs() < 1e-9 && (s.step_s - 0.002).abs() < 1e-12 && s.jitter_s < 1e-9);
    assert_eq!(s.columns[0], Column::Counts((0..400).map(|i| i * 3).collect()));
    assert!((r.sample_rate_hz - 500.0).abs() < 1e-6 && r.warnings.is_empty() && r.metadata.is_none());
    assert!((r.longest_segment_s() - 0.8).abs() < 1e-9 && (r.duration_s() - 0.8).abs() < 1e-9);
}

#[test]
fn dialects_are_accepted() {
    let plain = read(&rows(50)).unwrap();
    let crlf = format!("\u{feff}{}", rows(50).replace('\n', "\r\n"));
    let semicolon = rows(50).replace(',', ";").replace('.', ",");
    let tabs = rows(50).replace(',', "\t");
    let quoted = rows(50).replace(",x,", ",\"a, \"\"b\"\"\",").replace("t,count1", "\"t\",\"count1\"");
    let blank = rows(50) + "\n\r\n";
    let no_end = rows(50).trim_end().to_owned();
    for text in [crlf, semicolon, tabs, quoted, blank, no_end] {
        let r = read(&text).unwrap_or_else(|e| panic!("{e}\n{}", &text[..80]));
        assert_eq!(r.segments[0].columns, plain.segments[0].columns);
        assert_eq!(r.segments[0].start_s, plain.segments[0].start_s);
    }
}

#[test]
fn gaps_split_or_are_filled_and_are_counted() {
    let text: String = rows(300)
        .lines()
        .enumerate()
        .filter(|(i, _)| !(100..110).contains(i) && *i != 200)
        .map(|(_, l)| format!("{l}\n"))
        .collect();
    let r = read(&text).unwrap();
    assert_eq!(r.segments.iter().map(Segment::len).collect::<Vec<_>>(), [99, 191]);
    assert_eq!((r.losses.gaps, r.losses.lost_on_link, r.losses.received), (2, 11, 289));
    assert_eq!(r.segments[1].first_tick, 109);
    assert!((r.segments[1].start_s - 3.218).abs() < 1e-6, "{}", r.segments[1].start_s);
    let ids: Vec<_> = r.warnings.iter().map(|w| (w.id, w.text.as_str())).collect();
    let filled = "1 row that is missing or left out, in gaps of up to 1 row, was filled from those around; 2 unbroken stretches left";
    assert_eq!(ids, [("gaps", "2 gaps in t: 11 rows missing, 2 unbroken stretches left"), ("gaps-filled", filled)]);
}

use crate::record::Segment;

#[test]
fn nan_is_a_gap_with_one_warning() {
    let text = rows(300)
        .replace("3.100,150,", "3.100,,")
        .replace("3.102,153,", "3.102,NaN,")
        .replace("3.400,600,x,0.7", "3.400,600,x,nan");
    let r = read(&text).unwrap();
    assert_eq!((r.losses.nan_rows, r.segments.len(), r.losses.received, r.losses.gaps), (3, 1, 297, 0));
    let w: Vec<_> = r.warnings.iter().filter(|w| w.id == "nan-is-gap").collect();
    assert_eq!(w.len(), 1);
    assert!(w[0].text.contains("3 of 300") && w[0].text.contains("line 52 in count1"), "{}", w[0].text);
    // Resampled it has none left to warn of; two in a row, a gap there, are filled.
    let dir = Dir::new();
    let options = ReadOptions { resample: true, ..ReadOptions::default() };
    let r = Record::read(dir.file("r.csv", text.as_bytes()), &rig(), &options).unwrap();
    assert_eq!((r.losses.nan_rows, r.segments.len()), (0, 1));
    let ids: Vec<_> = r.warnings.iter().map(|w| w.id).collect();
    assert!(ids.contains(&"resampled") && !ids.contains(&"nan-is-gap"), "{ids:?}");
}

#[test]
fn each_bad_input_has_its_message() {
    let good = rows(20);
    let cases: &[(String, &[&str])] = &[
        (good.replace("3.010,15", "NaN,15"), &["r.csv", "line 7", "column t", "NaN"]),
        (good.replace("3.010,15", ",15"), &["line 7", "column t", "NaN"]),
        (good.replace("3.010,15", "noon,15"), &["line 7", "column t", "\"noon\""]),
        (good.replace("3.010,15", "3.008,15"), &["line 7", "3.008 a second time", "more digits", "stamped in lots"]),
        (
            (0..20).fold("t,count1,angle\n".to_owned(), |s, i| s + &format!("{},{i},0.1,7\n", f64::from(i) * 0.002)),
            &["line 2", "found 4 cells", "All rows have 4: the header row is short", "t,count1,angle,c4"],
        ),
        (good.replace("3.010,15", "3.001,15"), &["line 7", "3.001 after 3.008"]),
        (good.replace("3.010,15", "inf,15"), &["line 7", "column t", "inf"]),
        (good.replace("3.010,15,x,0.505", "3.010,15,x,inf"), &["line 7", "column angle", "inf"]),
        (good.replace("3.010,15,x,0.505", "3.010,15,x,1e999"), &["line 7", "column angle", "inf"]),
        (good.replace("3.010,15", "3.010,abc"), &["line 7", "column count1", "\"abc\"", "a number in count"]),
        (good.replace("3.010,15,", "3.010,15.5,"), &["line 7", "column count1", "15.5", "whole number"]),
        (good.replace("3.010,15,", "3.010,2147483648,"), &["line 7", "column count1", "2147483648", "32 bits"]),
        (good.replace("3.010,15,", "3.010,-1e15,"), &["line 7", "column count1", "32 bits"]),
        (good.replace("3.010,15,", "3.010,"), &["line 7", "3 cells", "4 as in the header"]),
        (good.replace("3.010,15,", "3.010,\"15,"), &["line 7", "quote"]),
        (good.replace("count1", "cuont1"), &["header", "\"cuont1\"", "column count1", "Did you mean cuont1?"]),
        (good.replace("t,count1", "tame,count1"), &["header", "a column t", "--time"]),
        (good.replace("extra", "count1"), &["the column count1 twice"]),
        (good.lines().skip(1).map(|l| format!("{}\n", l.replace('x', "0"))).collect(), &["header row", "t,count1"]),
        ("t,count1,angle\n".to_owned(), &["no row", "below the header"]),
        ("\n\n".to_owned(), &["no line", "header"]),
        (String::new(), &["empty file"]),
        (rows(100) + &rows(100).replace("3.", "1.")[21..], &["line 102", "1 after 3.198"]),
        ("t,count1,angle\n0,,1\n0.002,,1\n".to_owned(), &["no row with a value in every channel"]),
        (
            (0..50).fold("t,count1,angle\n".to_owned(), |s, i| s + &format!("{},{i},0.1\n", f64::from(i) * 0.004)),
            &["250 Hz", "500 Hz", "sample_rate_hz = 250 in"],
        ),
        (
            (0..50).fold("t,count1,angle\n".to_owned(), |s, i| s + &format!("{},{i},0.1\n", i * 2)),
            &["times 2 apart", "The time is in ms", "time_unit"],
        ),
    ];
    for (text, parts) in cases {
        let message = error(text);
        for part in *parts {
            assert!(message.contains(part), "{part:?} is not in: {message}");
        }
        assert!(!message.contains('\n'), "{message}");
    }
    let dir = Dir::new();
    for (name, bytes) in [("a.csv", &b"PK\x03\x04\0\0"[..]), ("b.bin", b"\0\x01\x02"), ("c.parquet", b"t,count1\n")] {
        let r = Record::read(dir.file(name, bytes), &rig(), &ReadOptions::default());
        assert!(r.is_err(), "{name}");
    }
    let mixed = |cell: &str| {
        (0..20).fold("t;count1;angle\n".to_owned(), |s, i| s + &format!("{:.3};{i};{cell}\n", f64::from(i) * 0.002))
    };
    let told = error(&mixed("124,320"));
    assert!(told.contains("found \"124,320\" beside \"0.000\"") && told.contains("thousands"), "{told}");
    assert!(read(&mixed("0,125")).is_ok());
    // Cut within its last number.
    assert_eq!(read(rows(50).trim_end().trim_end_matches("49")).unwrap().samples(), 49);
    assert!(Record::read(dir.0.path().join("none.csv"), &rig(), &ReadOptions::default()).is_err());
    assert!(Record::read(dir.0.path(), &rig(), &ReadOptions::default()).unwrap_err().to_string().contains("folder"));
}

#[test]
fn integral_floats_are_counts() {
    let r = read(&rows(20).replace(",15,x", ",15.0,x")).unwrap();
    assert_eq!(r.segments[0].columns[0], Column::Counts((0..20).map(|i| i * 3).collect()));
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut e = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

#[test]
fn a_truncated_gzip_names_the_last_whole_row_and_is_recovered() {
    let dir = Dir::new();
    let whole = gzip(rows(4000).as_bytes());
    let full = Record::read(dir.file("w.csv.gz", &whole), &rig(), &ReadOptions::default()).unwrap();
    assert_eq!(full.samples(), 4000);
    // Also two members, one after the other.
    let text = rows(4000);
    let (a, b) = text.as_bytes().split_at(30_011);
    let two = [gzip(a), gzip(b)].concat();
    assert_eq!(Record::read(dir.file("two.gz", &two), &rig(), &ReadOptions::default()).unwrap().samples(), 4000);

    for cut in [whole.len() / 3, whole.len() / 2, whole.len() - 9, whole.len() - 1] {
        let path = dir.file("cut.csv.gz", &whole[..cut]);
        let e = Record::read(&path, &rig(), &ReadOptions::default()).unwrap_err().to_string();
        assert!(e.contains("truncated gzip") && e.contains("--recover"), "{e}");
        let r = Record::read(&path, &rig(), &ReadOptions { recover: true, ..ReadOptions::default() }).unwrap();
        let (s, n) = (&r.segments[0], r.samples());
        assert!(n > 500 && n <= 4000);
        assert!(e.contains(&format!("the last whole row is line {} (t = ", n + 1)), "{n} rows: {e}");
        assert_eq!(s.columns[0], Column::Counts((0..n as i32).map(|i| i * 3).collect()));
        assert!(r.warnings.iter().any(|w| w.id == "recovered"));
    }
    let mut corrupt = whole.clone();
    let crc = corrupt.len() - 8;
    corrupt[crc] ^= 1;
    let path = dir.file("crc.csv.gz", &corrupt);
    let e = Record::read(&path, &rig(), &ReadOptions::default()).unwrap_err().to_string();
    assert!(e.contains("damaged gzip") && e.contains("--recover"), "{e}");
    assert_eq!(
        Record::read(&path, &rig(), &ReadOptions { recover: true, ..ReadOptions::default() }).unwrap().samples(),
        4000
    );
    let e = Record::read(
        dir.file("head.csv.gz", &whole[..12]),
        &rig(),
        &ReadOptions { recover: true, ..ReadOptions::default() },
    )
    .unwrap_err();
    assert!(e.to_string().contains("no row is whole"), "{e}");
}

#[test]
fn a_torn_last_line_is_an_error_or_recovered() {
    let dir = Dir::new();
    let text = rows(100);
    for cut in [3, 6, 8, 12] {
        let path = dir.file("torn.csv", &text.as_bytes()[..text.len() - cut]);
        match Record::read(&path, &rig(), &ReadOptions::default()) {
            // The cut went through the last number: that cannot be told for sure.
            Ok(r) => {
                let told = r.warnings.iter().find(|w| w.id == "no-line-feed").unwrap();
                let out = if told.text.contains("left out") { 1 } else { 0 };
                assert!(cut < 6 && r.samples() == 100 - out, "{cut}: {told:?}");
            }
            Err(e) => {
                let e = e.to_string();
                assert!(
                    e.contains("line 101") && e.contains("last whole row is line 100") && e.contains("--recover"),
                    "{e}"
                );
                let r = Record::read(&path, &rig(), &ReadOptions { recover: true, ..ReadOptions::default() }).unwrap();
                assert!(r.warnings.iter().any(|w| w.id == "recovered"), "{:?}", r.warnings);
                assert_eq!(r.samples(), 99);
            }
        }
    }
}

#[test]
fn a_decompression_bomb_of_one_line_is_refused_in_flat_memory() {
    let dir = Dir::new();
    let mut e = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    e.write_all(b"t,count1,angle\n").unwrap();
    let block = vec![b'1'; 1 << 20];
    for _ in 0..64 {
        e.write_all(&block).unwrap();
    }
    let path = dir.file("bomb.csv.gz", &e.finish().unwrap());
    let e = Record::read(path, &rig(), &ReadOptions::default()).unwrap_err().to_string();
    assert!(e.contains("line 2") && e.contains("a line of more than"), "{e}");
}

#[test]
fn jitter_is_told() {
    let mut text = "t,count1,angle\n".to_owned();
    for i in 0..300 {
        text += &format!("{},{i},0.1\n", f64::from(i) * 0.002 + 0.0003 * f64::from(i * 7919 % 13 - 6) / 6.0);
    }
    let r = read(&text).unwrap();
    assert_eq!(r.segments.len(), 1);
    assert!((r.segments[0].jitter_s - 1.87e-4).abs() < 1e-5, "{}", r.segments[0].jitter_s);
    assert!(r.warnings.iter().any(|w| w.id == "jitter" && w.text.contains("9.4 %")), "{:?}", r.warnings);
}

#[test]
fn wrapped_columns_are_unwrapped_with_a_warning() {
    let mut text = "t,count1,angle\n".to_owned();
    let truth = |i: i32| (i * 37, f64::from(i) * 0.05);
    for i in 0..1000 {
        let (c, a) = truth(i);
        text += &format!("{},{},{}\n", f64::from(i) * 0.002, c.rem_euclid(4096), a.sin().atan2(a.cos()));
    }
    let r = read(&text).unwrap();
    let Column::Values(v) = &r.segments[0].columns[1] else { panic!() };
    assert_eq!(r.segments[0].columns[0], Column::Counts((0..1000).map(|i| truth(i).0).collect()));
    assert!(v.iter().enumerate().all(|(i, v)| (v - truth(i as i32).1).abs() < 1e-9));
    assert_eq!(r.warnings.iter().filter(|w| w.id == "unwrapped").count(), 2);
}

fn own_rig() -> Rig {
    let text = RIG.replace("unit = \"rad\"", "unit = \"count\"\ncounts_per_turn = 4096");
    Rig::parse(&text, Path::new("rig.toml")).unwrap()
}

#[test]
fn whirls_own_csv_reads_back_with_ticks_and_phase() {
    let dir = Dir::new();
    for name in ["own.csv", "own.csv.gz"] {
        let path = dir.0.path().join(name);
        let mut w = RecordWriter::create(&path, &Metadata::default(), &own_rig()).unwrap();
        for i in (0..100i32).chain(150..260) {
            let phase = 0xffff_ff00u32.wrapping_add((i as u32).wrapping_mul(42_949_673));
            w.push(&Sample { tick: 1_000_000 + i64::from(i), counts: &[i, -i], phase, amplitude_nm: 15_525_000 })
                .unwrap();
        }
        assert!(w.push(&Sample { tick: 5, counts: &[0, 0], phase: 0, amplitude_nm: 0 }).is_err());
        w.finish(&Losses::default()).unwrap();
        let r = Record::read(&path, &own_rig(), &ReadOptions::default()).unwrap();
        assert_eq!((r.segments.len(), r.losses.lost_on_link, r.segments[1].first_tick), (2, 50, 1_000_150));
        assert_eq!(r.segments[0].phase.as_ref().unwrap()[1], 0xffff_ff00u32.wrapping_add(42_949_673));
        assert_eq!(r.segments[1].amplitude_nm.as_ref().unwrap()[0], 15_525_000);
        assert!((r.segments[0].start_s - 2000.0).abs() < 1e-9);
        assert_eq!(r.segments[0].columns[1], Column::Counts((0..100).map(|i| -i).collect()));
    }
}

#[test]
fn mutated_bytes_never_panic() {
    use rand::{Rng, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    let dir = Dir::new();
    let plain = rows(60).into_bytes();
    let zipped = gzip(&plain);
    let (mut good, mut bad) = (0, 0);
    for round in 0..2000 {
        let mut bytes = if round % 2 == 0 { plain.clone() } else { zipped.clone() };
        for _ in 0..1 + rng.next_u32() % 4 {
            let i = rng.next_u32() as usize % bytes.len();
            match rng.next_u32() % 4 {
                0 => bytes[i] = rng.next_u32() as u8,
                1 => bytes[i] = b",;\"\n\r.-eN9"[rng.next_u32() as usize % 10],
                2 => bytes.truncate(i + 1),
                _ => bytes.insert(i, rng.next_u32() as u8),
            }
        }
        let path = dir.file(if round % 2 == 0 { "m.csv" } else { "m.csv.gz" }, &bytes);
        match Record::read(path, &rig(), &ReadOptions { recover: round % 3 == 0, ..ReadOptions::default() }) {
            Ok(r) => good += usize::from(r.samples() <= 61),
            Err(e) => bad += usize::from(!e.to_string().is_empty()),
        }
    }
    assert_eq!(good + bad, 2000);
    assert!(good > 100 && bad > 500, "{good} {bad}");
}

#[test]
fn nanoseconds_and_dates_count_from_the_first_row() {
    let nanoseconds = |i: i64| (1_795_435_200_123_456_789 + 2_000_000 * i).to_string();
    let date = |i: i64| format!("2026-11-23T12:00:{:02}.{:03}", i / 500, 2 * (i % 500));
    for (name, time) in [("time (ns)", &nanoseconds as &dyn Fn(i64) -> String), ("time", &date)] {
        let rows: String = (0..600).map(|i| format!("{},{i},0.1\n", time(i))).collect();
        let r = read(&format!("{name},count1,angle\n{rows}")).unwrap_or_else(|e| panic!("{name}: {e}"));
        let s = &r.segments[0];
        assert_eq!((r.samples(), r.segments.len()), (600, 1), "{name}");
        let off = [s.start_s, s.step_s - 0.002, s.jitter_s].map(f64::abs);
        assert!(off.iter().all(|x| *x < 1e-12), "{name}: {off:?}");
    }
}

#[test]
fn lines_before_the_header_are_told() {
    let rows: String = (0..50).map(|i| format!("{},{i},0.1\n", f64::from(i) * 0.002)).collect();
    for (lines, told) in [
        ("a rig\n", "1 line before the rows, which begin behind line 2, was"),
        ("a rig\nof mine\n", "2 lines before the rows, which begin behind line 3, were"),
    ] {
        let r = read(&format!("{lines}t,count1,angle\n{rows}")).unwrap();
        let w = r.warnings.iter().find(|w| w.id == "head-passed-over").unwrap_or_else(|| panic!("{:?}", r.warnings));
        assert_eq!(w.text, format!("{told} passed over; the columns are t, count1, angle"));
    }
    assert!(read(&format!("t,count1,angle\n{rows}")).unwrap().warnings.is_empty());
}

#[test]
fn rows_that_follow_another_clock_are_named() {
    let mut text = rows(40_000);
    for i in 0..2000 {
        text += &format!("{:.4},{},x,41.5\n", 90.0 + f64::from(i) * 0.0005, 120_000 + i);
    }
    let e = read(&text).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(
        e.contains("line 40003, column t") && e.contains("found 90.0005 after 90, expected a time about 0.00"),
        "{e}"
    );
}
