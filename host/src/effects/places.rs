//! Where effects can act on a system derived from bodies: joints, pairs of coordinates, arms, the
//! driven point, gravity's frame, encoders, measured inputs.

use super::columns::LOAD;
use super::entry::{At, Entry, Verb};
use super::on_a_frame;
use super::written::load::hung;
use super::{at_a_point, between};
use crate::model::model_file::Space;
use crate::model::model_file::expression::{Function, Symbol};
use crate::rig::measures::ObservedModel;
use crate::system::bodies::Body;
use crate::system::language::{Gravity, SystemFile};
use crate::system::mechanism::Mechanism;
use crate::system::polynomial::{Atom, Polynomial};

/// A place of a system.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Place {
    /// Joint, by its number in the file.
    Joint(usize),
    /// Pair of coordinates, by their numbers.
    Between(usize, usize),
    /// Arm, by its number among the bodies.
    Arm(usize),
    /// Mass at a point, by its number among the bodies.
    Body(usize),
    /// The driven point.
    Drive,
    /// What carries everything.
    Frame,
    /// Sensor, by its number among the rig's.
    Encoder(usize),
    /// Measured input, by its number.
    Input(usize),
}

impl Place {
    /// Name after the `@`.
    pub fn name(self, file: &SystemFile) -> String {
        match self {
            Self::Joint(k) => file.joints[k].name.clone(),
            // Names of coordinates have no hyphen.
            Self::Between(i, j) => format!("{}-{}", file.coordinates[i].0.name, file.coordinates[j].0.name),
            Self::Arm(k) | Self::Body(k) => match &file.bodies[k].value {
                Body::Arm { name, .. } | Body::Free { name, .. } => name.clone(),
            },
            Self::Drive => "drive".to_owned(),
            Self::Frame => "frame".to_owned(),
            Self::Encoder(k) => format!("encoder{}", k + 1),
            Self::Input(k) => file.words.inputs[k].clone(),
        }
    }

    /// The displacement across it, on which a force does work: of a joint or between coordinates.
    pub fn moves(self, file: &SystemFile) -> Option<Polynomial> {
        match self {
            Self::Joint(k) => Some(file.joints.get(k)?.moves.value.clone()),
            Self::Between(i, j) => Some(between::difference(i, j)),
            _ => None,
        }
    }
}

/// The driven point.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// Component along which it moves.
    pub along: usize,
    /// Components of a point.
    pub components: usize,
    /// Its displacement.
    pub y: Polynomial,
}

/// The driven point, where one moves along one axis.
pub fn drive(file: &SystemFile) -> Option<Drive> {
    let moves = |p: &Polynomial| p.moves(|s| s == Symbol::Tau);
    let (_, point) = file.words.points.iter().find(|(_, v)| v.iter().any(moves))?;
    let mut driven = (0..point.len()).filter(|&k| moves(&point[k]));
    let along = driven.next()?;
    if driven.next().is_some() {
        return None;
    }
    let mut y = Polynomial::default();
    for (product, c) in point[along].terms() {
        let term = Polynomial::product(product.clone(), c);
        if moves(&term) {
            y = y.plus(&term);
        }
    }
    Some(Drive { along, components: point.len(), y })
}

/// Whether a joint's coordinates are angles that are counted over turns, and an entry's law has
/// harmonics of them alone: what acts near one angle is for those on a circle.
fn winds(file: &SystemFile, bound: &ObservedModel, entry: &Entry, joint: usize) -> bool {
    let moves = &file.joints[joint].moves.value;
    let mut own = (0..bound.angles.len()).filter(|k| moves.moves(|s| s == Symbol::Coordinate(*k))).peekable();
    let is_harmonic = entry.shapes.iter().all(|s| s.within.is_none());
    is_harmonic && own.peek().is_some() && own.all(|k| bound.angles[k])
}

/// Whether an angle takes part in an expression.
fn turns(file: &SystemFile, p: &Polynomial) -> bool {
    (0..file.coordinates.len())
        .any(|k| file.coordinates[k].0.space == Space::Circle && p.moves(|s| s == Symbol::Coordinate(k)))
}

/// The size of the force across a joint, √(F_x² + F_y²), with the system's parameters in it; none
/// where that is not known (see [`SystemFile::reaction`]), and where something slides: what a guide
/// carries is not all of it. `omega` is dτ/dt, rad/s; `mass` as there.
pub fn load(file: &SystemFile, joint: usize, omega: f64, mass: Option<f64>) -> Option<Polynomial> {
    if !is_angle(file, &file.joints[joint].moves.value) {
        return None;
    }
    Some(size_of(&file.reaction(joint, omega, mass)?))
}

/// The size of a vector.
pub fn size_of(vector: &[Polynomial]) -> Polynomial {
    // Squares that are not multiplied out stay above zero whatever rounding does.
    let square = |x: &Polynomial| Polynomial::product(vec![(Atom::Sum(x.clone()), 2)], 1.0);
    let sum = vector.iter().filter(|x| !x.is_zero()).fold(Polynomial::default(), |sum, x| sum.plus(&square(x)));
    Polynomial::call(Function::Sqrt, sum)
}

/// Whether a joint's load may be known: of written equations the joint that arms hang on, whose
/// equations may still not tell it ([`super::written::load`]).
fn has_load(file: &SystemFile, joint: usize) -> bool {
    if file.written {
        let turns = |k: usize| file.coordinates[k].0.space == Space::Circle;
        return (0..file.coordinates.len()).all(turns) && hung(&file.joints, joint, file.coordinates.len()).is_some();
    }
    load(file, joint, 1.0, None).is_some()
}

/// Every place of an entry; `bound` has the sensors.
pub fn of(entry: &Entry, file: &SystemFile, bound: &ObservedModel) -> Vec<Place> {
    let vertical = |d: &Drive| d.along + 1 == d.components;
    match entry.at {
        At::Joint => (0..file.joints.len())
            .filter(|&k| !entry.turning || turns(file, &file.joints[k].moves.value) || winds(file, bound, entry, k))
            .filter(|&k| !entry.names(LOAD) || has_load(file, k))
            .map(Place::Joint)
            .collect(),
        At::Between => between::pairs(file)
            .into_iter()
            .filter(|&(i, j)| !entry.turning || turns(file, &between::difference(i, j)))
            .map(|(i, j)| Place::Between(i, j))
            .collect(),
        At::Arm => (0..file.bodies.len())
            .filter(|&k| file.bodies[k].value.angle().is_some())
            // What turns a centroid, or acts along a line, has a line from an end; arms of written
            // equations are angles only.
            .filter(|&k| entry.verb == Verb::Force || matches!(&file.bodies[k].value, Body::Arm { .. }))
            .filter(|_| entry.verb != Verb::Drags || !file.written)
            .map(Place::Arm)
            .collect(),
        At::Body => (0..file.bodies.len()).filter(|&k| at_a_point::moves(file, k)).map(Place::Body).collect(),
        At::Drive => match drive(file) {
            // One law has two names: by the direction across the drive.
            Some(d) if entry.alias => {
                if vertical(&d) {
                    Vec::new()
                } else {
                    vec![Place::Drive]
                }
            }
            Some(d) if entry.id == "horizontal-motion" && !vertical(&d) => Vec::new(),
            Some(_) => vec![Place::Drive],
            None => Vec::new(),
        },
        At::Frame if entry.verb == Verb::Moves => {
            if on_a_frame::carries(file) {
                vec![Place::Frame]
            } else {
                Vec::new()
            }
        }
        // What has a weight in a plane or in space, and a coordinate that it pulls at.
        At::Frame => match &file.gravity {
            Some(Gravity::Down) if file.bodies.iter().any(|b| has_weight(&b.value)) => vec![Place::Frame],
            _ => Vec::new(),
        },
        At::Encoder => (0..bound.sensors.len())
            // A delay is told against the first channel.
            .filter(|&k| k > 0 || entry.id != "channel-delay")
            .filter(|&k| !entry.turning || shows_angle(file, bound, k))
            .map(Place::Encoder)
            .collect(),
        At::Input => (0..bound.inputs.len().min(file.words.inputs.len())).map(Place::Input).collect(),
    }
}

/// Whether gravity, turned, pulls at a body otherwise.
fn has_weight(body: &Body) -> bool {
    match body {
        Body::Arm { .. } => true,
        Body::Free { centroid, .. } => centroid.as_ref().is_some_and(|c| c.len() > 1),
    }
}

fn shows_angle(file: &SystemFile, bound: &ObservedModel, sensor: usize) -> bool {
    (0..file.coordinates.len()).any(|k| bound.shown[(sensor, k)] != 0.0 && file.coordinates[k].0.space == Space::Circle)
}

/// The equation in whose inertia a force at a place is told where no mass is known, and what it
/// does work on.
pub fn equation(place: Place, mechanism: &Mechanism) -> Option<(usize, Polynomial)> {
    let file = mechanism.file.as_deref()?;
    if let Place::Body(k) = place {
        return at_a_point::equation(k, mechanism);
    }
    let moves = match place {
        Place::Joint(_) | Place::Between(..) => place.moves(file)?,
        Place::Arm(k) => file.bodies[k].value.angle()?.clone(),
        _ => return None,
    };
    let coordinate = (0..file.coordinates.len()).rev().find(|k| moves.moves(|s| s == Symbol::Coordinate(*k)))?;
    let equation = mechanism.scales.iter().position(|s| s.0 == coordinate)?;
    Some((equation, moves))
}

/// Whether an expression of coordinates is an angle: every coordinate in it lies on a circle.
pub fn is_angle(file: &SystemFile, p: &Polynomial) -> bool {
    turns(file, p)
        && !(0..file.coordinates.len())
            .any(|k| file.coordinates[k].0.space == Space::Line && p.moves(|s| s == Symbol::Coordinate(k)))
}

/// Name of [`size`] in an effect's law.
pub const SIZE: &str = "size";

/// Amplitude of the driven point for values of the parameters: of its first harmonic, √2 times the
/// rms over a period.
pub fn size(y: &Polynomial, parameters: &[f64]) -> f64 {
    const POINTS: u32 = 64;
    let at = |k: u32| {
        let tau = core::f64::consts::TAU * f64::from(k) / f64::from(POINTS);
        y.value(&|a| match a {
            Atom::Parameter(i) => parameters.get(*i).copied().unwrap_or(f64::NAN),
            _ => tau,
        })
    };
    ((0..POINTS).map(|k| at(k) * at(k)).sum::<f64>() * 2.0 / f64::from(POINTS)).sqrt()
}
