//! Multiple shooting for a model file: [`crate::identify::shooting`] over its equations of motion, inputs taken as band-limited.
//!
//! Pieces are one drive period times four, or 0.8 s when free, as for the built-in systems; the start is the weak form. A coefficient of
//! its own for each record is not possible here: shooting shares all coefficients over all pieces.

use indicatif::ProgressBar;
use nalgebra::DVector;

use super::track::{Along, Pieces, Track};
use super::{Prepared, correlation, physical, prepare};
use crate::error::{BadInput, Result};
use crate::identify::shooting::run::{self, Failure, Outcome, REPEATING};
use crate::identify::shooting::{Details, MISSES, Settings, told};
use crate::identify::{Identification, Settings as WeakSettings, identifiability};
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::Bound;
use crate::system::ties::Identified;
use crate::warning::Warning;

/// Part of a window that stands for the drive's period in a free system.
const PERIODS: f64 = 20.0;
/// Fewest samples of a piece.
const FEWEST_SAMPLES: usize = 16;

/// Identifies a model file's coefficients by multiple shooting from the weak form's result.
///
/// # Errors
/// As the weak form; equations that cannot be integrated; coefficients for each record; bounds on a coefficient that there is not; a record
/// that no solution of the model follows.
pub fn identify(
    records: &[Record],
    rig: &Rig,
    bound: &Bound,
    weak: &WeakSettings,
    settings: &Settings,
    progress: &ProgressBar,
) -> Result<Identification> {
    let model = &*bound.model;
    let own = records.len() > 1 && model.equations.iter().flat_map(|e| &e.terms).any(|t| t.each_record);
    if own {
        return Err(model
            .bad("each = \"record\"", "coefficients that all records share, for multiple shooting")
            .remedy("Give the records one by one, or use --method weak"));
    }
    let first = super::identify(records, rig, bound, weak)?;
    let Prepared { stretches, sensors, geometry, .. } = prepare(records, rig, bound, weak)?;
    let motion = EquationsOfMotion::new(model, rig.omega())?;
    let along: Vec<Along> = stretches.iter().map(|s| Along::new(s, rig.drive.map_or(0.0, |_| rig.omega()))).collect();
    let track = Track::new(&stretches, &along, rig, bound, &sensors);
    let period_s = rig.drive.map_or(geometry.windows.length_s / PERIODS, |d| 1.0 / d.frequency_hz);
    let piece_s = settings.segment_s.unwrap_or((4.0 * period_s).max(FEWEST_SAMPLES as f64 * track.spacing_s));
    let longest = (0..stretches.len()).map(|k| track.samples(k)).max().unwrap_or(0) as f64 * track.spacing_s;
    let shortest = FEWEST_SAMPLES as f64 * track.spacing_s;
    if !(piece_s >= shortest && piece_s <= longest) {
        return Err(BadInput::new(format!("{piece_s} s"), format!("{shortest} to {longest} s"))
            .at("--segment-s")
            .remedy("A piece needs at least 16 samples, and cannot be longer than the longest unbroken stretch"));
    }
    let length = (piece_s / track.spacing_s).round() as usize;
    let mut levels: Vec<usize> = [4, 2, 1].iter().map(|d| length / d).filter(|l| *l >= FEWEST_SAMPLES).collect();
    levels.dedup();
    let guess = ((0.05 * period_s / track.spacing_s).round() as usize).clamp(4, 16).min(length);
    let Pieces { pieces, guesses, .. } = track
        .cut(length, guess)
        .ok_or_else(|| BadInput::new("sensors that do not give all coordinates", "one sensor for each coordinate"))?;
    let names = motion.coefficients();
    let start: Vec<f64> = names.iter().map(|n| first.parameter(n).map_or(0.0, |p| p.value)).collect();
    let mut bounds = vec![[f64::NEG_INFINITY, f64::INFINITY]; names.len()];
    for (name, low, high) in &settings.bounds {
        let i = names.iter().position(|n| n == name).ok_or_else(|| {
            BadInput::new(format!("\"{name}\""), format!("one of {}", names.join(", "))).at("--bound")
        })?;
        bounds[i] = [*low, *high];
    }
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let problem = track.problem(&motion, period_s, &at);
    let samples: usize = (0..stretches.len()).map(|k| track.samples(k)).sum();
    let outcome = run::run(problem, pieces, guesses, &start, &bounds, &levels, &mut || progress.inc(1));
    progress.finish_and_clear();
    let outcome = outcome.map_err(|e| {
        let error = match e {
            Failure::NothingFollows => BadInput::new(
                "no piece of the record that a solution of the model follows",
                "motion that the model describes over a piece",
            )
            .remedy("Look at the weak form's result and at `whirl explain`, or try shorter pieces with --segment-s"),
            Failure::NotDetermined => BadInput::new(
                "a coefficient that the record does not determine",
                "motion in which every term takes part",
            )
            .remedy("Does everything move? See `whirl inspect`"),
        };
        match records.first() {
            Some(r) => error.in_file(&r.path),
            None => error,
        }
    })?;
    let levels_s = levels.iter().map(|l| *l as f64 * track.spacing_s).collect();
    Ok(finish((rig, model), first, names, outcome, levels_s, samples * track.sensors.len()))
}

/// The run's result in the place of the weak form's.
fn finish(
    (rig, model): (&Rig, &ModelFile),
    first: Identification,
    names: &[String],
    outcome: Outcome,
    levels_s: Vec<f64>,
    values_given: usize,
) -> Identification {
    let Outcome { fit, covariance, noise_ratio, lost, repetition, step_s, values, rounds } = outcome;
    let mut warnings: Vec<Warning> = first.warnings.iter().filter(|w| w.id != physical::OPEN).cloned().collect();
    let worst = noise_ratio.iter().copied().fold(0.0, f64::max);
    if repetition > REPEATING && worst <= MISSES {
        warnings.push(Warning::new(
            "periodic-record",
            format!("residuals repeat from piece to piece (correlation {repetition:.2}): the motion is periodic"),
            "Errors repeat with it and do not average out; standard errors were widened for that",
        ));
    }
    warnings.extend(told(worst, (lost, fit.states.len()), rounds, fit.converged, covariance.blocks));
    let values_found = DVector::from_vec(fit.parameters.clone());
    let estimate = &covariance.estimate;
    let mut parameters = first.parameters.clone();
    parameters.truncate(first.correlation_names.len());
    for p in &mut parameters {
        if let Some(i) = names.iter().position(|n| *n == p.name) {
            (p.value, p.std_error) = (fit.parameters[i], estimate[(i, i)].max(0.0).sqrt());
        }
    }
    let identified = Identified { names, values: &values_found, covariance: estimate, metric: &covariance.bound };
    let mut details = first.details.clone();
    details.ties_misfit = physical::add(rig, model, &identified, &mut parameters, &mut warnings);
    details.repetition = repetition;
    details.jackknife_blocks = covariance.blocks;
    details.condition = vec![covariance.condition];
    details.noise_bias = Vec::new();
    Identification {
        method: "shooting".to_owned(),
        parameters,
        equations_used: values,
        equations_dropped: values_given.saturating_sub(values),
        groups_not_separable: identifiability::groups_not_separable(names, &values_found, estimate),
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
        ..first
    }
}
