//! A joint that stands still although its friction could not hold it: its sensor has died.
//!
//! Where a joint is held by dry friction the equations ask of it for whatever torque keeps it
//! there, up to what the friction can give. With the joint at rest a row of the weak form, without
//! the terms of dry friction, is what they ask for, ∫ τ w cos mΩt, at most C ∫ w of friction's level
//! C. It is compared with `HOLDS` C ∫ w and what the fit leaves at that frequency; a standstill at
//! half of the windows of which it is more is no joint's.
//!
//! Terms of dry friction are known by what they do: with the sensor's angle replaced by steady
//! ramps of speeds v, 2v and −v they are the same for v and 2v, and the opposite for −v. ∫ w is
//! theirs then.
//!
//! Limits: sensors that count, whose joint has dry friction in the equations; a joint that is held
//! by hand looks like one whose sensor died.

use nalgebra::DVector;

use super::built_in;
use super::per_record::Split;
use super::prepared::{Prepared, prepare_moving};
use super::regression;
use super::series::System;
use super::standstill::{self, Still};
use super::stretches::{Stretch, mixed};
use super::windows::{WindowRows, frequency_of_row, rows_of};
use crate::error::Result;
use crate::identify::Settings;
use crate::model::model_file::weak_form::WeakForm;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::warning::Warning;
use crate::wording::format::in_seconds;

/// Greatest friction at rest over that of sliding: dry contacts have up to about twice.
const HOLDS: f64 = 2.0;
/// Residuals of the fit, and standard errors of friction's level, beyond which nothing is chance.
const SURE: f64 = 6.0;
/// Speed of a ramp, rad/s: any.
const SPEED: f64 = 1.0;
/// Relative difference of what dry friction does on two ramps: what the low-pass leaves.
const SAME: f64 = 1e-6;

/// What is to be said of the standstills of records: `standstill` of joints that may be held,
/// `channel-stopped` of those that cannot; nothing where nothing can be identified.
pub fn standing(records: &[Record], rig: &Rig) -> Vec<Warning> {
    judged(records, rig).unwrap_or_default()
}

/// Puts the same in the place of what was said of standstills.
pub fn tell_in(warnings: &mut Vec<Warning>, records: &[Record], rig: &Rig) {
    let Some(at) = warnings.iter().position(|w| w.id == standstill::ID) else { return };
    let Ok(told) = judged(records, rig) else { return };
    warnings.retain(|w| w.id != standstill::ID && !told.contains(w));
    let at = at.min(warnings.len());
    warnings.splice(at..at, told);
}

fn judged(records: &[Record], rig: &Rig) -> Result<Vec<Warning>> {
    let own = built_in::written(rig)?;
    let bound = built_in::bound(&own)?;
    let prepared = prepare_moving(records, &own, bound, &Settings::default())?;
    if prepared.still.is_empty() {
        return Ok(Vec::new());
    }
    let ratios = ratios(records, &own, bound, &prepared)?;
    let (mut held, mut told) = (Vec::new(), Vec::new());
    for (still, ratio) in prepared.still.iter().zip(ratios) {
        match ratio {
            Some(ratio) => told.push(warning(still, ratio, records, bound)),
            None => held.push(still.clone()),
        }
    }
    told.extend(standstill::told(&held, records, bound));
    Ok(told)
}

fn warning(still: &Still, ratio: f64, records: &[Record], bound: &ObservedModel) -> Warning {
    let (place, name) = standstill::place(still, records, bound);
    let n = still.stretch.len();
    let w = Warning::new(
        "channel-stopped",
        format!(
            "{name} stands still from {place} on for {} although the motion asks for {ratio:.1} times the torque with which its friction holds: its sensor has died",
            in_seconds(still.length_s())
        ),
        format!("These {n} rows are left out as a gap; look at the sensor's cable and supply"),
    );
    let w = w.with("channel", name).with("time_s", still.stretch.start_s).with("value", ratio).with("left_out", n);
    match standstill::row(still, records) {
        Some(row) => w.with("row", row),
        None => w,
    }
}

/// For each standstill by how much, in the middle of its windows, what the equations ask for exceeds
/// what friction holds; none where it does not.
fn ratios(records: &[Record], own: &Rig, bound: &ObservedModel, prepared: &Prepared) -> Result<Vec<Option<f64>>> {
    let weak = WeakForm::new(&bound.model, own.omega(), &[])?;
    let split = Split::new(&bound.model, records.len());
    let circle = bound.model.circle();
    let (kernels, windows) = (&prepared.geometry.kernels, &prepared.geometry.windows);
    let rows = |stretches: &[Stretch], record_of: &[usize]| {
        let mut rows =
            rows_of(&System { stretches, weak: &weak, kernels, circle: &circle }, &weak.equations, kernels, windows);
        split.spread(&mut rows, record_of);
        rows
    };
    let moving = rows(&prepared.stretches, &prepared.record_of);
    let Ok(fit) = regression::solve(&moving, &split.terms(), windows.frequencies) else {
        return Ok(vec![None; prepared.still.len()]);
    };
    let errors: Vec<f64> = fit.covariance.diagonal().iter().map(|v| v.max(0.0).sqrt()).collect();
    let one = |still: &Still| {
        let of = |speed: f64| rows(&[ramp(still, bound, speed)], &[still.record]);
        let at_rest = rows(std::slice::from_ref(&still.stretch), &[still.record]);
        let ramps = [of(SPEED), of(2.0 * SPEED), of(-SPEED)];
        let mut first = 0;
        let mut most: Option<f64> = None;
        for (e, x) in fit.coefficients.iter().enumerate() {
            let friction = dry(&ramps, e, x.len());
            let known = &errors[first..first + x.len()];
            first += x.len();
            let level: f64 = friction.iter().map(|&(c, area)| (x[c].abs() + SURE * known[c]) * area).sum();
            if level > 0.0 {
                let mut asked: Vec<f64> =
                    at_rest.iter().map(|w| demand(w, e, x, &friction, &fit.residual_rms[e], level)).collect();
                asked.sort_by(f64::total_cmp);
                // At least half of the windows exceed it.
                let middle = asked.get(asked.len().saturating_sub(1) / 2).copied();
                most = most.into_iter().chain(middle.filter(|r| *r > HOLDS)).reduce(f64::max);
            }
        }
        most
    };
    Ok(prepared.still.iter().map(one).collect())
}

/// What an equation asks of a joint at rest over a window, in levels of its friction, less what the
/// fit leaves.
fn demand(window: &WindowRows, e: usize, x: &DVector<f64>, friction: &[(usize, f64)], left: &[f64], level: f64) -> f64 {
    let p = x.len();
    let of = |(r, row): (usize, &[f64])| {
        let rest: f64 = (0..p).filter(|c| friction.iter().all(|f| f.0 != *c)).map(|c| row[c] * x[c]).sum();
        ((row[p] - rest).abs() - SURE * left[frequency_of_row(r)]) / level
    };
    window.equations[e].chunks_exact(p + 1).enumerate().map(of).fold(0.0, f64::max)
}

/// The columns of an equation that are dry friction of a ramp's joint, and ∫ w.
fn dry(ramps: &[Vec<WindowRows>; 3], e: usize, p: usize) -> Vec<(usize, f64)> {
    let [slow, fast, back] = ramps;
    let one = |c: usize| {
        let of = |rows: &[WindowRows]| -> Vec<f64> {
            rows.iter().flat_map(|w| w.equations[e].chunks_exact(p + 1).map(move |row| row[c])).collect()
        };
        let (slow, fast, back) = (of(slow), of(fast), of(back));
        let area = slow.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let same = |(s, (f, b)): (&f64, (&f64, &f64))| (s - f).abs().max((s + b).abs()) <= SAME * area;
        (area > 0.0 && slow.iter().zip(fast.iter().zip(&back)).all(same)).then_some((c, area))
    };
    (0..p).filter_map(one).collect()
}

/// A standstill with its sensor's angle replaced by a steady ramp.
fn ramp(still: &Still, bound: &ObservedModel, speed: f64) -> Stretch {
    let stretch = &still.stretch;
    let mut shown = stretch.sensors(bound);
    let x = &mut shown[still.sensor];
    let first = x.first().copied().unwrap_or(0.0);
    x.iter_mut().enumerate().for_each(|(i, x)| *x = first + speed * i as f64 * stretch.step_s);
    Stretch { coordinates: mixed(&bound.coordinates, &shown), ..stretch.clone() }
}
