//! Tests of which columns of a Parquet file are read, whoever wrote it.

use std::fs::File;

use parquet::column::writer::ColumnWriter;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use parquet::schema::types::ColumnDescPtr;

use super::tests::{RIG, dir, read_with, rig, write};
use super::*;
use crate::record::arrow_schema::tests::POLARS;
use crate::record::names::TimeChoice;
use crate::record::{Column, formats};

/// Writes a file of 300 rows and these keys: times and counts in the columns that are not nested,
/// −1 in the others.
fn write_columns(path: &Path, schema: &str, keys: &[(&str, &str)]) {
    write_values(path, schema, keys, &|_, i| i);
}

/// As [`write_columns`], the whole numbers by column and row.
fn write_values(path: &Path, schema: &str, keys: &[(&str, &str)], value: &dyn Fn(&str, i64) -> i64) {
    let schema = Arc::new(parse_message_type(schema).unwrap());
    let keys = keys.iter().map(|(k, v)| KeyValue::new((*k).to_owned(), (*v).to_owned())).collect();
    let properties = WriterProperties::builder().set_key_value_metadata(Some(keys)).build();
    let mut w = SerializedFileWriter::new(File::create(path).unwrap(), schema, Arc::new(properties)).unwrap();
    let mut g = w.next_row_group().unwrap();
    while let Some(mut c) = g.next_column().unwrap() {
        let levels = |column: &ColumnDescPtr| (vec![column.max_def_level(); 300], vec![0; 300]);
        let nested = |column: &ColumnDescPtr| column.path().parts().len() > 1 || column.max_rep_level() > 0;
        match c.untyped() {
            ColumnWriter::DoubleColumnWriter(c) => {
                let ((def, rep), nested) = (levels(c.get_descriptor()), nested(c.get_descriptor()));
                let t: Vec<f64> = (0..300).map(|i| if nested { -1.0 } else { f64::from(i) * 0.002 }).collect();
                c.write_batch(&t, Some(&def), Some(&rep)).unwrap();
            }
            ColumnWriter::Int64ColumnWriter(c) => {
                let ((def, rep), nested) = (levels(c.get_descriptor()), nested(c.get_descriptor()));
                let name = c.get_descriptor().name().to_owned();
                let n: Vec<i64> = (0..300).map(|i| if nested { -1 } else { value(&name, i) }).collect();
                c.write_batch(&n, Some(&def), Some(&rep)).unwrap();
            }
            _ => unreachable!(),
        }
        c.close().unwrap();
    }
    g.close().unwrap();
    w.close().unwrap();
}

#[test]
fn nested_columns_are_passed_over_whatever_their_names() {
    let (_dir, path) = dir();
    let schema = "message m { required group g { required double t; } required double t; \
                  optional group o { optional int64 count1; } optional int64 count1; \
                  repeated int64 more; required int64 count2; }";
    write_columns(&path, schema, &[]);
    let r = read_with(&path, false).unwrap();
    assert_eq!((r.samples(), r.segments[0].start_s), (300, 0.0));
    for column in &r.segments[0].columns {
        assert_eq!(column, &Column::Counts((0..300).collect()));
    }
    // One that is nested is no channel.
    write_columns(&path, &schema.replace("optional int64 count1; repeated", "repeated"), &[]);
    assert!(read_with(&path, false).unwrap_err().to_string().contains("column count1"));
}

#[test]
fn a_nested_column_that_is_asked_for_is_told_what_it_is() {
    let (_dir, path) = dir();
    let list = "optional group count1 (LIST) { repeated group list { optional double element; } }";
    let map = "optional group count1 (MAP) { repeated group key_value { required int64 key; optional int64 value; } }";
    for (column, found, remedy) in [
        (list, "a list of DOUBLE", "df[\"count1\"].str[0]"),
        ("repeated int64 count1;", "a list of INT64", "df[\"count1\"].str[0]"),
        (map, "a map", "a column of its own"),
        ("optional group count1 { optional int64 raw; }", "a structure of INT64", "df[\"count1\"].str[\"raw\"]"),
    ] {
        write_columns(&path, &format!("message m {{ required double t; {column} required int64 count2; }}"), &[]);
        let e = read_with(&path, false).unwrap_err().to_string();
        let whole = format!("column count1: found {found} in every row, expected one number in every row");
        assert!(e.contains(&whole) && e.contains(remedy) && !e.contains("Did you mean"), "{e}");
    }
    // So is a time that is one.
    let times = list.replace("count1", "t");
    write_columns(&path, &format!("message m {{ {times} required int64 count1; required int64 count2; }}"), &[]);
    let e = read_with(&path, false).unwrap_err().to_string();
    assert!(e.contains("column t: found a list of DOUBLE in every row"), "{e}");
}

#[test]
fn the_time_is_the_only_column_that_is_one_by_its_type() {
    let (_dir, path) = dir();
    let listed = |path: &Path| {
        let listed = formats::columns(path, &TimeChoice::default()).unwrap();
        listed.into_iter().map(|c| (c.name, c.is_number)).collect::<Vec<_>>()
    };
    let moment = "required int64 moment (TIMESTAMP(MICROS,true));";
    let elapsed = "required int64 elapsed;";
    let keys = [("ARROW:schema", POLARS)];
    let microseconds = |name: &str, i: i64| if name.starts_with("count") { i } else { 2000 * i };
    let write_columns = |schema: &str| write_values(&path, schema, &keys, &microseconds);
    for (name, column) in [("moment", moment), ("elapsed", elapsed)] {
        let counts = "required int64 count1; required int64 count2;";
        write_columns(&format!("message m {{ {counts} {column} }}"));
        let of = |name: &str, number: bool| (name.to_owned(), number);
        assert_eq!(listed(&path), [of("count1", true), of("count2", true), of(name, false)]);
        let r = read_with(&path, false).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!((r.samples(), r.segments[0].columns[1].len()), (300, 300), "{name}");
        assert!((r.segments[0].step_s - 0.002).abs() < 1e-12, "{name}: {}", r.segments[0].step_s);
        // One that is asked for by its name, or is called a time, goes before it.
        let asked = TimeChoice { column: Some("clock".into()), unit: None };
        let e = Record::read(&path, &Rig { time: asked, ..rig() }, &ReadOptions::default()).unwrap_err();
        assert!(e.to_string().contains("clock"), "{e}");
        write_columns(&format!("message m {{ {counts} {column} required double t; }}"));
        assert_eq!(read_with(&path, false).unwrap().samples(), 300, "{name}");
    }
    // Two of them could both be it, and none is a channel.
    write_columns(&format!(
        "message m {{ required int64 count1; required int64 count2; {moment} {} }}",
        moment.replace("moment", "instant")
    ));
    assert!(read_with(&path, false).unwrap_err().to_string().contains("a column t"));
    write_columns(
        "message m { required double t; required int64 count1 (TIMESTAMP(MICROS,true)); required int64 count2; }",
    );
    let e = read_with(&path, false).unwrap_err().to_string();
    assert!(e.contains("column count1: found the type "), "{e}");
}

#[test]
fn nanoseconds_since_1970_lose_no_digit() {
    let (_dir, path) = dir();
    let schema = "message m { required int64 clock; required int64 count1; required int64 count2; }";
    let clock = |name: &str, i: i64| if name == "clock" { 1_795_435_200_123_456_789 + 2_000_000 * i } else { i };
    write_values(&path, schema, &[], &clock);
    let time = TimeChoice { column: Some("clock".into()), unit: Some("ns".into()) };
    let r = Record::read(&path, &Rig { time, ..rig() }, &ReadOptions::default()).unwrap();
    let s = &r.segments[0];
    assert_eq!(r.samples(), 300);
    assert!(
        s.start_s.abs() < 1e-12 && (s.step_s - 0.002).abs() < 1e-12 && s.jitter_s < 1e-12,
        "{} {}",
        s.step_s,
        s.jitter_s
    );
}

#[test]
fn a_record_of_whirls_own_has_its_own_time_whatever_the_rig_file_says_of_others() {
    let (_dir, path) = dir();
    write(&path, 3000, 0..0);
    let time = TimeChoice { column: Some("count1".into()), unit: Some("ms".into()) };
    let r = Record::read(&path, &Rig { time, ..rig() }, &ReadOptions::default()).unwrap();
    assert_eq!((r.samples(), r.segments[0].start_s, r.segments[0].step_s), (3000, 2.0, 0.002));
}

#[test]
fn a_record_that_another_program_has_taken_columns_out_of_goes_by_its_times() {
    let (_dir, path) = dir();
    let keys = [("whirl.format", "1"), ("whirl.rig", RIG), ("whirl.sample_rate_hz", "500"), ("whirl.board", "test")];
    for missing in ["tick", "phase", "amplitude_nm"] {
        let mut schema =
            "message m { required int64 tick; required double t; required int64 count1; required int64 count2; \
             required int64 phase; required int64 amplitude_nm; }"
                .to_owned();
        schema = schema.replace(&format!("required int64 {missing};"), "");
        write_columns(&path, &schema, &keys);
        let r = read_with(&path, false).unwrap_or_else(|e| panic!("without {missing}: {e}"));
        assert_eq!((r.samples(), r.metadata.unwrap().board.as_str()), (300, "test"), "without {missing}");
        assert!(r.segments[0].phase.is_none() && (r.segments[0].step_s - 0.002).abs() < 1e-12, "without {missing}");
    }
}

#[test]
fn the_devices_columns_are_read_from_wider_numbers_too_and_checked() {
    let (_dir, path) = dir();
    let keys = [("whirl.format", "1"), ("whirl.rig", RIG), ("whirl.sample_rate_hz", "500")];
    let schema = "message m { required int64 tick; required double t; required int64 count1; required int64 count2; \
                  required int64 phase; required int64 amplitude_nm; }";
    let highest = i64::from(u32::MAX);
    let whole = |name: &str, i: i64| match name {
        "tick" => 7000 + i,
        "phase" => highest - 299 + i,
        _ => 3 * i,
    };
    write_values(&path, schema, &keys, &whole);
    let r = read_with(&path, false).unwrap();
    let s = &r.segments[0];
    assert_eq!(
        (r.samples(), s.first_tick, s.columns[1].clone()),
        (300, 7000, Column::Counts((0..300).map(|i| 3 * i).collect()))
    );
    assert_eq!(s.phase, Some((0..300).map(|i| u32::MAX - 299 + i).collect()));
    assert_eq!(s.amplitude_nm, Some((0..300).map(|i| 3 * i).collect()));
    for (column, value, found) in [
        ("tick", 7249, "7249 after 7249"),
        ("phase", -1, "-1"),
        ("phase", highest + 1, "4294967296"),
        ("amplitude_nm", -1, "-1"),
    ] {
        let spoilt = |name: &str, i: i64| if (name, i) == (column, 250) { value } else { whole(name, i) };
        write_values(&path, schema, &keys, &spoilt);
        let e = read_with(&path, false).unwrap_err().to_string();
        assert!(e.contains(&format!("row 251, column {column}")) && e.contains(found), "{e}");
    }
}
