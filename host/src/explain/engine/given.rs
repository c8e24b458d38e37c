//! A model that is given: its coefficients and effects become the state that is compared and extended, or equations to predict with.

use std::collections::BTreeMap;

use nalgebra::DVector;

use super::setting::Setting;
use super::state::{Chosen, State};
use crate::effects::columns::{self, Action, Span};
use crate::effects::entry::{Entry, Form};
use crate::effects::{catalogue, places, written};
use crate::error::{BadInput, Result};
use crate::identify::model_file::own_keys;
use crate::model::identified::{AddedEffect, IdentifiedModel, RECORD_S, System};
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::model::model_file::expression::{Node, multiple};
use crate::motion::at_coordinates;
use crate::rig::Rig;
use crate::rig::measures::Bound;
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

fn bad<T>(found: String, expected: &str) -> Result<T> {
    Err(BadInput::new(found, expected).at("--model").remedy("Give a model that was identified on this rig"))
}

/// Takes a model's coefficients, dampings and effects over.
///
/// # Errors
/// A model of other equations, a coefficient that is missing, an effect that this rig cannot have.
pub fn take(setting: &Setting<'_>, state: &mut State, model: &IdentifiedModel) -> Result<()> {
    match &model.system {
        System::Own(table) if *table == own_keys(&setting.whole.model)? => {}
        System::Own(_) => return bad("other equations".to_owned(), "those of the rig's model file"),
        System::BuiltIn(id) => return bad(format!("a model of \"{id}\""), "a model of the rig's own system"),
    }
    let mut by_name = BTreeMap::new();
    for name in setting.whole.model.coefficients() {
        let Some(p) = model.coefficient(&name) else {
            return bad(format!("no parameter {name}"), "every coefficient");
        };
        by_name.insert(name, p.value);
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
    let all = setting.candidates(&state.physical);
    // Earlier versions wrote what stands at a coordinate without where it acts.
    let earlier = setting.is_written() && !model.found_with.contains_key(RECORD_S);
    let as_written = if earlier { at_coordinates::of(model, setting.model())? } else { Vec::new() };
    for (index, e) in model.effects.iter().enumerate() {
        let name = format!("{}@{}", e.id, e.at);
        let found = all.iter().find(|c| {
            c.name(setting) == name && (c.refined_shape().is_some() || form_of(&c.entry, e).as_ref() == Some(&c.form))
        });
        let Some(mut candidate) = found.cloned() else {
            return bad(format!("effect \"{name}\""), "effects of `whirl list effects` that this rig can have");
        };
        if let (Some(shape), Some(form)) = (candidate.refined_shape(), form_of(&candidate.entry, e)) {
            let step = form[shape].1 - candidate.form[shape].1;
            candidate = candidate
                .at(setting, form, &state.physical)
                .unwrap_or_else(|| candidate.moved(setting, step, &state.physical));
        }
        let mut joined = Chosen::new(setting, candidate, &state.physical);
        if e.strengths.len() > joined.strengths.len() {
            return bad(format!("{} strengths of {name}", e.strengths.len()), "as many as the effect has");
        }
        joined.strengths.iter_mut().zip(&e.strengths).for_each(|(to, from)| *to = *from);
        if let Some(terms) = as_written.get(index) {
            let columns = joined.candidate.plain(setting, &state.physical);
            for ((to, from), (term, column)) in
                joined.strengths.iter_mut().zip(&e.strengths).zip(terms.columns.iter().zip(&columns))
            {
                let own = column.iter().find(|c| c.0 == terms.equation);
                *to = own.and_then(|(_, of)| multiple(term, of)).map_or(0.0, |k| k * from);
            }
        }
        state.chosen.push(joined);
    }
    state.nominal = state.chosen.len();
    state.stretches = state.taken_off(setting, &setting.raw);
    Ok(())
}

/// Strength of a nominal damping from the coefficients that it gives: from the largest, which is known best.
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

/// The coefficients of a state as they are, those of what is applied to the record as no further increment.
pub fn coefficients(state: &State) -> DVector<f64> {
    let strengths = state.chosen.iter().flat_map(|k| {
        let applied = k.candidate.is_applied();
        k.strengths.iter().map(move |s| if applied { 0.0 } else { *s })
    });
    DVector::from_iterator(state.own_columns(), state.values.iter().copied().chain(strengths))
}

/// A model as equations of motion with its parameters, and effects that do not act on the motion.
pub struct Moving {
    /// The equations.
    pub motion: EquationsOfMotion,
    /// Their parameters.
    pub parameters: Vec<f64>,
    /// `ID@PLACE` of those left out.
    pub left_out: Vec<String>,
}

/// The rig's whole equations with the effects of a model; none where an effect is not one of the catalogue at a place of a system that was derived
/// from bodies.
///
/// # Errors
/// A coefficient that is missing.
pub fn motion(given: &IdentifiedModel, rig: &Rig, bound: &Bound, start_s: f64) -> Result<Option<Moving>> {
    let model = &*bound.model;
    if given.effects.is_empty() {
        return Ok(None);
    }
    let values: Vec<f64> =
        model.coefficients().iter().map(|n| given.coefficient(n).map_or(f64::NAN, |p| p.value)).collect();
    let places = if written::applies(model) {
        // What was found before effects had places in written equations does not tell the record's length.
        if !given.found_with.contains_key(RECORD_S) {
            return Ok(None);
        }
        written::mechanism(model, rig.direction(), rig.omega(), &values)
    } else {
        None
    };
    let Some(mechanism) = places.as_ref().or(model.mechanism.as_deref()) else { return Ok(None) };
    let Some(file) = mechanism.file.as_deref() else { return Ok(None) };
    let physical: Vec<f64> = match &places {
        Some(_) => written::parameters(model, rig.direction(), rig.omega(), &values).unwrap_or_default(),
        None => file.parameters.iter().map(|p| given.found_with.get(&p.name).copied().unwrap_or(f64::NAN)).collect(),
    };
    let span = Span { start_s, length_s: given.found_with.get(RECORD_S).copied().unwrap_or(f64::NAN) };
    let mut terms: Vec<(usize, String, Node)> = Vec::new();
    let mut strengths: BTreeMap<String, f64> = BTreeMap::new();
    let mut left_out = Vec::new();
    for e in &given.effects {
        let entries = catalogue().iter().chain(rig.effects.iter().map(AsRef::as_ref));
        let Some(entry) = entries.into_iter().find(|x| x.id == e.id) else { return Ok(None) };
        let found = places::of(entry, file, bound).into_iter().find(|p| p.name(file) == e.at);
        let (Some(place), Some(form)) = (found, form_of(entry, e)) else { return Ok(None) };
        let action = columns::action(entry, &form, place, mechanism, &physical, (rig.omega(), span));
        let all = match &action {
            Ok(Some(Action::Force(parts))) => {
                Some(columns::columns(parts, entry.strengths.len(), mechanism, &physical))
            }
            Ok(Some(Action::Changes(all))) => Some(written::columns(all, model, rig.direction(), rig.omega(), &values)),
            _ => None,
        };
        match (action, all) {
            (_, Some(all)) => {
                for (k, (column, strength)) in all.into_iter().zip(&e.strengths).enumerate() {
                    let name = format!("{}@{} {k}", e.id, e.at);
                    strengths.insert(name.clone(), *strength);
                    terms.extend(column.into_iter().map(|(equation, of)| (equation, name.clone(), of)));
                }
            }
            (Ok(Some(_)), None) => left_out.push(format!("{}@{}", e.id, e.at)),
            _ => return Ok(None),
        }
    }
    let motion = EquationsOfMotion::with_columns(model, rig.omega(), &terms)?;
    let parameters = motion
        .coefficients()
        .iter()
        .map(|n| {
            let value = given.coefficient(n).map(|p| p.value).or_else(|| strengths.get(n).copied());
            value.ok_or_else(|| {
                BadInput::new(format!("no {n}"), motion.coefficients().join(", "))
                    .at(format!("parameters.{n}"))
                    .remedy("Write the model anew with `whirl identify -o`")
            })
        })
        .collect::<Result<_>>()?;
    Ok(Some(Moving { motion, parameters, left_out }))
}
