//! Identification from regression rows that the device has summed (`whirl capture --rows`), without
//! any sample.
//!
//! The rows are those of the weak form with windows of twenty drive periods and frequencies up to
//! 1.6 of the drive's; the device's weights are taken off them again, and what follows is what
//! follows for the host's own rows ([`super::regression`]): weights from the residuals, covariance
//! from leaving out blocks of windows. What needs samples is left out: the bias by the sensors'
//! noise is neither measured nor taken off. On simulated records of the chaotic rig at 4096 counts
//! it is far below the standard errors.

use std::path::Path;

use nalgebra::DVector;
use whirl_shared::regressor::weights;
use whirl_shared::waveform::exact_frequency;

use super::regression::{self, Unsolvable};
use super::units::units_of;
use super::weak_form::{few_windows, periodic};
use super::windows::{WindowRows, frequency_of_row};
use super::{Details, Identification, RecordUse, Residuals, built_in, identifiability};
use crate::capture::estimates::unfit;
use crate::error::{BadInput, Result};
use crate::record::ReadOptions;
use crate::record::regression_rows::{RowsRecord, Window, holds_rows};
use crate::rig::Rig;
use crate::system::ties::Identified;
use crate::warning::Warning;

/// Greatest relative difference of the drive's frequency from the rig file's.
const FREQUENCY_TOLERANCE: f64 = 1e-4;

/// Reads records of rows, if that is what the first path names; `None` otherwise.
///
/// # Errors
/// As [`RowsRecord::read`]; rows and samples in one identification.
pub fn read(paths: &[std::path::PathBuf], options: &ReadOptions) -> Result<Option<Vec<RowsRecord>>> {
    if !paths.first().is_some_and(|path| holds_rows(path)) {
        return Ok(None);
    }
    let one = |path: &std::path::PathBuf| {
        if holds_rows(path) {
            return RowsRecord::read(path, options);
        }
        Err(BadInput::new("no record of regression rows", "rows, as the first record has them")
            .in_file(path)
            .remedy("Identify from rows and from samples one after the other"))
    };
    paths.iter().map(one).collect::<Result<_>>().map(Some)
}

/// The window as the host's own, without the device's weights.
fn plain(window: &Window, run: usize, rate: f64) -> WindowRows {
    // Twenty, but whatever the device says.
    let turns = f64::from(window.window_ticks) * f64::from(window.phase_increment) / 4_294_967_296.0;
    let periods = turns.round().max(1.0);
    let unweighted = |row: usize| weights(frequency_of_row(row) as f64 / periods);
    let first = window.first.iter().enumerate().flat_map(|(r, row)| {
        let weight = unweighted(r)[0];
        row.map(|x| f64::from(x) / weight)
    });
    let second = window.second.iter().enumerate().flat_map(|(r, row)| {
        let weight = unweighted(r)[1];
        row.map(|x| f64::from(x) / weight)
    });
    WindowRows {
        start_s: (window.tick - i64::from(window.window_ticks) + 1) as f64 / rate,
        index: window.index,
        run,
        equations: vec![first.collect(), second.collect()],
    }
}

fn frequency_differs(path: &Path, found: f64, rig: &Rig, expected: f64) -> BadInput {
    BadInput::new(format!("a drive of {found:.4} Hz"), format!("{expected} Hz, as {} says", rig.path.display()))
        .in_file(path)
        .at("drive.frequency_hz")
        .remedy("Name the rig file of this record")
}

/// The windows of all records that belong together.
struct Windows {
    /// As the host's own, without the device's weights.
    rows: Vec<WindowRows>,
    /// Unbroken runs.
    runs: usize,
    /// Frequencies of each.
    frequencies: usize,
    /// Length of each, s.
    length_s: f64,
}

impl Windows {
    /// Gathers them, those of another amplitude of the drive left out.
    ///
    /// # Errors
    /// Another rate, drive or shape of windows; fewer than two.
    fn gather(records: &[RowsRecord], rig: &Rig, warnings: &mut Vec<Warning>) -> Result<Self> {
        let amplitude = records.iter().flat_map(|r| &r.windows).map(|w| w.amplitude_nm).max().unwrap_or(0);
        let expected = rig.drive.map_or(0.0, |d| d.frequency_hz);
        let (mut rows, mut runs, mut dropped) = (Vec::new(), 0, 0_usize);
        let mut shape = None;
        for record in records {
            let rate = rate_of(record, rig)?;
            let mut last_run = None;
            for window in &record.windows {
                let found = exact_frequency(window.phase_increment, (rate * 1e3).round() as u32);
                if (found / expected - 1.0).abs() > FREQUENCY_TOLERANCE {
                    return Err(frequency_differs(&record.path, found, rig, expected));
                }
                let this = (window.first.len(), window.window_ticks);
                if *shape.get_or_insert(this) != this {
                    return Err(BadInput::new(
                        format!("windows of {} rows over {} ticks", this.0, this.1),
                        "windows like those before",
                    )
                    .in_file(&record.path)
                    .remedy("Identify from records of one drive and one firmware"));
                }
                if window.amplitude_nm != amplitude {
                    dropped += 1;
                    continue;
                }
                runs += usize::from(last_run.replace(window.run) != Some(window.run));
                rows.push(plain(window, runs, rate));
            }
        }
        let Some((count, ticks)) = shape.filter(|_| rows.len() >= 2) else {
            let mut error =
                BadInput::new(format!("{} windows of rows", rows.len()), "at least 2").remedy("Capture for longer");
            if let Some(r) = records.first() {
                error = error.in_file(&r.path);
            }
            return Err(error);
        };
        if dropped > 0 {
            warnings.push(Warning::new(
                "drive-not-steady",
                format!("{dropped} windows were taken at another amplitude than {} µm", f64::from(amplitude) / 1e3),
                "They were left out; capture with one amplitude to use all of them",
            ));
        }
        Ok(Self { rows, runs, frequencies: count / 2, length_s: f64::from(ticks) / rig.sample_rate_hz })
    }
}

/// Sampling rate of a record, which must be the rig's.
fn rate_of(record: &RowsRecord, rig: &Rig) -> Result<f64> {
    let rate = record.header.metadata.sample_rate_hz;
    if rate > 0.0 && (rate / rig.sample_rate_hz - 1.0).abs() < FREQUENCY_TOLERANCE {
        return Ok(rate);
    }
    Err(BadInput::new(format!("{rate} Hz"), format!("sample_rate_hz = {}", rig.sample_rate_hz))
        .in_file(&record.path)
        .at("metadata.sample_rate_hz"))
}

/// Identifies the double pendulum from records of rows.
///
/// # Errors
/// A rig that is not what the device identifies, another drive, too few windows, a record in which
/// a coefficient's column vanishes.
pub fn identify(records: &[RowsRecord], rig: &Rig) -> Result<Identification> {
    if let Some(error) = unfit(rig) {
        return Err(error
            .remedy("Rows are of a double pendulum on a vertical drive with the default dampings: capture samples"));
    }
    let mut warnings: Vec<Warning> = records.iter().flat_map(|r| r.warnings.clone()).collect();
    let Windows { rows, runs, frequencies, length_s } = Windows::gather(records, rig, &mut warnings)?;
    let own = built_in::written(rig)?;
    let bound = built_in::bound(&own)?;
    let model = &*bound.model;
    let terms: Vec<usize> = model.equations.iter().map(|e| e.terms.len()).collect();
    let solution = regression::solve(&rows, &terms, frequencies).map_err(|e| match e {
        Unsolvable::Dependent { equation, column } => BadInput::new(
            format!("nothing in the rows that determines {}", model.equations[equation].terms[column].name),
            "motion in which every term of the equations takes part",
        )
        .remedy("Is a coordinate at rest, does the drive run?"),
        Unsolvable::NotFinite => BadInput::new("a value too large to compute with", "rows of a rig that moves"),
    })?;
    if solution.repeating {
        warnings.push(periodic(solution.repetition, "window", rig, bound));
    }
    warnings.extend(few_windows(&solution, rows.len()));
    let names: Vec<String> = model.equations.iter().flat_map(|e| e.terms.iter().map(|t| t.name.clone())).collect();
    let units: Vec<String> = units_of(model, &own, bound).into_iter().flatten().collect();
    let values = DVector::from_iterator(names.len(), solution.coefficients.iter().flat_map(|c| c.iter().copied()));
    let covariance = &solution.covariance;
    let identified = Identified { names: &names, values: &values, covariance, metric: &solution.metric };
    let (parameters, ties_misfit) = built_in::parameters(rig, &identified, &units, &mut warnings);
    let mut result = Identification {
        model: model.name.clone(),
        method: "weak".to_owned(),
        parameters,
        identification_error: solution.error.clone(),
        equations_used: regression::rows_used(&rows, model.equations.len(), frequencies),
        groups_not_separable: identifiability::groups_not_separable(&names, &values, covariance),
        record: RecordUse {
            // Under the windows: at most some 10⁸.
            samples: records.iter().map(|r| r.footer.losses.received as usize).sum(),
            lost: records.iter().map(|r| r.footer.losses.lost()).sum(),
            segments: runs,
        },
        correlation: identifiability::correlation(covariance),
        correlation_names: names,
        details: Details {
            window_s: length_s,
            windows: rows.len(),
            max_frequency_hz: frequencies as f64 / length_s,
            condition: solution.condition.clone(),
            repetition: solution.repetition,
            jackknife_blocks: solution.blocks,
            ties_misfit,
            ..Details::default()
        },
        warnings,
        residuals: (0..model.equations.len())
            .map(|e| Residuals {
                frequency_step_hz: 1.0 / length_s,
                rms: solution.residual_rms[e].clone(),
                dots: regression::residual_dots(&rows, e, &solution.coefficients[e]),
            })
            .collect(),
        ..Identification::default()
    };
    super::judgement::judge(&mut result, rig);
    Ok(result)
}
