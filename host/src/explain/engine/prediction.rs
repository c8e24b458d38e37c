//! Predictions by a model file with its effects: over short windows with fitted initial states (the
//! gap), and over the end of a record from its beginning, without touching the state (the
//! simulation error).
//!
//! Both are least-squares fits of shooting ([`crate::identify::shooting`]): derivatives from the
//! variational equations, reversals under dry friction placed exactly.

use rayon::prelude::*;

use crate::identify::shooting::problem::Piece;
use crate::identify::shooting::solve::{Bounds, Start, minimise};
use crate::identify::track::Track;
use crate::model::dynamics::Dynamics;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;

/// Most windows of the gap.
const MOST_WINDOWS: usize = 40;
/// Most samples that a simulation is fitted to: of a free system, whose beginning tells on its end,
/// and of one with inputs.
const MOST_FREE: usize = 60_000;
const MOST_DRIVEN: usize = 4_000;
/// Samples over which the step of integration is sought.
const STEP_SAMPLES: usize = 2000;
/// Most rounds of a fit by simulation, and the promise, in squared standard errors, at which it
/// stops.
const ROUNDS: usize = 8;
const TOLERANCE: f64 = 1e-2;
/// Growth of an initial error over a record up to which one simulation follows it: that of swings
/// whose frequency depends on their size stays below, chaos is beyond in ten to twenty periods.
const GROWN: f64 = 100.0;
/// Shares of what a sensor shows to which solutions are exact, for the gap and for simulations.
const EXACT_GAP: f64 = 1e-5;
const EXACT: f64 = 1e-4;
/// What stands for a drive's period in the search for the step of integration, s.
const PERIOD_S: f64 = 0.2;

/// Range, over the noise, up to which a sensor shows a system at rest: two counts, each √12 times
/// the noise of its rounding.
const AT_REST: f64 = 7.0;

/// Where predictions are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Part {
    /// Inside the held-out blocks: every third, s each.
    HeldOut(f64),
    /// From a sample of a stretch on, and in every later stretch.
    From(usize, usize),
}

/// Windows that predictions are made in.
struct Windows {
    pieces: Vec<Piece>,
    /// Guesses of their states, and whether each is as good as a fit over a short beginning.
    guesses: Vec<Vec<f64>>,
    known: Vec<bool>,
    /// Stretch and first sample of each.
    places: Vec<(usize, usize)>,
    /// Samples of each.
    length: usize,
}

/// At most `most` windows of a horizon in a part of the record, spread evenly.
fn windows(track: &Track<'_>, horizon_s: f64, part: Part, most: usize) -> Option<Windows> {
    let length = ((horizon_s / track.spacing_s).round() as usize).max(8) + 1;
    let all = track.cut(length, (length / 12).clamp(3, 16))?;
    let values = length * track.sensors.len();
    let place = |k: usize| {
        let since_s = track.since_begin(&all.pieces[k]);
        (all.pieces[k].stretch, (since_s / track.spacing_s).round() as usize)
    };
    // Where states are known from windows that were followed, one whose start has to be sought, and
    // may not be found, decides nothing.
    let known = all.known.iter().filter(|k| **k).count();
    let only_known = 2 * known >= all.known.len();
    let kept: Vec<usize> = (0..all.pieces.len())
        .filter(|&k| all.pieces[k].measured.len() == values && (!only_known || all.known[k]))
        .filter(|&k| match part {
            Part::HeldOut(block_s) => {
                let block = (track.since_begin(&all.pieces[k]) / block_s).floor() as i64;
                block.rem_euclid(3) == 0
            }
            Part::From(stretch, sample) => place(k) >= (stretch, sample),
        })
        .collect();
    let moving: Vec<usize> = kept.iter().copied().filter(|&k| moves(&all.pieces[k], track)).collect();
    let kept = if matches!(part, Part::HeldOut(_)) && !moving.is_empty() { moving } else { kept };
    let stride = kept.len().div_ceil(most).max(1);
    let kept: Vec<usize> = kept.into_iter().step_by(stride).collect();
    Some(Windows {
        places: kept.iter().map(|&k| place(k)).collect(),
        guesses: kept.iter().map(|&k| all.guesses[k].clone()).collect(),
        known: kept.iter().map(|&k| all.known[k]).collect(),
        pieces: kept.into_iter().map(|k| all.pieces[k].clone()).collect(),
        length,
    })
}

/// Whether a window shows any motion: what rests on one count is off by as much everywhere, up to
/// √3 times the noise of what crosses counts, and a model of it can be no better.
fn moves(piece: &Piece, track: &Track<'_>) -> bool {
    let m = track.sensors.len().max(1);
    (0..track.sensors.len()).any(|k| {
        let of = piece.measured.iter().skip(k).step_by(m);
        let (low, high) = of.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        high - low > AT_REST * track.sigma[k]
    })
}

/// Rms motion about the mean over the gap's windows, over the noise; none where that is no number.
pub fn motion(track: &Track<'_>, horizon_s: f64, block_s: f64) -> Option<f64> {
    let windows = windows(track, horizon_s, Part::HeldOut(block_s), MOST_WINDOWS)?;
    let sum: f64 = windows.pieces.iter().map(|p| motion_power(p, track)).sum();
    let rms = (sum / windows.pieces.len() as f64).sqrt();
    (rms.is_finite() && rms > 0.0).then_some(rms)
}

/// A model that predicts: its equations, their parameters, and the step of integration, which is
/// sought where none is given.
#[derive(Clone, Copy)]
pub struct Model<'a> {
    /// Equations.
    pub motion: &'a EquationsOfMotion,
    /// Values.
    pub parameters: &'a [f64],
    /// Step, s.
    pub step_s: Option<f64>,
}

/// A window's fitted state, and the mean square residual that is left; none where the model has no
/// solution.
type State = Option<(Vec<f64>, f64)>;

impl Model<'_> {
    /// Fits the states of windows; the problem that they were fitted in has this step.
    fn states(&self, track: &Track<'_>, windows: &Windows, horizon_s: f64) -> (Vec<State>, f64) {
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let (pieces, guesses) = (&windows.pieces, &windows.guesses);
        let sought = || track.step_s(self.motion, pieces, guesses, self.parameters, PERIOD_S.min(horizon_s), EXACT_GAP);
        let step_s = self.step_s.unwrap_or_else(sought);
        let problem = track.problem(self.motion, step_s, &at);
        let lengths = [(windows.length / 4).max(8), windows.length];
        let of = |k: usize| lengths[usize::from(windows.known[k])..].to_vec();
        let found = problem.fit_states(pieces, guesses, self.parameters, &of);
        (found, step_s)
    }

    /// The gap over windows of the horizon inside the held-out blocks: rms of predicted minus
    /// measured over the noise, over the degrees of freedom that the fit of the initial state
    /// leaves.
    pub fn gap(&self, track: &Track<'_>, (horizon_s, block_s): (f64, f64)) -> f64 {
        let Some(windows) = windows(track, horizon_s, Part::HeldOut(block_s), MOST_WINDOWS) else { return f64::NAN };
        let values = (windows.length * track.sensors.len()) as f64;
        let states = 2.0 * self.motion.degrees_of_freedom() as f64;
        let left: Vec<f64> = self.states(track, &windows, horizon_s).0.into_iter().flatten().map(|s| s.1).collect();
        let freedom = left.len() as f64 * (values - states);
        if freedom > 0.0 { (left.iter().sum::<f64>() * values / freedom).sqrt() } else { f64::NAN }
    }

    /// Rms of predicted minus measured over windows in a part of the record, over all sensors, SI;
    /// none where there is no window.
    pub fn error(&self, track: &Track<'_>, horizon_s: f64, part: Part, most: usize) -> Option<f64> {
        let windows = windows(track, horizon_s, part, most).filter(|w| !w.pieces.is_empty())?;
        let (states, step_s) = self.states(track, &windows, horizon_s);
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let problem = track.problem(self.motion, step_s, &at);
        let sensors = track.sensors.len().max(1);
        let squares: Vec<f64> = windows
            .pieces
            .par_iter()
            .zip(&states)
            .filter_map(|(piece, state)| {
                let left = problem.residuals(piece, &state.as_ref()?.0, self.parameters)?;
                Some(left.iter().enumerate().map(|(i, r)| (r * track.sigma[i % sensors]).powi(2)).sum::<f64>())
            })
            .collect();
        let values = (squares.len() * windows.length * sensors) as f64;
        Some((squares.iter().sum::<f64>() / values).sqrt())
    }

    /// How long predictions from held-out windows, whose states were fitted over the horizon, hold
    /// until a sensor is off by its tolerance: the median, s. They run for `longest_s` at most.
    pub fn holds_s(
        &self,
        track: &Track<'_>,
        (horizon_s, block_s): (f64, f64),
        tolerance: &[f64],
        longest_s: f64,
    ) -> Option<f64> {
        let windows = windows(track, horizon_s, Part::HeldOut(block_s), MOST_WINDOWS)?;
        let (states, step_s) = self.states(track, &windows, horizon_s);
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let problem = track.problem(self.motion, step_s, &at);
        let sensors = track.sensors.len().max(1);
        let mut times: Vec<f64> = windows
            .places
            .par_iter()
            .zip(&states)
            .filter_map(|(&(stretch, first), state)| {
                let (state, _) = state.as_ref()?;
                let longest = ((longest_s / track.spacing_s) as usize).min(track.samples(stretch) - first);
                // Longer and longer, since few hold to the end.
                let lengths = [4, 16].map(|f| f * windows.length).into_iter().filter(|l| *l < longest);
                lengths.chain([longest]).find_map(|count| {
                    let (piece, _) = track.piece(stretch, first, count)?;
                    let left = problem.residuals_until(&piece, state, self.parameters);
                    let off = |(i, r): (usize, &f64)| (r * track.sigma[i % sensors]).abs() > tolerance[i % sensors];
                    let held = left.iter().enumerate().position(off);
                    let ended = held.or((left.len() < count * sensors || count == longest).then_some(left.len()))?;
                    Some((ended / sensors) as f64 * track.spacing_s)
                })
            })
            .collect();
        times.sort_by(f64::total_cmp);
        times.get(times.len() / 2).copied()
    }

    /// Free predictions from at most `most` held-out windows, whose states were fitted over the
    /// horizon: stretch and first sample of each, and predicted minus measured over `span_s` (where
    /// the record goes on for so long), SI, sensor after sensor within a sample; shorter where the
    /// solution ends.
    pub fn free(
        &self,
        track: &Track<'_>,
        (horizon_s, block_s): (f64, f64),
        span_s: f64,
        most: usize,
    ) -> Vec<((usize, usize), Vec<f64>)> {
        let Some(windows) = windows(track, horizon_s, Part::HeldOut(block_s), most) else { return Vec::new() };
        let (states, step_s) = self.states(track, &windows, horizon_s);
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let problem = track.problem(self.motion, step_s, &at);
        let (sensors, count) = (track.sensors.len().max(1), (span_s / track.spacing_s).round() as usize + 1);
        let places = windows.places.par_iter().zip(&states);
        places
            .filter_map(|(&(stretch, first), state)| {
                let (state, _) = state.as_ref()?;
                if first + count > track.samples(stretch) {
                    return None;
                }
                let (piece, _) = track.piece(stretch, first, count)?;
                let left = problem.residuals_until(&piece, state, self.parameters);
                let left = left.iter().enumerate().map(|(i, r)| r * track.sigma[i % sensors]).collect();
                Some(((stretch, first), left))
            })
            .collect()
    }

    /// What the sensors would show of a stretch from its first state, fitted over a horizon, sensor
    /// by sensor; shorter where the solution ends.
    pub fn shown(&self, track: &Track<'_>, stretch: usize, horizon_s: f64) -> Option<Vec<Vec<f64>>> {
        let (piece, guess) = track.piece(stretch, 0, track.samples(stretch))?;
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let step_s = self.step_s.unwrap_or_else(|| step_of(self.motion, self.parameters, track, &piece, &guess));
        let problem = track.problem(self.motion, step_s, &at);
        let length = ((horizon_s / track.spacing_s).round() as usize).max(8) + 1;
        let mut room = problem.room(false);
        let head = problem.head(&piece, length);
        let (state, _) =
            problem.fit_state(&head, &guess, self.parameters, &[(length / 4).max(8), length], &mut room)?;
        let left = problem.residuals_until(&piece, &state, self.parameters);
        let sensors = track.sensors.len();
        let of = |k: usize| {
            let both = left.iter().zip(&piece.measured).skip(k).step_by(sensors);
            both.map(|(r, y)| r * track.sigma[k] + y).collect()
        };
        Some((0..sensors).map(of).collect())
    }
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
    track.step_s(motion, &head, &[guess.to_vec()], parameters, PERIOD_S, EXACT)
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
    span: Span,
) -> Option<(Vec<f64>, f64)> {
    let most = if track.is_driven() { MOST_DRIVEN } else { MOST_FREE };
    let first = span.fitted.saturating_sub(most);
    let fit = fitted(motion, parameters, signs, track, span, first)?;
    Some((fit.parameters, rms_behind(&fit.residuals, span.fitted - first, track)))
}

/// Mean square, in units of the noise, of what one simulation leaves of a stretch whose beginning
/// (at most [`MOST_FREE`] samples) its parameters and initial state are fitted to, and its values;
/// none where the fit does not converge, or where an initial state that is off by the noise is off
/// by more than [`GROWN`] times that in the end: chaos parts any two motions.
pub fn left_of_stretch(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    signs: &[f64],
    track: &Track<'_>,
    stretch: usize,
) -> Option<(f64, usize)> {
    let end = track.samples(stretch).min(MOST_FREE);
    let fit = fitted(motion, parameters, signs, track, Span { stretch, fitted: end, end }, 0)?;
    let (piece, _) = track.piece(stretch, 0, end)?;
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
    /// To the span's end, in units of the noise.
    residuals: Vec<f64>,
    converged: bool,
    step_s: f64,
}

/// Such a fit from sample `first` of a stretch on.
fn fitted(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    signs: &[f64],
    track: &Track<'_>,
    span: Span,
    first: usize,
) -> Option<Fitted> {
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
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
    let start = Start { parameters, states: vec![state] };
    let fit = minimise(&problem, &[piece], start, &bounds, TOLERANCE, ROUNDS, &mut || {})?;
    let (whole, _) = track.piece(span.stretch, first, span.end - first)?;
    let state = fit.states.first()?.clone();
    let residuals = problem.residuals(&whole, &state, &fit.parameters)?;
    Some(Fitted { parameters: fit.parameters, state, residuals, converged: fit.converged, step_s })
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
