//! Model files (TOML): a system that is not built in, written down by its user.
//!
//! ```toml
//! name = "positioning drive"
//! coordinates = [{ name = "q", space = "R" }]
//! inputs = ["force"]
//! [[equation]]
//! balance = "force"
//! terms = { M = "q''", F_v = "q'" }
//! ```
//!
//! Each equation says Σ_j λ_j X_j = balance, λ_j the unknown coefficients. A prime is d/dτ, τ = Ω
//! t, Ω = 2π f_e of the rig's `[drive]` and 1 rad/s without one (so that it is d/dt then), or
//! always d/dt with `time = "s"`. Coefficients of one name in several equations are one
//! coefficient. `docs/model-file.md` is the user's page.
//!
//! | file | what |
//! |---|---|
//! | [`parser`], [`grammar`], [`names`] | text to expressions, errors at the character; what names mean |
//! | [`expression`] | the tree, derivatives |
//! | [`by_parts`] | weak form of a term |
//! | [`memory`] | states of effects that remember |
//! | [`tape`] | evaluation over blocks of samples |
//! | [`basis`] | unknown functions by harmonic or interpolation basis |
//! | [`weak_form`] | all equations as series and parts for a sampling |
//! | `whole_angles` | sums of angles as one angle each |
//! | [`split`] | terms split into what multiplies accelerations and the rest |
//! | [`equations_of_motion`] | accelerations: [`crate::model::dynamics::Dynamics`] |

mod affine;
pub mod basis;
pub mod by_parts;
mod course;
pub mod equations_of_motion;
pub mod expression;
pub mod grammar;
pub mod memory;
pub mod names;
pub mod parser;
mod reading;
pub mod simulation;
pub mod split;
pub mod tape;
mod tautology;
pub mod toml_place;
pub mod units;
pub mod weak_form;
mod whole_angles;

use std::path::Path;
use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use self::expression::{Node, Symbol};
use self::parser::Names;
use self::reading::{MOST_NAMES, coordinates, equation, inputs};
pub(crate) use self::reading::{check_name, mistake};
use self::toml_place::{Source, described};
use crate::error::{BadInput, Result};
use crate::system::language;
use crate::system::mechanism::Mechanism;

/// Keys that an identified model written by `identify -o` has beside those of a model file.
const IDENTIFIED_KEYS: [&str; 8] =
    ["format", "model", "method", "drive_frequency_hz", "nominal", "found_with", "parameters", "effect"];

/// Where a coordinate lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// The line.
    Line,
    /// The circle: an angle that may whirl.
    Circle,
}

/// A coordinate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coordinate {
    /// Name.
    pub name: String,
    /// Space.
    pub space: Space,
}

/// One unknown coefficient and what it multiplies.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// The coefficient's name.
    pub name: String,
    /// What it multiplies.
    pub of: Node,
    /// As it was written.
    pub text: String,
    /// Whether each record has its own coefficient.
    pub each_record: bool,
}

/// Σ_j λ_j X_j = balance.
#[derive(Clone, Debug, PartialEq)]
pub struct Equation {
    /// The right-hand side.
    pub balance: Node,
    /// As it was written.
    pub balance_text: String,
    /// Terms, in the file's order.
    pub terms: Vec<Term>,
}

/// What a prime stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Time {
    /// d/dτ of the drive (d/dt without one).
    Phase,
    /// d/dt.
    Seconds,
}

/// A system that a user wrote down.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelFile {
    /// Name for people.
    pub name: String,
    /// Coordinates.
    pub coordinates: Vec<Coordinate>,
    /// Measured inputs.
    pub inputs: Vec<String>,
    /// What a prime stands for.
    pub time: Time,
    /// Equations.
    pub equations: Vec<Equation>,
    /// The text and the file.
    pub source: Source,
    /// What the coefficients are made of, where the equations were derived from a system file.
    pub mechanism: Option<Arc<Mechanism>>,
    /// Names of the equations' coefficients; nothing renames one.
    coefficients: Vec<String>,
}

/// Whether a rig file's `model` is the path of a model file.
pub fn is_path(model: &str) -> bool {
    model.ends_with(".toml") || model.contains(['/', '\\'])
}

impl ModelFile {
    /// Reads a model file.
    ///
    /// # Errors
    /// Names file, line and column, what was found and what was expected.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        Self::from_source(toml_place::read(path.as_ref(), "a model file")?)
    }

    /// Parses the text of a model file; `path` is for messages.
    ///
    /// # Errors
    /// As [`ModelFile::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        Self::from_source(Source { text: text.to_owned(), path: path.to_path_buf() })
    }

    /// Reads the text of a model file.
    ///
    /// # Errors
    /// As [`ModelFile::read`].
    pub fn from_source(source: Source) -> Result<Self> {
        let table = source.table()?;
        let span = table.span();
        let top = table.get_ref();
        let known = ["name", "coordinates", "inputs", "time", "equation"];
        source.known_keys(top, &[&known[..], &IDENTIFIED_KEYS].concat(), "a model file").map_err(|mut e| {
            e.expected = format!("one of {}", known.join(", "));
            let of_a_system = language::KEYS.iter().any(|key| e.found == format!("the key \"{key}\""));
            let remedy = "It stands beside coordinates that are a table: coordinates = { x = \"length\" }";
            if of_a_system { e.remedy(remedy) } else { e }
        })?;
        let name = source.required(top, span.clone(), "name", "a name for people")?;
        let name = source.text(name, "a name for people")?.to_owned();
        let coordinates = coordinates(&source, top, &span)?;
        let inputs = inputs(&source, top, &coordinates)?;
        let (time, equations) = Self::equations_of(&source, top, span, &coordinates, &inputs)?;
        drop(table);
        let mut coefficients: Vec<String> = Vec::new();
        for t in equations.iter().flat_map(|e| &e.terms) {
            if !coefficients.contains(&t.name) {
                coefficients.push(t.name.clone());
            }
        }
        Ok(Self { name, coordinates, inputs, time, equations, source, mechanism: None, coefficients })
    }

    /// What a prime stands for, and the `[[equation]]`s.
    ///
    /// # Errors
    /// As [`ModelFile::read`].
    pub fn equations_of(
        source: &Source,
        top: &DeTable<'_>,
        span: std::ops::Range<usize>,
        coordinates: &[Coordinate],
        inputs: &[String],
    ) -> Result<(Time, Vec<Equation>)> {
        let time = match top.get("time") {
            None => Time::Phase,
            Some(v) => match v.get_ref().as_str() {
                Some("tau") => Time::Phase,
                Some("s") => Time::Seconds,
                _ => {
                    return Err(source
                        .bad(v.span().start, described(v.get_ref()), "\"tau\" (the drive's phase) or \"s\"")
                        .remedy("Say what a prime stands for"));
                }
            },
        };
        let names =
            Names { coordinates: coordinates.iter().map(|c| c.name.clone()).collect(), inputs: inputs.to_vec() };
        let circle: Vec<bool> = coordinates.iter().map(|c| c.space == Space::Circle).collect();
        let list =
            source.required(top, span.clone(), "equation", "one [[equation]] or more, each with balance and terms")?;
        let equations = match list.get_ref() {
            DeValue::Array(a) if (1..=MOST_NAMES).contains(&a.len()) => {
                a.iter().map(|e| equation(source, e, &names, &circle)).collect::<Result<Vec<_>>>()?
            }
            other => {
                return Err(source
                    .bad(list.span().start, described(other), format!("[[equation]], 1 to {MOST_NAMES} times"))
                    .remedy("Write [[equation]] in double brackets"));
            }
        };
        Ok((time, equations))
    }

    /// Names of all coefficients, each once, in the file's order.
    pub fn coefficients(&self) -> &[String] {
        &self.coefficients
    }

    /// For each term of each equation, the place of its coefficient among
    /// [`ModelFile::coefficients`].
    pub fn term_places(&self) -> Vec<Vec<usize>> {
        let names = self.coefficients();
        let place = |t: &Term| names.iter().position(|n| *n == t.name).unwrap_or(usize::MAX);
        self.equations.iter().map(|e| e.terms.iter().map(place).collect()).collect()
    }

    /// Whether each coordinate lies on S1.
    pub fn circle(&self) -> Vec<bool> {
        self.coordinates.iter().map(|c| c.space == Space::Circle).collect()
    }

    /// dτ/dt by which primes are divided, for a drive of angular frequency `omega` (rad/s; 1
    /// without one).
    pub fn prime_scale(&self, omega: f64) -> f64 {
        if self.time == Time::Phase { omega } else { 1.0 }
    }

    /// An expression of this file with primes turned into derivatives by seconds.
    pub fn in_seconds(&self, e: &Node, omega: f64) -> Node {
        let scale = 1.0 / self.prime_scale(omega);
        if scale == 1.0 {
            return e.clone();
        }
        e.replace(&|s| match s {
            Symbol::Rate(_) => expression::multiply(expression::number(scale), expression::symbol(s)),
            Symbol::Acceleration(_) => expression::multiply(expression::number(scale * scale), expression::symbol(s)),
            other => expression::symbol(other),
        })
    }

    /// Whether some expression uses the drive's phase.
    pub fn uses_phase(&self) -> bool {
        self.equations.iter().any(|e| {
            std::iter::once(&e.balance).chain(e.terms.iter().map(|t| &t.of)).any(|n| n.any(&|s| s == Symbol::Tau))
        })
    }

    /// An error about this model as a whole.
    pub fn bad(&self, found: impl Into<String>, expected: impl Into<String>) -> BadInput {
        BadInput::new(found, expected).in_file(&self.source.path)
    }
}

#[cfg(test)]
mod tests;
