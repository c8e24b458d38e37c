//! A table of many records as CSV and as Parquet: the same rows give the same bytes.

use std::path::Path;

use super::row::{Cell, Kind, Row, columns, command_of, kind};
use super::{FORMAT, parquet};
use crate::error::{BadInput, Result};
use crate::files;
use crate::record::csv_write::is_formula;

/// How a table is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Comma-separated, with a header row.
    Csv,
    /// Parquet, one row group.
    Parquet,
}

impl Layout {
    /// By a file's extension.
    ///
    /// # Errors
    /// Any other than `.csv` and `.parquet`.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match extension.as_deref() {
            Some("csv") => Ok(Self::Csv),
            Some("parquet") => Ok(Self::Parquet),
            _ => Err(BadInput::new("another extension", "TABLE.parquet or TABLE.csv")
                .in_file(path)
                .at("--out")
                .remedy("Name the table with one of these extensions")),
        }
    }
}

/// A table.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The command whose answers it holds.
    pub command: String,
    /// The rows, by their index.
    pub rows: Vec<Row>,
}

/// What a table cannot be read for.
fn bad(path: &Path, place: impl Into<String>, found: impl Into<String>, expected: impl Into<String>) -> BadInput {
    BadInput::new(found, expected).in_file(path).at(place).remedy("Name a table that `whirl batch` wrote")
}

impl Table {
    /// Of rows in any order.
    pub fn new(command: &str, mut rows: Vec<Row>) -> Self {
        rows.sort_by_key(|row| row.integer_of("index"));
        Self { command: command.to_owned(), rows }
    }

    /// The file's bytes.
    ///
    /// # Errors
    /// None in practice: writing into memory cannot fail; a library's error is passed on.
    pub fn bytes(&self, layout: Layout) -> Result<Vec<u8>> {
        let columns = columns(&self.command, &self.rows);
        match layout {
            Layout::Csv => self.csv(&columns),
            Layout::Parquet => parquet::write(&self.command, &columns, &self.rows)
                .map_err(|e| BadInput::new(format!("the table cannot be written: {e}"), "")),
        }
    }

    fn csv(&self, columns: &[String]) -> Result<Vec<u8>> {
        let failed = |e: csv::Error| BadInput::new(format!("the table cannot be written: {e}"), "");
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(columns).map_err(failed)?;
        for row in &self.rows {
            let cells = columns.iter().map(|name| row.get(name).map_or_else(String::new, guarded));
            writer.write_record(cells).map_err(failed)?;
        }
        writer.into_inner().map_err(|e| BadInput::new(format!("the table cannot be written: {e}"), ""))
    }

    /// Reads one that [`Table::bytes`] wrote.
    ///
    /// # Errors
    /// Any other file; one of a later format; a cell that is not of its column's kind.
    pub fn read(path: &Path) -> Result<Self> {
        let mut file = files::open(path, "a table", "Name a table that `whirl batch` wrote")?;
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut file, &mut bytes).map_err(|e| BadInput::io(path, &e))?;
        let (columns, rows) = if bytes.starts_with(b"PAR1") {
            parquet::read(bytes).map_err(|e| bad(path, "Parquet", e.to_string(), "a whole table of `whirl batch`"))?
        } else {
            from_csv(path, &bytes)?
        };
        let command =
            command_of(&columns).ok_or_else(|| bad(path, "columns", "other columns", "those of `whirl batch`"))?;
        for row in &rows {
            let place = || format!("row of {}", row.text_of("file"));
            if row.integer_of("format") != i64::from(FORMAT) {
                let found = format!("format {}", row.integer_of("format"));
                return Err(bad(path, place(), found, format!("format {FORMAT}")));
            }
            if row.text_of("command") != command {
                return Err(bad(path, place(), format!("the command \"{}\"", row.text_of("command")), command));
            }
        }
        Ok(Self::new(command, rows))
    }

    /// Whether a file is one.
    pub fn is_at(path: &Path) -> bool {
        Self::read(path).is_ok()
    }
}

/// A cell of a CSV: a text behind an apostrophe where a spreadsheet would take it for a formula.
fn guarded(cell: &Cell) -> String {
    match cell {
        Cell::Text(text) if is_formula(text.trim_start_matches('\'')) => format!("'{text}"),
        other => other.written(),
    }
}

/// What stood there.
fn unguarded(kind: Kind, text: &str) -> &str {
    text.strip_prefix('\'').filter(|t| kind == Kind::Text && is_formula(t.trim_start_matches('\''))).unwrap_or(text)
}

fn from_csv(path: &Path, bytes: &[u8]) -> Result<(Vec<String>, Vec<Row>)> {
    let failed = |e: csv::Error| bad(path, "CSV", e.to_string(), "a table of `whirl batch`");
    let mut reader = csv::Reader::from_reader(bytes);
    let names: Vec<String> = reader.headers().map_err(failed)?.iter().map(str::to_owned).collect();
    let mut rows = Vec::new();
    for (i, record) in reader.records().enumerate() {
        let record = record.map_err(failed)?;
        let mut row = Row::default();
        for (name, text) in names.iter().zip(&record).filter(|(_, text)| !text.is_empty()) {
            let kind = kind(name);
            let cell = Cell::read(kind, unguarded(kind, text)).ok_or_else(|| {
                let wanted = format!("a {}", format!("{kind:?}").to_lowercase());
                bad(path, format!("row {}, column {name}", i + 1), format!("\"{text}\""), wanted)
            })?;
            row.set(name, cell);
        }
        rows.push(row);
    }
    Ok((names, rows))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Rows of a run of four records, of which one failed.
    pub fn rows() -> Vec<Row> {
        (1..=4)
            .map(|i| {
                let mut row = Row::default();
                row.integer("format", 1);
                row.text("command", "identify");
                row.text("run", "0123456789abcdef");
                row.integer("index", i);
                row.integer("of", 4);
                row.text("file", ["r, \"1\".csv", "=2.csv", "'=3.csv", "-4.csv"][i as usize - 1].to_owned());
                if i == 2 {
                    row.integer("exit_status", 2);
                    row.text("error", "found an empty file, expected\na record");
                } else {
                    row.integer("exit_status", 0);
                    row.number("seconds", 24.002);
                    row.number(if i == 4 { "C2" } else { "B11" }, 1.0 / f64::from(i));
                    row.number("B11_std_error", 1e-9);
                }
                row
            })
            .collect()
    }

    #[test]
    fn what_is_read_gives_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        for (layout, name) in [(Layout::Csv, "t.csv"), (Layout::Parquet, "t.parquet")] {
            for rows in [rows(), rows().into_iter().rev().collect(), Vec::new()] {
                let table = Table::new("identify", rows);
                let (path, bytes) = (folder.path().join(name), table.bytes(layout).unwrap());
                std::fs::write(&path, &bytes).unwrap();
                let again = Table::read(&path).unwrap();
                assert_eq!(again.command, "identify");
                assert_eq!(again.bytes(layout).unwrap(), bytes, "{name}");
                assert_eq!(again.rows.len(), table.rows.len());
                let files = |t: &Table| t.rows.iter().map(|r| r.text_of("file").to_owned()).collect::<Vec<_>>();
                assert_eq!(files(&again), files(&table));
                let formula = |cell: &str| ["\n=", ",=", ",-4.csv", "\"="].iter().any(|s| cell.contains(s));
                assert!(layout != Layout::Csv || !formula(&String::from_utf8(bytes).unwrap()));
                assert_eq!(Layout::of(&path).unwrap(), layout);
            }
        }
        assert!(Layout::of(Path::new("table.xlsx")).unwrap_err().to_string().contains("--out"));
    }

    #[test]
    fn other_files_are_no_tables() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        let whole = String::from_utf8(Table::new("identify", rows()).bytes(Layout::Csv).unwrap()).unwrap();
        for (text, told) in [
            ("t,x\n0,1\n".to_owned(), "other columns"),
            (whole.replace("24.002", "long"), "row 1, column seconds: found \"long\", expected a number"),
            (whole.replace("\n1,identify", "\n2,identify"), "found format 2, expected format 1"),
            (whole.replace(",identify,", ",explain,"), "the command \"explain\""),
            ("PAR1".to_owned(), "Parquet"),
        ] {
            std::fs::write(&path, text).unwrap();
            let error = Table::read(&path).unwrap_err().to_string();
            assert!(error.contains(told) && !Table::is_at(&path), "{error}");
        }
    }
}
