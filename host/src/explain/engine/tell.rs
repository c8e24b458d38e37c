//! What is told: values with their units, parameters of the final model, the model for its file.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::candidates::Candidate;
use super::residual::balance_unit;
use super::setting::{Physical, Setting};
use super::state::State;
use crate::effects::columns::LOAD;
use crate::effects::entry::{At, Verb, multiplied};
use crate::effects::places::{self, Place};
use crate::effects::value::{Reported, report};
use crate::effects::written;
use crate::error::Result;
use crate::explain::explanation::{Explanation, Found};
use crate::identify::Identification;
use crate::identify::Parameter;
use crate::identify::model_file::own_keys;
use crate::identify::units::channel_units;
use crate::model::identified::{AddedEffect, IdentifiedModel, RECORD_S, System};
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::units::{self, Unit};
use crate::system::language::SystemFile;
use crate::system::mechanism::at;
use crate::system::polynomial::Polynomial;

/// Name of the inertia of an equation: of the quantity that it is, if there is one.
fn inertia_name(setting: &Setting<'_>, equation: usize) -> String {
    let Some(mechanism) = setting.mechanism() else { return String::new() };
    let (coordinate, scale) = &mechanism.scales[equation];
    let named = mechanism.quantities.iter().find(|q| q.value == *scale).map(|q| q.name.clone());
    named.unwrap_or_else(|| format!("inertia of {}", setting.model().coordinates[*coordinate].name))
}

/// Unit of a strength of one whose law is that of the entry, and the factor that turns strengths
/// into it.
fn scale(setting: &Setting<'_>, physical: &Physical, c: &Candidate) -> (f64, String) {
    if (c.entry.verb, c.entry.at) == (Verb::Moves, At::Frame) {
        return frame(setting, physical, c);
    }
    if c.entry.at == At::Body {
        return body(setting, physical, c);
    }
    let works = matches!(c.entry.verb, Verb::Force | Verb::Drags);
    if let (false, Some(unit)) = (works, &c.entry.unit) {
        return (1.0, unit.clone());
    }
    if c.entry.verb == Verb::Moves && setting.is_written() {
        // In units of the drive's amplitude, which written equations hold only in products.
        return match setting.rig.drive.and_then(|d| d.amplitude_m) {
            Some(a) => (a, "m".to_owned()),
            None => (1.0, "of the drive's amplitude".to_owned()),
        };
    }
    match (c.entry.verb, c.entry.at) {
        (Verb::Turns, _) => (1.0, "rad".to_owned()),
        (Verb::Moves, _) => (1.0, "m".to_owned()),
        (Verb::Reads, At::Input) => {
            let (_, inputs) = channel_units(setting.model(), setting.rig, setting.whole);
            let Place::Input(k) = c.place else { return (1.0, String::new()) };
            (1.0, inputs.get(k).map_or_else(String::new, ToString::to_string))
        }
        (Verb::Reads, _) => {
            let sensor = if let Place::Encoder(k) = c.place { k } else { 0 };
            let own = setting.bound.sensors.get(sensor).map_or("m", |k| setting.rig.channel[*k].si_unit());
            (1.0, if own == "1" { String::new() } else { own.to_owned() })
        }
        (Verb::Advances, _) => (1.0, "rad".to_owned()),
        (Verb::Force | Verb::Drags, _) => force(setting, physical, c),
    }
}

/// The same of a frame that gives way: over its mass, times the first equation's inertia where
/// masses stay open.
fn frame(setting: &Setting<'_>, physical: &Physical, c: &Candidate) -> (f64, String) {
    let unit = c.entry.unit.clone().unwrap_or_default();
    match setting.mechanism().and_then(|m| m.scales.first()) {
        Some((_, inertia)) if physical.open.first().copied().unwrap_or(true) => {
            let name = inertia_name(setting, 0);
            let told = unit.strip_prefix("1/").map(|mass| format!("{name} per {mass}"));
            (at(inertia, &physical.values), told.unwrap_or_else(|| format!("{name} × {unit}")))
        }
        _ => (1.0, unit),
    }
}

/// The same at a body: over the inertia of the first coordinate that moves it where that stays open.
fn body(setting: &Setting<'_>, physical: &Physical, c: &Candidate) -> (f64, String) {
    let unit = c.entry.unit.clone().unwrap_or_default();
    let (Some(mechanism), Some(file)) = (setting.mechanism(), setting.file()) else { return (1.0, unit) };
    match places::equation(c.place, mechanism) {
        Some((equation, moves)) if physical.open.get(equation).copied().unwrap_or(true) => {
            let mass = if is_angle(file, &moves) { "kg m²" } else { "kg" };
            let told = format!("{unit} per {mass} of {}", inertia_name(setting, equation)).trim_start().to_owned();
            (1.0 / at(&mechanism.scales[equation].1, &physical.values), told)
        }
        _ => (1.0, unit),
    }
}

/// Whether an expression of coordinates is told in radians.
fn is_angle(file: &SystemFile, p: &Polynomial) -> bool {
    let mut own = (0..file.coordinates.len()).filter(|k| p.moves(|s| s == Symbol::Coordinate(*k))).peekable();
    own.peek().is_some() && own.all(|k| file.counts_radians(k))
}

/// Factor and unit of a plain force at a place.
pub fn of_force(setting: &Setting<'_>, physical: &Physical, place: Place) -> (f64, String) {
    let Some((equation, moves)) = setting.mechanism().and_then(|m| places::equation(place, m)) else {
        return (1.0, String::new());
    };
    let angle = setting.file().is_some_and(|f| is_angle(f, &moves));
    if setting.is_written() {
        let (model, omega) = (setting.model(), setting.rig.omega());
        return (written::told_by(model, omega, equation, &physical.values), balance_unit(setting, equation));
    }
    let Some(mechanism) = setting.mechanism() else { return (1.0, String::new()) };
    let unit = |known: bool| match (angle, known) {
        (true, true) => "N m",
        (true, false) => "rad/s²",
        (false, true) => "N",
        (false, false) => "m/s²",
    };
    if physical.open.get(equation).copied().unwrap_or(true) {
        return (1.0 / at(&mechanism.scales[equation].1, &physical.values), unit(false).to_owned());
    }
    (1.0, unit(true).to_owned())
}

/// The same for a force.
fn force(setting: &Setting<'_>, physical: &Physical, c: &Candidate) -> (f64, String) {
    let (Some((equation, moves)), Some(file), Some(mechanism)) =
        (setting.mechanism().and_then(|m| places::equation(c.place, m)), setting.file(), setting.mechanism())
    else {
        return (1.0, String::new());
    };
    if setting.is_written() && !c.entry.names(LOAD) {
        return in_its_equation(setting, physical, c, equation, &moves);
    }
    let angle = is_angle(file, &moves);
    let work = if angle { "N m" } else { "N" };
    let unit_of = |k: usize| Unit::of_channel(if file.counts_radians(k) { "rad" } else { "m" });
    let coordinates: Vec<Unit> = (0..file.coordinates.len()).map(unit_of).collect();
    let newton = [Unit::parse("N").unwrap_or_default()];
    // A strength's unit: that of the work over that of what it multiplies.
    let of = multiplied(&c.entry, &c.form, &moves, file.coordinates.len(), setting.rig.omega());
    let unit = Unit::parse(work).unwrap_or_default();
    let per = of.and_then(|n| crate::model::model_file::units::of(&n, &coordinates, &newton, true)).unwrap_or_default();
    // The entry's own unit is that of something that turns.
    let own = c.entry.unit.clone().filter(|_| angle);
    // Where a shape is the value, a position, no inertia is in its unit.
    let is_shape = c.entry.value.as_ref().is_some_and(|v| c.form.iter().any(|s| s.0 == *v));
    let unit = match own {
        Some(unit) => unit,
        None if is_shape => if angle { "rad" } else { "m" }.to_owned(),
        None => unit.times(&per, -1.0).to_string(),
    };
    // A load is a force: over the inertia it is fixed, or the effect is not offered.
    if physical.open.get(equation).copied().unwrap_or(true) && !c.entry.names(LOAD) {
        let inertia = at(&mechanism.scales[equation].1, &physical.values);
        let mass = if angle { "kg m²" } else { "kg" };
        if is_shape {
            return (1.0 / inertia, unit);
        }
        return (1.0 / inertia, format!("{unit} per {mass} of {}", inertia_name(setting, equation)));
    }
    (1.0, unit)
}

/// The same in the units of a written equation.
fn in_its_equation(
    setting: &Setting<'_>,
    physical: &Physical,
    c: &Candidate,
    equation: usize,
    moves: &Polynomial,
) -> (f64, String) {
    let (model, omega) = (setting.model(), setting.rig.omega());
    let factor = written::told_by(model, omega, equation, &physical.values);
    let (coordinates, inputs) = channel_units(model, setting.rig, setting.whole);
    let balance = model.in_seconds(&model.equations[equation].balance, omega);
    let is_shape = c.entry.value.as_ref().is_some_and(|v| c.form.iter().any(|s| s.0 == *v));
    let name = &model.coordinates[setting.mechanism().map_or(equation, |m| m.scales[equation].0)].name;
    let inertia = setting.rig.known.get(&format!("J_{name}"));
    let factor = factor * inertia.copied().unwrap_or(1.0);
    let unit = if let (Some(_), false, Some(unit)) = (inertia, is_shape, &c.entry.unit) {
        unit.clone()
    } else if is_shape {
        let moved = (0..coordinates.len()).find(|k| moves.moves(|s| s == Symbol::Coordinate(*k)));
        moved.map_or_else(|| "m".to_owned(), |k| coordinates[k].to_string())
    } else {
        multiplied(&c.entry, &c.form, moves, model.coordinates.len(), omega)
            .map_or_else(String::new, |of| units::coefficient(&balance, &of, &coordinates, &inputs, true))
    };
    (factor, unit)
}

/// Value, standard error, parameters and unit of an effect with strengths `k` and their covariance.
pub fn value(
    setting: &Setting<'_>,
    physical: &Physical,
    c: &Candidate,
    k: &[f64],
    covariance: &DMatrix<f64>,
) -> (Reported, String) {
    let (factor, unit) = scale(setting, physical, c);
    let d = c.entry.strengths.len();
    let mut form = c.form.clone();
    let mut moved = BTreeMap::new();
    let leading = c.leading();
    let square: f64 = k[..leading].iter().map(|s| s * s).sum();
    for (n, (shape, step)) in c.refined_shapes().into_iter().zip(c.steps(k)).enumerate() {
        // What is left of the last Gauss–Newton step belongs to the value.
        let [low, high] = c.entry.shapes[shape].within.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        form[shape].1 = (form[shape].1 + step).clamp(low, high);
        let at = d + n * leading;
        let variance: f64 = (0..leading).map(|i| k[i] * k[i] * covariance[(at + i, at + i)].max(0.0)).sum();
        moved.insert(form[shape].0.clone(), variance / (square * square));
    }
    let own = covariance.view((0, 0), (d, d)).into_owned();
    (report(&c.entry, &form, &k[..d], &own, factor, &moved), unit)
}

/// A found effect.
pub fn found(setting: &Setting<'_>, c: &Candidate, reported: Reported, unit: String) -> Found {
    let confirm = rounded(setting, c, &reported).unwrap_or(&c.entry.confirm).to_owned();
    Found {
        value: reported.value,
        std_error: reported.std_error,
        parameters: reported.parameters,
        parameter_std_errors: reported.std_errors,
        equation: c.entry.equation.clone(),
        confirm,
        ..Found::empty(&c.entry.id, &c.place_name(setting), unit)
    }
}

/// Share of half a count within which an offset is taken for one, beside three standard errors.
const HALF: f64 = 0.03;

/// What to do about an offset of half a count, which is how the counts were made and no effect of
/// the rig: a count c says [c, c + 1), one that was rounded [c − ½, c + ½).
fn rounded(setting: &Setting<'_>, c: &Candidate, offset: &Reported) -> Option<&'static str> {
    let Place::Encoder(sensor) = c.place else { return None };
    let channel = &setting.rig.channel[*setting.bound.sensors.get(sensor)?];
    let half = 0.5 * channel.scale();
    let misses = (offset.value.abs() - half).abs() > (HALF * half).max(3.0 * offset.std_error);
    if c.entry.id != "zero-offset" || channel.unit != "count" || misses {
        return None;
    }
    Some(
        "it is half a count, as of counts that were made by rounding an angle; here a count c says that the angle lies \
         between c and c + 1. Cut instead of rounding, or record the angle itself (unit = \"rad\"); if a counter made \
         them, let everything come to rest and read it",
    )
}

/// Reads parameters and the effects' final values off the last fit.
pub fn parameters(
    setting: &Setting<'_>,
    state: &State,
    (x, covariance): (&DVector<f64>, &DMatrix<f64>),
    first: &Identification,
    result: &mut Explanation,
) {
    let mut at_column = state.values.len();
    let mut strengths: BTreeMap<String, (f64, f64)> = BTreeMap::new();
    let mut told: Vec<Parameter> = Vec::new();
    for (index, k) in state.chosen.iter().enumerate() {
        let d = k.strengths.len();
        let own = covariance.view((at_column, at_column), (d, d)).into_owned();
        let values = k.values(x, at_column);
        let (reported, unit) = value(setting, &state.physical, &k.candidate, &values, &own);
        let name = k.candidate.name(setting);
        if index < state.dampings {
            strengths.insert(name.clone(), (values[0], own[(0, 0)].max(0.0).sqrt()));
        } else if index < state.nominal {
            result.given.push(AddedEffect {
                id: k.candidate.entry.id.clone(),
                at: k.candidate.place_name(setting),
                value: reported.value,
                std_error: reported.std_error,
                unit: unit.clone(),
                strengths: values,
                parameters: reported.parameters,
            });
        } else if let Some(f) = result.effects.get_mut(index - state.nominal) {
            (f.value, f.std_error, f.unit) = (reported.value, reported.std_error, unit.clone());
            f.parameters = reported.parameters;
            f.parameter_std_errors = reported.std_errors;
            f.strengths = values;
        }
        told.push(Parameter { name, value: reported.value, std_error: reported.std_error, unit });
        at_column += d;
    }
    let mechanism = setting.whole.model.mechanism.as_deref();
    let told_as = |name: &str| first.parameter(name).map_or_else(String::new, |p| p.unit.clone());
    for name in setting.whole.model.coefficients() {
        // A coefficient of which each record has its own is told once for each.
        let columns = setting.own.columns(setting.model(), name);
        result.parameters.extend(columns.iter().map(|&i| {
            let name = setting.own.names[i].clone();
            Parameter { unit: told_as(&name), name, value: x[i], std_error: covariance[(i, i)].max(0.0).sqrt() }
        }));
        if columns.is_empty() {
            let of = |m| damping(m, name, &state.physical.values, &strengths);
            let (value, std_error) = mechanism.map_or((f64::NAN, f64::NAN), of);
            result.parameters.push(Parameter { unit: told_as(name), name: name.clone(), value, std_error });
        }
    }
    result.parameters.extend(told);
}

/// A nominal damping's coefficient from its strength.
fn damping(
    mechanism: &crate::system::mechanism::Mechanism,
    name: &str,
    physical: &[f64],
    strengths: &BTreeMap<String, (f64, f64)>,
) -> (f64, f64) {
    let with = |pick: fn(&(f64, f64)) -> f64| {
        let all: Vec<f64> = mechanism
            .parameters
            .iter()
            .enumerate()
            .map(|(k, p)| physical.get(k).copied().unwrap_or_else(|| strengths.get(&p.name).map_or(0.0, pick)))
            .collect();
        mechanism.value(name, &all).unwrap_or(0.0)
    };
    (with(|s| s.0), with(|s| s.1).abs())
}

/// The model with its effects.
///
/// # Errors
/// A model file that cannot be read.
pub fn model(setting: &Setting<'_>, state: &State, result: &Explanation) -> Result<IdentifiedModel> {
    let mut found_with = BTreeMap::new();
    let none = result.effects.is_empty() && result.given.is_empty();
    if let (false, Some(file)) = (none, setting.file()) {
        if !setting.is_written() {
            // What an effect rests on, where that is a shape of it.
            let in_form = |c: &Candidate| setting.values_in(&c.entry, c.place, &c.form, &state.physical);
            let own = state.chosen.iter().rev().filter_map(|c| in_form(&c.candidate)).find(|v| v.1);
            let values = own.map_or_else(|| state.physical.values.clone(), |v| v.0.into_owned());
            found_with.extend(file.parameters.iter().zip(&values).map(|(p, v)| (p.name.clone(), *v)));
        }
        found_with.insert(RECORD_S.to_owned(), setting.span.length_s);
    }
    Ok(IdentifiedModel {
        found_with,
        name: setting.rig.name.clone(),
        system: System::Own(own_keys(&setting.whole.model)?),
        method: "explain".to_owned(),
        drive_frequency_hz: setting.rig.drive.map(|d| d.frequency_hz),
        nominal: Vec::new(),
        parameters: result.parameters.iter().filter(|p| !p.name.contains('@')).cloned().collect(),
        effects: result.given.iter().cloned().chain(result.effects.iter().map(Found::added)).collect(),
    })
}
