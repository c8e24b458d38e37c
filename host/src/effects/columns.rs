//! What an effect of strength one adds to the left-hand side of every equation of a system derived
//! from bodies.
//!
//! Equation e is E_e/D_e = 0, E_e Lagrange's expression and D_e its own inertia (see
//! [`crate::system::equations`]). A force F that does work on s adds −F ∂s/∂q_e. What displaces a
//! point or turns a body or gravity changes T and V: the terms of E_e that are linear in the
//! strength. Both hold products of the system's parameters, whose values come from the
//! identification.

use std::sync::Arc;

use super::along_an_arm;
use super::at_a_point;
use super::between;
use super::entry::{Entry, Form, MASS, Verb};
use super::on_a_frame;
use super::own_spring;
use super::places::{self, Place};
use super::turned::Rotation;
use super::written::{self, Change};
use crate::model::model_file::expression::{Node, Symbol, add, multiply, number, symbol};
use crate::model::model_file::memory::Memory;
use crate::model::model_file::parser::Mistake;
use crate::system::bodies::Body;
use crate::system::derivative::{by_time, partial};
use crate::system::lagrange;
use crate::system::language::SystemFile;
use crate::system::mechanism::{Mechanism, at};
use crate::system::polynomial::{Atom, Polynomial, Product};
use crate::system::words::{Value as Word, Words};

/// The word for the force across a joint.
pub const LOAD: &str = "load";

/// What a strength adds to one equation: a product of the system's parameters times an expression
/// of the motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Which strength.
    pub strength: usize,
    /// Which equation of the model.
    pub equation: usize,
    /// Parameters with their powers.
    pub(super) product: Product,
    /// The expression.
    pub(super) of: Law,
    /// What stands for each [`Symbol::State`] in it.
    pub(super) states: Vec<Node>,
}

impl Part {
    /// The expression at values of the parameters.
    fn at(&self, parameters: &[f64]) -> Node {
        let of = self.of.at(parameters);
        if self.states.is_empty() {
            return of;
        }
        of.replace(&|s| if let Symbol::State(k) = s { self.states[k].clone() } else { symbol(s) })
    }
}

/// An expression of the motion.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Law {
    /// One without parameters.
    Motion(Node),
    /// One with parameters inside functions, whose values are put in where columns are made: the
    /// load of a joint, fixed over the equation's inertia.
    Load(Polynomial),
    /// The same of speeds, fixed by themselves.
    Speeds(Polynomial),
    /// A number times one without parameters, behind squares of moments ([`on_a_frame::ratios`]).
    Momentum(f64, Node),
    /// The same over the equation's inertia already ([`super::changes::at_values`]).
    Given(f64, Node),
}

impl Law {
    fn of_load(p: Polynomial) -> Self {
        if p.has_parameter() { Self::Load(p) } else { Self::Motion(p.node()) }
    }

    /// Of speeds, with the lengths in them.
    pub(super) fn of_speeds(p: Polynomial) -> Self {
        if p.has_parameter() { Self::Speeds(p) } else { Self::Motion(p.node()) }
    }

    pub(super) fn at(&self, parameters: &[f64]) -> Node {
        match self {
            Self::Motion(of) | Self::Given(_, of) => of.clone(),
            Self::Momentum(factor, of) => multiply(number(*factor), of.clone()),
            Self::Load(of) | Self::Speeds(of) => of.node_at(parameters),
        }
    }
}

/// How an effect in one form acts at a place.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// On the left-hand sides.
    Force(Vec<Part>),
    /// On what a sensor shows: additions to it by x and v ([`Symbol::Coordinate`] and
    /// [`Symbol::Rate`] 0), one for each strength.
    Reads {
        /// Sensor.
        sensor: usize,
        /// Additions.
        laws: Vec<Node>,
    },
    /// On what is recorded of a measured input: additions to it, as for a sensor.
    Records {
        /// Input.
        input: usize,
        /// Additions.
        laws: Vec<Node>,
    },
    /// On the drive's phase: radians by t for each strength.
    Advances(Vec<Node>),
    /// On the left-hand sides of written equations, whose coefficients take part.
    Changes(Vec<Change>),
}

/// The record's beginning and length, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Time of the first sample.
    pub start_s: f64,
    /// Length.
    pub length_s: f64,
}

/// How an entry acts at a place; none where it adds nothing there.
///
/// # Errors
/// A law that has no meaning at this place.
pub fn action(
    entry: &Entry,
    form: &Form,
    place: Place,
    mechanism: &Mechanism,
    parameters: &[f64],
    omega: f64,
    span: Span,
) -> Result<Option<Action>, Mistake> {
    let Some(file) = mechanism.file.as_deref() else { return Ok(None) };
    if file.written && (matches!(entry.verb, Verb::Moves | Verb::Turns) || entry.names(LOAD)) {
        let psi = parameters.last().copied().unwrap_or(0.0);
        return Ok(written::changes(entry, form, place, file, span, omega, psi).map(Action::Changes));
    }
    let own = file.parameters.len();
    let mut words = Words { parameters: vec![String::new(); own], ..Words::default() };
    let time = Polynomial::motion(Symbol::Time).plus(&Polynomial::number(-span.start_s));
    words.scalars.push(("t".to_owned(), time));
    words.constants.push(("T".to_owned(), span.length_s));
    let n = file.coordinates.len();
    match (place, entry.verb) {
        (Place::Joint(_) | Place::Between(..), Verb::Force) => {
            let Some(moves) = place.moves(file) else { return Ok(None) };
            let Ok(rate) = by_time(&moves, n, omega) else { return Ok(None) };
            let x = own_spring::displacement(file, &moves);
            words.scalars.extend([("x".to_owned(), x), ("v".to_owned(), rate)]);
            words.on_line = !places::is_angle(file, &moves);
            if let (Place::Joint(k), true) = (place, entry.names(LOAD)) {
                let mass = form.iter().find(|s| s.0 == MASS).map(|s| s.1);
                let Some(load) = places::load(file, k, omega, mass) else { return Ok(None) };
                words.scalars.push((LOAD.to_owned(), load));
            }
            let Word::Scalar(law) = entry.law(&words, form)? else { return Ok(None) };
            let law = own_spring::beside(entry, law, file, &moves);
            let on = match place {
                Place::Between(i, j) => between::works_on((i, j), form, mechanism, parameters),
                _ => moves,
            };
            remembering(entry, &words, form, work(mechanism, &law, &on, own))
        }
        (Place::Arm(k), Verb::Force) => {
            let Some(angle) = file.bodies[k].value.angle() else { return Ok(None) };
            let Ok(rate) = by_time(angle, n, omega) else { return Ok(None) };
            words.scalars.push(("omega".to_owned(), rate));
            let Word::Scalar(law) = entry.law(&words, form)? else { return Ok(None) };
            remembering(entry, &words, form, work(mechanism, &law, angle, own))
        }
        (Place::Arm(k), Verb::Drags) if !file.written => {
            let found = along_an_arm::parts(entry, form, k, mechanism, words, omega)?;
            Ok(found.map(Action::Force))
        }
        (Place::Body(k), Verb::Drags) => {
            let found = at_a_point::parts(entry, form, k, mechanism, words, omega)?;
            Ok(found.map(Action::Force))
        }
        (Place::Drive, Verb::Moves) => {
            let Some(drive) = places::drive(file) else { return Ok(None) };
            let axis =
                |k: usize| (0..drive.components).map(|i| Polynomial::number(f64::from(u8::from(i == k)))).collect();
            let across = if drive.along == 0 { drive.components - 1 } else { 0 };
            words.points = vec![("along".to_owned(), axis(drive.along)), ("across".to_owned(), axis(across))];
            words.constants.push((places::SIZE.to_owned(), places::size(&drive.y, parameters)));
            words.scalars.push(("y".to_owned(), drive.y.clone()));
            let Word::Vector(law) = entry.law(&words, form)? else { return Ok(None) };
            Ok(changed(mechanism, &displaced(file, &law), own, omega))
        }
        (Place::Frame, Verb::Moves) => {
            Ok(on_a_frame::parts(entry, form, mechanism, parameters, words, omega)?.map(Action::Force))
        }
        (Place::Drive, Verb::Advances) => {
            let Word::Scalar(law) = entry.law(&words, form)? else { return Ok(None) };
            Ok(Some(Action::Advances(by_strength(&law, own, entry.strengths.len()))))
        }
        (Place::Arm(k), Verb::Turns) => {
            let Word::Scalar(law) = entry.law(&words, form)? else { return Ok(None) };
            let by = Rotation::of(entry, &law, own);
            Ok(by.and_then(|r| r.arm(file, k)).and_then(|f| changed(mechanism, &f, own, omega)))
        }
        (Place::Frame, Verb::Turns) => {
            let Word::Scalar(law) = entry.law(&words, form)? else { return Ok(None) };
            let by = Rotation::of(entry, &law, own);
            Ok(by.and_then(|r| r.frame(file)).and_then(|f| changed(mechanism, &f, own, omega)))
        }
        (Place::Encoder(_) | Place::Input(_), Verb::Reads) => {
            let x = Polynomial::motion(Symbol::Coordinate(0));
            words.scalars.extend([("x".to_owned(), x.clone()), ("v".to_owned(), Polynomial::motion(Symbol::Rate(0)))]);
            let Word::Scalar(law) = entry.law(&words, form)? else { return Ok(None) };
            let laws = by_strength(&law.minus(&x), own, entry.strengths.len());
            Ok(Some(match place {
                Place::Input(input) => Action::Records { input, laws },
                Place::Encoder(sensor) => Action::Reads { sensor, laws },
                _ => return Ok(None),
            }))
        }
        _ => Ok(None),
    }
}

/// A force whose states are followed by the laws of their rates; none where these hold parameters
/// of the system, whose values change as it is identified.
fn remembering(entry: &Entry, words: &Words, form: &Form, force: Option<Action>) -> Result<Option<Action>, Mistake> {
    let Some(Action::Force(mut parts)) = force else { return Ok(force) };
    if !entry.states.is_empty() {
        let Some(states) = entry.followed(words, form)? else { return Ok(None) };
        parts.iter_mut().for_each(|p| p.states.clone_from(&states));
    }
    Ok(Some(Action::Force(parts)))
}

impl Action {
    /// The same with each state of an effect that remembers replaced.
    #[must_use]
    pub fn with_memories(mut self, with: &dyn Fn(&Arc<Memory>, usize) -> Node) -> Self {
        if let Self::Force(parts) = &mut self {
            parts.iter_mut().flat_map(|p| &mut p.states).for_each(|s| *s = s.with_memories(with));
        }
        self
    }

    /// What stands for states in it.
    pub fn states(&self) -> impl Iterator<Item = &Node> {
        let parts = if let Self::Force(parts) = self { &parts[..] } else { &[] };
        parts.iter().flat_map(|p| &p.states)
    }
}

/// Quotients N/D of sums of products of parameters that must be fixed for columns of these parts to
/// be: what stands inside functions, over the inertia of the equation. A function of the load other
/// than itself needs the inertia alone as well.
pub fn quotients(parts: &[Part], mechanism: &Mechanism) -> Vec<(Polynomial, Polynomial)> {
    fn inside(p: &Polynomial, per: &Polynomial, out: &mut Vec<(Polynomial, Polynomial)>) {
        for (a, _) in p.terms().flat_map(|(product, _)| product) {
            if let Atom::Call(_, q) | Atom::Sum(q) = a {
                let own = q.by_motion().into_values().filter(Polynomial::has_own_parameter);
                out.extend(own.map(|n| (n, per.clone())));
                inside(q, per, out);
            }
        }
    }
    let mut out = Vec::new();
    let one = Polynomial::number(1.0);
    for part in parts {
        let Some((_, inertia)) = mechanism.scales.get(part.equation) else { continue };
        match &part.of {
            Law::Motion(_) | Law::Momentum(..) | Law::Given(..) => {}
            Law::Speeds(of) => inside(of, &one, &mut out),
            Law::Load(of) => {
                inside(of, inertia, &mut out);
                let loads = |(a, n): &(Atom, i32)| *n != 1 && Polynomial::atom(a.clone()).has_parameter();
                if of.terms().any(|(product, _)| product.iter().any(loads)) {
                    out.push((inertia.clone(), one.clone()));
                }
            }
        }
    }
    out.extend(on_a_frame::ratios(parts, mechanism));
    out
}

/// What each strength multiplies in a law without other parameters.
fn by_strength(law: &Polynomial, own: usize, count: usize) -> Vec<Node> {
    let parts = law.by_parameters();
    (0..count)
        .map(|k| parts.get(&vec![(Atom::Parameter(own + k), 1)]).map_or_else(|| number(0.0), Polynomial::node))
        .collect()
}

/// The parts of an expression of equation `equation` that are linear in one strength.
pub(super) fn parts_of(
    e: &Polynomial,
    equation: usize,
    own: usize,
    law: &dyn Fn(Polynomial) -> Law,
    out: &mut Vec<Part>,
) {
    for (product, of) in e.by_parameters() {
        let strengths: Vec<(usize, i32)> = product
            .iter()
            .filter_map(|(a, n)| if let Atom::Parameter(k) = a { (*k >= own).then(|| (*k - own, *n)) } else { None })
            .collect();
        if let [(strength, 1)] = strengths[..] {
            let rest: Product =
                product.into_iter().filter(|(a, _)| !matches!(a, Atom::Parameter(k) if *k >= own)).collect();
            out.push(Part { strength, equation, product: rest, of: law(of), states: Vec::new() });
        }
    }
}

/// A force that does work on a displacement.
fn work(mechanism: &Mechanism, force: &Polynomial, on: &Polynomial, own: usize) -> Option<Action> {
    let mut out = Vec::new();
    for (equation, (coordinate, _)) in mechanism.scales.iter().enumerate() {
        let along = partial(on, &Atom::Motion(Symbol::Coordinate(*coordinate))).ok()?;
        if !along.is_zero() {
            parts_of(&force.times(&along).ok()?.scaled(-1.0), equation, own, &Law::of_load, &mut out);
        }
    }
    (!out.is_empty()).then_some(Action::Force(out))
}

/// What of Lagrange's equations of a changed system is linear in the strengths.
fn changed(mechanism: &Mechanism, file: &SystemFile, own: usize, omega: f64) -> Option<Action> {
    let equations = lagrange::equations(file, &[], omega).ok()?;
    let mut out = Vec::new();
    for (equation, (coordinate, _)) in mechanism.scales.iter().enumerate() {
        for column in &equations[*coordinate] {
            let whole = column.of.times(&Polynomial::product(column.product.clone(), 1.0)).ok()?;
            parts_of(&whole, equation, own, &Law::of_load, &mut out);
        }
    }
    (!out.is_empty()).then_some(Action::Force(out))
}

/// The system with everything that the driven point carries displaced.
fn displaced(file: &SystemFile, by: &[Polynomial]) -> SystemFile {
    let mut out = file.clone();
    let carried = |v: &[Polynomial]| v.iter().any(|p| p.moves(|s| s == Symbol::Tau));
    for body in &mut out.bodies {
        let point = match &mut body.value {
            Body::Arm { from, .. } => Some(from),
            Body::Free { centroid, .. } => centroid.as_mut(),
        };
        if let Some(point) = point.filter(|p| carried(p)) {
            for (x, d) in point.iter_mut().zip(by) {
                *x = x.plus(d);
            }
        }
    }
    out
}

/// Columns of the parts at values of the parameters: for each strength its additions to the
/// equations.
pub fn columns(parts: &[Part], strengths: usize, mechanism: &Mechanism, parameters: &[f64]) -> Vec<Vec<(usize, Node)>> {
    let scale: Vec<f64> = mechanism.scales.iter().map(|(_, d)| 1.0 / at(d, parameters)).collect();
    // What several bodies add alike is one term.
    let mut alike: Vec<Vec<(usize, Node, f64)>> = vec![Vec::new(); strengths];
    for part in parts {
        let factor = match part.of {
            Law::Given(factor, _) => factor,
            _ => at(&Polynomial::product(part.product.clone(), 1.0), parameters) * scale[part.equation],
        };
        let (of, all) = (part.at(parameters), &mut alike[part.strength]);
        match all.iter_mut().find(|t| t.0 == part.equation && t.1 == of) {
            Some(t) => t.2 += factor,
            None => all.push((part.equation, of, factor)),
        }
    }
    let mut out: Vec<Vec<(usize, Node)>> = vec![Vec::new(); strengths];
    for (column, all) in out.iter_mut().zip(alike) {
        for (equation, of, factor) in all {
            let of = multiply(number(factor), of);
            match column.iter_mut().find(|c| c.0 == equation) {
                Some(c) => c.1 = add(c.1.clone(), of),
                None => column.push((equation, of)),
            }
        }
    }
    out
}

#[cfg(test)]
#[path = "columns_tests.rs"]
mod tests;
