//! What a record would tell: standard errors of a model's parameters and effects on it, and how far its effects could be told from others.
//!
//! The record is one that the model itself made ([`crate::plan::trial`]). It goes the way of every record: sensors' noise, windows, shooting from the smoothed record
//! on, and the covariance of a jackknife over windows. An effect with strengths a and covariance S, fitted with a rival beside it, stands √(aᵀ S⁻¹ a) standard errors
//! from zero: so much better than its best-fitting rival it explains the record (the square is the rise of the weighted sum of squares without it: T-optimality, Atkinson and
//! Fedorov 1975).

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::candidates::Candidate;
use super::setting::{Begun, Setting};
use super::state::State;
use super::{given, settled, shooting, start, tell};
use crate::error::{BadInput, Result};
use crate::explain::MOST_WINDOWS;
use crate::explain::explanation::Explanation;
use crate::identify::{Parameter, Settings as IdentifySettings};
use crate::model::identified::{AddedEffect, IdentifiedModel, RECORD_S};
use crate::record::Record;
use crate::rig::Rig;

/// How clearly an effect of the model would show.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Separation {
    /// The effect, `ID@PLACE`.
    pub effect: String,
    /// What it is told from; none: from nothing missing.
    pub from: Option<String>,
    /// Standard errors between them.
    pub deviations: f64,
}

/// What a record would tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    /// Parameters of the model with their standard errors.
    pub parameters: Vec<Parameter>,
    /// Every effect of the model from nothing and from each rival.
    pub separations: Vec<Separation>,
    /// Windows, and the length of one, s.
    pub windows: (usize, f64),
}

/// √(aᵀ S⁻¹ a).
fn deviations(a: &DVector<f64>, covariance: &DMatrix<f64>) -> Option<f64> {
    let solved = covariance.clone().cholesky()?.solve(a);
    Some(a.dot(&solved).max(0.0).sqrt())
}

/// Strengths of what was chosen behind the dampings, with their columns.
fn effects(setting: &Setting<'_>, state: &State) -> Vec<(String, core::ops::Range<usize>, DVector<f64>)> {
    let mut at = state.values.len();
    let mut out = Vec::new();
    for (k, chosen) in state.chosen.iter().enumerate() {
        let own = at..at + chosen.strengths.len();
        at = own.end;
        if k >= state.dampings {
            // What refines a form is no strength.
            let leading = chosen.candidate.entry.strengths.len().min(own.len());
            let values = DVector::from_column_slice(&chosen.strengths[..leading]);
            out.push((chosen.candidate.name(setting), own.start..own.start + leading, values));
        }
    }
    out
}

/// What a record would tell of a model that made it, and how far its effects stand from `rivals`; none where it is not followed.
///
/// # Errors
/// A record that cannot be identified, a model of another rig.
pub fn expected(record: Record, rig: &Rig, model: &IdentifiedModel, rivals: &[String]) -> Result<Option<Expected>> {
    let Some(whole) = rig.bound.as_deref() else { return Ok(None) };
    let records = [record];
    let begun = Setting::begin(&records, rig, whole, (MOST_WINDOWS, &IdentifySettings::default()))?;
    let Some(Begun { mut setting, first, physical, .. }) = begun else { return Ok(None) };
    let Some(mut state) = start(&setting, &first, physical) else { return Ok(None) };
    given::take(&setting, &mut state, model)?;
    if !settled(&mut setting, &mut state) || !setting.shooting {
        return Ok(None);
    }
    let all = setting.candidates(&state.physical, &[]);
    let own = state.own_columns();
    let effects = effects(&setting, &state);
    let wanted: Vec<&Candidate> = all.iter().filter(|c| rivals.contains(&c.name(&setting))).collect();
    let mut separations = Vec::new();
    let Some(blocks) = shooting::evidence(&setting, &state, (&wanted, false), &[]) else { return Ok(None) };
    let columns: Vec<usize> = (0..own).collect();
    let Some(fit) = blocks.fit(&columns) else { return Ok(None) };
    for (name, range, values) in &effects {
        let part = |covariance: &DMatrix<f64>| {
            covariance.view((range.start, range.start), (range.len(), range.len())).into_owned()
        };
        let alone = deviations(values, &part(&fit.covariance)).unwrap_or(0.0);
        separations.push(Separation { effect: name.clone(), from: None, deviations: alone });
        let mut at = own;
        for c in &wanted {
            let behind = at..at + c.strengths();
            at = behind.end;
            let rival = c.name(&setting);
            // What the model has is fitted beside it anyway.
            if effects.iter().any(|e| e.0 == rival) {
                continue;
            }
            // What cannot be fitted beside it is not told from it.
            let both: Vec<usize> = columns.iter().copied().chain(behind).collect();
            let apart = blocks.fit(&both).and_then(|f| deviations(values, &part(&f.covariance))).unwrap_or(0.0);
            let same = separations.iter_mut().find(|s| s.effect == *name && s.from.as_deref() == Some(&rival));
            match same {
                // Of several forms the one that is hardest to tell.
                Some(s) => s.deviations = s.deviations.min(apart),
                None => separations.push(Separation { effect: name.clone(), from: Some(rival), deviations: apart }),
            }
        }
    }
    let windows = state.followed.as_ref().map_or((0, 0.0), |f| f.windows(&setting));
    let mut told = Explanation::new(1.0, Vec::new());
    tell::parameters(&setting, &state, (&fit.all, &fit.covariance), &first, &mut told);
    Ok(Some(Expected { parameters: told.parameters, separations, windows }))
}

/// A model with an effect of a given size in it, in the effect's first form; `record` is one that the model without it made.
///
/// # Errors
/// As [`expected`]; an effect that the rig cannot have, or whose size is no strength.
pub fn with_effect(
    record: Record,
    rig: &Rig,
    model: &IdentifiedModel,
    (name, size): (&str, f64),
) -> Result<Option<IdentifiedModel>> {
    let Some(whole) = rig.bound.as_deref() else { return Ok(None) };
    let records = [record];
    let begun = Setting::begin(&records, rig, whole, (MOST_WINDOWS, &IdentifySettings::default()))?;
    let Some(Begun { setting, first, physical, .. }) = begun else { return Ok(None) };
    let Some(mut state) = start(&setting, &first, physical) else { return Ok(None) };
    given::take(&setting, &mut state, model)?;
    let all = setting.candidates(&state.physical, &[]);
    let Some(candidate) = all.iter().find(|c| c.name(&setting) == name) else {
        return Err(BadInput::new(format!("\"{name}\""), "an effect of `whirl list effects` that this rig can have")
            .at("--tell"));
    };
    let candidate = candidate.clone().refined(&setting, &state.physical);
    let mut strengths = vec![0.0; candidate.strengths()];
    let nothing = DMatrix::zeros(strengths.len(), strengths.len());
    let mut of = |strength: f64| {
        strengths[0] = strength;
        tell::value(&setting, &state.physical, &candidate, &strengths, &nothing)
    };
    let ((one, unit), (two, _)) = (of(1.0), of(2.0));
    let is_a_strength = one.value.is_normal() && (two.value / one.value - 2.0).abs() < 1e-9;
    if !is_a_strength {
        return Err(BadInput::new(format!("{name}={size}"), "an effect whose size is a strength")
            .at("--tell")
            .remedy("Give a model that has it, by `whirl explain -o`, and its name alone"));
    }
    strengths.truncate(candidate.entry.strengths.len());
    strengths[0] = size / one.value;
    let (id, at) = name.split_once('@').unwrap_or((name, ""));
    let mut out = model.clone();
    if let (Some(file), false) = (setting.file(), setting.is_written()) {
        out.found_with.extend(file.parameters.iter().zip(&state.physical.values).map(|(p, v)| (p.name.clone(), *v)));
    }
    out.found_with.insert(RECORD_S.to_owned(), setting.span.length_s);
    out.effects.push(AddedEffect {
        id: id.to_owned(),
        at: at.to_owned(),
        value: size,
        std_error: 0.0,
        unit,
        strengths,
        parameters: one.parameters,
    });
    Ok(Some(out))
}
