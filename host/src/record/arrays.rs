//! Records as named arrays (`.npz`, `.mat`): `t` in seconds, or a scalar `fs` (Hz) or `dt` (s), and an array for each channel.
//!
//! All arrays are vectors of one length. Without `t`, sample i was taken at i/fs, and the message of the reader says so.

use std::path::Path;

use super::formats::ReadOptions;
use super::rows::{Cell, ROW_LIMIT, Rows, missing_column};
use super::{Record, segments};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::warning::Warning;

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
    if let Some(c) = rig.channel.iter().find(|c| !has(&c.name)) {
        return Err(missing_column(path, &c.name, names));
    }
    let columns: Vec<Array> = rig.channel.iter().map(|c| get(&c.name)).collect::<Result<_>>()?;
    let count = columns.first().map_or(0, Array::len);
    for (c, a) in rig.channel.iter().zip(&columns) {
        if a.len() != count {
            return Err(BadInput::new(
                format!("{} values in {}, {count} in {}", a.len(), c.name, rig.channel[0].name),
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
    let step = if has("t") {
        None
    } else if has("fs") {
        Some(1.0 / scalar("fs", &get("fs")?)?)
    } else if has("dt") {
        Some(scalar("dt", &get("dt")?)?)
    } else {
        return Err(missing_column(path, "t", names).remedy("Save t in seconds, or a scalar fs (Hz) or dt (s)"));
    };
    let time = match step {
        None => get("t")?,
        Some(step) => {
            warnings.push(Warning::new(
                "no-time",
                format!("no array t: samples are taken as {step} s apart (fs or dt)"),
                "Gaps cannot be seen this way; save t where there are any",
            ));
            Array::Floats((0..count).map(|i| i as f64 * step).collect())
        }
    };
    if time.len() != count {
        return Err(BadInput::new(
            format!("{} values in t, {count} in {}", time.len(), rig.channel[0].name),
            "one time a sample",
        )
        .in_file(path)
        .at("array t")
        .remedy("Save t of the same samples"));
    }
    let mut rows = Rows::new(path, rig, "sample", false);
    rows.resample = options.resample;
    for i in 0..count {
        let place = (i + 1) as u64;
        let t = time.value(i);
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
