//! Channels that are computed from the columns that were read ([`crate::rig::computed`]).

use super::Column;
use super::rows::Rows;
use crate::error::Result;
use crate::rig::computed::{self, Formula, From};

/// Puts the rig's channels in the place of the columns that were read. A gap of one column is one
/// of each channel that needs it.
///
/// # Errors
/// A value that is no number, or no whole number of counts: its row.
pub(super) fn compute(rows: &mut Rows<'_>) -> Result<()> {
    if !computed::any(&rows.rig.channel) {
        return Ok(());
    }
    let from = std::mem::take(&mut rows.sources.channels);
    let mut out: Vec<Option<Column>> = vec![None; from.len()];
    let mut missing = vec![Vec::new(); from.len()];
    for (k, from) in from.iter().enumerate() {
        match from {
            From::Column(i) => missing[k].clone_from(&rows.missing[*i]),
            From::Expression(formula) => {
                missing[k] = without(rows, formula);
                out[k] = Some(values(rows, k, formula, &missing[k])?);
            }
        }
    }
    let mut read = std::mem::take(&mut rows.columns);
    rows.columns = std::iter::zip(&from, out)
        .map(|(from, column)| match (from, column) {
            (_, Some(column)) => column,
            (From::Column(i), None) => std::mem::replace(&mut read[*i], Column::Values(Vec::new())),
            (From::Expression(_), None) => Column::Values(Vec::new()),
        })
        .collect();
    let first = (0..missing.len()).filter_map(|k| Some((*missing[k].first()?, k))).min();
    rows.first_missing = first.map(|(row, k)| (place(rows, row), k));
    rows.missing = missing;
    rows.sources.columns.clone_from(&rows.rig.channel);
    rows.sources.channels = (0..from.len()).map(From::Column).collect();
    Ok(())
}

/// Rows in which some column of an expression has no value, increasing.
fn without(rows: &Rows<'_>, formula: &Formula) -> Vec<usize> {
    let used = |i: usize| formula.any(&|used| used == i);
    let mut all: Vec<usize> =
        (0..rows.missing.len()).filter(|i| used(*i)).flat_map(|i| rows.missing[i].clone()).collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// An expression's values, in the type of channel k.
fn values(rows: &Rows<'_>, k: usize, formula: &Formula, missing: &[usize]) -> Result<Column> {
    let channel = &rows.rig.channel[k];
    let count = channel.unit == "count";
    let (mut counts, mut values) = (Vec::new(), Vec::new());
    let mut gaps = missing.iter().peekable();
    for row in 0..rows.t.len() {
        if gaps.next_if(|gap| **gap == row).is_some() {
            if count {
                counts.push(0)
            } else {
                values.push(f64::NAN)
            }
            continue;
        }
        let value = formula.value(&|i| match &rows.columns[i] {
            Column::Counts(c) => f64::from(c[row]),
            Column::Values(v) => v[row],
        });
        let bad = |expected: &str| {
            let e = rows.bad(place(rows, row), &channel.name, value.to_string(), expected);
            Err(e.remedy("Mend this row of its columns, or the expression in the rig file"))
        };
        if !value.is_finite() {
            return bad("a finite number");
        }
        if !count {
            values.push(value);
        } else if value.fract() != 0.0 {
            return bad("a whole number of counts");
        } else if value < f64::from(i32::MIN) || value > f64::from(i32::MAX) {
            return bad("a count within 32 bits, −2147483648 to 2147483647");
        } else {
            // In range and whole: the cast is exact.
            counts.push(value as i32);
        }
    }
    Ok(if count { Column::Counts(counts) } else { Column::Values(values) })
}

/// The place of a row as the file counts it.
fn place(rows: &Rows<'_>, row: usize) -> u64 {
    let known = rows.places.partition_point(|(first, _)| *first <= row);
    match known.checked_sub(1).map(|i| rows.places[i]) {
        Some((first, place)) => place + (row - first) as u64,
        None => (rows.passed + row + 1) as u64,
    }
}
