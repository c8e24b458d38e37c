//! The weak form of any system: rows over windows, least squares per equation, the noise's bias
//! taken off, coefficients that stand in several equations tied.
//!
//! The equations are those of a system file or of written terms; those of the built-in systems are
//! written out for it ([`super::built_in`]).

use core::cell::OnceCell;

use nalgebra::DVector;

use super::built_in::WrittenRig;
use super::noise_bias::{Bias, with_noise_that_fits};
use super::prepared::{Geometry, Prepared, prepare_moving};
use super::regression::{self, Options, Solution, Unsolvable};
use super::remeasured::{Remeasured, Sensors};
use super::result::{Details, Identification, RecordUse, Residuals};
use super::series::System;
use super::windows::{WindowRows, frequency_of_row, rows_of};
use super::{
    Settings, balance_error, built_in, chain_bias, identifiability, input_noise, judgement, per_record, ties, units,
};
use crate::error::{BadInput, Result};
use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::weak_form::WeakForm;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::system::ties::Identified;
use crate::warning::Warning;

/// Identifies the coefficients of a system from one or several records of the same rig.
///
/// # Errors
/// A model that there is not, missing channels, settings out of range, records shorter than one
/// window, or a record in which a coefficient's column vanishes (an arm at rest).
pub fn weak_form(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Identification> {
    let own = built_in::written(rig)?;
    let bound = built_in::bound(&own)?;
    let prepared = prepare_moving(records, &own, bound, settings)?;
    let written = WrittenRig { rig, own: &own, bound };
    let fitted = Fitted::of(records, written, &prepared)?;
    let mut result = fitted.identification(records, written, &prepared)?;
    judgement::judge(&mut result, rig);
    Ok(result)
}

/// Identification error below which a record may be exact: ten times what the low-pass's ripple,
/// 120 dB down, leaves of one.
const EXACT: f64 = 1e-5;

/// Rows of a record with their solution.
struct Fitted {
    rows: Vec<WindowRows>,
    split: per_record::Split,
    solution: Solution,
    /// Before the bias was taken off: residuals are these coefficients'.
    plain: Vec<DVector<f64>>,
    bias: Option<Bias>,
    /// Noise of each sensor, as it was taken.
    sigma: Vec<f64>,
    /// Weighted rms of the residuals.
    left: f64,
}

impl Fitted {
    fn of(records: &[Record], written: WrittenRig<'_>, prepared: &Prepared) -> Result<Self> {
        let WrittenRig { rig, own, bound } = written;
        let model = &*bound.model;
        let Prepared { stretches, record_of, sensors, geometry: Geometry { windows, kernels, .. }, .. } = prepared;
        let circle = model.circle();
        let split = per_record::Split::new(model, records.len());
        let (terms, names) = (split.terms(), split.names());
        let error = |e: Unsolvable| unsolvable(e, &terms, &names, model, records);
        // What a model lacks varies as slowly as the motion: blocks of 4 s where windows are
        // shorter.
        let block = if bound.inputs.is_empty() { 0 } else { (4.0 / windows.hop_s).ceil() as usize };
        let options = Options { weights: None, block };
        let fit = |weak: &WeakForm| {
            let system = System { stretches, weak, kernels, circle: &circle };
            let mut rows = rows_of(&system, &weak.equations, kernels, windows);
            split.spread(&mut rows, record_of);
            regression::solve_with(&rows, &terms, windows.frequencies, &options).map(|solution| (rows, solution))
        };
        let mut weak = WeakForm::new(model, own.omega(), &[])?;
        let (mut rows, mut solution) = fit(&weak).map_err(error)?;
        if solution.error.iter().all(|e| *e < EXACT) {
            let plain = WeakForm::unsmoothed(model, own.omega())?;
            if let Ok(found) = fit(&plain)
                && found.1.error.iter().zip(&solution.error).all(|(a, b)| a < b)
            {
                (weak, (rows, solution)) = (plain, found);
            }
        }
        let system = System { stretches, weak: &weak, kernels, circle: &circle };
        let remeasured = OnceCell::new();
        let remeasured =
            || remeasured.get_or_init(|| Remeasured::new(&system, windows, bound, sensors, &split, record_of));
        if !bound.inputs.is_empty() {
            let weights = input_weights(model, &rows, &terms, windows.frequencies, remeasured()).map_err(error)?;
            let options = Options { weights: Some(&weights), ..options };
            solution = regression::solve_with(&rows, &terms, windows.frequencies, &options).map_err(error)?;
        }
        let mut sigma = sensors.sigma.clone();
        let weights = &solution.weights;
        // Where the equations cannot be integrated, the smoothed record takes the place of their
        // motion.
        let motion = built_in::equations_of_motion(rig, own, bound).ok();
        let whole = |sensors: &Sensors| {
            let (motion, coefficients) = motion.as_ref()?;
            let solved = chain_bias::Solved { motion: &**motion, coefficients, columns: &names, solution: &solution };
            chain_bias::estimate(&system, windows, own, bound, sensors, &solved)
        };
        let plain = solution.coefficients.clone();
        let all = DVector::from_iterator(terms.iter().sum(), plain.iter().flat_map(|c| c.iter().copied()));
        let left = regression::weighted_rms(&rows, &terms, weights, &all);
        let counted: Vec<bool> = sensors.count.iter().map(Option::is_some).collect();
        let bias = with_noise_that_fits(&mut sigma, &counted, left, |sigma| {
            let as_read = sigma == sensors.sigma;
            let sensors = Sensors { sigma: sigma.to_vec(), ..sensors.clone() };
            let smoothed = || match as_read {
                true => remeasured().bias(&terms, weights),
                false => Remeasured::new(&system, windows, bound, &sensors, &split, record_of).bias(&terms, weights),
            };
            let whole = whole(&sensors);
            if bound.inputs.is_empty() {
                return whole.or_else(smoothed);
            }
            let own = smoothed()?;
            Some(match whole {
                Some(Bias { residual, noise, by_chance, error, .. }) => {
                    Bias { residual, noise, by_chance, error, ..own }
                }
                None => own,
            })
        });
        if let Some(bias) = &bias {
            bias.take_off(&mut solution);
        }
        Ok(Self { rows, split, solution, plain, bias, sigma, left })
    }

    /// The result in the terms of `rig`, of which `own` has the equations.
    fn identification(
        self,
        records: &[Record],
        written: WrittenRig<'_>,
        prepared: &Prepared,
    ) -> Result<Identification> {
        let WrittenRig { rig, own, bound } = written;
        let Self { rows, split, solution, plain, bias, sigma, left } = self;
        let model = &*bound.model;
        let Geometry { windows, kernels, .. } = &prepared.geometry;
        let mut warnings = prepared.warnings.clone();
        if solution.repeating {
            warnings.push(periodic(solution.repetition, "window", rig, bound));
        }
        warnings.extend(few_windows(&solution, rows.len()));
        let names = split.names();
        let all = DVector::from_iterator(names.len(), solution.coefficients.iter().flat_map(|c| c.iter().copied()));
        let units = split.units(&units::units_of(model, own, bound));
        let (shared, values, covariance) = ties::tie(&names, &all, &solution.covariance, &solution.metric);
        let unit_of =
            |name: &String| names.iter().position(|n| n == name).map_or_else(String::new, |i| units[i].clone());
        let units: Vec<String> = shared.iter().map(unit_of).collect();
        // Where an equation shares a coefficient with another, the metric is not that of the shared
        // ones.
        let metric = if shared.len() == names.len() { &solution.metric } else { &covariance };
        let identified = Identified { names: &shared, values: &values, covariance: &covariance, metric };
        let (parameters, ties_misfit) = built_in::parameters(rig, &identified, &units, &mut warnings);
        let balance_error = if rig.bound.is_some() {
            let tied = split.tied(&shared, &values);
            balance_error::balance_errors(model, own, &prepared.stretches, kernels, &prepared.record_of, &split, &tied)
        } else {
            Vec::new()
        };
        let residuals = |e: usize| Residuals {
            frequency_step_hz: 1.0 / windows.length_s,
            rms: solution.residual_rms[e].clone(),
            dots: regression::residual_dots(&rows, e, &plain[e]),
        };
        Ok(Identification {
            model: model.name.clone(),
            method: "weak".to_owned(),
            parameters,
            identification_error: solution.error.clone(),
            equations_used: regression::rows_used(&rows, model.equations.len(), windows.frequencies),
            equations_dropped: 0,
            groups_not_separable: identifiability::groups_not_separable(&shared, &values, &covariance),
            record: RecordUse::of(records),
            correlation: identifiability::correlation(&covariance),
            correlation_names: shared,
            details: Details {
                balance_error,
                hidden_noise: input_noise::hidden(model, &prepared.sensors.inputs),
                ties_misfit,
                ..Details::of(&solution, rows.len(), &prepared.geometry, sigma, bias.as_ref().map(|b| (b, left)))
            },
            warnings,
            residuals: (0..model.equations.len()).map(residuals).collect(),
            ..Identification::default()
        })
    }
}

/// An equation that cannot be solved, in words.
fn unsolvable(e: Unsolvable, terms: &[usize], names: &[String], model: &ModelFile, records: &[Record]) -> BadInput {
    let error = match e {
        Unsolvable::Dependent { equation, column } => {
            let at = terms[..equation].iter().sum::<usize>() + column;
            BadInput::new(
                format!("nothing in the record that determines {}", names[at]),
                "motion in which every term of the equations takes part and none is a sum of others",
            )
            .remedy(
                "Is a coordinate at rest, is a channel dead or named twice, does the drive run, is a term a combination of others? See `whirl inspect`",
            )
        }
        Unsolvable::NotFinite => BadInput::new(
            "a value too large to compute with, or a term that is not finite somewhere in the record",
            "channels in the unit that the rig file names, and expressions that exist over the whole record (log and sqrt of positive values, no division by zero)",
        )
        .remedy(format!("Correct the channels' units, or the terms of {}", model.source.path.display())),
    };
    match records.first() {
        Some(r) => error.in_file(&r.path),
        None => error,
    }
}

/// The warning where residuals repeat from one part of the record to the next.
pub(super) fn periodic(repetition: f64, part: &str, rig: &Rig, bound: &ObservedModel) -> Warning {
    let (why, remedy) = match (bound.inputs.is_empty(), rig.drive.is_some()) {
        (true, true) => (
            "the motion is locked to the drive or periodic",
            "Change the drive's amplitude or frequency until the motion repeats no more, or resolve it more finely",
        ),
        (true, false) => (
            "the motion is periodic",
            "Record a motion that dies away more, or one let go elsewhere, or resolve it more finely",
        ),
        (false, _) => (
            "the motion or its input is periodic",
            "Change the input until the motion repeats no more, or resolve it more finely",
        ),
    };
    Warning::new(
        "periodic-record",
        format!("residuals repeat from {part} to {part} (correlation {repetition:.2}): {why}"),
        format!(
            "Quantisation errors, and what the model lacks, repeat with it and do not average out; standard errors were widened for that. {remedy}"
        ),
    )
}

/// The warning where windows are too few for a jackknife.
pub(super) fn few_windows(solution: &Solution, windows: usize) -> Option<Warning> {
    (solution.blocks == 0).then(|| {
        Warning::new(
            "few-windows",
            match windows {
                1 => "one window is too few to measure how residuals scatter".to_owned(),
                n => format!("{n} windows are too few to measure how residuals scatter"),
            },
            "Standard errors assume white sensor noise; record longer",
        )
    })
}

/// Weights of the equations that hold an input, see [`noise_weights`]; the others keep their own
/// weights (empty here).
fn input_weights(
    model: &ModelFile,
    rows: &[WindowRows],
    terms: &[usize],
    frequencies: usize,
    remeasured: &Remeasured,
) -> std::result::Result<Vec<Vec<f64>>, Unsolvable> {
    let mut weights = noise_weights(rows, terms, frequencies, remeasured)?;
    for (w, e) in weights.iter_mut().zip(&model.equations) {
        let mut all = std::iter::once(&e.balance).chain(e.terms.iter().map(|t| &t.of));
        if !all.any(|n| n.any(&|s| matches!(s, Symbol::Input(_)))) {
            w.clear();
        }
    }
    Ok(weights)
}

/// Weights 1/(N_m + c): N_m is what the sensors' noise gives at frequency m (it grows with it, as ∫
/// ẅ q does), c what is left, spread evenly over the frequencies: an input's own noise is white
/// there, and what the model lacks is then weighed as in a plain least squares of the right-hand
/// side (a weight by the residual itself would turn away from the frequencies at which the system
/// moves).
fn noise_weights(
    rows: &[WindowRows],
    terms: &[usize],
    frequencies: usize,
    remeasured: &Remeasured,
) -> std::result::Result<Vec<Vec<f64>>, Unsolvable> {
    let mut weights: Vec<Vec<f64>> = (0..terms.len())
        .map(|e| {
            let share = remeasured.share(e, terms[e], frequencies);
            let least = share.iter().copied().filter(|x| *x > 0.0).fold(f64::INFINITY, f64::min);
            // Rows whose noise is below a hundredth of the signal count alike.
            let level = if least.is_finite() { least.max(1e-4) } else { 1.0 };
            share.iter().map(|x| 1.0 / (x + level)).collect()
        })
        .collect();
    for _ in 0..2 {
        let solved = regression::solve_weighted(rows.iter(), terms, &weights)?;
        for (e, x) in solved.iter().enumerate() {
            let noise = remeasured.power(e, x, frequencies);
            let (mut left, mut count) = (0.0, 0.0);
            for window in rows {
                for (r, row) in window.equations[e].chunks_exact(x.len() + 1).enumerate() {
                    let predicted: f64 = row.iter().zip(x.iter()).map(|(a, b)| a * b).sum();
                    left += (row[x.len()] - predicted).powi(2) - noise[frequency_of_row(r)];
                    count += 1.0;
                }
            }
            let greatest = noise.iter().fold(0.0_f64, |m, v| m.max(*v));
            let level = (left / f64::max(count, 1.0)).max(1e-6 * greatest).max(f64::MIN_POSITIVE);
            weights[e] = noise.iter().map(|n| 1.0 / (n + level)).collect();
        }
    }
    Ok(weights)
}

#[cfg(test)]
#[path = "weak_form_tests.rs"]
mod tests;
