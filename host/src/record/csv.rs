//! Records as CSV, plain or gzipped: a header row, a column `t` in seconds, one column for each channel of the rig.
//!
//! - Delimiter: `,`, or `;` or a tab where the header has no `,`; with `;` a decimal comma is taken too. A byte-order mark, CRLF,
//!   quoted cells (within one line), blank lines and further columns are accepted.
//! - An empty cell or `NaN` of a channel is a gap; anything else that is not a number, and an infinite one, is an error.
//! - `t` must increase from row to row; it need not start at 0.
//! - A last line that is torn (no line feed, and cells missing or broken), a truncated gzip stream and one whose checksum is
//!   wrong are errors that name the last whole row; with [`ReadOptions::recover`] the rows up to there are read.
//! - whirl's own CSV has the columns `tick`, `phase` and `amplitude_nm` too; they are then used as the device's.
//!
//! Lines are streamed: memory is that of the columns read.

use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use super::formats::{Format, ReadOptions, shown};
use super::lines::{Cells, LINE_LIMIT, Line, Lines};
use super::rows::{Cell, Rows, missing_column};
use super::{Column, Record, segments};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::warning::Warning;

/// Columns that only whirl's own CSV has.
pub(super) const OWN_COLUMNS: [&str; 3] = ["tick", "phase", "amplitude_nm"];

pub(super) const FORMAT: Format = Format {
    id: "csv",
    about: "CSV with a header row and a column t in seconds (.csv)",
    extensions: &["csv", "tsv", "txt"],
    is: |head| !head.iter().any(|&b| b < 9 || (b > 13 && b < 32)),
    read: |path, rig, options| {
        let file = open(path)?;
        read_rows(BufReader::with_capacity(1 << 16, file), path, rig, options)
    },
};

pub(super) const GZIP: Format = Format {
    id: "csv.gz",
    about: "gzipped CSV (.csv.gz)",
    extensions: &["csv.gz", "tsv.gz", "gz"],
    is: |head| head.starts_with(&[0x1f, 0x8b]),
    read: |path, rig, options| {
        let gzip = MultiGzDecoder::new(BufReader::with_capacity(1 << 16, open(path)?));
        read_rows(BufReader::with_capacity(1 << 16, gzip), path, rig, options)
    },
};

fn open(path: &Path) -> Result<File> {
    File::open(path).map_err(|e| BadInput::io(path, &e).remedy("Name a record that exists and can be read"))
}

/// Where the columns of interest stand.
struct Layout {
    delimiter: u8,
    width: usize,
    t: usize,
    channels: Vec<usize>,
    own: Option<[usize; 3]>,
}

/// One row, parsed but not yet taken.
struct Row {
    t: f64,
    cells: Vec<Cell>,
    own: (i64, u32, u32),
}

fn read_rows<R: BufRead>(reader: R, path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    let mut lines = Lines::new(reader);
    let mut cells = Cells::default();
    let layout = loop {
        match lines.advance() {
            Line::Whole { .. } if lines.bytes.trim_ascii().is_empty() => {}
            Line::Whole { .. } => break header(&lines.bytes, lines.number, path, rig, &mut cells)?,
            Line::End => {
                return Err(BadInput::new("no line", "a header row")
                    .in_file(path)
                    .at("start of file")
                    .remedy("Record again, or export the data with the header"));
            }
            Line::TooLong => return Err(too_long(path, lines.number)),
            Line::Broken(e) => return Err(broken(&e, path, "no row is whole").0),
        }
    };
    let mut rows = Rows::new(path, rig, "line", layout.own.is_some());
    rows.resample = options.resample;
    let mut row = Row { t: 0.0, cells: Vec::with_capacity(rig.channel.len()), own: (0, 0, 0) };
    let mut warnings = Vec::new();
    loop {
        match lines.advance() {
            Line::End => break,
            Line::TooLong => return Err(too_long(path, lines.number)),
            Line::Broken(e) => {
                let (error, advice) = broken(&e, path, &rows.last_whole());
                if !options.recover || advice.is_empty() {
                    return Err(error);
                }
                warnings.push(recovered(&error, advice));
                break;
            }
            Line::Whole { ended } => {
                if lines.bytes.trim_ascii().is_empty() {
                    continue;
                }
                let parsed = parse(&lines.bytes, lines.number, &layout, &rows, &mut cells, &mut row);
                // A line cut right behind a delimiter has all of its cells, the last one empty.
                let cut = !ended && cells.get(layout.width - 1).is_empty();
                match parsed {
                    Ok(()) if !cut => {
                        take(&mut rows, lines.number, &row);
                        if !ended {
                            warnings.push(Warning::new(
                                "no-line-feed",
                                format!(
                                    "line {}, the last, has no line feed: its last number may be cut off",
                                    lines.number
                                ),
                                "If this file was cut short, copy it again",
                            ));
                        }
                    }
                    Err(e) if ended => return Err(e),
                    Ok(()) | Err(_) => {
                        let error = BadInput::new(
                            format!("a torn last line, {}; {}", shown(&lines.bytes), rows.last_whole()),
                            format!("{} cells and a line feed", layout.width),
                        )
                        .in_file(path)
                        .at(format!("line {}", lines.number))
                        .remedy("Copy the file again, or read it up to the last whole row with --recover");
                        if !options.recover {
                            return Err(error);
                        }
                        warnings.push(recovered(&error, "What follows the last whole row is lost"));
                        break;
                    }
                }
            }
        }
    }
    segments::assemble(rows, None, None, warnings)
}

/// Reads the header row.
fn header(line: &[u8], number: u64, path: &Path, rig: &Rig, cells: &mut Cells) -> Result<Layout> {
    let line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line);
    let delimiter = [b',', b';', b'\t'].into_iter().find(|d| line.contains(d)).unwrap_or(b',');
    let bad = |found: String, expected: &str| BadInput::new(found, expected).in_file(path).at(format!("line {number}"));
    if !cells.split(line, delimiter) {
        return Err(bad("a quote that does not end on its line".to_owned(), "a header row").remedy("Mend the header"));
    }
    let names: Vec<String> = (0..cells.len()).map(|i| String::from_utf8_lossy(cells.get(i)).into_owned()).collect();
    let find = |wanted: &str| -> Result<usize> {
        let mut places = names.iter().enumerate().filter(|(_, n)| *n == wanted).map(|(i, _)| i);
        let Some(first) = places.next() else {
            if names.iter().all(|n| n.replace(',', ".").parse::<f64>().is_ok()) {
                return Err(bad(format!("{} (numbers)", shown(line)), "a header row that names the columns")
                    .remedy("Add a first line such as t,count1,count2"));
            }
            return Err(missing_column(path, wanted, &names));
        };
        if places.next().is_some() {
            return Err(bad(format!("the column {wanted} twice"), "each column once").remedy("Rename one of them"));
        }
        Ok(first)
    };
    let t = find("t")?;
    let channels = rig.channel.iter().map(|c| find(&c.name)).collect::<Result<Vec<usize>>>()?;
    let own = OWN_COLUMNS.map(|name| names.iter().position(|n| n == name));
    let own = match own {
        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
        _ => None,
    };
    Ok(Layout { delimiter, width: names.len(), t, channels, own })
}

/// Parses one row into `row`; nothing is taken yet, so that a torn line leaves no half row.
fn parse(line: &[u8], number: u64, layout: &Layout, rows: &Rows<'_>, cells: &mut Cells, row: &mut Row) -> Result<()> {
    let at_line = |e: BadInput| e.in_file(rows.path).at(format!("line {number}"));
    if !cells.split(line, layout.delimiter) {
        return Err(at_line(
            BadInput::new("a quote that does not end on its line", "closed quotes").remedy("Mend the line"),
        ));
    }
    if cells.len() != layout.width {
        return Err(at_line(
            BadInput::new(format!("{} cells", cells.len()), format!("{} as in the header", layout.width))
                .remedy("Mend the line; a text with the delimiter in it must be in quotes"),
        ));
    }
    let comma = layout.delimiter == b';';
    row.t = match number_of(cells.get(layout.t), comma) {
        Some(t) => t,
        None if cells.get(layout.t).is_empty() => f64::NAN,
        None => {
            return Err(rows
                .bad(number, "t", shown(cells.get(layout.t)), "a time in seconds")
                .remedy("Write t as seconds, such as 0.002, not as a date"));
        }
    };
    rows.check_time(number, row.t)?;
    row.cells.clear();
    for (k, &place) in layout.channels.iter().enumerate() {
        let text = cells.get(place);
        let counts = matches!(rows.columns[k], Column::Counts(_));
        let integer = if counts { core::str::from_utf8(text).ok().and_then(|s| s.parse::<i64>().ok()) } else { None };
        let cell = match integer {
            Some(value) => rows.check_integer(number, k, value)?,
            None if text.is_empty() => Cell::Missing,
            None => match number_of(text, comma) {
                Some(value) => rows.check_number(number, k, value)?,
                None => {
                    let c = &rows.rig.channel[k];
                    return Err(rows
                        .bad(number, &c.name, shown(text), &format!("a number in {}", c.unit))
                        .remedy("Mend the cell, or leave it empty (that is a gap)"));
                }
            },
        };
        row.cells.push(cell);
    }
    if let Some(own) = layout.own {
        let whole = |i: usize, low: i64, high: i64| {
            let text = cells.get(own[i]);
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
        row.own = (whole(0, i64::MIN, i64::MAX)?, whole(1, 0, high)? as u32, whole(2, 0, high)? as u32);
        if let Some(&before) = rows.device.as_ref().and_then(|d| d.tick.last())
            && row.own.0 <= before
        {
            return Err(rows
                .bad(number, "tick", format!("{} after {before}", row.own.0), "a tick later than the row before")
                .remedy("Sort the rows by tick, or remove the column (t is used then)"));
        }
    }
    Ok(())
}

fn take(rows: &mut Rows<'_>, number: u64, row: &Row) {
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

/// A cell as a number; none where it is not one.
fn number_of(text: &[u8], decimal_comma: bool) -> Option<f64> {
    let text = core::str::from_utf8(text).ok()?;
    if decimal_comma && text.contains(',') {
        return text.replacen(',', ".", 1).parse().ok();
    }
    text.parse().ok()
}

fn too_long(path: &Path, number: u64) -> BadInput {
    BadInput::new(format!("a line of more than {LINE_LIMIT} bytes"), "lines of text")
        .in_file(path)
        .at(format!("line {number}"))
        .remedy("This is not a CSV with one row a line: export it again")
}

/// The error for a stream that broke off, and the advice where its rows can be recovered (empty where not).
fn broken(e: &std::io::Error, path: &Path, last: &str) -> (BadInput, &'static str) {
    let (what, advice) = match e.kind() {
        ErrorKind::UnexpectedEof => ("a truncated gzip stream", "What follows the last whole row is lost"),
        ErrorKind::InvalidInput | ErrorKind::InvalidData => (
            "a damaged gzip stream",
            "The checksum or the stream is wrong, so that rows that were read may be wrong too: compare with another copy",
        ),
        _ => return (BadInput::io(path, e).remedy("Copy the file again"), ""),
    };
    let error = BadInput::new(format!("{what} ({e}); {last}"), "a whole one")
        .in_file(path)
        .at("gzip")
        .remedy("Copy the file again, or read it up to the last whole row with --recover");
    (error, advice)
}

fn recovered(error: &BadInput, advice: &str) -> Warning {
    Warning::new("recovered", format!("{}: found {}", error.place.as_deref().unwrap_or("file"), error.found), advice)
}

#[cfg(test)]
#[path = "csv_tests.rs"]
mod tests;
