//! Dimensions of expressions, from the units that a system file declares: what is added must agree,
//! functions take numbers, a mass is in kg.
//!
//! Refused is only what units that were written contradict. A unit that is not written may be any:
//! that of a constant, of what is declared in `1`, of a coordinate that is no length or angle, of a
//! number such as 9.81, of a coefficient of one (`force - x`). A whole number to twelve is a plain
//! factor where a parameter with a unit stands beside it; a number or an angle alone may be so many of
//! anything.

use std::collections::BTreeMap;

use toml::de::DeTable;

use super::reader::Reader;
use super::words::Scope;
use crate::error::Result;
use crate::model::model_file::mistake;
use crate::model::model_file::parser::{Fault, Grammar, parse};
use crate::model::model_file::toml_place::{Value, described};
use crate::model::model_file::units::Unit;

/// Largest whole number that is a plain factor beside a parameter.
const PLAIN_TO: f64 = 12.0;

/// What to do about units that do not agree.
const REMEDY: &str = "Correct the expression, or a unit where it is declared; a number that carries a unit stands \
                      under constants, and the unit \"1\" leaves open what something is counted in";

/// What a name stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A coordinate.
    Coordinate,
    /// A measured input.
    Input,
    /// A parameter.
    Parameter,
}

/// What is known of the unit of an expression.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measure {
    /// As it follows from the units that were written.
    pub unit: Unit,
    /// Whether something takes part whose unit was not written.
    open: bool,
    /// Whether a parameter with a unit is a factor.
    named: bool,
    /// Whether an input is.
    input: bool,
    /// Whether a whole number is a factor.
    counted: bool,
    /// Its value, where it is a number.
    value: Option<f64>,
}

impl Measure {
    /// Of a name declared in a unit.
    pub fn declared(text: &str, unit: &Unit, role: Role) -> Self {
        let open = text.trim() == "1" || (role == Role::Coordinate && !["angle", "length"].contains(&text));
        let named = role == Role::Parameter && !open;
        Self { unit: unit.clone(), open, named, input: role == Role::Input && !open, ..Self::default() }
    }

    /// Of a constant.
    pub fn constant(x: f64) -> Self {
        Self { open: true, value: Some(x), ..Self::default() }
    }

    fn of(unit: Unit) -> Self {
        Self { unit, named: true, ..Self::default() }
    }

    /// Per second, so many times.
    fn rate(&self, order: usize) -> Self {
        let second = Unit::parse("s").unwrap_or_default();
        Self { unit: self.unit.times(&second, -(order as f64)), ..self.clone() }
    }

    fn open() -> Self {
        Self { open: true, ..Self::default() }
    }

    fn is_number(&self) -> bool {
        self.unit.agrees(&Unit::default())
    }

    /// Whether it contradicts nothing, whatever stands beside it.
    fn fits_any(&self) -> bool {
        self.open || (!self.named && (self.counted || self.is_number()))
    }

    /// The same of a term, before which a coefficient of one need not be written.
    fn is_any_term(&self) -> bool {
        self.fits_any() || !(self.named || self.input)
    }

    fn contradicts(&self, unit: &Unit) -> bool {
        !self.fits_any() && !self.unit.agrees(unit)
    }

    fn times(&self, other: &Self, power: f64) -> Self {
        let value = |(a, b): (f64, f64)| a * b.powf(power);
        Self {
            unit: self.unit.times(&other.unit, power),
            open: self.open || other.open,
            named: self.named || other.named,
            input: self.input || other.input,
            counted: self.counted || other.counted,
            value: self.value.zip(other.value).map(value),
        }
    }

    fn to_the(&self, power: f64) -> Self {
        Self {
            unit: Unit::default().times(&self.unit, power),
            value: self.value.map(|x| x.powf(power)),
            ..self.clone()
        }
    }

    fn sum(&self, other: &Self, operator: char) -> Checked<Self> {
        let value = self.value.zip(other.value).map(|(a, b)| if operator == '+' { a + b } else { a - b });
        let agree = self.unit.agrees(&other.unit);
        let sum = match (self.is_any_term(), other.is_any_term()) {
            (true, true) if agree => Self { open: self.open || other.open, counted: false, ..self.clone() },
            (true, true) => Self::open(),
            (true, false) => other.clone(),
            (false, true) => self.clone(),
            (false, false) if agree => self.clone(),
            (false, false) => {
                let what = if operator == '+' { "sum" } else { "difference" };
                let found = format!("the {what} of {} and {}", told(&self.unit), told(&other.unit));
                return Err(Fault::new(found, "terms of one unit", REMEDY));
            }
        };
        Ok(Self { value, ..sum })
    }
}

type Checked<T> = core::result::Result<T, Fault>;

/// A unit in a message.
fn told(unit: &Unit) -> String {
    if unit.agrees(&Unit::default()) { "a number".to_owned() } else { unit.to_string() }
}

/// A unit that was calculated, by the one of these names that it has.
fn by_its_name(unit: &Unit, usual: &[&str]) -> String {
    let named = usual.iter().filter_map(|name| Unit::parse(name)).find(|u| u.agrees(unit));
    told(named.as_ref().unwrap_or(unit))
}

/// An energy's unit in a message.
fn of_energy(unit: &Unit) -> String {
    by_its_name(unit, &["J"])
}

/// A number, or the components of a vector.
enum Shape {
    Scalar(Measure),
    Vector(Vec<Measure>),
}

/// The names that an expression may use, each with its measure; one that is not among them is open.
struct Scoped<'a>(&'a Reader<'a>, Scope);

impl Scoped<'_> {
    fn combined(operator: char, a: &Measure, b: &Measure) -> Checked<Measure> {
        Ok(match operator {
            '+' | '-' => a.sum(b, operator)?,
            '*' => a.times(b, 1.0),
            '/' => a.times(b, -1.0),
            _ => match b.value {
                _ if b.contradicts(&Unit::default()) => {
                    return Err(Fault::new(format!("a power of {}", told(&b.unit)), "a number as a power", REMEDY));
                }
                Some(power) => a.to_the(power),
                None if a.is_number() => a.clone(),
                None => Measure::open(),
            },
        })
    }
}

impl Grammar for Scoped<'_> {
    type Value = Shape;
    const LISTS: bool = true;

    fn number(&self, x: f64) -> Shape {
        let counted = x.fract() == 0.0 && x.abs() <= PLAIN_TO && x != 0.0;
        Shape::Scalar(Measure {
            counted: counted && x.abs() != 1.0,
            open: !counted,
            value: Some(x),
            ..Measure::default()
        })
    }

    fn operation(&self, operator: char, left: Shape, right: Shape) -> Checked<Shape> {
        use Shape::{Scalar, Vector};
        let op = |(a, b): (&Measure, &Measure)| Self::combined(operator, a, b);
        Ok(match (&left, &right) {
            (Scalar(a), Scalar(b)) => Scalar(op((a, b))?),
            (Vector(a), Vector(b)) => Vector(a.iter().zip(b).map(op).collect::<Checked<_>>()?),
            (Scalar(a), Vector(v)) => Vector(v.iter().map(|x| op((a, x))).collect::<Checked<_>>()?),
            (Vector(v), Scalar(a)) => Vector(v.iter().map(|x| op((x, a))).collect::<Checked<_>>()?),
        })
    }

    fn name(&self, name: &str, primes: usize, called: bool) -> Checked<Option<Shape>> {
        let w = &self.0.words;
        let found = self.0.measures.get(name).map(|m| m.rate(primes));
        if let Some((_, point)) = w.points.iter().find(|p| p.0 == name && self.1 == Scope::Motion) {
            let length = Measure::of(Unit::parse("m").unwrap_or_default());
            return Ok(Some(Shape::Vector(vec![length; point.len()])));
        }
        Ok(match found {
            Some(m) => Some(Shape::Scalar(m)),
            None if called => None,
            None if matches!(name, "pi" | "π" | "tau") => Some(Shape::Scalar(Measure::default())),
            None => Some(Shape::Scalar(Measure::open())),
        })
    }

    fn call(&self, name: &str, arguments: Vec<Shape>) -> Checked<Shape> {
        let mut all = arguments.into_iter().map(|a| match a {
            Shape::Scalar(m) => m,
            Shape::Vector(_) => Measure::open(),
        });
        let (Some(first), second) = (all.next(), all.next()) else { return Ok(Shape::Scalar(Measure::open())) };
        let number = Measure::default();
        Ok(Shape::Scalar(match name {
            "abs" | "wrap" => first,
            "sqrt" => first.to_the(0.5),
            "sign" | "step" => number,
            "atan2" => {
                second.map_or(Ok(Measure::default()), |x| first.sum(&x, '+'))?;
                number
            }
            _ if first.contradicts(&Unit::default()) => {
                let found = format!("{name} of what is in {}", told(&first.unit));
                let remedy = format!("Divide by a number under constants that is in {}. {REMEDY}", told(&first.unit));
                return Err(Fault::new(found, "a number or an angle", remedy));
            }
            "along" | "across" => return Ok(Shape::Vector(vec![number; 2])),
            _ => number,
        }))
    }

    fn list(&self, items: Vec<Shape>) -> Checked<Shape> {
        let scalar = |item| match item {
            Shape::Scalar(m) => m,
            Shape::Vector(_) => Measure::open(),
        };
        Ok(Shape::Vector(items.into_iter().map(scalar).collect()))
    }
}

/// Measures of names.
pub type Measures = BTreeMap<String, Measure>;

impl Reader<'_> {
    /// What the components of an expression are counted in, one for a number.
    ///
    /// # Errors
    /// Units that contradict each other.
    pub fn measured(&self, value: &Value<'_>, scope: Scope) -> Result<Vec<Measure>> {
        let Some(text) = value.get_ref().as_str() else { return Ok(vec![Measure::open()]) };
        match parse(text, &Scoped(self, scope)).map_err(|m| mistake(self.source, value, text, m))? {
            Shape::Scalar(m) => Ok(vec![m]),
            Shape::Vector(v) => Ok(v),
        }
    }

    /// Refuses an expression that is not counted in a unit; `what` it stands for.
    ///
    /// # Errors
    /// Names both units.
    pub fn counted_in(&self, value: &Value<'_>, what: &str, unit: &str) -> Result<()> {
        let expected = Unit::parse(unit).unwrap_or_default();
        match self.measured(value, Scope::Motion)?.iter().find(|m| m.contradicts(&expected)) {
            None => Ok(()),
            Some(m) => {
                let expected = match what {
                    "the angle" => "an angle in rad".to_owned(),
                    "the direction" => "numbers such as [sin(a), cos(a)]".to_owned(),
                    _ => told(&expected),
                };
                Err(self.in_another(value, what, &m.unit, expected))
            }
        }
    }

    fn in_another(&self, value: &Value<'_>, what: &str, unit: &Unit, expected: String) -> crate::error::BadInput {
        let found = format!("{what} {} in {}", described(value.get_ref()), told(unit));
        self.source.bad(self.source.inside(value, 0), found, expected).remedy(REMEDY)
    }

    /// Refuses energies and works of forces that are not counted in one unit.
    ///
    /// # Errors
    /// Names both units.
    pub fn one_energy(&self, top: &DeTable<'_>) -> Result<()> {
        let mut energy: Option<(Unit, &str)> = None;
        let scalar = |v: &Value<'_>| -> Result<Measure> {
            Ok(self.measured(v, Scope::Motion)?.into_iter().next().unwrap_or_default())
        };
        for (body, _) in self.tables(top, "body")? {
            for value in ["mass", "first_moment", "inertia"].into_iter().filter_map(|key| body.get(key)) {
                if !scalar(value)?.fits_any() {
                    energy = Some((Unit::parse("J").unwrap_or_default(), "the bodies' energy"));
                }
            }
        }
        for (key, name) in [("kinetic", "the kinetic energy"), ("potential", "the potential energy")] {
            let Some(value) = top.get(key) else { continue };
            let own = scalar(value)?;
            match &energy {
                Some((unit, whose)) if own.contradicts(unit) => {
                    return Err(self.in_another(value, name, &own.unit, format!("{} as {whose}", of_energy(unit))));
                }
                None if !own.fits_any() => energy = Some((own.unit, name)),
                _ => {}
            }
        }
        for (force, _) in self.tables(top, "force")? {
            let (Some(along), Some(value)) = (force.get("does_work_on"), force.get("value")) else { continue };
            let (displacement, own) = (scalar(along)?, scalar(value)?);
            // A bare number may be so many of anything.
            let work = if own.fits_any() { Measure::open() } else { own.times(&displacement, 1.0) };
            match &energy {
                Some((unit, whose)) if !work.open && !work.unit.agrees(unit) => {
                    let wanted = by_its_name(&unit.times(&displacement.unit, -1.0), &["N m", "N", "V"]);
                    let along = described(along.get_ref());
                    let expected = format!("{wanted}, whose work along {along} is in {} as {whose}", of_energy(unit));
                    return Err(self.in_another(value, "the force", &own.unit, expected));
                }
                None if !work.fits_any() => energy = Some((work.unit, "the work of a force before it")),
                _ => {}
            }
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "dimensions_tests.rs"]
mod tests;
