//! A model that is given: its coefficients and effects become the state that is compared and extended.

use nalgebra::DVector;

use super::comparison::{Comparison, Measured};
use super::design::base_terms;
use super::parameters::{strengths, untied};
use super::state::{Chosen, State, candidates};
use crate::error::{BadInput, Result};
use crate::model::identified::{IdentifiedModel, System};
use crate::rig::Rig;

/// Takes a model's coefficients, dampings and effects over.
///
/// # Errors
/// A model of another system, another drive, or with an effect that this rig cannot have.
pub(super) fn take(state: &mut State, model: &IdentifiedModel, rig: &Rig) -> Result<()> {
    let bad = |found: String, expected: String| {
        Err(BadInput::new(found, expected).at("--model").remedy("Give a model that was identified on this rig"))
    };
    match &model.system {
        System::BuiltIn(id) if *id == rig.model => {}
        System::BuiltIn(id) => return bad(format!("a model of \"{id}\""), format!("a model of \"{}\"", rig.model)),
        System::Own(_) => return bad("a system of its own".to_owned(), format!("a model of \"{}\"", rig.model)),
    }
    let frequency = rig.drive.map(|d| d.frequency_hz);
    if model.drive_frequency_hz != frequency {
        let text = |f: Option<f64>| f.map_or("no drive".to_owned(), |f| format!("a drive of {f} Hz"));
        return bad(text(model.drive_frequency_hz), format!("{}, as in the rig file", text(frequency)));
    }
    let n = base_terms(state.context.driven);
    for i in 0..2 {
        for j in 0..n {
            let name = format!("B{}{}", i + 1, j + 1);
            let Some(p) = model.parameter(&name) else {
                return bad(format!("no parameter {name}"), format!("B11 … B2{n}"));
            };
            state.context.b[i][j] = p.value;
            state.base[i * n + j] = p.value;
        }
    }
    let all = candidates(&state.context);
    let mut chosen = Vec::new();
    for name in &model.nominal {
        let Some(k) = all.iter().find(|k| k.name() == *name) else {
            return bad(format!("\"{name}\""), "a damping of `whirl list effects`".to_owned());
        };
        let mut joined = Chosen { candidate: k.clone(), strengths: vec![0.0] };
        // Where the tie does not hold, the second equation's coefficient, which is the larger, is the start of the refit.
        joined.strengths[0] = strengths(state, &joined, model).last().copied().unwrap_or(0.0);
        chosen.push(joined);
    }
    for e in &model.effects {
        let name = format!("{}@{}", e.id, e.at);
        let fits = |k: &&super::state::Candidate| {
            k.name() == name
                && (k.variant.refine.is_some()
                    || k.variant.shape.iter().all(|(s, v)| e.parameters.get(*s).is_some_and(|g| g == v)))
        };
        let Some(k) = all.iter().find(fits) else {
            return bad(
                format!("effect \"{name}\""),
                "effects of `whirl list effects` that this rig can have".to_owned(),
            );
        };
        let mut joined = Chosen::new(&state.context, k.clone());
        if let (Some(refine), Some((form, _))) = (k.variant.refine, k.variant.shape.first()) {
            let at = e.parameters.get(*form).copied().unwrap_or(e.value);
            joined.candidate.variant = refine(&state.context, k.place, at);
        }
        if e.strengths.len() != joined.strengths.len() {
            return bad(
                format!("{} strengths of {name}", e.strengths.len()),
                format!("{} strengths", joined.strengths.len()),
            );
        }
        joined.strengths.clone_from(&e.strengths);
        chosen.push(joined);
    }
    state.nominal = chosen.len();
    state.chosen = chosen;
    Ok(())
}

/// Measures the model as it was given, before anything is refitted.
pub(super) fn measure(state: &State, model: &IdentifiedModel, comparison: &Comparison<'_>) -> Measured {
    let mut as_given = State {
        context: state.context.clone(),
        chosen: Vec::new(),
        nominal: state.nominal,
        base: state.base.clone(),
        segments: Vec::new(),
    };
    let mut x: Vec<f64> = state.base.clone();
    for k in &state.chosen {
        let values = strengths(state, k, model);
        let tied = values.is_empty();
        let variant = if tied { k.candidate.variant.clone() } else { untied(&k.candidate.variant, k.candidate.place) };
        let applied = variant.action.is_applied();
        let values = if tied { k.strengths.clone() } else { values };
        x.extend(values.iter().map(|v| if applied { 0.0 } else { *v }));
        let candidate = super::state::Candidate { variant, ..k.candidate.clone() };
        as_given.chosen.push(Chosen { candidate, strengths: values });
    }
    comparison.measure_given(&as_given, &DVector::from_vec(x))
}
