//! Rig files (TOML): what is measured, how it is driven, what is known beforehand.
//!
//! Every key is checked: an unknown key, a zero rate or a channel that measures nothing is an error
//! with its line. `[plant]` is kept as text and read only by `simulate` and `demo` ([`plant`]): an
//! identification cannot peek at the truth.

pub mod as_own;
mod channel;
pub(crate) mod checks;
pub mod choices;
pub mod computed;
pub mod declared;
pub mod measures;
pub mod plant;
pub(crate) mod possible;
pub mod single_plant;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use self::channel::{Channel, StuckBits, UNITS};
use self::choices::Choices;
use crate::effects;
use crate::effects::entry::{Entry, MOST_FORMS};
use crate::error::{BadInput, Result};
use crate::files;
use crate::model::model_file::toml_place;
use crate::record::names::TimeChoice;

/// Standard gravity used where a rig file gives none, m/s².
pub const GRAVITY: f64 = 9.81;

/// Smallest and greatest rate of samples or frequency, Hz: a sample in eleven days; what no sampler
/// in counts reaches.
pub(crate) const RATES: core::ops::RangeInclusive<f64> = 1e-6..=1e7;
/// Most samples of a drive period: a window of twenty periods is then no longer than what fits into
/// memory.
pub(crate) const MOST_A_PERIOD: f64 = 1e6;
/// Longest simulated record, s (a day).
pub const LONGEST_S: f64 = 86_400.0;
/// Most samples of one that is held in memory.
pub const MOST_SAMPLES: f64 = 2e7;

/// Refuses a length of a simulated record that is none, more than [`LONGEST_S`] or more than so
/// many samples at a rate.
///
/// # Errors
/// Names the longest.
pub fn check_seconds(seconds: f64, rate_hz: f64, most_samples: f64) -> Result<()> {
    if seconds > 0.0 && seconds <= LONGEST_S && seconds * rate_hz <= most_samples {
        return Ok(());
    }
    let most = LONGEST_S.min(most_samples / rate_hz);
    Err(BadInput::new(seconds.to_string(), format!("seconds above 0, at most {most}")).at("--seconds"))
}

/// Smallest and greatest physical quantity, SI: products of six of them are still far from what
/// binary64 can hold (1e±308).
pub(crate) const QUANTITIES: core::ops::RangeInclusive<f64> = 1e-30..=1e30;

/// Physical quantities that `[known]` may hold, with their units.
pub const KNOWN: &[(&str, &str)] = &[
    ("m1", "kg"),
    ("e1", "m"),
    ("m1e1", "kg m"),
    ("l1", "m"),
    ("m2", "kg"),
    ("e2", "m"),
    ("J_o1", "kg m²"),
    ("J_o2", "kg m²"),
    ("a", "m"),
    ("g", "m/s²"),
];

/// The rate of a rig of which none is known yet: a record that is read with it tells its own.
pub const UNKNOWN_RATE: f64 = 0.0;

/// Direction of the base's motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// y = a cos(τ − ψ), upward.
    Vertical,
    /// x_b = a sin τ, toward positive angle.
    Horizontal,
}

/// Harmonic motion of the base.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drive {
    /// Direction.
    pub direction: Direction,
    /// Frequency f_e, Hz.
    pub frequency_hz: f64,
    /// Amplitude, m, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amplitude_m: Option<f64>,
}

/// The nominal model's effects, `ID@PLACE` each.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Nominal {
    effects: Vec<String>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    name: String,
    model: String,
    #[serde(default)]
    sample_rate_hz: Option<f64>,
    #[serde(default)]
    time: Option<String>,
    #[serde(default)]
    time_unit: Option<String>,
    #[serde(default)]
    drive: Option<Drive>,
    channel: Vec<Channel>,
    #[serde(default)]
    known: BTreeMap<String, f64>,
    #[serde(default)]
    nominal: Option<Nominal>,
    #[serde(default)]
    effects: Vec<PathBuf>,
    #[serde(default)]
    plant: Option<toml::Table>,
}

/// Gives the sampling rate of what is read beside a rig file without one, Hz, from its time; none
/// where nothing is.
pub type RateOf<'a> = dyn FnMut(&TimeChoice) -> Result<Option<f64>> + 'a;

/// A rig: what a rig file says, checked.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rig {
    /// Name for people.
    pub name: String,
    /// Model id or path to a model file.
    pub model: String,
    /// Sampling rate, Hz. [`UNKNOWN_RATE`] while a record is read whose rate is not known yet.
    pub sample_rate_hz: f64,
    /// Which column is the time.
    #[serde(skip)]
    pub time: TimeChoice,
    /// Base motion; none for a free system.
    pub drive: Option<Drive>,
    /// Measured columns.
    pub channel: Vec<Channel>,
    /// Known physical quantities, SI; `g` is always there.
    pub known: BTreeMap<String, f64>,
    /// Effects of the nominal model, `ID@PLACE`.
    pub nominal: Option<Vec<String>>,
    /// Effects beside the catalogue's, from the effect files that the rig file names.
    #[serde(skip)]
    pub effects: Vec<Arc<Entry>>,
    /// Effect files, as the rig file names them.
    #[serde(skip)]
    pub effect_files: Vec<PathBuf>,
    /// The file's text, stored with every record.
    #[serde(skip)]
    pub text: String,
    /// Where it was read from.
    #[serde(skip)]
    pub path: PathBuf,
    /// The model file that `model` names, with what the channels measure of it; none for a built-in
    /// model, and for a rig that was not read from a file of its own.
    #[serde(skip)]
    pub bound: Option<Arc<measures::ObservedModel>>,
}

/// That an effect file is not there which a rig file names.
fn no_effects(path: &Path, text: &str, file: &Path) -> BadInput {
    let name = file.display().to_string();
    let is_named = |l: &str| !l.trim_start().starts_with('#') && l.contains(&name);
    let line = text.lines().position(is_named).map_or_else(String::new, |i| format!(", line {}", i + 1));
    BadInput::new(format!("\"{name}\", which does not exist"), "an effect file")
        .in_file(path)
        .at(format!("effects{line}"))
        .remedy("Name a file that exists; paths begin at the rig file's folder")
}

/// Refuses known quantities other than [`KNOWN`]'s, above 0.
fn check_known(known: &BTreeMap<String, f64>, path: &Path) -> Result<()> {
    let bad = |key: &str, found: String, expected: String| {
        Err(BadInput::new(found, expected).in_file(path).at(format!("known.{key}")).remedy("Correct the rig file"))
    };
    for (key, value) in known {
        let Some((_, unit)) = KNOWN.iter().find(|(name, _)| name == key) else {
            let names: Vec<&str> = KNOWN.iter().map(|k| k.0).collect();
            return bad(key, "an unknown quantity".to_owned(), format!("one of {}", names.join(", ")));
        };
        if !QUANTITIES.contains(value) {
            return bad(key, value.to_string(), format!("a value above 0 in {unit} (1e-30 to 1e30)"));
        }
    }
    Ok(())
}

impl Rig {
    /// Reads and checks a rig file, and the model file that it names.
    ///
    /// # Errors
    /// Names the file, the line or key, the value found and the one expected.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        Self::read_for(path.as_ref(), &Choices::default(), &mut |_| Ok(None))
    }

    /// The same with what a command's options say of the columns. `rate` is asked for the sampling
    /// rate where the file has none.
    ///
    /// # Errors
    /// As [`Rig::read`]; a choice that does not fit; what `rate` ends with.
    pub fn read_for(path: &Path, choices: &Choices, rate: &mut RateOf<'_>) -> Result<Self> {
        let text = files::read_text(path, "a rig file", "Name a rig file that exists; shipped ones are in rigs/")?;
        Self::of_text(&text, path, choices, rate)
    }

    /// The same from a rig file's text; `path` is used for messages and for relative paths.
    ///
    /// # Errors
    /// As [`Rig::read_for`].
    pub fn of_text(text: &str, path: &Path, choices: &Choices, rate: &mut RateOf<'_>) -> Result<Self> {
        let mut rig = Self::parse_for(text, path, choices, rate)?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        for file in core::mem::take(&mut rig.effect_files) {
            let whole = folder.join(&file);
            if !whole.exists() {
                return Err(no_effects(path, text, &file));
            }
            rig.add_effects(&whole)?;
        }
        rig.bound = measures::bind(&rig)?;
        Ok(rig)
    }

    /// Adds the effects of an effect file to the catalogue's.
    ///
    /// # Errors
    /// As [`effects::read_more`].
    pub fn add_effects(&mut self, path: &Path) -> Result<()> {
        let source = toml_place::read(path, "an effect file")?;
        let own = effects::read_more(&source, self.effects.iter().map(AsRef::as_ref))?;
        self.effects.extend(own.into_iter().map(Arc::new));
        let forms: usize = self.effects.iter().map(|e| e.forms().len()).sum();
        if forms > MOST_FORMS {
            return Err(BadInput::new(
                format!("{forms} forms of effects"),
                format!("at most {MOST_FORMS} beside the list's"),
            )
            .in_file(path)
            .at("shape")
            .remedy("Shorten the grids, or name fewer files"));
        }
        Ok(())
    }

    /// Parses and checks the text of a rig file; `path` is used for messages and for relative model
    /// paths.
    ///
    /// # Errors
    /// As [`Rig::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        Self::parse_for(text, path, &Choices::default(), &mut |_| Ok(None))
    }

    fn parse_for(text: &str, path: &Path, choices: &Choices, rate: &mut RateOf<'_>) -> Result<Self> {
        let mut file = checks::table(text, path)?;
        choices.apply(&mut file, path)?;
        let time = TimeChoice { column: file.time, unit: file.time_unit };
        checks::time(&time, path)?;
        let sample_rate_hz = match file.sample_rate_hz {
            Some(rate) => rate,
            None => rate(&time)?.ok_or_else(|| checks::no_rate(path))?,
        };
        checks::rate(sample_rate_hz, path)?;
        if let Some(drive) = &file.drive {
            checks::drive(drive, sample_rate_hz, path)?;
        }
        checks::channels(&file.channel, path)?;
        // The quantities of a model file are its own: see [`measures::bind`].
        if !measures::is_file(&file.model) {
            check_known(&file.known, path)?;
        }
        let mut known = file.known;
        known.entry("g".to_owned()).or_insert(GRAVITY);
        let _ = &file.plant;
        let rig = Self {
            name: file.name,
            model: file.model,
            sample_rate_hz,
            time,
            drive: file.drive,
            channel: file.channel,
            known,
            nominal: file.nominal.map(|n| n.effects),
            effects: Vec::new(),
            effect_files: file.effects,
            text: text.to_owned(),
            path: path.to_path_buf(),
            bound: None,
        };
        measures::check_built_in(&rig)?;
        Ok(rig)
    }

    /// A rig of columns as they stand, of which nothing is known yet: no model, no unit, no rate.
    pub fn of_columns(columns: &[String], time: TimeChoice) -> Self {
        Self {
            name: "columns".to_owned(),
            model: String::new(),
            sample_rate_hz: UNKNOWN_RATE,
            time,
            drive: None,
            channel: columns.iter().map(|name| Channel::new(name, "1")).collect(),
            known: BTreeMap::new(),
            nominal: None,
            effects: Vec::new(),
            effect_files: Vec::new(),
            text: String::new(),
            path: PathBuf::new(),
            bound: None,
        }
    }

    /// Whether it is one of columns as they stand, that no file says anything of.
    pub fn is_of_columns(&self) -> bool {
        self.text.is_empty() && self.path.as_os_str().is_empty()
    }

    /// Whether the rig file itself gives g.
    pub fn says_gravity(&self) -> bool {
        let table: Option<toml::Table> = toml::from_str(&self.text).ok();
        table.and_then(|t| t.get("known")?.as_table().map(|k| k.contains_key("g"))).unwrap_or(false)
    }

    /// Direction of the drive; none for a free system.
    pub fn direction(&self) -> Option<Direction> {
        self.drive.map(|d| d.direction)
    }

    /// Angular frequency Ω = 2π f_e of the drive, or 1 rad/s for a free system.
    pub fn omega(&self) -> f64 {
        self.drive.map_or(1.0, |d| core::f64::consts::TAU * d.frequency_hz)
    }
}
