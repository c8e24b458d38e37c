//! What a model is made of, ready to be printed: names, constants with their comments, terms split
//! into mass matrix and right-hand side.

use super::expression::{Printer, uses};
use super::names::Names;
use super::remarks::{error_text, rounded, unit_text};
use super::written_out::strength_error;
use super::{Language, Printed};
use crate::error::{BadInput, Result};
use crate::identify::units::channel_units;
use crate::model::identified::AddedEffect;
use crate::model::model_file::Space;
use crate::model::model_file::expression::{Function, Node, Symbol, multiply, number};
use crate::model::model_file::split::{Entry, Split};
use crate::motion::effects::bad;
use crate::motion::{Acts, Motion};

/// Unit of a strength that is not the effect's value, but what the equations hold of it.
const AS_IT_ENTERS: &str = "as in its equation";

/// A coordinate.
pub struct Coordinate {
    /// Its name.
    pub name: String,
    /// Name of its rate a second.
    pub rate: String,
    /// Name of its derivative by the drive's phase.
    pub prime: String,
    /// Its unit.
    pub unit: String,
    /// Whether it has to be wrapped to [−π, π) first: something is not periodic in it.
    pub wraps: bool,
}

/// A number with a name.
pub struct Constant {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Unit, standard error, what it belongs to.
    pub about: String,
    /// Its name in the model's file.
    pub own: String,
    /// Its standard error; NaN where it is not known, or has none.
    pub std_error: f64,
    /// Its unit.
    pub unit: String,
    /// The effect that it is a strength of, where what enters the equations is not its value.
    pub stands_for: Option<AddedEffect>,
}

/// A term of an equation as the model's file has it: coefficient (none for the balance),
/// expression, whether primes are its derivatives.
pub struct Term {
    /// Equation.
    pub equation: usize,
    /// Index of its constant; none for the balance.
    pub constant: Option<usize>,
    /// What it multiplies.
    pub of: Node,
    /// Whether its rates are derivatives by the model's own time, not by seconds.
    pub primed: bool,
}

/// A model, ready to be printed.
pub struct Program<'a> {
    /// The model.
    pub motion: &'a Motion,
    /// The language.
    pub language: &'static dyn Language,
    /// Name of the whole.
    pub name: String,
    /// Coordinates.
    pub coordinates: Vec<Coordinate>,
    /// Inputs: name, unit.
    pub inputs: Vec<(String, String)>,
    /// Coefficients, then strengths of effects.
    pub constants: Vec<Constant>,
    /// Name of Ω and its value, rad/s, where there is a drive.
    pub omega: Option<(String, f64)>,
    /// Whether primes are d/dτ of a drive.
    pub scaled: bool,
    /// Every term, unsplit.
    pub terms: Vec<Term>,
    /// Every term, split.
    pub split: Split,
    /// Whether each of the split terms is primed.
    primed: Vec<bool>,
    /// Names of the signs of dry friction.
    pub signs: Vec<String>,
    /// Name of the drive's phase.
    pub tau: String,
    /// Name of the time.
    pub time: String,
}

/// Refuses an effect whose force is a function of accelerations: code holds a mass matrix and a
/// right-hand side.
fn solvable(motion: &Motion) -> Result<()> {
    for (index, effect) in motion.effects.iter().enumerate() {
        let Acts::Motion(list) = &effect.acts else { continue };
        let laws = list.iter().flat_map(|s| &s.adds);
        if laws.into_iter().any(|(_, of)| !of.is_linear_in_accelerations()) {
            let remedy = "Leave this effect out of the file, or simulate it with `whirl simulate --model`";
            let expected = "an effect that is linear in accelerations";
            return Err(bad(index, &effect.identified, "whose force depends on accelerations", expected, remedy));
        }
    }
    Ok(())
}

impl<'a> Program<'a> {
    /// Prepares a model for a language; `stem` is the stem of the file's name.
    ///
    /// # Errors
    /// A number of equations that differs from that of the coordinates, a coefficient that is no
    /// finite number, an effect whose accelerations the equations cannot be solved for.
    pub fn new(motion: &'a Motion, language: &'static dyn Language, stem: &str) -> Result<Self> {
        // Refuses what code cannot follow: too few equations, effects with states.
        motion.equations()?;
        solvable(motion)?;
        let mut names = Names::new(language.reserved());
        // A file's name is no name within it.
        let name = Names::new(language.reserved()).give(if stem.is_empty() { "identified" } else { stem });
        let (units, input_units) = channel_units(&motion.file, &motion.rig, &motion.bound);
        let omega = motion.omega().map(|w| ("OMEGA".to_owned(), w));
        let scaled = omega.is_some() && motion.file.prime_scale(motion.rig.omega()) != 1.0;
        let coordinates = motion
            .file
            .coordinates
            .iter()
            .zip(&units)
            .map(|(c, unit)| Coordinate {
                // An angle has no dimension, and is in radians.
                unit: if c.space == Space::Circle { "rad".to_owned() } else { unit_text(&unit.to_string()) },
                name: names.give(&c.name),
                rate: names.give(&format!("v_{}", c.name)),
                prime: names.give(&format!("{}_tau", c.name)),
                wraps: false,
            })
            .collect();
        let inputs = motion.file.inputs.iter().zip(&input_units);
        let inputs = inputs.map(|(n, unit)| (names.give(n), unit_text(&unit.to_string()))).collect();
        let constants = constants(motion, &mut names)?;
        let mut out = Self {
            motion,
            language,
            name,
            coordinates,
            inputs,
            constants,
            omega,
            scaled,
            terms: terms(motion),
            split: Split::of(motion.file.coordinates.len()),
            primed: Vec::new(),
            signs: Vec::new(),
            tau: "tau".to_owned(),
            time: "t".to_owned(),
        };
        for t in &out.terms {
            out.split.put(t.equation, t.constant, &t.of);
            out.primed.resize(out.split.nodes.len(), t.primed);
        }
        out.signs = (1..=out.split.switches.len()).map(|k| names.give(&format!("s{k}"))).collect();
        for (i, circle) in motion.file.circle().into_iter().enumerate() {
            out.coordinates[i].wraps = circle && out.split.nodes.iter().any(|n| !is_periodic(n, i));
        }
        Ok(out)
    }

    /// Parts of the template that this model needs.
    pub fn sections(&self) -> Vec<(&'static str, bool)> {
        let uses = |f: Option<Function>| self.split.nodes.iter().any(|n| uses(n, f));
        let events = !self.signs.is_empty();
        let wraps = self.coordinates.iter().any(|c| c.wraps) || uses(Some(Function::Wrap));
        vec![
            ("events", events),
            ("plain", !events),
            ("sign", events || uses(Some(Function::Sign))),
            ("wrap", wraps),
            ("hat", uses(None)),
            ("pi", wraps),
            ("solve", self.coordinates.len() > 1),
            ("single", self.coordinates.len() == 1),
            ("inputs", !self.inputs.is_empty()),
            ("drive", self.omega.is_some()),
            ("tau", self.depends(|s| s == Symbol::Tau)),
            ("scaled", self.scaled),
        ]
    }

    /// Whether some term depends on a symbol.
    pub fn depends(&self, wanted: impl Fn(Symbol) -> bool) -> bool {
        self.split.nodes.iter().any(|n| n.any(&wanted))
    }

    /// Whether some primed term depends on the rate of a coordinate.
    pub fn needs_prime(&self, i: usize) -> bool {
        let mut primed = self.split.nodes.iter().zip(&self.primed).filter(|(_, p)| **p);
        self.scaled && primed.any(|(n, _)| n.any(&|s| s == Symbol::Rate(i)))
    }

    /// Functions that are called.
    pub fn calls(&self, f: Function) -> bool {
        self.split.nodes.iter().any(|n| uses(n, Some(f)))
    }

    /// Name of a symbol in code.
    pub fn symbol(&self, s: Symbol, primed: bool) -> String {
        match s {
            Symbol::Coordinate(i) | Symbol::Raw(i) => self.coordinates[i].name.clone(),
            Symbol::Rate(i) | Symbol::ClearRate(i) if primed && self.scaled => self.coordinates[i].prime.clone(),
            Symbol::Rate(i) | Symbol::ClearRate(i) => self.coordinates[i].rate.clone(),
            Symbol::Input(k) | Symbol::RawInput(k) | Symbol::InputRate(k) => self.inputs[k].0.clone(),
            Symbol::Tau => self.tau.clone(),
            Symbol::Time => self.time.clone(),
            Symbol::Held(k) => self.signs[k].clone(),
            // Split terms have none.
            Symbol::Acceleration(_) => String::new(),
            // Models with states are refused in the beginning.
            Symbol::State(_) | Symbol::Memory(_) => String::new(),
        }
    }

    /// Terms of the mass matrix' element (e, i), or with no acceleration those of the right-hand
    /// side of equation e.
    pub fn sum(&self, equation: usize, acceleration: Option<usize>) -> Vec<Printed> {
        let wanted = |e: &Entry| e.equation == equation && e.acceleration == acceleration;
        let all = self.split.entries.iter().zip(&self.split.nodes).zip(&self.primed);
        all.filter(|((e, _), _)| wanted(e))
            .map(|((e, node), primed)| {
                let symbol = |s: Symbol| self.symbol(s, *primed);
                let printer = Printer { language: self.language, symbol: &symbol };
                let factor = e.coefficient.map_or("", |c| &self.constants[c].name);
                // The unknowns are q″: what multiplies accelerations a second is Ω² as large.
                let square = if *primed || !self.scaled { 1.0 } else { self.omega.as_ref().map_or(1.0, |o| o.1 * o.1) };
                let node = if acceleration.is_some() { multiply(number(square), node.clone()) } else { node.clone() };
                // Terms stand on the left, the balance on the right.
                printer.term(factor, &node, e.coefficient.is_some() != acceleration.is_some())
            })
            .collect()
    }

    /// A constant sum of one number, such as an element of a mass matrix that is 1.
    pub fn is_empty(&self, equation: usize, acceleration: Option<usize>) -> bool {
        !self.split.entries.iter().any(|e| e.equation == equation && e.acceleration == acceleration)
    }

    /// The weights of the rates whose sum's sign is held, as texts.
    pub fn switch(&self, k: usize) -> Vec<String> {
        self.split.switches[k].weights.iter().map(|w| self.signed(*w)).collect()
    }

    /// A number with its sign.
    pub fn signed(&self, x: f64) -> String {
        if x.is_sign_negative() && x != 0.0 {
            format!("-{}", self.language.number(-x))
        } else {
            self.language.number(x.abs())
        }
    }

    /// The linear form of the rates whose sign a switch is.
    pub fn form(&self, k: usize) -> String {
        let mut out = String::new();
        for (w, c) in self.split.switches[k].weights.iter().zip(&self.coordinates).filter(|(w, _)| **w != 0.0) {
            let term = if w.abs() == 1.0 {
                c.rate.clone()
            } else {
                self.language.product(&self.language.number(w.abs()), &c.rate)
            };
            out.push_str(match (out.is_empty(), *w < 0.0) {
                (true, false) => "",
                (true, true) => "-",
                (false, false) => " + ",
                (false, true) => " - ",
            });
            out.push_str(&term);
        }
        out
    }

    /// The example's initial state, as texts.
    pub fn initial(&self) -> Vec<String> {
        self.motion.example().iter().map(|x| self.signed(*x)).collect()
    }

    /// Names of the state: coordinates, then rates.
    pub fn state(&self) -> Vec<&str> {
        let rates = self.coordinates.iter().map(|c| c.rate.as_str());
        self.coordinates.iter().map(|c| c.name.as_str()).chain(rates).collect()
    }
}

/// Whether two numbers are one but for sign and rounding.
fn same(a: f64, b: f64) -> bool {
    (a.abs() - b.abs()).abs() <= 1e-9 * b.abs()
}

/// Coefficients, then strengths.
fn constants(motion: &Motion, names: &mut Names) -> Result<Vec<Constant>> {
    let mut out = Vec::new();
    for c in &motion.coefficients {
        out.push(Constant {
            name: names.give(&c.name),
            value: c.value,
            about: format!(
                "{}; {}",
                if c.unit == "1" || c.unit.is_empty() { "no unit" } else { &c.unit },
                error_text(c.std_error)
            ),
            own: c.name.clone(),
            std_error: c.std_error,
            unit: c.unit.clone(),
            stands_for: None,
        });
    }
    for (effect, strength) in motion.strengths().filter(|s| !s.1.adds.is_empty()) {
        let own = match strength.name.as_str() {
            "" => effect.name(),
            name => format!("{} {name}", effect.name()),
        };
        let found = &effect.identified;
        // What enters as the effect's value does has its unit; else it is divided by others.
        let is_value = same(strength.value, found.value);
        let is_all = strength.name.is_empty();
        let physical = format!("{} {}", rounded(found.value), if found.unit == "1" { "" } else { &found.unit });
        let physical = match (is_value, is_all) {
            (true, _) => String::new(),
            (false, true) => format!(" ({})", physical.trim_end()),
            (false, false) => format!(" (of the effect as a whole: {})", physical.trim_end()),
        };
        out.push(Constant {
            name: names.give(&own),
            value: strength.value,
            about: format!("strength of {}{physical}, as it enters the equations", effect.name()),
            own,
            std_error: strength_error(motion, effect),
            unit: if is_value { found.unit.clone() } else { AS_IT_ENTERS.to_owned() },
            stands_for: (!is_value && is_all).then(|| found.clone()),
        });
    }
    match out.iter().find(|c| !c.value.is_finite()) {
        None => Ok(out),
        Some(c) => Err(BadInput::new(c.value.to_string(), "a finite number")
            .at(format!("parameters.{}", c.own))
            .remedy("Identify the model anew: this coefficient was not determined")),
    }
}

/// Every term; those of effects behind the file's own.
pub(super) fn terms(motion: &Motion) -> Vec<Term> {
    let names = motion.file.coefficients();
    let mut out = Vec::new();
    for (equation, e) in motion.file.equations.iter().enumerate() {
        for t in &e.terms {
            let constant = names.iter().position(|n| *n == t.name);
            out.push(Term { equation, constant, of: t.of.clone(), primed: true });
        }
        out.push(Term { equation, constant: None, of: e.balance.clone(), primed: true });
    }
    for (k, (_, strength)) in motion.strengths().filter(|s| !s.1.adds.is_empty()).enumerate() {
        let constant = Some(names.len() + k);
        let adds = strength.adds.iter();
        out.extend(adds.map(|(equation, of)| Term { equation: *equation, constant, of: of.clone(), primed: false }));
    }
    out
}

/// Whether an expression has the period 2π in a coordinate, by its values at a few states.
fn is_periodic(e: &Node, i: usize) -> bool {
    let at = |k: f64, turns: f64| {
        e.value(&|s| match s {
            Symbol::Coordinate(j) if j == i => 0.37 * k - 1.1 + turns * core::f64::consts::TAU,
            Symbol::Coordinate(j) => 0.3 + 0.17 * j as f64 * k,
            _ => 0.5 + 0.11 * k,
        })
    };
    (0..6).all(|k| {
        let (a, b) = (at(f64::from(k), 0.0), at(f64::from(k), 1.0));
        (a - b).abs() <= 1e-9 * (1.0 + a.abs())
    })
}
