//! A model to start from (`--model`), and the model that an explanation found (`-o`).

use std::collections::BTreeMap;

use super::Setting;
use super::candidates::{self, Candidate};
use super::measure::Moving;
use super::round::{Round, column_name, terms};
use super::told::put_value;
use crate::error::{BadInput, Result};
use crate::explain::explanation::{Explanation, Found, Step};
use crate::identify::general::track::Track;
use crate::identify::model_file::own_keys;
use crate::model::identified::{AddedEffect, IdentifiedModel, System};
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;

/// Effects of a given model as columns of the rig's.
///
/// # Errors
/// Other equations than the rig's, an effect that there is not.
pub fn effects(given: &IdentifiedModel, model: &ModelFile, speeds: &[f64]) -> Result<Vec<Candidate>> {
    let wanted = own_keys(model)?;
    match &given.system {
        System::Own(table) if *table == wanted => {}
        System::Own(_) => {
            return Err(BadInput::new("other equations", format!("those of {}", model.source.path.display()))
                .at("--model")
                .remedy("Give the rig file on which the model was identified"));
        }
        System::BuiltIn(id) => {
            return Err(BadInput::new(format!("model = \"{id}\""), "a system of your own")
                .at("--model")
                .remedy("Give the rig file on which the model was identified"));
        }
    }
    given
        .effects
        .iter()
        .enumerate()
        .map(|(k, e)| {
            // ψ follows from the strengths; what else there is, is the shape.
            let shape = e.parameters.iter().find(|(n, _)| *n != "psi").map(|(_, v)| *v);
            let found = candidates::candidate(model, &e.id, &e.at, shape, speeds);
            found.filter(|c| c.columns.len() == e.strengths.len()).ok_or_else(|| {
                BadInput::new(
                    format!("{}@{} with {} strengths", e.id, e.at, e.strengths.len()),
                    "an effect of `whirl list effects` at a coordinate of the model",
                )
                .at(format!("--model, effect {}", k + 1))
                .remedy("Correct the file, or write it anew with `whirl explain -o`")
            })
        })
        .collect()
}

/// The name that all records share: a coefficient of its own for each record has the record's number behind it.
fn shared(name: &str) -> &str {
    match name.rsplit_once('_') {
        Some((short, k)) if k.parse::<u32>().is_ok() => short,
        _ => name,
    }
}

/// The coefficients of a given model and of its effects by name.
pub(super) fn by_name(given: &IdentifiedModel, chosen: &[Candidate]) -> BTreeMap<String, f64> {
    let mut by_name: BTreeMap<String, f64> = given.parameters.iter().map(|p| (p.name.clone(), p.value)).collect();
    for p in &given.parameters {
        if let Some(short) = p.name.strip_suffix("_1") {
            by_name.entry(short.to_owned()).or_insert(p.value);
        }
    }
    for (c, e) in chosen.iter().zip(&given.effects) {
        for (k, s) in e.strengths.iter().enumerate() {
            by_name.insert(column_name(c, k), *s);
        }
    }
    by_name
}

/// A given model with its effects as equations of motion under a drive of angular frequency `omega` (1 without one), and their parameters.
///
/// # Errors
/// A model of other equations; as [`EquationsOfMotion::with_columns`]; a coefficient that is missing.
pub fn motion(given: &IdentifiedModel, model: &ModelFile, omega: f64) -> Result<(EquationsOfMotion, Vec<f64>)> {
    let chosen = effects(given, model, &vec![1.0; model.coordinates.len()])?;
    let motion = EquationsOfMotion::with_columns(model, omega, &terms(&chosen))?;
    let known = |name: &str| motion.coefficients().iter().any(|c| c == name || c == shared(name));
    if let Some(p) = given.parameters.iter().find(|p| !known(&p.name)) {
        return Err(BadInput::new("a parameter that the equations do not have", motion.coefficients().join(", "))
            .at(format!("parameters.{}", p.name))
            .remedy("Give a model that was identified on this rig, by the weak form or shooting"));
    }
    let values = by_name(given, &chosen);
    let parameters = motion
        .coefficients()
        .iter()
        .map(|n| {
            values.get(n).copied().ok_or_else(|| {
                BadInput::new(format!("no {n}"), motion.coefficients().join(", "))
                    .at(format!("parameters.{n}"))
                    .remedy("Write the model anew with `whirl identify -o`")
            })
        })
        .collect::<Result<_>>()?;
    Ok((motion, parameters))
}

/// The gap of the model as it was given.
///
/// # Errors
/// As [`Moving::new`].
pub fn measure(
    given: &IdentifiedModel,
    setting: &Setting<'_>,
    chosen: &[Candidate],
    track: &Track<'_>,
    result: &mut Explanation,
) -> Result<()> {
    let value = Moving::new(setting, chosen)?
        .map_or(f64::NAN, |m| m.gap(setting, &by_name(given, chosen), track, result.gap.horizon_s));
    result.gap.steps.push(Step { added: None, value });
    Ok(())
}

/// The model with everything that was chosen.
///
/// # Errors
/// A model file that is no longer readable.
pub fn model(
    setting: &Setting<'_>,
    round: &Round,
    chosen: &[Candidate],
    result: &Explanation,
) -> Result<IdentifiedModel> {
    let mut behind: Vec<usize> = round.groups.iter().map(|g| g.names.len()).collect();
    let effects = chosen
        .iter()
        .map(|c| {
            let g = round.group_of(c);
            let from = behind[g];
            behind[g] += c.columns.len();
            let mut found = Found::empty(c.effect.id, &c.at, super::told::unit_of(setting, c));
            put_value(c, &round.groups[g].own, from, super::told::scale_of(setting, c), &mut found);
            AddedEffect {
                id: found.id,
                at: found.at,
                value: found.value,
                std_error: found.std_error,
                unit: found.unit,
                strengths: found.strengths,
                parameters: found.parameters,
            }
        })
        .collect();
    Ok(IdentifiedModel {
        name: setting.rig.name.clone(),
        system: System::Own(own_keys(&setting.bound.model)?),
        method: if round.groups.len() == 1 { "shooting" } else { "weak" }.to_owned(),
        drive_frequency_hz: setting.rig.drive.map(|d| d.frequency_hz),
        nominal: Vec::new(),
        parameters: result.parameters.clone(),
        effects,
        found_with: BTreeMap::new(),
    })
}
