//! Rows as they stand in a file, checked cell by cell, before they are cut into segments.
//!
//! Every reader hands its cells to [`Rows`], so that a NaN, an infinite value, a count beyond its
//! type or a time that runs backwards is told in the same words whatever the format.

use std::path::Path;

use super::Column;
use super::damage::Damage;
use super::unwrap::turn;
use crate::error::{BadInput, Result};
use crate::rig::computed::{self, Sources};
use crate::rig::{Channel, Rig};
use crate::wording::close::closest;
use crate::wording::format::shortest;

/// Most rows that are read from one file: a bound on memory, 4.6 days at 500 Hz.
pub(super) const ROW_LIMIT: usize = 200_000_000;

/// Most rows for which room is made before they are there.
const RESERVED: usize = 1 << 22;

/// What to do with a time that is not later than the one before, and with one that is the same.
const SORT: &str = "Sort the rows by time, or split the file where its clock was set back";
const TWICE: &str = "Write the times with more digits; of samples that came evenly and were stamped in lots, \
    write the number of the row over their rate; remove a row that is there twice";

/// A checked cell of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cell {
    /// An encoder count.
    Count(i32),
    /// A value in the channel's unit.
    Value(f64),
    /// Nothing, or not a number: the row is a gap.
    Missing,
}

/// What the device itself recorded beside the counts.
#[derive(Clone, Debug, Default)]
pub(super) struct DeviceColumns {
    pub(super) tick: Vec<i64>,
    pub(super) phase: Vec<u32>,
    pub(super) amplitude_nm: Vec<u32>,
}

/// Rows in file order.
pub(super) struct Rows<'a> {
    pub(super) path: &'a Path,
    pub(super) rig: &'a Rig,
    /// The columns that are read, and what becomes of them.
    pub(super) sources: Sources,
    /// "line" or "row": what `place` counts.
    pub(super) word: &'static str,
    pub(super) t: Vec<f64>,
    /// One for each column that is read; a missing cell is 0 or NaN.
    pub(super) columns: Vec<Column>,
    /// Rows with a missing cell, for each column, increasing.
    pub(super) missing: Vec<Vec<usize>>,
    /// Place and column of the first missing cell.
    pub(super) first_missing: Option<(u64, usize)>,
    /// Ticks, phases and amplitudes of a record of whirl's own.
    pub(super) device: Option<DeviceColumns>,
    /// First timestamp of a column of timestamps, from which they count.
    pub(super) time_origin: Option<i64>,
    /// Units of the time in a second.
    pub(super) per_second: f64,
    /// The column of the time, for messages.
    pub(super) time_name: String,
    /// Whether an uneven clock is to be made even.
    pub(super) resample: bool,
    /// Rows that stand before those that are here: taken already, block by block, or damaged.
    pub(super) passed: usize,
    /// Rows of the file that are damaged.
    pub(super) damage: Damage,
    /// Most rows that may come.
    pub(super) limit: usize,
    /// From which row on places are numbered so: (row, its place); rows between follow one by one.
    pub(super) places: Vec<(usize, u64)>,
    last_place: u64,
}

impl<'a> Rows<'a> {
    pub(super) fn new(path: &'a Path, rig: &'a Rig, word: &'static str, own: bool) -> Self {
        let column = |c: &Channel| if c.unit == "count" { Column::Counts(vec![]) } else { Column::Values(vec![]) };
        let sources = sources(rig);
        Self {
            path,
            rig,
            word,
            t: vec![],
            columns: sources.columns.iter().map(column).collect(),
            missing: vec![vec![]; sources.columns.len()],
            sources,
            first_missing: None,
            device: own.then(DeviceColumns::default),
            time_origin: None,
            per_second: 1.0,
            time_name: "t".to_owned(),
            resample: false,
            passed: 0,
            damage: Damage::default(),
            limit: ROW_LIMIT,
            places: vec![],
            last_place: 0,
        }
    }

    /// Makes room for so many rows more, as far as a file may be believed that says how many it
    /// has.
    pub(super) fn reserve(&mut self, rows: usize) {
        let rows = rows.min(RESERVED);
        self.t.reserve(rows);
        for column in &mut self.columns {
            match column {
                Column::Counts(c) => c.reserve(rows),
                Column::Values(v) => v.reserve(rows),
            }
        }
        if let Some(d) = &mut self.device {
            d.tick.reserve(rows);
            d.phase.reserve(rows);
            d.amplitude_nm.reserve(rows);
        }
    }

    /// An error in this file.
    pub(super) fn bad(&self, place: u64, column: &str, found: String, expected: &str) -> BadInput {
        BadInput::new(found, expected).in_file(self.path).at(format!("{} {place}, column {column}", self.word))
    }

    /// The last whole row, for messages.
    pub(super) fn last_whole(&self) -> String {
        match self.t.last() {
            Some(t) => format!("the last whole row is {} {} (t = {t} s)", self.word, self.last_place),
            None => "no row is whole".to_owned(),
        }
    }

    /// Drops all rows from row `n` on, whole or not.
    pub(super) fn truncate(&mut self, n: usize) {
        self.t.truncate(n);
        for column in &mut self.columns {
            match column {
                Column::Counts(c) => c.truncate(n),
                Column::Values(v) => v.truncate(n),
            }
        }
        for missing in &mut self.missing {
            missing.retain(|&row| row < n);
        }
        if self.first_missing.is_some_and(|(place, _)| place > (self.passed + n) as u64) {
            self.first_missing = None;
        }
        if let Some(d) = &mut self.device {
            d.tick.truncate(n);
            d.phase.truncate(n);
            d.amplitude_nm.truncate(n);
        }
        self.last_place = (self.passed + n) as u64;
    }

    /// Passes over damaged rows of row group `group` (from 1): how many, where that is known.
    pub(super) fn lose(&mut self, count: Option<usize>, group: usize, why: &str) {
        let first = (self.passed + self.t.len() + 1) as u64;
        let lost = self.damage.lose(first, count.map(|n| n as u64), group, self.t.last().copied(), why);
        // Far beyond every file, far below an overflow.
        self.passed = (self.passed + lost).min(1 << 60);
        if self.t.is_empty() {
            self.time_origin = None;
        }
    }

    /// Rows are whole again, from index `from` on.
    pub(super) fn resume(&mut self, from: usize) {
        if let Some(t) = self.t.get(from) {
            self.damage.resume(*t);
        }
    }

    /// Lets all rows but the last go; it stays, so that the next ones are compared with it.
    pub(super) fn keep_last(&mut self) {
        let gone = self.t.len().saturating_sub(1);
        self.t.drain(..gone);
        for column in &mut self.columns {
            match column {
                Column::Counts(c) => drop(c.drain(..gone)),
                Column::Values(v) => drop(v.drain(..gone)),
            }
        }
        for missing in &mut self.missing {
            missing.retain(|&row| row >= gone);
            missing.iter_mut().for_each(|row| *row -= gone);
        }
        if let Some(d) = &mut self.device {
            d.tick.drain(..gone);
            d.phase.drain(..gone);
            d.amplitude_nm.drain(..gone);
        }
        self.passed += gone;
    }

    /// Checks a time against the one before it.
    pub(super) fn check_time(&self, place: u64, t: f64) -> Result<()> {
        let name = self.time_name.as_str();
        if t.is_nan() {
            return Err(self
                .bad(place, name, "NaN".to_owned(), "a time in seconds")
                .remedy("A time cannot be missing: leave the row out (that is a gap) or mend it"));
        }
        if t.is_infinite() {
            return Err(self.bad(place, name, t.to_string(), "a finite time in seconds").remedy("Mend this row"));
        }
        if let Some(&before) = self.t.last()
            && t <= before
        {
            // As few digits as tell them apart.
            let (short, short_before) = (shortest(t), shortest(before));
            let found = if t == before {
                format!("{t} a second time")
            } else if short == short_before {
                format!("{t} after {before}")
            } else {
                format!("{short} after {short_before}")
            };
            let remedy = if t == before { TWICE } else { SORT };
            return Err(self.bad(place, name, found, "a time later than the row before").remedy(remedy));
        }
        if self.t.len() >= self.limit {
            return Err(self
                .bad(place, name, format!("more than {} rows", self.limit), "a record that fits into memory")
                .remedy("Split the file"));
        }
        Ok(())
    }

    /// Takes a time that has been checked.
    pub(super) fn push_time(&mut self, place: u64, t: f64) {
        if place != self.last_place + 1 || self.places.is_empty() {
            self.places.push((self.t.len(), place));
        }
        self.t.push(t);
        self.last_place = place;
    }

    /// Takes times that have been checked, the last of them at `place`.
    pub(super) fn push_times(&mut self, place: u64, t: &[f64]) {
        self.t.extend_from_slice(t);
        self.last_place = place;
    }

    /// Checks a number for channel `channel`.
    pub(super) fn check_number(&self, place: u64, channel: usize, value: f64) -> Result<Cell> {
        let c = &self.sources.columns[channel];
        if value.is_nan() {
            return Ok(Cell::Missing);
        }
        if value.is_infinite() {
            return Err(self
                .bad(place, &c.name, value.to_string(), &format!("a finite value in {}", c.unit))
                .remedy("Mend the cell, or leave it empty (that is a gap)"));
        }
        match self.columns[channel] {
            Column::Values(_) if is_no_angle(c, value) => Err(self.no_angle(place, channel, value)),
            Column::Values(_) => Ok(Cell::Value(value)),
            Column::Counts(_) if value.fract() != 0.0 => Err(self
                .bad(place, &c.name, value.to_string(), "a whole number of counts")
                .remedy("If the column holds an angle, set the channel's unit to \"rad\" or \"deg\" in the rig file")),
            Column::Counts(_) if value < f64::from(i32::MIN) || value > f64::from(i32::MAX) => {
                Err(self.beyond(place, channel, value.to_string()))
            }
            // In range and whole: the cast is exact.
            Column::Counts(_) => Ok(Cell::Count(value as i32)),
        }
    }

    /// Checks a whole number for channel `channel`.
    pub(super) fn check_integer(&self, place: u64, channel: usize, value: i64) -> Result<Cell> {
        match self.columns[channel] {
            Column::Values(_) if is_no_angle(&self.sources.columns[channel], value as f64) => {
                Err(self.no_angle(place, channel, value as f64))
            }
            Column::Values(_) => Ok(Cell::Value(value as f64)),
            Column::Counts(_) => match i32::try_from(value) {
                Ok(count) => Ok(Cell::Count(count)),
                Err(_) => Err(self.beyond(place, channel, value.to_string())),
            },
        }
    }

    /// The error for a value that no angle can have.
    fn no_angle(&self, place: u64, channel: usize, value: f64) -> BadInput {
        let c = &self.sources.columns[channel];
        self.bad(place, &c.name, format!("{value:e}"), &format!("an angle in {}", c.unit))
            .remedy("So large a number holds no part of a turn: mend the cell, or leave it empty (that is a gap)")
    }

    /// The error for a count beyond its type.
    pub(super) fn beyond(&self, place: u64, channel: usize, found: String) -> BadInput {
        let name = &self.sources.columns[channel].name;
        self.bad(place, name, found, "a count within 32 bits, −2147483648 to 2147483647")
            .remedy("Mend the cell; a counter that overflowed must be unwrapped before it is recorded")
    }

    /// Takes a checked cell.
    pub(super) fn push_cell(&mut self, place: u64, channel: usize, cell: Cell) {
        let row = self.columns[channel].len();
        if cell == Cell::Missing {
            self.missing[channel].push(row);
            if self.first_missing.is_none_or(|(first, _)| place < first) {
                self.first_missing = Some((place, channel));
            }
        }
        match (&mut self.columns[channel], cell) {
            (Column::Counts(c), Cell::Count(v)) => c.push(v),
            (Column::Counts(c), _) => c.push(0),
            (Column::Values(c), Cell::Value(v)) => c.push(v),
            (Column::Values(c), _) => c.push(f64::NAN),
        }
    }
}

/// Whether a value of an angle is so large that binary64 no longer tells a thousandth of a turn: it
/// is no angle that anything has measured, and would be taken for one that wraps.
fn is_no_angle(channel: &Channel, value: f64) -> bool {
    turn(channel).is_some_and(|turn| value.abs() * f64::EPSILON > turn / 1000.0)
}

/// The columns that are read for a rig. Its expressions were checked when it was read; one that was
/// not is looked for as a column.
pub(super) fn sources(rig: &Rig) -> Sources {
    computed::sources(&rig.channel, &rig.path).unwrap_or_else(|_| Sources {
        columns: rig.channel.clone(),
        channels: (0..rig.channel.len()).map(computed::From::Column).collect(),
    })
}

/// The error for a column that a file does not have: lists those it has, and the closest as the
/// remedy, unless it is one of those that are used already.
pub(super) fn missing_column(path: &Path, wanted: &str, header: &[String], used: &[&str]) -> BadInput {
    let list: Vec<String> = header.iter().take(40).map(|h| super::formats::shown(h.as_bytes())).collect();
    let more = if header.len() > 40 { format!(" and {} more", header.len() - 40) } else { String::new() };
    let times = |h: &str| header.iter().take(1000).filter(|o| *o == h).count();
    // A name that two columns have cannot be chosen.
    let free = header.iter().take(1000).map(String::as_str).filter(|h| !used.contains(h) && times(h) == 1);
    let close = closest(wanted, free);
    let remedy = match (wanted, close) {
        ("t", Some(h)) if !is_numbered(header) => {
            format!("If the column {h} holds the time, say --time \"{h}\", or time = \"{h}\" in the rig file")
        }
        ("t", _) if is_numbered(header) => {
            "The file has no header row that names its columns: say --time c1 (or time = \"c1\" in the rig file) where the first holds the time, or add a row such as t,count1,count2".to_owned()
        }
        ("t", _) => "Say which one is the time: --time COLUMN, or time = \"COLUMN\" in the rig file; or add a column t in seconds".to_owned(),
        (_, Some(h)) => format!("Did you mean {h}? Set it as the channel's name in the rig file, or say --map MEASURE=COLUMN"),
        (_, None) => match header.iter().take(40).find(|h| !h.is_empty() && times(h) > 1) {
            Some(h) => format!("{} columns are called {h}: give each a name of its own in the header", times(h)),
            None => "Set the channel's name in the rig file to one of these columns, or say --map MEASURE=COLUMN".to_owned(),
        },
    };
    BadInput::new(format!("the columns {}{more}", list.join(", ")), format!("a column {wanted}"))
        .in_file(path)
        .at("header")
        .remedy(remedy)
}

/// Whether the columns have no names, but are c1, c2, ….
pub(super) fn is_numbered(header: &[String]) -> bool {
    header.iter().enumerate().all(|(i, h)| *h == format!("c{}", i + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_resolves_no_part_of_a_turn_is_no_angle() {
        let (rad, deg, metre) = (Channel::new("a", "rad"), Channel::new("a", "deg"), Channel::new("a", "m"));
        assert!(is_no_angle(&rad, 1e30) && is_no_angle(&rad, -1e308) && is_no_angle(&deg, 1e30));
        assert!(!is_no_angle(&rad, 1e13) && !is_no_angle(&deg, -1e15) && !is_no_angle(&metre, 1e30));
    }

    #[test]
    fn the_closest_column_is_proposed() {
        let header = ["t".to_owned(), "cuont1".to_owned(), "speed".to_owned()];
        let e = missing_column(Path::new("x.csv"), "count1", &header, &[]).to_string();
        assert!(e.contains("\"t\", \"cuont1\", \"speed\"") && e.contains("Did you mean cuont1?"), "{e}");
        // One that another channel is read from is not meant.
        let header = ["t", "winkel1", "count2"].map(str::to_owned);
        let e = missing_column(Path::new("x.csv"), "count1", &header, &["count1", "count2"]).to_string();
        assert!(!e.contains("Did you mean") && e.contains("--map MEASURE=COLUMN"), "{e}");
    }
}
