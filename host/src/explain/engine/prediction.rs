//! Predictions by a model file with its effects over short windows with fitted initial states (the
//! gap).
//!
//! They are least-squares fits of shooting ([`crate::identify::shooting`]): derivatives from the
//! variational equations, reversals under dry friction placed exactly.

use rayon::prelude::*;

use super::free_run::step_of;
use crate::identify::shooting::problem::Piece;
use crate::identify::track::Track;
use crate::model::dynamics::Dynamics;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;

/// Most windows of the gap.
const MOST_WINDOWS: usize = 40;
/// Share of what a sensor shows to which solutions are exact.
const EXACT_GAP: f64 = 1e-5;

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
        let sought = || track.step_s(self.motion, pieces, guesses, self.parameters, horizon_s, EXACT_GAP);
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
