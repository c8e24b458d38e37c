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
//! Lines are streamed: memory is that of the columns read, or of a block of rows ([`super::stream`]).

use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use super::csv_write::is_formula;
use super::formats::{Format, ReadOptions, open, shown};
use super::lines::{Cells, LINE_LIMIT, Line, Lines};
use super::rows::{Cell, Rows, missing_column};
use super::stream::{Source, Streamed};
use super::{Column, Losses, Metadata, Record, segments};
use crate::capture::interrupted::ticks_behind;
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
    read: |path, rig, options| Reader::open(plain(path)?, path, rig, options)?.read(rig, options),
    stream: Some(Streamed {
        open: |path, rig, options| Ok(Box::new(Reader::open(plain(path)?, path, rig, options)?)),
        rows: |path| rows_of(path, 1),
    }),
};

pub(super) const GZIP: Format = Format {
    id: "csv.gz",
    about: "gzipped CSV (.csv.gz)",
    extensions: &["csv.gz", "tsv.gz", "gz"],
    is: |head| head.starts_with(&[0x1f, 0x8b]),
    read: |path, rig, options| Reader::open(gzipped(path)?, path, rig, options)?.read(rig, options),
    stream: Some(Streamed {
        open: |path, rig, options| Ok(Box::new(Reader::open(gzipped(path)?, path, rig, options)?)),
        // Numbers in decimals shrink to a third or a quarter.
        rows: |path| rows_of(path, 4),
    }),
};

fn plain(path: &Path) -> Result<BufReader<File>> {
    Ok(BufReader::with_capacity(1 << 16, open(path)?))
}

fn gzipped(path: &Path) -> Result<BufReader<MultiGzDecoder<BufReader<File>>>> {
    Ok(BufReader::with_capacity(1 << 16, MultiGzDecoder::new(plain(path)?)))
}

/// About how many rows a file has whose text is so many times as long: its length by that of its first lines.
fn rows_of(path: &Path, times: u64) -> Option<u64> {
    let length = std::fs::metadata(path).ok()?.len().saturating_mul(times);
    let mut head = Vec::new();
    let file = open(path).ok()?;
    if times > 1 {
        MultiGzDecoder::new(BufReader::new(file)).take(1 << 16).read_to_end(&mut head).ok()?;
    } else {
        file.take(1 << 16).read_to_end(&mut head).ok()?;
    }
    let lines = head.iter().filter(|b| **b == b'\n').count().max(1) as u64;
    Some(length / (head.len() as u64 / lines).max(1))
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

/// Reads rows, all at once or some at a time.
struct Reader<'a, R> {
    lines: Lines<R>,
    cells: Cells,
    layout: Layout,
    row: Row,
    path: &'a Path,
    recover: bool,
    ended: bool,
    warnings: Vec<Warning>,
}

impl<'a, R: BufRead> Reader<'a, R> {
    fn open(reader: R, path: &'a Path, rig: &Rig, options: &ReadOptions) -> Result<Self> {
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
        let row = Row { t: 0.0, cells: Vec::with_capacity(rig.channel.len()), own: (0, 0, 0) };
        let recover = options.recover;
        Ok(Self { lines, cells, layout, row, path, recover, ended: false, warnings: Vec::new() })
    }

    fn read(mut self, rig: &Rig, options: &ReadOptions) -> Result<Record> {
        let mut rows = Rows::new(self.path, rig, "line", self.layout.own.is_some());
        rows.resample = options.resample;
        while self.fill(&mut rows, usize::MAX)? {}
        segments::assemble(rows, None, None, self.warnings)
    }

    /// A CSV that was cut behind a whole line looks whole: the journal of its capture, where one is beside it, knows better.
    fn check_journal(&mut self, rows: &Rows<'_>) -> Result<()> {
        let last = self.layout.own.filter(|_| rows.passed + rows.t.len() > 0).map(|_| self.row.own.0);
        let Some(ticks) = last.and_then(|last| ticks_behind(self.path, rows.rig, last)) else { return Ok(()) };
        let error = BadInput::new(
            format!("the record of an interrupted capture; {}", rows.last_whole()),
            format!("{ticks} ticks more, which are in the journal beside it"),
        )
        .in_file(self.path)
        .at("end of file")
        .remedy("Or read it up to its last row with --recover");
        if !self.recover {
            return Err(error);
        }
        self.warnings.push(recovered(&error, "The journal beside it has the rest: see the command that capture names"));
        Ok(())
    }

    /// Reads the next row; whether there was one.
    fn next(&mut self, rows: &mut Rows<'_>) -> Result<bool> {
        let number = self.lines.number + 1;
        match self.lines.advance() {
            Line::End => Ok(false),
            Line::TooLong => Err(too_long(self.path, number)),
            Line::Broken(e) => {
                let (error, advice) = broken(&e, self.path, &rows.last_whole());
                if !self.recover || advice.is_empty() {
                    return Err(error);
                }
                self.warnings.push(recovered(&error, advice));
                Ok(false)
            }
            Line::Whole { .. } if self.lines.bytes.trim_ascii().is_empty() => Ok(true),
            Line::Whole { ended } => {
                let parsed = parse(&self.lines.bytes, number, &self.layout, rows, &mut self.cells, &mut self.row);
                // A line cut right behind a delimiter has all of its cells, the last one empty.
                let cut = !ended && self.cells.get(self.layout.width - 1).is_empty();
                match parsed {
                    Ok(()) if !cut => {
                        take(rows, number, &self.row);
                        if !ended {
                            self.warnings.push(Warning::new(
                                "no-line-feed",
                                format!("line {number}, the last, has no line feed: its last number may be cut off"),
                                "If this file was cut short, copy it again",
                            ));
                        }
                        Ok(true)
                    }
                    Err(e) if ended => Err(e),
                    Ok(()) | Err(_) => {
                        let error = BadInput::new(
                            format!("a torn last line, {}; {}", shown(&self.lines.bytes), rows.last_whole()),
                            format!("{} cells and a line feed", self.layout.width),
                        )
                        .in_file(self.path)
                        .at(format!("line {number}"))
                        .remedy("Copy the file again, or read it up to the last whole row with --recover");
                        if !self.recover {
                            return Err(error);
                        }
                        self.warnings.push(recovered(&error, "What follows the last whole row is lost"));
                        Ok(false)
                    }
                }
            }
        }
    }
}

impl<R: BufRead> Source for Reader<'_, R> {
    fn fill(&mut self, rows: &mut Rows<'_>, most: usize) -> Result<bool> {
        let until = rows.t.len().saturating_add(most);
        while !self.ended && rows.t.len() < until {
            self.ended = !self.next(rows)?;
        }
        if self.ended { self.check_journal(rows).map(|()| false) } else { Ok(true) }
    }

    fn warnings(&mut self, _: &Rows<'_>) -> Result<Vec<Warning>> {
        Ok(std::mem::take(&mut self.warnings))
    }

    fn word(&self) -> &'static str {
        "line"
    }

    fn own(&self) -> bool {
        self.layout.own.is_some()
    }

    fn metadata(&self) -> Option<&Metadata> {
        None
    }

    fn losses(&self) -> Option<&Losses> {
        None
    }
}

/// Reads the header row.
fn header(line: &[u8], number: u64, path: &Path, rig: &Rig, cells: &mut Cells) -> Result<Layout> {
    let line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line);
    let delimiter = [b',', b';', b'\t'].into_iter().find(|d| line.contains(d)).unwrap_or(b',');
    let bad = |found: String, expected: &str| BadInput::new(found, expected).in_file(path).at(format!("line {number}"));
    if !cells.split(line, delimiter) {
        return Err(bad("a quote that does not end on its line".to_owned(), "a header row").remedy("Mend the header"));
    }
    // As `csv_write` puts an apostrophe before what a spreadsheet would compute.
    let name = |i: usize| {
        let cell = String::from_utf8_lossy(cells.get(i)).into_owned();
        cell.strip_prefix('\'').filter(|c| is_formula(c)).map(str::to_owned).unwrap_or(cell)
    };
    let names: Vec<String> = (0..cells.len()).map(name).collect();
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
