//! The keys of a system file, read and checked: every mistake has its line and column.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::bodies::{self, Body};
use super::dimensions::{Measure, Role};
use super::forces::{self, Force};
use super::joints::{self, Joint};
use super::mechanism::Quantity;
use super::polynomial::Polynomial;
pub use super::reader::Reader;
use super::sensors::{self, Sensor};
use super::words::{Scope, Words};
use super::{equations, points, reactions};
use crate::error::{BadInput, Result};
use crate::model::model_file::toml_place::{Source, Value};
use crate::model::model_file::units::Unit;
use crate::model::model_file::{Coordinate, ModelFile, Space};
use crate::wording::close::did_you_mean;

/// Keys of a system file.
pub(crate) const KEYS: [&str; 16] = [
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

/// A system file as it is written; angular frequency and nominal effects of the rig make equations
/// of it, see [`SystemFile::model`].
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
    /// Units of the inputs, in the order of [`Words::inputs`].
    pub input_units: Vec<Unit>,
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

/// Whether a file's top level is that of a system file: its coordinates are a table,
/// `{ phi = "angle" }`.
pub fn is_system(top: &DeTable<'_>) -> bool {
    matches!(top.get("coordinates").map(Spanned::get_ref), Some(DeValue::Table(_)))
}

impl Reader<'_> {
    fn coordinates(&mut self, top: &DeTable<'_>) -> Result<Vec<(Coordinate, String)>> {
        let example = "coordinates such as { phi = \"angle\", x = \"length\" }";
        let mut out = Vec::new();
        for (name, at, value) in self.table(top, "coordinates", example)? {
            self.new_name(at, name)?;
            let unit = self.source.text(value, "\"angle\", \"length\" or a unit such as \"V\"")?;
            let space = if unit == "angle" { Space::Circle } else { Space::Line };
            let counted_in = match unit {
                "angle" => Unit::default(),
                "length" => Unit::parse("m").unwrap_or_default(),
                _ => self.unit_beside(value, &["angle", "length"])?,
            };
            self.measures.insert(name.to_owned(), Measure::declared(unit, &counted_in, Role::Coordinate));
            out.push((Coordinate { name: name.to_owned(), space }, unit.to_owned()));
            self.words.coordinates.push(name.to_owned());
            self.words.angles.push(space == Space::Circle);
        }
        if out.is_empty() {
            let at = top.get("coordinates").map_or(0, |v| v.span().start);
            return Err(self.source.bad(at, "no coordinate", example).remedy("Name the quantities that move"));
        }
        Ok(out)
    }

    fn unit(&self, value: &Value<'_>) -> Result<Unit> {
        self.unit_beside(value, &[])
    }

    /// A unit where some words may stand as well.
    fn unit_beside(&self, value: &Value<'_>, words: &[&str]) -> Result<Unit> {
        let text = self.source.text(value, "a unit in quotes, such as \"kg m^2\"")?;
        let bad = |expected: String| self.source.bad(value.span().start, format!("the unit \"{text}\""), expected);
        let remedy = "Write products with blanks and powers with ^";
        match Unit::known(text) {
            Some(Ok(unit)) => Ok(unit),
            Some(Err(name)) => {
                let words: String = words.iter().map(|word| format!("{word}, ")).collect();
                let what = format!("units that are known, and \"{name}\" is none of {words}{}", Unit::names());
                let meant = did_you_mean(&name, words.split(", ").filter(|w| w.len() > 1));
                Err(bad(what).remedy(format!("{meant}{remedy}, such as \"N m\" or \"kg m^2\"")))
            }
            None => Err(bad("a unit such as \"kg m^2\", \"N m/A\" or \"1\"".to_owned()).remedy(remedy)),
        }
    }

    /// The unit of a name, which is told from then on.
    fn declared(&mut self, name: &str, value: &Value<'_>, role: Role) -> Result<Unit> {
        let unit = self.unit(value)?;
        let text = value.get_ref().as_str().unwrap_or_default();
        self.measures.insert(name.to_owned(), Measure::declared(text, &unit, role));
        Ok(unit)
    }

    fn parameters(&mut self, top: &DeTable<'_>) -> Result<Vec<Parameter>> {
        let mut out = Vec::new();
        for (name, at, value) in self.table(top, "parameters", "parameters such as { m = \"kg\" }")? {
            self.new_name(at, name)?;
            let unit = self.declared(name, value, Role::Parameter)?;
            out.push(Parameter { name: name.to_owned(), unit, declared: Some(at) });
            self.words.parameters.push(name.to_owned());
        }
        for (name, at, value) in self.table(top, "constants", "constants such as { N = 50 }")? {
            self.new_name(at, name)?;
            let x = self.source.number(value, "a number; what is to be found stands under parameters")?;
            self.words.constants.push((name.to_owned(), x));
            self.measures.insert(name.to_owned(), Measure::constant(x));
        }
        let w = &self.words;
        if !w.parameters.iter().chain(&w.coordinates).chain(&w.inputs).any(|n| n == "g")
            && !w.constants.iter().any(|c| c.0 == "g")
        {
            let unit = Unit::parse("m/s^2").unwrap_or_default();
            self.measures.insert("g".to_owned(), Measure::declared("m/s^2", &unit, Role::Parameter));
            out.push(Parameter { name: "g".to_owned(), unit, declared: None });
            self.words.parameters.push("g".to_owned());
        }
        Ok(out)
    }

    fn inputs(&mut self, top: &DeTable<'_>) -> Result<Vec<Unit>> {
        let mut units = Vec::new();
        for (name, at, value) in self.table(top, "inputs", "inputs such as { force = \"N\" }")? {
            self.new_name(at, name)?;
            units.push(self.declared(name, value, Role::Input)?);
            self.words.inputs.push(name.to_owned());
        }
        Ok(units)
    }

    fn gravity(&self, top: &DeTable<'_>) -> Result<Option<Gravity>> {
        match top.get("gravity") {
            None => Ok(None),
            Some(v) if v.get_ref().as_str() == Some("down") => Ok(Some(Gravity::Down)),
            Some(v) => {
                let direction = self.vector(v).map_err(|e| {
                    let expected = "\"down\", or a vector such as \"[g*sin(0.1), -g*cos(0.1)]\"";
                    let remedy = "Write gravity = \"down\", or where it points: up is \"[0, g]\"";
                    BadInput { expected: expected.to_owned(), remedy: remedy.to_owned(), ..e }
                })?;
                self.counted_in(v, "gravity", "m/s^2")?;
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
    /// Whether a coordinate is told in radians: one on the circle, or on the line in that unit.
    pub fn counts_radians(&self, coordinate: usize) -> bool {
        let (c, unit) = &self.coordinates[coordinate];
        c.space == Space::Circle || unit == "rad"
    }

    /// Reads a system file.
    ///
    /// # Errors
    /// Names file, line and column, what was found and what was expected.
    pub fn from_source(source: Source) -> Result<Self> {
        let table = source.table()?;
        let top = table.get_ref();
        source.known_keys(top, &[&KEYS[..], &["equation", "format"]].concat(), "a system file")?;
        let mut r = Reader::new(&source);
        let name = source.required(top, table.span(), "name", "a name for people")?;
        let name = source.text(name, "a name for people")?.to_owned();
        let coordinates = r.coordinates(top)?;
        let input_units = r.inputs(top)?;
        let parameters = r.parameters(top)?;
        points::read(&mut r, top)?;
        let gravity = r.gravity(top)?;
        let bodies = bodies::read(&r, top)?;
        let (kinetic, potential) = (r.energy(top, "kinetic")?, r.energy(top, "potential")?);
        let mut joints = joints::read(&r, top)?;
        reactions::find(&r, top, &bodies, &mut joints);
        let forces = forces::read(&r, top)?;
        forces::join(&forces, &mut joints);
        r.one_energy(top)?;
        let sensors = sensors::read(&r, top)?;
        let quantities = super::mechanism::quantities(&r, top)?;
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
            input_units,
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

    /// The equations for a drive of angular frequency `omega` (rad/s; 1 without one), with the
    /// nominal effects of the rig file where it names some.
    ///
    /// # Errors
    /// An effect that there is not; equations that no record could determine.
    pub fn model(&self, nominal: Option<&[String]>, omega: f64) -> Result<ModelFile> {
        equations::model(self, nominal, omega)
    }
}
