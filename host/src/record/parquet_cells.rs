//! Numbers of one Parquet column, one after the other, whatever its physical type.

use parquet::basic::{LogicalType, TimeUnit};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::schema::types::ColumnDescriptor;

use super::csv::OWN_COLUMNS;
use super::parquet::Failure;
use super::rows::Rows;
use crate::error::Result;

/// Rows decoded at once.
const BATCH: usize = 8192;

/// One cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Number {
    /// No value.
    Null,
    /// A whole number.
    Integer(i64),
    /// A real number.
    Real(f64),
    /// A point in time, and ticks a second.
    Timestamp(i64, f64),
}

/// How a column's integers are meant.
#[derive(Clone, Copy)]
enum Meaning {
    Plain,
    Unsigned,
    Timestamp(f64),
}

/// Calls `take` for each of the next `count` rows of a column chunk.
pub(super) fn for_each(
    reader: &mut ColumnReader,
    column: &ColumnDescriptor,
    count: usize,
    take: &mut dyn FnMut(usize, Number) -> Result<()>,
) -> core::result::Result<(), Failure> {
    let meaning = match column.logical_type_ref() {
        None => Meaning::Plain,
        Some(LogicalType::Integer(i)) if i.is_signed => Meaning::Plain,
        Some(LogicalType::Integer(_)) => Meaning::Unsigned,
        Some(LogicalType::Timestamp(t)) => Meaning::Timestamp(match t.unit {
            TimeUnit::MILLIS => 1e3,
            TimeUnit::MICROS => 1e6,
            TimeUnit::NANOS => 1e9,
        }),
        Some(other) => return Err(unfit(column, &format!("{other:?}"))),
    };
    match reader {
        ColumnReader::Int32ColumnReader(r) => decode(r, column, count, take, |v| match meaning {
            Meaning::Unsigned => Number::Integer(i64::from(v.cast_unsigned())),
            _ => Number::Integer(i64::from(v)),
        }),
        ColumnReader::Int64ColumnReader(r) => decode(r, column, count, take, |v| match meaning {
            Meaning::Timestamp(rate) => Number::Timestamp(v, rate),
            // Beyond every count: told as such.
            Meaning::Unsigned if v < 0 => Number::Real(v.cast_unsigned() as f64),
            _ => Number::Integer(v),
        }),
        ColumnReader::FloatColumnReader(r) => decode(r, column, count, take, |v| Number::Real(f64::from(v))),
        ColumnReader::DoubleColumnReader(r) => decode(r, column, count, take, Number::Real),
        _ => Err(unfit(column, &column.physical_type().to_string())),
    }
}

fn unfit(column: &ColumnDescriptor, kind: &str) -> Failure {
    Failure::File(format!("column {} is of type {kind}, which is not a number", column.name()))
}

fn decode<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    column: &ColumnDescriptor,
    count: usize,
    take: &mut dyn FnMut(usize, Number) -> Result<()>,
    number: impl Fn(T::T) -> Number,
) -> core::result::Result<(), Failure> {
    let top = column.max_def_level();
    let (mut values, mut levels) = (Vec::with_capacity(BATCH), Vec::with_capacity(BATCH));
    let mut row = 0;
    while row < count {
        values.clear();
        levels.clear();
        let (records, _, _) =
            reader.read_records(BATCH.min(count - row), (top > 0).then_some(&mut levels), None, &mut values)?;
        if records == 0 {
            return Err(Failure::File(format!("column {} ends after {row} of {count} rows", column.name())));
        }
        let mut values = values.drain(..);
        for i in 0..records {
            let there = top == 0 || levels.get(i) == Some(&top);
            let cell = match there.then(|| values.next()) {
                Some(Some(v)) => number(v),
                Some(None) => return Err(Failure::File(format!("column {} has too few values", column.name()))),
                None => Number::Null,
            };
            take(row + i, cell)?;
        }
        row += records;
    }
    Ok(())
}

impl Rows<'_> {
    /// A cell of the column `t` in seconds, NaN where there is none; timestamps count from the first one, so that no digits
    /// are lost.
    pub(super) fn seconds(&mut self, number: Number) -> f64 {
        match number {
            Number::Null => f64::NAN,
            Number::Real(v) => v,
            Number::Integer(v) => v as f64,
            Number::Timestamp(v, rate) => {
                let origin = *self.time_origin.get_or_insert(v);
                // Differences of years in nanoseconds fit into 64 bits.
                v.saturating_sub(origin) as f64 / rate
            }
        }
    }

    /// Takes a cell of one of the device's own columns.
    pub(super) fn push_device(&mut self, place: u64, which: usize, number: Number) -> Result<()> {
        let value = match number {
            Number::Integer(v) => Some(v),
            _ => None,
        };
        let fits = |v: &i64| which == 0 || (0..=i64::from(u32::MAX)).contains(v);
        let before = self.device.as_ref().and_then(|d| d.tick.last().copied());
        let Some(value) = value.filter(fits) else {
            let expected = if which == 0 { "a whole number" } else { "a whole number from 0 to 4294967295" };
            return Err(self
                .bad(place, OWN_COLUMNS[which], format!("{number:?}"), expected)
                .remedy("Copy the file again"));
        };
        if which == 0
            && let Some(before) = before
            && value <= before
        {
            return Err(self
                .bad(place, OWN_COLUMNS[0], format!("{value} after {before}"), "a tick later than the row before")
                .remedy("The file is damaged or was changed: copy it again"));
        }
        if let Some(d) = &mut self.device {
            match which {
                0 => d.tick.push(value),
                // In range of u32, see above.
                1 => d.phase.push(value as u32),
                _ => d.amplitude_nm.push(value as u32),
            }
        }
        Ok(())
    }
}
