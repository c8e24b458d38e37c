//! Tests of damaged Parquet records: what is whole is read, what is not is named and counted, and
//! nothing wrong comes out.

use std::fs::File;

use parquet::basic::Compression;
use parquet::data_type::{DoubleType, Int64Type};
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use rand::{RngExt, SeedableRng};

use super::super::parquet_recovery::{MAGIC, extent};
use super::tests::{dir, metadata, read_with, rig, sample, write};
use super::*;
use crate::record::{Column, Segment, stream};

/// Rows of the record of whirl's own: four row groups, the last one short.
const OWN: i64 = 9000;

/// Checks every sample that was read of whirl's own record against what was written; their number.
fn as_written(record: &Record) -> usize {
    for segment in &record.segments {
        let from = segment.first_tick - 1000;
        for (k, column) in segment.columns.iter().enumerate() {
            let truth: Vec<i32> = (from..from + column.len() as i64).map(|i| sample(i).0[k]).collect();
            assert_eq!(column, &Column::Counts(truth));
        }
        if let Some(phase) = &segment.phase {
            assert!(phase.iter().enumerate().all(|(i, p)| *p == sample(from + i as i64).1));
        }
    }
    record.samples()
}

/// The row groups of a file as its footer has them.
fn groups(path: &Path) -> Vec<RowGroupMetaData> {
    let file = File::open(path).unwrap();
    ParquetMetaDataReader::new().parse_and_finish(&file).unwrap().row_groups().to_vec()
}

fn damaged(record: &Record) -> &Warning {
    record.warnings.iter().find(|w| w.id == "damaged-rows").unwrap_or_else(|| panic!("{:?}", record.warnings))
}

#[test]
fn one_flipped_bit_costs_its_row_group_and_is_named() {
    let (_dir, path) = dir();
    write(&path, OWN, 0..0);
    let whole = std::fs::read(&path).unwrap();
    let (start, length) = extent(&groups(&path)[1]).unwrap();
    let mut bytes = whole.clone();
    bytes[(start + length / 2) as usize] ^= 4;
    std::fs::write(&path, &bytes).unwrap();

    let e = read_with(&path, false).unwrap_err().to_string();
    let parts = ["row group 2 of 4 (rows 2501 to 5000)", "last whole row is row 2500 (t = 6.998 s)", "--recover"];
    assert!(parts.iter().all(|p| e.contains(p)) && !e.contains('\n'), "{e}");

    let r = read_with(&path, true).unwrap();
    assert_eq!(as_written(&r), 6500);
    assert_eq!(r.segments.iter().map(|s| (s.first_tick, s.len())).collect::<Vec<_>>(), [(1000, 2500), (6000, 4000)]);
    assert_eq!((r.losses.lost(), r.losses.damaged, r.losses.gaps), (2500, 2500, 2));
    let w = damaged(&r);
    assert!(
        w.text.contains("rows 2501 to 5000 (between t = 6.998 and 12 s; row group 2: its checksum is wrong)"),
        "{w:?}"
    );
    assert_eq!(w.details["rows"], 2500);

    // The same block by block.
    let mut samples = 0;
    let options = ReadOptions { recover: true, ..ReadOptions::default() };
    let summary = stream::read(&path, &rig(), &options, &mut |block| samples += block.columns[0].len()).unwrap();
    assert_eq!((samples, summary.losses.lost()), (6500, 2500));
    assert!(summary.warnings.iter().any(|w| w.id == "damaged-rows"));
    assert!(stream::read(&path, &rig(), &ReadOptions::default(), &mut |_| {}).is_err());
}

#[test]
fn a_flipped_bit_in_the_first_row_group_is_not_said_to_cost_all_rows() {
    let (_dir, path) = dir();
    write(&path, OWN, 0..0);
    let mut bytes = std::fs::read(&path).unwrap();
    let (start, length) = extent(&groups(&path)[0]).unwrap();
    bytes[(start + length / 2) as usize] ^= 4;
    std::fs::write(&path, &bytes).unwrap();
    let e = read_with(&path, false).unwrap_err().to_string();
    let parts = ["row group 1 of 4 (rows 1 to 2500)", "no row before it is whole", "--recover"];
    assert!(parts.iter().all(|p| e.contains(p)), "{e}");
    assert_eq!(as_written(&read_with(&path, true).unwrap()), 6500);
}

#[test]
fn a_flipped_bit_anywhere_costs_at_most_its_row_group() {
    let (_dir, path) = dir();
    write(&path, OWN, 0..0);
    let whole = std::fs::read(&path).unwrap();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(31);
    let mut refused = 0;
    for round in 0..400 {
        let mut bytes = whole.clone();
        // A quarter of the bits in the footer, which is short.
        let tail = if round % 4 == 0 { 3000 } else { bytes.len() - 4 };
        let at = bytes.len() - 1 - rng.random_range(0..tail);
        let bit = rng.random_range(0..8u32);
        bytes[at] ^= 1 << bit;
        std::fs::write(&path, &bytes).unwrap();
        match read_with(&path, false) {
            Ok(r) => assert_eq!(as_written(&r), OWN as usize, "bit {bit} of byte {at}"),
            Err(e) => {
                refused += 1;
                assert!(e.to_string().contains("--recover"), "{e}");
            }
        }
        let r = read_with(&path, true).unwrap_or_else(|e| panic!("bit {bit} of byte {at}: {e}"));
        assert!(as_written(&r) >= OWN as usize - 2500, "bit {bit} of byte {at}: {:?}", r.warnings);
    }
    assert!(refused > 100, "{refused}");
}

#[test]
fn whatever_is_damaged_every_whole_row_group_is_read() {
    let (_dir, path) = dir();
    write(&path, OWN, 0..0);
    let whole = std::fs::read(&path).unwrap();
    let extents: Vec<(u64, u64)> = groups(&path).iter().map(|g| extent(g).unwrap()).collect();
    let middle = |k: usize| (extents[k].0 + extents[k].1 / 2) as usize;
    let behind = |k: usize| (extents[k].0 + extents[k].1) as usize;
    let footer = behind(3) + 1500..whole.len() - 8;
    let head = MAGIC.len() + 60;
    // Bytes that are spoilt, and the rows that stay.
    let cases: [(&str, Vec<usize>, usize); 8] = [
        ("two row groups", vec![middle(0), middle(2)], 4000),
        ("the footer", footer.clone().step_by(7).collect(), 9000),
        ("footer and row group", footer.clone().step_by(7).chain([middle(1)]).collect(), 6500),
        ("a marker", vec![behind(1) + 40], 9000),
        ("footer and a marker", footer.clone().step_by(7).chain([behind(1) + 40]).collect(), 6500),
        ("a page header", vec![extents[2].0 as usize + 1], 6500),
        ("the head", vec![head], 9000),
        ("footer and head", footer.step_by(7).chain([head]).collect(), 9000),
    ];
    for (what, spoilt, stays) in cases {
        let mut bytes = whole.clone();
        spoilt.iter().for_each(|at| bytes[*at] ^= 0x55);
        std::fs::write(&path, &bytes).unwrap();
        let r = read_with(&path, true).unwrap_or_else(|e| panic!("{what}: {e}"));
        if r.metadata.is_some() {
            assert_eq!(as_written(&r), stays, "{what}: {:?}", r.warnings);
            assert_eq!(r.metadata, Some(metadata()), "{what}");
            assert_eq!(r.losses.lost(), (OWN as usize - stays) as u64, "{what}");
        } else {
            assert_eq!((r.samples(), what), (stays, "footer and head"));
        }
        assert_eq!(r.samples() < OWN as usize, r.warnings.iter().any(|w| w.id == "damaged-rows"), "{what}");
    }
}

#[test]
fn truncated_in_every_tenth_every_whole_row_group_is_read() {
    let (_dir, path) = dir();
    write(&path, OWN, 0..0);
    let whole = std::fs::read(&path).unwrap();
    let ends: Vec<u64> = groups(&path).iter().map(|g| extent(g).map(|(a, n)| a + n).unwrap()).collect();
    for tenth in 1..10 {
        // A marker is shorter than that.
        let cut = whole.len() * tenth / 10;
        let least = ends.iter().filter(|end| **end + 2000 < cut as u64).count() * 2500;
        std::fs::write(&path, &whole[..cut]).unwrap();
        match read_with(&path, true) {
            Ok(r) => assert!(as_written(&r) >= least.max(1), "{tenth}"),
            Err(e) => assert!(least == 0 && e.to_string().contains("no row is whole"), "{tenth}: {e}"),
        }
    }
}

const SCHEMA: &str = "message m { required double t; required int64 count1; required int64 count2; }";

/// A file of somebody else's: row groups of 3000 rows in pages of 500, counts through a dictionary
/// if asked.
fn foreign(path: &Path, groups: usize, dictionary: bool, compression: Compression) -> Vec<u8> {
    foreign_of(path, groups, 3000, dictionary, compression)
}

/// As [`foreign`], of so many row groups of so many rows.
fn foreign_of(path: &Path, groups: usize, each: usize, dictionary: bool, compression: Compression) -> Vec<u8> {
    let schema = Arc::new(parse_message_type(SCHEMA).unwrap());
    let properties = WriterProperties::builder()
        .set_compression(compression)
        .set_dictionary_enabled(dictionary)
        .set_column_dictionary_enabled("t".into(), false)
        .set_data_page_row_count_limit(500)
        .set_write_batch_size(500)
        .build();
    let mut w = SerializedFileWriter::new(File::create(path).unwrap(), schema, Arc::new(properties)).unwrap();
    for g in 0..groups {
        let rows = g * each..(g + 1) * each;
        let mut group = w.next_row_group().unwrap();
        let t: Vec<f64> = rows.clone().map(|i| i as f64 * 0.002).collect();
        let mut c = group.next_column().unwrap().unwrap();
        c.typed::<DoubleType>().write_batch(&t, None, None).unwrap();
        c.close().unwrap();
        for k in 0..2 {
            let counts: Vec<i64> = rows.clone().map(|i| count(i, k)).collect();
            let mut c = group.next_column().unwrap().unwrap();
            c.typed::<Int64Type>().write_batch(&counts, None, None).unwrap();
            c.close().unwrap();
        }
        group.close().unwrap();
    }
    w.close().unwrap();
    std::fs::read(path).unwrap()
}

fn count(i: usize, k: usize) -> i64 {
    (200.0 * ((i + 100 * k) as f64 * 0.01).sin()) as i64
}

/// Checks every sample of a foreign record; their number.
fn as_exported(record: &Record) -> usize {
    for s in &record.segments {
        let from = (s.start_s / 0.002).round() as usize;
        for (k, column) in s.columns.iter().enumerate() {
            let truth: Vec<i32> = (from..from + s.len()).map(|i| count(i, k) as i32).collect();
            assert_eq!(column, &Column::Counts(truth), "from row {from}");
        }
    }
    record.samples()
}

#[test]
fn of_a_foreign_file_every_row_with_whole_pages_is_read() {
    let (_dir, path) = dir();
    let offset =
        |groups: &[RowGroupMetaData], g: usize, column: usize| groups[g].column(column).data_page_offset() as usize;
    let plain = foreign(&path, 2, false, Compression::SNAPPY);
    let at = groups(&path);
    let dictionary = foreign(&path, 2, true, Compression::SNAPPY);
    let with = groups(&path);
    let start = |g: usize, column: usize| with[g].column(column).dictionary_page_offset().unwrap() as usize;
    // What is spoilt (the first bytes of a Snappy stream are its length), and the rows that stay.
    let header = 40;
    let cases: [(&str, &[u8], Vec<usize>, usize); 5] = [
        ("page", &plain, (0..8).map(|i| offset(&at, 0, 1) + header + i).collect(), 5500),
        ("page header", &plain, vec![offset(&at, 1, 2)], 3000),
        ("dictionary", &dictionary, (0..8).map(|i| start(1, 1) + 20 + i).collect(), 3000),
        (
            "two pages",
            &plain,
            (0..8).flat_map(|i| [offset(&at, 0, 1) + header + i, offset(&at, 1, 1) + header + i]).collect(),
            5000,
        ),
        ("t's page header", &plain, vec![offset(&at, 0, 0)], 3000),
    ];
    for (what, whole, spoilt, stays) in cases {
        let mut bytes = whole.to_vec();
        spoilt.iter().for_each(|at| bytes[*at] = 0xff);
        std::fs::write(&path, &bytes).unwrap();
        let e = read_with(&path, false).unwrap_err().to_string();
        assert!(e.contains("row group") && e.contains("--recover"), "{what}: {e}");
        let r = read_with(&path, true).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!(as_exported(&r), stays, "{what}: {:?}", r.warnings);
        assert_eq!(
            (r.losses.lost(), damaged(&r).details["rows"].as_u64()),
            (6000 - stays as u64, Some(6000 - stays as u64))
        );
    }
    // One row group alone, as most programs write: the pages before and behind the damage are read.
    let mut bytes = foreign(&path, 1, false, Compression::SNAPPY);
    let second = groups(&path)[0].column(2).data_page_offset() as usize + 1200;
    (0..12).for_each(|i| bytes[second + i] = 0xff);
    std::fs::write(&path, &bytes).unwrap();
    let r = read_with(&path, true).unwrap();
    assert!((2000..3000).contains(&as_exported(&r)), "{:?}", r.warnings);
}

#[test]
fn a_page_damaged_far_into_a_long_row_group_costs_itself_and_no_row_comes_twice() {
    let (_dir, path) = dir();
    // Longer than a block and than what is decoded at once, both no whole number of pages.
    let n = 150_000;
    let mut bytes = foreign_of(&path, 1, n, false, Compression::SNAPPY);
    assert_eq!(as_exported(&read_with(&path, false).unwrap()), n);
    let chunk = groups(&path)[0].column(2).clone();
    let at = (chunk.data_page_offset() + chunk.compressed_size() * 97 / 100) as usize;
    (0..12).for_each(|i| bytes[at + i] = 0xff);
    std::fs::write(&path, &bytes).unwrap();
    let r = read_with(&path, true).unwrap();
    let read = as_exported(&r);
    assert!((n - 2000..n).contains(&read) && damaged(&r).text.contains("row group 1"), "{read}: {:?}", r.warnings);
    assert_eq!((r.losses.lost(), r.segments.len()), ((n - read) as u64, 2));
    // Block by block, rows of it have been handed on before the damage is met.
    let options = ReadOptions { recover: true, ..ReadOptions::default() };
    let mut stretches: Vec<Vec<f64>> = Vec::new();
    let summary = stream::read(&path, &rig(), &options, &mut |block| match stretches.last_mut() {
        Some(last) if !block.begins => last.extend(&block.columns[1]),
        _ => stretches.push(block.columns[1].clone()),
    });
    let of = |s: &Segment| s.columns[1].angle(&r.channels[1]);
    assert!(stretches == r.segments.iter().map(of).collect::<Vec<_>>());
    assert_eq!(summary.unwrap().losses, r.losses);
}

#[test]
fn a_page_that_states_another_number_of_rows_costs_its_row_group() {
    let (_dir, path) = dir();
    let whole = foreign(&path, 2, false, Compression::SNAPPY);
    let page = groups(&path)[1].column(1).data_page_offset() as usize;
    // The header's fields 5 and 5.1: a data page of 500 values.
    let values = page + whole[page..].windows(4).position(|w| w == [0x2c, 0x15, 0xe8, 0x07]).unwrap() + 2;
    for (stated, spoilt) in [("501", 0xea), ("499", 0xe6)] {
        let mut bytes = whole.clone();
        bytes[values] = spoilt;
        std::fs::write(&path, &bytes).unwrap();
        // Rows could be shifted behind it: none of them is read, though all other pages are whole.
        let r = read_with(&path, true).unwrap_or_else(|e| panic!("{stated}: {e}"));
        assert_eq!(as_exported(&r), 3000, "{stated}: {:?}", r.warnings);
        assert_eq!((r.losses.lost(), damaged(&r).details["rows"].as_u64()), (3000, Some(3000)), "{stated}");
    }
}

#[test]
fn a_wrong_time_costs_its_pages_and_a_foreign_file_without_footer_is_refused() {
    let (_dir, path) = dir();
    let whole = foreign(&path, 2, false, Compression::UNCOMPRESSED);
    // The exponent of one time.
    let needle = (3100_f64 * 0.002).to_le_bytes();
    let place = whole.windows(8).position(|w| w == needle).unwrap();
    let mut bytes = whole.clone();
    bytes[place + 7] ^= 0x40;
    std::fs::write(&path, &bytes).unwrap();
    let e = read_with(&path, false).unwrap_err().to_string();
    assert!(e.contains("row 3101, column t"), "{e}");
    let r = read_with(&path, true).unwrap();
    assert_eq!(as_exported(&r), 5500, "{:?}", r.warnings);
    assert!(damaged(&r).text.contains("row 3101, column t"), "{:?}", r.warnings);

    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let e = read_with(&path, true).unwrap_err().to_string();
    assert!(e.contains("only whirl's own records can be recovered without their footer"), "{e}");
}
