//! Predictions by a model file with its effects over short windows with fitted initial states (the
//! gap).
//!
//! They are least-squares fits of shooting ([`crate::identify::shooting`]): derivatives from the
//! variational equations, reversals under dry friction placed exactly.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::shooting::MOST_LOST;
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

/// A part of a stretch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// Stretch.
    pub stretch: usize,
    /// Sample of it at which the part begins.
    pub begin: usize,
    /// Sample at which it ends.
    pub end: usize,
}

/// Predictions of what was not fitted.
#[derive(Clone, Copy, Debug)]
pub struct Predictions<'a> {
    /// Horizon of the gap, s.
    pub horizon_s: f64,
    /// Longest over which it is measured: a window, s.
    pub longest_s: f64,
    /// What the coefficients that they are made with were not fitted to.
    pub held_out: &'a [Range],
    /// Step of integration, s; sought where none is given.
    pub step_s: Option<f64>,
}

/// Where predictions are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Part<'a> {
    /// Inside what was not fitted.
    HeldOut(&'a [Range]),
    /// From a sample of a stretch on, and in every later stretch.
    From(usize, usize),
}

impl Part<'_> {
    /// Stretch and first sample of windows of some samples, a quarter of one apart.
    fn places(&self, track: &Track<'_>, length: usize) -> Vec<(usize, usize)> {
        let hop = (length / 4).max(16);
        // The last sample is the first of what follows.
        let inside = |Range { stretch, begin, end }: Range| {
            let last = (end + 1).min(track.samples(stretch)).checked_sub(length).filter(|last| *last >= begin);
            last.into_iter().flat_map(move |last| (begin..=last).step_by(hop).map(move |first| (stretch, first)))
        };
        match *self {
            Self::HeldOut(ranges) => ranges.iter().copied().flat_map(inside).collect(),
            Self::From(stretch, sample) => {
                let begin = |k: usize| if k == stretch { sample } else { 0 };
                let from = |k: usize| Range { stretch: k, begin: begin(k), end: track.samples(k) };
                (stretch..track.stretches()).map(from).flat_map(inside).collect()
            }
        }
    }
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

/// Samples over a horizon, its two ends among them.
fn samples(track: &Track<'_>, horizon_s: f64) -> usize {
    ((horizon_s / track.spacing_s).round() as usize).max(8) + 1
}

/// At most `most` windows of a horizon in a part of the record, spread evenly.
fn windows(track: &Track<'_>, horizon_s: f64, part: Part<'_>, most: usize) -> Windows {
    let length = samples(track, horizon_s);
    let known = |at: (usize, usize)| (at, track.is_known(at.0, at.1));
    let mut all: Vec<((usize, usize), bool)> = part.places(track, length).into_iter().map(known).collect();
    // Where states are known from windows that were followed, one whose start has to be sought, and
    // may not be found, decides nothing.
    if 2 * all.iter().filter(|(_, known)| *known).count() >= all.len() {
        all.retain(|(_, known)| *known);
    }
    if matches!(part, Part::HeldOut(_)) {
        // Cut one by one: they overlap, and all together are several copies of the record.
        let shows = |&((stretch, first), _): &((usize, usize), bool)| {
            track.piece(stretch, first, length).is_some_and(|(piece, _)| moves(&piece, track))
        };
        let moving: Vec<bool> = all.par_iter().map(shows).collect();
        if moving.contains(&true) {
            let mut moving = moving.into_iter();
            all.retain(|_| moving.next().unwrap_or(true));
        }
    }
    let stride = all.len().div_ceil(most).max(1);
    let mut out = Windows { pieces: Vec::new(), guesses: Vec::new(), known: Vec::new(), places: Vec::new(), length };
    for ((stretch, first), known) in all.into_iter().step_by(stride) {
        let Some((piece, guess)) = track.piece(stretch, first, length) else { continue };
        out.pieces.push(piece);
        out.guesses.push(guess);
        out.known.push(known);
        out.places.push((stretch, first));
    }
    out
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

/// Rms motion about the mean over windows of the horizon, over the noise; none where that is no
/// number.
pub fn motion(track: &Track<'_>, horizon_s: f64) -> Option<f64> {
    let windows = windows(track, horizon_s, Part::From(0, 0), MOST_WINDOWS);
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

    /// The gap over windows of the horizon inside what was not fitted: rms of predicted minus
    /// measured over the noise, over the degrees of freedom that the fit of the initial state
    /// leaves. Windows in which the model has no solution are left out while they are few, and then
    /// count as their motion.
    pub fn gap(&self, track: &Track<'_>, horizon_s: f64, held_out: &[Range]) -> f64 {
        let windows = windows(track, horizon_s, Part::HeldOut(held_out), MOST_WINDOWS);
        let values = (windows.length * track.sensors.len()) as f64;
        let states = 2.0 * self.motion.degrees_of_freedom() as f64;
        let found = self.states(track, &windows, horizon_s).0;
        let left = with_lost(&windows, &found, |_, (_, left)| Some(*left), |piece| motion_power(piece, track));
        let freedom = left.len() as f64 * (values - states);
        if freedom > 0.0 { (left.iter().sum::<f64>() * values / freedom).sqrt() } else { f64::NAN }
    }

    /// Rms of predicted minus measured over windows in a part of the record, over all sensors, SI;
    /// none where there is no window.
    pub fn error(&self, track: &Track<'_>, horizon_s: f64, part: Part<'_>, most: usize) -> Option<f64> {
        let windows = windows(track, horizon_s, part, most);
        if windows.pieces.is_empty() {
            return None;
        }
        let (states, step_s) = self.states(track, &windows, horizon_s);
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let problem = track.problem(self.motion, step_s, &at);
        let sensors = track.sensors.len().max(1);
        let off = |piece: &Piece, (state, _): &(Vec<f64>, f64)| {
            let left = problem.residuals(piece, state, self.parameters)?;
            Some(left.iter().enumerate().map(|(i, r)| (r * track.sigma[i % sensors]).powi(2)).sum::<f64>())
        };
        let moved = |piece: &Piece| (0..sensors).map(|k| about_mean(piece, sensors, k)).sum::<f64>();
        let squares = with_lost(&windows, &states, off, moved);
        let values = (squares.len() * windows.length * sensors) as f64;
        Some((squares.iter().sum::<f64>() / values).sqrt())
    }

    /// How long predictions from windows inside what was not fitted, whose states were fitted over
    /// the horizon, hold until a sensor is off by its tolerance: the median, s; nothing where the
    /// model has no solution. They run for `longest_s` at most.
    pub fn holds_s(&self, track: &Track<'_>, how: Predictions<'_>, tolerance: &[f64], longest_s: f64) -> Option<f64> {
        let windows = windows(track, how.horizon_s, Part::HeldOut(how.held_out), MOST_WINDOWS);
        let (states, step_s) = self.states(track, &windows, how.horizon_s);
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let problem = track.problem(self.motion, step_s, &at);
        let sensors = track.sensors.len().max(1);
        let mut times: Vec<f64> = windows
            .places
            .par_iter()
            .zip(&states)
            .filter_map(|(&(stretch, first), state)| {
                let Some((state, _)) = state else { return Some(0.0) };
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
        how: Predictions<'_>,
        span_s: f64,
        most: usize,
    ) -> Vec<((usize, usize), Vec<f64>)> {
        let windows = windows(track, how.horizon_s, Part::HeldOut(how.held_out), most);
        let (states, step_s) = self.states(track, &windows, how.horizon_s);
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

    /// What the sensors show over the first `count` samples of a stretch of records that the model
    /// itself makes with each of some values of its parameters, from states that their noise does
    /// not tell from the record's, with steps of `step_s`: in chaos they part. None where one has no
    /// solution.
    pub fn made(
        &self,
        track: &Track<'_>,
        (stretch, count): (usize, usize),
        horizon_s: f64,
        step_s: f64,
        parameters: &[Vec<f64>],
    ) -> Option<Vec<Vec<Vec<f64>>>> {
        let (piece, guess) = track.piece(stretch, 0, count)?;
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let problem = track.problem(self.motion, step_s, &at);
        let length = samples(track, horizon_s).min(count);
        let head = problem.head(&piece, length);
        let levels = [(length / 4).max(8).min(length), length];
        let (state, _) = problem.fit_state(&head, &guess, self.parameters, &levels, &mut problem.room(false))?;
        let n = self.motion.degrees_of_freedom();
        let noise = track.sigma.iter().copied().fold(f64::INFINITY, f64::min);
        let of = |(record, parameters): (usize, &Vec<f64>)| {
            let mut rng = ChaCha8Rng::seed_from_u64(record as u64);
            let mut begin = state.clone();
            for (k, x) in begin.iter_mut().take(2 * n).enumerate() {
                // Of a rate, what noise leaves over the horizon.
                let size = if k < n { noise } else { noise / horizon_s };
                *x += size * rng.random_range(-1.0..1.0);
            }
            let left = problem.residuals(&piece, &begin, parameters)?;
            let sensors = track.sensors.len();
            let of = |k: usize| {
                let both = left.iter().zip(&piece.measured).skip(k).step_by(sensors);
                both.map(|(r, y)| r * track.sigma[k] + y).collect()
            };
            Some((0..sensors).map(of).collect())
        };
        parameters.par_iter().enumerate().map(of).collect()
    }
}

/// What is left in every window; in those where the model has no solution, which are left out while
/// they are few, their `motion`.
fn with_lost(
    windows: &Windows,
    states: &[State],
    left: impl Fn(&Piece, &(Vec<f64>, f64)) -> Option<f64> + Sync,
    motion: impl Fn(&Piece) -> f64,
) -> Vec<f64> {
    let of = |(piece, state): (&Piece, &State)| left(piece, state.as_ref()?);
    let found: Vec<Option<f64>> = windows.pieces.par_iter().zip(states).map(of).collect();
    let lost = found.iter().filter(|f| f.is_none()).count();
    let counts = lost as f64 > MOST_LOST * found.len() as f64;
    let all = found.into_iter().zip(&windows.pieces);
    all.filter_map(|(f, piece)| f.or_else(|| counts.then(|| motion(piece)))).collect()
}

/// Mean square of a piece's motion about its mean, in units of the noise.
pub fn motion_power(piece: &Piece, track: &Track<'_>) -> f64 {
    let m = track.sensors.len();
    let of = |k: usize| about_mean(piece, m, k) / track.sigma[k].powi(2);
    (0..m).map(of).sum::<f64>() / piece.measured.len().max(1) as f64
}

/// Sum of squares of what a sensor shows of a piece about its mean, SI.
fn about_mean(piece: &Piece, sensors: usize, k: usize) -> f64 {
    let of = || piece.measured.iter().skip(k).step_by(sensors);
    let mean = of().sum::<f64>() / of().count().max(1) as f64;
    of().map(|x| (x - mean).powi(2)).sum()
}
