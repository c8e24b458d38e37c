//! The built-in double pendulum with its effects, as expressions: its equations (3.4) written out
//! as a model file, its effects by the catalogue's laws.
//!
//! The catalogue's laws act on a mechanism, whose parameters stand with the effects. Files of
//! earlier versions have ratios of inertias only, and strengths of torques over J_o2: their
//! mechanism is one with J_o2 = 1, on which the catalogue's laws have these strengths. With l the
//! lever S_i/J_oi = B_i2 Ω²/g: J_o1 = B21/B11, S2 = l_2, S1 = l_1 J_o1, l1 = B21/S2, and m1 e1 = m2
//! l1 = S1/2, which of both does not matter. The base's amplitude is each equation's own there,
//! a_c = −B_i3/l_i and a_s = −B_i4/l_i, as identified: columns of equation i are taken from a
//! mechanism with those.

use super::effects::{MechanismInstance, bad, entry, on_mechanism};
use super::{Acts, Effect, Strength};
use crate::effects::columns::Span;
use crate::effects::places::Place;
use crate::error::{BadInput, Result};
use crate::identify::model_file::{check_double_pendulum as checked, own_keys};
use crate::model::damping::Damping;
use crate::model::double_pendulum::DAMPINGS;
use crate::model::identified::{AddedEffect, IdentifiedModel, RECORD_S, System};
use crate::model::model_file::expression::{Node, multiply, number};
use crate::rig::{Rig, as_own};
use crate::system::library;
use crate::system::mechanism::Mechanism;

/// Share of S1 that the first arm has in the mechanism with J_o2 = 1; the rest is the second arm's
/// mass.
const OWN_SHARE: f64 = 0.5;

/// The rig with the equations written out, the model in their terms, and its effects.
///
/// # Errors
/// Another model, parameters or effects that do not belong to it, effects without an expression.
pub fn double_pendulum(
    model: &IdentifiedModel,
    rig: &Rig,
    start_s: f64,
) -> Result<(Rig, IdentifiedModel, Vec<Effect>)> {
    checked(model)?;
    let dampings: Vec<&Damping> = DAMPINGS.iter().filter(|d| model.nominal.iter().any(|n| n == d.id)).collect();
    let own_rig = as_own::double_pendulum(rig, &dampings)?;
    let mut own = model.clone();
    if let Some(bound) = &own_rig.bound {
        own.system = System::Own(own_keys(&bound.model)?);
    }
    let effects = if model.effects.is_empty() { Vec::new() } else { effects(model, &own_rig, start_s)? };
    Ok((own_rig, own, effects))
}

/// Effects by the catalogue's laws.
fn effects(model: &IdentifiedModel, rig: &Rig, start_s: f64) -> Result<Vec<Effect>> {
    let name = as_own::of_bodies(rig);
    let shipped = library::read(name, library::text(name).unwrap_or_default())?.model(Some(&[]), rig.omega())?;
    let Some(mechanism) = shipped.mechanism else { return Ok(Vec::new()) };
    let earlier = is_earlier(model);
    let physical: [Vec<f64>; 2] = [physical(model, rig, &mechanism, 0)?, physical(model, rig, &mechanism, 1)?];
    let span = Span { start_s, length_s: model.found_with.get(RECORD_S).copied().unwrap_or(f64::NAN) };
    let list = model.effects.iter().enumerate();
    list.map(|(i, e)| {
        if earlier && e.id == "imbalance" && e.at == "arm2" {
            // Found as what encoder 2 shows, of the opposite sign.
            return Ok(turned_encoder(e, rig));
        }
        let entry = entry(i, e, rig)?;
        let Some(place) = place(&e.at, rig) else {
            return Err(bad(
                i,
                e,
                "",
                "a place of the double pendulum",
                "Write the model anew with `whirl explain -o`",
            ));
        };
        let of = |k: usize| {
            let (mechanism, physical, omega) = (&mechanism, &physical[k][..], rig.omega());
            let found = MechanismInstance { mechanism, physical, omega, span, changed: &|_| Vec::new() };
            on_mechanism(i, e, entry, place, &found)
        };
        let (first, second) = (of(0)?, of(1)?);
        let acts = match (first.acts, second.acts) {
            (Acts::Motion(a), Acts::Motion(b)) => {
                // The imbalance of earlier versions is told of the whole of S1.
                let share = if earlier && e.id == "imbalance" { 1.0 / OWN_SHARE } else { 1.0 };
                Acts::Motion(a.into_iter().zip(b).map(|(a, b)| joined(a, b, rig.omega(), share)).collect())
            }
            (other, _) => other,
        };
        Ok(Effect { acts, ..second })
    })
    .collect()
}

/// Whether a model holds no mechanism that its effects act on.
pub fn is_earlier(model: &IdentifiedModel) -> bool {
    !model.found_with.contains_key("J_2") || !model.found_with.contains_key("J_1")
}

/// The first equation's part of one and the second's of the other, over Ω² as the equations are.
fn joined(first: Strength, second: Strength, omega: f64, share: f64) -> Strength {
    let scale = |of: Node| multiply(number(share / (omega * omega)), of);
    let own = first.adds.into_iter().filter(|a| a.0 == 0).chain(second.adds.into_iter().filter(|a| a.0 == 1));
    Strength { adds: own.map(|(e, of)| (e, scale(of))).collect(), name: first.name, value: first.value }
}

/// The sensor of an encoder: that of φ1, or the other.
fn sensor(rig: &Rig, encoder: usize) -> usize {
    let Some(bound) = &rig.bound else { return encoder };
    let first = bound.sensors.iter().position(|&c| rig.channel[c].measures == "phi1").unwrap_or(0);
    if encoder == 0 { first } else { 1 - first.min(1) }
}

fn turned_encoder(e: &AddedEffect, rig: &Rig) -> Effect {
    let laws = e.strengths.iter().map(|k| (number(-1.0), *k)).collect();
    Effect {
        identified: e.clone(),
        equation: "m e sin(φ + β) for m e sin φ".to_owned(),
        acts: Acts::Sensor(sensor(rig, 1), laws),
    }
}

/// A place by its name in the contract.
fn place(name: &str, rig: &Rig) -> Option<Place> {
    Some(match name {
        "joint1" => Place::Joint(0),
        "joint2" => Place::Joint(1),
        "arm1" => Place::Arm(0),
        "arm2" => Place::Arm(1),
        "encoder1" => Place::Encoder(sensor(rig, 0)),
        "encoder2" => Place::Encoder(sensor(rig, 1)),
        "drive" => Place::Drive,
        "frame" => Place::Frame,
        _ => return None,
    })
}

/// Parameters of the mechanism: those that stand with the model, otherwise those with J_o2 = 1, its
/// base moving as equation `of` says.
///
/// # Errors
/// A model of an earlier version without gravity or coupling.
pub fn physical(model: &IdentifiedModel, rig: &Rig, mechanism: &Mechanism, of: usize) -> Result<Vec<f64>> {
    let names: Vec<&str> = mechanism.file.iter().flat_map(|f| &f.parameters).map(|p| p.name.as_str()).collect();
    let known = |n: &str| model.found_with.get(n).or_else(|| rig.known.get(n)).copied();
    let g = known("g").unwrap_or(crate::rig::GRAVITY);
    if !is_earlier(model) {
        // A base at rest has no amplitude; g stands there where the file names it.
        let rest = |n: &str| if n == "g" { g } else { 0.0 };
        return Ok(names.iter().map(|n| model.found_with.get(*n).copied().unwrap_or_else(|| rest(n))).collect());
    }
    let b = |i: usize, k: usize| model.parameter(&format!("B{i}{k}")).map_or(0.0, |p| p.value);
    let lever = |i: usize| b(i, 2) * rig.omega().powi(2) / g;
    let inertia = b(2, 1) / b(1, 1);
    let (s1, s2) = (lever(1) * inertia, lever(2));
    let l1 = b(2, 1) / s2;
    let m2 = (1.0 - OWN_SHARE) * s1 / l1;
    let value = |name: &&str| match *name {
        "m1" | "J_2" => 1.0,
        "e1" => OWN_SHARE * s1,
        "l1" => l1,
        "m2" => m2,
        "e2" => s2 / m2,
        "J_1" => inertia - m2 * l1 * l1,
        "a_c" => -b(of + 1, 3) / lever(of + 1),
        "a_s" => -b(of + 1, 4) / lever(of + 1),
        "g" => g,
        _ => f64::NAN,
    };
    let values: Vec<f64> = names.iter().map(value).collect();
    if values.iter().all(|v| v.is_finite()) {
        return Ok(values);
    }
    Err(BadInput::new(
        "B11, B12, B21 or B22 of 0",
        "the coefficients of two arms that gravity pulls at and that are coupled",
    )
    .at("parameters")
    .remedy("Identify the model anew: its effects rest on these coefficients"))
}
