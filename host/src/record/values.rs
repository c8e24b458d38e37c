//! Records of plain values, one column a channel of any unit: CSV by extension (`.csv`, `.csv.gz`),
//! otherwise Parquet with `t` in seconds (DOUBLE) and a column for each channel (INT32 for counts,
//! DOUBLE otherwise).

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

use super::Column;
use super::csv_write::{create_file, text_cell};
use crate::error::{BadInput, Result};
use crate::rig::{Channel, Rig, computed};

/// Rows of a Parquet row group.
const GROUP: usize = 1 << 16;

/// The column that a channel has of values in its unit, which a counter rounds down; none where
/// they leave its 32 bits.
pub fn column(channel: &Channel, values: impl Iterator<Item = f64>) -> Option<Column> {
    if channel.unit != "count" {
        return Some(Column::Values(values.collect()));
    }
    let count = |x: f64| Some(x.floor()).filter(|x| x.abs() < f64::from(i32::MAX)).map(|x| x as i32);
    values.map(count).collect::<Option<Vec<i32>>>().map(Column::Counts)
}

/// Writes columns of equal length sampled at the rig's rate from t = 0 on.
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
    let io = |e: std::io::Error| BadInput::io(path, &e);
    if name.ends_with(".csv.gz") {
        let mut sink = BufWriter::new(GzEncoder::new(create_file(path)?, Compression::default()));
        csv(&mut sink, rig, start_s, columns).map_err(io)?;
        sink.into_inner().map_err(|e| io(e.into_error()))?.finish().map(drop).map_err(io)
    } else if name.ends_with(".csv") {
        let mut sink = BufWriter::new(create_file(path)?);
        csv(&mut sink, rig, start_s, columns).and_then(|()| sink.flush()).map_err(io)
    } else {
        parquet(path, rig, start_s, columns).map_err(|e| BadInput::new(e.to_string(), "").in_file(path))
    }
}

fn csv(sink: &mut impl Write, rig: &Rig, start_s: f64, columns: &[Column]) -> std::io::Result<()> {
    write!(sink, "t")?;
    for c in &rig.channel {
        write!(sink, ",{}", text_cell(&c.name))?;
    }
    writeln!(sink)?;
    for i in 0..columns.first().map_or(0, Column::len) {
        write!(sink, "{}", start_s + i as f64 / rig.sample_rate_hz)?;
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

fn parquet(path: &Path, rig: &Rig, start_s: f64, columns: &[Column]) -> std::result::Result<(), ParquetError> {
    let field = |name: &str, physical: Physical| {
        Type::primitive_type_builder(name, physical).with_repetition(Repetition::REQUIRED).build().map(Arc::new)
    };
    let mut fields = vec![field("t", Physical::DOUBLE)?];
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
    let file = create_file(path).map_err(|e| ParquetError::General(e.to_string()))?;
    let mut writer = SerializedFileWriter::new(BufWriter::new(file), schema, Arc::new(properties))?;
    let count = columns.first().map_or(0, Column::len);
    for from in (0..count).step_by(GROUP) {
        let to = (from + GROUP).min(count);
        let t: Vec<f64> = (from..to).map(|i| start_s + i as f64 / rig.sample_rate_hz).collect();
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
            write_values(&path, &rig, &columns).unwrap();
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
}
