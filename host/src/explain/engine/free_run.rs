//! Predictions over the end of a record from its beginning, without touching the state (the
//! simulation error), and one simulation of the whole: least-squares fits of shooting
//! ([`crate::identify::shooting`]).

use super::prediction::motion_power;
use crate::identify::shooting::longer::{EXACT, GROWN, PERIOD_SAMPLES, ROUNDS, TOLERANCE};
use crate::identify::shooting::problem::Piece;
use crate::identify::shooting::solve::{Bounds, Start, minimise};
use crate::identify::track::Track;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;

/// Most samples that a simulation is fitted to: of a free system, whose beginning tells on its end,
/// and of one with inputs.
const MOST_FREE: usize = 60_000;
const MOST_DRIVEN: usize = 4_000;
/// Samples over which the step of integration is sought.
const STEP_SAMPLES: usize = 2000;

/// A part of a stretch that a free run is fitted to, and where it ends: samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Split {
    /// Stretch.
    pub stretch: usize,
    /// Beginning of what may be fitted: where the windows begin. A motion that was let go by hand is
    /// not yet free before (by hand: 0.2 s in it, and a simulation from there missed by 1868 times).
    pub begin: usize,
    /// End of what is fitted.
    pub fitted: usize,
    /// End of what is predicted.
    pub end: usize,
}

/// Step of integration for a free run from a piece on.
pub fn step_of(motion: &EquationsOfMotion, parameters: &[f64], track: &Track<'_>, piece: &Piece, guess: &[f64]) -> f64 {
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let longest_s = PERIOD_SAMPLES * track.spacing_s;
    let head = [track.problem(motion, longest_s, &at).head(piece, STEP_SAMPLES)];
    track.step_s(motion, &head, &[guess.to_vec()], parameters, longest_s, EXACT)
}

/// Rms of residuals behind `fitted` samples, of the sensor with the greatest.
fn rms_behind(residuals: &[f64], fitted: usize, track: &Track<'_>) -> f64 {
    let sensors = track.sensors.len();
    let of = |k: usize| {
        let rest = || residuals.iter().skip(fitted * sensors + k).step_by(sensors);
        let mean = rest().map(|r| (r * track.sigma[k]).powi(2)).sum::<f64>() / (rest().count().max(1) as f64);
        mean.sqrt()
    };
    (0..sensors).map(of).fold(0.0, f64::max)
}

/// Parameters as they are, a state fitted to the last `window` samples of what is fitted, then
/// simulated without touching the state: the rms error over the rest.
pub fn run(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    track: &Track<'_>,
    split: Split,
    window: usize,
) -> Option<f64> {
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let window = window.clamp(64, split.fitted.max(64));
    let first = split.fitted.checked_sub(window)?;
    let (whole, guess) = track.piece(split.stretch, first, split.end - first)?;
    let step_s = step_of(motion, parameters, track, &whole, &guess);
    let problem = track.problem(motion, step_s, &at);
    let lengths = [window / 16, window / 4, window].map(|l| l.max(16));
    let mut room = problem.room(false);
    let (state, _) = problem.fit_state(&problem.head(&whole, window), &guess, parameters, &lengths, &mut room)?;
    let residuals = problem.residuals(&whole, &state, parameters)?;
    Some(rms_behind(&residuals, window, track))
}

/// Parameters, each with its sign (0: either; NaN: as it is), and initial state fitted by
/// simulation to what is fitted (its last [`MOST_FREE`] or [`MOST_DRIVEN`] samples), then simulated
/// without touching the state: the fitted parameters, and the rms error over the rest of the sensor
/// with the greatest.
pub fn simulate(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    signs: &[f64],
    track: &Track<'_>,
    split: Split,
) -> Option<(Vec<f64>, f64)> {
    let most = if track.is_driven() { MOST_DRIVEN } else { MOST_FREE };
    let first = split.fitted.saturating_sub(most).max(split.begin);
    let fit = fitted(motion, parameters, signs, track, split, first)?;
    Some((fit.parameters, rms_behind(&fit.residuals, split.fitted - first, track)))
}

/// Mean square, in units of the noise, of what one simulation leaves of a stretch from sample
/// `begin` on, to which (at most [`MOST_FREE`] samples) its parameters and initial state are fitted,
/// and its values; none where the fit does not converge, or where an initial state that is off by
/// the noise is off by more than [`GROWN`] times that in the end: chaos parts any two motions.
pub fn left_of_stretch(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    signs: &[f64],
    track: &Track<'_>,
    (stretch, begin): (usize, usize),
) -> Option<(f64, usize)> {
    let end = track.samples(stretch).min(begin + MOST_FREE);
    let split = Split { stretch, begin, fitted: end, end };
    let fit = fitted(motion, parameters, signs, track, split, begin)?;
    let (piece, _) = track.piece(stretch, begin, end.checked_sub(begin)?)?;
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let problem = track.problem(motion, fit.step_s, &at);
    // Every coordinate by the noise of the sensor that shows it.
    let mut beside = fit.state.clone();
    for (weights, sigma) in track.sensors.iter().zip(&track.sigma) {
        weights.iter().zip(&mut beside).filter(|w| *w.0 != 0.0).for_each(|(_, x)| *x += sigma);
    }
    let moved = problem.residuals(&piece, &beside, &fit.parameters)?;
    let apart = moved.iter().zip(&fit.residuals).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let values = fit.residuals.len();
    let left = fit.residuals.iter().map(|r| r * r).sum::<f64>() / values.max(1) as f64;
    (fit.converged && apart <= GROWN).then_some((left, values))
}

/// A fit by simulation.
struct Fitted {
    parameters: Vec<f64>,
    state: Vec<f64>,
    /// To the split's end, in units of the noise.
    residuals: Vec<f64>,
    converged: bool,
    step_s: f64,
}

/// Bounds of parameters by their signs (0: either; NaN: as it is).
pub fn bounds(signs: &[f64], parameters: &[f64]) -> Bounds {
    let of = |(s, p): (&f64, &f64)| match *s {
        s if s.is_nan() => [*p, *p],
        s => [if s > 0.0 { 0.0 } else { f64::NEG_INFINITY }, if s < 0.0 { 0.0 } else { f64::INFINITY }],
    };
    signs.iter().zip(parameters).map(of).collect()
}

/// Such a fit from sample `first` of a stretch on.
fn fitted(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    signs: &[f64],
    track: &Track<'_>,
    split: Split,
    first: usize,
) -> Option<Fitted> {
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let fitted = split.fitted.checked_sub(first).filter(|n| *n >= 64)?;
    let (piece, guess) = track.piece(split.stretch, first, fitted)?;
    let step_s = step_of(motion, parameters, track, &piece, &guess);
    let problem = track.problem(motion, step_s, &at);
    // The state first, over longer and longer beginnings, then everything over the whole part.
    let lengths: Vec<usize> = (0..).map(|k| 64_usize << (2 * k)).take_while(|l| *l < fitted).chain([fitted]).collect();
    let (state, left) = problem.fit_state(&piece, &guess, parameters, &lengths, &mut problem.room(false))?;
    // What misses by as much as the motion itself is no simulation of it: a fit would not end.
    if left > motion_power(&piece, track) {
        return None;
    }
    let bounds = bounds(signs, parameters);
    let start = Start { parameters, states: vec![state] };
    let fit = minimise(&problem, &[piece], start, &bounds, TOLERANCE, ROUNDS, &mut || {})?;
    let (whole, _) = track.piece(split.stretch, first, split.end - first)?;
    let state = fit.states.first()?.clone();
    let residuals = problem.residuals(&whole, &state, &fit.parameters)?;
    Some(Fitted { parameters: fit.parameters, state, residuals, converged: fit.converged, step_s })
}
