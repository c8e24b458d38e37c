//! The head of a CSV: what stands before its rows, how its cells are delimited, what its columns
//! are called.
//!
//! - A first line that names the time is the header row, whatever follows.
//! - Otherwise rows are looked for: lines that follow each other with as many cells, numbers (or
//!   dates) all of them. The line before the first of them is the header row where it has as many
//!   cells and is not all numbers; a line of units may stand between. Lines before that (of an
//!   instrument, say) are passed over. Without such a line the columns are c1, c2, ….
//! - A first line that names the rig's channels alone is it where no line above the rows names the
//!   time besides.
//! - A line that begins with `#` or `%` is a comment; the last one before the rows may be the
//!   header row.

use super::csv_write::is_formula;
use super::lines::Cells;
use super::names::{self, TimeChoice};
use super::{csv_time, dates};

/// Lines that are looked at.
pub(super) const LOOK_AT: usize = 100;
/// Rows that follow each other before they are believed.
const ROWS: usize = 3;
/// Delimiters, the likelier first.
const DELIMITERS: [u8; 4] = [b',', b';', b'\t', b' '];

/// What the head says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Head {
    pub(super) delimiter: u8,
    /// Names of the columns.
    pub(super) names: Vec<String>,
    /// Lines before the first that may be a row.
    pub(super) lines: usize,
    /// Lines among them that are neither the header row, nor units, nor comments, nor blank.
    pub(super) passed_over: usize,
    /// Cells of every row that was looked at, where these are not as many as the names.
    pub(super) row_cells: Option<usize>,
    /// Time from row to row, s, where a line before them says it.
    pub(super) period_s: Option<f64>,
}

/// Whether a line holds no row: blank, or a comment.
pub(super) fn is_no_row(line: &[u8]) -> bool {
    matches!(line.trim_ascii_start().first(), None | Some(b'#' | b'%'))
}

/// A cell as a number; none where it is not one.
pub(super) fn number_of(text: &[u8], decimal_comma: bool) -> Option<f64> {
    let text = core::str::from_utf8(text).ok()?;
    if decimal_comma && text.contains(',') {
        return text.replacen(',', ".", 1).parse().ok();
    }
    text.parse().ok()
}

/// What people and programs write for a value that is not there, in small letters; NaN is a number.
const MISSING: [&[u8]; 14] = [
    b"",
    b"na",
    b"n/a",
    b"#n/a",
    b"#n/a n/a",
    b"<na>",
    b"null",
    b"none",
    b"-",
    b"--",
    b"-nan(ind)",
    b"nan(ind)",
    b"-1.#ind",
    b"1.#qnan",
];

/// Whether a cell says that there is no value: empty, or one of the words for it.
pub(super) fn is_missing(cell: &[u8]) -> bool {
    MISSING.iter().any(|word| cell.eq_ignore_ascii_case(word))
}

/// Whether a comma may stand before decimals.
pub(super) fn decimal_comma(delimiter: u8) -> bool {
    delimiter != b','
}

fn cells(line: &[u8], delimiter: u8) -> Option<Vec<Vec<u8>>> {
    let mut cells = Cells::default();
    cells.split(line, delimiter).then(|| (0..cells.len()).map(|i| cells.get(i).to_vec()).collect())
}

/// Finds the head in a file's first lines; none where no line looks like one. `wanted`: columns
/// that the rig file names.
pub(super) fn find(lines: &[&[u8]], time: &TimeChoice, wanted: &[&str]) -> Option<Head> {
    let first = lines.iter().position(|l| !is_no_row(l))?;
    let header = header_first(lines, first, time, wanted);
    let head = match header {
        Some(head) if names_time(&head.names, time) => Some(head),
        Some(head) => above_rows(lines).filter(|h| names_time(&h.names, time)).or(Some(head)),
        None => above_rows(lines),
    };
    head.map(|head| Head { period_s: csv_time::period(&lines[..head.lines], head.delimiter), ..head })
}

/// Whether columns are called so that one is the time, as it is chosen or may be found.
fn names_time(names: &[String], time: &TimeChoice) -> bool {
    match &time.column {
        Some(c) => names.contains(c) || c.rsplit_once(':').is_some_and(|(c, _)| names.iter().any(|n| n == c)),
        None => names.iter().any(|n| names::is_time(n)),
    }
}

/// The first line, where it names the time (or every channel).
fn header_first(lines: &[&[u8]], first: usize, time: &TimeChoice, wanted: &[&str]) -> Option<Head> {
    let next = lines[first + 1..].iter().find(|l| !is_no_row(l));
    let named: Vec<(u8, Vec<String>)> = DELIMITERS
        .into_iter()
        .filter(|d| lines[first].contains(d))
        .filter_map(|d| Some((d, as_names(&cells(lines[first], d)?))))
        .filter(|(_, names)| {
            names_time(names, time) || (!wanted.is_empty() && wanted.iter().all(|w| names.iter().any(|n| n == w)))
        })
        .collect();
    let fits = |d: u8, n: usize| next.is_some_and(|l| cells(l, d).is_some_and(|c| c.len() == n));
    let (delimiter, names) =
        named.iter().find(|(d, names)| fits(*d, names.len())).or_else(|| named.iter().find(|(d, _)| *d != b' '))?;
    let (delimiter, names) = (*delimiter, names.clone());
    let mut head = Head { delimiter, names, lines: first + 1, passed_over: 0, row_cells: None, period_s: None };
    // A line of units may follow it.
    if let Some((i, units)) = lines
        .iter()
        .enumerate()
        .skip(first + 1)
        .find(|(_, l)| !is_no_row(l))
        .and_then(|(i, l)| Some((i, cells(l, delimiter).filter(|c| c.len() == head.names.len() && are_units(c))?)))
    {
        head.names = with_units(&head.names, &units);
        head.lines = i + 1;
    }
    head.row_cells = row_cells(&lines[head.lines..], delimiter).filter(|n| *n != head.names.len());
    Some(head)
}

/// How many cells rows have, if there are several and all have as many.
fn row_cells(rows: &[&[u8]], delimiter: u8) -> Option<usize> {
    // The last line may be torn.
    let (_, whole) = rows.split_last()?;
    let mut widths = whole.iter().filter(|l| !is_no_row(l)).map(|l| cells(l, delimiter).map(|c| c.len()));
    let first = widths.next()??;
    let mut others = 0;
    for width in widths {
        others += 1;
        if width != Some(first) {
            return None;
        }
    }
    (others > 0).then_some(first)
}

/// The line above the first rows, whichever delimiter makes rows first.
fn above_rows(lines: &[&[u8]]) -> Option<Head> {
    let found = DELIMITERS.into_iter().filter_map(|d| first_rows(lines, d).map(|(i, n)| (i, d, n)));
    let (row, delimiter, width) = found.min_by_key(|(i, _, _)| *i)?;
    let mut above = lines[..row].iter().enumerate().rev().filter(|(_, l)| !l.trim_ascii().is_empty());
    let titles = |line: &[u8]| {
        let comment = line.trim_ascii_start();
        let line = comment.strip_prefix(b"#").or_else(|| comment.strip_prefix(b"%")).unwrap_or(line);
        let mut c = cells(line.trim_ascii_start(), delimiter)?;
        // LabVIEW names a column of comments that its rows do not have.
        if c.len() == width + 1 && c.last().is_some_and(|c| c.is_empty() || c.eq_ignore_ascii_case(b"comment")) {
            c.pop();
        }
        (c.len() == width && !c.iter().all(|c| is_value(c, delimiter))).then_some(c)
    };
    let mut used = 0;
    let mut names: Vec<String> = (1..=width).map(|i| format!("c{i}")).collect();
    if let Some(c) = above.next().and_then(|(_, l)| titles(l)) {
        used = 1;
        names = as_names(&c);
        if are_units(&c)
            && let Some(up) = above.next().and_then(|(_, l)| titles(l))
        {
            used = 2;
            names = with_units(&as_names(&up), &c);
        }
    }
    let before = lines[..row].iter().filter(|l| !is_no_row(l)).count();
    let passed_over = before.saturating_sub(used);
    Some(Head { delimiter, names, lines: row, passed_over, row_cells: None, period_s: None })
}

/// The first of lines that are rows at this delimiter, and how many cells they have.
fn first_rows(lines: &[&[u8]], delimiter: u8) -> Option<(usize, usize)> {
    let content: Vec<(usize, Option<usize>)> = lines
        .iter()
        .enumerate()
        .filter(|(_, l)| !is_no_row(l))
        .map(|(i, l)| (i, cells(l, delimiter).filter(|c| is_row(c, delimiter)).map(|c| c.len())))
        .collect();
    let rows = ROWS.min(content.len());
    (0..=content.len() - rows)
        .find(|&k| content[k..k + rows].iter().all(|(_, n)| n.is_some() && *n == content[k].1))
        .and_then(|k| Some((content[k].0, content[k].1?)))
}

/// Whether cells may be a row: two or more, all of them values, not all empty.
fn is_row(cells: &[Vec<u8>], delimiter: u8) -> bool {
    cells.len() >= 2
        && cells.iter().all(|c| is_missing(c) || is_value(c, delimiter))
        && cells.iter().any(|c| !is_missing(c))
}

fn is_value(cell: &[u8], delimiter: u8) -> bool {
    number_of(cell, decimal_comma(delimiter)).is_some()
        || core::str::from_utf8(cell).is_ok_and(|t| dates::nanoseconds(t).is_some())
}

/// Whether cells are units, at least one of them and nothing else.
fn are_units(cells: &[Vec<u8>]) -> bool {
    let text = |c: &[u8]| {
        let text = String::from_utf8_lossy(c).into_owned();
        text.trim_matches(|c: char| "()[]<>{}".contains(c)).to_owned()
    };
    let is_unit = |t: &str| t.is_empty() || names::unit(t).is_some() || names::per_second(t).is_some();
    let texts: Vec<String> = cells.iter().map(|c| text(c)).collect();
    // "1" and "-" are units too, and numbers or gaps.
    texts.iter().all(|t| is_unit(t)) && texts.iter().any(|t| t.chars().any(|c| c.is_alphabetic() || c == '°'))
}

fn with_units(names: &[String], units: &[Vec<u8>]) -> Vec<String> {
    let unit = |c: &[u8]| String::from_utf8_lossy(c).trim_matches(|c: char| "()[]<>{}".contains(c)).to_owned();
    names
        .iter()
        .zip(units)
        .map(|(n, u)| match unit(u) {
            u if u.is_empty() => n.clone(),
            u => format!("{n} ({u})"),
        })
        .collect()
}

/// Names of columns: as `csv_write` puts an apostrophe before what a spreadsheet would compute, it
/// is taken off.
fn as_names(cells: &[Vec<u8>]) -> Vec<String> {
    let name = |c: &Vec<u8>| {
        let cell = String::from_utf8_lossy(c).into_owned();
        cell.strip_prefix('\'').filter(|c| is_formula(c)).map(str::to_owned).unwrap_or(cell)
    };
    cells.iter().map(name).collect()
}

/// The head of a file of which no line looks like one: its first line, delimited by what stands in
/// it.
pub(super) fn plain(line: &[u8]) -> Option<Head> {
    let delimiter = DELIMITERS[..3].iter().copied().find(|d| line.contains(d)).unwrap_or(b',');
    let names = as_names(&cells(line, delimiter)?);
    Some(Head { delimiter, names, lines: 1, passed_over: 0, row_cells: None, period_s: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(text: &str) -> Head {
        let lines: Vec<&[u8]> = text.lines().map(str::as_bytes).collect();
        find(&lines, &TimeChoice::default(), &[]).unwrap_or_else(|| panic!("{text}"))
    }

    fn names(text: &str) -> (char, Vec<String>, usize, usize) {
        let h = head(text);
        (char::from(h.delimiter), h.names, h.lines, h.passed_over)
    }

    fn list(names: &[&str]) -> Vec<String> {
        names.iter().map(|n| (*n).to_owned()).collect()
    }

    #[test]
    fn headers_of_all_kinds_are_found() {
        let german = "Time (s);Winkel 1 (deg)\n0,000;1,5\n0,002;1,6\n";
        assert_eq!(names(german), (';', list(&["Time (s)", "Winkel 1 (deg)"]), 1, 0));
        assert_eq!(names("t\tx, y\n0\t1\n").1, list(&["t", "x, y"]));
        assert_eq!(names("# made by hand\n\nt,x\n0,1\n"), (',', list(&["t", "x"]), 3, 0));
        let units = "time;angle\nms;deg\n0;1\n2;1\n4;1\n";
        assert_eq!(names(units), (';', list(&["time (ms)", "angle (deg)"]), 2, 0));
        // As numpy.savetxt writes it.
        assert_eq!(names("# t angle\n0.0 1.0\n0.1 1.1\n0.2 1.3\n"), (' ', list(&["t", "angle"]), 1, 0));
        assert_eq!(names("a,b\n0.0,1.0\n0.1,1.1\n0.2,1.3\n"), (',', list(&["a", "b"]), 1, 0));
    }

    #[test]
    fn without_a_header_columns_are_numbered() {
        assert_eq!(names("0.0,1.0\n0.1,1.1\n0.2,1.3\n"), (',', list(&["c1", "c2"]), 0, 0));
        assert_eq!(names("0,0;1,0\n0,1;1,1\n0,2;1,3\n"), (';', list(&["c1", "c2"]), 0, 0));
        assert_eq!(names("# a note of mine\n0  1.0\n1  1.1\n2  1.3\n"), (' ', list(&["c1", "c2"]), 1, 0));
    }

    #[test]
    fn what_an_instrument_writes_first_is_passed_over() {
        let text = "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\nChannels\t2\nX_Value\tA\tB\tComment\n\
                    0,0\t1,0\t2,0\n0,1\t1,1\t2\n0,2\t1\t2\n";
        assert_eq!(names(text), ('\t', list(&["X_Value", "A", "B"]), 6, 4));
        let text = "Rig 3\nwhen;today\nWinkel;Kraft\ngrad;N\n1;2\n3;4\n5;6\n";
        assert_eq!(names(text), (';', list(&["Winkel (grad)", "Kraft (N)"]), 4, 2));
    }

    #[test]
    fn a_damaged_first_row_is_no_preamble() {
        assert_eq!(names("t,x\nfoo,1\n0.1,2\n0.2,3\n0.3,3\n"), (',', list(&["t", "x"]), 1, 0));
        assert_eq!(find(&[b"a picture of nothing"], &TimeChoice::default(), &[]), None);
    }
}
