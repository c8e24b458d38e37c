//! Records as named arrays (`.npz`, `.npy`, `.mat`): the time, or a scalar `fs` (Hz) or `dt` (s),
//! and an array for each channel.
//!
//! All arrays are vectors of one length. Without a time, sample i was taken at i/fs, and the
//! message of the reader says so.

use std::path::Path;

use super::csv::EXACT;
use super::formats::{Listed, ReadOptions};
use super::rows::{Cell, ROW_LIMIT, Rows, is_numbered, sources};
use super::{Record, names, segments};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::warning::Warning;

/// Most columns of a matrix that are taken one by one.
const MOST_COLUMNS: usize = 64;

/// A vector read from a file.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Array {
    /// Whole numbers.
    Integers(Vec<i64>),
    /// Numbers.
    Floats(Vec<f64>),
}

impl Array {
    fn len(&self) -> usize {
        match self {
            Self::Integers(x) => x.len(),
            Self::Floats(x) => x.len(),
        }
    }

    /// A value of the time; counts from the first where binary64 cannot hold it.
    fn seconds(&self, i: usize) -> f64 {
        match self {
            Self::Integers(x) if x[0].unsigned_abs() as f64 >= EXACT => x[i].saturating_sub(x[0]) as f64,
            other => other.value(i),
        }
    }

    fn value(&self, i: usize) -> f64 {
        match self {
            Self::Integers(x) => x[i] as f64,
            Self::Floats(x) => x[i],
        }
    }
}

/// What is told of an array before it is read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Shape(pub(super) Vec<u64>);

impl Shape {
    /// Number of elements of a vector (or scalar); none for a matrix.
    pub(super) fn vector(&self) -> Option<u64> {
        let long = self.0.iter().filter(|n| **n != 1).count();
        (long <= 1).then(|| self.0.iter().copied().fold(1, u64::saturating_mul))
    }

    /// Rows and columns of a matrix that is higher than wide and fits into memory; none for
    /// everything else.
    pub(super) fn columns(&self) -> Option<(usize, usize)> {
        let [rows, columns] = self.0[..] else { return None };
        let (rows, columns) = (usize::try_from(rows).ok()?, usize::try_from(columns).ok()?);
        (columns > 1 && columns <= MOST_COLUMNS && rows > columns && rows <= ROW_LIMIT).then_some((rows, columns))
    }

    /// The number of elements of a vector that may be read.
    pub(super) fn checked(&self, path: &Path, name: &str) -> Result<usize> {
        let bad =
            |found: String, expected: &str| BadInput::new(found, expected).in_file(path).at(format!("array {name}"));
        let shown: Vec<String> = self.0.iter().map(u64::to_string).collect();
        let Some(n) = self.vector() else {
            return Err(bad(format!("{} elements", shown.join(" × ")), "a vector, one value a sample")
                .remedy("Save each column of the matrix as an array of its own"));
        };
        usize::try_from(n)
            .ok()
            .filter(|n| *n <= ROW_LIMIT)
            .ok_or_else(|| bad(format!("{n} elements"), "a record that fits into memory").remedy("Split the record"))
    }
}

/// The arrays of a file, and whether they may be channels: vectors of numbers that are more than
/// one, the longest ones of the file (others are no columns beside them).
pub(super) fn listed(names: &[String], mut get: impl FnMut(&str) -> Result<Array>) -> Vec<Listed> {
    let lengths: Vec<usize> = names.iter().map(|name| get(name).map_or(0, |a| a.len())).collect();
    let longest = lengths.iter().copied().max().unwrap_or(0).max(2);
    std::iter::zip(names, lengths).map(|(name, n)| Listed { name: name.clone(), is_number: n == longest }).collect()
}

/// Makes the record from the arrays of a file.
pub(super) fn record(
    path: &Path,
    rig: &Rig,
    names: &[String],
    options: &ReadOptions,
    mut get: impl FnMut(&str) -> Result<Array>,
) -> Result<Record> {
    let mut warnings = Vec::new();
    let has = |name: &str| names.iter().any(|n| n == name);
    let read = sources(rig).columns;
    let found = names::find_all(names, &read, path)?;
    let columns: Vec<Array> = found.into_iter().map(|i| get(&names[i])).collect::<Result<_>>()?;
    let count = columns.first().map_or(0, Array::len);
    for (c, a) in read.iter().zip(&columns) {
        if a.len() != count {
            return Err(BadInput::new(
                format!("{} values in {}, {count} in {}", a.len(), c.name, read[0].name),
                "arrays of one length",
            )
            .in_file(path)
            .at(format!("array {}", c.name))
            .remedy("Save all channels of the same samples"));
        }
    }
    let scalar = |name: &str, array: &Array| match array.len() {
        1 if array.value(0).is_finite() && array.value(0) > 0.0 => Ok(array.value(0)),
        n => Err(BadInput::new(
            if n == 1 { array.value(0).to_string() } else { format!("{n} values") },
            "one number above 0",
        )
        .in_file(path)
        .at(format!("array {name}"))
        .remedy("Save t in seconds instead")),
    };
    let called = names::time_column(names, &rig.time, path);
    let step = if called.is_ok() || rig.time.column.is_some() {
        None
    } else if has("fs") {
        Some(1.0 / scalar("fs", &get("fs")?)?)
    } else if has("dt") {
        Some(scalar("dt", &get("dt")?)?)
    } else {
        None
    };
    let (time, name, per_second) = match step {
        None => {
            let hint = |e: BadInput| match e.remedy.as_str() {
                _ if rig.time.column.is_some() || is_numbered(names) => e,
                _ => e.remedy(
                    "Save t in seconds, or a scalar fs (Hz) or dt (s); or say which array is the time: --time NAME",
                ),
            };
            let called = called.map_err(hint)?;
            (get(&called.name)?, called.name, called.per_second.unwrap_or(1.0))
        }
        Some(step) => {
            warnings.push(Warning::new(
                "no-time",
                format!("no array t: samples are taken as {step} s apart (fs or dt)"),
                "Gaps cannot be seen this way; save t where there are any",
            ));
            (Array::Floats((0..count).map(|i| i as f64 * step).collect()), "t".to_owned(), 1.0)
        }
    };
    if time.len() != count {
        return Err(BadInput::new(
            format!("{} values in {name}, {count} in the channels", time.len()),
            "one time a sample",
        )
        .in_file(path)
        .at(format!("array {name}"))
        .remedy("Save the time of the same samples"));
    }
    let mut rows = Rows::new(path, rig, "sample", false);
    rows.resample = options.resample;
    rows.time_name = name;
    for i in 0..count {
        let place = (i + 1) as u64;
        let t = time.seconds(i) / per_second;
        rows.check_time(place, t)?;
        let cells: Vec<Cell> = columns
            .iter()
            .enumerate()
            .map(|(k, a)| match a {
                Array::Integers(x) => rows.check_integer(place, k, x[i]),
                Array::Floats(x) => rows.check_number(place, k, x[i]),
            })
            .collect::<Result<_>>()?;
        rows.push_time(place, t);
        cells.into_iter().enumerate().for_each(|(k, cell)| rows.push_cell(place, k, cell));
    }
    segments::assemble(rows, None, None, warnings)
}
