//! `whirl simulate --model`: a record of an identified or explained model, from a record's state or
//! from a given one.

use core::f64::consts::TAU;
use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::Answer;
use super::output::print_warnings;
use super::outputs::Outputs;
use super::simulate::Arguments;
use crate::error::{BadInput, Result};
use crate::init::rate_of;
use crate::model::identified::{IdentifiedModel, System};
use crate::model::refused;
use crate::motion::from_record::{self, Begin};
use crate::motion::simulation::{self, Solution};
use crate::motion::{Effect, Motion, stand_in};
use crate::record::names::TimeChoice;
use crate::record::values::write_values_from;
use crate::record::writer::check_ending;
use crate::record::{ReadOptions, Record, metadata, names};
use crate::rig::{Channel, LONGEST_S, MOST_SAMPLES, Rig};
use crate::wording::format::{count, shortest};

/// Length where neither a record nor `--seconds` says one, s.
const SECONDS: f64 = 10.0;

/// What was simulated.
#[derive(Debug, Serialize)]
struct Summary {
    model: String,
    samples: u64,
    seconds: f64,
    sample_rate_hz: f64,
    /// The record's t of the first sample, s.
    start_s: f64,
    /// Coordinates at the first sample, then rates a second, by name.
    initial: BTreeMap<String, f64>,
    /// Step of integration, s.
    step_s: f64,
    /// Difference to a solution with twice the step over the first second, of the largest size of a
    /// coordinate.
    difference: f64,
    effects: Vec<String>,
    channels: Vec<Shown>,
}

#[derive(Debug, Serialize)]
struct Shown {
    name: String,
    measures: String,
    unit: String,
}

/// Simulates a model and writes its record.
pub fn run(arguments: &Arguments, path: &Path) -> Result<Answer> {
    let given = arguments.rig.as_ref().map(|rig| rig_for(arguments, rig)).transpose()?;
    let mut files = Outputs::of(&arguments.out, Some(arguments.replace)).reads([path]).reads(&arguments.from);
    if let Some(rig) = &given {
        files = files.reads_rig(rig);
    }
    files.record("-o", &arguments.output).check()?;
    check_ending(&arguments.output)?;
    let model = IdentifiedModel::read(path)?;
    given.as_ref().map_or(Ok(()), |rig| refused::other_system(&model, path, rig))?;
    // What is wrong in the model has no file yet; rigs and records name theirs.
    let of_model =
        |e: BadInput| if e.place.as_deref().is_some_and(|p| p.starts_with("--")) { e } else { e.in_file(path) };
    let rig = match (given, &arguments.from) {
        (Some(rig), _) => rig,
        (None, Some(record)) => own_rig(&model, path, record)?,
        (None, None) => stand_in::rig(&model, path).map_err(of_model)?,
    };
    let record = arguments.from.as_ref().map(|p| Record::read(p, &rig, &ReadOptions::default())).transpose()?;
    record.as_ref().map_or(Ok(()), |r| arguments.columns.check(r))?;
    let first_s = record.as_ref().and_then(|r| r.segments.first()).map_or(0.0, |s| s.start_s);
    let motion = Motion::of(&model, path, Some(&rig), first_s).map_err(of_model)?;
    let begin = match &record {
        Some(record) => from_record::begin(&motion, record, arguments.start)?,
        None => from_given(&motion, &arguments.initial)?,
    };
    let count = samples(arguments.seconds, &motion, &begin)?;
    let bar = super::progress::bar("simulating", 0);
    let solution = simulation::solve(&motion, &begin, count).map_err(of_model)?;
    bar.finish_and_clear();
    let columns = simulation::columns(&motion, &solution, begin.step_s)?;
    let start_s = rounded_to(time_of(&motion, &begin), begin.step_s);
    let sample_rate_hz = 1.0 / begin.step_s;
    write_values_from(&arguments.output, &Rig { sample_rate_hz, ..rig.clone() }, start_s, &columns)?;
    let summary = summary(&motion, &rig, &begin, &solution, start_s);
    let warnings = record.map(|r| r.warnings).unwrap_or_default();
    print_warnings(&warnings);
    arguments.out.write_json_with(&summary, &warnings)?;
    arguments.out.say(&said(&summary, &rig, &motion, &arguments.output));
    Ok(Answer::Positive)
}

/// A time as far as the clock of a record is worth: a thousandth to a ten thousandth of a step, so
/// that a clock fitted to a record's times tells no more digits than they have.
fn rounded_to(time_s: f64, step_s: f64) -> f64 {
    let places = 10f64.powf(-(1e-3 * step_s).log10().floor());
    // What rounding leaves of 0 is 0.
    (places * time_s).round() / places + 0.0
}

/// The rig file, with what the command line says of the record's columns.
fn rig_for(arguments: &Arguments, rig: &Path) -> Result<Rig> {
    let options = ReadOptions::default();
    let rate = |time: &TimeChoice| arguments.from.as_ref().map(|r| rate_of(r, time, &options)).transpose();
    Rig::read_for(rig, &arguments.columns.choices(), &mut { rate })
}

/// The rig that a record of whirl's own carries, for a built-in model.
fn own_rig(model: &IdentifiedModel, path: &Path, record: &Path) -> Result<Rig> {
    let text = metadata(record).map(|m| m.rig).filter(|t| !t.is_empty());
    let rig = text.and_then(|text| Rig::parse(&text, record).ok());
    match (rig, &model.system) {
        (Some(rig), System::BuiltIn(id)) if rig.model == *id => Ok(rig),
        _ => Err(BadInput::new("a record without a rig file", "the rig file that says what its columns measure")
            .in_file(record)
            .at("--from")
            .remedy(format!("Name the rig file on which {} was identified: --rig RIG.toml", path.display()))),
    }
}

/// A beginning at t = 0 in a given state, or in the example; inputs are 0.
fn from_given(motion: &Motion, initial: &[f64]) -> Result<Begin> {
    let n = motion.file.coordinates.len();
    let state = if initial.is_empty() { motion.example() } else { initial.to_vec() };
    if state.len() != 2 * n || !state.iter().all(|x| x.is_finite()) {
        let names: Vec<&str> = motion.file.coordinates.iter().map(|c| c.name.as_str()).collect();
        let expected = format!("{} numbers: {}, then their rates a second", 2 * n, names.join(", "));
        let found: Vec<String> = state.iter().map(f64::to_string).collect();
        return Err(BadInput::new(found.join(","), expected)
            .at("--initial")
            .remedy("Give one number for each, in SI units"));
    }
    let step_s = 1.0 / motion.rig.sample_rate_hz;
    Ok(Begin { time: 0.0, tau: 0.0, state, inputs: None, left_s: f64::INFINITY, step_s })
}

/// How many samples: to the record's end where nothing else is said, and no longer where its inputs
/// act.
fn samples(seconds: Option<f64>, motion: &Motion, begin: &Begin) -> Result<usize> {
    let most = LONGEST_S.min(MOST_SAMPLES * begin.step_s);
    let bound = if begin.inputs.is_some() { begin.left_s.min(most) } else { most };
    let seconds = seconds.unwrap_or(if begin.left_s.is_finite() { begin.left_s.min(most) } else { SECONDS });
    if !(seconds > 0.0 && seconds <= bound + 0.5 * begin.step_s) {
        let why = if bound < most {
            format!(", where the record's {} ends", motion.file.inputs.join(", "))
        } else {
            String::new()
        };
        return Err(BadInput::new(seconds.to_string(), format!("seconds above 0, at most {}{why}", shortest(bound)))
            .at("--seconds")
            .remedy("Give fewer seconds, or begin earlier with --start"));
    }
    // Bounded above.
    Ok(((seconds / begin.step_s).round() as usize).max(1))
}

/// The t of the first sample: the record's own; where the device told the phase, the nearest at
/// which τ = Ω t.
fn time_of(motion: &Motion, begin: &Begin) -> f64 {
    let Some(omega) = motion.omega() else { return begin.time };
    let off = (begin.tau - omega * begin.time + core::f64::consts::PI).rem_euclid(TAU) - core::f64::consts::PI;
    // A clock's own phase is off by rounding only.
    if off.abs() < 1e-9 { begin.time } else { begin.time + off / omega }
}

fn summary(motion: &Motion, rig: &Rig, begin: &Begin, solution: &Solution, start_s: f64) -> Summary {
    let names = motion.file.coordinates.iter().map(|c| c.name.clone());
    let rates = motion.file.coordinates.iter().map(|c| format!("{} rate", c.name));
    let count = solution.coordinates.first().map_or(0, Vec::len);
    let shown = rig.channel.iter();
    Summary {
        model: motion.name.clone(),
        samples: count as u64,
        seconds: count as f64 * begin.step_s,
        sample_rate_hz: 1.0 / begin.step_s,
        start_s,
        initial: names.chain(rates).zip(begin.state.iter().copied()).collect(),
        step_s: solution.step_s,
        difference: solution.difference,
        effects: motion.effects.iter().map(Effect::name).collect(),
        channels: shown
            .map(|c| Shown { name: c.name.clone(), measures: c.measures.clone(), unit: c.unit.clone() })
            .collect(),
    }
}

/// The answer for people.
fn said(s: &Summary, rig: &Rig, motion: &Motion, output: &Path) -> String {
    // A name that tells its unit is not told it twice.
    let told = |c: &Channel| match names::split(&c.name).1 {
        Some(unit) if unit == c.unit => c.name.clone(),
        _ if c.unit == "1" => format!("{} (no unit)", c.name),
        _ if !c.is_plain() => format!("{} ({} with the rig file's gain and offset)", c.name, c.unit),
        _ => format!("{} ({})", c.name, c.unit),
    };
    let columns: Vec<String> = rig.channel.iter().map(told).collect();
    let time = match names::written_time(&rig.time) {
        (name, 1.0) if names::split(&name).1.is_none() => format!("{name} (s)"),
        (name, _) => name,
    };
    let mut out = format!(
        "{} samples ({} s from t = {} s, {} Hz) of {} in {}\ncolumns: {time}, {}\n",
        count(s.samples),
        shortest(s.seconds),
        shortest(s.start_s),
        shortest(s.sample_rate_hz),
        s.model,
        output.display(),
        columns.join(", ")
    );
    let on_sensors: Vec<String> = motion.effects.iter().filter(|e| e.is_of_the_record()).map(Effect::name).collect();
    if !on_sensors.is_empty() {
        out.push_str(&format!("{} change what the columns show, not the motion\n", on_sensors.join(", ")));
    }
    out
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_start_has_the_digits_of_its_clock() {
        let of = super::rounded_to;
        assert_eq!((of(5.000_000_023_283, 0.002), of(1e-17, 0.002), of(0.123_456, 1e-3)), (5.0, 0.0, 0.123_456));
        assert_eq!(of(12.345_678_9, 100.0), 12.3);
    }
}
