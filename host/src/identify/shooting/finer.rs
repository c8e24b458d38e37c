//! The step of integration of a fit, as fine as its parameters need it.
//!
//! What a step leaves of a solution is no noise: it is alike all along a record (Dormand and Prince's
//! method takes (1/600 − 1/720)(ωh)⁶ off an oscillation in every step, as a damping would that is not
//! there). A share of the sensors' noise in every sample, it adds up in parameters, whose standard
//! errors shrink with the number of samples. With e = y_h − y_{h/2} what half the step changes, in the
//! noise, and J the derivatives of what is predicted by the parameters, states eliminated, half the
//! step moves the parameters by H⁻¹Jᵀe, H = JᵀJ: no combination of them by more standard errors than
//! the root of eᵀJ H⁻¹ Jᵀe. While that promises more than a fit is to leave, the fit goes on with a
//! finer step.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::problem::{Piece, Problem, Share};
use super::run::FINEST;
use super::solve::{Bounds, Reduced, ShootingFit, Start, minimise, reduce, solve_scaled};
use crate::model::dynamics::Dynamics;
use crate::model::flow::Work;

/// Half the step takes its promise down by 2¹⁰ (a method of order 5).
const DOUBLINGS: f64 = 10.0;
/// Most halvings at once.
const MOST_AT_ONCE: f64 = 3.0;
/// Share of a promise that a finer step leaves at most, where the step is what makes it: kinks and
/// rounding keep theirs (by hand).
const LESS: f64 = 0.25;

/// As [`minimise`], with steps of integration from the problem's own on so fine that half of the last
/// one promises less than `tolerance`; and that step, s. Pieces under a drive are a few of its periods,
/// over which steps do not add up: of a driven Duffing oscillator, up to 500 000 values, none moved a
/// parameter by more than a twentieth of its standard error.
pub fn minimise_finely<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    pieces: &[Piece],
    start: Start<'_>,
    bounds: &Bounds,
    tolerance: f64,
    most: usize,
    tick: &mut dyn FnMut(),
) -> Option<(ShootingFit, f64)> {
    let mut step_s = problem.step_s;
    let mut fit = minimise(problem, pieces, start, bounds, tolerance, most, tick)?;
    let mut before = f64::INFINITY;
    while problem.omega == 0.0 && fit.converged && step_s >= FINEST * problem.spacing_s {
        let promise = promise_of_half(&Problem { step_s, ..*problem }, pieces, &fit);
        let Some(promise) = promise.filter(|p| *p >= tolerance && *p < LESS * before) else { break };
        let halvings = ((promise / tolerance).log2() / DOUBLINGS).ceil().clamp(1.0, MOST_AT_ONCE);
        let finer_s = (step_s * (-halvings).exp2()).max(0.5 * FINEST * problem.spacing_s);
        let finer = Problem { step_s: finer_s, ..*problem };
        let from = Start { parameters: &fit.parameters, states: fit.states.clone() };
        let next = minimise(&finer, pieces, from, bounds, tolerance, most, tick);
        let Some(next) = next.filter(|f| f.converged) else { break };
        fit = ShootingFit { rounds: fit.rounds + next.rounds, ..next };
        (step_s, before) = (finer_s, promise);
    }
    Some((fit, step_s))
}

/// What half the step promises at a minimum, in squared standard errors; none where the equations
/// have no solution with it.
fn promise_of_half<D: Dynamics + ?Sized>(problem: &Problem<'_, D>, pieces: &[Piece], fit: &ShootingFit) -> Option<f64> {
    let (x, p, sensors) = (problem.states(), fit.parameters.len(), problem.sensors.len());
    let half = Problem { step_s: 0.5 * problem.step_s, ..*problem };
    // The share of a record that shows what half the step predicts.
    let share = |work: &mut Work, (piece, state): (&Piece, &Vec<f64>)| -> Option<Share> {
        let left = half.residuals(piece, state, &fit.parameters)?;
        let shown = piece.measured.iter().zip(&left).enumerate();
        let measured = shown.map(|(i, (y, r))| y + r * problem.sigma[i % sensors]).collect();
        problem.share(&Piece { measured, ..*piece }, state, &fit.parameters, work)
    };
    let shares: Option<Vec<Share>> =
        pieces.par_iter().zip(&fit.states).map_init(|| problem.room(true), share).collect();
    let reduced: Vec<Reduced> = shares?.iter().map(|s| reduce(s, x, 0.0)).collect::<Option<_>>()?;
    let normal = reduced.iter().fold(DMatrix::zeros(p, p), |sum, r| sum + &r.normal);
    let gradient = reduced.iter().fold(DVector::zeros(p), |sum, r| sum + &r.gradient);
    let step = solve_scaled(&normal, &gradient, 0.0, &fit.held)?;
    let cost: f64 = fit.shares.iter().map(Share::cost).sum();
    let freedom = fit.shares.iter().map(|s| s.samples * sensors - x).sum::<usize>().max(1) as f64;
    Some(step.dot(&gradient) * freedom / cost)
}
