//! A motion that is no chaos, followed in longer pieces: they grow from those of the search up to
//! whole stretches, parameters and initial states being fitted to each length.
//!
//! What a piece tells of a damping or of a frequency grows with the power 3/2 of its length, so that
//! a whole stretch tells far more than its parts, as long as the model holds; what it misses adds up
//! along a piece. Which length tells the most is measured. With J the derivatives of what is
//! predicted by the parameters, those by each piece's initial state projected out, r what is left and
//! g_b = Σ Jᵀr over the b-th of G parts of the record, the covariance of the parameters is
//!
//! H⁻¹ (Σ_b g_b g_bᵀ) H⁻¹ G/(G − 1), H = Σ JᵀJ,
//!
//! whatever is left within a part (White 1982, Econometrica 50, 1; Liang and Zeger 1986, Biometrika
//! 73, 13), stretched by Student's t for G − 1 degrees of freedom, and no less than what white noise
//! of that size allows. The length with the smallest geometric mean of standard errors is taken.

use nalgebra::{DMatrix, DVector};

use super::covariance::{Covariance, covariance};
use super::finer::minimise_finely;
use super::problem::{Piece, Problem};
use super::run::{Outcome, noise_ratio};
use super::solve::{Bounds, Start};
use crate::identify::jackknife::widening;
use crate::identify::track::Track;
use crate::model::dynamics::Dynamics;
use crate::model::flow::Work;

/// Parts of a record between which scores scatter (by hand).
const PARTS: usize = 24;
/// Most samples that are followed: some seconds of work.
const MOST_SAMPLES: usize = 60_000;
/// Growth of an initial error over a piece up to which it is followed: that of swings whose frequency
/// depends on their size stays below, chaos is beyond in ten to twenty periods (by hand).
pub const GROWN: f64 = 100.0;
/// Most rounds of a fit, and the promise, in squared standard errors, at which it stops.
pub const ROUNDS: usize = 16;
/// See [`ROUNDS`].
pub const TOLERANCE: f64 = 1e-2;
/// Samples that stand for a period where the step of integration is sought, which begins with a
/// twentieth of them.
pub const PERIOD_SAMPLES: f64 = 200.0;
/// Share of what a sensor shows to which solutions are exact.
pub const EXACT: f64 = 1e-6;
/// Growth of pieces from one length to the next (by hand): a frequency from one piece of a length L,
/// known to 1/L^{3/2}, keeps the phase over many.
pub const GROWTH: usize = 4;
/// Shortest beginning over which an initial state is sought, samples.
const FIRST_SAMPLES: usize = 16;
/// Growth over a beginning from which no better parameters make it less than [`GROWN`] (by hand).
const RUNS_AWAY: f64 = 10.0 * GROWN;

/// Where longer pieces begin.
pub struct From<'a> {
    /// Parameters.
    pub parameters: &'a [f64],
    /// Their bounds.
    pub bounds: &'a Bounds,
    /// Samples of a piece.
    pub length: usize,
    /// Samples left out at both ends of a stretch where more is known without them: a motion that was
    /// let go by hand is not yet free.
    pub margin: usize,
}

impl From<'_> {
    /// Samples of each stretch that are followed.
    fn samples(&self, track: &Track<'_>) -> Vec<usize> {
        let of = |k| track.samples(k).saturating_sub(2 * self.margin);
        (0..track.stretches()).map(of).collect()
    }
}

/// The fit in longer pieces, those that tell the most, and the length of these, samples; none where
/// none can be followed, or the record is too long.
pub fn longer<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    track: &Track<'_>,
    from: &From<'_>,
    tick: &mut dyn FnMut(),
) -> Option<(Outcome, usize)> {
    if (0..track.stretches()).map(|k| track.samples(k)).sum::<usize>() > MOST_SAMPLES {
        return None;
    }
    let longest = from.samples(track).into_iter().max()?;
    let grown =
        (1..usize::BITS).map_while(|k| from.length.checked_mul(GROWTH.checked_pow(k)?)).take_while(|l| *l < longest);
    let mut best: Option<(Outcome, usize)> = None;
    let mut parameters = from.parameters.to_vec();
    for length in grown.chain([longest]) {
        tick();
        let Some(found) = at_length(problem, track, &From { parameters: &parameters, length, ..*from }) else { break };
        parameters.clone_from(&found.fit.parameters);
        if best.as_ref().is_none_or(|(before, _)| error(&found) < error(before)) {
            best = Some((found, length));
        }
    }
    let (found, length) = best?;
    tick();
    let parameters = &found.fit.parameters;
    let whole = at_length(problem, track, &From { parameters, length, margin: 0, ..*from });
    Some((whole.filter(|w| error(w) < error(&found)).unwrap_or(found), length))
}

/// The mean logarithm of the standard errors of what is free.
fn error(outcome: &Outcome) -> f64 {
    let free: Vec<usize> = (0..outcome.fit.held.len()).filter(|i| !outcome.fit.held[*i]).collect();
    mean_error(&outcome.covariance.estimate, &free)
}

/// What is expected that long pieces leave more than short ones, in squares of the noise.
#[derive(Clone, Copy, Debug, Default)]
pub struct Expected {
    /// Mean.
    pub mean: f64,
    /// Variance.
    pub variance: f64,
}

/// Standard errors by which the model leaves more over long pieces than over short ones, of `states`
/// each, and than `expected`: with the noise alone a state that is not fitted leaves one square of
/// it, with a variance of two, and so does a value that the other did not have.
pub fn excess(short: &Outcome, long: &Outcome, states: usize, expected: Expected) -> f64 {
    let of = |o: &Outcome| {
        let square = o.noise_ratio.iter().map(|r| r * r).sum::<f64>() / o.noise_ratio.len().max(1) as f64;
        (square, o.values as f64, o.values as f64 - (states * o.pieces.len()) as f64)
    };
    let ((noise, fewer, short), (left, values, long)) = (of(short), of(long));
    let states_fewer = long - short * values / fewer;
    let variance = 2.0 * (states_fewer.abs() + (values - fewer).abs());
    let variance = variance.max(1.0) * (noise / long).powi(2) + expected.variance;
    (left - noise - expected.mean) / variance.sqrt()
}

/// The mean logarithm of the standard errors of some parameters: how much a fit tells.
pub fn mean_error(covariance: &DMatrix<f64>, of: &[usize]) -> f64 {
    let error = |i: &usize| 0.5 * covariance[(*i, *i)].max(f64::MIN_POSITIVE).ln();
    of.iter().map(error).sum::<f64>() / of.len().max(1) as f64
}

/// Pieces of about a length that share their stretches evenly, and guesses of their states.
fn pieces(track: &Track<'_>, from: &From<'_>) -> Option<(Vec<Piece>, Vec<Vec<f64>>)> {
    let mut out = (Vec::new(), Vec::new());
    for (stretch, samples) in from.samples(track).into_iter().enumerate() {
        if samples < super::FEWEST_SAMPLES {
            continue;
        }
        let count = (samples / from.length).max(1);
        for k in 0..count {
            let first = k * samples / count;
            let (piece, guess) = track.piece(stretch, from.margin + first, (k + 1) * samples / count - first)?;
            out.0.push(piece);
            out.1.push(guess);
        }
    }
    (!out.0.is_empty()).then_some(out)
}

/// A fit in pieces of one length; none where one cannot be followed, or small errors of a state grow
/// too far.
fn at_length<D: Dynamics + ?Sized>(problem: &Problem<'_, D>, track: &Track<'_>, from: &From<'_>) -> Option<Outcome> {
    let (pieces, guesses) = pieces(track, from)?;
    let parameters = from.parameters;
    let own = &parameters[..parameters.len() - problem.zeros.count];
    let step_s = track.step_s(problem.dynamics, &pieces, &guesses, own, PERIOD_SAMPLES * track.spacing_s, EXACT);
    let problem = Problem { step_s, ..*problem };
    let mut room = problem.room(false);
    let found = pieces.iter().zip(&guesses).map(|(piece, guess)| begun(&problem, piece, guess, parameters, &mut room));
    let states: Vec<Vec<f64>> = found.collect::<Option<_>>()?;
    let start = Start { parameters, states };
    let (fit, step_s) = minimise_finely(&problem, &pieces, start, from.bounds, TOLERANCE, ROUNDS, &mut || {})?;
    if !fit.converged {
        return None;
    }
    let problem = Problem { step_s, ..problem };
    let least = covariance(&fit.shares, problem.states(), &fit.held, 0.0)?;
    let (estimate, parts) = by_parts(&problem, &pieces, &fit.states, &fit.parameters, &fit.held)?;
    let widen = DVector::from_fn(fit.held.len(), |i, _| {
        let (found, least) = (estimate[(i, i)], least.bound[(i, i)]);
        if found > 0.0 && least > found { (least / found).sqrt() } else { 1.0 }
    });
    let estimate = estimate.map_with_location(|i, j, v| v * widen[i] * widen[j]);
    Some(Outcome {
        noise_ratio: noise_ratio(&fit.shares, problem.states()),
        covariance: Covariance { estimate, blocks: parts, ..least },
        lost: 0,
        repetition: 0.0,
        step_s,
        values: pieces.iter().map(|p| p.measured.len()).sum(),
        rounds: fit.rounds,
        fit,
        pieces,
    })
}

/// The initial state of a piece, sought over longer and longer beginnings. None where one has no
/// solution, or errors of the state grow far over it: over the whole piece they grow farther, and the
/// search for a state of which every digit counts takes all its rounds.
fn begun<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    piece: &Piece,
    guess: &[f64],
    parameters: &[f64],
    room: &mut Work,
) -> Option<Vec<f64>> {
    let count = piece.measured.len() / problem.sensors.len().max(1);
    let mut state = guess.to_vec();
    for length in (0..usize::BITS).map(|k| FIRST_SAMPLES << k).take_while(|l| *l < count).chain([count]) {
        state = problem.fit_state(piece, &state, parameters, &[length], room)?.0;
        let (_, by_state) = problem.linear(&problem.head(piece, length), &state, parameters)?;
        if growth(problem, &by_state) > RUNS_AWAY {
            return None;
        }
    }
    Some(state)
}

/// The covariance by the scatter of scores between parts of the record, and how many there are.
fn by_parts<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    pieces: &[Piece],
    states: &[Vec<f64>],
    parameters: &[f64],
    held: &[bool],
) -> Option<(DMatrix<f64>, usize)> {
    let (x, p) = (problem.states(), parameters.len());
    let free: Vec<usize> = (0..p).filter(|i| !held[*i]).collect();
    let all: usize = pieces.iter().map(|p| p.measured.len()).sum();
    let (mut normal, mut scores) = (DMatrix::zeros(free.len(), free.len()), Vec::new());
    for (piece, state) in pieces.iter().zip(states) {
        let (left, by) = problem.linear_by_all(piece, state, parameters)?;
        let by_state = by.columns(0, x).into_owned();
        if growth(problem, &by_state) > GROWN {
            return None;
        }
        let of_free = DMatrix::from_fn(by.nrows(), free.len(), |i, j| by[(i, x + free[j])]);
        let q = by_state.qr().q();
        let own = &of_free - &q * (q.transpose() * &of_free);
        normal += own.transpose() * &own;
        let rows = by.nrows();
        let parts = ((PARTS * rows) as f64 / all.max(1) as f64).round().max(1.0) as usize;
        scores.extend((0..parts).map(|k| {
            let (first, end) = (k * rows / parts, (k + 1) * rows / parts);
            own.rows(first, end - first).transpose() * left.rows(first, end - first)
        }));
    }
    let inverse = normal.cholesky()?.inverse();
    let g = scores.len();
    let sum = scores.iter().fold(DMatrix::zeros(free.len(), free.len()), |s, g| s + g * g.transpose());
    let stretch = widening(g).powi(2) * g as f64 / (g as f64 - 1.0).max(1.0);
    let found = &inverse * sum * &inverse * stretch;
    let mut out = DMatrix::zeros(p, p);
    for (i, a) in free.iter().enumerate() {
        free.iter().enumerate().for_each(|(j, b)| out[(*a, *b)] = found[(i, j)]);
    }
    Some((out, g))
}

/// By how many times that an initial state which is off by the sensors' noise is off where it is most
/// along a piece, given derivatives of what sensors show by it, in their noise.
fn growth<D: Dynamics + ?Sized>(problem: &Problem<'_, D>, by_state: &DMatrix<f64>) -> f64 {
    let n = problem.dynamics.degrees_of_freedom();
    // Every coordinate by the noise of the sensor that shows it.
    let mut beside = DVector::zeros(by_state.ncols());
    for (weights, sigma) in problem.sensors.iter().zip(problem.sigma) {
        weights.iter().take(n).zip(beside.iter_mut()).filter(|w| *w.0 != 0.0).for_each(|(_, x)| *x += sigma);
    }
    (by_state * beside).amax()
}
