//! What is left and has no name: its shape as a function of one coordinate.
//!
//! For each place where a torque can act (joint 1, joint 2, either arm) and each coordinate that it may depend on, the torque is a sum of hat functions
//! on a grid (linear interpolation, periodic for angles), f(x) = Σ_k f_k Λ_k(x), added to the model and fitted with it by the weak form. The pair of place and
//! coordinate with the greatest held-out gain is told, with the standard error of every f_k by the jackknife over blocks. A shape is known only up to
//! what the model's own terms can absorb (a sine of joint 1's angle is gravity, a straight line in a velocity viscous friction); a small ridge keeps
//! those directions at zero.

use std::sync::Arc;

use serde::Serialize;

use super::Outcome;
use super::design;
use super::effects::{Compose, Place, Variant, joint_torque, torque, wrapped};
use super::ranking;
use super::state::State;
use crate::identify::Geometry;
use crate::model::weak::{Sample, Series};

/// Grid points of an angle and of a velocity.
pub(super) const POINTS: usize = 17;
/// Ridge, as a share of the hats' mean square.
pub(super) const RIDGE: f64 = 1e-4;
/// Least share of the held-out residual power that a shape must take away to be told.
pub(super) const LEAST_GAIN: f64 = 0.05;

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

/// A coordinate that a torque may depend on: name, unit, value at a sample, whether it is an angle.
struct Coordinate {
    name: &'static str,
    unit: &'static str,
    value: fn(&Sample) -> f64,
    angle: bool,
}

/// Coordinates that a torque at a place may depend on.
fn coordinates(place: Place, driven: bool) -> Vec<Coordinate> {
    let phase = Coordinate { name: "drive phase", unit: "rad", value: |s| s.sin_tau.atan2(s.cos_tau), angle: true };
    let mut out = match place {
        Place::Joint1 => vec![
            Coordinate { name: "angle of joint1", unit: "rad", value: |s| wrapped(s.phi[0]), angle: true },
            Coordinate { name: "velocity of joint1", unit: "rad/s", value: |s| s.rate[0], angle: false },
        ],
        Place::Joint2 => vec![
            Coordinate { name: "angle of joint2", unit: "rad", value: |s| wrapped(s.phi[1] - s.phi[0]), angle: true },
            Coordinate { name: "velocity of joint2", unit: "rad/s", value: |s| s.rate[1] - s.rate[0], angle: false },
        ],
        _ => vec![
            Coordinate { name: "angle of arm2", unit: "rad", value: |s| wrapped(s.phi[1]), angle: true },
            Coordinate { name: "velocity of arm2", unit: "rad/s", value: |s| s.rate[1], angle: false },
        ],
    };
    if driven {
        out.push(phase);
    }
    out
}

/// Hat function k of a grid from `low` with spacing `width`; periodic over `count` points for an angle.
fn hat(x: f64, k: usize, low: f64, width: f64, count: usize, angle: bool) -> f64 {
    let mut u = (x - low) / width - k as f64;
    if angle {
        let n = count as f64;
        u -= n * (u / n).round();
    }
    (1.0 - u.abs()).max(0.0)
}

/// The shape that takes away most, if any takes away enough.
pub(super) fn shape(state: &State, geometry: &Geometry, outcome: &Outcome) -> Option<Unknown> {
    let c = &state.context;
    let own = outcome.own.len();
    let without = ranking::fit(&outcome.design, &outcome.own, &outcome.weights)?;
    let total: f64 = without.held_out.iter().sum();
    let mut best: Option<Unknown> = None;
    for place in [Place::Joint1, Place::Joint2, Place::Arm2] {
        for coordinate in coordinates(place, c.driven) {
            let (low, high) = range(state, &coordinate);
            let count = if coordinate.angle { POINTS - 1 } else { POINTS };
            let width = (high - low) / (POINTS - 1) as f64;
            if !(width > 0.0 && width.is_finite()) {
                continue;
            }
            let columns: Vec<[Option<Series>; 2]> =
                (0..count).map(|k| column(state, place, &coordinate, k, low, width, count)).collect();
            let hats = torque(columns, Vec::new(), Compose::Single);
            let variants: Vec<&Variant> =
                state.chosen.iter().map(|k| &k.candidate.variant).chain(core::iter::once(&hats)).collect();
            let design = design::build(c, &state.segments, geometry, &variants, &state.model(), &state.base);
            let all: Vec<usize> = (0..own + count).collect();
            let ridge: Vec<f64> = all.iter().map(|&i| if i < own { 0.0 } else { RIDGE }).collect();
            let Some(fit) = ranking::fit_ridge(&design, &all, &outcome.weights, &ridge) else { continue };
            let gain = (total - fit.held_out.iter().sum::<f64>()) / total;
            if gain < best.as_ref().map_or(LEAST_GAIN, |b| b.held_out_gain) {
                continue;
            }
            // Strengths are torques over J_o2.
            let (scale, unit) = c.known.get("J_o2").map_or((1.0, "rad/s²".to_owned()), |j| (*j, "N m".to_owned()));
            best = Some(Unknown {
                at: place.name().to_owned(),
                against: coordinate.name.to_owned(),
                against_unit: coordinate.unit,
                unit,
                points: (0..count)
                    .map(|k| {
                        let error = fit.covariance[(own + k, own + k)].max(0.0).sqrt();
                        // The torque itself: effects are written as torques that oppose.
                        [low + k as f64 * width, -scale * fit.all[own + k], 1.96 * scale * error]
                    })
                    .collect(),
                held_out_gain: gain,
            });
        }
    }
    best
}

/// Least and greatest value of a coordinate over the record (the circle for an angle).
fn range(state: &State, coordinate: &Coordinate) -> (f64, f64) {
    use core::f64::consts::PI;
    if coordinate.angle {
        return (-PI, PI);
    }
    let mut out = (f64::INFINITY, f64::NEG_INFINITY);
    for s in &state.segments {
        for i in (6..s.len().saturating_sub(6)).step_by(5) {
            let rate = [0, 1].map(|k| (s.phi[k][i + 6] - s.phi[k][i - 6]) / (12.0 * s.step_s));
            let v = (coordinate.value)(&Sample { rate, ..Sample::default() });
            out = (out.0.min(v), out.1.max(v));
        }
    }
    out
}

/// A hat's columns in both equations.
fn column(
    state: &State,
    place: Place,
    coordinate: &Coordinate,
    k: usize,
    low: f64,
    width: f64,
    count: usize,
) -> [Option<Series>; 2] {
    let (value, angle) = (coordinate.value, coordinate.angle);
    let f = move |s: &Sample| hat(value(s), k, low, width, count, angle);
    // Signs and inertias of a torque in a joint; the function itself is of the sample, not of the joint.
    let unit = joint_torque(&state.context, place_of(place), |_| 1.0);
    let scaled = |series: &Option<Series>| -> Option<Series> {
        let factor = series.as_ref().map(|s| s(&Sample::default()))?;
        Some(Arc::new(move |s: &Sample| factor * f(s)))
    };
    match place {
        // On arm 2 alone: the second equation of a torque in joint 2.
        Place::Arm2 => [None, scaled(&unit[1])],
        _ => [scaled(&unit[0]), scaled(&unit[1])],
    }
}

fn place_of(place: Place) -> Place {
    if place == Place::Joint1 { Place::Joint1 } else { Place::Joint2 }
}

#[cfg(test)]
mod tests {
    use super::hat;
    use core::f64::consts::{PI, TAU};

    #[test]
    fn hats_sum_to_one_and_interpolate() {
        let width = TAU / 16.0;
        for i in 0..100 {
            let x = -PI + TAU * f64::from(i) / 100.0;
            let sum: f64 = (0..16).map(|k| hat(x, k, -PI, width, 16, true)).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{x} {sum}");
        }
        let line: f64 = (0..5).map(|k| (2.0 + 3.0 * k as f64) * hat(1.7, k, 0.0, 1.0, 5, false)).sum();
        assert!((line - (2.0 + 3.0 * 1.7)).abs() < 1e-12);
    }
}
