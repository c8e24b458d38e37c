//! The identified model as a file: what `identify -o` and `explain -o` write, and what
//! `validate --model` and `explain --model` read.
//!
//! TOML: `name`, `model` (a built-in's id; a system of one's own has its `coordinates`, `inputs`
//! and `[[equation]]` here in full instead, so that the file is itself a model file), `method`,
//! `drive_frequency_hz` (absent when free; it fixes the non-dimensional form), `nominal` (the
//! dampings among the parameters), `[parameters]` with value, standard error and unit of each
//! coefficient in the model's order, and an `[[effect]]` for each effect that was added. Numbers
//! are written with the fewest digits that give back the same bits: reading what was written gives
//! the same model, and writing what was read the same bytes.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use serde::Serialize;
use toml::{Table, Value};

use crate::error::{BadInput, Result};
use crate::model::model_file::toml_place::MODEL_PAGE;
use crate::model::parameter::Parameter;
use crate::model::refused;
use crate::system::library::Pendulum;
use crate::wording::toml_words;

/// Which equations the parameters belong to.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum System {
    /// A built-in model by its id.
    BuiltIn(String),
    /// A system of one's own: the keys that define it (`coordinates`, `inputs`, `equation`, …), as
    /// in its model file.
    Own(Table),
}

impl System {
    /// The built-in pendulum that it is, if it is one.
    pub fn pendulum(&self) -> Option<Pendulum> {
        match self {
            Self::BuiltIn(id) => Pendulum::named(id),
            Self::Own(_) => None,
        }
    }
}

/// An effect that was added to the nominal model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AddedEffect {
    /// Effect.
    pub id: String,
    /// Place.
    pub at: String,
    /// Value in `unit`.
    pub value: f64,
    /// Standard error of the value.
    pub std_error: f64,
    /// Unit of the value.
    pub unit: String,
    /// Strengths as they enter the equations.
    pub strengths: Vec<f64>,
    /// Parameters beyond the first, SI.
    pub parameters: BTreeMap<String, f64>,
}

impl AddedEffect {
    /// `ID@PLACE`.
    pub fn name(&self) -> String {
        format!("{}@{}", self.id, self.at)
    }
}

/// A model with its identified parameters.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IdentifiedModel {
    /// Name for people.
    pub name: String,
    /// Equations.
    pub system: System,
    /// Method of identification.
    pub method: String,
    /// Frequency of the drive, Hz; none for a free system.
    pub drive_frequency_hz: Option<f64>,
    /// Dampings among the parameters, `ID@PLACE` (double pendulum; empty for others).
    pub nominal: Vec<String>,
    /// Coefficients, in the model's order.
    pub parameters: Vec<Parameter>,
    /// Effects, in the order in which they were added.
    pub effects: Vec<AddedEffect>,
    /// Physical quantities that the effects were found with, identified ones among them; empty
    /// without effects.
    pub found_with: BTreeMap<String, f64>,
}

/// Key in [`IdentifiedModel::found_with`] of the length of the record that effects were found on,
/// s: a drift's unit of time.
pub const RECORD_S: &str = "record_s";

/// Version of the file; one without is of the first.
const FORMAT: i64 = 1;

/// A number in TOML with the fewest digits that give back the same bits.
fn number(x: f64) -> String {
    if x.is_nan() { "nan".to_owned() } else { format!("{x:?}") } // "inf" and "1e300" are TOML as they are
}

/// A basic string in TOML.
fn text(s: &str) -> String {
    Value::String(s.to_owned()).to_string()
}

/// A key in TOML: bare where it may be.
fn key(s: &str) -> String {
    let bare = !s.is_empty() && s.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-');
    if bare { s.to_owned() } else { text(s) }
}

impl IdentifiedModel {
    /// A parameter by name.
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|p| p.name == name)
    }

    /// A coefficient by name; where each record has its own, that of the first.
    pub fn coefficient(&self, name: &str) -> Option<&Parameter> {
        self.parameter(name).or_else(|| self.parameter(&format!("{name}_1")))
    }

    /// Values of the parameters, in order.
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.value).collect()
    }

    /// The file's text.
    pub fn to_toml(&self) -> String {
        let mut out = String::new();
        // Writing into a string cannot fail.
        let _ = writeln!(out, "format = {FORMAT}");
        let _ = writeln!(out, "name = {}", text(&self.name));
        if let System::BuiltIn(id) = &self.system {
            let _ = writeln!(out, "model = {}", text(id));
        }
        let _ = writeln!(out, "method = {}", text(&self.method));
        if let Some(f) = self.drive_frequency_hz {
            let _ = writeln!(out, "drive_frequency_hz = {}", number(f));
        }
        let list: Vec<String> = self.nominal.iter().map(|n| text(n)).collect();
        let _ = writeln!(out, "nominal = [{}]", list.join(", "));
        if let System::Own(table) = &self.system {
            // Plain keys first, inline; tables after them would end the top level.
            for (k, v) in table.iter().filter(|(k, _)| !["equation", "format"].contains(&k.as_str())) {
                let _ = writeln!(out, "{} = {}", key(k), v);
            }
            if let Some(Value::Array(equations)) = table.get("equation") {
                for e in equations.iter().filter_map(Value::as_table) {
                    out.push_str("\n[[equation]]\n");
                    for (k, v) in e {
                        let _ = writeln!(out, "{} = {}", key(k), v);
                    }
                }
            }
        }
        if !self.found_with.is_empty() {
            out.push_str("\n[found_with]\n");
            for (k, v) in &self.found_with {
                let _ = writeln!(out, "{} = {}", key(k), number(*v));
            }
        }
        out.push_str("\n[parameters]\n");
        for p in &self.parameters {
            let _ = writeln!(
                out,
                "{} = {{ value = {}, std_error = {}, unit = {} }}",
                key(&p.name),
                number(p.value),
                number(p.std_error),
                text(&p.unit)
            );
        }
        for e in &self.effects {
            let strengths: Vec<String> = e.strengths.iter().map(|x| number(*x)).collect();
            let parameters: Vec<String> =
                e.parameters.iter().map(|(k, v)| format!("{} = {}", key(k), number(*v))).collect();
            let _ = write!(
                out,
                "\n[[effect]]\nid = {}\nat = {}\nvalue = {}\nstd_error = {}\nunit = {}\nstrengths = [{}]\nparameters = {{ {} }}\n",
                text(&e.id),
                text(&e.at),
                number(e.value),
                number(e.std_error),
                text(&e.unit),
                strengths.join(", "),
                parameters.join(", ")
            );
        }
        out
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// A folder that does not exist, a full disk, missing rights.
    pub fn write(&self, path: &Path) -> Result<()> {
        crate::files::write_file(path, self.to_toml().as_bytes())
    }

    /// Reads and checks a file.
    ///
    /// # Errors
    /// Names the file, the key or line, the value found and the one expected.
    pub fn read(path: &Path) -> Result<Self> {
        let remedy = "Name a model that `whirl identify -o` or `whirl explain -o` wrote";
        Self::parse(&crate::files::read_text(path, "an identified model", remedy)?).map_err(|e| refused::told(e, path))
    }

    /// Parses and checks a file's text.
    ///
    /// # Errors
    /// As [`IdentifiedModel::read`], without the file.
    pub fn parse(source: &str) -> Result<Self> {
        let mut table: Table =
            toml::from_str(source).map_err(|e| toml_words::told(&e, source, "an identified model", MODEL_PAGE))?;
        refused::other_file(&table)?;
        match table.remove("format") {
            None | Some(Value::Integer(FORMAT)) => {}
            Some(v) => return Err(bad("format", &v, &format!("{FORMAT}, which this version of whirl reads"))),
        }
        let name = take_text(&mut table, "", "name")?;
        let method = take_text(&mut table, "", "method")?;
        let drive_frequency_hz = match table.remove("drive_frequency_hz") {
            None => None,
            Some(v) => match finite(&v) {
                Some(f) if crate::rig::RATES.contains(&f) => Some(f),
                _ => return Err(bad("drive_frequency_hz", &v, "a frequency in Hz, 1e-6 to 1e7 (left out when free)")),
            },
        };
        let nominal = match table.remove("nominal") {
            None => Vec::new(),
            Some(Value::Array(list)) => list
                .iter()
                .map(|v| {
                    v.as_str()
                        .map(str::to_owned)
                        .ok_or_else(|| bad("nominal", v, "texts like \"coulomb-friction@joint1\""))
                })
                .collect::<Result<_>>()?,
            Some(v) => return Err(bad("nominal", &v, "a list of dampings, ID@PLACE each")),
        };
        let parameters = match table.remove("parameters") {
            Some(Value::Table(t)) => parameters(t)?,
            Some(v) => return Err(bad("parameters", &v, "a table of parameters")),
            None => return Err(BadInput::new("no [parameters]", "a table with value, std_error and unit of each")),
        };
        let found_with = match table.remove("found_with") {
            None => BTreeMap::new(),
            Some(Value::Table(t)) => t
                .into_iter()
                .map(|(k, v)| {
                    let x = finite(&v).ok_or_else(|| bad(format!("found_with.{k}"), &v, "a finite number"))?;
                    Ok((k, x))
                })
                .collect::<Result<_>>()?,
            Some(v) => return Err(bad("found_with", &v, "a table of quantities")),
        };
        let effects = match table.remove("effect") {
            None => Vec::new(),
            Some(Value::Array(list)) => {
                list.into_iter().enumerate().map(|(i, v)| effect(i, v)).collect::<Result<_>>()?
            }
            Some(v) => return Err(bad("effect", &v, "[[effect]] tables")),
        };
        let system = match table.remove("model") {
            Some(Value::String(id)) => {
                if let Some((k, v)) = table.iter().next() {
                    return Err(bad(k, v, "no such key in a built-in model's file"));
                }
                System::BuiltIn(id)
            }
            Some(v) => return Err(bad("model", &v, "the id of a built-in model (`whirl list models`)")),
            None if table.contains_key("equation") && table.contains_key("coordinates") => System::Own(table),
            None => {
                return Err(BadInput::new(
                    "no model",
                    "model = \"…\", or coordinates and [[equation]] of a system of your own",
                ));
            }
        };
        Ok(Self { name, system, method, drive_frequency_hz, nominal, parameters, effects, found_with })
    }
}

fn bad(place: impl Into<String>, found: &Value, expected: &str) -> BadInput {
    let mut shown = found.to_string();
    if shown.chars().count() > 60 {
        shown = shown.chars().take(60).chain(['…']).collect();
    }
    BadInput::new(shown, expected).at(place.into())
}

fn finite(v: &Value) -> Option<f64> {
    match v {
        Value::Float(x) if x.is_finite() => Some(*x),
        Value::Integer(i) => Some(*i as f64),
        _ => None,
    }
}

fn take_text(table: &mut Table, prefix: &str, name: &str) -> Result<String> {
    let place = format!("{prefix}{name}");
    match table.remove(name) {
        Some(Value::String(s)) => Ok(s),
        Some(v) => Err(bad(place, &v, "a text")),
        None => Err(BadInput::new(format!("no {name}"), "a text").at(place)),
    }
}

fn take_value(table: &mut Table, prefix: &str) -> Result<f64> {
    let place = format!("{prefix}value");
    match table.remove("value") {
        Some(v) => finite(&v).ok_or_else(|| bad(place, &v, "a finite number")),
        None => Err(BadInput::new("no value", "a finite number").at(place)),
    }
}

/// A standard error: NaN stands for one that is not known.
fn take_error(table: &mut Table, prefix: &str) -> Result<f64> {
    let place = format!("{prefix}std_error");
    match table.remove("std_error") {
        None => Ok(f64::NAN),
        Some(Value::Float(x)) if x.is_nan() || x == f64::INFINITY => Ok(x),
        Some(v) => match finite(&v) {
            Some(x) if x >= 0.0 => Ok(x),
            _ => Err(bad(place, &v, "a standard error, 0 or more (nan or left out where it is not known)")),
        },
    }
}

fn nothing_left(table: &Table, prefix: &str, keys: &str) -> Result<()> {
    match table.iter().next() {
        Some((k, v)) => Err(bad(format!("{prefix}{k}"), v, &format!("no key but {keys}"))),
        None => Ok(()),
    }
}

fn parameters(table: Table) -> Result<Vec<Parameter>> {
    table
        .into_iter()
        .map(|(name, v)| {
            let prefix = format!("parameters.{name}.");
            let Value::Table(mut t) = v else {
                return Err(bad(format!("parameters.{name}"), &v, "{ value = …, std_error = …, unit = \"…\" }"));
            };
            let value = take_value(&mut t, &prefix)?;
            let std_error = take_error(&mut t, &prefix)?;
            let unit = if t.contains_key("unit") { take_text(&mut t, &prefix, "unit")? } else { "1".to_owned() };
            nothing_left(&t, &prefix, "value, std_error, unit")?;
            Ok(Parameter { name, value, std_error, unit })
        })
        .collect()
}

fn effect(index: usize, v: Value) -> Result<AddedEffect> {
    let prefix = format!("effect {}, ", index + 1);
    let Value::Table(mut t) = v else {
        return Err(bad(format!("effect {}", index + 1), &v, "a table"));
    };
    let id = take_text(&mut t, &prefix, "id")?;
    let at = take_text(&mut t, &prefix, "at")?;
    let value = take_value(&mut t, &prefix)?;
    let std_error = take_error(&mut t, &prefix)?;
    let unit = take_text(&mut t, &prefix, "unit")?;
    let strengths = match t.remove("strengths") {
        Some(Value::Array(list)) => list
            .iter()
            .map(|v| finite(v).ok_or_else(|| bad(format!("{prefix}strengths"), v, "finite numbers")))
            .collect::<Result<_>>()?,
        Some(v) => return Err(bad(format!("{prefix}strengths"), &v, "a list of numbers")),
        None => return Err(BadInput::new("no strengths", "a list of numbers").at(format!("{prefix}strengths"))),
    };
    let parameters = match t.remove("parameters") {
        None => BTreeMap::new(),
        Some(Value::Table(p)) => p
            .into_iter()
            .map(|(k, v)| {
                let x = finite(&v).ok_or_else(|| bad(format!("{prefix}parameters.{k}"), &v, "a finite number"))?;
                Ok((k, x))
            })
            .collect::<Result<_>>()?,
        Some(v) => return Err(bad(format!("{prefix}parameters"), &v, "a table of numbers")),
    };
    nothing_left(&t, &prefix, "id, at, value, std_error, unit, strengths, parameters")?;
    Ok(AddedEffect { id, at, value, std_error, unit, strengths, parameters })
}

#[cfg(test)]
#[path = "identified_tests.rs"]
mod tests;
