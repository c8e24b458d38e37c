//! Predictions by a model file with its effects: over short windows with fitted initial states (the gap), and over the end of a record
//! from its beginning, without touching the state (the simulation error).
//!
//! Both are least-squares fits of shooting ([`crate::identify::shooting`]): derivatives from the variational equations, reversals under dry
//! friction placed exactly.

use rayon::prelude::*;

use crate::identify::general::track::Track;
use crate::identify::shooting::problem::Piece;
use crate::identify::shooting::solve::{Bounds, minimise};
use crate::model::model_file::equations_of_motion::EquationsOfMotion;

/// Most windows of the gap.
const MOST_WINDOWS: usize = 40;
/// Most samples that a simulation is fitted to: of a free system, whose beginning tells on its end, and of one with inputs.
const MOST_FREE: usize = 60_000;
const MOST_DRIVEN: usize = 4_000;
/// Samples over which the step of integration is sought.
const STEP_SAMPLES: usize = 2000;
/// Most rounds of a fit by simulation, and the promise, in squared standard errors, at which it stops.
const ROUNDS: usize = 8;
const TOLERANCE: f64 = 1e-2;
/// Shares of what a sensor shows to which solutions are exact, for the gap and for simulations.
const EXACT_GAP: f64 = 1e-5;
const EXACT: f64 = 1e-4;
/// What stands for a drive's period in the search for the step of integration, s.
const PERIOD_S: f64 = 0.2;

/// Windows of the horizon inside the held-out blocks (every third of `block_s`), with guesses of their states, and the samples of each.
fn windows(track: &Track<'_>, horizon_s: f64, block_s: f64) -> Option<(Vec<Piece>, Vec<Vec<f64>>, usize)> {
    let length = ((horizon_s / track.spacing_s).round() as usize).max(8) + 1;
    let all = track.cut(length, (length / 12).clamp(3, 16))?;
    let values = length * track.sensors.len();
    let mut kept = Vec::new();
    for (k, piece) in all.pieces.iter().enumerate() {
        let block = (track.since_begin(all.stretch[k], piece) / block_s).floor() as i64;
        if piece.measured.len() == values && block.rem_euclid(3) == 0 {
            kept.push(k);
        }
    }
    let stride = kept.len().div_ceil(MOST_WINDOWS).max(1);
    let (pieces, guesses) =
        kept.into_iter().step_by(stride).map(|k| (all.pieces[k].clone(), all.guesses[k].clone())).unzip();
    Some((pieces, guesses, length))
}

/// Rms motion about the mean over the gap's windows, over the noise; none where that is no number.
pub fn motion(track: &Track<'_>, horizon_s: f64, block_s: f64) -> Option<f64> {
    let (pieces, ..) = windows(track, horizon_s, block_s)?;
    let sum: f64 = pieces.iter().map(|p| motion_power(p, track)).sum();
    let rms = (sum / pieces.len() as f64).sqrt();
    (rms.is_finite() && rms > 0.0).then_some(rms)
}

/// The gap over windows of the horizon inside the held-out blocks (every third of `block_s`): rms of predicted minus measured over
/// the noise, over the degrees of freedom that the fit of the initial state leaves. The step of integration is sought where none is given.
pub fn gap(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    track: &Track<'_>,
    (horizon_s, block_s): (f64, f64),
    step_s: Option<f64>,
) -> f64 {
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let Some((pieces, guesses, length)) = windows(track, horizon_s, block_s) else { return f64::NAN };
    let values = length * track.sensors.len();
    let sought = || track.step_s(motion, &pieces, &guesses, parameters, (PERIOD_S.min(horizon_s), EXACT_GAP));
    let problem = track.problem(motion, step_s.unwrap_or_else(sought), &at);
    let lengths = [(length / 4).max(8), length];
    let sums: Vec<Option<f64>> = pieces
        .par_iter()
        .zip(&guesses)
        .map_init(
            || problem.room(false),
            |work, (piece, guess)| {
                problem.fit_state(piece, guess, parameters, &lengths, work).map(|f| f.1 * values as f64)
            },
        )
        .collect();
    let freedom = sums.iter().flatten().count() as f64 * (values as f64 - problem.states() as f64);
    if freedom > 0.0 { (sums.iter().flatten().sum::<f64>() / freedom).sqrt() } else { f64::NAN }
}

/// A part of a stretch that a free run is fitted to, and where it ends: samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Stretch.
    pub stretch: usize,
    /// End of what is fitted.
    pub fitted: usize,
    /// End of what is predicted.
    pub end: usize,
}

/// Step of integration for a free run from a piece on.
fn step_of(motion: &EquationsOfMotion, parameters: &[f64], track: &Track<'_>, piece: &Piece, guess: &[f64]) -> f64 {
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let head = [track.problem(motion, PERIOD_S, &at).head(piece, STEP_SAMPLES)];
    track.step_s(motion, &head, &[guess.to_vec()], parameters, (PERIOD_S, EXACT))
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

/// Parameters as they are, a state fitted to the last `window` samples of what is fitted, then simulated without touching the state: the rms error over the rest.
pub fn run(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    track: &Track<'_>,
    span: Span,
    window: usize,
) -> Option<f64> {
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let window = window.clamp(64, span.fitted.max(64));
    let first = span.fitted.checked_sub(window)?;
    let (whole, guess) = track.piece(span.stretch, first, span.end - first)?;
    let step_s = step_of(motion, parameters, track, &whole, &guess);
    let problem = track.problem(motion, step_s, &at);
    let lengths = [window / 16, window / 4, window].map(|l| l.max(16));
    let mut room = problem.room(false);
    let (state, _) = problem.fit_state(&problem.head(&whole, window), &guess, parameters, &lengths, &mut room)?;
    let residuals = problem.residuals(&whole, &state, parameters, &mut room)?;
    Some(rms_behind(&residuals, window, track))
}

/// Parameters, each with its sign (0: either; NaN: as it is), and initial state fitted by simulation to what is fitted (its last
/// [`MOST_FREE`] or [`MOST_DRIVEN`] samples), then simulated without touching the state: the fitted parameters, and the rms
/// error over the rest of the sensor with the greatest.
pub fn simulate(
    motion: &EquationsOfMotion,
    (parameters, signs): (&[f64], &[f64]),
    track: &Track<'_>,
    span: Span,
) -> Option<(Vec<f64>, f64)> {
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let most = if track.is_driven() { MOST_DRIVEN } else { MOST_FREE };
    let first = span.fitted.saturating_sub(most);
    let fitted = span.fitted - first;
    if fitted < 64 {
        return None;
    }
    let (piece, guess) = track.piece(span.stretch, first, fitted)?;
    let step_s = step_of(motion, parameters, track, &piece, &guess);
    let problem = track.problem(motion, step_s, &at);
    // The state first, over longer and longer beginnings, then everything over the whole part.
    let lengths: Vec<usize> = (0..).map(|k| 64_usize << (2 * k)).take_while(|l| *l < fitted).chain([fitted]).collect();
    let (state, _) = problem.fit_state(&piece, &guess, parameters, &lengths, &mut problem.room(false))?;
    let bounds: Bounds = signs
        .iter()
        .zip(parameters)
        .map(|(s, p)| match *s {
            s if s.is_nan() => [*p, *p],
            s => [if s > 0.0 { 0.0 } else { f64::NEG_INFINITY }, if s < 0.0 { 0.0 } else { f64::INFINITY }],
        })
        .collect();
    let fit = minimise(&problem, &[piece], (parameters, vec![state]), &bounds, TOLERANCE, ROUNDS, &mut || {})?;
    let (whole, _) = track.piece(span.stretch, first, span.end - first)?;
    let residuals = problem.residuals(&whole, fit.states.first()?, &fit.parameters, &mut problem.room(false))?;
    Some((fit.parameters, rms_behind(&residuals, fitted, track)))
}

/// Mean square of a piece's motion about its mean, in units of the noise.
fn motion_power(piece: &Piece, track: &Track<'_>) -> f64 {
    let m = track.sensors.len();
    let count = (piece.measured.len() / m.max(1)).max(1) as f64;
    let sum: f64 = (0..m)
        .map(|k| {
            let of = || piece.measured.iter().skip(k).step_by(m);
            let mean = of().sum::<f64>() / count;
            of().map(|x| ((x - mean) / track.sigma[k]).powi(2)).sum::<f64>()
        })
        .sum();
    sum / (count * m.max(1) as f64)
}
