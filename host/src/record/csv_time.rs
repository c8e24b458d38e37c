//! The time of a CSV whose rows do not hold it: what an instrument writes of it above them, and
//! what is said where nothing tells it.

use std::path::Path;

use super::csv_head::{Head, decimal_comma, is_no_row, number_of};
use super::lines::Cells;
use super::rows::{is_numbered, sources};
use super::{dates, names};
use crate::error::BadInput;
use crate::rig::Rig;

/// What instruments call the time from row to row, and the rows in a second, in small letters.
const PERIODS: [&str; 8] = [
    "sampling period",
    "sample period",
    "sampling interval",
    "sample interval",
    "time increment",
    "time interval",
    "delta t",
    "dt",
];
const RATES: [&str; 4] = ["sampling rate", "sample rate", "sampling frequency", "sample frequency"];

/// The time from row to row, s, as a line above the rows says: `Sampling Period,4.000E-06`.
pub(super) fn period(lines: &[&[u8]], delimiter: u8) -> Option<f64> {
    let of_line = |line: &&[u8]| {
        let mut cells = Cells::default();
        if !cells.split(line, delimiter) {
            return None;
        }
        let text = |i: usize| String::from_utf8_lossy(cells.get(i)).into_owned();
        let (name, unit) = names::split(text(0).trim_start_matches(['#', '%']).trim_end_matches(':'));
        let name = name.to_lowercase().replace('_', " ");
        let unit = unit.unwrap_or_else(|| text(2));
        let value = number_of(cells.get(1), decimal_comma(delimiter))?;
        let period = if PERIODS.contains(&name.as_str()) {
            value / names::per_second(&unit).unwrap_or(1.0)
        } else if RATES.contains(&name.as_str()) {
            let hz = match unit.as_str() {
                "kHz" => 1e3,
                "MHz" => 1e6,
                _ => 1.0,
            };
            1.0 / (hz * value)
        } else {
            return None;
        };
        (period.is_normal() && period > 0.0).then_some(period)
    };
    lines.iter().find_map(of_line)
}

/// The error for a file no column of which is called a time: a column that does not increase from
/// row to row cannot be it, and is not proposed.
pub(super) fn untold(e: BadInput, head: &Head, rows: &[&[u8]], rig: &Rig) -> BadInput {
    if rig.time.column.is_some() || names::time_column(&head.names, &rig.time, Path::new("")).is_ok() {
        return e;
    }
    // Two that are called a time are asked for already.
    if head.names.iter().any(|n| names::is_time(n)) {
        return e;
    }
    let used = sources(rig).columns;
    let is_once = |name: &str| !name.is_empty() && head.names.iter().filter(|n| *n == name).count() == 1;
    let rising: Vec<&str> = (0..head.names.len())
        .filter(|k| is_once(&head.names[*k]) && rises(rows, head.delimiter, *k))
        .map(|k| head.names[k].as_str())
        .collect();
    let free = rising.iter().find(|name| used.iter().all(|c| c.name != **name));
    e.remedy(match free.or(rising.first()) {
        Some(name) if is_numbered(&head.names) => format!(
            "The file has no header row that names its columns: say --time {name} (or time = \"{name}\" in the rig file) where that holds the time, or add a row such as t,count1,count2"
        ),
        Some(name) => format!("If the column {name} holds the time, say --time \"{name}\", or time = \"{name}\" in the rig file"),
        None => "No column increases from row to row, so that none is the time: add a column t in seconds, or a line such as Sampling Period,0.002 above the rows".to_owned(),
    })
}

/// Whether a column increases from each of some rows to the next.
fn rises(rows: &[&[u8]], delimiter: u8, column: usize) -> bool {
    let (mut cells, mut last, mut count) = (Cells::default(), f64::NEG_INFINITY, 0);
    for row in rows.iter().filter(|row| !is_no_row(row)) {
        if !cells.split(row, delimiter) {
            return false;
        }
        let text = cells.get(column);
        let date = || core::str::from_utf8(text).ok().and_then(dates::nanoseconds).map(|ns| ns as f64);
        match number_of(text, decimal_comma(delimiter)).or_else(date) {
            Some(value) if value > last => last = value,
            _ => return false,
        }
        count += 1;
    }
    count > 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_between_rows_is_read_from_what_an_instrument_writes() {
        for (line, period_s) in [
            ("Sampling Period,4.000E-06,", Some(4e-6)),
            ("Sample Interval,2,ms", Some(2e-3)),
            ("# sample_rate (kHz): ,0.5", Some(2e-3)),
            ("delta t,3.3E-6,3.3E-6", Some(3.3e-6)),
            ("Sampling Period,0,", None),
            ("Horizontal Scale,1.000E-03,", None),
        ] {
            let found = period(&[b"Source,CH2,", line.as_bytes()], b',');
            let near = |(a, b): (f64, f64)| (a / b - 1.0).abs() < 1e-12;
            assert!(found.is_some() == period_s.is_some() && found.zip(period_s).is_none_or(near), "{line}: {found:?}");
        }
    }
}
