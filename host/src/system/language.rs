//! The keys of a system file, read and checked: every mistake has its line and column.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::bodies::{self, Body};
use super::forces::{self, Force};
use super::joints::{self, Joint};
use super::mechanism::Quantity;
use super::polynomial::Polynomial;
use super::sensors::{self, Sensor};
use super::words::{Scope, Scoped, Value as Word, Words};
use super::{equations, points};
use crate::error::{BadInput, Result};
use crate::model::model_file::parser::parse;
use crate::model::model_file::toml_place::{Source, Value, described};
use crate::model::model_file::units::Unit;
use crate::model::model_file::{Coordinate, ModelFile, Space, check_name, mistake};

/// Keys of a system file.
const KEYS: [&str; 16] = [
    "name",
    "coordinates",
    "inputs",
    "time",
    "parameters",
    "constants",
    "gravity",
    "points",
    "body",
    "kinetic",
    "potential",
    "joint",
    "force",
    "sensors",
    "quantities",
    "nominal",
];
/// Most names of one kind.
const MOST_NAMES: usize = 64;

/// A parameter of the system.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Unit, printed.
    pub unit: Unit,
    /// Where it is declared; none for g where the file does not name it.
    pub declared: Option<usize>,
}

/// Something with the byte of the file where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed<T> {
    /// What it is.
    pub value: T,
    /// Where it stands.
    pub at: usize,
}

/// The direction of gravity.
#[derive(Clone, Debug, PartialEq)]
pub enum Gravity {
    /// Along the last component, downward.
    Down,
    /// A vector, m/s².
    Along(Vec<Polynomial>),
}

/// A system file as it is written; angular frequency and nominal effects of the rig make equations of it, see [`SystemFile::model`].
#[derive(Clone, Debug, PartialEq)]
pub struct SystemFile {
    /// The text and the file.
    pub source: Source,
    /// Name for people.
    pub name: String,
    /// Coordinates with their units (`angle`, `length`, …).
    pub coordinates: Vec<(Coordinate, String)>,
    /// Names declared.
    pub words: Words,
    /// Parameters, in the order of [`Words::parameters`].
    pub parameters: Vec<Parameter>,
    /// Gravity; none where there is none.
    pub gravity: Option<Gravity>,
    /// Bodies.
    pub bodies: Vec<Placed<Body>>,
    /// Kinetic energy beside the bodies'.
    pub kinetic: Option<Placed<Polynomial>>,
    /// Potential energy beside gravity's.
    pub potential: Option<Placed<Polynomial>>,
    /// Joints.
    pub joints: Vec<Joint>,
    /// Forces.
    pub forces: Vec<Force>,
    /// Sensors.
    pub sensors: Vec<Sensor>,
    /// Quantities.
    pub quantities: Vec<Quantity>,
    /// Nominal effects, `ID@PLACE`.
    pub nominal: Vec<Placed<String>>,
    /// Whether there are written equations beside or instead of bodies.
    pub written: bool,
    /// Whether a prime in written equations is by the drive's phase, and whether that was said.
    pub time: Option<String>,
}

/// Whether a file's top level is that of a system file: its coordinates are a table, `{ phi = "angle" }`.
pub fn is_system(top: &DeTable<'_>) -> bool {
    matches!(top.get("coordinates").map(Spanned::get_ref), Some(DeValue::Table(_)))
}

/// A file and its names, for what reads its parts.
pub struct Reader<'a> {
    /// The file.
    pub source: &'a Source,
    /// Names declared so far.
    pub words: Words,
}

/// A key with its value, in the file's order.
pub type Entry<'a, 'i> = (&'a str, usize, &'a Value<'i>);

impl Reader<'_> {
    /// Entries of a table in the order of the file.
    pub fn entries<'a, 'i>(&self, table: &'a DeTable<'i>) -> Vec<Entry<'a, 'i>> {
        let mut all: Vec<Entry<'a, 'i>> =
            table.iter().map(|(k, v)| (k.get_ref().as_ref(), k.span().start, v)).collect();
        all.sort_by_key(|e| e.1);
        all
    }

    /// A table at a key, if there.
    pub fn table<'a, 'i>(&self, top: &'a DeTable<'i>, key: &str, example: &str) -> Result<Vec<Entry<'a, 'i>>> {
        match top.get(key) {
            None => Ok(Vec::new()),
            Some(v) => match v.get_ref() {
                DeValue::Table(t) if t.len() <= MOST_NAMES => Ok(self.entries(t)),
                DeValue::Table(t) => Err(self.source.bad(
                    v.span().start,
                    format!("{} entries of {key}", t.len()),
                    format!("at most {MOST_NAMES}"),
                )),
                other => Err(self
                    .source
                    .bad(v.span().start, described(other), example.to_owned())
                    .remedy(format!("Write {key} as a table"))),
            },
        }
    }

    /// Tables at a key in double brackets.
    pub fn tables<'a, 'i>(&self, top: &'a DeTable<'i>, key: &str) -> Result<Vec<(&'a DeTable<'i>, usize)>> {
        let Some(v) = top.get(key) else { return Ok(Vec::new()) };
        let wrong = |at: usize, what: &DeValue<'_>| {
            self.source
                .bad(at, described(what), format!("[[{key}]], at most {MOST_NAMES} times"))
                .remedy(format!("Write [[{key}]] in double brackets"))
        };
        match v.get_ref() {
            DeValue::Array(a) if a.len() <= MOST_NAMES => a
                .iter()
                .map(|item| match item.get_ref() {
                    DeValue::Table(t) => Ok((t, item.span().start)),
                    other => Err(wrong(item.span().start, other)),
                })
                .collect(),
            other => Err(wrong(v.span().start, other)),
        }
    }

    /// An expression, in quotes or a bare number.
    pub fn value(&self, value: &Value<'_>, scope: Scope) -> Result<Word> {
        if matches!(value.get_ref(), DeValue::Integer(_) | DeValue::Float(_)) {
            let x = self.source.number(value, "a number")?;
            return Ok(Word::Scalar(Polynomial::number(x)));
        }
        let text = self.source.text(value, "an expression in quotes")?;
        parse(text, &Scoped(&self.words, scope)).map_err(|m| mistake(self.source, value, text, m))
    }

    /// An expression that is a number.
    pub fn scalar(&self, value: &Value<'_>, scope: Scope) -> Result<Polynomial> {
        match self.value(value, scope)? {
            Word::Scalar(p) => Ok(p),
            Word::Vector(_) => Err(self
                .source
                .bad(value.span().start, format!("the vector {}", described(value.get_ref())), "a number")
                .remedy("Write one of its components, or an angle")),
        }
    }

    /// An expression that is a vector with as many components as those before.
    pub fn vector(&self, value: &Value<'_>) -> Result<Vec<Polynomial>> {
        let bad = |found: String, expected: String| {
            Err(self.source.bad(value.span().start, found, expected).remedy("Points have right and up, or three axes"))
        };
        match self.value(value, Scope::Motion)? {
            Word::Vector(v) => match self.words.points.first() {
                Some((name, first)) if first.len() != v.len() => bad(
                    format!("a vector of {} components", v.len()),
                    format!("{} as in the point {name}", first.len()),
                ),
                _ => Ok(v),
            },
            Word::Scalar(_) => {
                bad(described(value.get_ref()), "a vector such as \"[x, 0]\" or a sum of points".to_owned())
            }
        }
    }

    /// Refuses a name that is taken or cannot be one.
    pub fn new_name(&self, at: usize, name: &str) -> Result<()> {
        let w = &self.words;
        let taken: Vec<String> = [&w.coordinates[..], &w.inputs, &w.parameters].concat();
        let more = w.constants.iter().map(|c| c.0.clone()).chain(w.points.iter().map(|p| p.0.clone()));
        check_name(self.source, at, name, &taken.into_iter().chain(more).collect::<Vec<_>>())?;
        if ["along", "across", "atan2"].contains(&name) {
            return Err(self
                .source
                .bad(at, format!("the name \"{name}\""), "a name that expressions do not use otherwise")
                .remedy("Rename it"));
        }
        Ok(())
    }

    /// The name of a body or joint: free of blanks and of those before.
    pub fn own_name(&self, table: &DeTable<'_>, at: usize, taken: &[&str]) -> Result<String> {
        let value = self.source.required(table, at..at, "name", "a name")?;
        let name = self.source.text(value, "a name")?;
        let bad = |found: String, expected: &str| {
            Err(self.source.bad(value.span().start, found, expected.to_owned()).remedy("Rename it"))
        };
        if name.is_empty() || !name.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '-')) || name.len() > 64 {
            return bad(format!("the name \"{name}\""), "letters, digits, _ and -, at most 64");
        }
        if taken.contains(&name) {
            return bad(format!("the name \"{name}\" a second time"), "each name once");
        }
        Ok(name.to_owned())
    }

    fn coordinates(&mut self, top: &DeTable<'_>) -> Result<Vec<(Coordinate, String)>> {
        let example = "coordinates such as { phi = \"angle\", x = \"length\" }";
        let mut out = Vec::new();
        for (name, at, value) in self.table(top, "coordinates", example)? {
            self.new_name(at, name)?;
            let unit = self.source.text(value, "\"angle\", \"length\" or a unit such as \"V\"")?;
            let space = if unit == "angle" { Space::Circle } else { Space::Line };
            if !["angle", "length"].contains(&unit) {
                self.unit(value)?;
            }
            out.push((Coordinate { name: name.to_owned(), space }, unit.to_owned()));
            self.words.coordinates.push(name.to_owned());
        }
        if out.is_empty() {
            let at = top.get("coordinates").map_or(0, |v| v.span().start);
            return Err(self.source.bad(at, "no coordinate", example).remedy("Name the quantities that move"));
        }
        Ok(out)
    }

    fn unit(&self, value: &Value<'_>) -> Result<Unit> {
        let text = self.source.text(value, "a unit in quotes, such as \"kg m^2\"")?;
        Unit::parse(text).ok_or_else(|| {
            self.source
                .bad(value.span().start, format!("the unit \"{text}\""), "a unit such as \"kg m^2\", \"N m/A\" or \"1\"")
                .remedy("Write products with blanks and powers with ^")
        })
    }

    fn parameters(&mut self, top: &DeTable<'_>) -> Result<Vec<Parameter>> {
        let mut out = Vec::new();
        for (name, at, value) in self.table(top, "parameters", "parameters such as { m = \"kg\" }")? {
            self.new_name(at, name)?;
            out.push(Parameter { name: name.to_owned(), unit: self.unit(value)?, declared: Some(at) });
            self.words.parameters.push(name.to_owned());
        }
        for (name, at, value) in self.table(top, "constants", "constants such as { N = 50 }")? {
            self.new_name(at, name)?;
            let x = self.source.number(value, "a number; what is to be found stands under parameters")?;
            self.words.constants.push((name.to_owned(), x));
        }
        let w = &self.words;
        if !w.parameters.iter().chain(&w.coordinates).chain(&w.inputs).any(|n| n == "g")
            && !w.constants.iter().any(|c| c.0 == "g")
        {
            let unit = Unit::parse("m/s^2").unwrap_or_default();
            out.push(Parameter { name: "g".to_owned(), unit, declared: None });
            self.words.parameters.push("g".to_owned());
        }
        Ok(out)
    }

    fn inputs(&mut self, top: &DeTable<'_>) -> Result<()> {
        for (name, at, value) in self.table(top, "inputs", "inputs such as { force = \"N\" }")? {
            self.new_name(at, name)?;
            self.unit(value)?;
            self.words.inputs.push(name.to_owned());
        }
        Ok(())
    }

    fn gravity(&self, top: &DeTable<'_>) -> Result<Option<Gravity>> {
        match top.get("gravity") {
            None => Ok(None),
            Some(v) if v.get_ref().as_str() == Some("down") => Ok(Some(Gravity::Down)),
            Some(v) => {
                let direction = self.vector(v).map_err(|e| {
                    let expected = "\"down\", or a vector such as \"[g*sin(0.1), -g*cos(0.1)]\"";
                    BadInput { expected: expected.to_owned(), ..e }
                })?;
                Ok(Some(Gravity::Along(direction)))
            }
        }
    }

    fn energy(&self, top: &DeTable<'_>, key: &str) -> Result<Option<Placed<Polynomial>>> {
        let Some(v) = top.get(key) else { return Ok(None) };
        let value = self.scalar(v, Scope::Motion)?;
        Ok(Some(Placed { value, at: self.source.inside(v, 0) }))
    }

    fn nominal(&self, top: &DeTable<'_>) -> Result<Vec<Placed<String>>> {
        let mut out = Vec::new();
        for (key, at, value) in self.table(top, "nominal", "[nominal] with effects = [\"viscous-friction@pivot\"]")? {
            let DeValue::Array(list) = value.get_ref() else {
                return Err(self
                    .source
                    .bad(at, format!("the key \"{key}\" of nominal"), "effects = [\"ID@PLACE\", …]")
                    .remedy("List the effects that the nominal model has"));
            };
            if key != "effects" {
                return Err(self.source.bad(at, format!("the key \"{key}\""), "effects").remedy("Correct the key"));
            }
            for item in list {
                let text = self.source.text(item, "an effect such as \"viscous-friction@pivot\"")?;
                out.push(Placed { value: text.to_owned(), at: item.span().start });
            }
        }
        Ok(out)
    }
}

impl SystemFile {
    /// Reads a system file.
    ///
    /// # Errors
    /// Names file, line and column, what was found and what was expected.
    pub fn from_source(source: Source) -> Result<Self> {
        let table = source.table()?;
        let top = table.get_ref();
        source.known_keys(top, &[&KEYS[..], &["equation"]].concat(), "a system file")?;
        let mut r = Reader { source: &source, words: Words::default() };
        let name = source.required(top, table.span(), "name", "a name for people")?;
        let name = source.text(name, "a name for people")?.to_owned();
        let coordinates = r.coordinates(top)?;
        r.inputs(top)?;
        let parameters = r.parameters(top)?;
        points::read(&mut r, top)?;
        let gravity = r.gravity(top)?;
        let bodies = bodies::read(&r, top)?;
        let (kinetic, potential) = (r.energy(top, "kinetic")?, r.energy(top, "potential")?);
        let joints = joints::read(&r, top)?;
        let forces = forces::read(&r, top)?;
        let sensors = sensors::read(&r, top)?;
        let quantities = super::mechanism::quantities(&r, top, &parameters)?;
        let nominal = r.nominal(top)?;
        let time = top.get("time").map(|v| source.text(v, "\"tau\" or \"s\"")).transpose()?.map(str::to_owned);
        let words = r.words;
        let written = top.get("equation").is_some();
        if bodies.is_empty() && kinetic.is_none() && !written {
            return Err(source
                .bad(0, "neither [[body]] nor kinetic nor [[equation]]", "something that moves")
                .remedy("Add a body with its mass or inertia, or kinetic = \"m*x'^2/2\""));
        }
        drop(table);
        let file = Self {
            source,
            name,
            coordinates,
            words,
            parameters,
            gravity,
            bodies,
            kinetic,
            potential,
            joints,
            forces,
            sensors,
            quantities,
            nominal,
            written,
            time,
        };
        // Equations are made once here, so that every mistake is told when the file is read.
        equations::model(&file, None, 1.0)?;
        Ok(file)
    }

    /// The equations for a drive of angular frequency `omega` (rad/s; 1 without one), with the nominal effects of the rig file where
    /// it names some.
    ///
    /// # Errors
    /// An effect that there is not; equations that no record could determine.
    pub fn model(&self, nominal: Option<&[String]>, omega: f64) -> Result<ModelFile> {
        equations::model(self, nominal, omega)
    }
}
