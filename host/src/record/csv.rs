//! Records as CSV, plain or gzipped: a column of the time, one column for each channel of the rig.
//!
//! - The head (header row, delimiter, comments, what an instrument writes before):
//!   [`super::csv_head`]. Where the delimiter is no comma a decimal comma is taken too. A
//!   byte-order mark, CRLF, quoted cells (within one line), blank lines and further columns are
//!   accepted.
//! - The time: a number, in the unit that the column's name or the rig file says, or a date
//!   ([`super::dates`]); dates count from the first.
//! - An empty cell or `NaN` of a channel is a gap; anything else that is not a number, and an
//!   infinite one, is an error.
//! - Times must increase from row to row; it need not start at 0.
//! - A last line that is torn (no line feed, and cells missing or broken), a truncated gzip stream
//!   and one whose checksum is wrong are errors that name the last whole row; with
//!   [`ReadOptions::recover`] the rows up to there are read.
//! - whirl's own CSV has the columns `tick`, `phase` and `amplitude_nm` too; they are then used as
//!   the device's.
//!
//! Lines are streamed: memory is that of the columns read, or of a block of rows
//! ([`super::stream`]).

use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use super::csv_head::{self, Head, LOOK_AT, number_of};
use super::csv_row::{Layout, Row, layout, parse, take};
use super::formats::{Format, Listed, ReadOptions, open, shown};
use super::lines::{Cells, LINE_LIMIT, Line, Lines};
use super::names::TimeChoice;
use super::rows::{Rows, sources};
use super::stream::{Source, Streamed};
use super::{Losses, Metadata, Record, csv_time, segments};
use crate::capture::interrupted::ticks_behind;
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::warning::Warning;
use crate::wording::format::{several, shortest};

/// Whole numbers up to which binary64 holds each.
pub(super) const EXACT: f64 = 9_007_199_254_740_992.0;
/// Columns that only whirl's own CSV has.
pub(super) const OWN_COLUMNS: [&str; 3] = ["tick", "phase", "amplitude_nm"];

/// How many times as large as the number above it one is whose exponent was cut off.
const LEAP: f64 = 100.0;

pub(super) const FORMAT: Format = Format {
    id: "csv",
    about: "CSV with a column for the time (.csv, .tsv, .txt, .lvm)",
    extensions: &["csv", "tsv", "lvm", "dat", "txt"],
    is: |head| !head.iter().any(|&b| b < 9 || (b > 13 && b < 32)),
    columns: |path, time| listed(plain(path)?, path, time),
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
    columns: |path, time| listed(gzipped(path)?, path, time),
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

/// About how many rows a file has whose text is so many times as long: its length by that of its
/// first lines.
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
        let head = head(&mut lines, path, rig)?;
        let layout =
            layout(&head, path, rig).map_err(|e| csv_time::untold(e, &head, &lines.look_ahead(LOOK_AT), rig))?;
        let mut warnings = Vec::new();
        if head.passed_over > 0 {
            let (were, lines) = if head.passed_over == 1 { ("was", "line") } else { ("were", "lines") };
            let apart =
                |s: f64| format!("; no column holds the time, and rows are {} s apart, as these say", shortest(s));
            let apart = layout.period_s.map(apart).unwrap_or_default();
            warnings.push(Warning::new(
                "head-passed-over",
                format!(
                    "{} {lines} before the rows, which begin behind line {}, {were} passed over; the columns are {}{apart}",
                    head.passed_over,
                    head.lines,
                    head.names.join(", ")
                ),
                "Right where an instrument writes a head of its own",
            ));
        }
        let row = Row { t: 0.0, tick: None, cells: Vec::with_capacity(layout.channels.len()), own: (0, 0, 0) };
        let recover = options.recover;
        Ok(Self { lines, cells: Cells::default(), layout, row, path, recover, ended: false, warnings })
    }

    fn read(mut self, rig: &Rig, options: &ReadOptions) -> Result<Record> {
        let mut rows = Rows::new(self.path, rig, "line", self.layout.own.is_some());
        rows.resample = options.resample;
        while self.fill(&mut rows, usize::MAX)? {}
        segments::assemble(rows, None, None, self.warnings)
    }

    /// Why the last number of a line without a line feed is taken for cut off: it is shorter than
    /// the one above it, or leaps away from it. None where no column of interest has it.
    fn shortened(&self) -> Option<String> {
        let last = self.layout.width - 1;
        if !self.layout.channels.contains(&last) && self.layout.own.is_none() {
            return None;
        }
        let text = self.cells.get(last).to_vec();
        let mut above = Cells::default();
        if !above.split(&self.lines.before, self.layout.delimiter) || above.len() != self.layout.width {
            return None;
        }
        let above = above.get(last);
        let comma = csv_head::decimal_comma(self.layout.delimiter);
        let (x, before) = (number_of(&text, comma)?, number_of(above, comma)?);
        let is_shorter = text.len() < above.len();
        // A number of as many characters that lost its exponent or its last digits before the point.
        let is_off = before != 0.0 && x.abs() > LEAP * before.abs() && text.len() <= above.len();
        (is_shorter || is_off).then(|| format!("{} behind {}", shown(&text), shown(above)))
    }

    /// A CSV that was cut behind a whole line looks whole: the journal of its capture, where one is
    /// beside it, knows better.
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
            Line::Whole { .. } if csv_head::is_no_row(&self.lines.bytes) => Ok(true),
            Line::Whole { ended } => {
                let parsed = parse(&self.lines.bytes, number, &self.layout, rows, &mut self.cells, &mut self.row);
                // A line cut right behind a delimiter has all of its cells, the last one empty.
                let cut = !ended && self.cells.get(self.layout.width - 1).is_empty();
                match parsed {
                    Ok(()) if !cut => {
                        let shortened = if ended { None } else { self.shortened() };
                        if shortened.is_none() {
                            take(rows, number, &self.row);
                        }
                        if !ended {
                            let why =
                                shortened.map_or_else(String::new, |why| format!(", {why}: this row is left out"));
                            let told = "the last, has no line feed: its last number may be cut off";
                            self.warnings.push(Warning::new(
                                "no-line-feed",
                                format!("line {number}, {told}{why}"),
                                "If this file was cut short, copy it again",
                            ));
                        }
                        Ok(true)
                    }
                    Err(e) if ended => Err(e),
                    Ok(()) | Err(_) => {
                        let error = BadInput::new(
                            format!("a torn last line, {}; {}", shown(&self.lines.bytes), rows.last_whole()),
                            format!("{} and a line feed", several(self.layout.width, "cell")),
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
        if rows.time_name != self.layout.time {
            rows.time_name.clone_from(&self.layout.time);
        }
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

/// The head of a file, its lines passed over.
fn head<R: BufRead>(lines: &mut Lines<R>, path: &Path, rig: &Rig) -> Result<Head> {
    let mut ahead = lines.look_ahead(LOOK_AT);
    if let Some(first) = ahead.first_mut() {
        *first = first.strip_prefix(b"\xef\xbb\xbf").unwrap_or(first);
    }
    let is_cr = |line: &[u8]| line.trim_ascii_end().contains(&b'\r') && !line.contains(&b'"');
    // All of the file is then one line.
    if let [only] = ahead[..]
        && is_cr(only)
    {
        return Err(carriage_returns(path));
    }
    let sources = sources(rig);
    let wanted: Vec<&str> = sources.columns.iter().map(|c| c.name.as_str()).collect();
    if let Some(head) = csv_head::find(&ahead, &rig.time, &wanted) {
        for _ in 0..head.lines {
            lines.advance();
        }
        return Ok(head);
    }
    loop {
        match lines.advance() {
            Line::Whole { .. } if csv_head::is_no_row(&lines.bytes) => {}
            Line::Whole { .. } => {
                let line = lines.bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&lines.bytes);
                return csv_head::plain(line).ok_or_else(|| {
                    BadInput::new("a quote that does not end on its line", "a header row")
                        .in_file(path)
                        .at(format!("line {}", lines.number))
                        .remedy("Mend the header")
                });
            }
            Line::End => {
                return Err(BadInput::new("no line", "a header row")
                    .in_file(path)
                    .at("start of file")
                    .remedy("Record again, or export the data with the header"));
            }
            Line::TooLong if lines.bytes.iter().filter(|b| **b == b'\r').count() > 1 => {
                return Err(carriage_returns(path));
            }
            Line::TooLong => return Err(too_long(path, lines.number)),
            Line::Broken(e) => return Err(broken(&e, path, "no row is whole").0),
        }
    }
}

/// Columns of a file, and whether most cells of the first rows are numbers.
fn listed<R: BufRead>(reader: R, path: &Path, time: &TimeChoice) -> Result<Vec<Listed>> {
    let mut lines = Lines::new(reader);
    let rig = Rig::of_columns(&[], time.clone());
    let head = head(&mut lines, path, &rig)?;
    let mut cells = Cells::default();
    // Cells that are numbers, and cells that are something else.
    let mut seen = vec![(0, 0); head.names.len()];
    let comma = csv_head::decimal_comma(head.delimiter);
    for line in lines.look_ahead(LOOK_AT).into_iter().filter(|l| !csv_head::is_no_row(l)) {
        if !cells.split(line, head.delimiter) || cells.len() != seen.len() {
            continue;
        }
        for (i, (numbers, others)) in seen.iter_mut().enumerate() {
            match number_of(cells.get(i), comma) {
                Some(_) => *numbers += 1,
                None if csv_head::is_missing(cells.get(i)) => {}
                None => *others += 1,
            }
        }
    }
    // A column of numbers with a word in it is one: where it is read, the word is told with its line.
    let listed = |(name, (numbers, others)): (String, (u64, u64))| Listed { name, is_number: numbers > others };
    Ok(head.names.into_iter().zip(seen).map(listed).collect())
}

/// The error for lines that end as on an old Macintosh.
fn carriage_returns(path: &Path) -> BadInput {
    BadInput::new("lines that end in a carriage return alone (CR)", "lines that end in a line feed (LF or CRLF)")
        .in_file(path)
        .at("line 1")
        .remedy("Save the file with the line ends of Linux or Windows: tr '\\r' '\\n' < FILE > lf.csv")
}

fn too_long(path: &Path, number: u64) -> BadInput {
    BadInput::new(format!("a line of more than {LINE_LIMIT} bytes"), "lines of text")
        .in_file(path)
        .at(format!("line {number}"))
        .remedy("This is not a CSV with one row a line: export it again")
}

/// The error for a stream that broke off, and the advice where its rows can be recovered (empty
/// where not).
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

#[cfg(test)]
#[path = "csv_cause_tests.rs"]
mod cause_tests;
