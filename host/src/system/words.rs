//! What names and operations mean in a system file: scalars and vectors over parameters and the
//! motion.
//!
//! `along(a)` = \[sin a, −cos a\] hangs at the angle a, `across(a)` = \[cos a, sin a\] is its
//! direction of growing a. A prime is d/dt. A parameter inside a function is refused where
//! equations are made: what a record determines enters linearly, as products of parameters.

use super::polynomial::{Atom, Polynomial, TooLarge};
use crate::model::model_file::expression::{FUNCTIONS, Function, Symbol};
use crate::model::model_file::parser::{Fault, Grammar};

/// A number or a vector.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A number that may vary.
    Scalar(Polynomial),
    /// Components: right and up, or two across and up.
    Vector(Vec<Polynomial>),
}

/// Which names an expression may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Everything.
    Motion,
    /// Parameters and constants: a quantity, in which functions of parameters may stand.
    Parameters,
}

/// Names of a system file, as far as they are declared.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Words {
    /// Coordinates.
    pub coordinates: Vec<String>,
    /// Which of them are angles on the circle; those beyond its end are none.
    pub angles: Vec<bool>,
    /// Measured inputs.
    pub inputs: Vec<String>,
    /// Parameters; g is one.
    pub parameters: Vec<String>,
    /// Constants.
    pub constants: Vec<(String, f64)>,
    /// Points declared so far.
    pub points: Vec<(String, Vec<Polynomial>)>,
    /// Further names for numbers that vary: the vocabulary of an effect's law.
    pub scalars: Vec<(String, Polynomial)>,
    /// Whether what these name lies on a line, where `wrap` leaves a number as it is: a length of
    /// four units is no other one.
    pub on_line: bool,
    /// Whether parameters may stand inside functions, since their values are put in before anything
    /// is evaluated.
    pub filled: bool,
}

/// The words that one expression may use.
pub struct Scoped<'a>(pub &'a Words, pub Scope);

fn too_large(_: TooLarge) -> Fault {
    Fault::new(
        "an expression that multiplies out to too many products",
        "a simpler one",
        "Choose coordinates or points in which it is shorter",
    )
}

fn mixed(operator: char) -> Fault {
    let what = match operator {
        '+' => "the sum of a number and a vector",
        '-' => "the difference of a number and a vector",
        '*' => "a product of two vectors",
        '/' => "a division by a vector",
        _ => "a power of or with a vector",
    };
    Fault::new(what, "two numbers, or two vectors to add", "Write the components out")
}

impl Scoped<'_> {
    fn known(&self) -> String {
        let w = self.0;
        let mut all: Vec<&str> = Vec::new();
        if self.1 == Scope::Motion {
            all.extend(w.coordinates.iter().chain(&w.inputs).map(String::as_str));
        }
        all.extend(w.parameters.iter().map(String::as_str));
        all.extend(w.constants.iter().map(|c| c.0.as_str()));
        if self.1 == Scope::Motion {
            all.extend(w.points.iter().map(|p| p.0.as_str()));
            all.extend(w.scalars.iter().map(|p| p.0.as_str()));
            all.push("tau");
        }
        all.push("pi");
        format!("one of {}", all.join(", "))
    }

    fn derivative(&self, name: &str, primes: usize) -> Fault {
        if self.0.inputs.iter().any(|n| n == name) {
            return Fault::new(
                format!("a derivative of the input {name}"),
                "derivatives of coordinates only",
                "Remove the prime",
            );
        }
        if self.0.scalars.iter().any(|(n, _)| n == name) {
            let rate = if self.0.scalars.iter().any(|(n, _)| n == "v") { "v" } else { "the words of its place" };
            return Fault::new(
                format!("{name}{}", "'".repeat(primes)),
                format!("{rate} for a rate"),
                "A law of an effect holds rates by their own names, and no accelerations: see docs/effects.md",
            );
        }
        match primes {
            2.. if self.0.coordinates.iter().any(|n| n == name) => Fault::new(
                format!("{name}{}", "'".repeat(primes)),
                format!("{name} or {name}'"),
                "Energies and forces hold no accelerations: the program takes the derivatives",
            ),
            _ => Fault::new(format!("a derivative of {name}"), "derivatives of coordinates only", "Remove the prime"),
        }
    }

    /// A factor or a base, in which sums of angles are angles.
    fn factor(&self, a: &Polynomial) -> Polynomial {
        a.of_whole_angles(&|i| self.0.angles.get(i).is_some_and(|is| *is))
    }

    fn scalar_operation(&self, operator: char, a: &Polynomial, b: &Polynomial) -> Result<Polynomial, Fault> {
        // Multiples of a sum are a sum still, which may go on.
        let is_multiple = a.as_number().is_some() || b.as_number().is_some();
        let (a, b) = match operator {
            '*' | '/' if !is_multiple => (&self.factor(a), &self.factor(b)),
            '/' => (a, &self.factor(b)),
            '^' => (&self.factor(a), b),
            _ => (a, b),
        };
        Ok(match operator {
            '+' => a.plus(b),
            '-' => a.minus(b),
            '*' => a.times(b).map_err(too_large)?,
            '/' => {
                if b.is_zero() {
                    return Err(Fault::new("a division by 0", "a divisor other than 0", "Correct the divisor"));
                }
                if self.1 == Scope::Motion && b.has_parameter() && b.size() > 1 {
                    return Err(Fault::new(
                        "a sum with a parameter in a denominator",
                        "products of parameters, which a record can determine",
                        "Make the sum a constant, or declare its reciprocal as a parameter",
                    ));
                }
                a.times(&b.power(-1).map_err(too_large)?).map_err(too_large)?
            }
            _ => match b.as_number() {
                Some(n) if n.fract() == 0.0 && n.abs() <= 100.0 => {
                    let n = n as i32; // whole and at most 100
                    if self.1 == Scope::Motion && n < 0 && a.has_parameter() && a.size() > 1 {
                        return Err(Fault::new(
                            "a negative power of a sum with a parameter",
                            "products of parameters, which a record can determine",
                            "Make the sum a constant, or declare its reciprocal as a parameter",
                        ));
                    }
                    a.power(n).map_err(too_large)?
                }
                Some(x) if (x - 0.5).abs() < f64::EPSILON => self.function(Function::Sqrt, a.clone())?,
                _ => {
                    self.inside(a, "a broken power")?;
                    self.inside(b, "a power")?;
                    Polynomial::atom(Atom::Power(a.clone(), b.clone()))
                }
            },
        })
    }

    /// Refuses parameters inside what is not linear in them.
    fn inside(&self, a: &Polynomial, what: &str) -> Result<(), Fault> {
        if self.1 == Scope::Parameters || self.0.filled || !a.has_parameter() {
            return Ok(());
        }
        let mut name = String::new();
        for (k, n) in self.0.parameters.iter().enumerate() {
            if a.any(&|x| *x == Atom::Parameter(k)) {
                name.clone_from(n);
                break;
            }
        }
        Err(Fault::new(
            format!("the parameter {name} inside {what}"),
            "parameters as factors only, which a record can determine",
            format!("Give {name} its number under constants, or write an amplitude pair: A*cos(x) + B*sin(x)"),
        ))
    }

    fn function(&self, f: Function, a: Polynomial) -> Result<Polynomial, Fault> {
        // |k x| and sign(k x) would be linear in a k of known sign, which is not known.
        self.inside(&a, "a function")?;
        Ok(Polynomial::call(f, a))
    }
}

impl Grammar for Scoped<'_> {
    type Value = Value;
    const LISTS: bool = true;

    fn number(&self, x: f64) -> Value {
        Value::Scalar(Polynomial::number(x))
    }

    fn operation(&self, operator: char, left: Value, right: Value) -> Result<Value, Fault> {
        use Value::{Scalar, Vector};
        let each = |a: &Polynomial, v: &[Polynomial], swap: bool| -> Result<Value, Fault> {
            let one = |x| if swap { self.scalar_operation(operator, x, a) } else { self.scalar_operation('*', a, x) };
            Ok(Vector(v.iter().map(one).collect::<Result<_, _>>()?))
        };
        match (&left, &right) {
            (Scalar(a), Scalar(b)) => Ok(Scalar(self.scalar_operation(operator, a, b)?)),
            (Vector(a), Vector(b)) if matches!(operator, '+' | '-') => {
                if a.len() != b.len() {
                    return Err(Fault::new(
                        format!("vectors of {} and {} components", a.len(), b.len()),
                        "as many components in every point",
                        "Write all points with two components (right, up) or all with three",
                    ));
                }
                let sum = |(a, b)| self.scalar_operation(operator, a, b);
                Ok(Vector(a.iter().zip(b).map(sum).collect::<Result<_, _>>()?))
            }
            (Scalar(a), Vector(v)) if operator == '*' => each(a, v, false),
            (Vector(v), Scalar(a)) if matches!(operator, '*' | '/') => each(a, v, true),
            _ => Err(mixed(operator)),
        }
    }

    fn name(&self, name: &str, primes: usize, called: bool) -> Result<Option<Value>, Fault> {
        let (w, motion) = (self.0, self.1 == Scope::Motion);
        let scalar = |p| Ok(Some(Value::Scalar(p)));
        if motion && let Some(i) = w.coordinates.iter().position(|n| n == name) {
            return match primes {
                0 => scalar(Polynomial::motion(Symbol::Coordinate(i))),
                1 => scalar(Polynomial::motion(Symbol::Rate(i))),
                n => Err(self.derivative(name, n)),
            };
        }
        let function = FUNCTIONS.iter().any(|f| f.0 == name) || ["along", "across", "atan2", "step"].contains(&name);
        if function && called && primes == 0 {
            return Ok(None);
        }
        let found = if motion && let Some(k) = w.inputs.iter().position(|n| n == name) {
            Some(Value::Scalar(Polynomial::motion(Symbol::Input(k))))
        } else if motion && let Some((_, v)) = w.points.iter().find(|p| p.0 == name) {
            Some(Value::Vector(v.clone()))
        } else if motion && let Some((_, p)) = w.scalars.iter().find(|p| p.0 == name) {
            Some(Value::Scalar(p.clone()))
        } else if let Some(k) = w.parameters.iter().position(|n| n == name) {
            Some(Value::Scalar(Polynomial::atom(Atom::Parameter(k))))
        } else if let Some((_, x)) = w.constants.iter().find(|c| c.0 == name) {
            Some(self.number(*x))
        } else if motion && name == "tau" {
            Some(Value::Scalar(Polynomial::motion(Symbol::Tau)))
        } else if matches!(name, "pi" | "π") {
            Some(self.number(core::f64::consts::PI))
        } else {
            None
        };
        // A rate that has a name of its own: that of an effect's state.
        if motion
            && primes == 1
            && let Some((_, p)) = w.scalars.iter().find(|p| p.0.strip_suffix('\'') == Some(name))
        {
            return scalar(p.clone());
        }
        match found {
            Some(_) if primes > 0 => Err(self.derivative(name, primes)),
            Some(v) => Ok(Some(v)),
            None if called => {
                let functions: Vec<&str> = FUNCTIONS.iter().map(|f| f.0).collect();
                Err(Fault::new(
                    format!("the function \"{name}\""),
                    format!("one of the functions {}, along, across", functions.join(", ")),
                    "Correct the function's name",
                ))
            }
            None => {
                let remedy = if function {
                    format!("Give the function its argument, {name}(…)")
                } else if !self.0.scalars.is_empty() {
                    "Correct the name, or give it as a strength, under shape or under states; see docs/effects.md"
                        .to_owned()
                } else if motion {
                    "Correct the name, or declare it under parameters, constants, inputs or above under points"
                        .to_owned()
                } else {
                    "Correct the name; a quantity is made of parameters and constants".to_owned()
                };
                Err(Fault::new(format!("the name \"{name}\""), self.known(), remedy))
            }
        }
    }

    fn call(&self, name: &str, arguments: Vec<Value>) -> Result<Value, Fault> {
        let wanted = if name == "atan2" { 2 } else { 1 };
        let mut scalars: Vec<Polynomial> = arguments
            .into_iter()
            .map(|a| match a {
                Value::Scalar(p) => Ok(p),
                Value::Vector(_) => Err(Fault::new(
                    format!("a vector in {name}"),
                    "a number",
                    "Functions take numbers; write the components out",
                )),
            })
            .collect::<Result<_, _>>()?;
        if scalars.len() != wanted {
            return Err(Fault::new(
                format!("{} arguments of {name}", scalars.len()),
                wanted.to_string(),
                "Write decimals with a point, and arguments with a comma between them",
            ));
        }
        let last = scalars.pop().unwrap_or_default();
        match (name, scalars.pop()) {
            ("atan2", Some(y)) => {
                self.inside(&y, "atan2")?;
                self.inside(&last, "atan2")?;
                Ok(Value::Scalar(Polynomial::atom(Atom::Atan2(y, last))))
            }
            // 1 for what is positive, 0 for what is negative.
            ("step", _) => {
                let sign = self.function(Function::Sign, last)?;
                Ok(Value::Scalar(sign.plus(&Polynomial::number(1.0)).scaled(0.5)))
            }
            ("along" | "across", _) => {
                let sin = self.function(Function::Sin, last.clone())?;
                let cos = self.function(Function::Cos, last)?;
                Ok(Value::Vector(if name == "along" { vec![sin, cos.scaled(-1.0)] } else { vec![cos, sin] }))
            }
            _ => match FUNCTIONS.iter().find(|f| f.0 == name) {
                Some((_, Function::Wrap)) if self.0.on_line => Ok(Value::Scalar(last)),
                Some((_, f)) => Ok(Value::Scalar(self.function(*f, last)?)),
                None => Err(Fault::new(format!("the function \"{name}\""), "a function", "Correct the name")),
            },
        }
    }

    fn list(&self, items: Vec<Value>) -> Result<Value, Fault> {
        let mut out = Vec::new();
        for item in items {
            match item {
                Value::Scalar(p) => out.push(p),
                Value::Vector(_) => {
                    return Err(Fault::new("a vector within a vector", "numbers, [right, up]", "Write numbers"));
                }
            }
        }
        if !(2..=3).contains(&out.len()) {
            return Err(Fault::new(
                format!("a vector of {} components", out.len()),
                "two, [right, up], or three, two across and up",
                "Write two or three",
            ));
        }
        Ok(Value::Vector(out))
    }
}

#[cfg(test)]
#[path = "words_tests.rs"]
mod tests;
