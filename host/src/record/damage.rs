//! Rows that stand in a file but cannot be read from it: which ones, between which times, and why.
//!
//! Such a stretch is a gap like any other, and its rows count as missing ([`Losses::damaged`]).

use serde_json::{Map, Value, json};

use super::Losses;
use crate::warning::Warning;

/// Stretches named in the text, and in the details.
const NAMED: usize = 4;
const LISTED: usize = 100;
/// Most rows of one stretch that are believed of a file that says how many it has.
const MOST: u64 = super::rows::ROW_LIMIT as u64;

/// One stretch of rows that are lost.
#[derive(Clone, Debug, PartialEq)]
struct Stretch {
    /// Its first row, from 1.
    first: u64,
    /// How many rows; none where the file does not say.
    rows: Option<u64>,
    /// Row group that it begins in, from 1.
    group: usize,
    /// Times of the rows before and behind it, s; none at the ends of the file.
    after_s: Option<f64>,
    before_s: Option<f64>,
    why: String,
}

/// The stretches of a file, in its order.
#[derive(Clone, Debug, Default)]
pub(super) struct Damage {
    stretches: Vec<Stretch>,
    /// Whether the rows before were the last stretch's.
    open: bool,
}

impl Damage {
    /// Rows are lost: `first` (from 1) is the first of them, `after_s` the time of the row before.
    /// Gives how many are believed.
    pub(super) fn lose(
        &mut self,
        first: u64,
        rows: Option<u64>,
        group: usize,
        after_s: Option<f64>,
        why: &str,
    ) -> usize {
        let rows = rows.map(|n| n.min(MOST));
        match self.stretches.last_mut().filter(|_| self.open) {
            Some(last) => last.rows = last.rows.zip(rows).map(|(a, b)| a.saturating_add(b)),
            None => {
                self.stretches.push(Stretch { first, rows, group, after_s, before_s: None, why: why.to_owned() });
                self.open = true;
            }
        }
        rows.unwrap_or(0) as usize
    }

    /// A row is whole again, at this time.
    pub(super) fn resume(&mut self, t: f64) {
        if let Some(last) = self.stretches.last_mut().filter(|_| self.open) {
            last.before_s = Some(t);
        }
        self.open = false;
    }

    /// What the first stretch suffers from.
    pub(super) fn reason(&self) -> Option<String> {
        self.stretches.first().map(|s| format!("row group {}: {}", s.group, s.why))
    }

    /// Counts the lost rows. `stored`: the losses are those that the record brought, which know
    /// nothing of this damage; otherwise the gaps that the rows left are counted already.
    pub(super) fn count(&self, losses: &mut Losses, stored: bool) {
        for s in &self.stretches {
            let rows = s.rows.unwrap_or(0);
            losses.damaged = losses.damaged.saturating_add(rows);
            if s.after_s.is_some() && s.before_s.is_some() {
                if stored {
                    losses.gaps += 1;
                } else {
                    losses.lost_on_link = losses.lost_on_link.saturating_sub(rows);
                }
            }
        }
    }

    /// Says which rows are lost.
    pub(super) fn warning(&self) -> Option<Warning> {
        let n = self.stretches.len();
        if n == 0 {
            return None;
        }
        let named: Vec<String> = self.stretches.iter().take(NAMED).map(Stretch::text).collect();
        let more = if n > NAMED { format!("; and {} more", n - NAMED) } else { String::new() };
        let all = self.stretches.iter().filter_map(|s| s.rows).fold(0, u64::saturating_add);
        let listed: Vec<Value> = self.stretches.iter().take(LISTED).map(Stretch::details).collect();
        let places = if n == 1 { "one place".to_owned() } else { format!("{n} places") };
        Some(
            Warning::new(
                "damaged-rows",
                format!("the file is damaged in {places}: {}{more}", named.join("; ")),
                "These rows are a gap and count as missing; the rest is read. Copy the file again if its source still has it",
            )
            .with("rows", all)
            .with("stretches", listed),
        )
    }
}

impl Stretch {
    fn text(&self) -> String {
        let rows = match self.rows {
            Some(1) => format!("row {} ", self.first),
            Some(n) => format!("rows {} to {} ", self.first, self.first.saturating_add(n - 1)),
            None => format!("rows from {} on, how many is not known ", self.first),
        };
        let times = match (self.after_s, self.before_s) {
            (Some(a), Some(b)) => format!("between t = {a} and {b} s"),
            (Some(a), None) => format!("behind t = {a} s"),
            (None, Some(b)) => format!("before t = {b} s"),
            (None, None) => "all".to_owned(),
        };
        format!("{rows}({times}; row group {}: {})", self.group, self.why)
    }

    fn details(&self) -> Value {
        let mut all = Map::new();
        all.insert("first_row".into(), self.first.into());
        all.insert("rows".into(), json!(self.rows));
        all.insert("after_s".into(), json!(self.after_s));
        all.insert("before_s".into(), json!(self.before_s));
        all.insert("row_group".into(), self.group.into());
        all.insert("why".into(), self.why.clone().into());
        Value::Object(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_losses_are_one_stretch_and_are_counted_once() {
        let mut damage = Damage::default();
        assert_eq!(damage.lose(11, Some(10), 2, Some(0.9), "checksum"), 10);
        damage.lose(21, Some(10), 3, Some(0.9), "checksum");
        damage.resume(3.1);
        damage.resume(3.2);
        damage.lose(41, Some(1), 5, Some(4.0), "a page");
        let warning = damage.warning().unwrap();
        assert_eq!(
            warning.text,
            "the file is damaged in 2 places: rows 11 to 30 (between t = 0.9 and 3.1 s; row group 2: checksum); \
             row 41 (behind t = 4 s; row group 5: a page)"
        );
        assert_eq!(warning.details["rows"], json!(21));
        let stretch =
            json!({"first_row": 41, "rows": 1, "after_s": 4.0, "before_s": null, "row_group": 5, "why": "a page"});
        assert_eq!(warning.details["stretches"][1], stretch);
        let mut stored = Losses { lost_on_link: 3, gaps: 1, ..Losses::default() };
        let mut found = Losses { lost_on_link: 24, gaps: 2, ..Losses::default() };
        damage.count(&mut stored, true);
        damage.count(&mut found, false);
        assert_eq!((stored.lost(), stored.gaps, found.lost(), found.gaps), (24, 2, 25, 2));
    }

    #[test]
    fn absurd_numbers_of_rows_are_not_believed() {
        let mut damage = Damage::default();
        for group in 0..3 {
            assert!(damage.lose(1, Some(u64::MAX), group, None, "x") <= 200_000_000);
        }
        assert!(damage.warning().unwrap().text.contains("row group 0"));
    }
}
