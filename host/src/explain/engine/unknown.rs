//! What is left and has no name: its shape as a function of one coordinate.
//!
//! At each joint and each arm that is no joint by itself, a force is a sum of hat functions of the position, the velocity or the drive's phase, f(x) =
//! Σ_k f_k Λ_k(x) (linear interpolation on a grid, periodic for angles), added to the model and fitted with it; the pair of place and coordinate with the
//! greatest held-out gain is told, with the standard error of every f_k by the jackknife over blocks. A shape is known only up to
//! what the model's own terms can absorb (a sine of an arm's angle is gravity, a straight line in a velocity viscous friction); a small ridge keeps
//! those directions at zero.

use core::f64::consts::{PI, TAU};
use std::sync::Arc;

use serde::Serialize;

use super::evidence::Outcome;
use super::residual::range;
use super::setting::Setting;
use super::state::State;
use super::tell;
use crate::effects::places::{self, Place};
use crate::model::model_file::expression::{
    Expression, Function, Node, Symbol, call, multiply, number, subtract, symbol,
};
use crate::system::bodies::Body;
use crate::system::derivative::{by_time, partial};
use crate::system::mechanism::at;
use crate::system::polynomial::{Atom, Polynomial};

/// Grid points of an angle and of a velocity.
const POINTS: usize = 17;
/// Ridge, as a share of the hats' mean square.
const RIDGE: f64 = 1e-4;
/// Least share of the held-out residual power that a shape must take away to be told.
const LEAST_GAIN: f64 = 0.05;

/// A torque of unknown origin as a function of one coordinate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unknown {
    /// Where the torque acts.
    pub at: String,
    /// What it depends on.
    pub against: String,
    /// Unit of the coordinate.
    pub against_unit: &'static str,
    /// Unit of the torque (N m, or rad/s² where no inertia is known).
    pub unit: String,
    /// Coordinate, torque, half width of its 95 % band.
    pub points: Vec<[f64; 3]>,
    /// Share of the held-out residual power that it takes away.
    pub held_out_gain: f64,
}

/// A coordinate that a force may depend on.
struct Coordinate {
    name: String,
    unit: &'static str,
    of: Node,
    angle: bool,
}

/// Places of forces: each joint, and each arm whose angle is no joint's.
fn places_of(setting: &Setting<'_>) -> Vec<(Place, Polynomial)> {
    let Some(file) = setting.file() else { return Vec::new() };
    let joints: Vec<(Place, Polynomial)> =
        file.joints.iter().enumerate().map(|(k, j)| (Place::Joint(k), j.moves.value.clone())).collect();
    let arms = file.bodies.iter().enumerate().filter_map(|(k, b)| match &b.value {
        Body::Arm { angle: Some(angle), .. } if joints.iter().all(|j| j.1 != *angle) => {
            Some((Place::Arm(k), angle.clone()))
        }
        _ => None,
    });
    joints.iter().cloned().chain(arms).collect()
}

fn coordinates(setting: &Setting<'_>, place: Place, moves: &Polynomial) -> Vec<Coordinate> {
    let Some(file) = setting.file() else { return Vec::new() };
    let name = place.name(file);
    let angle = places::is_angle(file, moves);
    let x = if angle { call(Function::Wrap, moves.node()) } else { moves.node() };
    let what = if angle { "angle" } else { "position" };
    let mut out =
        vec![Coordinate { name: format!("{what} of {name}"), unit: if angle { "rad" } else { "m" }, of: x, angle }];
    if let Ok(rate) = by_time(moves, file.coordinates.len(), setting.rig.omega()) {
        let unit = if angle { "rad/s" } else { "m/s" };
        out.push(Coordinate { name: format!("velocity of {name}"), unit, of: rate.node(), angle: false });
    }
    if setting.rig.drive.is_some() {
        let phase = call(Function::Wrap, symbol(Symbol::Tau));
        out.push(Coordinate { name: "drive phase".to_owned(), unit: "rad", of: phase, angle: true });
    }
    out
}

/// A force of one at a place on the left-hand sides: for each equation, what multiplies it.
fn shares(setting: &Setting<'_>, state: &State, moves: &Polynomial) -> Vec<(usize, Node)> {
    let Some(mechanism) = setting.mechanism() else { return Vec::new() };
    mechanism
        .scales
        .iter()
        .enumerate()
        .filter_map(|(e, (coordinate, scale))| {
            let along = partial(moves, &Atom::Motion(Symbol::Coordinate(*coordinate))).ok()?;
            let inertia = at(scale, &state.physical.values);
            (!along.is_zero()).then(|| (e, multiply(number(-1.0 / inertia), along.node())))
        })
        .collect()
}

/// The shape that takes away most, if any takes away enough.
pub fn shape(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<Unknown> {
    let own = outcome.own.len();
    let total: f64 = outcome.fit.held_out.iter().sum();
    let mut best: Option<Unknown> = None;
    for (place, moves) in places_of(setting) {
        let shares = shares(setting, state, &moves);
        for c in coordinates(setting, place, &moves) {
            let (low, high) = if c.angle { (-PI, PI) } else { range(setting, state, &c.of) };
            let count = if c.angle { POINTS - 1 } else { POINTS };
            let width = (high - low) / (POINTS - 1) as f64;
            if !(width > 0.0 && width.is_finite()) {
                continue;
            }
            let hat = |k: usize| -> Node {
                let from_node = subtract(c.of.clone(), number(low + k as f64 * width));
                Arc::new(Expression::Hat { from_node, width, period: c.angle.then_some(TAU) })
            };
            let columns: Vec<Vec<(usize, Node)>> = (0..count)
                .map(|k| shares.iter().map(|(e, share)| (*e, multiply(share.clone(), hat(k)))).collect())
                .collect();
            let Some(fit) = outcome.evidence.with_columns(setting, state, own, &columns, RIDGE) else { continue };
            let gain = (total - fit.held_out.iter().sum::<f64>()) / total;
            if gain < best.as_ref().map_or(LEAST_GAIN, |b| b.held_out_gain) {
                continue;
            }
            let (scale, unit) = tell::of_force(setting, &state.physical, place);
            best = Some(Unknown {
                at: setting.file().map_or_else(String::new, |f| place.name(f)),
                against: c.name.clone(),
                against_unit: c.unit,
                unit,
                points: (0..count)
                    .map(|k| {
                        let error = fit.covariance[(own + k, own + k)].max(0.0).sqrt();
                        [low + k as f64 * width, scale * fit.all[own + k], 1.96 * scale.abs() * error]
                    })
                    .collect(),
                held_out_gain: gain,
            });
        }
    }
    best
}
