//! A rig file from a record alone: what its columns, its time and its motion show, each with the
//! reason for it.
//!
//! What can be seen is written as found: the rate, units, counts a turn, a drive's frequency, which
//! column is which angle. What cannot is guessed and marked `CHECK`; the file works as it stands.

pub mod columns;
mod counts;
mod drive;
mod look;
mod meant;
mod raw;
mod second_encoder;
mod settle;
mod system;
mod which_arm;
pub mod write;

use std::path::{Path, PathBuf};

use serde::Serialize;

use self::columns::{Kind, Seen};
use self::raw::Raw;
use crate::error::{BadInput, Result, plain};
use crate::record::names::{self, TimeChoice};
use crate::record::{ReadOptions, Record, formats, metadata};
use crate::rig::choices::Choices;
use crate::rig::{Direction, Rig};
use crate::system::library::Pendulum;
use crate::warning::Warning;
use crate::wording::format::shell_word;

/// A statement of the rig file, why it was made, and whether it is a guess.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Statement {
    /// What was taken for granted: `t`, `count1`, `drive`, ….
    pub of: String,
    /// What it is taken for.
    pub taken_for: String,
    /// Why.
    pub why: String,
    /// Whether the record cannot show it, so that a person must look at it.
    pub check: bool,
}

impl Statement {
    fn new(of: impl Into<String>, taken_for: impl Into<String>, why: impl Into<String>) -> Self {
        Self { of: of.into(), taken_for: taken_for.into(), why: why.into(), check: false }
    }

    fn unsure(mut self) -> Self {
        self.check = true;
        self
    }
}

/// A channel of the rig file that is drafted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DraftChannel {
    /// Column.
    pub name: String,
    /// What it measures.
    pub measures: String,
    /// Unit.
    pub unit: String,
    /// Counts a turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub counts_per_turn: Option<u32>,
    /// Factor to the unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// Why, a sentence each.
    pub why: Vec<Statement>,
}

/// A drive that was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DraftDrive {
    /// Direction.
    pub direction: Direction,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Why.
    pub why: Vec<Statement>,
}

/// A rig file that is drafted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Draft {
    /// The record.
    pub record: PathBuf,
    /// Where the rig file is to stand.
    #[serde(skip)]
    pub at: PathBuf,
    /// Name for people.
    pub name: String,
    /// Model id or path; none where the columns leave it open.
    pub model: Option<String>,
    /// Why that model.
    pub why_model: Vec<Statement>,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// Column and unit of the time, where the name `t` in seconds does not say it.
    pub time: TimeChoice,
    /// Why that rate and time.
    pub why_time: Vec<Statement>,
    /// Drive; none for a system at rest.
    pub drive: Option<DraftDrive>,
    /// Channels.
    pub channels: Vec<DraftChannel>,
    /// Columns that are not used, and why.
    pub unused: Vec<Statement>,
    /// The rig file that the record itself carries, which is then all that is written.
    #[serde(skip)]
    pub stored: Option<String>,
}

/// What a draft begins with.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// Model id or file; none where it follows from the number of angles.
    pub system: Option<String>,
    /// Choices of columns.
    pub choices: Choices,
    /// The drive's frequency, Hz, where a person says it; 0: nothing drives the rig.
    pub drive_hz: Option<f64>,
    /// How the record is read.
    pub options: ReadOptions,
    /// Where the rig file is to stand: paths in it are relative to that.
    pub output: PathBuf,
    /// Whether a system must be found (a rig file needs one, an inspection does not).
    pub needs_system: bool,
}

impl Draft {
    /// The built-in system that it is of.
    fn pendulum(&self) -> Option<Pendulum> {
        self.model.as_deref().and_then(Pendulum::named)
    }

    /// All statements, those about the time first.
    pub fn statements(&self) -> Vec<&Statement> {
        let channels = self.channels.iter().flat_map(|c| &c.why);
        let drive = self.drive.iter().flat_map(|d| &d.why);
        self.why_time.iter().chain(&self.why_model).chain(drive).chain(channels).chain(&self.unused).collect()
    }

    /// The rig that the draft is, as if its file stood where it is to stand.
    ///
    /// # Errors
    /// As [`Rig::read`].
    pub fn rig(&self) -> Result<Rig> {
        let rig = Rig::of_text(&write::text(self), &self.at, &Choices::default(), &mut |_| Ok(None))?;
        // A model of no name stands for columns as they are.
        Ok(if self.model.is_none() && self.stored.is_none() { Rig { model: String::new(), ..rig } } else { rig })
    }
}

/// Drafts the rig file of a record.
///
/// # Errors
/// A record that cannot be read, without a time or without a column that could be a channel; a
/// system that does not fit its columns or that must be told.
pub fn draft(path: &Path, settings: &Settings) -> Result<Draft> {
    if settings.system.is_none()
        && let Some(stored) = stored(path, &settings.output)
    {
        names::own_time(settings.choices.time.as_deref(), path)?;
        return Ok(stored);
    }
    let raw = raw::read(path, settings)?;
    let seen = columns::look(&raw);
    let (mut draft, fits) = of_system(&raw, &seen, settings)?;
    if fits == Some(false) {
        second_encoder::reconsider(&mut draft, &raw, &seen, settings);
    }
    Ok(draft)
}

/// The draft of the system that was told or that the columns suggest, and whether its equations fit
/// them to the sensors' noise, where that could be seen.
fn of_system(raw: &Raw, seen: &[Seen], settings: &Settings) -> Result<(Draft, Option<bool>)> {
    let mut seen = seen.to_vec();
    let (sample_rate_hz, why_rate) = raw::rate(raw);
    let chosen = system::choose(raw, &seen, settings)?;
    // Whole numbers that the system makes counts of are an angle's from here on.
    let is_counted = |s: &Seen| chosen.channels.iter().any(|c| c.name == s.name && c.unit == "count");
    for s in seen.iter_mut().filter(|s| s.may_count && is_counted(s)) {
        (s.kind, s.unit) = (Kind::Angle, "count");
    }
    let mut why_time = raw.why.clone();
    why_time.push(why_rate);
    let stem = raw.path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let mut draft = Draft {
        record: raw.path.clone(),
        at: settings.output.clone(),
        name: stem.split('.').next().unwrap_or_default().to_owned(),
        model: chosen.model,
        why_model: chosen.why,
        sample_rate_hz,
        time: raw.time.clone(),
        why_time,
        drive: None,
        channels: chosen.channels,
        unused: raw.unused.iter().cloned().chain(chosen.unused).collect(),
        stored: None,
    };
    let drive::Drives { known, possible, may_hide } = match settings.drive_hz {
        Some(hz) => drive::told(hz, sample_rate_hz)?,
        None if chosen.may_be_driven => drive::find(raw, &seen),
        None => drive::Drives::default(),
    };
    draft.drive = known;
    let fits = match draft.model {
        Some(_) => settle::settle(&mut draft, &seen, settings, &settle::Possible { lines: &possible, may_hide })?,
        None => None,
    };
    Ok((draft, fits))
}

/// What to say of a record whose columns' names are no UTF-8: their units are then not read, so
/// that time in `µs` passes for seconds.
pub fn garbled_names(path: &Path) -> Option<Warning> {
    let columns = formats::columns(path, &TimeChoice::default()).ok()?;
    let garbled = columns.iter().find(|c| c.name.contains(char::REPLACEMENT_CHARACTER))?;
    let file = shell_word(&path.display().to_string());
    Some(Warning::new(
        "names-not-utf8",
        format!(
            "the column {} is not named in UTF-8 (Latin-1, it may be): a unit such as ° or µ in it is not read",
            plain(&garbled.name)
        ),
        format!("Save the file as UTF-8: iconv -f latin1 -t utf8 {file} > utf8.csv"),
    ))
}

/// The rig file that one of whirl's own records carries.
fn stored(path: &Path, at: &Path) -> Option<Draft> {
    let metadata = metadata(path)?;
    let text = without_plant(&metadata.rig);
    let rig = Rig::parse(&text, path).ok()?;
    let why = Statement::new("rig file", rig.name.clone(), "the record carries the rig file that it was captured with");
    Some(Draft {
        record: path.to_path_buf(),
        at: at.to_path_buf(),
        name: rig.name,
        model: Some(rig.model),
        why_model: vec![why],
        sample_rate_hz: rig.sample_rate_hz,
        time: TimeChoice::default(),
        why_time: Vec::new(),
        drive: rig.drive.map(|d| DraftDrive { direction: d.direction, frequency_hz: d.frequency_hz, why: Vec::new() }),
        channels: rig
            .channel
            .into_iter()
            .map(|c| DraftChannel {
                name: c.name,
                measures: c.measures,
                unit: c.unit,
                counts_per_turn: c.counts_per_turn,
                gain: c.gain,
                why: Vec::new(),
            })
            .collect(),
        unused: Vec::new(),
        stored: Some(text),
    })
}

/// A rig file without the truth about a simulated rig.
fn without_plant(text: &str) -> String {
    let mut inside = false;
    let mut out = String::with_capacity(text.len());
    for line in text.lines() {
        let start = line.trim_start();
        if start.starts_with('[') {
            inside = start.starts_with("[plant]") || start.starts_with("[plant.") || start.starts_with("[[plant.");
        }
        if !inside {
            out.push_str(line);
            out.push('\n');
        }
    }
    out
}

/// The sampling rate that a record's own time says, Hz, rounded as far as its clock allows.
///
/// # Errors
/// A record that cannot be read, or whose time cannot be found.
pub fn rate_of(path: &Path, time: &TimeChoice, options: &ReadOptions) -> Result<f64> {
    if let Some(m) = metadata(path).filter(|m| m.sample_rate_hz > 0.0) {
        return Ok(m.sample_rate_hz);
    }
    raw::rate_of(path, time, options)
}

/// A record's columns of numbers as they stand, before anything is known of them; its rate is
/// rounded as far as its clock allows.
///
/// # Errors
/// A record that cannot be read, or whose time cannot be found.
pub fn columns_of(path: &Path, settings: &Settings) -> Result<Record> {
    // Counts are read as the rig file says that a record of whirl's own carries.
    let carried = metadata(path).and_then(|m| Rig::parse(&m.rig, path).ok());
    let mut record = match carried {
        Some(rig) => Record::read(path, &rig, &settings.options)?,
        None => raw::read(path, settings)?.record,
    };
    record.sample_rate_hz = raw::nice_rate(&record);
    Ok(record)
}

/// The error for a record in which nothing could be a channel.
fn nothing_to_measure(raw: &Raw, seen: &[Seen]) -> BadInput {
    let list: Vec<String> = seen.iter().map(|s| format!("{} ({})", s.name, s.kind.words())).collect();
    let left: Vec<String> = raw.unused.iter().map(|s| format!("{}: {}", s.of, s.why)).collect();
    if let Some(twice) = raw.unused.iter().find(|s| list.is_empty() && s.why.contains("columns have this name")) {
        return BadInput::new(format!("{}: {}", twice.of, twice.why), "columns with a name each")
            .in_file(&raw.path)
            .at("header")
            .remedy("Give each column a name of its own in the header, such as theta1 and theta2");
    }
    let found = match (list.is_empty(), left.is_empty()) {
        (true, true) => "no column of numbers but the time".to_owned(),
        (true, false) => format!("no column of numbers but the time ({})", left.join("; ")),
        _ => list.join(", "),
    };
    let is_rate = seen.iter().any(|s| s.kind == Kind::Other);
    BadInput::new(found, if is_rate { "a column of an angle or a displacement" } else { "a column that moves" })
        .in_file(&raw.path)
        .at("columns")
        .remedy(if is_rate {
            "Export the angles or displacements, one column each, beside the time; of a gyroscope's rate that is its sum over the rows times their distance in s, as a column of its own"
        } else {
            "Export the angles or displacements, one column each, beside the time"
        })
}

#[cfg(test)]
mod tests;
