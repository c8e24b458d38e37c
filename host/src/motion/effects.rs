//! Effects of a model's file as expressions: those of the catalogue on a mechanism, and those of
//! model files on their coordinates.

use super::{Acts, Effect, Strength, at_coordinates};
use crate::effects::between::INERTIA_RATIO;
use crate::effects::catalogue;
use crate::effects::columns::{self, Action, LOAD, Span};
use crate::effects::entry::{Entry, MASS};
use crate::effects::places::{self, Place};
use crate::effects::written::{self, Change};
use crate::error::{BadInput, Result};
use crate::explain::engine::given::form_of;
use crate::model::identified::{AddedEffect, IdentifiedModel, RECORD_S};
use crate::model::model_file::expression::{Node, number};
use crate::rig::Rig;
use crate::system::mechanism::Mechanism;

/// Columns of changes of written equations.
pub type Changed<'a> = dyn Fn(&[Change]) -> Vec<Vec<(usize, Node)>> + 'a;

/// An error about effect `index` (from 0) of the model's file.
pub fn bad(index: usize, e: &AddedEffect, found: &str, expected: &str, remedy: &str) -> BadInput {
    let name = e.name();
    let found = if found.is_empty() { format!("\"{name}\"") } else { format!("\"{name}\", {found}") };
    BadInput::new(found, expected).at(format!("effect {}", index + 1)).remedy(remedy)
}

/// Names of strengths: those of the law, none where there is one only.
pub fn named(names: &[String], values: &[f64], adds: Vec<Vec<(usize, Node)>>) -> Vec<Strength> {
    let one = names.len() == 1;
    let name = |k: usize| if one { String::new() } else { names[k].clone() };
    let list = adds.into_iter().zip(values).enumerate();
    list.map(|(k, (adds, value))| Strength { name: name(k), value: *value, adds }).collect()
}

/// Effects of a system of one's own: of the catalogue where its bodies are known, otherwise at its
/// coordinates.
///
/// # Errors
/// An effect that there is not at this place, one that needs the bodies of a rig file that was not
/// given.
pub fn of_own(model: &IdentifiedModel, rig: &Rig, start_s: f64) -> Result<Vec<Effect>> {
    let Some(bound) = &rig.bound else { return Ok(Vec::new()) };
    let on_bodies = model.found_with.keys().any(|k| k != RECORD_S);
    if written::applies(&bound.model) && !on_bodies {
        return of_written(model, model, rig, start_s);
    }
    let Some(mechanism) = bound.model.mechanism.as_deref().filter(|_| on_bodies) else {
        if let (true, Some(e)) = (on_bodies, model.effects.first()) {
            return Err(bad(
                0,
                e,
                "an effect on bodies that this file does not hold",
                "the system file that the equations were derived from",
                "Name the rig file that the model was identified with: --rig RIG.toml",
            ));
        }
        return of_coordinates(model, model, rig);
    };
    let physical: Vec<f64> = mechanism
        .file
        .iter()
        .flat_map(|f| &f.parameters)
        .map(|p| model.found_with.get(&p.name).copied().unwrap_or(f64::NAN))
        .collect();
    at_places(model, rig, mechanism, &physical, None, start_s)
}

/// Effects of written equations: at their joints, arms, drive, frame and encoders where the file
/// says on how long a record they were found, otherwise at coordinates. `identified` tells them,
/// `own` in the terms of the rig's equations.
///
/// # Errors
/// As [`of_own`].
pub fn of_written(own: &IdentifiedModel, identified: &IdentifiedModel, rig: &Rig, start_s: f64) -> Result<Vec<Effect>> {
    let Some(bound) = &rig.bound else { return Ok(Vec::new()) };
    let (model, direction, omega) = (&*bound.model, rig.direction(), rig.omega());
    if !own.found_with.contains_key(RECORD_S) {
        return of_coordinates(own, identified, rig);
    }
    let values: Vec<f64> =
        model.coefficients().iter().map(|n| own.coefficient(n).map_or(f64::NAN, |p| p.value)).collect();
    let found =
        written::mechanism(model, direction, omega, &values).zip(written::parameters(model, direction, omega, &values));
    let Some((mechanism, parameters)) = found else { return of_coordinates(own, identified, rig) };
    at_places(own, rig, &mechanism, &parameters, Some(&values), start_s)
}

/// Effects of the catalogue at the places of a mechanism; `values`: coefficients of equations that
/// were written.
fn at_places(
    model: &IdentifiedModel,
    rig: &Rig,
    mechanism: &Mechanism,
    physical: &[f64],
    values: Option<&[f64]>,
    start_s: f64,
) -> Result<Vec<Effect>> {
    let (Some(bound), Some(file)) = (&rig.bound, mechanism.file.as_deref()) else { return Ok(Vec::new()) };
    let length_s = model.found_with.get(RECORD_S).copied().unwrap_or(f64::NAN);
    let span = Span { start_s, length_s };
    let changed =
        |all: &[Change]| written::columns(all, &bound.model, rig.direction(), rig.omega(), values.unwrap_or_default());
    let found = MechanismInstance { mechanism, physical, omega: rig.omega(), span, changed: &changed };
    let list = model.effects.iter().enumerate();
    list.map(|(i, e)| {
        let entry = entry(i, e, rig)?;
        let place = places::of(entry, file, bound).into_iter().find(|p| p.name(file) == e.at);
        let Some(place) = place else {
            return Err(bad(
                i,
                e,
                "",
                "a place of this system",
                "Give the rig file that the model was identified with",
            ));
        };
        on_mechanism(i, e, entry, place, &found)
    })
    .collect()
}

/// The catalogue's entry of an effect, or that of an effect file of the rig.
///
/// # Errors
/// An id that there is not.
pub fn entry<'a>(index: usize, e: &AddedEffect, rig: &'a Rig) -> Result<&'a Entry> {
    let mut all = catalogue().iter().chain(rig.effects.iter().map(AsRef::as_ref));
    all.find(|x| x.id == e.id).ok_or_else(|| {
        let remedy = "An effect of one's own needs the rig file that names its effect file: --rig RIG.toml";
        bad(index, e, "", "an effect of `whirl list effects`", remedy)
    })
}

/// A mechanism with the values of its parameters, as a record was identified with it.
pub struct MechanismInstance<'a> {
    /// The mechanism.
    pub mechanism: &'a Mechanism,
    /// Values of its parameters.
    pub physical: &'a [f64],
    /// Angular frequency of the drive, rad/s; 0 without one.
    pub omega: f64,
    /// The record.
    pub span: Span,
    /// Columns of changes of written equations.
    pub changed: &'a Changed<'a>,
}

/// An effect of the catalogue at a place of a mechanism.
///
/// # Errors
/// A shape that is missing, a law that adds nothing there, a value that is not finite.
pub fn on_mechanism(
    index: usize,
    e: &AddedEffect,
    entry: &Entry,
    place: Place,
    found: &MechanismInstance<'_>,
) -> Result<Effect> {
    let MechanismInstance { mechanism, physical, omega, span, changed } = *found;
    let remedy = "Write the model anew with `whirl explain -o`";
    // A load that rested on a mass which nothing fixed, a force on a ratio of inertias.
    let found = |name: &str| {
        let value = *e.parameters.get(name)?;
        Some(entry.with_shape(name, vec![value], Some([0.0, f64::INFINITY])))
    };
    let rests_on = match place {
        Place::Joint(_) if entry.names(LOAD) => found(MASS),
        Place::Between(..) => found(INERTIA_RATIO),
        _ => None,
    };
    let entry = rests_on.as_ref().unwrap_or(entry);
    let Some(mut form) = form_of(entry, e) else {
        let names: Vec<&str> = entry.shapes.iter().map(|s| s.name.as_str()).collect();
        return Err(bad(index, e, "without its shape", &names.join(", "), remedy));
    };
    // What is left of the last step of refined shapes: the value of a file holds it, a parameter
    // does not.
    if let ([k, steps @ ..], [_]) = (&e.strengths[..], &entry.strengths[..])
        && *k != 0.0
    {
        for (shape, step) in entry.bounded_shapes().zip(steps) {
            if entry.value.as_ref() != Some(&form[shape].0) {
                let [low, high] = entry.shapes[shape].within.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
                form[shape].1 = (form[shape].1 + step / k).clamp(low, high);
            }
        }
    }
    let made = |acts: Acts| Effect { identified: e.clone(), equation: entry.equation.clone(), acts };
    if e.strengths.len() < entry.strengths.len() {
        let found = format!("with {} strengths", e.strengths.len());
        return Err(bad(index, e, &found, &format!("{} strengths", entry.strengths.len()), remedy));
    }
    let values = &e.strengths[..entry.strengths.len()];
    let laws = |laws: Vec<Node>| laws.into_iter().zip(values.iter().copied()).collect::<Vec<_>>();
    let action = columns::action(&entry.about_found(values), &form, place, mechanism, physical, omega, span);
    match action {
        Ok(Some(Action::Force(_) | Action::Changes(_))) => {
            let adds = match &action {
                Ok(Some(Action::Force(parts))) => columns::columns(parts, entry.strengths.len(), mechanism, physical),
                Ok(Some(Action::Changes(all))) => changed(all),
                _ => Vec::new(),
            };
            if !adds.iter().flatten().all(|(_, of)| is_finite(of)) {
                return Err(bad(index, e, "with quantities that the file does not hold", "[found_with]", remedy));
            }
            Ok(made(Acts::Motion(named(&entry.strengths, values, adds))))
        }
        Ok(Some(Action::Advances(list))) => Ok(made(Acts::Drive(laws(list)))),
        Ok(Some(Action::Reads { sensor, laws: list })) => Ok(made(Acts::Sensor(sensor, laws(list)))),
        Ok(Some(Action::Records { input, laws: list })) => Ok(made(Acts::Input(input, laws(list)))),
        _ => Err(bad(index, e, "which adds nothing there", "an effect that acts there", remedy)),
    }
}

/// Whether an expression is a number at some state, of its own states as well.
fn is_finite(of: &Node) -> bool {
    of.with_memories(&|_, _| number(0.3)).value(&|_| 0.3).is_finite()
}

/// Effects at the coordinates of a model file; `identified` tells them, `own` in the terms of the
/// rig's equations.
///
/// # Errors
/// Other equations than the rig's, an effect that there is not.
fn of_coordinates(own: &IdentifiedModel, identified: &IdentifiedModel, rig: &Rig) -> Result<Vec<Effect>> {
    let Some(bound) = &rig.bound else { return Ok(Vec::new()) };
    let found = at_coordinates::of(own, &bound.model)?;
    let list = found.into_iter().zip(&identified.effects);
    let made = list.map(|(c, e)| {
        let names: Vec<String> = (1..=c.columns.len()).map(|k| k.to_string()).collect();
        let adds = c.columns.iter().map(|of| vec![(c.equation, of.clone())]).collect();
        let acts = Acts::Motion(named(&names, &e.strengths, adds));
        let equation = catalogue().iter().find(|x| x.id == e.id).map_or_else(String::new, |x| x.equation.clone());
        Effect { identified: e.clone(), equation, acts }
    });
    Ok(made.collect())
}
