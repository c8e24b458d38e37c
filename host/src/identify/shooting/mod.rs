//! Multiple-shooting maximum likelihood: the equations are integrated over pieces of the record,
//! and parameters and initial states are those whose angles come closest to the measured counts.
//!
//! A count says that the angle lies in [c, c + 1): as noise, white with variance q²/12 (Widrow and
//! Kollár 2008, Quantization Noise). With white noise of given size the likelihood's maximum is the
//! least-squares solution of [`problem`], found by [`solve`] with the states eliminated; pieces
//! grow from 1T over 2T to 4T ([`run`]). Noise enters the measured angles only, never the
//! regressors, so that there is no bias to take off. Standard errors come from the pieces' own
//! scatter ([`covariance`]). The start is the weak form.
//!
//! Limits: a piece's solution must stay close to the motion, so pieces cannot be much longer than a
//! few Lyapunov times; a model that misses an effect is fitted as closely as it can be, and the
//! residuals then exceed the noise, which is said.

pub mod covariance;
pub mod finer;
pub mod first_step;
pub mod longer;
mod noisy_inputs;
pub mod problem;
mod result;
pub mod run;
pub mod solve;
mod states;
pub mod track;
mod with_offsets;
pub mod zeros;

use indicatif::ProgressBar;
use serde::Serialize;

use super::built_in::WrittenRig;
use super::geometry::DRIVE_PERIODS;
use super::prepared::{Prepared, prepare_moving};
use super::slips::{self, Placed, Slip};
use super::track::{ExogenousInputs, Pieces, Track};
use super::{Identification, Settings as WeakSettings, built_in};
use crate::error::{BadInput, Result};
use crate::model::dynamics::Dynamics;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::warning::Warning;
use longer::longer;
use problem::{Piece, Problem};
use run::{Failure, Outcome};
use with_offsets::WithOffsets;
use zeros::{Moment, Unknown, ZeroOffset};

/// Ratio of residuals to the sensors' noise from which the model is said to miss something.
pub const MISSES: f64 = 1.2;
/// Standard errors from which long pieces leave more than short ones (by hand).
const CLEARLY: f64 = 4.0;
/// Fewest samples of a piece.
pub(crate) const FEWEST_SAMPLES: usize = 16;
/// Bounds of what has none.
const OPEN: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];
/// Progress: rounds expected.
const EXPECTED_ROUNDS: u64 = 16;

/// Choices of multiple shooting.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Settings {
    /// Length of the pieces at the last level, s; by default four drive periods, a fifth of a
    /// window for a free system.
    pub segment_s: Option<f64>,
    /// Bounds of parameters: name, lowest, highest. None by default.
    pub bounds: Vec<(String, f64, f64)>,
    /// Ratio of residuals to the sensors' noise beyond which short pieces already end it.
    #[serde(skip)]
    pub most_left: Option<f64>,
}

/// How the numbers came about.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Details {
    /// Length of a piece at each level, s.
    pub levels_s: Vec<f64>,
    /// Pieces at the last level.
    pub pieces: usize,
    /// Pieces left out because no solution of the model followed them.
    pub lost: usize,
    /// Step of integration, s.
    pub step_s: f64,
    /// Rounds of the last level, and whether they came to rest.
    pub rounds: usize,
    /// Whether they came to rest.
    pub converged: bool,
    /// Rms residual of each sensor over its noise: 1 where the model explains everything else.
    pub noise_ratio: Vec<f64>,
    /// Standard errors that white Gaussian noise of the residuals' size allows at best for these
    /// pieces (Cramér and Rao), in the order of `correlation_names`.
    pub cramer_rao: Vec<f64>,
    /// Parameters that stand at a bound.
    pub at_bound: Vec<String>,
}

/// Identifies a system by multiple shooting from the weak form's result.
///
/// # Errors
/// As the weak form; equations that cannot be integrated; coefficients for each record; bounds on a
/// coefficient that there is not; a record that no solution of the model follows.
pub fn identify(
    records: &[Record],
    rig: &Rig,
    weak: &WeakSettings,
    settings: &Settings,
    progress: &ProgressBar,
) -> Result<Identification> {
    let own = built_in::written(rig)?;
    let bound = built_in::bound(&own)?;
    let model = &*bound.model;
    let each = records.len() > 1 && model.equations.iter().flat_map(|e| &e.terms).any(|t| t.each_record);
    if each {
        return Err(model
            .bad("each = \"record\"", "coefficients that all records share, for multiple shooting")
            .remedy("Give the records one by one, or use --method weak"));
    }
    let first = super::identify(records, rig, weak)?;
    let prepared = prepare_moving(records, &own, bound, weak)?;
    let (motion, names) = built_in::equations_of_motion(rig, &own, bound)?;
    let given = Given { motion: &*motion, names: &names, rig: &own, bound, prepared: &prepared, first: &first };
    let attempt = shoot(&given, false, settings, progress).map_err(|e| match records.first() {
        Some(r) if e.place.is_none() => e.in_file(&r.path),
        _ => e,
    })?;
    result::finish(first, WrittenRig { rig, own: &own, bound }, &names, &prepared, attempt)
}

/// Slips that shooting shows where every piece has its sensors' zeros to itself: where slips before
/// it would otherwise spoil the parameters. `first`: the weak form's result.
///
/// # Errors
/// As [`identify`].
pub fn slips(
    records: &[Record],
    rig: &Rig,
    weak: &WeakSettings,
    first: &Identification,
    progress: &ProgressBar,
) -> Result<Vec<Placed>> {
    let own = built_in::written(rig)?;
    let bound = built_in::bound(&own)?;
    let prepared = prepare_moving(records, &own, bound, weak)?;
    let (motion, names) = built_in::equations_of_motion(rig, &own, bound)?;
    let given = Given { motion: &*motion, names: &names, rig: &own, bound, prepared: &prepared, first };
    // Where more than slips is left, what looks like one may be that; short pieces show it soon.
    let settings = Settings { most_left: Some(MISSES), ..Settings::default() };
    let attempt = shoot(&given, true, &settings, progress)?;
    if !attempt.outcome.fit.converged || attempt.outcome.usual_left() > MISSES {
        return Ok(Vec::new());
    }
    Ok(slips::placed(&attempt.slips, bound, &prepared))
}

/// Parameters by simulations of pieces as long as tell the most ([`longer`](mod@longer)), from the
/// weak form's result, whatever the equations miss. None under a drive or measured inputs, whose
/// forces the weak form weighs, where records have coefficients of their own, and where no piece is
/// followed.
///
/// # Errors
/// As [`identify`].
pub fn simulated(
    records: &[Record],
    rig: &Rig,
    weak: &WeakSettings,
    first: &Identification,
    progress: &ProgressBar,
) -> Result<Option<Identification>> {
    let own = built_in::written(rig)?;
    let bound = built_in::bound(&own)?;
    let has_inputs = !bound.inputs.is_empty();
    if own.drive.is_some() || has_inputs || bound.model.equations.iter().flat_map(|e| &e.terms).any(|t| t.each_record) {
        return Ok(None);
    }
    let prepared = prepare_moving(records, &own, bound, weak)?;
    let (motion, names) = built_in::equations_of_motion(rig, &own, bound)?;
    let given = Given { motion: &*motion, names: &names, rig: &own, bound, prepared: &prepared, first };
    let Prepared { stretches, sensors, .. } = &prepared;
    let exogenous: Vec<ExogenousInputs> = stretches.iter().map(|s| ExogenousInputs::new(s, 0.0)).collect();
    let track = Track::new(stretches, &exogenous, &own, bound, sensors);
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let period_s = period_s(&given);
    let problem = track.problem(&*motion, period_s, &at);
    let parameters = start_of(&given)?;
    let from = longer::From {
        parameters: &parameters,
        bounds: &vec![OPEN; names.len()],
        // Not negative; rounded.
        length: ((4.0 * period_s / track.spacing_s).round() as usize).max(FEWEST_SAMPLES),
        margin: prepared.geometry.kernels.full.reach(),
    };
    progress.set_length(EXPECTED_ROUNDS);
    let found = longer(&problem, &track, &from, &mut || progress.inc(1));
    progress.finish_and_clear();
    let Some((outcome, length)) = found else { return Ok(None) };
    let run = ShootingRun {
        levels_s: vec![length as f64 * track.spacing_s],
        slips: Vec::new(),
        zeros: Vec::new(),
        adds_up: None,
        shifts: vec![vec![0.0; sensors.sigma.len()]; stretches.len()],
        outcome,
    };
    result::finish(first.clone(), WrittenRig { rig, own: &own, bound }, &names, &prepared, run).map(Some)
}

/// The pieces that were followed with their states, and those that were not with the states that come
/// nearest, in their order.
fn with_lost<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    outcome: &Outcome,
    (pieces, guesses): (&[Piece], &[Vec<f64>]),
    levels: &[usize],
) -> (Vec<Piece>, Vec<Vec<f64>>) {
    let is_same = |a: &Piece, b: &Piece| a.stretch == b.stretch && a.start_s.total_cmp(&b.start_s).is_eq();
    let of = |(piece, guess): (&Piece, &Vec<f64>)| {
        if let Some(k) = outcome.pieces.iter().position(|p| is_same(p, piece)) {
            return Some((piece.clone(), outcome.fit.states[k].clone()));
        }
        let mut lengths = levels.to_vec();
        lengths.sort_unstable();
        let found = problem.fit_state(piece, guess, &outcome.fit.parameters, &lengths, &mut problem.room(false));
        Some((piece.clone(), found?.0))
    };
    pieces.iter().zip(guesses).filter_map(of).unzip()
}

/// What a run starts from.
struct Given<'a> {
    motion: &'a dyn Dynamics,
    /// Names of its parameters.
    names: &'a [String],
    rig: &'a Rig,
    bound: &'a ObservedModel,
    prepared: &'a Prepared,
    /// The weak form's result.
    first: &'a Identification,
}

/// A run with the length of its pieces at each level, s, the slips that it shows and the sensors'
/// zeros, which are the last of its parameters where they were identified.
struct ShootingRun {
    outcome: Outcome,
    levels_s: Vec<f64>,
    slips: Vec<Slip>,
    zeros: Vec<ZeroOffset>,
    /// Zeros by stretch and sensor.
    shifts: Vec<Vec<f64>>,
    /// What long pieces show that short ones do not.
    adds_up: Option<Warning>,
}

/// Period of the drive, or what stands for it in a free system, s: as much of a window.
fn period_s(given: &Given<'_>) -> f64 {
    let free = given.prepared.geometry.windows.length_s / DRIVE_PERIODS;
    given.rig.drive.map_or(free, |d| 1.0 / d.frequency_hz)
}

/// The weak form's parameters.
fn start_of(given: &Given<'_>) -> Result<Vec<f64>> {
    let of = |n: &String| {
        let found = given.first.parameter(n).map(|p| p.value);
        found.ok_or_else(|| BadInput::new(format!("no {n}"), "a start by the weak form"))
    };
    given.names.iter().map(of).collect()
}

/// Pieces, start, bounds, levels, in pieces as long as can be followed where no length is asked for;
/// then the run, `offsets` saying whether every piece has its sensors' zeros to itself; otherwise
/// those of a record are parameters ([`zeros`]).
fn shoot(given: &Given<'_>, offsets: bool, settings: &Settings, progress: &ProgressBar) -> Result<ShootingRun> {
    let Given { rig, bound, prepared, .. } = *given;
    let Prepared { stretches, sensors, .. } = prepared;
    let omega = rig.drive.map_or(0.0, |_| rig.omega());
    let exogenous: Vec<ExogenousInputs> = stretches.iter().map(|s| ExogenousInputs::new(s, omega)).collect();
    let track = Track::new(stretches, &exogenous, rig, bound, sensors);
    let period_s = period_s(given);
    let shortest = FEWEST_SAMPLES as f64 * track.spacing_s;
    let piece_s = settings.segment_s.unwrap_or((4.0 * period_s).max(shortest));
    let longest = (0..stretches.len()).map(|k| track.samples(k)).max().unwrap_or(0) as f64 * track.spacing_s;
    if !(piece_s >= shortest && piece_s <= longest) {
        return Err(BadInput::new(format!("{piece_s} s"), format!("{shortest} to {longest} s"))
            .at("--segment-s")
            .remedy("A piece needs at least 16 samples, and cannot be longer than the longest unbroken stretch"));
    }
    let mut length = (piece_s / track.spacing_s).round() as usize;
    loop {
        match shoot_pieces(given, &track, length, offsets, settings, progress)? {
            Err(Failure::TooLong(followed)) if settings.segment_s.is_none() => length = followed,
            found => return found.map_err(|why| why.told(track.spacing_s)),
        }
    }
}

/// The same with pieces of so many samples.
fn shoot_pieces(
    given: &Given<'_>,
    track: &Track<'_>,
    length: usize,
    offsets: bool,
    settings: &Settings,
    progress: &ProgressBar,
) -> Result<core::result::Result<ShootingRun, Failure>> {
    let Given { motion, names, rig, bound, prepared, .. } = *given;
    let period_s = period_s(given);
    let mut levels: Vec<usize> = [4, 2, 1].iter().map(|d| length / d).filter(|l| *l >= FEWEST_SAMPLES).collect();
    levels.dedup();
    let guess = ((0.05 * period_s / track.spacing_s).round() as usize).clamp(4, 16).min(levels[0]);
    let Pieces { pieces, mut guesses } = track
        .cut(length, guess)
        .ok_or_else(|| BadInput::new("sensors that do not give all coordinates", "one sensor for each coordinate"))?;
    let start = start_of(given)?;
    let mut bounds = vec![OPEN; names.len()];
    for (name, low, high) in &settings.bounds {
        let i = names.iter().position(|n| n == name).ok_or_else(|| {
            BadInput::new(format!("\"{name}\""), format!("one of {}", names.join(", "))).at("--bound")
        })?;
        bounds[i] = [*low, *high];
    }
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let wide = offsets.then(|| WithOffsets::new(motion, track.sensors.len()));
    let (motion, shown) = match &wide {
        Some(wide) => (wide as &dyn Dynamics, wide.sensors(&track.sensors)),
        None => (motion, track.sensors.clone()),
    };
    if let Some(wide) = &wide {
        guesses.iter_mut().for_each(|g| *g = wide.state(g));
    }
    let moments: Vec<Moment> = pieces.iter().zip(&guesses).map(|(p, g)| track.moment(p, g)).collect();
    let unknown = if offsets { Unknown::default() } else { zeros::unknown(motion, &start, &moments, bound, prepared) };
    progress.reset();
    progress.set_length(EXPECTED_ROUNDS);
    let mut tick = || {
        if progress.position() + 1 < EXPECTED_ROUNDS {
            progress.inc(1);
        }
    };
    let lengths = run::Levels { samples: &levels, most_left: settings.most_left };
    let mut once = |unknown: &Unknown| {
        let problem = Problem { sensors: &shown, zeros: unknown.zeros(), ..track.problem(motion, period_s, &at) };
        let start: Vec<f64> = start.iter().copied().chain(unknown.none()).collect();
        let bounds: Vec<[f64; 2]> = bounds.iter().copied().chain(unknown.none().map(|_| OPEN)).collect();
        run::run(problem, pieces.clone(), guesses.clone(), &start, &bounds, lengths, &mut tick)
    };
    let found = zeros::worthwhile(&unknown, 2 * motion.degrees_of_freedom(), &mut once);
    progress.finish_and_clear();
    let mut found = match found {
        Ok(found) => found,
        Err(why) => return Ok(Err(why)),
    };
    let (unknown, outcome) = (&found.unknown, &found.outcome);
    let problem = Problem { sensors: &shown, zeros: unknown.zeros(), ..track.problem(motion, outcome.step_s, &at) };
    let first = |p: &Piece| (track.since_begin(p) / track.spacing_s).round() as usize;
    let fit = &outcome.fit;
    // A slip may be why a piece was not followed.
    let (all, states) = if offsets {
        with_lost(&problem, outcome, (&pieces, &guesses), &levels)
    } else {
        (outcome.pieces.clone(), fit.states.clone())
    };
    let slips = slips::find(&problem, &all, &states, &fit.parameters, &first, &prepared.sensors.count);
    let mut levels_s: Vec<f64> = levels.iter().map(|l| *l as f64 * track.spacing_s).collect();
    let mut adds_up = None;
    // What a drive keeps moving may be chaotic.
    if rig.drive.is_none() && settings.segment_s.is_none() && !offsets {
        let bounds: Vec<[f64; 2]> = bounds.iter().copied().chain(unknown.none().map(|_| OPEN)).collect();
        let margin = prepared.geometry.kernels.full.reach();
        let from = longer::From { parameters: &fit.parameters, bounds: &bounds, length, margin };
        // Where the model holds: what it misses adds up along a piece.
        let holds = |o: &Outcome| o.noise_ratio.iter().all(|r| *r <= MISSES);
        let all: Vec<usize> = (0..fit.parameters.len()).collect();
        let error = |o: &Outcome| longer::mean_error(&o.covariance.estimate, &all);
        let tells_more = |o: &Outcome| holds(o) && error(o) < error(outcome);
        if let Some((more, length)) = longer(&problem, track, &from, &mut tick).filter(|m| tells_more(&m.0)) {
            let longest_s = length as f64 * track.spacing_s;
            let excess = |expected| longer::excess(outcome, &more, problem.states(), expected);
            let is_clear = excess(longer::Expected::default()) > CLEARLY
                && noisy_inputs::more(given, &problem, outcome, &more)
                    .is_none_or(|by_inputs| excess(by_inputs) > CLEARLY);
            if is_clear {
                let shortest_s = levels_s.last().copied().unwrap_or(0.0);
                adds_up = Some(result::adds_up((shortest_s, outcome), (longest_s, &more)));
            }
            levels_s.push(longest_s);
            found.outcome = more;
        }
    }
    let shifts = found.unknown.values(&found.outcome.fit.parameters);
    let zeros = found.told(rig, bound, prepared);
    Ok(Ok(ShootingRun { levels_s, slips, zeros, shifts, adds_up, outcome: found.outcome }))
}
