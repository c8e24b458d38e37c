//! Multiple shooting from start to covariance, for any system with [`Dynamics`].
//!
//! 1. The step of integration: the longest whose solution over a whole piece differs from that of
//!    half the step by less than `STEP_ERROR` of the sensors' noise (`WORST_STEP_ERROR` in the
//!    worst piece); over beginnings first where the motion is unstable ([`first_step`](super::first_step)).
//! 2. Pieces of 1T, then 2T (at most `FEW` of them, spread over the record): states and parameters.
//!    A short piece bears a poor start; a long one knows the parameters better, since small changes
//!    grow along it.
//! 3. All pieces of full length (4T): each state alone, over 1T, 2T, 4T, then states and parameters
//!    together; with finer steps of integration where these would move the parameters ([`finer`](super::finer)).
//!    Where too few pieces of a level can be followed, those of the level before are the longest
//!    that can: chaos has grown over the sensors' noise and the parameters' errors.
//! 4. Sensors whose residuals differ from their noise are weighted by what they leave, and a piece
//!    that the model cannot follow where it follows all others (a mean square of `LOST` times the
//!    median, or a state that finds no rest and keeps the parameters from theirs) is left out and
//!    counted; then once more.

use rayon::prelude::*;

use super::covariance::{self, Covariance};
use super::finer::minimise_finely;
use super::first_step::FirstStep;
use super::problem::{Piece, Problem, Share};
use super::solve::{Bounds, ShootingFit, Start, minimise};
use crate::error::BadInput;
use crate::identify::regression::REPEATING;
use crate::model::dynamics::Dynamics;
use crate::statistics::median;
use crate::wording::format::significant;

/// Most pieces of the first two levels.
const FEW: usize = 96;
/// Difference, in the sensors' standard deviations, that the step of integration may make.
const STEP_ERROR: f64 = 0.03;
/// Steps are not sought below this share of a sample: a motion that its samples hold needs none,
/// and noise may be as good as nothing.
pub(super) const FINEST: f64 = 0.125;
/// Steps of a period at first.
pub(super) const FIRST_STEPS: f64 = 20.0;
/// [`STEP_ERROR`] in the worst piece.
const WORST_STEP_ERROR: f64 = 0.15;
/// Mean square of a piece, in medians, from which it counts as lost.
const LOST: f64 = 25.0;
/// Share of the pieces that may be lost at the end, and with the parameters of pieces half as long
/// (by hand).
pub const MOST_LOST: f64 = 0.1;
const MOST_LOST_AT_FIRST: f64 = 0.3;
/// Samples over which a state that leads nowhere is sought first.
const FIRST_SAMPLES: usize = 6;
/// Growth of what a lacking constant force leaves as pieces double: (2²)².
const DOUBLED: f64 = 16.0;
/// Promise of a step, in squared standard errors, at which the last level stops.
const TOLERANCE: f64 = 1e-2;
/// Most rounds of a level.
const MOST_ROUNDS: usize = 30;

/// What a run gives.
pub struct Outcome {
    /// The minimum.
    pub fit: ShootingFit,
    /// The pieces that were followed, one for each of its states.
    pub pieces: Vec<Piece>,
    /// Standard errors.
    pub covariance: Covariance,
    /// Rms residual of each sensor in units of the noise that was given.
    pub noise_ratio: Vec<f64>,
    /// Pieces that could not be followed.
    pub lost: usize,
    /// Correlation of residuals between pieces.
    pub repetition: f64,
    /// Step of integration, s.
    pub step_s: f64,
    /// Measured values used.
    pub values: usize,
    /// Rounds of the last level.
    pub rounds: usize,
}

impl Outcome {
    /// What most pieces leave, in units of the noise: a few may hold slips of counts.
    pub fn usual_left(&self) -> f64 {
        usual(&self.fit).sqrt()
    }
}

/// The median of what pieces leave, in squares of the noise.
fn usual(fit: &ShootingFit) -> f64 {
    median(&mut fit.shares.iter().map(mean_square).collect::<Vec<f64>>())
}

/// Why a run gives nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// No piece could be followed from the start parameters.
    NothingFollows,
    /// The normal equations are singular.
    NotDetermined,
    /// Short pieces already leave more than was to be left.
    LeavesTooMuch,
    /// Too few pieces could be followed where those of half their length, of so many samples, were.
    TooLong(usize),
}

impl Failure {
    /// Where pieces of a level cannot be followed.
    fn of_level(level: usize, levels: &[usize]) -> Self {
        level.checked_sub(1).map_or(Self::NothingFollows, |before| Self::TooLong(levels[before]))
    }

    /// In words, of samples that are `spacing_s` apart.
    pub fn told(self, spacing_s: f64) -> BadInput {
        match self {
            Self::NothingFollows => BadInput::new(
                "no piece of the record that a solution of the model follows",
                "motion that the model describes over a piece",
            )
            .remedy("Look at the weak form's result and at `whirl explain`, or try shorter pieces with --segment-s"),
            Self::TooLong(samples) => BadInput::new(
                "pieces of which a solution of the model follows too few",
                format!("pieces of {} s or so, which it follows", significant(samples as f64 * spacing_s, 3)),
            )
            .at("--segment-s")
            .remedy("Ask for shorter ones, or leave the option away"),
            Self::LeavesTooMuch => BadInput::new(
                "more than the sensors' noise in short pieces already",
                "equations that describe the record",
            )
            .remedy("See `whirl explain`"),
            Self::NotDetermined => {
                BadInput::new("a parameter that the record does not determine", "motion in which every term takes part")
                    .remedy("See `whirl inspect`: is an arm at rest, is the motion locked to the drive?")
            }
        }
    }
}

/// Lengths of the pieces.
#[derive(Clone, Copy)]
pub struct Levels<'a> {
    /// Samples of a piece at each level, shortest first, the last one the pieces' full length.
    pub samples: &'a [usize],
    /// Ratio of residuals to noise beyond which a level ends the run: longer pieces leave more.
    pub most_left: Option<f64>,
}

/// Runs all levels.
///
/// # Errors
/// Where no solution follows the record, or it does not determine the parameters.
pub fn run<D: Dynamics + ?Sized>(
    mut problem: Problem<'_, D>,
    pieces: Vec<Piece>,
    guesses: Vec<Vec<f64>>,
    start: &[f64],
    bounds: &Bounds,
    levels: Levels<'_>,
    tick: &mut dyn FnMut(),
) -> Result<Outcome, Failure> {
    let Levels { samples: levels, most_left } = levels;
    let first = FirstStep::new(&problem, &pieces, &guesses, start, levels[0]);
    problem.step_s = first.step_s;
    let mut parameters = start.to_vec();
    let stride = pieces.len().div_ceil(FEW).max(1);
    let mut before = None;
    for (i, length) in levels.iter().enumerate().take(levels.len().saturating_sub(1)) {
        let few: Vec<Piece> = pieces.iter().step_by(stride).map(|p| problem.head(p, *length)).collect();
        let guesses: Vec<&Vec<f64>> = guesses.iter().step_by(stride).collect();
        let (few, states) = followed(&problem, few, &guesses, &parameters, &levels[..=i], (before, MOST_LOST_AT_FIRST))
            .ok_or(Failure::of_level(i, levels))?;
        tick();
        // A level that gets nowhere leaves the parameters to the next.
        let start = Start { parameters: &parameters, states };
        if let Some(fit) = minimise(&problem, &few, start, bounds, 1.0, 10, tick)
            && fit.parameters.iter().all(|p| p.is_finite())
        {
            // Of most pieces: a few may hold a slip of counts.
            let usual = usual(&fit);
            if most_left.is_some_and(|most| usual > most * most) {
                return Err(Failure::LeavesTooMuch);
            }
            before = Some(usual);
            parameters = fit.parameters;
        }
    }
    let (all, whole) = (pieces.len(), pieces);
    let too_long = Failure::of_level(levels.len().saturating_sub(1), levels);
    let refitted = |problem: &Problem<'_, D>, parameters: &[f64], most_lost: f64| {
        let guesses: Vec<&Vec<f64>> = guesses.iter().collect();
        followed(problem, whole.clone(), &guesses, parameters, levels, (before, most_lost)).ok_or(too_long)
    };
    let (mut pieces, mut states) = refitted(&problem, &parameters, MOST_LOST_AT_FIRST)?;
    problem.step_s = first.with_states(&problem, &pieces, &states, &parameters);
    tick();
    let mut rounds = 0;
    let given = problem.sigma.to_vec();
    let mut sigma = given.clone();
    for last in [false, true] {
        let weighted = Problem { sigma: &sigma, ..copy(&problem) };
        let start = Start { parameters: &parameters, states: states.clone() };
        let (fit, step_s) = minimise_finely(&weighted, &pieces, start, bounds, TOLERANCE, MOST_ROUNDS, tick)
            .ok_or(Failure::NothingFollows)?;
        problem.step_s = step_s;
        let weighted = Problem { step_s, ..weighted };
        rounds += fit.rounds;
        let ratio = noise_ratio(&fit.shares, problem.states());
        let even = ratio.iter().all(|r| (r / ratio[0] - 1.0).abs() < 0.1);
        let (kept, kept_states) = without_lost(&pieces, &fit);
        if last || (even && kept.len() == all) {
            let residuals = residuals(&weighted, &pieces, &fit);
            let repetition = repetition(&residuals);
            let repeats = if repetition > REPEATING { repetition } else { 0.0 };
            let covariance = covariance::covariance(&fit.shares, problem.states(), &fit.held, repeats)
                .ok_or(Failure::NotDetermined)?;
            return Ok(Outcome {
                noise_ratio: ratio.iter().zip(&sigma).zip(&given).map(|((r, s), g)| r * s / g).collect(),
                covariance,
                lost: all - pieces.len(),
                repetition,
                step_s: problem.step_s,
                values: pieces.iter().map(|p| p.measured.len()).sum(),
                rounds,
                fit,
                pieces,
            });
        }
        // What was lost with the parameters of shorter pieces may be followed with those of longer ones.
        let lost_before = pieces.len() < all;
        (pieces, states) =
            if lost_before { refitted(&weighted, &fit.parameters, MOST_LOST)? } else { (kept, kept_states) };
        sigma.iter_mut().zip(&ratio).for_each(|(s, r)| *s *= if *r > 0.0 { *r } else { 1.0 });
        parameters.clone_from(&fit.parameters);
        if pieces.is_empty() {
            return Err(Failure::NothingFollows);
        }
    }
    Err(Failure::NothingFollows)
}

fn copy<'a, D: Dynamics + ?Sized>(p: &Problem<'a, D>) -> Problem<'a, D> {
    Problem { ..*p }
}

/// A piece's fitted state, and the mean square that is left; none where it has no solution.
type Found = Option<(Vec<f64>, f64)>;

/// Each piece's state fitted over some lengths with the parameters held.
fn fit_states<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    pieces: &[&Piece],
    guesses: &[&Vec<f64>],
    parameters: &[f64],
    lengths: &[usize],
) -> Vec<Found> {
    let of = |work: &mut _, (piece, guess): (&&Piece, &&Vec<f64>)| {
        problem.fit_state(piece, guess, parameters, lengths, work)
    };
    pieces.par_iter().zip(guesses).map_init(|| problem.room(false), of).collect()
}

/// What a piece that is followed may leave: [`LOST`] times the median, which is no more than what a
/// lacking constant force makes of the median of pieces half as long, `before`.
fn most_left(found: &[Found], before: Option<f64>) -> f64 {
    let mut left: Vec<f64> = found.iter().flatten().map(|f| f.1).collect();
    LOST * median(&mut left).min(before.map_or(f64::INFINITY, |m| DOUBLED * m))
}

/// The pieces that a solution follows, with their states, each fitted over the levels' lengths; from
/// a few samples on where that leads nowhere. None where more than a share of them is lost, if
/// shorter ones left `before`.
fn followed<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    pieces: Vec<Piece>,
    guesses: &[&Vec<f64>],
    parameters: &[f64],
    levels: &[usize],
    (before, most_lost): (Option<f64>, f64),
) -> Option<(Vec<Piece>, Vec<Vec<f64>>)> {
    let all: Vec<&Piece> = pieces.iter().collect();
    let mut found = fit_states(problem, &all, guesses, parameters, levels);
    let most = most_left(&found, before);
    let is_lost = |f: &Found| f.as_ref().is_none_or(|f| f.1 > most);
    let lost: Vec<usize> = (0..all.len()).filter(|&i| is_lost(&found[i])).collect();
    let doubled = (0..usize::BITS).map(|k| FIRST_SAMPLES << k).take_while(|l| *l < levels[0]);
    let lengths: Vec<usize> = doubled.chain(levels.iter().copied()).collect();
    let (again, from): (Vec<&Piece>, Vec<&Vec<f64>>) = lost.iter().map(|&i| (all[i], guesses[i])).unzip();
    for (i, state) in lost.into_iter().zip(fit_states(problem, &again, &from, parameters, &lengths)) {
        if !is_lost(&state) {
            found[i] = state;
        }
    }
    let count = all.len();
    let kept = pieces.into_iter().zip(found).filter_map(|(p, f)| Some((p, f.filter(|f| f.1 <= most)?.0)));
    let (pieces, states): (Vec<_>, Vec<_>) = kept.unzip();
    let most_lost = before.map_or(1.0, |_| most_lost);
    (!pieces.is_empty() && pieces.len() as f64 >= (1.0 - most_lost) * count as f64).then_some((pieces, states))
}

/// Mean square of a piece's residuals over all sensors, in squares of their noise.
fn mean_square(share: &Share) -> f64 {
    share.cost() / (share.samples * share.squares.len()).max(1) as f64
}

fn without_lost(pieces: &[Piece], fit: &ShootingFit) -> (Vec<Piece>, Vec<Vec<f64>>) {
    let mean: Vec<f64> = fit.shares.iter().map(mean_square).collect();
    let usual = median(&mut mean.clone());
    let kept = |i: &usize| mean[*i] <= LOST * usual && !fit.astray.contains(i);
    (0..pieces.len()).filter(kept).map(|i| (pieces[i].clone(), fit.states[i].clone())).unzip()
}

/// Rms residual of each sensor in units of its σ, the freedom of the states shared out evenly.
pub(super) fn noise_ratio(shares: &[Share], states: usize) -> Vec<f64> {
    let sensors = shares.first().map_or(0, |s| s.squares.len());
    let samples: usize = shares.iter().map(|s| s.samples).sum();
    let freedom = samples as f64 - (shares.len() * states) as f64 / sensors.max(1) as f64;
    (0..sensors).map(|k| (shares.iter().map(|s| s.squares[k]).sum::<f64>() / freedom.max(1.0)).sqrt()).collect()
}

fn residuals<D: Dynamics + ?Sized>(problem: &Problem<'_, D>, pieces: &[Piece], fit: &ShootingFit) -> Vec<Vec<f64>> {
    pieces
        .par_iter()
        .zip(&fit.states)
        .map(|(piece, state)| problem.residuals(piece, state, &fit.parameters).unwrap_or_default())
        .collect()
}

/// Greatest mean correlation of residuals between pieces 1 … 32 apart.
fn repetition(residuals: &[Vec<f64>]) -> f64 {
    let mut greatest = 0.0_f64;
    for lag in 1..=32.min(residuals.len().saturating_sub(1)) {
        let (mut product, mut power, mut pairs) = (0.0, 0.0, 0_usize);
        for (a, b) in residuals.iter().zip(&residuals[lag..]).filter(|(a, b)| a.len() == b.len()) {
            pairs += 1;
            for (x, y) in a.iter().zip(b) {
                product += x * y;
                power += 0.5 * (x * x + y * y);
            }
        }
        // A handful of pairs correlates by chance.
        if pairs >= 4 && power > 0.0 {
            greatest = greatest.max(product / power);
        }
    }
    greatest
}

/// The longest step T/20, T/28, T/40 … whose solution agrees with that of half the step: over all
/// pieces together, and in the worst of them, since one violent piece that is integrated badly
/// pulls the parameters by many standard errors.
pub fn integration_step<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    pieces: &[Piece],
    guesses: &[Vec<f64>],
    parameters: &[f64],
    period_s: f64,
) -> f64 {
    let run = |step_s: f64| -> Vec<Option<Vec<f64>>> {
        let p = Problem { step_s, ..copy(problem) };
        pieces.par_iter().zip(guesses).map(|(piece, state)| p.residuals(piece, state, parameters)).collect()
    };
    let mut step = period_s / FIRST_STEPS;
    let mut coarse = run(step);
    for _ in 0..12 {
        let fine = run(step / 2.0);
        let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0_f64);
        for (a, b) in coarse.iter().zip(&fine) {
            if let (Some(a), Some(b)) = (a, b)
                && !a.is_empty()
            {
                let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                sum += squares;
                count += a.len() as f64;
                worst = worst.max((squares / a.len() as f64).sqrt());
            }
        }
        // In units of what is allowed.
        let excess = f64::max((sum / f64::max(count, 1.0)).sqrt() / STEP_ERROR, worst / WORST_STEP_ERROR);
        if (count > 0.0 && excess < 1.0) || step < FINEST * problem.spacing_s {
            return step;
        }
        // A method of order 5: half the step has 1/32 of the error. Try the step between first.
        let between = step / 2f64.sqrt();
        step = if count > 0.0 && excess < 6.0 { between } else { step / 2.0 };
        coarse = if step == between { run(step) } else { fine };
    }
    step
}

#[cfg(test)]
mod tests;
