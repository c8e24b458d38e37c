//! `[plant]` of a rig whose model is a file: true coefficients by name, initial state, inputs,
//! noise. Read by `simulate` alone.
//!
//! ```toml
//! [plant]
//! m = 1.0                              # every coefficient of the model, by name
//! k = 4.0
//! initial = [0.5, 0.0]                 # coordinates, then rates a second
//! noise = { position = 1e-5 }          # standard deviation of white noise, in the channel's unit
//! settle_s = 0.0                       # simulated before recording
//! input.force = [{ kind = "random", rms = 2.0, to_hz = 5.0 }]
//! ```

use std::collections::BTreeMap;

use serde::Deserialize;

use super::excitation::{Excitation, Signal};
use crate::error::{BadInput, Result};
use crate::model::model_file::ModelFile;
use crate::rig::{Rig, possible};
use crate::wording::format::several;
use crate::wording::toml_words;

/// Keys that are not coefficients.
const KEYS: [&str; 4] = ["initial", "noise", "settle_s", "input"];

/// The truth of a simulated system.
#[derive(Clone, Debug)]
pub struct Plant {
    /// Parameters of the system's file; none for a model file's coefficients.
    pub physical: Vec<f64>,
    /// Coefficients, in the model's order.
    pub coefficients: Vec<f64>,
    /// Coordinates, then rates.
    pub initial: Vec<f64>,
    /// Standard deviation of the noise of each channel, in its unit.
    pub noise: Vec<f64>,
    /// Time simulated before recording, s.
    pub settle_s: f64,
    /// Inputs, in the model's order.
    pub inputs: Vec<Signal>,
}

#[derive(Deserialize)]
struct File {
    plant: Option<toml::Table>,
}

/// A number of a table.
fn value(v: &toml::Value) -> Option<f64> {
    match v {
        toml::Value::Float(x) => Some(*x),
        toml::Value::Integer(i) => Some(*i as f64),
        _ => None,
    }
    .filter(|x| x.is_finite())
}

/// What a plant gives: the coefficients of a model file; for a system, its parameters, strengths of
/// its nominal effects, and the coefficients of its written equations.
fn truths(model: &ModelFile) -> Vec<String> {
    let Some(mechanism) = &model.mechanism else { return model.coefficients().to_vec() };
    let derived = |n: &String| mechanism.coefficients.iter().any(|c| c.name == *n);
    let parameters = mechanism.parameters.iter().enumerate().filter(|(k, _)| mechanism.takes_part(*k));
    let written = model.coefficients().iter().filter(|n| !derived(n)).cloned();
    parameters.map(|(_, p)| p.name.clone()).chain(written).collect()
}

/// The parameters of a system and the coefficients of a plant's truths.
fn coefficients(model: &ModelFile, names: &[String], given: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let of = |n: &str| names.iter().position(|x| x == n).map(|i| given[i]);
    let parameters: Vec<f64> =
        model.mechanism.iter().flat_map(|m| &m.parameters).map(|p| of(&p.name).unwrap_or(0.0)).collect();
    let derived = |n: &str| model.mechanism.as_ref().and_then(|m| m.value(n, &parameters));
    let all = model.coefficients().iter().map(|n| derived(n).or_else(|| of(n)).unwrap_or(f64::NAN)).collect();
    let own = model.mechanism.as_ref().and_then(|m| m.file.as_ref()).map_or(0, |f| f.parameters.len());
    (parameters[..own.min(parameters.len())].to_vec(), all)
}

impl Plant {
    /// Reads `[plant]` from a rig's text.
    ///
    /// # Errors
    /// Names the key, the value found and the one expected.
    pub fn of(rig: &Rig, model: &ModelFile, length_s: f64, seed: u64) -> Result<Self> {
        let bad = |place: &str, found: String, expected: String| {
            BadInput::new(found, expected)
                .in_file(&rig.path)
                .at(if place.is_empty() { "[plant]".to_owned() } else { format!("plant.{place}") })
                .remedy("Correct [plant]; see docs/model-file.md")
        };
        let file: File = toml::from_str(&rig.text)
            .map_err(|e| toml_words::told(&e, &rig.text, "a rig file", "docs/rig-file.md").in_file(&rig.path))?;
        let table = file
            .plant
            .ok_or_else(|| bad("", "no [plant]".to_owned(), "the simulated system's coefficients".to_owned()))?;
        let names = truths(model);
        if let Some(key) = table.keys().find(|k| !names.contains(k) && !KEYS.contains(&k.as_str())) {
            let known = format!("{}, {}", names.join(", "), KEYS.join(", "));
            return Err(bad(key, format!("an unknown key \"{key}\""), format!("one of {known}")));
        }
        let number = |key: &str| {
            table
                .get(key)
                .map(|v| value(v).ok_or_else(|| bad(key, v.to_string(), "a finite number".to_owned())))
                .transpose()
        };
        let given = names
            .iter()
            .map(|n| {
                let gravity = (n == "g").then(|| rig.known.get("g").copied()).flatten();
                number(n)?.or(gravity).ok_or_else(|| bad(n, "nothing".to_owned(), format!("the coefficient {n}")))
            })
            .collect::<Result<Vec<f64>>>()?;
        if let Some(mechanism) = &model.mechanism {
            let values = names.iter().map(String::as_str).zip(given.iter().copied());
            possible::check((&rig.path, &rig.text), "plant", mechanism, values)?;
        }
        let (physical, coefficients) = coefficients(model, &names, &given);
        let n = model.coordinates.len();
        let initial = match table.get("initial") {
            None => vec![0.0; 2 * n],
            Some(toml::Value::Array(a)) if a.len() == 2 * n && a.iter().all(|v| value(v).is_some()) => {
                a.iter().filter_map(value).collect()
            }
            Some(v) => {
                return Err(bad(
                    "initial",
                    v.to_string(),
                    format!(
                        "{} numbers: {}, then {}",
                        2 * n,
                        several(n, "coordinate"),
                        if n == 1 { "its rate" } else { "their rates" }
                    ),
                ));
            }
        };
        let mut noise = vec![0.0; rig.channel.len()];
        match table.get("noise") {
            None => {}
            Some(toml::Value::Table(t)) => {
                for (key, v) in t {
                    let Some(i) = rig.channel.iter().position(|c| c.name == *key) else {
                        return Err(bad("noise", format!("\"{key}\""), "names of channels".to_owned()));
                    };
                    noise[i] = value(v)
                        .filter(|x| *x >= 0.0)
                        .ok_or_else(|| bad("noise", v.to_string(), "a standard deviation, 0 or more".to_owned()))?;
                }
            }
            Some(v) => return Err(bad("noise", v.to_string(), "{ CHANNEL = standard deviation }".to_owned())),
        }
        let settle_s = number("settle_s")?.unwrap_or(0.0);
        if !(0.0..=3600.0).contains(&settle_s) {
            return Err(bad("settle_s", settle_s.to_string(), "0 to 3600 s".to_owned()));
        }
        let given: BTreeMap<String, Vec<Excitation>> = match table.get("input") {
            None => BTreeMap::new(),
            Some(v) => v.clone().try_into().map_err(|e: toml::de::Error| {
                let told = toml_words::told(&e, "", "plant.input", "docs/model-file.md");
                BadInput { place: Some("plant.input".to_owned()), ..told }.in_file(&rig.path)
            })?,
        };
        if let Some(key) = given.keys().find(|k| !model.inputs.contains(k)) {
            return Err(bad("input", format!("\"{key}\""), format!("one of {}", model.inputs.join(", "))));
        }
        let inputs = model
            .inputs
            .iter()
            .enumerate()
            .map(|(k, name)| {
                let parts = given.get(name).map_or(&[][..], Vec::as_slice);
                Signal::new(parts, length_s + settle_s, rig.sample_rate_hz, seed, k as u64)
                    .map_err(|e| bad(&format!("input.{name}"), e.found, e.expected))
            })
            .collect::<Result<_>>()?;
        Ok(Self { physical, coefficients, initial, noise, settle_s, inputs })
    }
}
