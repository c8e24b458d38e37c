//! Explanations for the built-in single pendulum: its equation written out, explained as a system of one's own, told in the built-in's terms.
//!
//! The nominal model is θ″ with the rig file's dampings, gravity and the drive in its direction; what the identification adds to that (motion across the drive, a
//! centroid off the arm's line) are effects here. Places: `joint1`, `arm1`, `drive`, `frame`.
//!
//! Values are physical where `[known]` has `J_o1`, or m1 e1 from which gravity gives it, otherwise divided by it: a strength k of the non-dimensional equation is k Ω² J.

use core::f64::consts::TAU;

use super::Settings;
use super::explanation::{Explanation, Found};
use super::model_file::{self, Beside};
use crate::error::{BadInput, Result};
use crate::identify::model_file::own_keys;
use crate::identify::system::System as Known;
use crate::model::identified::{AddedEffect, IdentifiedModel, System};
use crate::model::single_pendulum::DAMPINGS;
use crate::record::Record;
use crate::rig::{Direction, Rig, as_own};

/// The coordinate in the equation as it is written out.
const ANGLE: &str = "phi1";

/// What the effects of the drive need.
pub fn beside(rig: &Rig) -> Beside {
    Beside { omega: rig.omega(), direction: rig.drive.map(|d| d.direction) }
}

/// Names of the coefficients of some dampings.
fn coefficients(dampings: &[String]) -> Vec<&'static str> {
    DAMPINGS.iter().filter(|d| dampings.iter().any(|n| n == d.0)).map(|d| d.1).collect()
}

/// A rig and a model of it in the built-in's terms as those of a system of one's own.
///
/// # Errors
/// A model of another system, a damping that there is not.
pub fn own(model: &IdentifiedModel, rig: &Rig) -> Result<(Rig, IdentifiedModel)> {
    let bad = |found: String, expected: &str| {
        Err(BadInput::new(found, expected).at("model").remedy("Give a model that was identified on this rig"))
    };
    match &model.system {
        System::BuiltIn(id) if id == "single-pendulum" => {}
        System::BuiltIn(id) => return bad(format!("a model of \"{id}\""), "a model of \"single-pendulum\""),
        System::Own(_) => return bad("a system of its own".to_owned(), "a model of \"single-pendulum\""),
    }
    if let Some(n) = model.nominal.iter().find(|n| !DAMPINGS.iter().any(|d| d.0 == *n)) {
        return bad(format!("\"{n}\" in nominal"), "viscous-friction@joint1, coulomb-friction@joint1");
    }
    let across = match rig.drive.map(|d| d.direction) {
        Some(Direction::Vertical) => ["n_cos", "p_cos"],
        _ => ["n_sin", "p_sin"],
    };
    let all = model.parameter("q_cos").is_some() || across.iter().any(|n| model.parameter(n).is_some());
    let rig = as_own::single_pendulum(rig, &coefficients(&model.nominal), all)?;
    let Some(bound) = &rig.bound else { return bad("no channel".to_owned(), "a channel that measures theta1") };
    let mut out = model.clone();
    out.system = System::Own(own_keys(&bound.model)?);
    out.nominal.clear();
    for e in &mut out.effects {
        if ["joint1", "frame"].contains(&e.at.as_str()) || (e.at == "arm1" && e.id != "imbalance") {
            if e.id == "frame-tilt" {
                e.id = "imbalance".to_owned();
            }
            e.at = ANGLE.to_owned();
        }
        // The phase follows from the strengths.
        e.parameters.retain(|n, _| n != "phase" && n != "psi");
    }
    Ok((rig, out))
}

/// Explains one or several records of a single pendulum.
///
/// # Errors
/// As [`super::explain`].
pub fn explain(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Explanation> {
    let nominal = match &settings.model {
        Some(model) => model.nominal.clone(),
        None => Known::of(rig)?.nominal(),
    };
    let (own_rig, model) = match &settings.model {
        Some(model) => {
            let (rig, model) = own(model, rig)?;
            (rig, Some(model))
        }
        None => (as_own::single_pendulum(rig, &coefficients(&nominal), false)?, None),
    };
    let Some(bound) = &own_rig.bound else {
        return Err(BadInput::new("no channel", "a channel that measures theta1").in_file(&rig.path).at("channel"));
    };
    let settings = Settings { model, ..settings.clone() };
    let mut out = model_file::explain(records, &own_rig, bound, &settings, Some(&beside(rig)))?;
    let scale = Scale::of(&out, rig);
    for found in &mut out.effects {
        scale.tell(found);
    }
    for step in out.gap.steps.iter_mut().chain(out.simulation.iter_mut().flat_map(|s| &mut s.steps)) {
        step.added = step.added.take().map(|n| renamed(&n));
    }
    for c in out.simulation.iter_mut().flat_map(|s| &mut s.parameters) {
        c.name = renamed(&c.name);
    }
    for ranked in &mut out.ranking {
        ranked.name = renamed(&ranked.name);
    }
    if let Some(model) = &mut out.model {
        model.system = System::BuiltIn("single-pendulum".to_owned());
        model.nominal = nominal;
        for e in &mut model.effects {
            scale.tell_added(e);
        }
    }
    Ok(out)
}

/// `ID@PLACE` (with what may follow) in the built-in's terms.
fn renamed(name: &str) -> String {
    let Some((id, place)) = name.split_once('@') else { return name.to_owned() };
    let Some(rest) = place.strip_prefix(ANGLE) else { return name.to_owned() };
    match id {
        // S cos φ without the drive's share turned with it.
        "imbalance" => format!("frame-tilt@frame{rest}"),
        "quadratic-drag" => format!("{id}@arm1{rest}"),
        _ => format!("{id}@joint1{rest}"),
    }
}

/// Moment of inertia, kg m²: known, or from the known m e by gravity, q = m e g/(J Ω²).
fn inertia(rig: &Rig, q_sin: f64) -> Option<f64> {
    let known = |name: &str| rig.known.get(name).copied();
    known("J_o1").or_else(|| {
        let moment = known("m1e1").or_else(|| Some(known("m1")? * known("e1")?))?;
        let g = known("g").unwrap_or(crate::rig::GRAVITY);
        Some(moment * g / (q_sin * rig.omega() * rig.omega())).filter(|j| j.is_finite() && *j > 0.0)
    })
}

/// Scales of what is told.
struct Scale {
    /// Ω², s⁻².
    square: f64,
    /// Moment of inertia, kg m², where it is known.
    inertia: Option<f64>,
    /// Non-dimensional gravity 1/r² and size of the drive's terms.
    gravity: f64,
    drive: f64,
    /// Amplitude of the base, m, where it is known.
    amplitude_m: Option<f64>,
}

impl Scale {
    fn of(result: &Explanation, rig: &Rig) -> Self {
        let value = |n: &str| result.parameters.iter().find(|p| p.name == n).map_or(0.0, |p| p.value);
        let [c, s] = match rig.drive.map(|d| d.direction) {
            Some(Direction::Vertical) => ["n_sin", "p_sin"],
            _ => ["n_cos", "p_cos"],
        };
        Self {
            square: rig.omega() * rig.omega(),
            inertia: inertia(rig, value("q_sin")),
            gravity: value("q_sin"),
            drive: value(c).hypot(value(s)),
            amplitude_m: rig.drive.and_then(|d| d.amplitude_m),
        }
    }

    /// Factor and unit of an effect's value.
    fn value(&self, id: &str, unit: &str) -> (f64, String) {
        let over_drive = |k: f64| if self.drive > 0.0 { 1.0 / (k * self.drive) } else { f64::NAN };
        match id {
            "imbalance" => {
                if self.drive > 0.0 {
                    (1.0, "rad".to_owned())
                } else {
                    (1.0 / self.gravity, "rad".to_owned())
                }
            }
            // Gravity turned by an angle: sin(φ − δ).
            "frame-tilt" => (-1.0 / self.gravity, "rad".to_owned()),
            "drive-harmonic-2" => (over_drive(4.0), "1".to_owned()),
            "drive-harmonic-3" => (over_drive(9.0), "1".to_owned()),
            "vertical-motion" | "horizontal-motion" => match self.amplitude_m {
                Some(a) => (a * over_drive(1.0), "m".to_owned()),
                None => (over_drive(1.0), "of the drive's amplitude".to_owned()),
            },
            _ => match self.inertia {
                Some(j) => {
                    let told = match unit {
                        "s⁻²" => "N m".to_owned(),
                        "s⁻¹" => "N m s".to_owned(),
                        "1" | "" => "N m s²".to_owned(),
                        other => format!("kg m² {other}"),
                    };
                    (self.square * j, told)
                }
                None => (self.square, unit.to_owned()),
            },
        }
    }

    /// Parameters beyond the value.
    fn phase(id: &str, strengths: &[f64], parameters: &mut std::collections::BTreeMap<String, f64>) {
        if id.starts_with("drive-harmonic") {
            parameters.remove("psi");
            // The force is minus the base's acceleration, which is minus the displacement's multiple.
            if let [c, s] = strengths {
                parameters.insert("phase".to_owned(), (-s).atan2(-c).rem_euclid(TAU));
            }
        }
    }

    fn tell(&self, found: &mut Found) {
        let name = renamed(&format!("{}@{}", found.id, found.at));
        if let Some((id, at)) = name.split_once('@') {
            (found.id, found.at) = (id.to_owned(), at.to_owned());
        }
        let (factor, unit) = self.value(&found.id, &found.unit);
        (found.value, found.std_error, found.unit) = (factor * found.value, factor.abs() * found.std_error, unit);
        Self::phase(&found.id, &found.strengths, &mut found.parameters);
        for n in &mut found.indistinguishable_from {
            *n = renamed(n);
        }
        if let Some((n, _)) = &mut found.runner_up {
            *n = renamed(n);
        }
        let same: &[&str] = match found.id.as_str() {
            "imbalance" => &["zero-offset@encoder1"],
            // Without a drive nothing tells a turned frame from a turned centroid or scale.
            "frame-tilt" if self.drive == 0.0 => &["imbalance@arm1", "zero-offset@encoder1"],
            _ => &[],
        };
        for n in same {
            if !found.indistinguishable_from.iter().any(|x| x == n) {
                found.indistinguishable_from.push((*n).to_owned());
            }
        }
    }

    fn tell_added(&self, e: &mut AddedEffect) {
        let name = renamed(&format!("{}@{}", e.id, e.at));
        if let Some((id, at)) = name.split_once('@') {
            (e.id, e.at) = (id.to_owned(), at.to_owned());
        }
        let (factor, unit) = self.value(&e.id, &e.unit);
        (e.value, e.std_error, e.unit) = (factor * e.value, factor.abs() * e.std_error, unit);
        Self::phase(&e.id, &e.strengths, &mut e.parameters);
    }
}
