//! Explanations for the built-in double pendulum: the system file that ships with the program, told
//! in the built-in's terms.
//!
//! Its equations are over Ω² and in derivatives by τ = Ω t, (3.4); those of the file are divided by
//! their inertias only. A coefficient x of the file is B = ± x/Ω^k there, with k and the sign of
//! `COEFFICIENTS` and `dampings`.

use super::Settings;
use super::explanation::Explanation;
use super::{decidability, engine};
use crate::error::{BadInput, Result};
use crate::identify::Parameter;
use crate::identify::model_file::{check_double_pendulum as checked, own_keys};
use crate::identify::system::System as Known;
use crate::model::double_pendulum::DAMPINGS;
use crate::model::identified::{IdentifiedModel, System};
use crate::motion::built_in::{is_earlier, physical};
use crate::record::Record;
use crate::rig::measures::ObservedModel;
use crate::rig::{Rig, as_own};
use crate::system::library::Pendulum;

/// Coefficients of (3.4), those of the system file, the power of Ω between them, and the sign.
const COEFFICIENTS: [(&str, &str, i32, f64); 10] = [
    ("B11", "phi1_l1_m2_e2", 0, 1.0),
    ("B12", "phi1_m1_e1_g", 2, 1.0),
    ("B13", "phi1_m1_e1_a_c", 0, -1.0),
    ("B14", "phi1_m1_e1_a_s", 0, -1.0),
    ("B21", "phi2_l1_m2_e2", 0, 1.0),
    ("B22", "phi2_m2_e2_g", 2, 1.0),
    ("B23", "phi2_m2_e2_a_c", 0, -1.0),
    ("B24", "phi2_m2_e2_a_s", 0, -1.0),
    ("B16", "phi1_m1_e1_scale", 2, 1.0),
    ("B26", "phi2_m2_e2_scale", 2, 1.0),
];

/// The same of the dampings: name in (3.4), name in the system file, power of Ω.
fn dampings() -> impl Iterator<Item = (&'static str, String, i32)> {
    DAMPINGS.iter().flat_map(|d| {
        let of = move |(i, name): (usize, Option<&'static str>)| {
            let file = format!("phi{}_{}", i + 1, d.id.replace(['-', '@'], "_"));
            Some((name?, file, if d.viscous { 1 } else { 2 }))
        };
        d.names.into_iter().enumerate().filter_map(of)
    })
}

/// Coefficients in each other's terms: name here, name in the file, and what a value of the file is
/// multiplied with.
fn terms(omega: f64) -> Vec<(&'static str, String, f64)> {
    let base = COEFFICIENTS.iter().map(|(name, file, k, sign)| (*name, (*file).to_owned(), sign / omega.powi(*k)));
    base.chain(dampings().map(|(name, file, k)| (name, file, 1.0 / omega.powi(k)))).collect()
}

/// A model in the terms of the system file.
fn in_file(model: &IdentifiedModel, rig: &Rig, bound: &ObservedModel) -> Result<IdentifiedModel> {
    let mut out = model.clone();
    out.system = System::Own(own_keys(&bound.model)?);
    out.nominal.clear();
    out.parameters = terms(rig.omega())
        .into_iter()
        .filter_map(|(name, file, factor)| {
            let p = model.parameter(name)?;
            let (value, std_error) = (p.value / factor, (p.std_error / factor).abs());
            Some(Parameter { name: file, value, std_error, unit: String::new() })
        })
        .collect();
    let mechanism = bound.model.mechanism.as_deref();
    if let (true, false, Some(mechanism)) = (is_earlier(model), model.effects.is_empty(), mechanism) {
        let values = physical(model, rig, mechanism, 0)?;
        let names = mechanism.file.iter().flat_map(|f| &f.parameters);
        out.found_with.extend(names.zip(values).map(|(p, v)| (p.name.clone(), v)));
    }
    Ok(out)
}

/// A rig and a model of it in the built-in's terms as those of the system file.
///
/// # Errors
/// A model of another system, channels that do not measure both angles.
pub fn own(model: &IdentifiedModel, rig: &Rig) -> Result<(Rig, IdentifiedModel)> {
    checked(model).map_err(|e| e.at("--model").remedy("Give a model that was identified on this rig"))?;
    let own_rig = as_own::double_pendulum_of_bodies(rig, &model.nominal)?;
    let bound = own_rig.bound.as_ref().ok_or_else(|| no_channel(rig))?;
    let model = in_file(model, rig, bound)?;
    Ok((own_rig, model))
}

fn no_channel(rig: &Rig) -> BadInput {
    BadInput::new("no channel", "channels that measure both angles").in_file(&rig.path).at("channel")
}

/// Parameters of an explanation as the non-dimensional coefficients of (3.4), by their names, then
/// dampings and effects in physical units as they were added.
///
/// Without a drive they have the units of time that they were found with.
pub fn to_non_dimensional(parameters: &mut [Parameter], rig: &Rig) {
    for (name, file, factor) in terms(rig.omega()) {
        if let Some(p) = parameters.iter_mut().find(|p| p.name == file) {
            name.clone_into(&mut p.name);
            (p.value, p.std_error) = (p.value * factor, (p.std_error * factor).abs());
            if rig.drive.is_some() {
                if name.ends_with('6') { "s²/m" } else { "1" }.clone_into(&mut p.unit);
            }
        }
    }
    parameters.sort_by(|a, b| match (a.name.contains('@'), b.name.contains('@')) {
        (false, false) => a.name.cmp(&b.name),
        (a, b) => a.cmp(&b),
    });
}

/// Explains one or several records of a double pendulum.
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
        None => (as_own::double_pendulum_of_bodies(rig, &nominal)?, None),
    };
    let bound = own_rig.bound.clone().ok_or_else(|| no_channel(rig))?;
    let settings = Settings { model, ..settings.clone() };
    let mut out = engine::explain(records, &own_rig, &bound, &settings)?.unwrap_or_else(decidability::unplaced);
    to_non_dimensional(&mut out.parameters, rig);
    to_non_dimensional(&mut out.parameters_before, rig);
    if let Some(model) = &mut out.model {
        model.system = System::BuiltIn(Pendulum::Double.id().to_owned());
        model.nominal = nominal;
        to_non_dimensional(&mut model.parameters, rig);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::model::double_pendulum_dynamics::DoublePendulum;
    use crate::model::dynamics::{Dynamics, Instant};
    use crate::model::model_file::equations_of_motion::EquationsOfMotion;

    /// Coefficients of the file have the accelerations of (3.4) with those that they are told as,
    /// driven and free, with every damping.
    #[test]
    fn the_system_file_moves_as_the_built_in_equations_do() {
        for drive in ["[drive]\ndirection = \"vertical\"\nfrequency_hz = 5.0\n", ""] {
            let channel = |name: &str, what: &str| {
                format!("[[channel]]\nname = \"{name}\"\nmeasures = \"{what}\"\nunit = \"rad\"\n")
            };
            let text = format!(
                "name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n{drive}{}{}",
                channel("a", "theta2"),
                channel("b", "theta1")
            );
            let rig = Rig::parse(&text, Path::new("rig.toml")).unwrap();
            let nominal: Vec<String> = DAMPINGS.iter().map(|d| d.id.to_owned()).collect();
            let own = as_own::double_pendulum_of_bodies(&rig, &nominal).unwrap();
            let bound = own.bound.unwrap();
            // Encoder 1 is that of arm 1.
            assert_eq!(bound.sensors, [1, 0]);
            let motion = EquationsOfMotion::new(&bound.model, rig.omega()).unwrap();
            // Couplings of arms that there may be: B11 B21 < 1.
            let value = |(k, n): (usize, &String)| if n.ends_with("l1_m2_e2") { 0.4 } else { 0.3 + 0.17 * k as f64 };
            let values: Vec<f64> = motion.coefficients().iter().enumerate().map(value).collect();
            let named = motion.coefficients().iter().zip(&values);
            let mut parameters: Vec<Parameter> = named
                .map(|(n, v)| Parameter { name: n.clone(), value: *v, std_error: 0.0, unit: String::new() })
                .collect();
            to_non_dimensional(&mut parameters, &rig);
            let all: Vec<_> = DAMPINGS.iter().collect();
            let built_in = DoublePendulum::new(rig.omega(), rig.drive.is_some(), &all);
            let of = |n: &String| parameters.iter().find(|p| p.name == *n).unwrap_or_else(|| panic!("{n}")).value;
            let built_in_values: Vec<f64> = built_in.names().iter().map(of).collect();
            assert_eq!(parameters.len(), built_in_values.len());
            for (q, v, tau) in [([0.3, 2.0], [1.5, -4.0], 0.7), ([-2.0, 7.0], [-3.0, 20.0], 2.9)] {
                let at = Instant { time: 0.0, tau, inputs: &[] };
                let (mut a, mut b) = ([0.0; 2], [0.0; 2]);
                assert!(motion.acceleration(&values, &q, &v, &at, &mut a));
                assert!(built_in.acceleration(&built_in_values, &q, &v, &at, &mut b));
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9 * (1.0 + b.abs())), "{a:?} {b:?}");
            }
        }
    }

    /// Where the base is measured, coefficients of the file are those of (3.4) with B16 and B26.
    #[test]
    fn a_measured_base_moves_the_file_s_arms_as_the_written_ones() {
        let channel = |name: &str, what: &str, unit: &str| {
            format!("[[channel]]\nname = \"{name}\"\nmeasures = \"{what}\"\nunit = \"{unit}\"\n")
        };
        let channels =
            [channel("y", "base", "m/s2"), channel("a", "theta1", "rad"), channel("b", "theta2", "rad")].concat();
        for drive in ["[drive]\ndirection = \"vertical\"\nfrequency_hz = 5.0\n", ""] {
            let text = format!("name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n{drive}{channels}");
            let rig = Rig::parse(&text, Path::new("rig.toml")).unwrap();
            let nominal: Vec<String> = DAMPINGS.iter().map(|d| d.id.to_owned()).collect();
            let own = as_own::double_pendulum_of_bodies(&rig, &nominal).unwrap().bound.unwrap();
            assert_eq!((own.sensors.as_slice(), own.inputs.as_slice(), own.base), (&[1, 2][..], &[0][..], Some(0)));
            let motion = EquationsOfMotion::new(&own.model, rig.omega()).unwrap();
            let value = |(k, n): (usize, &String)| if n.ends_with("l1_m2_e2") { 0.4 } else { 0.3 + 0.17 * k as f64 };
            let values: Vec<f64> = motion.coefficients().iter().enumerate().map(value).collect();
            let named = motion.coefficients().iter().zip(&values);
            let mut parameters: Vec<Parameter> = named
                .map(|(n, v)| Parameter { name: n.clone(), value: *v, std_error: 0.0, unit: String::new() })
                .collect();
            to_non_dimensional(&mut parameters, &rig);
            let all: Vec<_> = DAMPINGS.iter().collect();
            let written = as_own::double_pendulum(&rig, &all).unwrap().bound.unwrap();
            let plain = EquationsOfMotion::new(&written.model, rig.omega()).unwrap();
            let of = |n: &String| parameters.iter().find(|p| p.name == *n).unwrap_or_else(|| panic!("{n}")).value;
            let plain_values: Vec<f64> = plain.coefficients().iter().map(of).collect();
            assert_eq!(parameters.len(), plain_values.len());
            for (q, v, base) in [([0.3, 2.0], [1.5, -4.0], 7.3), ([-2.0, 7.0], [-3.0, 20.0], -12.0)] {
                let at = Instant { time: 0.0, tau: 0.4, inputs: &[base] };
                let (mut a, mut b) = ([0.0; 2], [0.0; 2]);
                assert!(motion.acceleration(&values, &q, &v, &at, &mut a));
                assert!(plain.acceleration(&plain_values, &q, &v, &at, &mut b));
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9 * (1.0 + b.abs())), "{a:?} {b:?}");
            }
        }
    }
}
