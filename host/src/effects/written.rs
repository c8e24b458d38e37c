//! Effects on equations that a user wrote down: where they act, and what a strength of one adds
//! there.
//!
//! A written equation F_e = Σ λ_j X_j − Y = 0 is Lagrange's equation of coordinate q_e over some
//! D_e. Mechanics makes D_e known up to one factor: inertias are symmetric, D_i ∂F_i/∂q̈_j = D_j
//! ∂F_j/∂q̈_i, and so are forces that have a potential, D_i ∂F_i/∂q_j = D_j ∂F_j/∂q_i at rest (for
//! coordinates that share no inertia). The first coordinate of those that are coupled has D = ±1,
//! the sign of its inertia, so that its strengths are in the equation's own unit.
//!
//! * A force f along s adds −(f/D_e) ∂s/∂q_e, as for a system of bodies.
//! * G_e, the part of F_e that the drive's phase moves at rest, is K_e(q) ÿ₀ with y₀ = a cos(τ −
//!   ψ): a base that moves by y as well adds K_e ÿ along the drive, and K_e with all angles turned
//!   by a quarter across it.
//! * Gravity is the part f of F_e that rests on sines and cosines of angles alone. What is turned by
//!   β adds sin β D f + (1 − cos β) D² f, exactly so where angles stand there once (`turned.rs`):
//!   D is −Σ_i ∂/∂φ_i for a frame, ∂/∂φ_k for a centroid off the line of arm k, in equation k and of
//!   f + G_k. An arm on which no joint hangs turns with all of itself: what rests on angles in every
//!   equation, as if its encoder had another zero.

mod inertias;
mod left_hand_sides;
pub mod load;

use core::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use self::inertias::apart;
pub use self::inertias::{Inertias, inertias};
use self::left_hand_sides::{STATES, at_rest, of_angles, sides, value};
use self::load::{Equations, Hung};
use super::columns::{LOAD, Span};
use super::entry::{At, Entry, Form, MASS};
use super::places::{Place, SIZE};
use super::turned::Rotation;
use crate::model::model_file::expression::{
    Function, Node, Symbol, add, as_number, multiple, multiply, number, subtract, symbol,
};
use crate::model::model_file::units::{self, Unit};
use crate::model::model_file::{ModelFile, Space};
use crate::rig::Direction;
use crate::system::bodies::Body;
use crate::system::derivative::{by_time, partial};
use crate::system::forces::Force;
use crate::system::joints::Joint;
use crate::system::language::{Gravity, Parameter, Placed, SystemFile};
use crate::system::mechanism::{Mechanism, Named};
use crate::system::polynomial::{Atom, Polynomial};
use crate::system::words::{Value as Word, Words};

/// What a strength of one does of a rotation.
#[derive(Clone, Debug, PartialEq)]
pub struct Turn {
    /// Of its sine.
    sine: Node,
    /// Of 1 − cos.
    versine: Node,
}

impl Turn {
    /// What it adds, by the derivative along the rotation.
    fn of(&self, still: &Node, along: &dyn Fn(&Node) -> Node) -> Node {
        let first = along(still);
        let second = if as_number(&self.versine) == Some(0.0) { number(0.0) } else { along(&first) };
        add(multiply(self.sine.clone(), first), multiply(self.versine.clone(), second))
    }
}

/// What a strength of one does beside forces.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// Second derivatives by τ of the base's displacement along and across the drive, in units of
    /// the drive's amplitude.
    Moves {
        /// Along the drive.
        along: Node,
        /// Across it.
        across: Node,
    },
    /// Turns the centroid of the arm with this coordinate, on which nothing hangs or something
    /// does.
    Arm(usize, bool, Turn),
    /// Turns gravity.
    Frame(Turn),
    /// Does work at a joint on which arms hang, by their load ([`Symbol::State`] 0 in it) for a mass
    /// in units of the nearest arm's own inertia.
    Load(Hung, f64, Node),
}

/// Whether effects find their places in a model's equations: written ones, one for each coordinate.
pub fn applies(model: &ModelFile) -> bool {
    let derived = model.mechanism.as_ref().is_some_and(|m| !m.coefficients.is_empty());
    !derived && model.equations.len() == model.coordinates.len()
}

/// Values of what the mechanism of a written model rests on: D_e of every equation, then ψ.
pub fn parameters(model: &ModelFile, direction: Option<Direction>, omega: f64, values: &[f64]) -> Option<Vec<f64>> {
    let mut out = inertias(model, omega, values)?.scales;
    out.push(driven(model, &at_rest(model, omega, values), direction).psi);
    Some(out)
}

/// Places of a written model: its own joints and arms where it names them; otherwise every
/// coordinate is both, under its own name (what moves along a line meets drag as well), and the
/// difference of two that are coupled is a joint `q2-q1`.
pub fn mechanism(model: &ModelFile, direction: Option<Direction>, omega: f64, values: &[f64]) -> Option<Mechanism> {
    let Inertias { coupled: pairs, springs, .. } = inertias(model, omega, values)?;
    let declared = model.mechanism.as_deref().and_then(|m| m.file.as_deref());
    let coordinate = |k: usize| Polynomial::motion(Symbol::Coordinate(k));
    let name = |k: usize| model.coordinates[k].name.clone();
    let circle = |k: usize| model.coordinates[k].space == Space::Circle;
    let joint = |name: String, moves: Polynomial| {
        let moves = Placed { value: moves, at: 0 };
        Joint { name, at: None, moves, carries: Vec::new() }
    };
    let n = model.coordinates.len();
    let mut joints: Vec<Joint> = declared.map_or_else(Vec::new, |f| f.joints.clone());
    if joints.is_empty() {
        joints = (0..n).map(|k| joint(name(k), coordinate(k))).collect();
        let alike = pairs.iter().filter(|(i, j)| circle(*i) == circle(*j));
        joints.extend(
            alike.map(|&(i, j)| joint(format!("{}-{}", name(j), name(i)), coordinate(j).minus(&coordinate(i)))),
        );
    }
    let arm = |name: String, angle: Polynomial| {
        let (from, along) = (vec![Polynomial::default(); 2], vec![Polynomial::default(); 2]);
        let (mass, first_moment, inertia) = Default::default();
        Placed { value: Body::Arm { name, angle: Some(angle), from, along, mass, first_moment, inertia }, at: 0 }
    };
    let mut bodies: Vec<Placed<Body>> = declared.map_or_else(Vec::new, |f| {
        let named = f.bodies.iter().filter_map(|b| match &b.value {
            Body::Free { name, turns: Some((angle, _)), .. } => Some(arm(name.clone(), angle.clone())),
            _ => None,
        });
        named.collect()
    });
    if bodies.is_empty() {
        bodies = (0..n).map(|k| arm(name(k), coordinate(k))).collect();
    }
    let mut parameters: Vec<String> = (0..n).map(|k| format!("inertia of {}", name(k))).collect();
    parameters.push("phase of the drive".to_owned());
    let mut words = Words { parameters: parameters.clone(), ..Words::default() };
    words.coordinates = (0..n).map(name).collect();
    words.inputs.clone_from(&model.inputs);
    let driven = at_rest(model, omega, values).iter().any(|[_, g]| g.any(&|s| s == Symbol::Tau));
    if let (Some(direction), true) = (direction, driven) {
        let y = Polynomial::call(Function::Cos, Polynomial::motion(Symbol::Tau));
        let still = Polynomial::default();
        let base = if direction == Direction::Vertical { vec![still, y] } else { vec![y, still] };
        words.points.push(("base".to_owned(), base));
    }
    let unit = |k: usize| if circle(k) { "angle" } else { "length" }.to_owned();
    let file = SystemFile {
        source: model.source.clone(),
        name: model.name.clone(),
        coordinates: (0..n).map(|k| (model.coordinates[k].clone(), unit(k))).collect(),
        words,
        input_units: Vec::new(),
        parameters: parameters
            .iter()
            .map(|p| Parameter { name: p.clone(), unit: Unit::default(), declared: None })
            .collect(),
        gravity: Some(Gravity::Down),
        bodies,
        kinetic: None,
        potential: None,
        joints,
        // Which parameter stands for the stiffness is nothing: what is looked for is that there is one.
        forces: springs.iter().map(|&(i, j)| Force::spring(&coordinate(j).minus(&coordinate(i)), j)).collect(),
        sensors: Vec::new(),
        quantities: Vec::new(),
        nominal: Vec::new(),
        written: true,
        time: None,
    };
    let apart = apart(n, &pairs);
    Some(Mechanism {
        apart,
        parameters: parameters.into_iter().map(|name| Named { name, unit: Unit::default(), positive: false }).collect(),
        scales: (0..n).map(|k| (k, Polynomial::atom(Atom::Parameter(k)))).collect(),
        file: Some(Arc::new(file)),
        ..Mechanism::default()
    })
}

/// What each strength of an entry does at a place for which the coefficients of the equations take
/// part: what is no force, and forces by a load; none for others, whose columns do not depend on how
/// the system was written, and where it does nothing.
pub fn changes(
    entry: &Entry,
    form: &Form,
    place: Place,
    file: &SystemFile,
    span: Span,
    omega: f64,
    psi: f64,
) -> Option<Vec<Change>> {
    let own = file.parameters.len();
    let mut words = Words { parameters: vec![String::new(); own], ..Words::default() };
    let time = Polynomial::motion(Symbol::Time).plus(&Polynomial::number(-span.start_s));
    words.scalars.push(("t".to_owned(), time));
    words.constants.push(("T".to_owned(), span.length_s));
    let count = entry.strengths.len();
    let by_strength = |law: &Polynomial| -> Vec<Node> {
        let parts = law.by_parameters();
        let of = |k: usize| parts.get(&vec![(Atom::Parameter(own + k), 1)]);
        (0..count).map(|k| of(k).map_or_else(|| number(0.0), Polynomial::node)).collect()
    };
    let turns = |law: &Polynomial| -> Option<Vec<Turn>> {
        let by = Rotation::of(entry, law, own)?;
        let both = by_strength(&by.sine).into_iter().zip(by_strength(&by.versine));
        Some(both.map(|(sine, versine)| Turn { sine, versine }).collect())
    };
    match (place, entry.at) {
        (Place::Drive, At::Drive) if entry.verb == super::entry::Verb::Moves => {
            // The drive's own displacement in units of its amplitude.
            let phase = Polynomial::motion(Symbol::Tau).plus(&Polynomial::number(-psi));
            let y = Polynomial::call(Function::Cos, phase);
            let axis = |up: f64| vec![Polynomial::number(up), Polynomial::number(1.0 - up)];
            words.points = vec![("along".to_owned(), axis(1.0)), ("across".to_owned(), axis(0.0))];
            words.constants.push((SIZE.to_owned(), 1.0));
            words.scalars.push(("y".to_owned(), y));
            let Ok(Word::Vector(law)) = entry.law(&words, form) else { return None };
            let twice = |p: &Polynomial| {
                let rate = by_time(p, 0, omega).ok()?;
                Some(by_time(&rate, 0, omega).ok()?.scaled(1.0 / (omega * omega)))
            };
            let (along, across) = (by_strength(&twice(&law[0])?), by_strength(&twice(&law[1])?));
            Some(along.into_iter().zip(across).map(|(along, across)| Change::Moves { along, across }).collect())
        }
        (Place::Arm(k), At::Arm) if entry.verb == super::entry::Verb::Turns => {
            let Body::Arm { angle: Some(angle), .. } = &file.bodies[k].value else { return None };
            let turned = (0..file.coordinates.len()).find(|&i| *angle == Polynomial::motion(Symbol::Coordinate(i)))?;
            let Ok(Word::Scalar(law)) = entry.law(&words, form) else { return None };
            let is_last = is_last(file, turned);
            Some(turns(&law)?.into_iter().map(|turn| Change::Arm(turned, is_last, turn)).collect())
        }
        (Place::Joint(k), At::Joint) if entry.states.is_empty() => {
            let hung = load::hung(&file.joints, k, file.coordinates.len())?;
            let mass = form.iter().find(|s| s.0 == MASS)?.1;
            let moves = &file.joints[k].moves.value;
            let x = Polynomial::call(Function::Wrap, moves.clone());
            let rate = by_time(moves, file.coordinates.len(), omega).ok()?;
            let load = Polynomial::motion(Symbol::State(0));
            words.scalars.extend([("x".to_owned(), x), ("v".to_owned(), rate), (LOAD.to_owned(), load)]);
            let Ok(Word::Scalar(law)) = entry.law(&words, form) else { return None };
            Some(by_strength(&law).into_iter().map(|of| Change::Load(hung.clone(), mass, of)).collect())
        }
        (Place::Frame, At::Frame) => {
            let Ok(Word::Scalar(law)) = entry.law(&words, form) else { return None };
            Some(turns(&law)?.into_iter().map(Change::Frame).collect())
        }
        _ => None,
    }
}

/// Whether no joint hangs on the arm of a coordinate: a joint that moves by the difference of two
/// hangs on the one that is taken off. Where joints are not named, none is known to be the last.
fn is_last(file: &SystemFile, coordinate: usize) -> bool {
    let slope = |j: &Joint| partial(&j.moves.value, &Atom::Motion(Symbol::Coordinate(coordinate))).ok();
    let hangs = |j: &Joint| slope(j).and_then(|s| s.as_number()).is_none_or(|s| s < 0.0);
    // A joint that the file names stands somewhere in it.
    file.joints.iter().all(|j| j.moves.at > 0) && !file.joints.iter().any(hangs)
}

/// The drive's part of the left-hand sides as K_e(q) d²y₀/dτ², and its phase ψ.
struct Driven {
    /// K_e.
    along: Vec<Node>,
    /// K_e across the drive.
    across: Vec<Node>,
    /// Phase of y₀.
    psi: f64,
}

fn driven(model: &ModelFile, parts: &[[Node; 2]], direction: Option<Direction>) -> Driven {
    let at = |g: &Node, tau: f64| {
        g.replace(&|s| match s {
            Symbol::Tau => number(tau),
            Symbol::Time => number(0.0),
            other => symbol(other),
        })
    };
    let pairs: Vec<[Node; 2]> = parts.iter().map(|[_, g]| [at(g, 0.0), at(g, FRAC_PI_2)]).collect();
    let states = || pairs.iter().flat_map(|p| (0..STATES).map(move |s| [value(&p[0], s, 0.0), value(&p[1], s, 0.0)]));
    let sum = |f: fn([f64; 2]) -> f64| states().map(f).sum::<f64>();
    // The axis of the ellipse that cosine and sine draw.
    let mut psi = 0.5 * (2.0 * sum(|[c, s]| c * s)).atan2(sum(|[c, s]| c * c - s * s));
    let turn = if direction == Some(Direction::Vertical) { FRAC_PI_2 } else { -FRAC_PI_2 };
    let turned = |n: &Node, by: f64| {
        n.replace(&|s| match s {
            Symbol::Coordinate(k) if model.coordinates[k].space == Space::Circle => {
                add(symbol(Symbol::Coordinate(k)), number(by))
            }
            other => symbol(other),
        })
    };
    // ÿ₀ = −Ω² a cos(τ − ψ): where the base goes up with gravity's own sign, a is positive.
    let of = |psi: f64| -> Vec<Node> {
        let mix =
            |p: &[Node; 2]| add(multiply(number(-psi.cos()), p[0].clone()), multiply(number(-psi.sin()), p[1].clone()));
        pairs.iter().map(mix).collect()
    };
    let up: f64 = of(psi)
        .iter()
        .zip(parts)
        .map(|(k, [still, _])| {
            let vertical = if direction == Some(Direction::Vertical) { k.clone() } else { turned(k, -FRAC_PI_2) };
            (0..STATES).map(|s| value(&vertical, s, 0.0) * value(still, s, 0.0)).sum::<f64>()
        })
        .sum();
    if up < 0.0 {
        psi += core::f64::consts::PI;
    }
    let along = of(psi);
    let across = along.iter().map(|k| turned(k, turn)).collect();
    Driven { along, across, psi }
}

/// What each change adds to the left-hand sides, in seconds, for coefficients in the order of
/// [`ModelFile::coefficients`].
pub fn columns(
    changes: &[Change],
    model: &ModelFile,
    direction: Option<Direction>,
    omega: f64,
    values: &[f64],
) -> Vec<Vec<(usize, Node)>> {
    let (parts, all) = (at_rest(model, omega, values), sides(model, omega, values));
    let slope = |n: &Node, k: usize| n.derivative_between_jumps(Symbol::Coordinate(k)).unwrap_or_else(|| number(0.0));
    let kept = |all: Vec<(usize, Node)>| -> Vec<(usize, Node)> {
        all.into_iter().filter(|(_, n)| as_number(n) != Some(0.0)).collect()
    };
    changes
        .iter()
        .map(|change| match change {
            Change::Moves { along, across } => {
                let drive = driven(model, &parts, direction);
                let sum = |e: usize| {
                    let first = multiply(drive.along[e].clone(), along.clone());
                    add(first, multiply(drive.across[e].clone(), across.clone()))
                };
                kept((0..parts.len()).map(|e| (e, sum(e))).collect())
            }
            Change::Arm(k, true, turn) => {
                let turned = |side: &Node| turn.of(&of_angles(side), &|n| slope(n, *k));
                kept(all.iter().enumerate().map(|(e, side)| (e, turned(side))).collect())
            }
            Change::Arm(k, false, turn) => {
                let [still, driven] = &parts[*k];
                let own = add(of_angles(still), of_angles(driven));
                kept(vec![(*k, turn.of(&own, &|n| slope(n, *k)))])
            }
            Change::Load(hung, mass, law) => {
                let equations = Equations { model, direction, omega, values };
                equations.columns(hung, *mass, law).map_or_else(Vec::new, kept)
            }
            Change::Frame(turn) => {
                let angles = (0..model.coordinates.len()).filter(|&k| model.coordinates[k].space == Space::Circle);
                let back = |n: &Node| angles.clone().fold(number(0.0), |sum, k| subtract(sum, slope(n, k)));
                kept(parts.iter().enumerate().map(|(e, [s, _])| (e, turn.of(&of_angles(s), &back))).collect())
            }
        })
        .collect()
}

/// By how much an equation's right-hand side grows where its primes are derivatives by seconds: Ω²
/// for −q″, 1 for a force.
pub fn balance_scale(model: &ModelFile, omega: f64, equation: usize) -> f64 {
    let balance = &model.equations[equation].balance;
    multiple(balance, &model.in_seconds(balance, omega)).filter(|k| *k > 0.0).unwrap_or(1.0)
}

/// Unit of what stands on the right-hand side of an equation, in seconds, for units of coordinates
/// and inputs.
pub fn balance_unit(model: &ModelFile, omega: f64, equation: usize, coordinates: &[Unit], inputs: &[Unit]) -> String {
    let balance = model.in_seconds(&model.equations[equation].balance, omega);
    units::of(&balance, coordinates, inputs, true).unwrap_or_default().to_string()
}

/// What turns the strength of a force into the unit of the equation that it is told in;
/// `parameters`: see [`parameters`].
pub fn told_by(model: &ModelFile, omega: f64, equation: usize, parameters: &[f64]) -> f64 {
    balance_scale(model, omega, equation) / parameters.get(equation).copied().unwrap_or(1.0).abs()
}

#[cfg(test)]
#[path = "written_tests.rs"]
mod tests;
