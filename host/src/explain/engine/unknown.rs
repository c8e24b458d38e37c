//! What is left and has no name: its shape as a function of one coordinate.
//!
//! At each joint and each arm that is no joint by itself, a force is a sum of hat functions of the
//! position, the velocity or the drive's phase, f(x) = Σ_k f_k Λ_k(x) (linear interpolation on a
//! grid, periodic for angles), added to the model and fitted with it; the pair of place and
//! coordinate with the greatest held-out gain is told, with the standard error of every f_k by the
//! jackknife over blocks. A shape is known only up to what the model's own terms can absorb (a sine
//! of an arm's angle is gravity, a straight line in a velocity viscous friction); a small ridge
//! keeps those directions at zero.
//!
//! A shape that predicts clearly better than the model with everything that it names is left over,
//! however little it is beside the noise: where nothing is missing, or what is has its right name,
//! its many strengths only make predictions worse.

use core::f64::consts::{PI, TAU};
use std::sync::Arc;

use serde::Serialize;

use super::axes::{self, Axis};
use super::candidates::Column;
use super::evidence::Outcome;
use super::residual::range;
use super::setting::Setting;
use super::state::State;
use super::tell;
use crate::effects::places::Place;
use crate::explain::ranking::{self, Fit};
use crate::identify::jackknife::widening;
use crate::model::model_file::expression::{Expression, Node, Symbol, multiply, number, subtract};
use crate::statistics::Z95;
use crate::system::derivative::partial;
use crate::system::mechanism::at;
use crate::system::polynomial::{Atom, Polynomial};
use crate::wording::format::significant;

/// Grid points of an angle and of a velocity.
const POINTS: usize = 17;
/// Ridge, as a share of the hats' mean square.
const RIDGE: f64 = 1e-4;
/// Least share of the held-out residual power that a shape must take away to be told (by hand).
const LEAST_GAIN: f64 = 0.05;
/// Standard errors between blocks from which a shape's gain is clear: 3e-5 by chance for each
/// shape.
pub const CLEAR: f64 = 4.0;

/// A torque of unknown origin as a function of one coordinate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unknown {
    /// Where the torque acts.
    pub at: String,
    /// What it depends on.
    pub against: String,
    /// Unit of the coordinate.
    pub against_unit: String,
    /// Unit of the torque (N m, or rad/s² where no inertia is known).
    pub unit: String,
    /// Coordinate, torque, half width of its 95 % band.
    pub points: Vec<[f64; 3]>,
    /// Share of the held-out residual power that it takes away.
    pub held_out_gain: f64,
}

impl Unknown {
    /// What its unit makes it: a torque, a force, or a term of an equation in other units.
    pub fn kind(&self) -> &'static str {
        match self.unit.as_str() {
            "N m" | "rad/s²" => "torque",
            "N" | "m/s²" => "force",
            _ => "term",
        }
    }

    /// In words.
    pub fn told(&self) -> String {
        let share = significant(100.0 * self.held_out_gain, 2);
        let (Self { at, against, .. }, kind) = (self, self.kind());
        format!(
            "a {kind} at {at} that depends on the {against} takes away {share} % of what is left where it was not fitted"
        )
    }
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

/// Hat functions of one coordinate at one place.
struct Hats {
    place: Place,
    coordinate: Axis,
    /// Where the first stands, and how far they are apart.
    low: f64,
    width: f64,
    columns: Vec<Column>,
}

impl Hats {
    /// None where the coordinate does not move.
    fn new(setting: &Setting<'_>, state: &State, place: Place, shares: &[(usize, Node)], of: Axis) -> Option<Self> {
        let (low, high) = if of.turn { (-PI, PI) } else { range(setting, state, &of.of) };
        let count = if of.turn { POINTS - 1 } else { POINTS };
        let width = (high - low) / (POINTS - 1) as f64;
        if !(width > 0.0 && width.is_finite()) {
            return None;
        }
        let hat = |k: usize| -> Node {
            let from_node = subtract(of.of.clone(), number(low + k as f64 * width));
            Arc::new(Expression::Hat { from_node, width, period: of.turn.then_some(TAU) })
        };
        let column = |k: usize| shares.iter().map(|(e, share)| (*e, multiply(share.clone(), hat(k)))).collect();
        let columns = (0..count).map(column).collect();
        Some(Self { place, coordinate: of, low, width, columns })
    }

    /// What a fit with them behind `own` columns found.
    fn fitted(&self, setting: &Setting<'_>, state: &State, own: usize, fit: &Fit, held_out_gain: f64) -> Unknown {
        let (scale, unit) = tell::of_force(setting, &state.physical, self.place);
        let point = |k: usize| {
            let error = fit.covariance[(own + k, own + k)].max(0.0).sqrt();
            [
                self.low + k as f64 * self.width,
                scale * fit.all[own + k],
                Z95 * widening(fit.blocks) * scale.abs() * error,
            ]
        };
        Unknown {
            at: setting.file().map_or_else(String::new, |f| self.place.name(f)),
            against: self.coordinate.name.clone(),
            against_unit: self.coordinate.unit.clone(),
            unit,
            points: (0..self.columns.len()).map(point).collect(),
            held_out_gain,
        }
    }
}

/// A shape, and whether it predicts clearly better than the model without it.
pub struct Shape {
    /// What is told of it.
    pub unknown: Unknown,
    /// Whether its gain is clear, from one block to the other.
    pub is_clear: bool,
    /// Its gain in standard errors between blocks.
    pub deviations: f64,
}

/// The shape that takes away most, if any takes away enough or is clear.
pub fn shape(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<Shape> {
    let own = outcome.own.len();
    let all: Vec<Hats> = axes::places_of_forces(setting)
        .into_iter()
        .flat_map(|(place, moves)| {
            let shares = shares(setting, state, &moves);
            let hats = |c| Hats::new(setting, state, place, &shares, c);
            axes::of_force(setting, place, &moves).into_iter().filter_map(hats).collect::<Vec<_>>()
        })
        .collect();
    let groups: Vec<Vec<Column>> = all.iter().map(|h| h.columns.clone()).collect();
    let total: f64 = outcome.fit.held_out.iter().sum();
    let fits = outcome.evidence.with_groups(setting, state, own, &groups, RIDGE);
    let found = all.iter().zip(fits).filter_map(|(hats, fit)| {
        let fit = fit?;
        let (mean, error) = ranking::gain(&outcome.fit.held_out, &fit.held_out);
        let share = mean * fit.held_out.len() as f64 / total;
        let is_clear = outcome.evidence.is_shooting() && mean > CLEAR * error;
        (share > LEAST_GAIN || is_clear).then(|| Shape {
            unknown: hats.fitted(setting, state, own, &fit, share),
            is_clear,
            deviations: mean / error,
        })
    });
    found.max_by(|a, b| a.unknown.held_out_gain.total_cmp(&b.unknown.held_out_gain))
}
