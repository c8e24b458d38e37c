//! What the noise of measured inputs leaves of predictions: it goes through the system, and adds up
//! along a piece as what a model misses does.

use nalgebra::DVector;

use super::problem::Problem;
use super::run::Outcome;
use super::{Given, longer};
use crate::identify::input_noise::disturb;
use crate::identify::stretches::Stretch;
use crate::identify::track::{ExogenousInputs, Track};
use crate::model::dynamics::Dynamics;

/// Times that inputs are disturbed by as much again.
const REPEATS: u64 = 8;

/// The mean square that the difference between inputs leaves, in the sensors' noise, each piece's
/// initial state fitted to it; none where the equations have no solution.
fn left<D: Dynamics + ?Sized>(own: &Problem<'_, D>, disturbed: &Problem<'_, D>, outcome: &Outcome) -> Option<f64> {
    let (mut sum, mut freedom) = (0.0, 0.0);
    let parameters = &outcome.fit.parameters;
    for (piece, state) in outcome.pieces.iter().zip(&outcome.fit.states) {
        let (before, by_state) = own.linear(piece, state, parameters)?;
        let difference: DVector<f64> = disturbed.linear(piece, state, parameters)?.0 - before;
        let q = by_state.qr().q();
        sum += (&difference - &q * (q.transpose() * &difference)).norm_squared();
        freedom += difference.len() as f64 - own.states() as f64;
    }
    Some(sum / freedom.max(1.0))
}

/// How much more of the inputs' noise long pieces leave than short ones; nothing where no noise of
/// theirs is known, and none where the equations have no solution with it.
pub fn more<D: Dynamics + ?Sized>(
    given: &Given<'_>,
    problem: &Problem<'_, D>,
    short: &Outcome,
    long: &Outcome,
) -> Option<longer::Expected> {
    let Given { rig, bound, prepared, .. } = *given;
    let levels = &prepared.sensors.inputs;
    if levels.iter().all(|l| l.sigma() == 0.0) {
        return Some(longer::Expected::default());
    }
    let omega = rig.drive.map_or(0.0, |_| rig.omega());
    let once = |seed: u64| -> Option<f64> {
        let mut stretches: Vec<Stretch> = prepared.stretches.clone();
        (0_u64..).zip(&mut stretches).for_each(|(stream, s)| disturb(s, levels, 1.0, seed, stream));
        let exogenous: Vec<ExogenousInputs> = stretches.iter().map(|s| ExogenousInputs::new(s, omega)).collect();
        let track = Track::new(&stretches, &exogenous, rig, bound, &prepared.sensors);
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let inputs = track.problem(problem.dynamics, problem.step_s, &at).inputs;
        let disturbed = Problem { inputs, ..*problem };
        Some(left(problem, &disturbed, long)? - left(problem, &disturbed, short)?)
    };
    let all: Vec<f64> = (0..REPEATS).map(once).collect::<Option<_>>()?;
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let variance = all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (all.len() - 1) as f64;
    // The record's own noise is one more of them.
    Some(longer::Expected { mean, variance: variance * (1.0 + 1.0 / all.len() as f64) })
}
