//! Beyond short windows: how long predictions hold, and whether the model's attractor is the record's, before and after.
//!
//! *Prediction horizon*: from held-out windows whose initial state was fitted the model runs on freely until any sensor's angle is off by 30°; the median time
//! over the windows. *Poincaré section*: model and record at each period of the drive, as points (cos, sin of each sensor's angle, its velocity over its scatter);
//! the energy distance between the two clouds with its permutation test ([`crate::validate::energy_distance`]).

use nalgebra::DVector;
use rayon::prelude::*;
use serde::Serialize;

use super::comparison::Comparison;
use super::forward::Model;
use super::gap::{self, Part};
use super::state::State;
use crate::signal::angles::AngleSegment;
use crate::validate::energy_distance::energy_test;

/// Angle by which a prediction may be off, degrees.
pub const TOLERANCE_DEG: f64 = 30.0;
/// Most windows from which predictions start.
const MOST_STARTS: usize = 40;
/// Longest prediction, in horizons of the gap.
const LONGEST: f64 = 60.0;
/// Seed of the permutation test.
const SEED: u64 = 1;
/// Samples to either side over which velocities of a section are taken.
const REACH: usize = 2;

/// How far a model follows the record beyond short windows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Attractor {
    /// Median prediction horizon, s.
    pub prediction_horizon_s: f64,
    /// Energy distance of the Poincaré sections; none for a free system or a short record.
    pub section_distance: Option<f64>,
    /// Probability of at least this distance by chance.
    pub section_p_value: Option<f64>,
}

/// Measures a model with coefficients `x`.
pub(super) fn measure(state: &State, x: &DVector<f64>, comparison: &Comparison<'_>) -> Attractor {
    let model = Model::of(state, x);
    let test = comparison.raw.iter().max_by_key(|s| s.len()).and_then(|segment| {
        let [measured, simulated] = sections(state, &model, segment, comparison)?;
        energy_test(&measured, &simulated, SEED)
    });
    Attractor {
        prediction_horizon_s: horizon(state, &model, comparison),
        section_distance: test.map(|t| t.distance),
        section_p_value: test.map(|t| t.p_value),
    }
}

/// What the sensors show at a sample.
fn shown(segment: &AngleSegment, i: usize) -> [f64; 2] {
    let phi = [segment.phi[0][i], segment.phi[1][i]];
    [phi[0], if segment.relative { phi[1] - phi[0] } else { phi[1] }]
}

fn horizon(state: &State, model: &Model<'_>, comparison: &Comparison<'_>) -> f64 {
    let (raw, h) = (comparison.raw, comparison.horizon_s);
    let windows = gap::stretches(raw, comparison.geometry, h, Part::HeldOut, MOST_STARTS);
    let fits = gap::fit_windows(&state.context, model, raw, &windows, comparison.sigma);
    let tolerance = TOLERANCE_DEG.to_radians();
    let mut times: Vec<f64> = windows
        .par_iter()
        .zip(&fits)
        .map(|(&(s, first, _), (at, _))| {
            let segment = &raw[s];
            let longest = (LONGEST * h / segment.step_s) as usize;
            let count = longest.min(segment.len() - first);
            let predicted = model.predict(&state.context, segment, first, count, at);
            let held = predicted.iter().enumerate().position(|(k, p)| {
                let m = shown(segment, first + k);
                (p[0] - m[0]).abs() > tolerance || (p[1] - m[1]).abs() > tolerance
            });
            held.unwrap_or(count) as f64 * segment.step_s
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(0.0)
}

/// Points of a section: cos, sin and velocity of each angle.
type Cloud = Vec<Vec<f64>>;

/// Sections of the record and of the model started from the record's first state.
fn sections(
    state: &State,
    model: &Model<'_>,
    segment: &AngleSegment,
    comparison: &Comparison<'_>,
) -> Option<[Cloud; 2]> {
    if !state.context.driven {
        return None;
    }
    let first = REACH;
    let count = segment.len().checked_sub(2 * REACH).filter(|n| *n > 0)?;
    let window =
        [(comparison.raw.iter().position(|s| core::ptr::eq(s, segment))?, first, window_samples(comparison, segment))];
    let (at, _) = *gap::fit_windows(&state.context, model, comparison.raw, &window, comparison.sigma).first()?;
    let simulated = model.predict(&state.context, segment, first, count, &at);
    let measured: Vec<[f64; 2]> = (first..first + count).map(|i| shown(segment, i)).collect();
    // Where the drive's phase begins a new turn.
    let part = |i: usize| (segment.tau(first + i) / core::f64::consts::TAU).rem_euclid(1.0);
    let crossings: Vec<usize> = (1..count).filter(|&i| part(i) < part(i - 1)).collect();
    let mut clouds = [cloud(&measured, &crossings, segment.step_s), cloud(&simulated, &crossings, segment.step_s)];
    for k in 0..2 {
        let all: Vec<f64> = clouds.iter().flatten().map(|p| p[3 * k + 2]).collect();
        let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
        let scatter = (all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / all.len().max(1) as f64).sqrt();
        if scatter > 0.0 {
            clouds.iter_mut().flatten().for_each(|p| p[3 * k + 2] /= scatter);
        }
    }
    let [measured, simulated] = clouds;
    let finite = |cloud: &Cloud| cloud.iter().flatten().all(|v| v.is_finite());
    (finite(&measured) && finite(&simulated)).then_some([measured, simulated])
}

fn window_samples(comparison: &Comparison<'_>, segment: &AngleSegment) -> usize {
    ((comparison.horizon_s / segment.step_s).round() as usize + 1).min(segment.len() - REACH)
}

/// Points at some samples: cos, sin and velocity of each angle.
fn cloud(angles: &[[f64; 2]], at: &[usize], step_s: f64) -> Cloud {
    at.iter()
        .filter(|&&i| i >= REACH && i + REACH < angles.len())
        .map(|&i| {
            (0..2)
                .flat_map(|k| {
                    let velocity = (angles[i + REACH][k] - angles[i - REACH][k]) / (2.0 * REACH as f64 * step_s);
                    [angles[i][k].cos(), angles[i][k].sin(), velocity]
                })
                .collect()
        })
        .collect()
}
