//! The table as Parquet: every column may be empty, one row group, nothing in it that changes from
//! run to run.

use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::record::Field;
use parquet::schema::types::Type;

use super::FORMAT;
use super::row::{Cell, Kind, Row, kind};

/// Key in the file's metadata, with the command for a value.
const KEY: &str = "whirl.batch";

fn schema(columns: &[String]) -> Result<Type> {
    let field = |name: &String| {
        let (physical, logical) = match kind(name) {
            Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            Kind::Integer => (Physical::INT64, None),
            Kind::Number => (Physical::DOUBLE, None),
        };
        Type::primitive_type_builder(name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_logical_type(logical)
            .build()
            .map(Arc::new)
    };
    Type::group_type_builder("whirl_batch").with_fields(columns.iter().map(field).collect::<Result<_>>()?).build()
}

/// Writes the next column: `value` of each row that has one.
fn column<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, Vec<u8>>,
    cells: &[Option<&Cell>],
    value: impl Fn(&Cell) -> Option<T::T>,
) -> Result<()> {
    let values: Vec<Option<T::T>> = cells.iter().map(|cell| cell.and_then(&value)).collect();
    let there: Vec<i16> = values.iter().map(|v| i16::from(v.is_some())).collect();
    let values: Vec<T::T> = values.into_iter().flatten().collect();
    let Some(mut writer) = group.next_column()? else {
        return Err(ParquetError::General("more columns than the schema has".to_owned()));
    };
    writer.typed::<T>().write_batch(&values, Some(&there), None)?;
    writer.close()
}

/// The file's bytes.
pub(super) fn write(command: &str, columns: &[String], rows: &[Row]) -> Result<Vec<u8>> {
    let keys = [("whirl.format", FORMAT.to_string()), (KEY, command.to_owned())];
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_created_by("whirl".to_owned())
        .set_key_value_metadata(Some(keys.into_iter().map(|(k, v)| KeyValue::new(k.to_owned(), v)).collect()))
        .build();
    let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema(columns)?), Arc::new(properties))?;
    if !rows.is_empty() {
        let mut group = writer.next_row_group()?;
        for name in columns {
            let cells: Vec<Option<&Cell>> = rows.iter().map(|row| row.get(name)).collect();
            match kind(name) {
                Kind::Text => column::<ByteArrayType>(&mut group, &cells, |cell| match cell {
                    Cell::Text(text) => Some(ByteArray::from(text.as_str())),
                    _ => None,
                }),
                Kind::Integer => column::<Int64Type>(&mut group, &cells, |cell| match cell {
                    Cell::Integer(n) => Some(*n),
                    _ => None,
                }),
                Kind::Number => column::<DoubleType>(&mut group, &cells, |cell| match cell {
                    Cell::Number(x) => Some(*x),
                    _ => None,
                }),
            }?;
        }
        group.close()?;
    }
    writer.into_inner()
}

/// Columns and rows of a file's bytes.
pub(super) fn read(bytes: Vec<u8>) -> Result<(Vec<String>, Vec<Row>)> {
    let reader = SerializedFileReader::new(bytes::Bytes::from(bytes))?;
    let metadata = reader.metadata().file_metadata();
    if !metadata.key_value_metadata().is_some_and(|pairs| pairs.iter().any(|pair| pair.key == KEY)) {
        return Err(ParquetError::General("a Parquet file without the key whirl.batch".to_owned()));
    }
    let columns = metadata.schema_descr().columns().iter().map(|c| c.name().to_owned()).collect();
    let mut rows = Vec::new();
    for record in reader.get_row_iter(None)? {
        let mut row = Row::default();
        for (name, field) in record?.get_column_iter() {
            match (kind(name), field) {
                (_, Field::Null) => {}
                (Kind::Text, Field::Str(text)) => row.text(name, text),
                (Kind::Integer, Field::Long(n)) => row.integer(name, *n),
                (Kind::Number, Field::Double(x)) => row.number(name, *x),
                _ => return Err(ParquetError::General(format!("the column {name} of another type"))),
            }
        }
        rows.push(row);
    }
    Ok((columns, rows))
}
