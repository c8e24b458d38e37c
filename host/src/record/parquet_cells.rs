//! Numbers of one Parquet column, whatever its physical type: a run of rows at a time, checked as a
//! whole where nothing is missing, cell by cell otherwise.

use parquet::basic::{ConvertedType as Converted, LogicalType, TimeUnit, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::schema::types::ColumnDescriptor;

use super::Column;
use super::csv::{EXACT, OWN_COLUMNS};
use super::parquet_chunks::Failure;
use super::rows::{Cell, Rows};
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

/// The cells of a run of rows.
pub(super) enum Cells {
    /// Whole numbers, none missing.
    Integers(Vec<i64>),
    /// Whole numbers of 32 bits, none missing.
    Short(Vec<i32>),
    /// The same, not negative ones.
    Unsigned(Vec<i32>),
    /// Real numbers, none missing (some may be NaN).
    Reals(Vec<f64>),
    /// Anything else.
    Mixed(Vec<Number>),
}

impl Cells {
    fn numbers(self) -> Vec<Number> {
        match self {
            Self::Integers(v) => v.into_iter().map(Number::Integer).collect(),
            Self::Short(v) => v.into_iter().map(|v| Number::Integer(v.into())).collect(),
            Self::Unsigned(v) => v.into_iter().map(|v| Number::Integer(v.cast_unsigned().into())).collect(),
            Self::Reals(v) => v.into_iter().map(Number::Real).collect(),
            Self::Mixed(v) => v,
        }
    }
}

/// How a column's integers are meant.
#[derive(Clone, Copy)]
enum Meaning {
    Plain,
    Unsigned,
    Timestamp(f64),
}

/// What a column is whose cells are no numbers; none where they are.
pub(super) fn not_a_number(column: &ColumnDescriptor) -> Option<String> {
    let physical = column.physical_type();
    let number = matches!(physical, Physical::INT32 | Physical::INT64 | Physical::FLOAT | Physical::DOUBLE);
    let dated = matches!(
        column.converted_type(),
        Converted::DECIMAL | Converted::DATE | Converted::TIME_MILLIS | Converted::TIME_MICROS
    );
    match column.logical_type_ref() {
        None if number && dated => Some(format!("{} ({physical})", column.converted_type())),
        None if number => None,
        Some(LogicalType::Integer(_)) if number => None,
        None => Some(physical.to_string()),
        Some(logical) => Some(format!("{logical:?} ({physical})")),
    }
}

/// The next `count` rows of a column chunk.
pub(super) fn decode(
    reader: &mut ColumnReader,
    column: &ColumnDescriptor,
    count: usize,
) -> core::result::Result<Cells, Failure> {
    let meaning = match column.logical_type_ref() {
        None => Meaning::Plain,
        Some(LogicalType::Integer(i)) if i.is_signed => Meaning::Plain,
        Some(LogicalType::Integer(_)) => Meaning::Unsigned,
        Some(LogicalType::Timestamp(t)) => Meaning::Timestamp(ticks(t.unit)),
        Some(LogicalType::Time(t)) => Meaning::Timestamp(ticks(t.unit)),
        Some(other) => return Err(unfit(column, &format!("{other:?}"))),
    };
    match reader {
        ColumnReader::Int32ColumnReader(r) => Ok(match (Run::read(r, column, count)?, meaning) {
            (Run { values, there: None }, Meaning::Unsigned) => Cells::Unsigned(values),
            (Run { values, there: None }, Meaning::Plain) => Cells::Short(values),
            (run, Meaning::Unsigned) => run.mixed(|v| Number::Integer(i64::from(v.cast_unsigned()))),
            (run, Meaning::Timestamp(rate)) => run.mixed(|v| Number::Timestamp(i64::from(v), rate)),
            (run, _) => run.mixed(|v| Number::Integer(i64::from(v))),
        }),
        ColumnReader::Int64ColumnReader(r) => Ok(match (Run::read(r, column, count)?, meaning) {
            (Run { values, there: None }, Meaning::Plain) => Cells::Integers(values),
            (run, meaning) => run.mixed(|v| match meaning {
                Meaning::Timestamp(rate) => Number::Timestamp(v, rate),
                // Beyond every count: told as such.
                Meaning::Unsigned if v < 0 => Number::Real(v.cast_unsigned() as f64),
                _ => Number::Integer(v),
            }),
        }),
        ColumnReader::FloatColumnReader(r) => Ok(match Run::read(r, column, count)? {
            Run { values, there: None } => Cells::Reals(values.into_iter().map(f64::from).collect()),
            run => run.mixed(|v| Number::Real(f64::from(v))),
        }),
        ColumnReader::DoubleColumnReader(r) => Ok(match Run::read(r, column, count)? {
            Run { values, there: None } => Cells::Reals(values),
            run => run.mixed(Number::Real),
        }),
        _ => Err(unfit(column, &column.physical_type().to_string())),
    }
}

fn ticks(unit: TimeUnit) -> f64 {
    match unit {
        TimeUnit::MILLIS => 1e3,
        TimeUnit::MICROS => 1e6,
        TimeUnit::NANOS => 1e9,
    }
}

/// Whether a column is one of points in time, or of times of a day.
pub(super) fn is_time(column: &ColumnDescriptor) -> bool {
    matches!(column.logical_type_ref(), Some(LogicalType::Timestamp(_) | LogicalType::Time(_)))
        && matches!(column.physical_type(), Physical::INT32 | Physical::INT64)
}

fn unfit(column: &ColumnDescriptor, kind: &str) -> Failure {
    Failure::File(format!("column {} is of type {kind}, which is not a number", column.name()))
}

/// Values as stored, and which rows have one where some have none.
struct Run<T> {
    values: Vec<T>,
    there: Option<Vec<bool>>,
}

impl<T: Copy> Run<T> {
    fn read<D: DataType<T = T>>(
        reader: &mut ColumnReaderImpl<D>,
        column: &ColumnDescriptor,
        count: usize,
    ) -> core::result::Result<Self, Failure> {
        let top = column.max_def_level();
        let (mut values, mut levels) = (Vec::with_capacity(count.min(BATCH)), Vec::new());
        let mut rows = 0;
        while rows < count {
            let (records, _, _) =
                reader.read_records(BATCH.min(count - rows), (top > 0).then_some(&mut levels), None, &mut values)?;
            if records == 0 {
                return Err(Failure::File(format!("column {} ends after {rows} of {count} rows", column.name())));
            }
            rows += records;
        }
        let there: Vec<bool> = levels.iter().map(|l| *l == top).collect();
        let whole = there.iter().all(|t| *t);
        let held = if top == 0 { rows } else { there.iter().filter(|t| **t).count() };
        if values.len() != held || (top > 0 && there.len() != rows) {
            return Err(Failure::File(format!(
                "column {} has {} values for {held} cells",
                column.name(),
                values.len()
            )));
        }
        Ok(Self { values, there: (!whole).then_some(there) })
    }

    fn mixed(self, number: impl Fn(T) -> Number) -> Cells {
        let mut values = self.values.into_iter().map(number);
        Cells::Mixed(match self.there {
            None => values.collect(),
            Some(there) => there
                .into_iter()
                .map(|t| if t { values.next().unwrap_or(Number::Null) } else { Number::Null })
                .collect(),
        })
    }
}

impl Rows<'_> {
    /// Takes a run of cells of the column `t`, whose first row is `first` (from 0).
    pub(super) fn take_times(&mut self, first: usize, cells: Cells) -> Result<()> {
        if let (Cells::Reals(t), true) = (&cells, self.per_second == 1.0) {
            let after = self.t.last().is_none_or(|last| t.first().is_some_and(|t| t > last));
            // Infinity would have to be the last, a NaN is no later than anything.
            let good = after && t.windows(2).all(|w| w[1] > w[0]) && t.iter().all(|t| t.is_finite());
            if good && self.t.len().saturating_add(t.len()) <= self.limit {
                self.push_times((first + t.len()) as u64, t);
                return Ok(());
            }
        }
        for (i, number) in cells.numbers().into_iter().enumerate() {
            let place = (first + i + 1) as u64;
            let t = self.seconds(number);
            self.check_time(place, t)?;
            self.push_time(place, t);
        }
        Ok(())
    }

    /// Takes a run of cells of a channel, whose first row is `first` (from 0).
    pub(super) fn take_channel(&mut self, first: usize, channel: usize, cells: Cells) -> Result<()> {
        match (&mut self.columns[channel], &cells) {
            (Column::Counts(to), Cells::Short(v)) => {
                to.extend_from_slice(v);
                return Ok(());
            }
            (Column::Counts(to), Cells::Integers(v)) if v.iter().all(|v| i32::try_from(*v).is_ok()) => {
                // In range, see above.
                to.extend(v.iter().map(|v| *v as i32));
                return Ok(());
            }
            (Column::Values(to), Cells::Reals(v)) if v.iter().all(|v| v.is_finite()) => {
                to.extend_from_slice(v);
                return Ok(());
            }
            _ => {}
        }
        for (i, number) in cells.numbers().into_iter().enumerate() {
            let place = (first + i + 1) as u64;
            let cell = match number {
                Number::Null => Cell::Missing,
                Number::Integer(v) | Number::Timestamp(v, _) => self.check_integer(place, channel, v)?,
                Number::Real(v) => self.check_number(place, channel, v)?,
            };
            self.push_cell(place, channel, cell);
        }
        Ok(())
    }

    /// Takes a run of cells of one of the device's own columns, whose first row is `first` (from
    /// 0).
    pub(super) fn take_device(&mut self, first: usize, which: usize, cells: Cells) -> Result<()> {
        if let Some(d) = &mut self.device {
            let to = if which == 1 { &mut d.phase } else { &mut d.amplitude_nm };
            match &cells {
                Cells::Integers(v) if which == 0 => {
                    let after = d.tick.last().is_none_or(|last| v.first().is_some_and(|v| v > last));
                    if after && v.windows(2).all(|w| w[1] > w[0]) {
                        d.tick.extend_from_slice(v);
                        return Ok(());
                    }
                }
                Cells::Unsigned(v) if which > 0 => {
                    to.extend(v.iter().map(|v| v.cast_unsigned()));
                    return Ok(());
                }
                Cells::Integers(v) if v.iter().all(|v| u32::try_from(*v).is_ok()) => {
                    // In range, see above.
                    to.extend(v.iter().map(|v| *v as u32));
                    return Ok(());
                }
                _ => {}
            }
        }
        for (i, number) in cells.numbers().into_iter().enumerate() {
            self.push_device((first + i + 1) as u64, which, number)?;
        }
        Ok(())
    }

    /// A cell of the column `t` in seconds, NaN where there is none; timestamps count from the
    /// first one, so that no digits are lost.
    fn seconds(&mut self, number: Number) -> f64 {
        match number {
            Number::Null => f64::NAN,
            Number::Real(v) => v / self.per_second,
            // A clock that counts since 1970 in nanoseconds has more digits than binary64.
            Number::Integer(v) if self.time_origin.is_some() || v.unsigned_abs() as f64 >= EXACT => {
                let origin = *self.time_origin.get_or_insert(v);
                v.saturating_sub(origin) as f64 / self.per_second
            }
            Number::Integer(v) => v as f64 / self.per_second,
            Number::Timestamp(v, rate) => {
                let origin = *self.time_origin.get_or_insert(v);
                // Differences of years in nanoseconds fit into 64 bits.
                v.saturating_sub(origin) as f64 / rate
            }
        }
    }

    /// Takes a cell of one of the device's own columns.
    fn push_device(&mut self, place: u64, which: usize, number: Number) -> Result<()> {
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
