//! Parameters of the final model: coefficients of (3.4), physical values of dampings and effects, and the model for its file.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::Outcome;
use super::design::base_terms;
use super::effects::{Action, Place, Variant};
use super::explanation::{Explanation, Found};
use super::naming::compose;
use super::state::{Chosen, State};
use crate::identify::{self, Identification, Parameter};
use crate::model::identified::{AddedEffect, IdentifiedModel, RECORD_S, System};
use crate::rig::Rig;

/// Reads parameters and the effects' final values off the last fit (by shooting where the model leaves more than noise, otherwise the weak form).
pub(super) fn read(
    state: &State,
    outcome: &Outcome,
    first: &Identification,
    found: &mut [Found],
    result: &mut Explanation,
) {
    let (x, covariance): (&DVector<f64>, &DMatrix<f64>) = match &outcome.measured.shot {
        Some((x, covariance)) => (x, covariance),
        None => (&outcome.fit.all, &outcome.fit.covariance),
    };
    let n = base_terms(state.context.driven);
    let deviation = |i: usize| covariance[(i, i)].max(0.0).sqrt();
    for i in 0..2 {
        for j in 0..n {
            let name = format!("B{}{}", i + 1, j + 1);
            let unit = first.parameter(&name).map_or_else(|| "1".to_owned(), |p| p.unit.clone());
            result.parameters.push(Parameter { name, value: x[i * n + j], std_error: deviation(i * n + j), unit });
        }
    }
    let mut at = 2 * n;
    let mut effect = found.iter_mut();
    for (index, k) in state.chosen.iter().enumerate() {
        let d = k.strengths.len();
        let applied = k.candidate.variant.action.is_applied();
        let strengths: Vec<f64> = (0..d).map(|i| x[at + i] + if applied { k.strengths[i] } else { 0.0 }).collect();
        let own = covariance.view((at, at), (d, d)).into_owned();
        let (value, std_error, parameters, unit) = compose(&state.context, &k.candidate, &strengths, &own);
        if index < state.nominal {
            let named = coefficients(state, k);
            if named.is_empty() {
                result.given.push(AddedEffect {
                    id: k.candidate.effect.id.to_owned(),
                    at: k.candidate.place.name().to_owned(),
                    value,
                    std_error,
                    unit: unit.clone(),
                    strengths: strengths.clone(),
                    parameters,
                });
            }
            for (name, factor) in named {
                let unit = first.parameter(name).map_or_else(|| "1".to_owned(), |p| p.unit.clone());
                let std_error = (factor * deviation(at)).abs();
                result.parameters.push(Parameter {
                    name: name.to_owned(),
                    value: factor * strengths[0],
                    std_error,
                    unit,
                });
            }
        } else if let Some(f) = effect.next() {
            (f.value, f.std_error, f.parameters, f.unit) = (value, std_error, parameters, unit.clone());
            f.strengths = strengths;
        }
        result.parameters.push(Parameter { name: k.candidate.name(), value, std_error, unit });
        at += d;
    }
    // Coefficients in the order of (3.4), then dampings and effects in physical units as they were added.
    result.parameters.sort_by(|a, b| match (a.name.contains('@'), b.name.contains('@')) {
        (false, false) => a.name.cmp(&b.name),
        (a, b) => a.cmp(&b),
    });
}

/// Names of a nominal damping's coefficients in (3.4) and what its strength (a torque over J_o2) is multiplied with to give them: 1/(J_oi/J_o2 · Ω²) for dry
/// friction, Ω times that for viscous friction.
fn coefficients(state: &State, k: &Chosen) -> Vec<(&'static str, f64)> {
    let Some(damping) = identify::damping(&k.candidate.name()) else { return Vec::new() };
    let omega = state.context.omega;
    let power = if damping.is_viscous() { 1.0 / omega } else { 1.0 / (omega * omega) };
    (0..2).filter_map(|i| damping.names[i].map(|name| (name, power / state.context.inertia(i)))).collect()
}

/// Strength (a torque over J_o2) of a nominal damping in each equation, from the coefficients of (3.4).
pub(super) fn strengths(state: &State, k: &Chosen, model: &IdentifiedModel) -> Vec<f64> {
    coefficients(state, k)
        .into_iter()
        .map(|(name, factor)| model.parameter(name).map_or(0.0, |p| p.value / factor))
        .collect()
}

/// A joint's torque with a strength for each equation, for a model whose coefficients do not obey the tie.
pub(super) fn untied(variant: &Variant, place: Place) -> Variant {
    match &variant.action {
        Action::Force(columns) if place == Place::Joint2 && columns.len() == 1 => {
            let [first, second] = columns[0].clone();
            Variant { action: Action::Force(vec![[first, None], [None, second]]), ..variant.clone() }
        }
        _ => variant.clone(),
    }
}

/// The model with its effects.
pub(super) fn model(state: &State, rig: &Rig, result: &Explanation) -> IdentifiedModel {
    let nominal: Vec<String> = state.chosen[..state.nominal]
        .iter()
        .map(|k| k.candidate.name())
        .filter(|name| identify::damping(name).is_some())
        .collect();
    let given = result.given.iter().cloned();
    let mut found_with = BTreeMap::new();
    if !(result.given.is_empty() && result.effects.is_empty()) {
        // A drive's phase or a zero is no quantity that an effect rests on.
        found_with.extend(state.context.known.iter().filter(|(_, v)| **v > 0.0).map(|(k, v)| (k.clone(), *v)));
        found_with.insert(RECORD_S.to_owned(), state.context.span_s[1]);
    }
    IdentifiedModel {
        found_with,
        name: rig.name.clone(),
        system: System::BuiltIn(rig.model.clone()),
        method: "explain".to_owned(),
        drive_frequency_hz: rig.drive.map(|d| d.frequency_hz),
        nominal,
        parameters: result.parameters.iter().filter(|p| !p.name.contains('@')).cloned().collect(),
        effects: given.chain(result.effects.iter().map(Found::added)).collect(),
    }
}
