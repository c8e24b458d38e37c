//! Records of plain values, one column a channel of any unit: CSV by extension (`.csv`, `.csv.gz`),
//! otherwise Parquet with the time (DOUBLE) and a column for each channel (INT32 for counts, DOUBLE
//! otherwise).
//!
//! The rig file that names the channels reads what is written: the time is called and counted as it
//! says (`t` in seconds where it says nothing), and gains and offsets are taken off.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;

use flate2::Compression;
use flate2::write::GzEncoder;
use parquet::basic::{Compression as ParquetCompression, Repetition, Type as Physical};
use parquet::data_type::{DoubleType, Int32Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

use super::csv_write::{create_file, text_cell};
use super::writer::FULL;
use super::{Column, names};
use crate::error::{BadInput, Result};
use crate::files::Part;
use crate::rig::{Channel, Rig, computed};

/// Rows of a Parquet row group.
const GROUP: usize = 1 << 16;

/// The column that a file has of a channel's values in its unit, its gain and offset taken off; a
/// counter rounds down. None where they leave its 32 bits.
pub fn column(channel: &Channel, values: impl Iterator<Item = f64>) -> Option<Column> {
    let mut column = if channel.unit == "count" {
        let count = |x: f64| Some(x.floor()).filter(|x| x.abs() < f64::from(i32::MAX)).map(|x| x as i32);
        Column::Counts(values.map(count).collect::<Option<Vec<i32>>>()?)
    } else {
        Column::Values(values.collect())
    };
    channel.take_off(&mut column).ok()?;
    Some(column)
}

/// The time's column: its name and values.
struct Time {
    name: String,
    start_s: f64,
    rate_hz: f64,
    per_second: f64,
}

impl Time {
    fn of(rig: &Rig, start_s: f64) -> Self {
        let (name, per_second) = names::written_time(&rig.time);
        Self { name, start_s, rate_hz: rig.sample_rate_hz, per_second }
    }

    fn at(&self, row: usize) -> f64 {
        (self.start_s + row as f64 / self.rate_hz) * self.per_second
    }
}

/// Writes columns of equal length, as [`column()`] makes them, sampled at the rig's rate from t = 0
/// on.
///
/// # Errors
/// A file that cannot be written, a full disk.
pub fn write_values(path: &Path, rig: &Rig, columns: &[Column]) -> Result<()> {
    write_values_from(path, rig, 0.0, columns)
}

/// The same from t = `start_s` on.
///
/// # Errors
/// As [`write_values`].
pub fn write_values_from(path: &Path, rig: &Rig, start_s: f64, columns: &[Column]) -> Result<()> {
    computed::refuse(&rig.channel, &rig.path)?;
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    let io = |e: std::io::Error| BadInput::io(path, &e).remedy(FULL);
    let part = Part::of(path)?;
    let file = create_file(path, part.place())?;
    if name.ends_with(".csv.gz") {
        let mut sink = BufWriter::new(GzEncoder::new(file, Compression::default()));
        csv(&mut sink, rig, start_s, columns).map_err(io)?;
        sink.into_inner().map_err(|e| io(e.into_error()))?.finish().map_err(io)?;
    } else if name.ends_with(".csv") {
        let mut sink = BufWriter::new(file);
        csv(&mut sink, rig, start_s, columns).and_then(|()| sink.flush()).map_err(io)?;
    } else {
        parquet(file, rig, start_s, columns)
            .map_err(|e| BadInput::new(e.to_string(), "").in_file(path).remedy(FULL))?;
    }
    part.keep().map_err(io)
}

fn csv(sink: &mut impl Write, rig: &Rig, start_s: f64, columns: &[Column]) -> std::io::Result<()> {
    let time = Time::of(rig, start_s);
    write!(sink, "{}", text_cell(&time.name))?;
    for c in &rig.channel {
        write!(sink, ",{}", text_cell(&c.name))?;
    }
    writeln!(sink)?;
    for i in 0..columns.first().map_or(0, Column::len) {
        write!(sink, "{}", time.at(i))?;
        for c in columns {
            match c {
                Column::Counts(x) => write!(sink, ",{}", x[i])?,
                Column::Values(x) => write!(sink, ",{}", x[i])?,
            }
        }
        writeln!(sink)?;
    }
    Ok(())
}

fn parquet(file: File, rig: &Rig, start_s: f64, columns: &[Column]) -> std::result::Result<(), ParquetError> {
    let field = |name: &str, physical: Physical| {
        Type::primitive_type_builder(name, physical).with_repetition(Repetition::REQUIRED).build().map(Arc::new)
    };
    let time = Time::of(rig, start_s);
    let mut fields = vec![field(&time.name, Physical::DOUBLE)?];
    for (c, column) in rig.channel.iter().zip(columns) {
        let physical = if matches!(column, Column::Counts(_)) { Physical::INT32 } else { Physical::DOUBLE };
        fields.push(field(&c.name, physical)?);
    }
    let schema = Arc::new(Type::group_type_builder("record").with_fields(fields).build()?);
    let properties = WriterProperties::builder()
        .set_created_by("whirl simulate".to_owned())
        .set_compression(ParquetCompression::SNAPPY)
        .set_dictionary_enabled(false)
        .build();
    let mut writer = SerializedFileWriter::new(BufWriter::new(file), schema, Arc::new(properties))?;
    let count = columns.first().map_or(0, Column::len);
    for from in (0..count).step_by(GROUP) {
        let to = (from + GROUP).min(count);
        let t: Vec<f64> = (from..to).map(|i| time.at(i)).collect();
        let mut group = writer.next_row_group()?;
        let mut place = 0;
        while let Some(mut column) = group.next_column()? {
            match place {
                0 => column.typed::<DoubleType>().write_batch(&t, None, None)?,
                k => match &columns[k - 1] {
                    Column::Counts(x) => column.typed::<Int32Type>().write_batch(&x[from..to], None, None)?,
                    Column::Values(x) => column.typed::<DoubleType>().write_batch(&x[from..to], None, None)?,
                },
            };
            column.close()?;
            place += 1;
        }
        group.close()?;
    }
    writer.close().map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{ReadOptions, Record};

    #[test]
    fn every_format_reads_back_what_was_written() {
        let text = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n[[channel]]\nname = \"q\"\nmeasures = \"q\"\nunit = \"m\"\n\
                    [[channel]]\nname = \"c\"\nmeasures = \"a\"\nunit = \"count\"\ncounts_per_turn = 4096\n";
        let rig = Rig::parse(text, Path::new("rig.toml")).unwrap();
        let columns = vec![
            Column::Values((0..900).map(|i| (0.01 * f64::from(i)).sin() / 3.0).collect()),
            Column::Counts((0..900).map(|i| i * i % 700).collect()),
        ];
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.csv", "a.csv.gz", "a.parquet"] {
            let path = folder.path().join(name);
            // What had the name is replaced once, and nothing is left beside it.
            std::fs::write(&path, "before").unwrap();
            write_values(&path, &rig, &columns).unwrap();
            let beside = std::fs::read_dir(folder.path()).unwrap();
            assert!(beside.flatten().all(|f| !f.file_name().to_string_lossy().ends_with(".part")), "{name}");
            let record = Record::read(&path, &rig, &ReadOptions::default()).unwrap();
            assert_eq!(record.segments.len(), 1, "{name}");
            assert_eq!(record.segments[0].columns, columns, "{name}");
        }
        // A name that a spreadsheet would compute comes back, too.
        let formula = Rig::parse(&text.replace("name = \"q\"", "name = \"+1+1\""), Path::new("rig.toml")).unwrap();
        let path = folder.path().join("f.csv");
        write_values(&path, &formula, &columns).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().starts_with("t,'+1+1,c\n"));
        assert_eq!(Record::read(&path, &formula, &ReadOptions::default()).unwrap().segments[0].columns, columns);
        assert!(write_values(&folder.path().join("no/a.csv"), &rig, &columns).is_err());
    }

    #[test]
    fn the_rig_file_that_names_time_gain_and_offset_reads_what_it_wrote() {
        let text = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\ntime = \"t / ms\"\n\
                    [[channel]]\nname = \"x / cm\"\nmeasures = \"q\"\nunit = \"m\"\ngain = 0.01\noffset = 0.5\n\
                    [[channel]]\nname = \"c\"\nmeasures = \"a\"\nunit = \"count\"\ncounts_per_turn = 4096\ngain = -1\n\
                    offset = 7\n";
        let rig = Rig::parse(text, Path::new("rig.toml")).unwrap();
        let motion = |i: i32| (0.01 * f64::from(i)).sin();
        let metres = column(&rig.channel[0], (0..900).map(motion)).unwrap();
        let counts = column(&rig.channel[1], (0..900).map(|i| 1e3 * motion(i))).unwrap();
        assert!(matches!(&metres, Column::Values(v) if (v[0] + 50.0).abs() < 1e-12));
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.csv", "a.parquet"] {
            let path = folder.path().join(name);
            write_values_from(&path, &rig, 2.0, &[metres.clone(), counts.clone()]).unwrap();
            let record = Record::read(&path, &rig, &ReadOptions::default()).unwrap();
            let s = &record.segments[0];
            assert!((s.start_s - 2.0).abs() < 1e-9 && (s.step_s - 0.01).abs() < 1e-9, "{name}");
            let Column::Values(q) = &s.columns[0] else { unreachable!() };
            assert!((0..900).zip(q).all(|(i, q)| (q - motion(i)).abs() < 1e-12), "{name}");
            let counted: Vec<i32> = (0..900).map(|i| (1e3 * motion(i)).floor() as i32).collect();
            assert_eq!(s.columns[1], Column::Counts(counted), "{name}");
        }
        let csv = std::fs::read_to_string(folder.path().join("a.csv")).unwrap();
        assert!(csv.starts_with("t / ms,x / cm,c\n2000,"), "{}", &csv[..60]);
    }
}
