//! A model that is given: its coefficients and effects become the state that is compared and
//! extended.

use std::collections::BTreeMap;

use nalgebra::DVector;

use super::candidates::Candidate;
use super::setting::{Lines, Physical, Setting};
use super::state::{Chosen, State};
use crate::effects::entry::{Entry, Form};
use crate::error::{BadInput, Result};
use crate::identify::model_file::own_keys;
use crate::model::identified::{AddedEffect, IdentifiedModel, RECORD_S, System};
use crate::model::model_file::expression::multiple;
use crate::motion::{at_coordinates, check_drive};
use crate::system::mechanism::Mechanism;

/// The shape parameters of an effect in a file; none where one is missing.
pub fn form_of(entry: &Entry, e: &AddedEffect) -> Option<Form> {
    entry
        .shapes
        .iter()
        .map(|s| {
            let own = e.parameters.get(&s.name).copied();
            let value = (entry.value.as_ref() == Some(&s.name)).then_some(e.value);
            Some((s.name.clone(), own.or(value)?))
        })
        .collect()
}

/// An error about the model that was given.
fn told(e: BadInput) -> BadInput {
    e.at("--model").remedy("Give a model that was identified on this rig")
}

fn bad<T>(found: String, expected: &str) -> Result<T> {
    Err(told(BadInput::new(found, expected)))
}

/// Takes a model's coefficients, dampings and effects over.
///
/// # Errors
/// A model of other equations, a coefficient that is missing, an effect that this rig cannot have.
pub fn take(setting: &Setting<'_>, state: &mut State, model: &IdentifiedModel) -> Result<()> {
    match &model.system {
        System::Own(table) if *table == own_keys(&setting.whole.model)? => {}
        System::Own(_) => {
            let expected = format!("those of {}, which {} names", setting.rig.model, setting.rig.path.display());
            return bad(format!("other equations, of \"{}\"", model.name), &expected);
        }
        System::BuiltIn(id) => {
            let expected = format!("one of {}, which {} names", setting.rig.model, setting.rig.path.display());
            return bad(format!("a model of \"{id}\""), &expected);
        }
    }
    check_drive(model, setting.rig).map_err(told)?;
    let mut by_name = BTreeMap::new();
    for name in setting.whole.model.coefficients() {
        let Some(p) = model.coefficient(name) else {
            return bad(format!("no parameter {name}"), "every coefficient");
        };
        by_name.insert(name.clone(), p.value);
    }
    // A record's own coefficient starts from that of the first where the model knows fewer records.
    let value = |n: &String| -> Option<f64> {
        let short = n.rsplit_once('_').map_or(n.as_str(), |(short, _)| short);
        let known = model.parameter(n).map(|p| p.value);
        known.or_else(|| by_name.get(n).copied()).or_else(|| by_name.get(short).copied())
    };
    state.values = setting.own.names.iter().filter_map(value).collect();
    if let Some(mechanism) = setting.whole.model.mechanism.as_deref() {
        for k in &mut state.chosen {
            k.strengths[0] = damping(mechanism, &k.candidate.name(setting), &state.physical.values, &by_name);
        }
    }
    let lines: Vec<f64> = model.effects.iter().filter_map(|e| e.parameters.get("f").copied()).collect();
    let lines = Lines { of_frame: lines.clone(), of_forces: lines };
    let has = |name: &str| model.effects.iter().any(|e| e.name() == name);
    let all = setting.candidates_of(&state.physical, &lines, &has);
    // Earlier versions wrote what stands at a coordinate without where it acts.
    let earlier = setting.is_written() && !model.found_with.contains_key(RECORD_S);
    let as_written = if earlier { at_coordinates::of(model, setting.model())? } else { Vec::new() };
    for (index, e) in model.effects.iter().enumerate() {
        let name = e.name();
        let found = all.iter().find(|c| {
            c.name(setting) == name
                && (!c.refined_shapes().is_empty() || form_of(&c.entry, e).as_ref() == Some(&c.form))
        });
        let Some(mut candidate) = found.cloned() else {
            return bad(format!("effect \"{name}\""), "effects of `whirl list effects` that this rig can have");
        };
        let shapes = candidate.refined_shapes();
        if let (false, Some(form)) = (shapes.is_empty(), form_of(&candidate.entry, e)) {
            let steps: Vec<f64> = shapes.iter().map(|&k| form[k].1 - candidate.form[k].1).collect();
            candidate = candidate
                .at(setting, form, &state.physical)
                .unwrap_or_else(|| candidate.moved(setting, &steps, &state.physical));
        }
        // It stood beside what it takes away from.
        if candidate.entry.takes_from.is_some() && e.strengths.iter().any(|s| *s < 0.0) {
            candidate = candidate.of_either_sign();
        }
        let mut joined = Chosen::new(setting, candidate, &state.physical);
        if e.strengths.len() > joined.strengths.len() {
            return bad(format!("{} strengths of {name}", e.strengths.len()), "as many as the effect has");
        }
        let factors = factors(setting, state, &joined.candidate, model);
        for (k, (to, from)) in joined.strengths.iter_mut().zip(&e.strengths).enumerate() {
            *to = factors.get(k).copied().flatten().unwrap_or(1.0) * from;
        }
        if let Some(terms) = as_written.get(index) {
            let columns = joined.candidate.plain(setting, &state.physical);
            for ((to, from), (term, column)) in
                joined.strengths.iter_mut().zip(&e.strengths).zip(terms.columns.iter().zip(&columns))
            {
                let own = column.iter().find(|c| c.0 == terms.equation);
                *to = own.and_then(|(_, of)| multiple(term, of)).map_or(0.0, |k| k * from);
            }
        } else {
            joined.candidate = joined.candidate.about(setting, &joined.strengths, &state.physical);
        }
        state.chosen.push(joined);
    }
    state.nominal = state.chosen.len();
    state.take_off(setting);
    Ok(())
}

/// What strengths of a model on a mechanism of other parameters are multiplied with for the same
/// law here; none where that is no factor.
fn factors(setting: &Setting<'_>, state: &State, c: &Candidate, model: &IdentifiedModel) -> Vec<Option<f64>> {
    let there: Option<Vec<f64>> = setting
        .file()
        .filter(|_| !setting.is_written())
        .and_then(|f| f.parameters.iter().map(|p| model.found_with.get(&p.name).copied()).collect());
    let Some(values) = there else { return Vec::new() };
    let there = Physical { values, ..state.physical.clone() };
    let Some(other) = Candidate::new(setting, &c.entry, c.place, c.form.clone(), &there) else { return Vec::new() };
    let (theirs, own) = (other.plain(setting, &there), c.plain(setting, &state.physical));
    theirs
        .iter()
        .zip(&own)
        .map(|(theirs, own)| {
            // The equation in whose inertia it is told comes last.
            let (e, of) = theirs.last()?;
            multiple(of, &own.iter().find(|o| o.0 == *e)?.1)
        })
        .collect()
}

/// Strength of a nominal damping from the coefficients that it gives: from the largest, which is
/// known best.
fn damping(mechanism: &Mechanism, name: &str, physical: &[f64], by_name: &BTreeMap<String, f64>) -> f64 {
    let all: Vec<f64> = mechanism
        .parameters
        .iter()
        .enumerate()
        .map(|(k, p)| physical.get(k).copied().unwrap_or(f64::from(u8::from(p.name == name))))
        .collect();
    let uses = |c: &crate::system::mechanism::Coefficient| {
        mechanism
            .parameters
            .iter()
            .position(|p| p.name == name)
            .is_some_and(|k| c.numerator.any(&|a| *a == crate::system::polynomial::Atom::Parameter(k)))
    };
    mechanism
        .coefficients
        .iter()
        .filter(|c| uses(c))
        .filter_map(|c| Some((mechanism.value(&c.name, &all)?, *by_name.get(&c.name)?)))
        .max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
        .map_or(0.0, |(per, value)| value / per)
}

/// The coefficients of a state as they are, those of what is applied to the record as no further
/// increment.
pub fn coefficients(state: &State) -> DVector<f64> {
    let strengths = state.chosen.iter().flat_map(|k| {
        let applied = k.candidate.is_applied();
        k.strengths.iter().map(move |s| if applied { 0.0 } else { *s })
    });
    DVector::from_iterator(state.own_columns(), state.values.iter().copied().chain(strengths))
}
