//! What a batch says: a few lines, JSON, a report.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use serde::Serialize;

use crate::batch::row::{Cell, Row};
use crate::batch::table::Table;
use crate::cli::Answer;
use crate::cli::output::Output;
use crate::error::Result;
use crate::report::html::{Align, Html};
use crate::report::{Report, Section};
use crate::warning::Warning;
use crate::wording::format::{Z95, duration, plus_minus, significant};

/// Records that are told of one by one in the terminal.
const MOST: usize = 10;
/// Parameters that the report shows.
const MOST_PARAMETERS: usize = 20;

/// Verdict of an identification that can stand.
const IDENTIFIED: &str = "identified";
/// Warnings that say that its equations miss something.
const MISSING: [&str; 2] = ["model-misses-something", "more-than-noise"];

/// A record whose answer is negative, or that has none.
#[derive(Debug, Serialize)]
struct Unanswered {
    index: i64,
    file: String,
    exit_status: i64,
    verdict: String,
    error: String,
}

/// What is in a table.
#[derive(Debug, Serialize)]
pub struct Summary<'a> {
    command: &'a str,
    run: String,
    table: String,
    /// Records of the batch.
    records: usize,
    /// Rows of this table.
    rows: usize,
    /// Rows of each verdict.
    verdicts: BTreeMap<String, usize>,
    /// Rows whose exit status is not 0.
    negative: Vec<Unanswered>,
    warnings: Vec<Warning>,
    #[serde(skip)]
    of: &'a Table,
}

impl<'a> Summary<'a> {
    /// Of a table that was written, of a batch of so many records.
    pub fn of(table: &'a Table, path: &Path, records: usize) -> Self {
        let mut verdicts = BTreeMap::new();
        for row in &table.rows {
            *verdicts.entry(row.text_of("verdict").to_owned()).or_insert(0) += 1;
        }
        let negative = table.rows.iter().filter(|row| row.integer_of("exit_status") != 0).map(|row| Unanswered {
            index: row.integer_of("index"),
            file: row.text_of("file").to_owned(),
            exit_status: row.integer_of("exit_status"),
            verdict: row.text_of("verdict").to_owned(),
            error: row.text_of("error").to_owned(),
        });
        Self {
            command: &table.command,
            run: table.rows.first().map_or_else(String::new, |row| row.text_of("run").to_owned()),
            table: path.display().to_string(),
            records,
            rows: table.rows.len(),
            verdicts,
            negative: negative.collect(),
            warnings: Vec::new(),
            of: table,
        }
    }

    /// Says and writes it; negative where some row's exit status is not 0.
    pub fn give(&self, out: &Output) -> Result<Answer> {
        if let Some(path) = &out.report {
            self.page().write(path)?;
        }
        out.write_json(self)?;
        out.say(&self.text());
        Ok(if self.negative.is_empty() { Answer::Positive } else { Answer::Negative })
    }

    fn text(&self) -> String {
        // Other verdicts say what records are, and have no plural.
        let share = |(verdict, n): (&String, &usize)| {
            format!("{n} {verdict}{}", if verdict == "error" && *n > 1 { "s" } else { "" })
        };
        let mut shares: Vec<String> = self.verdicts.iter().map(share).collect();
        let standing = self.verdicts.get(IDENTIFIED).copied().unwrap_or(0);
        if let Some(place) = self.verdicts.keys().position(|v| v == IDENTIFIED).filter(|_| self.missing() > 0) {
            let missing = self.missing();
            shares[place] = format!(
                "{standing} {IDENTIFIED} ({} whose equations describe the record, {missing} whose equations miss something: \
                 `whirl batch explain` says what)",
                standing - missing
            );
        }
        let (s, of) = (
            if self.rows == 1 { "" } else { "s" },
            if self.rows == self.records { String::new() } else { format!(" of {}", self.records) },
        );
        let mut text = format!("{} record{s}{of} in {}: {}\n", self.rows, self.table, shares.join(", "));
        for u in self.negative.iter().take(MOST) {
            let why = if u.error.is_empty() { &u.verdict } else { &u.error };
            // Writing into a string cannot fail. A message names its file as a rule.
            let _ = match why.starts_with(&u.file) {
                true => writeln!(text, "  {why}"),
                false => writeln!(text, "  {}: {why}", u.file),
            };
        }
        if self.negative.len() > MOST {
            let _ = writeln!(text, "  and {} more: those whose exit_status is not 0", self.negative.len() - MOST);
        }
        text
    }

    /// Rows that are identified by equations that miss something, as their warnings say.
    fn missing(&self) -> usize {
        let misses = |row: &&Row| row.text_of("warnings").split('+').any(|w| MISSING.contains(&w));
        self.of.rows.iter().filter(|row| row.text_of("verdict") == IDENTIFIED).filter(misses).count()
    }

    fn page(&self) -> Report {
        let mut report = Report::new(format!("Batch: {}", self.command), self.table.clone());
        report.fact("Records", self.records.to_string()).fact("Rows", self.rows.to_string()).fact("Run", &self.run);
        let left = |t: &str| (Html::text(t), Align::Left);
        let right = |t: &str| (Html::text(t), Align::Right);
        let names = parameters(&self.of.rows);
        let mut heads = vec![right("number"), left("record"), right("length"), left("verdict"), left("what")];
        heads.extend(names.iter().map(|name| (Html::symbol(name), Align::Right)));
        let rows: Vec<Vec<Html>> = self.of.rows.iter().map(|row| line(row, &names)).collect();
        let mut body = Html::new();
        body.table(&heads, &rows).paragraph("± is 1.96 standard errors (95 %). All columns are in the table.");
        report.push(Section { id: "records".to_owned(), title: "Records".to_owned(), body });
        report
    }
}

/// Names of the first parameters.
fn parameters(rows: &[Row]) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for pair in rows.iter().flat_map(|row| row.text_of("units").split("; ")) {
        let name = pair.split(' ').next().unwrap_or_default();
        if !name.is_empty() && out.len() < MOST_PARAMETERS && !out.iter().any(|n| n == name) {
            out.push(name.to_owned());
        }
    }
    out
}

/// A record's line of the report.
fn line(row: &Row, names: &[String]) -> Vec<Html> {
    let number = |column: &str| if let Some(Cell::Number(x)) = row.get(column) { Some(*x) } else { None };
    let what = ["error", "effects", "checks_failed", "groups_not_separable"].map(|column| row.text_of(column));
    let mut out = vec![
        Html::text(&row.integer_of("index").to_string()),
        Html::text(row.text_of("file")),
        Html::text(&number("seconds").map_or_else(String::new, duration)),
        Html::text(row.text_of("verdict")),
        Html::text(what.iter().find(|text| !text.is_empty()).unwrap_or(&"")),
    ];
    out.extend(names.iter().map(|name| {
        Html::text(&match (number(name), number(&format!("{name}_std_error"))) {
            (Some(value), Some(error)) => plus_minus(value, Z95 * error),
            (Some(value), None) => significant(value, 6),
            _ => String::new(),
        })
    }));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(verdict: &str, status: i64, warnings: &str) -> Row {
        let mut row = Row::default();
        row.text("verdict", verdict);
        row.integer("exit_status", status);
        row.text("warnings", warnings);
        row
    }

    #[test]
    fn identifications_that_miss_something_are_counted_by_themselves() {
        let told = |rows: Vec<Row>| {
            let n = rows.len();
            Summary::of(&Table::new("identify", rows), Path::new("t.csv"), n).text()
        };
        let good = || row(IDENTIFIED, 0, "nan-is-gap");
        let misses = || row(IDENTIFIED, 0, "nan-is-gap+model-misses-something");
        assert!(told(vec![good(), good()]).starts_with("2 records in t.csv: 2 identified\n"));
        let text = told(vec![good(), misses(), misses(), row("error", 2, "")]);
        assert!(
            text.contains("4 records in t.csv: 1 error, 3 identified (1 whose equations describe the record, 2 whose"),
            "{text}"
        );
    }
}
