//! A rig and its model at another setting of the drive: what the same bodies do under another
//! frequency and amplitude.
//!
//! In seconds every term keeps its coefficient; those of a base that moves grow with its
//! acceleration a Ω². In derivatives by τ = Ω t a term of p primes stands over Ω^(2 − p).
//! Coefficients of equations that were derived from bodies hold no Ω: the base's acceleration is in
//! their columns.
//!
//! Limits: written equations in seconds with a force F cos τ are taken as those of a base too; a
//! plan for these holds at the frequency of the record alone.

use nalgebra::{DMatrix, DVector};

use super::Setting;
use crate::error::{BadInput, Result};
use crate::explain::{double_pendulum, single_pendulum};
use crate::identify::Parameter;
use crate::model::identified::{IdentifiedModel, System};
use crate::model::model_file::expression::{Node, Symbol};
use crate::model::model_file::{Equation, ModelFile, Term, Time};
use crate::rig::Rig;
use crate::rig::choices::Choices;
use crate::system::library::Pendulum;
use crate::system::ties::{self, Identified};

/// Parameters of a system of bodies that are the base's amplitude.
const AMPLITUDES: [&str; 2] = ["a_c", "a_s"];

/// A rig with its model, both of a file's equations.
pub struct Own {
    /// The rig, bound to the equations.
    pub rig: Rig,
    /// The model in their terms.
    pub model: IdentifiedModel,
}

/// A rig and a model in the terms of a file: built-in ones as those that they stand for.
///
/// # Errors
/// A model of another rig.
pub fn own(rig: &Rig, model: &IdentifiedModel) -> Result<Own> {
    let (rig, model) = match (&rig.bound, &model.system) {
        (Some(_), System::Own(_)) => (rig.clone(), model.clone()),
        (None, System::BuiltIn(_)) if rig.pendulum() == Some(Pendulum::Single) => single_pendulum::own(model, rig)?,
        (None, System::BuiltIn(_)) => double_pendulum::own(model, rig)?,
        _ => {
            return Err(BadInput::new(
                format!("a model of another system than \"{}\"", rig.model),
                "a model of this rig",
            )
            .at("--model")
            .remedy("Give a model that was identified with this rig file"));
        }
    };
    Ok(Own { rig, model })
}

/// A model whose coefficients are those of one system of bodies ([`crate::system::ties`]), the
/// nearest one by their standard errors. Explanations take dampings with one strength each: their
/// coefficients in several equations stand to one another as the inertias do. Where coefficients
/// give an inertia twice (by gravity and by coupling) and these two differ, as errors of an
/// identification, draws of them, or an effect that is not in it make them, no inertias are those
/// of all windows, and what is left of records of such a model is more than noise.
pub fn tied(rig: &Rig, mut model: IdentifiedModel) -> IdentifiedModel {
    let mechanism = rig.bound.as_ref().and_then(|b| b.model.mechanism.clone());
    let Some(mechanism) = mechanism.filter(|m| m.file.is_some()) else { return model };
    let known = mechanism.known(&rig.known, rig.says_gravity());
    let has = |name: &String| model.parameter(name).filter(|p| p.std_error > 0.0);
    let names: Vec<String> =
        mechanism.coefficients.iter().map(|c| c.name.clone()).filter(|n| has(n).is_some()).collect();
    let found: Vec<&Parameter> = names.iter().filter_map(has).collect();
    let values = DVector::from_iterator(found.len(), found.iter().map(|p| p.value));
    let errors = DVector::from_iterator(found.len(), found.iter().map(|p| p.std_error.powi(2)));
    let covariance = DMatrix::from_diagonal(&errors);
    let identified = Identified { names: &names, values: &values, covariance: &covariance, metric: &covariance };
    let Some(fit) = ties::fit(&mechanism, &identified, &known) else { return model };
    for p in model.parameters.iter_mut().filter(|p| names.contains(&p.name)) {
        if let Some(value) = mechanism.value(&p.name, &fit.parameters).filter(|v| v.is_finite()) {
            p.value = value;
        }
    }
    model
}

/// What is wrong with a setting, found when the rig file was read with it: neither that file nor
/// its place is what a person has to change.
fn of_setting(e: BadInput) -> BadInput {
    match e.place.as_deref().and_then(|place| place.strip_prefix("drive.")) {
        Some(key) => BadInput::new(e.found.clone(), e.expected.clone()).at(key),
        None => e,
    }
}

/// The rig at another setting, and its simulated plant, if it has one, with it; one without a
/// drive, or with nothing to set, is the same. An amplitude alone is one at the rig's frequency.
///
/// # Errors
/// A frequency that its samples do not resolve.
pub fn rig_at(rig: &Rig, setting: &Setting) -> Result<Rig> {
    let setting = setting.clone().on(rig);
    if setting.frequency_hz.is_none() && setting.pose.is_none() {
        return Ok(rig.clone());
    }
    let mut table: toml::Table =
        toml::from_str(&rig.text).map_err(|e| BadInput::new(e.message(), "a rig file").in_file(&rig.path))?;
    let drive = table.get_mut("drive").and_then(toml::Value::as_table_mut);
    if let (Some(own), Some(was), Some(frequency_hz)) = (drive, rig.drive, setting.frequency_hz) {
        own.insert("frequency_hz".to_owned(), frequency_hz.into());
        let scaled = || Some(was.amplitude_m? * setting.amplitude_factor?);
        // Where the rig file says none the record is to identify it.
        if let Some(a) = was.amplitude_m.and(setting.amplitude_m).or_else(scaled) {
            own.insert("amplitude_m".to_owned(), a.into());
        }
    }
    if let Some(plant) = table.get_mut("plant").and_then(toml::Value::as_table_mut) {
        if let Some(pose) = &setting.pose {
            let state = pose.iter().copied().chain(pose.iter().map(|_| 0.0));
            plant.insert("initial".to_owned(), state.map(toml::Value::from).collect::<Vec<_>>().into());
        }
        let of_rig = || Some(setting.amplitude_m? / rig.drive?.amplitude_m.filter(|a| *a > 0.0)?);
        let factor = setting.amplitude_factor.or_else(of_rig);
        if let (Some(a), Some(factor)) = (plant.get("amplitude_m").and_then(toml::Value::as_float), factor) {
            plant.insert("amplitude_m".to_owned(), (a * factor).into());
        }
    }
    table.insert("sample_rate_hz".to_owned(), rig.sample_rate_hz.into());
    let rate = rig.sample_rate_hz;
    Rig::of_text(&table.to_string(), &rig.path, &Choices::default(), &mut |_| Ok(Some(rate))).map_err(of_setting)
}

/// Power of the unit of time in an expression: X(q, s q̇, s² q̈) = s^p X(q, q̇, q̈).
fn primes(of: &Node) -> i32 {
    let at = |s: f64| {
        of.value(&|symbol| match symbol {
            Symbol::Coordinate(k) => 0.7 + 0.31 * k as f64,
            Symbol::Rate(k) => s * (1.3 - 0.4 * k as f64),
            Symbol::Acceleration(k) => s * s * (0.9 + 0.7 * k as f64),
            Symbol::Tau => 0.4,
            _ => 0.6,
        })
    };
    let ratio = (at(2.0) / at(1.0)).abs();
    if ratio.is_finite() && ratio > 0.0 { ratio.log2().round() as i32 } else { 0 }
}

/// What a coefficient is multiplied with.
fn factor(model: &ModelFile, equation: &Equation, term: &Term, times: f64, amplitude: f64) -> f64 {
    let driven = term.of.any(&|s| s == Symbol::Tau);
    let base = if driven { amplitude } else { 1.0 };
    let derived = model.mechanism.as_ref().is_some_and(|m| !m.coefficients.is_empty());
    match (model.time, derived, driven) {
        // What is over Ω² has the base's acceleration over Ω² as well.
        (Time::Phase, false, true) => base,
        (Time::Phase, false, false) => times.powi(primes(&term.of) - primes(&equation.balance)),
        (_, false, true) => base * times * times,
        _ => base,
    }
}

/// Multiplies the base's amplitude on which a model's effects rest.
pub fn scale_amplitude(model: &mut IdentifiedModel, by: f64) {
    let own = model.found_with.iter_mut().filter(|(name, _)| AMPLITUDES.contains(&name.as_str()));
    own.for_each(|(_, value)| *value *= by);
}

/// The rig and its model at a setting.
///
/// # Errors
/// A rig that cannot be had at it, such as one whose samples do not resolve the drive.
pub fn at(rig: &Rig, model: &IdentifiedModel, setting: &Setting) -> Result<Own> {
    let mut first = own(rig, model)?;
    first.model = tied(&first.rig, first.model);
    let (Some(drive), Some(frequency_hz)) = (rig.drive, setting.frequency_hz) else { return Ok(first) };
    let amplitude = setting.amplitude_factor.unwrap_or(1.0);
    let moved = rig_at(rig, setting)?;
    // The equations anew for that frequency; a model of the built-in terms names its own there.
    let there = own(&moved, &IdentifiedModel { drive_frequency_hz: Some(frequency_hz), ..model.clone() })?;
    let mut out = first.model;
    let Some(bound) = &first.rig.bound else { return Ok(Own { rig: there.rig, model: out }) };
    let times = frequency_hz / drive.frequency_hz;
    for equation in &bound.model.equations {
        for term in &equation.terms {
            let by = factor(&bound.model, equation, term, times, amplitude);
            for p in out.parameters.iter_mut().filter(|p| p.name == term.name) {
                (p.value, p.std_error) = (p.value * by, p.std_error * by.abs());
            }
        }
    }
    scale_amplitude(&mut out, amplitude);
    out.drive_frequency_hz = Some(frequency_hz);
    out.system = there.model.system;
    Ok(Own { rig: there.rig, model: out })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::rig::plant::Plant;
    use crate::rig::{Drive, as_own};
    use crate::system::mechanism::Coefficient;

    /// An amplitude without a frequency is one at that of the rig, for its simulated plant as well.
    #[test]
    fn an_amplitude_alone_is_set_at_the_rig_s_frequency() {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml")).unwrap();
        let (drive, plant) = (rig.drive.unwrap(), Plant::of(&rig).unwrap().amplitude_m);
        let stated = Rig { drive: Some(Drive { amplitude_m: Some(0.01), ..drive }), ..rig.clone() };
        let set = Setting { amplitude_m: Some(0.012), ..Setting::default() };
        assert_eq!(set.clone().on(&stated).frequency_hz, Some(drive.frequency_hz));
        let there = rig_at(&stated, &set).unwrap();
        let found = there.drive.unwrap();
        assert_eq!((found.frequency_hz, found.amplitude_m), (drive.frequency_hz, Some(0.012)));
        assert!((Plant::of(&there).unwrap().amplitude_m / (1.2 * plant) - 1.0).abs() < 1e-12);
        let fast = Setting { frequency_hz: Some(60.0), ..set };
        let e = rig_at(&rig, &fast).unwrap_err();
        assert_eq!((e.file, e.place.as_deref()), (None, Some("frequency_hz")));
    }

    /// Arm 2's inertia by gravity is 0.4 % more than by coupling: a model of that is brought to one
    /// that has both, by which its dampings stand to one another as the inertias do.
    #[test]
    fn an_inertia_that_is_given_twice_becomes_one() {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/seed.toml")).unwrap();
        let nominal = ["coulomb-friction@joint1", "viscous-friction@joint2"].map(str::to_owned);
        let own = as_own::double_pendulum_of_bodies(&rig, &nominal).unwrap();
        let mechanism = own.bound.as_ref().unwrap().model.mechanism.clone().unwrap();
        let physical = |name: &str| match name {
            "m1" => 0.1362,
            "e1" => 0.0127,
            "l1" => 0.0635,
            "m2" => 0.04,
            "e2" => 0.0267,
            "J_1" => 5.99e-4,
            "J_2" => 4.033e-5,
            "g" => 9.81,
            "a_c" => 0.0115,
            "a_s" => 0.0,
            "coulomb-friction@joint1" => 6.03e-4,
            "viscous-friction@joint2" => 6.145e-5,
            other => panic!("{other}"),
        };
        let all: Vec<f64> = mechanism.parameters.iter().map(|p| physical(&p.name)).collect();
        let parameter = |c: &Coefficient| {
            let value = mechanism.value(&c.name, &all).unwrap();
            let wrong = if c.name == "phi2_m2_e2_g" { 1.004 } else { 1.0 };
            Parameter { name: c.name.clone(), value: wrong * value, std_error: 1e-4, unit: String::new() }
        };
        let bent = IdentifiedModel {
            name: rig.name.clone(),
            system: System::Own(toml::Table::new()),
            method: "shooting".to_owned(),
            drive_frequency_hz: Some(5.0),
            nominal: Vec::new(),
            parameters: mechanism.coefficients.iter().map(parameter).collect(),
            effects: Vec::new(),
            found_with: Default::default(),
        };
        let inertias = |model: &IdentifiedModel| {
            let of = |name: &str| model.parameter(name).unwrap().value;
            let lever = 0.04 * 0.0267;
            let second = [9.81 * lever / of("phi2_m2_e2_g"), 0.0635 * lever / of("phi2_l1_m2_e2")];
            let damping = of("phi1_viscous_friction_joint2") / of("phi2_viscous_friction_joint2");
            [second[0] / second[1], damping * 0.0635 * lever / of("phi1_l1_m2_e2") / second[1]]
        };
        let (before, after) = (inertias(&bent), inertias(&tied(&own, bent.clone())));
        assert!((before[0] - 1.0 / 1.004).abs() < 1e-9, "{before:?}");
        assert!(after.iter().all(|ratio| (ratio - 1.0).abs() < 1e-9), "{after:?}");
    }
}
