//! One row of a CSV: its cells by the columns of interest, parsed whole before anything of it is
//! taken.

use std::path::Path;

use super::csv::{EXACT, OWN_COLUMNS};
use super::csv_head::{self, Head, is_missing, number_of};
use super::formats::shown;
use super::lines::Cells;
use super::names::{TimeChoice, TimeColumn};
use super::rows::{Cell, Rows, sources};
use super::{Column, dates, names};
use crate::error::{BadInput, Result, plain};
use crate::rig::Rig;
use crate::wording::format::several;

/// What to do with a line that has more cells or fewer than the others.
const MEND: &str = "Mend the line; a text with the delimiter in it must be in quotes";

/// A day in nanoseconds, and half of one in seconds.
const DAY_NS: i64 = 86_400_000_000_000;
const HALF_A_DAY_S: f64 = 43_200.0;

/// Where the columns of interest stand.
pub(super) struct Layout {
    pub(super) delimiter: u8,
    pub(super) width: usize,
    /// A header row for the rows, where theirs has more names or fewer than all of them have cells.
    pub(super) mended: Option<String>,
    pub(super) t: usize,
    pub(super) time: String,
    pub(super) per_second: f64,
    /// Time from row to row, s, where no column has the time and the head says it.
    pub(super) period_s: Option<f64>,
    pub(super) channels: Vec<usize>,
    pub(super) own: Option<[usize; 3]>,
}

/// One row, parsed but not yet taken.
pub(super) struct Row {
    pub(super) t: f64,
    /// The time as it stands, where it counts from the first one (a date, a count too long for
    /// binary64).
    pub(super) tick: Option<i64>,
    pub(super) cells: Vec<Cell>,
    pub(super) own: (i64, u32, u32),
}

/// Where the columns stand.
pub(super) fn layout(head: &Head, path: &Path, rig: &Rig) -> Result<Layout> {
    let names = &head.names;
    let own = OWN_COLUMNS.map(|name| names.iter().position(|n| n == name));
    let own = match own {
        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
        _ => None,
    };
    // whirl's own records call the time t, whatever other records of the rig call it.
    let t = names::time_column(names, &rig.time, path).or_else(|e| match own {
        Some(_) => names::time_column(names, &TimeChoice::default(), path).map_err(|_| e),
        None => Err(e),
    });
    // Without a column a cell of the time is none.
    let is_named = rig.time.column.is_some() || names.iter().any(|n| names::is_time(n));
    let period_s = head.period_s.filter(|_| t.is_err() && !is_named);
    let counted = || TimeColumn { index: usize::MAX, name: "t".to_owned(), per_second: None };
    let t = t.or_else(|e| if period_s.is_some() { Ok(counted()) } else { Err(e) })?;
    let per_second = t.per_second.unwrap_or(1.0);
    let channels = names::find_all(names, &sources(rig).columns, path)?;
    let mended = head.row_cells.map(|n| mended(names, n, char::from(head.delimiter)));
    Ok(Layout {
        delimiter: head.delimiter,
        width: names.len(),
        mended,
        t: t.index,
        time: t.name,
        per_second,
        period_s,
        channels,
        own,
    })
}

/// What to do where all rows have so many cells, and the header row another number of names.
fn mended(names: &[String], cells: usize, delimiter: char) -> String {
    if cells < names.len() {
        return format!("All rows have {cells}: the header row has names without a column; remove them");
    }
    let further = (names.len() + 1..=cells).map(|i| format!("c{i}"));
    let all: Vec<String> = names.iter().cloned().chain(further).collect();
    let all = all.join(&delimiter.to_string());
    format!("All rows have {cells}: the header row is short; give every column a name, such as {}", plain(&all))
}

/// Parses one row into `row`; nothing is taken yet, so that a torn line leaves no half row.
pub(super) fn parse(
    line: &[u8],
    number: u64,
    layout: &Layout,
    rows: &Rows<'_>,
    cells: &mut Cells,
    row: &mut Row,
) -> Result<()> {
    let at_line = |e: BadInput| e.in_file(rows.path).at(format!("line {number}"));
    if !cells.split(line, layout.delimiter) {
        return Err(at_line(
            BadInput::new("a quote that does not end on its line", "closed quotes").remedy("Mend the line"),
        ));
    }
    if cells.len() != layout.width {
        return Err(at_line(
            BadInput::new(several(cells.len(), "cell"), format!("{} as in the header", layout.width))
                .remedy(layout.mended.as_deref().unwrap_or(MEND)),
        ));
    }
    let comma = csv_head::decimal_comma(layout.delimiter);
    (row.t, row.tick) = match layout.period_s {
        Some(period_s) => ((rows.passed + rows.t.len()) as f64 * period_s, None),
        None => time_of(number, cells.get(layout.t), layout, rows)?,
    };
    rows.check_time(number, row.t).map_err(|e| midnight(e, cells.get(layout.t), row.t, rows))?;
    row.cells.clear();
    for (k, &place) in layout.channels.iter().enumerate() {
        let text = cells.get(place);
        let counts = matches!(rows.columns[k], Column::Counts(_));
        let integer = if counts { core::str::from_utf8(text).ok().and_then(|s| s.parse::<i64>().ok()) } else { None };
        let cell = match integer {
            Some(value) => rows.check_integer(number, k, value)?,
            None if is_missing(text) => Cell::Missing,
            None => match number_of(text, comma) {
                Some(value) => rows.check_number(number, k, value)?,
                None => {
                    let c = &rows.sources.columns[k];
                    // Columns of which nothing is known yet have the unit 1.
                    let expected =
                        if c.unit == "1" { "a number".to_owned() } else { format!("a number in {}", c.unit) };
                    let remedy =
                        comma_between(text, layout).unwrap_or("Mend the cell, or leave it empty (that is a gap)");
                    return Err(rows.bad(number, &c.name, shown(text), &expected).remedy(remedy));
                }
            },
        };
        row.cells.push(cell);
    }
    if comma {
        one_decimal_sign(number, layout, rows, cells)?;
    }
    if let Some(places) = layout.own {
        row.own = own(number, places, cells, rows)?;
    }
    Ok(())
}

/// Whether a comma may stand between thousands: `124,320`.
fn may_be_thousands(text: &[u8]) -> bool {
    let Ok(text) = core::str::from_utf8(text) else { return false };
    let text = text.trim_start_matches(['-', '+']);
    let digits = |t: &str| t.bytes().all(|b| b.is_ascii_digit());
    text.split_once(',').is_some_and(|(before, behind)| {
        (1..=3).contains(&before.len())
            && !before.starts_with('0')
            && behind.len() == 3
            && digits(before)
            && digits(behind)
    })
}

/// Where other cells of the row have a decimal point, such a comma is no decimal comma: taken for
/// one the value would be a thousandth.
fn one_decimal_sign(number: u64, layout: &Layout, rows: &Rows<'_>, cells: &Cells) -> Result<()> {
    let Some(k) = layout.channels.iter().position(|&place| may_be_thousands(cells.get(place))) else { return Ok(()) };
    let mut all = layout.channels.iter().chain([&layout.t]).map(|&place| cells.get(place));
    let Some(other) = all.find(|text| text.contains(&b'.') && number_of(text, false).is_some()) else { return Ok(()) };
    let found = format!("{} beside {}", shown(cells.get(layout.channels[k])), shown(other));
    Err(rows
        .bad(number, &rows.sources.columns[k].name, found, "one sign before decimals, and none between thousands")
        .remedy("Export the file without separators of thousands, or with a decimal comma in every column"))
}

/// What only whirl's own CSV has: tick, phase, amplitude in nm.
fn own(number: u64, places: [usize; 3], cells: &Cells, rows: &Rows<'_>) -> Result<(i64, u32, u32)> {
    let whole = |i: usize, low: i64, high: i64| {
        let text = cells.get(places[i]);
        core::str::from_utf8(text)
            .ok()
            .and_then(|s| s.parse::<i64>().ok())
            .filter(|v| (low..=high).contains(v))
            .ok_or_else(|| {
                rows.bad(number, OWN_COLUMNS[i], shown(text), &format!("a whole number from {low} to {high}"))
                    .remedy("Mend the cell, or remove the column (t is used then)")
            })
    };
    let high = i64::from(u32::MAX);
    // In range of u32: both casts are exact.
    let row = (whole(0, i64::MIN, i64::MAX)?, whole(1, 0, high)? as u32, whole(2, 0, high)? as u32);
    if let Some(&before) = rows.device.as_ref().and_then(|d| d.tick.last())
        && row.0 <= before
    {
        return Err(rows
            .bad(number, "tick", format!("{} after {before}", row.0), "a tick later than the row before")
            .remedy("Sort the rows by tick, or remove the column (t is used then)"));
    }
    Ok(row)
}

/// A cell of the time in seconds, NaN where it is empty, and as it stands where it counts from the
/// first one.
fn time_of(number: u64, text: &[u8], layout: &Layout, rows: &Rows<'_>) -> Result<(f64, Option<i64>)> {
    let comma = csv_head::decimal_comma(layout.delimiter);
    let from_origin = |v: i64, per_second: f64| {
        let origin = rows.time_origin.unwrap_or(v);
        ((i128::from(v) - i128::from(origin)) as f64 / per_second, Some(v))
    };
    if let Some(t) = number_of(text, comma) {
        let long = t.abs() >= EXACT || rows.time_origin.is_some();
        let whole = if long { core::str::from_utf8(text).ok().and_then(|s| s.parse::<i64>().ok()) } else { None };
        return Ok(whole.map_or((t / layout.per_second, None), |v| from_origin(v, layout.per_second)));
    }
    let text = core::str::from_utf8(text).unwrap_or_default();
    match dates::nanoseconds(text) {
        Some(v) => Ok(from_origin(v, 1e9)),
        None if text.is_empty() => Ok((f64::NAN, None)),
        None => Err(rows.bad(number, &layout.time, shown(text.as_bytes()), "a time in seconds").remedy(
            comma_between(text.as_bytes(), layout).unwrap_or(
                "Write the time as a number, such as 0.002, or as a date such as 2026-11-23T12:00:00.002 or 23.11.2026 12:00:00.002",
            ),
        )),
    }
}

/// What to do about a cell that would be a number if a decimal comma were read.
fn comma_between(text: &[u8], layout: &Layout) -> Option<&'static str> {
    let is_one = !csv_head::decimal_comma(layout.delimiter) && text.contains(&b',') && number_of(text, true).is_some();
    is_one.then_some(
        "A decimal comma is not read where commas stand between the cells: save with decimal points, or with ; between the cells",
    )
}

/// An error of a time that is a clock's alone, without a date, and fell back by most of a day.
fn midnight(e: BadInput, text: &[u8], t: f64, rows: &Rows<'_>) -> BadInput {
    let text = core::str::from_utf8(text).unwrap_or_default();
    let is_clock = text.contains(':') && dates::nanoseconds(text).is_some_and(|ns| (0..DAY_NS).contains(&ns));
    if !is_clock || rows.t.last().is_none_or(|before| before - t < HALF_A_DAY_S) {
        return e;
    }
    BadInput { found: format!("{} behind a later time of day", shown(text.as_bytes())), ..e }.remedy(
        "The clock passed midnight: write the date with each time (2026-11-23T00:00:00.000), or split the file there",
    )
}

/// Takes a row that was parsed.
pub(super) fn take(rows: &mut Rows<'_>, number: u64, row: &Row) {
    if let Some(v) = row.tick {
        rows.time_origin.get_or_insert(v);
    }
    rows.push_time(number, row.t);
    for (k, &cell) in row.cells.iter().enumerate() {
        rows.push_cell(number, k, cell);
    }
    if let Some(d) = &mut rows.device {
        d.tick.push(row.own.0);
        d.phase.push(row.own.1);
        d.amplitude_nm.push(row.own.2);
    }
}
