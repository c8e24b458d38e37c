//! A record's columns as they stand, before anything is known of them.

use std::path::{Path, PathBuf};

use super::{Settings, Statement};
use crate::error::{BadInput, Result};
use crate::identify::suspects::RATE;
use crate::record::formats::{self, Listed};
use crate::record::names::{self, TimeChoice};
use crate::record::{Column, ReadOptions, Record};
use crate::rig::{RATES, Rig};
use crate::wording::format::{count, shell_word, significant};

/// Columns that whirl's own CSV has beside the channels.
const DEVICE: [&str; 3] = ["tick", "phase", "amplitude_nm"];
/// Share of rows without a value from which a column is left out, so that it does not break the
/// others' stretches.
const SPARSE: f64 = 0.05;
/// Share of the difference from a record's rate at which [`crate::identify::suspects`] tells that
/// the rig file says another, to which a rate is rounded at most: half of it is left to the rest of
/// a record.
const ROUNDED: f64 = 0.5;
/// Rates that a measured pendulum is likely to have, Hz.
const LIKELY: core::ops::RangeInclusive<f64> = 5.0..=50_000.0;
/// Most columns that are tried as the time.
const MOST_TRIED: usize = 40;
/// Greatest rms deviation from an even clock of a column that is taken for the time by its values
/// alone, steps.
const EVEN: f64 = 0.1;

/// Columns as they stand.
pub(super) struct Raw {
    /// The file.
    pub path: PathBuf,
    /// Their samples, in segments.
    pub record: Record,
    /// How the time is to be read.
    pub time: TimeChoice,
    /// Why.
    pub why: Vec<Statement>,
    /// Columns that are not among them, and why.
    pub unused: Vec<Statement>,
}

impl Raw {
    /// The samples of a column, a slice for each stretch.
    pub fn values(&self, column: usize) -> Vec<&[f64]> {
        self.record.segments.iter().filter_map(|s| s.columns.get(column).and_then(of_values)).collect()
    }
}

fn of_values(column: &Column) -> Option<&[f64]> {
    if let Column::Values(v) = column { Some(v) } else { None }
}

fn read_columns(path: &Path, columns: &[String], time: &TimeChoice, settings: &Settings) -> Result<Record> {
    Record::read(path, &Rig::of_columns(columns, time.clone()), &settings.options)
}

/// Reads all columns that are numbers.
pub(super) fn read(path: &Path, settings: &Settings) -> Result<Raw> {
    let mut time = TimeChoice { column: settings.choices.time.clone(), unit: None };
    let listed = formats::columns(path, &time)?;
    let all: Vec<String> = listed.iter().map(|l| l.name.clone()).collect();
    let mut numbers = numbers(&listed);
    let called = names::time_column(&all, &time, path);
    let clock = called.as_ref().ok().map(|t| t.name.clone());
    numbers.retain(|n| Some(n) != clock.as_ref());
    let computed = settings.choices.map.iter().map(|(_, column)| column).filter(|c| c.starts_with('='));
    for column in computed {
        if !numbers.contains(column) {
            numbers.push(column.clone());
        }
    }
    let mut why = Vec::new();
    let mut record = match (read_columns(path, &numbers, &time, settings), &called) {
        (Ok(record), _) => record,
        (Err(e), Err(_)) if settings.choices.time.is_none() => {
            let (found, record) = time_by_values(path, &numbers, settings).ok_or(e)?;
            let called = if all.iter().any(|n| names::is_time(n)) { "more than one column is" } else { "no column is" };
            let text = format!("{called} called a time, and this is the first that increases evenly from row to row");
            why.push(Statement::new(&found, "the time", text).unsure());
            numbers.retain(|n| *n != found);
            time.column = Some(found);
            record
        }
        (Err(e), _) => return Err(e),
    };
    if record.has_own_time() {
        names::own_time(settings.choices.time.as_deref(), path)?;
    }
    let sparse = sparse(path, &numbers, &record, &time, settings);
    if !sparse.is_empty() {
        numbers.retain(|n| !sparse.contains(n));
        record = read_columns(path, &numbers, &time, settings)?;
    }
    // What the head says of the time between rows is in seconds.
    let is_counted = clock.is_none() && time.column.is_none();
    if let Some(name) = clock.clone() {
        // COLUMN:UNIT.
        let unit = time.column.as_ref().and_then(|c| c.strip_prefix(&name)?.strip_prefix(':'));
        time.unit = unit.map(str::to_owned);
        time.column = Some(name).filter(|n| n != "t");
    }
    let name = time.column.clone().or(clock).unwrap_or_else(|| "t".to_owned());
    // A column of dates says itself what it counts.
    let dated = listed.iter().any(|l| l.name == name && !l.is_number);
    let named = names::split(&name).1.is_some() || names::is_only_a_unit(&name).is_some();
    let said = dated || is_counted || time.unit.is_some() || named;
    if !said && !LIKELY.contains(&record.sample_rate_hz) {
        other_unit(&mut record, &mut time, &mut why, &name);
    }
    let not_numbers = listed.iter().filter(|l| {
        !l.is_number && !l.name.is_empty() && l.name != name && listed.iter().filter(|o| o.name == l.name).count() == 1
    });
    let mut unused: Vec<Statement> = not_numbers
        .map(|l| Statement::new(&l.name, "not used", "the cells of its first rows are no numbers"))
        .collect();
    unused.extend(twice(&listed));
    unused.extend(sparse.into_iter().map(|n| Statement::new(n, "not used", "many of its cells are empty")));
    Ok(Raw { path: path.to_path_buf(), record, time, why, unused })
}

/// The sampling rate that a record's own time says, Hz.
pub(super) fn rate_of(path: &Path, time: &TimeChoice, options: &ReadOptions) -> Result<f64> {
    let listed = formats::columns(path, time)?;
    let all: Vec<String> = listed.iter().map(|l| l.name.clone()).collect();
    let clock = names::time_column(&all, time, path).ok().map(|t| t.name);
    let any: Vec<String> = numbers(&listed).into_iter().filter(|n| Some(n) != clock.as_ref()).take(1).collect();
    let record = Record::read(path, &Rig::of_columns(&any, time.clone()), options)?;
    Ok(nice_rate(&record))
}

/// Columns that may be channels.
fn numbers(listed: &[Listed]) -> Vec<String> {
    let own = DEVICE.iter().all(|d| listed.iter().any(|l| l.name == *d));
    let once = |name: &str| listed.iter().filter(|l| l.name == name).count() == 1;
    let device = |name: &str| own && DEVICE.contains(&name);
    let fits = |l: &&Listed| l.is_number && !l.name.is_empty() && once(&l.name) && !device(&l.name);
    listed.iter().filter(fits).map(|l| l.name.clone()).collect()
}

/// What is said of columns that have one name, so that nobody can say which is meant.
fn twice(listed: &[Listed]) -> Vec<Statement> {
    let mut out: Vec<Statement> = Vec::new();
    for l in listed.iter().filter(|l| !l.name.is_empty()) {
        let times = listed.iter().filter(|o| o.name == l.name).count();
        if times > 1 && !out.iter().any(|s| s.of == l.name) {
            let why = format!("{times} columns have this name in the header: rename them, each its own");
            out.push(Statement::new(&l.name, "not used", why).unsure());
        }
    }
    out
}

/// The first column that increases evenly, and the record read by it.
fn time_by_values(path: &Path, numbers: &[String], settings: &Settings) -> Option<(String, Record)> {
    numbers.iter().take(MOST_TRIED).find_map(|name| {
        let time = TimeChoice { column: Some(name.clone()), unit: None };
        let others: Vec<String> = numbers.iter().filter(|n| *n != name).cloned().collect();
        let record = read_columns(path, &others, &time, settings).ok()?;
        let longest = record.segments.iter().max_by_key(|s| s.len())?;
        let even = longest.jitter_s < EVEN * longest.step_s && 2 * longest.len() > record.samples();
        even.then(|| (name.clone(), record))
    })
}

/// Columns many of whose cells are empty.
fn sparse(path: &Path, numbers: &[String], record: &Record, time: &TimeChoice, settings: &Settings) -> Vec<String> {
    let share = |r: &Record| r.losses.nan_rows as f64 / (r.losses.nan_rows + r.samples() as u64).max(1) as f64;
    if share(record) < SPARSE || numbers.len() < 2 {
        return Vec::new();
    }
    let empty = |name: &&String| {
        read_columns(path, core::slice::from_ref(*name), time, settings).map_or(true, |r| share(&r) > SPARSE)
    };
    numbers.iter().filter(empty).cloned().collect()
}

/// A time of which nobody says the unit: seconds, as every command reads it, and what it may be
/// instead; only where no rig has such a rate in seconds it is the unit with the likeliest one.
fn other_unit(record: &mut Record, time: &mut TimeChoice, why: &mut Vec<Statement>, name: &str) {
    let rate = record.sample_rate_hz;
    let distance = |n: f64| (rate * n / 500.0).ln().abs();
    let units = [("ms", 1e3), ("us", 1e6), ("ns", 1e9)];
    let Some((unit, n)) = units.into_iter().min_by(|a, b| distance(a.1).total_cmp(&distance(b.1))) else { return };
    if !LIKELY.contains(&(rate * n)) {
        return;
    }
    let step = significant(1.0 / rate, 6);
    if RATES.contains(&rate) {
        let text = format!(
            "no unit is said; rows {step} apart would be {} Hz in {unit}: if so, say it with --time {}",
            significant(rate * n, 3),
            shell_word(&format!("{name}:{unit}"))
        );
        why.push(Statement::new(name, "a time in s", text).unsure());
        return;
    }
    record.sample_rate_hz *= n;
    for s in &mut record.segments {
        s.step_s /= n;
        s.start_s /= n;
        s.jitter_s /= n;
    }
    time.unit = Some(unit.to_owned());
    let text = format!("no unit is said; rows {step} apart would be {} Hz in seconds", significant(rate, 3));
    why.push(Statement::new(name, format!("a time in {unit}"), text).unsure());
}

/// The rate, rounded as far as the clock allows.
pub(super) fn nice_rate(record: &Record) -> f64 {
    let Some(s) = record.segments.iter().max_by_key(|s| s.len()) else { return record.sample_rate_hz };
    // The slope of a fitted line: σ √12/n^1.5.
    let error = s.jitter_s / s.step_s * 12f64.sqrt() / (s.len().max(2) as f64).powf(1.5);
    nice(record.sample_rate_hz, (3.0 * error).clamp(1e-8, ROUNDED * RATE))
}

/// What is said of the rate.
pub(super) fn rate(raw: &Raw) -> (f64, Statement) {
    let record = &raw.record;
    let longest = record.segments.iter().max_by_key(|s| s.len());
    let (jitter, step) = longest.map_or((0.0, 1.0 / record.sample_rate_hz), |s| (s.jitter_s, s.step_s));
    let rate = nice_rate(record);
    let gaps = match record.losses.gaps {
        0 => String::new(),
        1 => ", 1 gap".to_owned(),
        n => format!(", {n} gaps"),
    };
    let rows = count(record.samples() as u64);
    let name = raw.time.column.as_deref().unwrap_or("t");
    let mut why = format!("{rows} rows, {} s apart{gaps}", significant(1.0 / record.sample_rate_hz, 7));
    if jitter > 0.05 * step {
        why.push_str(&format!(
            ", uneven by {} % of a step (rms): if the samples were taken so, read them with --resample",
            significant(100.0 * jitter / step, 2)
        ));
    }
    (rate, Statement::new(name, format!("{rate} Hz"), why))
}

/// The number of fewest digits within a relative error.
pub(super) fn nice(x: f64, error: f64) -> f64 {
    (0..=12)
        .filter_map(|digits| format!("{x:.digits$e}").parse::<f64>().ok())
        .find(|n| (n / x - 1.0).abs() <= error)
        .unwrap_or(x)
}

/// The error for `--map` of a column that is none.
pub(super) fn no_such_column(path: &Path, column: &str, names: &[String]) -> BadInput {
    BadInput::new(format!("\"{column}\""), format!("one of {}", names.join(", ")))
        .in_file(path)
        .at("--map")
        .remedy("Name a column of numbers that moves")
}
