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
pub mod problem;
pub mod run;
pub mod solve;
mod states;
pub mod track;
mod with_offsets;
pub mod zeros;

use indicatif::ProgressBar;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::built_in::WrittenRig;
use super::input_noise::Level;
use super::judgement::MISLEADING;
use super::per_record::Split;
use super::prepared::{Prepared, prepare_moving};
use super::regression::{frequency_dots, identification_error};
use super::series::System;
use super::slips::{self, Placed, Slip};
use super::stretches::Stretch;
use super::track::{ExogenousInputs, Pieces, Track};
use super::{Identification, Residuals, Settings as WeakSettings, built_in, identifiability, weak_form, windows};
use crate::error::{BadInput, Result};
use crate::model::dynamics::Dynamics;
use crate::model::model_file::weak_form::WeakForm;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::system::ties::Identified;
use crate::warning::Warning;
use problem::{Piece, Problem};
use run::{Failure, Outcome, REPEATING};
use with_offsets::WithOffsets;
use zeros::{Moment, Unknown, ZeroOffset};

/// Ratio of residuals to the sensors' noise from which the model is said to miss something.
pub const MISSES: f64 = 1.2;
/// Part of a window that stands for the drive's period in a free system.
const PERIODS: f64 = 20.0;
/// Fewest samples of a piece.
const FEWEST_SAMPLES: usize = 16;
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
    finish(first, WrittenRig { rig, own: &own, bound }, &names, &prepared, attempt)
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
    if !attempt.outcome.fit.converged || attempt.outcome.noise_ratio.iter().any(|r| *r > MISSES) {
        return Ok(Vec::new());
    }
    Ok(slips::placed(&attempt.slips, bound, &prepared))
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
}

/// Pieces, start, bounds, levels; then the run, `offsets` saying whether every piece has its
/// sensors' zeros to itself; otherwise those of a record are parameters ([`zeros`]).
fn shoot(given: &Given<'_>, offsets: bool, settings: &Settings, progress: &ProgressBar) -> Result<ShootingRun> {
    let Given { motion, names, rig, bound, prepared, first } = *given;
    let Prepared { stretches, sensors, geometry, .. } = prepared;
    let omega = rig.drive.map_or(0.0, |_| rig.omega());
    let exogenous: Vec<ExogenousInputs> = stretches.iter().map(|s| ExogenousInputs::new(s, omega)).collect();
    let track = Track::new(stretches, &exogenous, rig, bound, sensors);
    let period_s = rig.drive.map_or(geometry.windows.length_s / PERIODS, |d| 1.0 / d.frequency_hz);
    let shortest = FEWEST_SAMPLES as f64 * track.spacing_s;
    let piece_s = settings.segment_s.unwrap_or((4.0 * period_s).max(shortest));
    let longest = (0..stretches.len()).map(|k| track.samples(k)).max().unwrap_or(0) as f64 * track.spacing_s;
    if !(piece_s >= shortest && piece_s <= longest) {
        return Err(BadInput::new(format!("{piece_s} s"), format!("{shortest} to {longest} s"))
            .at("--segment-s")
            .remedy("A piece needs at least 16 samples, and cannot be longer than the longest unbroken stretch"));
    }
    let length = (piece_s / track.spacing_s).round() as usize;
    let mut levels: Vec<usize> = [4, 2, 1].iter().map(|d| length / d).filter(|l| *l >= FEWEST_SAMPLES).collect();
    levels.dedup();
    let guess = ((0.05 * period_s / track.spacing_s).round() as usize).clamp(4, 16).min(levels[0]);
    let Pieces { pieces, mut guesses, .. } = track
        .cut(length, guess)
        .ok_or_else(|| BadInput::new("sensors that do not give all coordinates", "one sensor for each coordinate"))?;
    let start: Vec<f64> = names
        .iter()
        .map(|n| {
            let found = first.parameter(n).map(|p| p.value);
            found.ok_or_else(|| BadInput::new(format!("no {n}"), "a start by the weak form"))
        })
        .collect::<Result<_>>()?;
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
    let found = found.map_err(Failure::told)?;
    let (unknown, outcome) = (&found.unknown, &found.outcome);
    let problem = Problem { sensors: &shown, zeros: unknown.zeros(), ..track.problem(motion, outcome.step_s, &at) };
    let first = |p: &Piece| (track.since_begin(p) / track.spacing_s).round() as usize;
    let fit = &outcome.fit;
    let slips = slips::find(&problem, &outcome.pieces, &fit.states, &fit.parameters, &first, &sensors.count);
    let levels_s = levels.iter().map(|l| *l as f64 * track.spacing_s).collect();
    let shifts = unknown.values(&fit.parameters);
    Ok(ShootingRun { levels_s, slips, zeros: found.told(rig, bound, prepared), shifts, outcome: found.outcome })
}

/// What a run makes one doubt; `worst`: its greatest residuals, in the sensors' noise.
fn doubts(outcome: &Outcome, worst: f64, inputs: &[Level]) -> Vec<Warning> {
    let Outcome { fit, lost, rounds, covariance, .. } = outcome;
    let used = fit.states.len();
    let mut warnings = Vec::new();
    if worst > MISSES {
        let warning = Warning::new(
            "more-than-noise",
            format!("residuals are {worst:.1} times the sensors' noise: the model misses something"),
            "Parameters make up for it as well as they can and may be off by more than their standard errors; see `whirl explain`",
        );
        // The noise of an input comes through the system, and is not the sensors'.
        let alone = inputs.iter().all(|l| *l == Level::Known(0.0));
        warnings.push(if alone && worst * worst > MISLEADING { warning.invalidating() } else { warning });
    }
    if *lost > 0 {
        warnings.push(Warning::new(
            "pieces-lost",
            format!("{lost} of {} pieces could not be followed by a solution of the model", lost + used),
            "They were left out; a blow, a slipping joint or a short piece of wrong values there?",
        ));
    }
    if !fit.converged {
        warnings.push(Warning::new(
            "not-converged",
            format!("{rounds} rounds did not come to rest"),
            "Try shorter pieces with --segment-s, and look at how well the weak form does",
        ));
    }
    if covariance.blocks == 0 {
        warnings.push(Warning::new(
            "few-pieces",
            format!("{used} pieces are too few to measure how residuals scatter"),
            "Standard errors assume white sensor noise; record longer",
        ));
    }
    warnings
}

/// The run's result in the place of the weak form's.
fn finish(
    first: Identification,
    written: WrittenRig<'_>,
    names: &[String],
    prepared: &Prepared,
    ShootingRun { outcome, levels_s, slips, zeros, shifts }: ShootingRun,
) -> Result<Identification> {
    let WrittenRig { rig, bound, .. } = written;
    let worst = outcome.noise_ratio.iter().copied().fold(0.0, f64::max);
    let doubts = doubts(&outcome, worst, &prepared.sensors.inputs);
    let Outcome { fit, covariance, noise_ratio, lost, repetition, step_s, values, rounds, .. } = outcome;
    // Zeros are told apart from the equations' parameters.
    let own = |of: &DMatrix<f64>| of.view((0, 0), (names.len(), names.len())).into_owned();
    let found = DVector::from_column_slice(&fit.parameters[..names.len()]);
    let (estimate, least) = (&own(&covariance.estimate), own(&covariance.bound));
    let mut warnings: Vec<Warning> = prepared.warnings.clone();
    // What a model misses shows in the residuals again and again, too.
    if repetition > REPEATING && worst <= MISSES {
        warnings.push(weak_form::periodic(repetition, "piece", rig, bound));
    }
    warnings.extend(doubts);
    warnings.extend(zeros::warnings(&zeros));
    let unit = |n: &String| first.parameter(n).map_or_else(String::new, |p| p.unit.clone());
    let units: Vec<String> = names.iter().map(unit).collect();
    let identified = Identified { names, values: &found, covariance: estimate, metric: &least };
    let (parameters, ties_misfit) = built_in::parameters(rig, &identified, &units, &mut warnings);
    let (identification_error, residuals) = balances(names, &found, written, prepared, &shifts)?;
    let given: usize = prepared.stretches.iter().map(Stretch::len).sum::<usize>() * noise_ratio.len();
    let details = super::Details {
        repetition,
        jackknife_blocks: covariance.blocks,
        ties_misfit,
        condition: vec![covariance.condition],
        noise_bias: Vec::new(),
        // Its own residuals tell what is left (`noise_ratio`).
        residual_over_noise: None,
        ..first.details.clone()
    };
    let mut result = Identification {
        method: "shooting".to_owned(),
        parameters,
        identification_error,
        equations_used: values,
        equations_dropped: given.saturating_sub(values),
        groups_not_separable: identifiability::groups_not_separable(names, &found, estimate),
        correlation: identifiability::correlation(estimate),
        correlation_names: names.to_vec(),
        details,
        shooting: Some(Details {
            levels_s,
            pieces: fit.states.len(),
            lost,
            step_s,
            rounds,
            converged: fit.converged,
            noise_ratio,
            cramer_rao: (0..names.len()).map(|i| least[(i, i)].max(0.0).sqrt()).collect(),
            at_bound: names.iter().zip(&fit.held).filter(|(_, h)| **h).map(|(n, _)| n.clone()).collect(),
        }),
        warnings,
        residuals,
        slips: slips::placed(&slips, bound, prepared),
        zeros,
        ..first
    };
    super::judgement::judge(&mut result, rig);
    Ok(result)
}

/// ε of the balance equations with these coefficients in them, the sensors' zeros (by stretch) taken
/// off, and their residuals.
fn balances(
    names: &[String],
    found: &DVector<f64>,
    written: WrittenRig<'_>,
    prepared: &Prepared,
    zeros: &[Vec<f64>],
) -> Result<(Vec<f64>, Vec<Residuals>)> {
    let WrittenRig { own, bound, .. } = written;
    let weak = WeakForm::new(&bound.model, own.omega(), &[])?;
    let circle = bound.model.circle();
    let super::Geometry { windows, kernels } = &prepared.geometry;
    let without_zeros = |(s, zeros): (&Stretch, &Vec<f64>)| s.shifted(bound, zeros);
    let stretches: Vec<Stretch> = prepared.stretches.iter().zip(zeros).map(without_zeros).collect();
    let system = System { stretches: &stretches, weak: &weak, kernels, circle: &circle };
    let rows = windows::rows_of(&system, &weak.equations, kernels, windows);
    let columns = Split::new(&bound.model, 1).tied(names, found);
    let one = |(e, coefficients): (usize, &DVector<f64>)| {
        let (rms, dots) = frequency_dots(&rows, e, coefficients, windows.frequencies, 2000);
        let residuals = Residuals { frequency_step_hz: 1.0 / windows.length_s, rms, dots };
        (identification_error(&rows, e, coefficients), residuals)
    };
    Ok(columns.iter().enumerate().map(one).unzip())
}
