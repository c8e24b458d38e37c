//! A line for each record that is done, where nobody sees a bar.

use std::sync::{Mutex, PoisonError};

use crate::batch::row::Row;
use crate::cli::progress;

/// The lines of a batch.
pub struct Told {
    of: usize,
    /// How many records are done, and lines that are held back: while every record failed for an
    /// option, which is told once if none does better.
    state: Mutex<(usize, Vec<String>)>,
    write: Box<dyn Fn(&str) + Send + Sync>,
}

impl Told {
    /// Of so many records; of nothing where lines are not wanted.
    pub fn of(records: usize) -> Self {
        let wanted = progress::wants_lines();
        Self::with(
            records,
            Box::new(move |line| {
                if wanted {
                    progress::line(line)
                }
            }),
        )
    }

    fn with(of: usize, write: Box<dyn Fn(&str) + Send + Sync>) -> Self {
        Self { of, state: Mutex::new((0, Vec::new())), write }
    }

    /// A record is done.
    pub fn done(&self, file: &str, row: &Row) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let (done, held) = &mut *state;
        *done += 1;
        held.push(line(row, file, *done, self.of));
        let is_first = held.len() == *done;
        if !(is_first && is_of_option(row)) {
            held.drain(..).for_each(|line| (self.write)(&line));
        }
    }

    /// All are done, and their rows stand.
    pub fn end(&self) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.1.drain(..).for_each(|line| (self.write)(&line));
    }
}

/// Whether a record has no answer for an option's sake.
pub fn is_of_option(row: &Row) -> bool {
    row.integer_of("exit_status") == 2 && row.text_of("error").starts_with("--")
}

/// Which record, and its verdict or what went wrong.
fn line(row: &Row, file: &str, done: usize, of: usize) -> String {
    let error = row.text_of("error").split_whitespace().collect::<Vec<_>>().join(" ");
    // A message names the file itself.
    let error = error.strip_prefix(&format!("{file}: ")).unwrap_or(&error);
    let why = if error.is_empty() { String::new() } else { format!(": {error}") };
    format!("{done} of {of}: {file}: {}{why}", row.text_of("verdict"))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    /// The lines of rows, as exit status, verdict and error.
    fn lines(rows: &[(usize, &str, &str)], end: bool) -> Vec<String> {
        let out = Arc::new(Mutex::new(Vec::new()));
        let into = Arc::clone(&out);
        let told = Told::with(rows.len(), Box::new(move |line| into.lock().unwrap().push(line.to_owned())));
        for (k, (status, verdict, error)) in rows.iter().enumerate() {
            let mut row = Row::default();
            row.integer("exit_status", *status);
            row.text("verdict", *verdict);
            row.text("error", *error);
            told.done(&format!("a/r{}.csv", k + 1), &row);
        }
        if end {
            told.end();
        }
        let lines = out.lock().unwrap();
        lines.clone()
    }

    #[test]
    fn each_record_has_a_line_with_its_verdict_or_what_went_wrong() {
        let rows = [(0, "identified", ""), (2, "error", "a/r2.csv: row 7: found 2 values,\nexpected 3")];
        let told = ["1 of 2: a/r1.csv: identified", "2 of 2: a/r2.csv: error: row 7: found 2 values, expected 3"];
        assert_eq!(lines(&rows, true), told);
    }

    #[test]
    fn an_option_that_every_record_fails_for_is_not_told_for_each() {
        let fails = (2, "error", "--from: found 30 s, expected less");
        assert!(lines(&[fails, fails], false).is_empty());
        assert_eq!(lines(&[fails, fails], true).len(), 2);
        // Where another record has an answer, all of them are told, in their order.
        let told = lines(&[fails, (0, "identified", ""), fails], false);
        assert!(told.len() == 3 && told[0].starts_with("1 of 3: a/r1.csv: error: --from"), "{told:?}");
    }
}
