//! Equations of motion with their numbers in them, for people: as MathML for a page and as plain
//! text for a terminal.
//!
//! Each equation is a list of terms, so that a page or a terminal may break lines between them. A
//! coefficient and the numbers that its expression begins with are one number, with the digits that
//! its standard error warrants. What is no force in the equations (an effect of a sensor or of the
//! drive's phase, one that remembers) stands below them in words.

use std::collections::BTreeMap;

use serde::Serialize;

use super::expression::Printer;
use super::for_people::{MathMl, Text, rounded};
use super::program::terms;
use super::{Notation, Printed};
use crate::identify::units::channel_units;
use crate::model::model_file::Space;
use crate::model::model_file::expression::{
    Expression as E, Function, Node, Symbol, call, divide, multiply, number, power_whole, subtract,
};
use crate::motion::{Acts, Effect, Motion};
use crate::wording::format::{Z95, mathml_number, quantity, shortest, significant, to_digits_of};
use crate::wording::names;
use crate::wording::symbols::{Mark, symbol_mathml, symbol_plain, symbol_plain_marked};

/// A term as it stands behind its sign.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WrittenTerm {
    /// Whether it is subtracted.
    pub negative: bool,
    /// As MathML, without the element `math` around it.
    pub mathml: String,
    /// As plain text.
    pub text: String,
}

/// One equation.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct WrittenEquation {
    /// Terms of the left-hand side.
    pub left: Vec<WrittenTerm>,
    /// Terms of the right-hand side; 0 where there are none.
    pub right: Vec<WrittenTerm>,
}

/// The equations of a model, its numbers in them.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct WrittenOut {
    /// The equations.
    pub equations: Vec<WrittenEquation>,
    /// What the symbols mean, and what is not in the equations: a sentence each.
    pub notes: Vec<String>,
    /// What each coefficient multiplies, by its name: `in equation 1: sin(φ₁)`.
    pub multiplies: BTreeMap<String, String>,
}

/// The number that an expression begins with, and the rest of it.
fn factored(e: &Node) -> (f64, Node) {
    let whole = || (1.0, e.clone());
    let sum = |a: &Node, b: &Node, sign: f64| {
        let ((x, a), (y, b)) = (factored(a), factored(b));
        if x.abs() != y.abs() || x == 0.0 {
            return whole();
        }
        // k a + k b is k (a + b); what comes first has no sign.
        (x, if sign * y * x.signum() > 0.0 { crate::model::model_file::expression::add(a, b) } else { subtract(a, b) })
    };
    match &**e {
        E::Number(x) => (*x, number(1.0)),
        E::Multiply(a, b) => {
            let ((x, a), (y, b)) = (factored(a), factored(b));
            (x * y, multiply(a, b))
        }
        E::Divide(a, b) => {
            let ((x, a), (y, b)) = (factored(a), factored(b));
            if y == 0.0 { whole() } else { (x / y, divide(a, b)) }
        }
        E::PowerWhole(a, n) => {
            let (x, a) = factored(a);
            let k = x.powi(*n);
            if k.is_finite() && k != 0.0 { (k, power_whole(a, *n)) } else { whole() }
        }
        E::Call(Function::Abs, a) => {
            let (x, a) = factored(a);
            (x.abs(), call(Function::Abs, a))
        }
        E::Call(Function::Sign, a) => {
            let (x, a) = factored(a);
            (x.signum(), call(Function::Sign, a))
        }
        E::Add(a, b) => sum(a, b, 1.0),
        E::Subtract(a, b) => sum(a, b, -1.0),
        _ => whole(),
    }
}

/// A model being written.
struct Writer<'a> {
    motion: &'a Motion,
    /// Whether primes are d/dτ of a drive.
    scaled: bool,
}

impl Writer<'_> {
    fn symbol(&self, s: Symbol, primed: bool, as_mathml: bool) -> String {
        let file = &self.motion.file;
        let symbol_of = |name: &str, mark: Mark| {
            if as_mathml { symbol_mathml(name, mark) } else { symbol_plain_marked(name, mark) }
        };
        let rate = if primed && self.scaled { Mark::Prime } else { Mark::Dot };
        let twice = if primed && self.scaled { Mark::DoublePrime } else { Mark::DoubleDot };
        match s {
            Symbol::Coordinate(i) | Symbol::Raw(i) => symbol_of(&file.coordinates[i].name, Mark::None),
            Symbol::Rate(i) | Symbol::ClearRate(i) => symbol_of(&file.coordinates[i].name, rate),
            Symbol::Acceleration(i) => symbol_of(&file.coordinates[i].name, twice),
            Symbol::Input(k) | Symbol::RawInput(k) => symbol_of(&file.inputs[k], Mark::None),
            Symbol::InputRate(k) => symbol_of(&file.inputs[k], Mark::Dot),
            Symbol::Tau => symbol_of("tau", Mark::None),
            Symbol::Time => symbol_of("t", Mark::None),
            // What has states is told in words.
            Symbol::Held(_) | Symbol::State(_) | Symbol::Memory(_) => symbol_of("z", Mark::None),
        }
    }

    /// A term: a number (with its text) times an expression.
    fn term(&self, negative: bool, digits: Option<&str>, e: &Node, primed: bool) -> WrittenTerm {
        let print = |notation: &dyn Notation, as_mathml: bool| -> Printed {
            let symbol = |s: Symbol| self.symbol(s, primed, as_mathml);
            let factor = match digits {
                Some(digits) if as_mathml => mathml_number(digits),
                Some(digits) => digits.to_owned(),
                None => String::new(),
            };
            Printer { language: notation, symbol: &symbol }.term(&factor, e, negative)
        };
        let (mathml, text) = (print(&MathMl, true), print(&Text, false));
        WrittenTerm { negative: text.negative, mathml: mathml.text, text: text.text }
    }

    /// The expression that a coefficient multiplies.
    fn multiplied(&self, equation: usize, e: &Node, primed: bool) -> String {
        let term = self.term(false, None, e, primed);
        format!("in equation {}: {}{}", equation + 1, if term.negative { "−" } else { "" }, term.text)
    }
}

/// The size of a coefficient times the number that its expression begins with, to the digits that
/// its standard error warrants.
pub(super) fn digits(value: f64, std_error: f64, factor: f64) -> String {
    let known = std_error.is_finite() && std_error > 0.0;
    let x = (value * factor).abs();
    if known && value != 0.0 { to_digits_of(x, (Z95 * std_error * factor).abs()) } else { rounded(x) }
}

/// Standard error of an effect's strengths, as they enter the equations.
pub(super) fn strength_error(motion: &Motion, effect: &Effect) -> f64 {
    let relative = (effect.identified.std_error / effect.identified.value).abs();
    // What is known of a whole (a tone's amplitude) is known of its parts (cosine and sine).
    let parts = motion.strengths().filter(|(e, _)| e.name() == effect.name());
    relative * parts.map(|(_, part)| part.value.abs()).fold(0.0, f64::max)
}

/// Writes a model out; none where its equations are not as many as its coordinates.
pub fn written_out(motion: &Motion) -> Option<WrittenOut> {
    if motion.file.equations.len() != motion.file.coordinates.len() {
        return None;
    }
    let scaled = motion.omega().is_some() && motion.file.prime_scale(motion.rig.omega()) != 1.0;
    let writer = Writer { motion, scaled };
    // Coefficients, then strengths: value, standard error, name.
    let mut constants: Vec<(f64, f64, Option<&str>)> =
        motion.coefficients.iter().map(|c| (c.value, c.std_error, Some(c.name.as_str()))).collect();
    for (effect, strength) in motion.strengths().filter(|s| !s.1.adds.is_empty()) {
        constants.push((strength.value, strength_error(motion, effect), None));
    }
    let mut out = WrittenOut {
        equations: vec![WrittenEquation::default(); motion.file.equations.len()],
        ..WrittenOut::default()
    };
    for t in terms(motion) {
        let equation = &mut out.equations[t.equation];
        let Some((value, std_error, name)) = t.constant.map(|c| constants[c]) else {
            // A balance of accelerations stands on the left, where a reader looks for them.
            if t.of.accelerates() {
                let (factor, rest) = factored(&t.of);
                let own = rounded(factor.abs());
                let sign = factor > 0.0;
                equation.left.insert(0, writer.term(sign, (own != "1").then_some(own.as_str()), &rest, t.primed));
            } else {
                equation.right.push(writer.term(false, None, &t.of, t.primed));
            }
            continue;
        };
        if let Some(name) = name {
            let multiplied = writer.multiplied(t.equation, &t.of, t.primed);
            out.multiplies.entry(name.to_owned()).or_insert(multiplied);
        }
        let mut states = Vec::new();
        t.of.memories(&mut states);
        if value == 0.0 || !states.is_empty() {
            continue;
        }
        let (factor, rest) = factored(&t.of);
        let number = digits(value, std_error, factor);
        equation.left.push(writer.term(value * factor < 0.0, Some(&number), &rest, t.primed));
    }
    out.notes = notes(&writer);
    Some(out)
}

/// What the symbols mean, and what acts beside the equations.
fn notes(w: &Writer<'_>) -> Vec<String> {
    let motion = w.motion;
    let (units, inputs) = channel_units(&motion.file, &motion.rig, &motion.bound);
    let name = |n: &String, unit: String| {
        if unit.is_empty() { symbol_plain(n) } else { format!("{} ({unit})", symbol_plain(n)) }
    };
    let coordinates = motion.file.coordinates.iter().zip(&units).map(|(c, u)| {
        // An angle has no dimension, and is in radians.
        let unit = if c.space == Space::Circle { "rad".to_owned() } else { u.to_string() };
        name(&c.name, if unit == "1" { String::new() } else { unit })
    });
    let inputs = motion
        .file
        .inputs
        .iter()
        .zip(&inputs)
        .map(|(n, u)| name(n, Some(u.to_string()).filter(|u| u != "1").unwrap_or_default()));
    let symbols: Vec<String> = coordinates.chain(inputs).collect();
    let mut out = vec![format!("Coordinates: {}. A dot is a derivative by time in seconds.", symbols.join(", "))];
    if let Some(omega) = motion.omega() {
        let hz = shortest(omega / core::f64::consts::TAU);
        let rate = significant(omega, 5);
        let primes = if w.scaled { " A prime ′ is a derivative by τ." } else { "" };
        out.push(format!("τ = Ω t is the drive's phase, Ω = 2π · {hz} Hz = {rate} rad/s.{primes}"));
    }
    out.extend(motion.effects.iter().filter_map(beside));
    out
}

/// An effect that is no force in the equations, in words.
fn beside(e: &Effect) -> Option<String> {
    let sentence = |how: &str| {
        let shapes: Vec<String> = e
            .identified
            .parameters
            .iter()
            .map(|(k, v)| format!(", {} = {}", symbol_plain(k), significant(*v, 4)))
            .collect();
        let name = names::effect(&e.name());
        Some(format!(
            "{how}: {name}, {} ({}){}.",
            quantity(e.identified.value, &e.identified.unit, 4),
            e.equation,
            shapes.concat()
        ))
    };
    match &e.acts {
        Acts::Sensor(..) => sentence("Not in the equations, since only the sensor shows it"),
        Acts::Input(..) => sentence("Not in the equations, since only the record of the input shows it"),
        Acts::Drive(_) => sentence("In the drive's phase"),
        Acts::Motion(_) if e.remembers() => sentence("Also in the equations, with a memory of its own"),
        Acts::Motion(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::model::identified::{IdentifiedModel, System};
    use crate::model::parameter::Parameter;

    fn double_pendulum(effects: Vec<crate::model::identified::AddedEffect>) -> WrittenOut {
        let names = ["B11", "B12", "B13", "B14", "C11", "C12", "B21", "B22", "B23", "B24", "C2"];
        let value = |i: usize| if i == 3 { -0.5 } else { 0.25 + 0.01 * i as f64 };
        let parameter = |(i, n): (usize, &&str)| Parameter {
            name: (*n).to_owned(),
            value: value(i),
            std_error: 1e-5,
            unit: "1".to_owned(),
        };
        let model = IdentifiedModel {
            name: "rig".to_owned(),
            system: System::BuiltIn("double-pendulum".to_owned()),
            method: "weak".to_owned(),
            drive_frequency_hz: Some(5.0),
            nominal: vec!["coulomb-friction@joint1".to_owned(), "viscous-friction@joint2".to_owned()],
            parameters: names.iter().enumerate().map(parameter).collect(),
            effects,
            found_with: BTreeMap::new(),
        };
        written_out(&Motion::of(&model, Path::new("m.toml"), None, 0.0).unwrap()).unwrap()
    }

    /// The text of an equation's left-hand side.
    fn text(e: &WrittenEquation) -> String {
        e.left.iter().map(|t| format!(" {} {}", if t.negative { '−' } else { '+' }, t.text)).collect()
    }

    #[test]
    fn numbers_stand_in_the_equations() {
        let all = double_pendulum(Vec::new());
        assert_eq!(all.equations.len(), 2);
        let first = text(&all.equations[0]);
        assert!(first.starts_with(" + φ₁″ + 0.250000 (φ₂″ cos(φ₂ − φ₁) − φ₂′² sin(φ₂ − φ₁))"), "{first}");
        assert!(first.contains("+ 0.260000 sin(φ₁)") && first.contains("− 0.500000 sin(φ₁) sin(τ)"), "{first}");
        assert!(all.equations[0].right.is_empty() && !first.contains('"'), "{first}");
        let mathml = &all.equations[0].left[1].mathml;
        assert!(mathml.starts_with("<mn>0.250000</mn>") && mathml.contains("<mi>cos</mi>"), "{mathml}");
        // Tags are closed in the order in which they were opened.
        for t in all.equations.iter().flat_map(|e| &e.left) {
            let mut open: Vec<&str> = Vec::new();
            for tag in t.mathml.split('<').skip(1) {
                let tag = tag.split_once('>').unwrap().0;
                match tag.strip_prefix('/') {
                    Some(name) => assert_eq!(open.pop(), Some(name), "{}", t.mathml),
                    None => open.push(tag.split(' ').next().unwrap()),
                }
            }
            assert!(open.is_empty(), "{}", t.mathml);
        }
        assert_eq!(all.multiplies["B12"], "in equation 1: sin(φ₁)");
        assert!(all.notes.iter().any(|n| n.contains("2π · 5 Hz = 31.416 rad/s")), "{:?}", all.notes);
    }

    #[test]
    fn numbers_that_an_expression_begins_with_join_the_coefficient() {
        let x = || crate::model::model_file::expression::symbol(Symbol::Rate(0));
        let y = || crate::model::model_file::expression::symbol(Symbol::Rate(1));
        let e = multiply(number(2.0), multiply(x(), call(Function::Abs, multiply(number(-3.0), x()))));
        let (k, rest) = factored(&e);
        assert_eq!((k, &rest), (6.0, &multiply(x(), call(Function::Abs, x()))));
        let (k, rest) = factored(&subtract(multiply(number(0.5), x()), multiply(number(0.5), y())));
        assert_eq!((k, rest), (0.5, subtract(x(), y())));
        let (k, rest) = factored(&subtract(multiply(number(0.5), x()), y()));
        assert!(k == 1.0 && matches!(*rest, E::Subtract(..)));
    }
}
