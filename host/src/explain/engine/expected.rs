//! What a record would tell: standard errors of a model's parameters and effects on it, and how far
//! its effects could be told from others.
//!
//! The record is one that the model itself made ([`crate::plan`]). It goes the way of every record:
//! sensors' noise, windows, shooting from the smoothed record on, and the covariance of a jackknife
//! over windows. An effect with strengths a and covariance S, fitted with a rival beside it, stands
//! √(aᵀ S⁻¹ a) standard errors from zero: so much better than its best-fitting rival it explains
//! the record (the square is the rise of the weighted sum of squares without it: T-optimality,
//! Atkinson and Fedorov 1975).

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;

use super::candidates::Candidate;
use super::evidence::{self, Evidence, Outcome};
use super::setting::{Begun, Lines, Setting};
pub use super::shooting::MOST_SAMPLES;
use super::shooting::WHOLE;
use super::state::State;
use super::{given, settled, start, tell};
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

/// The fit as an explanation goes on: in whole stretches of a motion that nothing drives, where it
/// can be followed so far; the windows whose motion is most sensitive, which tell most, stand still
/// last.
fn followed(setting: &mut Setting<'_>, state: &mut State, rivals: Vec<Candidate>) -> Option<Outcome> {
    if setting.rig.drive.is_none() && setting.bound.inputs.is_empty() {
        let (before, blocks) = (state.clone(), setting.blocks);
        setting.blocks = WHOLE;
        if let Ok(outcome) = evidence::refit(setting, state, rivals.clone()) {
            return Some(outcome);
        }
        (*state, setting.blocks) = (before, blocks);
    }
    evidence::refit(setting, state, rivals).ok()
}

/// What a record would tell of a model that made it, and how far its effects stand from those
/// others of the list that are rivals; none where it is not followed.
///
/// # Errors
/// A record that cannot be identified, a model of another rig.
pub fn expected(
    record: Record,
    rig: &Rig,
    model: &IdentifiedModel,
    is_rival: &dyn Fn(&str) -> bool,
) -> Result<Option<Expected>> {
    let Some(whole) = rig.bound.as_deref() else { return Ok(None) };
    let records = [record];
    let begun = Setting::begin(&records, rig, whole, MOST_WINDOWS, &IdentifySettings::default())?;
    let Some(Begun { mut setting, first, physical, .. }) = begun else { return Ok(None) };
    let Some(mut state) = start(&setting, &first, physical) else { return Ok(None) };
    given::take(&setting, &mut state, model)?;
    if !settled(&mut setting, &mut state) || !setting.shooting {
        return Ok(None);
    }
    // What the model has is fitted beside it anyway; beside nothing there is nothing to tell.
    let has = |name: &str| state.chosen.iter().any(|k| k.candidate.name(&setting) == name);
    let any = state.chosen.len() > state.dampings;
    let all = setting.candidates_of(&state.physical, &Lines::default(), &|name| any && !has(name) && is_rival(name));
    let Some(outcome) = followed(&mut setting, &mut state, all) else { return Ok(None) };
    let Outcome { candidates: rivals, evidence: Evidence::Shooting(blocks), .. } = outcome else { return Ok(None) };
    let own = state.own_columns();
    let effects = effects(&setting, &state);
    let columns: Vec<usize> = (0..own).collect();
    let Some(fit) = blocks.fit(&columns) else { return Ok(None) };
    let alone = blocks.covariance(&columns, &fit);
    let of = |range: &core::ops::Range<usize>, values: &DVector<f64>, covariance: &DMatrix<f64>| {
        let own = covariance.view((range.start, range.start), (range.len(), range.len())).into_owned();
        deviations(values, &own).unwrap_or(0.0)
    };
    let from_nothing = |(name, range, values): &(String, _, _)| Separation {
        effect: name.clone(),
        from: None,
        deviations: of(range, values, &alone),
    };
    let mut separations: Vec<Separation> = effects.iter().map(from_nothing).collect();
    let mut begin = own;
    let mut beside = Vec::new();
    for c in &rivals {
        beside.push(begin..begin + c.strengths());
        begin += c.strengths();
    }
    let beside_all = |behind: &core::ops::Range<usize>, gone: &core::ops::Range<usize>| {
        let both: Vec<usize> = columns.iter().copied().filter(|c| !gone.contains(c)).chain(behind.clone()).collect();
        blocks.fit(&both).map(|f| blocks.covariance(&both, &f))
    };
    // What the equations hold already is no rival; what can be fitted only without the effect is
    // the same as it.
    let from_rival = |behind: &core::ops::Range<usize>| -> Vec<Option<f64>> {
        let together = beside_all(behind, &(0..0));
        let one = |(_, range, values): &(String, core::ops::Range<usize>, DVector<f64>)| match &together {
            Some(covariance) => Some(of(range, values, covariance)),
            None => beside_all(behind, range).map(|_| 0.0),
        };
        effects.iter().map(one).collect()
    };
    let apart: Vec<Vec<Option<f64>>> = beside.par_iter().map(from_rival).collect();
    let mut nearest: BTreeMap<(usize, String), f64> = BTreeMap::new();
    for (c, all) in rivals.iter().zip(&apart) {
        for (k, found) in all.iter().enumerate().filter_map(|(k, d)| Some((k, (*d)?))) {
            // Of several forms the one that is hardest to tell.
            let least = nearest.entry((k, c.name(&setting))).or_insert(f64::INFINITY);
            *least = least.min(found);
        }
    }
    separations.extend(nearest.into_iter().map(|((k, rival), deviations)| Separation {
        effect: effects[k].0.clone(),
        from: Some(rival),
        deviations,
    }));
    let windows = state.followed.as_ref().map_or((0, 0.0), |f| f.windows(&setting));
    let mut told = Explanation::new(1.0, Vec::new());
    tell::parameters(&setting, &state, (&fit.all, &alone), &first, &mut told);
    Ok(Some(Expected { parameters: told.parameters, separations, windows }))
}

/// A model with an effect of a given size in it, in the effect's first form; `record` is one that
/// the model without it made.
///
/// # Errors
/// As [`expected`]; an effect that the rig cannot have, or whose size is no strength.
pub fn with_effect(
    record: Record,
    rig: &Rig,
    model: &IdentifiedModel,
    name: &str,
    size: f64,
) -> Result<Option<IdentifiedModel>> {
    let Some(whole) = rig.bound.as_deref() else { return Ok(None) };
    let records = [record];
    let begun = Setting::begin(&records, rig, whole, MOST_WINDOWS, &IdentifySettings::default())?;
    let Some(Begun { setting, first, physical, .. }) = begun else { return Ok(None) };
    let Some(mut state) = start(&setting, &first, physical) else { return Ok(None) };
    given::take(&setting, &mut state, model)?;
    let all = setting.candidates_of(&state.physical, &Lines::default(), &|n| n == name);
    let Some(candidate) = all.first() else {
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
