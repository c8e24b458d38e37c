//! Multiple-shooting maximum likelihood: the equations are integrated over pieces of the record, and parameters and initial states are those whose angles
//! come closest to the measured counts.
//!
//! A count says that the angle lies in [c, c + 1): as noise, white with variance q²/12 (Widrow and Kollár 2008, Quantization Noise). With white noise of given size the likelihood's maximum
//! is the least-squares solution of [`problem`], found by [`solve`] with the states eliminated; pieces grow from 1T over 2T to 4T ([`run`]).
//! Noise enters the measured angles only, never the regressors, so that there is no bias to take off. Standard errors come from the pieces' own
//! scatter ([`covariance`]). The start is the weak form.
//!
//! Limits: a piece's solution must stay close to the motion, so pieces cannot be much longer than a few Lyapunov times; a model that misses an effect is fitted as
//! closely as it can be, and the residuals then exceed the noise, which is said.

pub mod covariance;
pub mod problem;
pub mod run;
pub mod solve;
pub mod track;

use core::f64::consts::TAU;

use indicatif::ProgressBar;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::regression::{frequency_dots, identification_error};
use super::system::System;
use super::windows;
use super::{
    Identification, Parameter, Prepared, Residuals, Settings as WeakSettings, identifiability, prepare_system,
};
use crate::error::{BadInput, Result};
use crate::model::double_pendulum_dynamics::DoublePendulum;
use crate::model::dynamics::Dynamics;
use crate::model::single_pendulum_dynamics::SinglePendulum;
use crate::record::Record;
use crate::rig::Rig;
use crate::signal::angles::AngleSegment;
use crate::warning::Warning;
use problem::Problem;
use run::{Failure, Outcome, REPEATING};
use track::{Geometry, Stretch};

/// Ratio of residuals to the sensors' noise from which the model is said to miss something.
pub const MISSES: f64 = 1.2;
/// Part of a window that stands for the drive's period in a free system.
const PERIODS: f64 = 20.0;
/// Progress: rounds expected.
const EXPECTED_ROUNDS: u64 = 16;

/// Choices of multiple shooting.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Settings {
    /// Length of the pieces at the last level, s; by default four drive periods, a fifth of a window for a free system.
    pub segment_s: Option<f64>,
    /// Bounds of parameters: name, lowest, highest. None by default.
    pub bounds: Vec<(String, f64, f64)>,
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
    /// Standard errors that white Gaussian noise of the residuals' size allows at best for these pieces (Cramér and Rao), in the order of
    /// `correlation_names`.
    pub cramer_rao: Vec<f64>,
    /// Parameters that stand at a bound.
    pub at_bound: Vec<String>,
}

/// Identifies a system by multiple shooting from the weak form's result.
///
/// # Errors
/// As the weak form; bounds on a parameter that there is not; a record that no solution of the model follows.
pub fn identify(
    records: &[Record],
    rig: &Rig,
    weak: &WeakSettings,
    settings: &Settings,
    progress: &ProgressBar,
) -> Result<Identification> {
    if let Some(bound) = &rig.bound {
        return super::general::shooting::identify(records, rig, bound, weak, settings, progress);
    }
    let system = System::of(rig)?;
    let first = super::identify(records, rig, weak)?;
    let prepared = prepare_system(&system, records, rig, weak)?;
    let (omega, driven) = (rig.omega(), rig.drive.is_some());
    let located = |e: BadInput| match records.first() {
        Some(r) if e.place.is_none() => e.in_file(&r.path),
        _ => e,
    };
    match &system {
        System::Single(dampings) => {
            let equations = SinglePendulum::new(omega, driven, dampings);
            let sensors = [vec![1.0]];
            let outcome =
                shoot(&equations, equations.names(), &sensors, &[true], &prepared, rig, &first, settings, progress)
                    .map_err(located)?;
            finish(first, &system, equations.names(), equations.units(), &prepared, rig, outcome)
        }
        System::Double(dampings) => {
            let equations = DoublePendulum::new(omega, driven, dampings);
            let relative = prepared.segments.iter().any(|s| s.relative);
            let sensors = [vec![1.0, 0.0], if relative { vec![-1.0, 1.0] } else { vec![0.0, 1.0] }];
            let outcome =
                shoot(&equations, equations.names(), &sensors, &[true; 2], &prepared, rig, &first, settings, progress)
                    .map_err(located)?;
            finish(first, &system, equations.names(), equations.units(), &prepared, rig, outcome)
        }
    }
}

/// Pieces, start, bounds, levels; then the run.
fn shoot<D: Dynamics>(
    dynamics: &D,
    names: &[String],
    sensors: &[Vec<f64>],
    angles: &[bool],
    prepared: &Prepared,
    rig: &Rig,
    first: &Identification,
    settings: &Settings,
    progress: &ProgressBar,
) -> Result<(Outcome, Vec<f64>)> {
    let spacing_s = prepared.segments.first().map_or(1.0 / rig.sample_rate_hz, |s| s.step_s);
    let period_s = rig.drive.map_or(prepared.geometry.windows.length_s / PERIODS, |d| 1.0 / d.frequency_hz);
    let piece_s = settings.segment_s.unwrap_or(4.0 * period_s);
    let longest = prepared.segments.iter().map(AngleSegment::len).max().unwrap_or(0) as f64 * spacing_s;
    if !(piece_s >= 16.0 * spacing_s && piece_s <= longest) {
        return Err(BadInput::new(format!("{piece_s} s"), format!("{} to {longest} s", 16.0 * spacing_s))
            .at("--segment-s")
            .remedy("A piece needs at least 16 samples, and cannot be longer than the longest unbroken stretch"));
    }
    let length = (piece_s / spacing_s).round() as usize;
    let mut levels: Vec<usize> = [4, 2, 1].iter().map(|d| length / d).filter(|l| *l >= 16).collect();
    levels.dedup();
    let sigma: Vec<f64> = (0..sensors.len())
        .map(|k| {
            let count = prepared.segments.first().and_then(|s| s.count_rad.get(k).copied().flatten());
            let sigma = count.map_or(prepared.sigma[k], |q| q / 12f64.sqrt());
            // A sensor without noise is not possible; without a scale the weights would be infinite.
            if sigma > 0.0 && sigma.is_finite() { sigma } else { 1e-6 }
        })
        .collect();
    let stretches: Vec<Stretch<'_>> = prepared
        .segments
        .iter()
        .map(|s| Stretch {
            start_s: s.start_s,
            sensors: s.sensors().into_iter().take(sensors.len()).collect(),
            tau: Box::new(|i| s.tau(i)),
        })
        .collect();
    let guess = ((0.05 * period_s / spacing_s).round() as usize).clamp(4, 16).min(levels[0]);
    let geometry = Geometry { sensors, angles, spacing_s, guess };
    let (pieces, guesses) = track::cut(&stretches, &geometry, length, (length / 4).max(16))
        .ok_or_else(|| BadInput::new("sensors that do not give all coordinates", "one sensor for each coordinate"))?;
    let start: Vec<f64> = names
        .iter()
        .map(|n| {
            first
                .parameter(n)
                .map(|p| p.value)
                .ok_or_else(|| BadInput::new(format!("no {n}"), "a start by the weak form"))
        })
        .collect::<Result<_>>()?;
    let mut bounds = vec![[f64::NEG_INFINITY, f64::INFINITY]; names.len()];
    for (name, low, high) in &settings.bounds {
        let i = names.iter().position(|n| n == name).ok_or_else(|| {
            BadInput::new(format!("\"{name}\""), format!("one of {}", names.join(", "))).at("--bound")
        })?;
        bounds[i] = [*low, *high];
    }
    let problem = Problem {
        dynamics,
        sensors,
        sigma: &sigma,
        spacing_s,
        step_s: period_s,
        omega: rig.drive.map_or(0.0, |d| TAU * d.frequency_hz),
        inputs: None,
    };
    progress.set_length(EXPECTED_ROUNDS);
    let mut tick = || {
        if progress.position() + 1 < EXPECTED_ROUNDS {
            progress.inc(1);
        }
    };
    let levels_s = levels.iter().map(|l| *l as f64 * spacing_s).collect();
    let outcome = run::run(problem, pieces, guesses, &start, &bounds, &levels, &mut tick).map_err(|e| match e {
        Failure::NothingFollows => BadInput::new(
            "no piece of the record that a solution of the model follows",
            "motion that the model describes over a piece",
        )
        .remedy("Look at the weak form's result and at `whirl explain`, or try shorter pieces with --segment-s"),
        Failure::NotDetermined => {
            BadInput::new("a parameter that the record does not determine", "motion in which every term takes part")
                .remedy("See `whirl inspect`: is an arm at rest, is the motion locked to the drive?")
        }
    })?;
    progress.finish_and_clear();
    Ok((outcome, levels_s))
}

/// What a run has to tell: residuals (in the sensors' noise), pieces lost and used, rounds, whether they came to rest, blocks of the jackknife.
pub(crate) fn told(
    worst: f64,
    (lost, used): (usize, usize),
    rounds: usize,
    converged: bool,
    blocks: usize,
) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if worst > MISSES {
        warnings.push(Warning::new(
            "more-than-noise",
            format!("residuals are {worst:.1} times the sensors' noise: the model misses something"),
            "Parameters make up for it as well as they can and may be off by more than their standard errors; see `whirl explain`",
        ));
    }
    if lost > 0 {
        warnings.push(Warning::new(
            "pieces-lost",
            format!("{lost} of {} pieces could not be followed by a solution of the model", lost + used),
            "They were left out; a blow, a slipping joint or a short piece of wrong values there?",
        ));
    }
    if !converged {
        warnings.push(Warning::new(
            "not-converged",
            format!("{rounds} rounds did not come to rest"),
            "Try shorter pieces with --segment-s, and look at how well the weak form does",
        ));
    }
    if blocks == 0 {
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
    system: &System,
    names: &[String],
    units: &[&'static str],
    prepared: &Prepared,
    rig: &Rig,
    (outcome, levels_s): (Outcome, Vec<f64>),
) -> Result<Identification> {
    let Outcome { fit, covariance, noise_ratio, lost, repetition, step_s, values, rounds } = outcome;
    let vector = DVector::from_vec(fit.parameters.clone());
    let estimate = &covariance.estimate;
    let mut warnings: Vec<Warning> = prepared.warnings.clone();
    let worst = noise_ratio.iter().copied().fold(0.0, f64::max);
    // What a model misses shows in the residuals again and again, too.
    if repetition > REPEATING && worst <= MISSES {
        warnings.push(Warning::new(
            "periodic-record",
            format!("residuals repeat from piece to piece (correlation {repetition:.2}): the motion is locked to the drive or periodic"),
            "Quantisation errors repeat with it and do not average out; standard errors were widened for that. Change the drive's amplitude or frequency until the motion is chaotic, or count more lines a turn",
        ));
    }
    warnings.extend(told(worst, (lost, fit.states.len()), rounds, fit.converged, covariance.blocks));
    let mut parameters = super::ordered_parameters(names, units, &vector, estimate);
    let mut ties_misfit = None;
    if let Some(physical) = system.physical(names, &vector, estimate, &covariance.bound, rig) {
        ties_misfit = Some((physical.misfit, physical.freedom));
        parameters.extend(physical.parameters.iter().map(|p| Parameter {
            name: p.name.to_owned(),
            value: p.value,
            std_error: p.std_error,
            unit: p.unit.to_owned(),
        }));
        if !physical.undetermined.is_empty() {
            warnings.push(Warning::new(
                "undetermined",
                format!("the known quantities leave {} open", physical.undetermined.join(", ")),
                "Add what is known (a mass, a length, an amplitude) to [known] in the rig file",
            ));
        }
    }
    // ε of the balance equations, with these parameters in them.
    let windows = prepared.geometry.windows;
    let model = system.weak_model(rig);
    let rows = windows::rows(&prepared.segments, &model, &prepared.geometry.kernels, &windows);
    let mut at = 0;
    let (mut errors, mut residuals) = (Vec::new(), Vec::new());
    for (e, equation) in model.equations.iter().enumerate() {
        let coefficients = vector.rows(at, equation.terms.len()).into_owned();
        at += equation.terms.len();
        errors.push(identification_error(&rows, e, &coefficients));
        let (rms, dots) = frequency_dots(&rows, e, &coefficients, windows.frequencies, 2000);
        residuals.push(Residuals { frequency_step_hz: 1.0 / windows.length_s, rms, dots });
    }
    let samples: usize = prepared.segments.iter().map(AngleSegment::len).sum();
    let sensors = noise_ratio.len();
    let mut details = first.details.clone();
    details.repetition = repetition;
    details.jackknife_blocks = covariance.blocks;
    details.ties_misfit = ties_misfit;
    details.condition = vec![covariance.condition];
    details.noise_bias = Vec::new();
    // Its own residuals tell what is left (`noise_ratio`).
    details.residual_over_noise = None;
    let mut result = Identification {
        method: "shooting".to_owned(),
        parameters,
        identification_error: errors,
        equations_used: values,
        equations_dropped: (samples * sensors).saturating_sub(values),
        groups_not_separable: identifiability::groups_not_separable(names, &vector, estimate),
        correlation: correlation(estimate),
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
            cramer_rao: (0..names.len()).map(|i| covariance.bound[(i, i)].max(0.0).sqrt()).collect(),
            at_bound: names.iter().zip(&fit.held).filter(|(_, h)| **h).map(|(n, _)| n.clone()).collect(),
        }),
        warnings,
        residuals,
        ..first
    };
    super::judgement::judge(&mut result, rig);
    Ok(result)
}

fn correlation(covariance: &DMatrix<f64>) -> Vec<Vec<f64>> {
    let n = covariance.nrows();
    let at = |i: usize, j: usize| {
        let d = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
        if d > 0.0 { covariance[(i, j)] / d } else { f64::from(u8::from(i == j)) }
    };
    (0..n).map(|i| (0..n).map(|j| at(i, j)).collect()).collect()
}
