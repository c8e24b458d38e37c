//! What a run of multiple shooting tells: its result in the place of the weak form's, and what it
//! makes one doubt.

use nalgebra::{DMatrix, DVector};

use super::super::best::MISSES_SOMETHING;
use super::super::built_in::{self, WrittenRig};
use super::super::input_noise::Level;
use super::super::judgement::{self, MISLEADING};
use super::super::per_record::Split;
use super::super::prepared::Prepared;
use super::super::regression::{REPEATING, frequency_dots, identification_error};
use super::super::remeasured::Sensors;
use super::super::series::System;
use super::super::stretches::Stretch;
use super::super::{Identification, Residuals, identifiability, slips, weak_form, windows};
use super::run::Outcome;
use super::{Details, MISSES, ShootingRun, zeros};
use crate::error::Result;
use crate::model::model_file::weak_form::WeakForm;
use crate::system::ties::Identified;
use crate::warning::Warning;
use crate::wording::format::significant;

/// Standard errors by which residuals must exceed the sensors' noise, as in `explain`.
const CLEAR: f64 = 4.0;

/// Whether residuals of so many values are more than the noise of their sensor, the square of which
/// is known to a share of it: of a few hundred samples no better than to a sixth.
fn is_more(ratio: f64, square_error: f64, values: usize) -> bool {
    let error = square_error.hypot((2.0 / values.max(1) as f64).sqrt());
    ratio > MISSES && ratio * ratio > 1.0 + CLEAR * error
}

/// What a run makes one doubt; `worst`: its greatest residuals, in the sensors' noise; `is_balanced`:
/// whether the balance of forces misses nothing beside the noise of inputs.
fn doubts(outcome: &Outcome, worst: f64, sensors: &Sensors, is_balanced: bool) -> Vec<Warning> {
    let Outcome { fit, lost, rounds, covariance, noise_ratio, values, .. } = outcome;
    let used = fit.states.len();
    let inputs = &sensors.inputs;
    let mut warnings = Vec::new();
    let noisy = inputs.iter().any(|l| l.sigma() > 0.0);
    let each = values / noise_ratio.len().max(1);
    let more = noise_ratio.iter().zip(&sensors.square_error).any(|(ratio, error)| is_more(*ratio, *error, each));
    if more && noisy && is_balanced {
        warnings.push(Warning::new(
            "input-noise",
            format!(
                "residuals are {worst:.1} times the sensors' noise: the noise of the measured inputs comes through the \
                 system; the balance of forces, which counts it, misses nothing"
            ),
            "Parameters may be off by more than their standard errors; a quieter input would tell more",
        ));
    } else if more {
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

/// What is said where long pieces leave more than short ones: length, s, and fit of each.
pub fn adds_up((short_s, short): (f64, &Outcome), (long_s, long): (f64, &Outcome)) -> Warning {
    let of = |o: &Outcome| significant(o.noise_ratio.iter().copied().fold(0.0, f64::max), 3);
    let [short_s, long_s] = [short_s, long_s].map(|s| significant(s, 3));
    Warning::new(
        "misses-over-long",
        format!(
            "over pieces of {long_s} s residuals are {} times the sensors' noise, over pieces of {short_s} s {} times, \
             which is more than chance makes of it: something faint that the model misses adds up",
            of(long),
            of(short)
        ),
        "Parameters make up for it and may be off by more than their standard errors; `whirl explain` looks for it",
    )
}

/// The run's result in the place of the weak form's.
pub fn finish(
    first: Identification,
    written: WrittenRig<'_>,
    names: &[String],
    prepared: &Prepared,
    ShootingRun { outcome, levels_s, slips, zeros, shifts, adds_up }: ShootingRun,
) -> Result<Identification> {
    let WrittenRig { rig, bound, .. } = written;
    let worst = outcome.noise_ratio.iter().copied().fold(0.0, f64::max);
    let is_balanced = first.warnings.iter().all(|w| w.id != MISSES_SOMETHING);
    let doubts = doubts(&outcome, worst, &prepared.sensors, is_balanced);
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
    warnings.extend(adds_up);
    warnings.extend(zeros::warnings(&zeros));
    let unit = |n: &String| first.parameter(n).map_or_else(String::new, |p| p.unit.clone());
    let units: Vec<String> = names.iter().map(unit).collect();
    let identified = Identified { names, values: &found, covariance: estimate, metric: &least };
    let (parameters, ties_misfit) = built_in::parameters(rig, &identified, &units, &mut warnings);
    let (identification_error, residuals) = balances(names, &found, written, prepared, &shifts)?;
    let own = (first.identification_error.clone(), first.residuals.clone());
    let given: usize = prepared.stretches.iter().map(Stretch::len).sum::<usize>() * noise_ratio.len();
    let details = super::super::Details {
        repetition,
        jackknife_blocks: covariance.blocks,
        ties_misfit,
        condition: vec![covariance.condition],
        noise_bias: Vec::new(),
        // Its own residuals tell what is left (`noise_ratio`).
        residual_over_noise: None,
        ..first.details.clone()
    };
    let result = Identification {
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
    let mut result = as_balanced(result, own, worst);
    judgement::judge(&mut result, rig);
    Ok(result)
}

/// ε and residuals of the weak form's own coefficients in the place of those found, where solutions
/// follow the record to its noise and the equations miss something with these alone: of a motion
/// sampled coarsely the balance has errors of its own, which its own coefficients make up for.
fn as_balanced(found: Identification, own: (Vec<f64>, Vec<Residuals>), worst: f64) -> Identification {
    let misses = |i: &Identification| !i.within_bound() || judgement::misfit(i).is_some();
    if worst > MISSES || own.0.len() != found.identification_error.len() || !misses(&found) {
        return found;
    }
    let balanced = Identification { identification_error: own.0, residuals: own.1, ..found.clone() };
    if misses(&balanced) { found } else { balanced }
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
    let super::super::Geometry { windows, kernels, .. } = &prepared.geometry;
    let without_zeros = |(s, zeros): (&Stretch, &Vec<f64>)| s.shifted(bound, zeros);
    let stretches: Vec<Stretch> = prepared.stretches.iter().zip(zeros).map(without_zeros).collect();
    let system = System { stretches: &stretches, weak: &weak, kernels, circle: &circle };
    let rows = windows::rows_of(&system, &weak.equations, kernels, windows);
    let columns = Split::new(&bound.model, 1).tied(names, found);
    let one = |(e, coefficients): (usize, &DVector<f64>)| {
        let (rms, dots) = frequency_dots(&rows, e, coefficients, windows.frequencies);
        let residuals = Residuals { frequency_step_hz: 1.0 / windows.length_s, rms, dots };
        (identification_error(&rows, e, coefficients), residuals)
    };
    Ok(columns.iter().enumerate().map(one).unzip())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coarse_records_balance_is_that_of_the_weak_forms_own_coefficients() {
        let error = |found: f64, own: f64, worst: f64| {
            let mut result = Identification { identification_error: vec![found], ..Identification::default() };
            result.details.expected_error = vec![0.05];
            as_balanced(result, (vec![own], Vec::new()), worst).identification_error[0]
        };
        assert_eq!(error(0.13, 0.054, 1.0), 0.054);
        // Not where solutions miss more than noise, nor where both do, nor without need.
        assert_eq!(error(0.13, 0.054, 1.3), 0.13);
        assert_eq!(error(0.13, 0.12, 1.0), 0.13);
        assert_eq!(error(0.052, 0.050, 1.0), 0.052);
    }

    #[test]
    fn residuals_are_more_than_noise_where_that_is_known_well_enough() {
        // Of 421 samples the noise's square is known to 16 %, of a long record to 1 %.
        assert!(!is_more(1.27, 0.164, 256) && is_more(1.5, 0.164, 256));
        assert!(is_more(1.21, 0.01, 50_000) && !is_more(1.19, 0.01, 50_000));
        assert!(!is_more(f64::NAN, 0.0, 0));
    }
}
