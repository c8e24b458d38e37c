//! Records as LabVIEW writes them (`.lvm`, "LabVIEW Measurement"): after National Instruments'
//! "Specification for the LabVIEW Measurement File".
//!
//! A header of tags (`Separator`, `Decimal_Separator`, `X_Columns`, …) ends with
//! `***End_of_Header***`; each segment has tags of its own (`X0`, `Delta_X`, …), a second such
//! line, a row of titles and its rows. `X_Columns` says whether there is a column of times (`One`),
//! one for each channel (`Multi`), or none (`No`: then t = X0 + i·Delta_X). The columns are the
//! titles; the time is `X_Value`.
//!
//! Segments follow each other in time: a later one whose times begin anew is placed by its `Date`
//! and `Time` beside the first one's. A file without the header is a CSV like any other. Special
//! blocks (`***Start_Special***`) are passed over. All columns are held: about four times the
//! file's size.

use std::io::BufRead;
use std::path::Path;

use super::arrays::{self, Array};
use super::csv_head::{is_missing, number_of};
use super::formats::{Format, Listed, ReadOptions, open, shown};
use super::lines::{Line, Lines};
use super::rows::ROW_LIMIT;
use super::{Record, dates};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::wording::format::several;

pub(super) const FORMAT: Format = Format {
    id: "lvm",
    about: "LabVIEW measurement (.lvm)",
    extensions: &["lvm"],
    is: |head| head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head).starts_with(b"LabVIEW Measurement"),
    columns: |path, _| {
        let table = Table::read(path)?;
        Ok(table.names.into_iter().map(|name| Listed { name, is_number: true }).collect())
    },
    read: |path, rig, options| record(path, rig, options),
    stream: None,
};

const END: &str = "***End_of_Header***";
const SPECIAL: [&str; 2] = ["***Start_Special***", "***End_Special***"];
/// The column of the time.
const TIME: &str = "X_Value";
/// Most columns.
const MOST_COLUMNS: usize = 10_000;

/// Where the times of a segment come from.
#[derive(Clone, Copy, PartialEq)]
enum Times {
    /// The first column.
    One,
    /// A column before each channel.
    Multi,
    /// None: X0 and Delta_X.
    No,
}

/// All columns, the time first.
struct Table {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
}

/// What the header says, and the segment that is being read.
struct Head {
    separator: char,
    comma: bool,
    times: Times,
    /// Of the first segment and of this one, ns since 1970.
    first: Option<i64>,
    date: String,
    time: String,
    x0: f64,
    delta: f64,
    /// Added to this segment's times, s.
    shift: f64,
    rows: usize,
}

fn record(path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    let Table { names, mut columns } = Table::read(path)?;
    let place = |name: &str| names.iter().position(|n| n == name);
    // Each is asked for once.
    arrays::record(path, rig, &names, options, |name| match place(name) {
        Some(i) => Ok(Array::Floats(std::mem::take(&mut columns[i]))),
        None => Err(BadInput::new("nothing", format!("a column {name}")).in_file(path)),
    })
}

impl Table {
    fn read(path: &Path) -> Result<Self> {
        let file = std::io::BufReader::with_capacity(1 << 16, open(path)?);
        let mut reader = Reader {
            path,
            lines: Lines::new(file),
            head: Head {
                separator: '\t',
                comma: false,
                times: Times::One,
                first: None,
                date: String::new(),
                time: String::new(),
                x0: 0.0,
                delta: f64::NAN,
                shift: 0.0,
                rows: 0,
            },
            table: Self { names: Vec::new(), columns: Vec::new() },
        };
        reader.all()?;
        if reader.table.columns.first().is_none_or(Vec::is_empty) {
            return Err(super::segments::no_row(path));
        }
        Ok(reader.table)
    }
}

/// Reads the lines of a file.
struct Reader<'a, R> {
    path: &'a Path,
    lines: Lines<R>,
    head: Head,
    table: Table,
}

impl<R: BufRead> Reader<'_, R> {
    fn bad(&self, found: String, expected: &str, remedy: &str) -> BadInput {
        BadInput::new(found, expected).in_file(self.path).at(format!("line {}", self.lines.number)).remedy(remedy)
    }

    /// The next line without its end; none behind the last one.
    fn line(&mut self) -> Result<Option<String>> {
        match self.lines.advance() {
            Line::End => Ok(None),
            Line::Whole { .. } => {
                let text = String::from_utf8_lossy(&self.lines.bytes);
                Ok(Some(text.trim_end_matches(['\r', '\n']).trim_start_matches('\u{feff}').to_owned()))
            }
            Line::TooLong => {
                Err(self.bad("a line that does not end".to_owned(), "lines of text", "Export the file again"))
            }
            Line::Broken(e) => Err(BadInput::io(self.path, &e).remedy("Copy the file again")),
        }
    }

    /// The file's header, then segments: tags up to the line that ends them, titles, rows up to the
    /// tags of the next one.
    fn all(&mut self) -> Result<()> {
        let mut tags = true;
        let (mut headers, mut special) = (0, false);
        while let Some(line) = self.line()? {
            let first = line.split([self.head.separator, '\t', ',']).next().unwrap_or_default().trim();
            if SPECIAL.contains(&first) {
                special = first == SPECIAL[0];
                continue;
            }
            if special || line.trim().is_empty() {
                continue;
            }
            if first == END {
                headers += 1;
                // The first one ends the file's own.
                tags = headers == 1;
                if !tags {
                    self.begin()?;
                }
            } else if tags {
                self.tag(&line)?;
            } else if first.starts_with(|c: char| c.is_alphabetic()) && !is_number(first) {
                // The tags of a further segment.
                tags = true;
                self.tag(&line)?;
            } else {
                self.row(&line)?;
            }
        }
        if headers < 2 {
            return Err(self.bad(
                format!("the end of the file after {headers} lines {END}"),
                "one behind the file's header and one behind each segment's",
                "Copy the file again, or export it as CSV",
            ));
        }
        Ok(())
    }

    fn tag(&mut self, line: &str) -> Result<()> {
        let mut cells = line.split(self.head.separator).map(str::trim);
        // Tags stand before their value is known to be separated by what the header will say.
        let (mut key, mut value) = (cells.next().unwrap_or_default(), cells.next().unwrap_or_default());
        if value.is_empty()
            && let Some((k, v)) = line.split_once(['\t', ','])
        {
            (key, value) = (k.trim(), v.split(['\t', ',']).next().unwrap_or_default().trim());
        }
        let head = &mut self.head;
        match key {
            "Separator" => head.separator = if value.eq_ignore_ascii_case("comma") { ',' } else { '\t' },
            "Decimal_Separator" => head.comma = line.trim_end().ends_with(','),
            "X_Columns" => {
                head.times = match value.to_lowercase().as_str() {
                    "one" => Times::One,
                    "multi" => Times::Multi,
                    "no" => Times::No,
                    _ => {
                        return Err(self.bad(
                            format!("X_Columns {}", shown(value.as_bytes())),
                            "One, Multi or No",
                            "Export the file again",
                        ));
                    }
                }
            }
            "Date" => value.clone_into(&mut head.date),
            // Fractions of up to 19 digits are written; nanoseconds are read.
            "Time" => head.time = value.replace(',', ".").chars().take(18).collect(),
            "X0" => head.x0 = number_of(value.as_bytes(), head.comma).unwrap_or(0.0),
            "Delta_X" => head.delta = number_of(value.as_bytes(), head.comma).unwrap_or(f64::NAN),
            _ => {}
        }
        Ok(())
    }

    /// Titles of a segment: the first one's name the columns, the others' must be the same.
    fn begin(&mut self) -> Result<()> {
        let Some(line) = self.line()? else { return Ok(()) };
        let mut titles: Vec<String> = line.split(self.head.separator).map(|t| t.trim().to_owned()).collect();
        if titles.last().is_some_and(|t| t.is_empty() || t.eq_ignore_ascii_case("comment")) {
            titles.pop();
        }
        let mut names = vec![TIME.to_owned()];
        names.extend(titles.into_iter().enumerate().filter(|(i, _)| !self.is_time(*i)).map(|(_, t)| t));
        if names.len() < 2 || names.len() > MOST_COLUMNS {
            let found = format!("{} titles of channels", names.len() - 1);
            return Err(self.bad(found, "a row of titles, X_Value first", "Export the file again"));
        }
        if self.table.names.is_empty() {
            self.table.columns = vec![Vec::new(); names.len()];
            self.table.names = names;
        } else if names != self.table.names {
            let found = format!("a segment of the columns {}", shown(names[1..].join(", ").as_bytes()));
            let expected = format!("those of the first segment, {}", self.table.names[1..].join(", "));
            return Err(self.bad(found, &expected, "Split the file, one part for each set of channels"));
        }
        let head = &mut self.head;
        let began = dates::nanoseconds(&format!("{} {}", head.date.replace('/', "-"), head.time));
        let since = began.zip(head.first).map(|(b, f)| b.saturating_sub(f) as f64 * 1e-9);
        head.first = head.first.or(began);
        (head.rows, head.shift) = (0, since.unwrap_or(0.0));
        if head.times == Times::No && !(head.delta.is_finite() && head.delta > 0.0) {
            let delta = head.delta;
            return Err(self.bad(
                format!("no column of times (X_Columns No) and Delta_X {delta}"),
                "the time between samples, s, above 0",
                "Export the file with one column of times (X_Columns One)",
            ));
        }
        Ok(())
    }

    /// Whether a column holds times.
    fn is_time(&self, column: usize) -> bool {
        match self.head.times {
            // Without times their column is there, and empty.
            Times::One | Times::No => column == 0,
            Times::Multi => column.is_multiple_of(2),
        }
    }

    fn row(&mut self, line: &str) -> Result<()> {
        let width = self.table.names.len();
        let cells: Vec<&str> = line.split(self.head.separator).map(str::trim).collect();
        let (channels, count) = match self.head.times {
            Times::Multi => ((0..width - 1).map(|k| 2 * k + 1).collect::<Vec<_>>(), 2 * (width - 1)),
            _ => ((1..width).collect(), width),
        };
        // A comment may stand behind; a channel that ended before the others has empty cells, or
        // none.
        if cells.len() > count + 1 {
            let found = several(cells.len(), "cell");
            return Err(self.bad(found, &format!("{count}, and a comment"), "Mend the line"));
        }
        let number = |cell: &str| number_of(cell.as_bytes(), self.head.comma);
        let wrong = |column: usize, cell: &str| {
            let name = self.table.names.get(column).map_or(TIME, String::as_str);
            let e = BadInput::new(shown(cell.as_bytes()), "a number").in_file(self.path);
            e.at(format!("line {}, column {name}", self.lines.number))
                .remedy("Mend the cell, or leave it empty (that is a gap)")
        };
        let mut values = Vec::with_capacity(width);
        for (k, &column) in channels.iter().enumerate() {
            let cell = cells.get(column).copied().unwrap_or_default();
            values.push(if is_missing(cell.as_bytes()) {
                f64::NAN
            } else {
                number(cell).ok_or_else(|| wrong(k + 1, cell))?
            });
        }
        let cell = cells.first().copied().unwrap_or_default();
        let own = match self.head.times {
            Times::No => self.head.x0 + self.head.rows as f64 * self.head.delta,
            _ => number(cell).ok_or_else(|| wrong(0, cell))?,
        };
        if self.head.times == Times::Multi
            && let Some(k) =
                channels.iter().find(|c| cells.get(**c - 1).is_some_and(|x| !x.is_empty() && number(x) != Some(own)))
        {
            let found = format!("times {} and {cell} in one row", shown(cells[*k - 1].as_bytes()));
            return Err(self.bad(
                found,
                "channels that are sampled together",
                "Export those of each rate as a file of their own",
            ));
        }
        if self.table.columns[0].len() >= ROW_LIMIT {
            return Err(self.bad(
                format!("more than {ROW_LIMIT} rows"),
                "a record that fits into memory",
                "Split the file",
            ));
        }
        if self.head.rows == 0 {
            // Times that go on by themselves need no shift.
            let last = self.table.columns[0].last().copied();
            self.head.shift = if last.is_none_or(|last| own > last) { 0.0 } else { self.head.shift };
        }
        self.head.rows += 1;
        self.table.columns[0].push(own + self.head.shift);
        self.table.columns[1..].iter_mut().zip(values).for_each(|(c, v)| c.push(v));
        Ok(())
    }
}

fn is_number(cell: &str) -> bool {
    number_of(cell.as_bytes(), true).is_some() || number_of(cell.as_bytes(), false).is_some()
}

#[cfg(test)]
#[path = "lvm_tests.rs"]
mod tests;
