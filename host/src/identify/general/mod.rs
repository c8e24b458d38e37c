//! Identification of a system that a user wrote down (a model file), by the weak form.
//!
//! The same windows, low-passes, least squares, covariance and bias of noise as for the built-in systems, over any number of coordinates
//! and inputs. Coefficients that stand in several equations are tied ([`ties`]).

pub mod balance_error;
pub mod chain;
pub mod geometry;
pub mod history;
pub mod noise;
pub mod per_record;
pub mod physical;
pub mod series;
pub mod shooting;
pub mod stretches;
pub mod ties;
pub mod track;

use core::cell::OnceCell;

use nalgebra::DVector;

use self::noise::{Remeasured, Sensors};
use self::series::System;
use self::stretches::Stretch;
use super::boots;
use super::correlation_of as correlation;
use super::few_windows;
use super::free_geometry;
use super::noise_bias::with_noise_that_fits;
use super::regression::{self, Options, Unsolvable};
use super::windows::{WindowRows, frequency_of_row, rows_of, samples_needed};
use super::{Details, Geometry, Identification, Parameter, RecordUse, Residuals, Settings, identifiability};
use crate::error::{BadInput, Result};
use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::units::{self, Unit};
use crate::model::model_file::weak_form::WeakForm;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::Bound;
use crate::signal::noise as spectral;
use crate::system::ties::Identified;
use crate::warning::Warning;

/// A record made ready for the weak form of a model file.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Unbroken stretches of steady drive.
    pub stretches: Vec<Stretch>,
    /// Record of each stretch.
    pub record_of: Vec<usize>,
    /// Noise of the sensors.
    pub sensors: Sensors,
    /// Windows and low-passes.
    pub geometry: Geometry,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

/// Stretches, noise, windows and low-passes of one or several records.
///
/// # Errors
/// As [`identify`].
pub fn prepare(records: &[Record], rig: &Rig, bound: &Bound, settings: &Settings) -> Result<Prepared> {
    let step_s = 1.0 / rig.sample_rate_hz;
    let mut warnings: Vec<Warning> = records.iter().flat_map(|r| r.warnings.clone()).collect();
    let (records, restarted) = boots::of_known_zero(records);
    let records = &*records;
    warnings.extend(restarted);
    let (mut stretches, mut record_of) = (Vec::new(), Vec::new());
    for (k, record) in records.iter().enumerate() {
        for s in stretches::of(record, rig, bound)? {
            stretches.push(s);
            record_of.push(k);
        }
    }
    if rig.drive.is_some() {
        steady(records, &mut stretches, &mut record_of, &mut warnings)?;
    }
    let shown: Vec<Vec<Vec<f64>>> = stretches.iter().map(|s| s.sensors(bound)).collect();
    let noises: Vec<Option<spectral::Noise>> =
        (0..bound.sensors.len()).map(|i| spectral::estimate(shown.iter().map(|s| &s[i][..]), step_s)).collect();
    let free = rig.drive.is_none();
    let of_sensor = |i: usize| shown.iter().map(move |s| &s[i][..]);
    let band = if free { free_geometry::band((0..bound.sensors.len()).map(of_sensor), step_s) } else { None };
    drop(shown);
    let lengths: Vec<f64> = stretches.iter().map(|s| s.len() as f64 * s.step_s).collect();
    let geometry = geometry::geometry(rig, settings, &noises, !bound.inputs.is_empty(), step_s, (band, &lengths))?;
    let needed = samples_needed(&geometry.windows, &geometry.kernels, step_s);
    let longest = stretches.iter().map(Stretch::len).max().unwrap_or(0);
    if longest < needed {
        let mut error = BadInput::new(
            format!("{longest} samples ({:.3} s) in the longest unbroken stretch", longest as f64 * step_s),
            format!(
                "at least {needed} ({:.3} s): one window of {:.3} s and the low-pass's reach on either side",
                needed as f64 * step_s,
                geometry.windows.length_s
            ),
        )
        .remedy("Record longer, or choose a shorter window with --window-s");
        if let Some(r) = records.first() {
            error = error.in_file(&r.path);
        }
        return Err(error);
    }
    let counted = |&i: &usize| Some(&rig.channel[i]).filter(|c| c.unit == "count").map(crate::rig::Channel::scale);
    let count: Vec<Option<f64>> = bound.sensors.iter().map(counted).collect();
    let error = |(n, count): (&Option<spectral::Noise>, &Option<f64>)| match count {
        Some(_) => 0.0,
        None => n.map_or(0.0, |n| n.square_error),
    };
    let sensors = Sensors {
        sigma: noises.iter().map(|n| n.map_or(0.0, |n| n.sigma)).collect(),
        square_error: noises.iter().zip(&count).map(error).collect(),
        count,
    };
    Ok(Prepared { stretches, record_of, sensors, geometry, warnings })
}

/// Cuts stretches to those over which the device's drive ran steadily.
fn steady(
    records: &[Record],
    stretches: &mut Vec<Stretch>,
    record_of: &mut Vec<usize>,
    warnings: &mut Vec<Warning>,
) -> Result<()> {
    if stretches.iter().any(|s| s.amplitude_nm.is_none()) {
        return Ok(());
    }
    let Some(target) = stretches.iter().filter_map(|s| s.amplitude_nm.as_ref()?.iter().copied().max()).max() else {
        return Ok(());
    };
    if target == 0 {
        let path = records.first().map(|r| r.path.clone()).unwrap_or_default();
        return Err(BadInput::new(
            "a record whose shaker never moved",
            "motion of the base, since the rig file has [drive]",
        )
        .in_file(path)
        .remedy("Start the shaker during the capture, or leave [drive] out of the rig file"));
    }
    let (mut kept, mut from, mut dropped) = (Vec::new(), Vec::new(), 0);
    for (s, record) in stretches.drain(..).zip(record_of.drain(..)) {
        let mut start = 0;
        for run in s.amplitude_nm.clone().unwrap_or_default().chunk_by(|a, b| a == b) {
            if run[0] == target {
                kept.push(s.part(start, start + run.len()));
                from.push(record);
            } else {
                dropped += run.len();
            }
            start += run.len();
        }
    }
    if dropped > 0 {
        warnings.push(Warning::new(
            "drive-not-steady",
            format!("{dropped} samples were taken while the shaker's amplitude was not {} µm", f64::from(target) / 1e3),
            "They were left out; start the capture when the shaker runs to use all of it",
        ));
    }
    (*stretches, *record_of) = (kept, from);
    Ok(())
}

/// Units of the coordinates and of the inputs, from those of the channels.
pub fn channel_units(model: &ModelFile, rig: &Rig, bound: &Bound) -> (Vec<Unit>, Vec<Unit>) {
    let coordinates = (0..model.coordinates.len())
        .map(|k| {
            let row = (0..bound.sensors.len()).find(|&r| bound.shown[(r, k)] != 0.0).unwrap_or(0);
            Unit::of_channel(&rig.channel[bound.sensors[row]].unit)
        })
        .collect();
    (coordinates, bound.inputs.iter().map(|&i| Unit::of_channel(&rig.channel[i].unit)).collect())
}

/// Units of a model file's coefficients; one for each term, equation by equation.
pub fn units_of(model: &ModelFile, rig: &Rig, bound: &Bound) -> Vec<Vec<String>> {
    let (coordinates, inputs) = channel_units(model, rig, bound);
    let seconds = model.prime_scale(rig.omega()) == 1.0;
    model
        .equations
        .iter()
        .map(|e| {
            e.terms.iter().map(|t| units::coefficient(&e.balance, &t.of, &coordinates, &inputs, seconds)).collect()
        })
        .collect()
}

/// Identifies the coefficients of a model file from one or several records of the same rig.
///
/// # Errors
/// Settings out of range, records shorter than one window, or a record in which a coefficient's column vanishes.
pub fn identify(records: &[Record], rig: &Rig, bound: &Bound, settings: &Settings) -> Result<Identification> {
    let model = &*bound.model;
    let Prepared { stretches, record_of, sensors, geometry: Geometry { windows, kernels }, mut warnings } =
        prepare(records, rig, bound, settings)?;
    let weak = WeakForm::new(model, rig.omega(), &[])?;
    let circle = model.circle();
    let system = System { stretches: &stretches, weak: &weak, kernels: &kernels, circle: &circle };
    let mut rows = rows_of(&system, &weak.equations, &kernels, &windows);
    let split = per_record::Split::new(model, records.len());
    split.spread(&mut rows, &record_of);
    let terms = split.terms();
    let names = split.names();
    let told = |e: Unsolvable| {
        let error = match e {
            Unsolvable::Dependent { equation, column } => {
                let at = terms[..equation].iter().sum::<usize>() + column;
                BadInput::new(
                    format!("nothing in the record that determines {}", names[at]),
                    "motion in which every term of the equations takes part and none is a sum of others",
                )
                .remedy(
                    "Does everything move, is a channel dead, is a term a combination of others? See `whirl inspect`",
                )
            }
            Unsolvable::NotFinite => BadInput::new(
                "a term that is not finite somewhere in the record",
                "expressions that exist over the whole record (log and sqrt of positive values, no division by zero)",
            )
            .remedy(format!("Correct {}, or the channels' units", model.source.path.display())),
        };
        match records.first() {
            Some(r) => error.in_file(&r.path),
            None => error,
        }
    };
    // What a model lacks varies as slowly as the motion: blocks of 4 s where windows are shorter.
    let block = if bound.inputs.is_empty() { 0 } else { (4.0 / windows.hop_s).ceil() as usize };
    let options = Options { weights: None, block };
    let mut solution = regression::solve_with(&rows, &terms, windows.frequencies, &options).map_err(told)?;
    let remeasured = OnceCell::new();
    let remeasured =
        || remeasured.get_or_init(|| Remeasured::new(&system, &windows, bound, &sensors, &split, &record_of));
    if !bound.inputs.is_empty() {
        let weights = input_weights(model, &rows, &terms, windows.frequencies, remeasured()).map_err(told)?;
        let options = Options { weights: Some(&weights), ..options };
        solution = regression::solve_with(&rows, &terms, windows.frequencies, &options).map_err(told)?;
    }
    let mut sigma = sensors.sigma.clone();
    let weights = &solution.weights;
    let bias = if bound.inputs.is_empty() {
        let counted: Vec<bool> = sensors.count.iter().map(Option::is_some).collect();
        with_noise_that_fits(&mut sigma, &counted, |sigma| {
            let sensors = Sensors { sigma: sigma.to_vec(), ..sensors.clone() };
            let whole = chain::estimate(&system, &windows, (rig, bound), &sensors, &names, &solution);
            let smoothed = || Remeasured::new(&system, &windows, bound, &sensors, &split, &record_of);
            whole.or_else(|| smoothed().bias(&terms, weights))
        })
    } else {
        // Its weights are not those of residuals, so that these do not tell how large the noise is.
        remeasured().bias(&terms, weights)
    };
    if let Some(bias) = &bias {
        bias.take_off(&mut solution);
    }
    if solution.repeating {
        warnings.push(Warning::new(
            "periodic-record",
            format!(
                "residuals repeat from window to window (correlation {:.2}): the motion or its input is periodic",
                solution.repetition
            ),
            "What the model lacks repeats with it and does not average out; standard errors were widened for that",
        ));
    }
    warnings.extend(few_windows(&solution, rows.len()));
    let all = DVector::from_iterator(names.len(), solution.coefficients.iter().flat_map(|c| c.iter().copied()));
    let units = split.units(&units_of(model, rig, bound));
    let unit_of = |name: &String| names.iter().position(|n| n == name).map_or_else(String::new, |i| units[i].clone());
    let (own, values, covariance) = ties::tie(&names, &all, &solution.covariance, &solution.metric);
    let mut parameters: Vec<Parameter> = own
        .iter()
        .enumerate()
        .map(|(i, name)| Parameter {
            name: name.clone(),
            value: values[i],
            std_error: covariance[(i, i)].max(0.0).sqrt(),
            unit: unit_of(name),
        })
        .collect();
    let groups = identifiability::groups_not_separable(&own, &values, &covariance);
    // Where a written equation shares a coefficient with another, the metric is not that of the shared ones.
    let metric = if own.len() == names.len() { &solution.metric } else { &covariance };
    let identified = Identified { names: &own, values: &values, covariance: &covariance, metric };
    let ties_misfit = physical::add(rig, model, &identified, &mut parameters, &mut warnings);
    let tied: Vec<DVector<f64>> = split.tied(&own, &values);
    let errors = balance_error::balance_errors(model, rig, &stretches, &kernels, &record_of, &split, &tied);
    let length_s = windows.length_s;
    let mut result = Identification {
        model: model.name.clone(),
        method: "weak".to_owned(),
        parameters,
        identification_error: solution.error.clone(),
        equations_used: regression::rows_used(&rows, model.equations.len(), windows.frequencies),
        equations_dropped: 0,
        groups_not_separable: groups,
        record: RecordUse::of(records),
        correlation: correlation(&covariance),
        correlation_names: own,
        details: Details {
            balance_error: errors,
            ties_misfit,
            ..Details::of(&solution, rows.len(), (&windows, &kernels), sigma, bias.as_ref())
        },
        shooting: None,
        not_by_shooting: None,
        balance: None,
        warnings,
        residuals: (0..model.equations.len())
            .map(|e| Residuals {
                frequency_step_hz: 1.0 / length_s,
                rms: solution.residual_rms[e].clone(),
                dots: regression::residual_dots(&rows, e, &solution.coefficients[e], 2000),
            })
            .collect(),
    };
    super::judgement::judge(&mut result, rig);
    Ok(result)
}

/// Weights of the equations that hold an input, see [`noise_weights`]; the others keep their own weights (empty here).
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

/// Weights 1/(N_m + c): N_m is what the sensors' noise gives at frequency m (it grows with it, as
/// ∫ ẅ q does), c what is left, spread evenly over the frequencies: an input's own noise is white there, and what the model lacks is then
/// weighed as in a plain least squares of the right-hand side (a weight by the residual itself would turn away from the frequencies at which
/// the system moves).
pub(crate) fn noise_weights(
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
mod system_tests;
#[cfg(test)]
mod tests;
