//! Explanations for the built-in single pendulum: its equation written out, explained as a system
//! of one's own, told in the built-in's terms.
//!
//! The nominal model is θ″ with the rig file's dampings, gravity and the drive in its direction;
//! what the identification adds to that (motion across the drive, a centroid off the arm's line)
//! are effects here. Places: `joint1`, `arm1`, `encoder1`, `drive`, `frame`.
//!
//! Values are physical where `[known]` has `J_o1`, or m1 e1 from which gravity gives it, otherwise
//! divided by it.

use std::collections::BTreeMap;

use super::Settings;
use super::explanation::Explanation;
use super::{decidability, engine};
use crate::effects::catalogue;
use crate::effects::columns::LOAD;
use crate::effects::entry::{Entry, Verb};
use crate::error::{BadInput, Result};
use crate::identify::model_file::own_keys;
use crate::identify::system::System as Known;
use crate::identify::weak_form;
use crate::model::identified::{IdentifiedModel, RECORD_S, System};
use crate::model::single_pendulum::DAMPINGS;
use crate::record::Record;
use crate::rig::{Direction, Rig, as_own};
use crate::system::library::Pendulum;

/// The coordinate in the equation as it is written out.
const ANGLE: &str = "phi1";

/// Names of the coefficients of some dampings.
fn coefficients(dampings: &[String]) -> Vec<&'static str> {
    DAMPINGS.iter().filter(|d| dampings.iter().any(|n| n == d.id)).filter_map(|d| d.names[0]).collect()
}

/// A rig and a model of it in the built-in's terms as those of a system of one's own.
///
/// # Errors
/// A model of another system, a damping that there is not.
pub fn own(model: &IdentifiedModel, rig: &Rig) -> Result<(Rig, IdentifiedModel)> {
    let bad = |found: String, expected: &str| {
        Err(BadInput::new(found, expected).at("model").remedy("Give a model that was identified on this rig"))
    };
    let expected = format!("a model of \"{}\"", Pendulum::Single.id());
    match &model.system {
        own if own.pendulum() == Some(Pendulum::Single) => {}
        System::BuiltIn(id) => return bad(format!("a model of \"{id}\""), &expected),
        System::Own(_) => return bad("a system of its own".to_owned(), &expected),
    }
    if let Some(n) = model.nominal.iter().find(|n| !DAMPINGS.iter().any(|d| d.id == *n)) {
        return bad(format!("\"{n}\" in nominal"), "viscous-friction@joint1, coulomb-friction@joint1");
    }
    let across = match rig.drive.map(|d| d.direction) {
        Some(Direction::Vertical) => ["n_cos", "p_cos"],
        _ => ["n_sin", "p_sin"],
    };
    let all = model.parameter("q_cos").is_some() || across.iter().any(|n| model.parameter(n).is_some());
    let rig = written(rig, &model.nominal, all)?;
    let Some(bound) = &rig.bound else { return bad("no channel".to_owned(), "a channel that measures theta1") };
    let mut out = model.clone();
    out.system = System::Own(own_keys(&bound.model)?);
    out.nominal.clear();
    // What the engine of driven ones found has its places already.
    let placed = out.found_with.contains_key(RECORD_S);
    for e in out.effects.iter_mut().filter(|_| !placed) {
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
        None => (written(rig, &nominal, false)?, None),
    };
    let settings = Settings { model, ..settings.clone() };
    let mut out = as_own_system(records, rig, own_rig, &settings)?;
    for found in &mut out.effects {
        // Without a drive nothing tells a turned frame from a turned centroid or scale; under one
        // nothing tells the last two.
        let alike = ["imbalance@arm1", "zero-offset@encoder1", "frame-tilt@frame"];
        let alike = if rig.drive.is_some() { &alike[..2] } else { &alike[..] };
        let name = found.name();
        if alike.contains(&name.as_str()) {
            for same in alike.iter().filter(|n| **n != name) {
                if !found.indistinguishable_from.iter().any(|x| x == same) {
                    found.indistinguishable_from.push((*same).to_owned());
                }
            }
        }
    }
    if let Some(model) = &mut out.model {
        model.system = System::BuiltIn(Pendulum::Single.id().to_owned());
        model.nominal = nominal;
    }
    Ok(out)
}

/// The rig with its equation written out; its inertia is found below, nothing else is known there.
fn written(rig: &Rig, nominal: &[String], all: bool) -> Result<Rig> {
    let own = as_own::single_pendulum(rig, &coefficients(nominal), all)?;
    Ok(Rig { known: BTreeMap::new(), ..own })
}

fn no_channel(rig: &Rig) -> BadInput {
    BadInput::new("no channel", "a channel that measures theta1").in_file(&rig.path).at("channel")
}

/// Explained by every effect of the catalogue, values in torques where the inertia is known.
fn as_own_system(records: &[Record], rig: &Rig, mut own_rig: Rig, settings: &Settings) -> Result<Explanation> {
    let bound = own_rig.bound.clone().ok_or_else(|| no_channel(rig))?;
    let first = weak_form(records, &own_rig, &settings.weak)?;
    let gravity = first.parameter("q_sin").map_or(f64::NAN, |p| p.value);
    if let Some(j) = inertia(rig, gravity) {
        let _ = own_rig.known.insert(format!("J_{ANGLE}"), j);
    }
    let mut out = engine::explain(records, &own_rig, &bound, settings)?.unwrap_or_else(decidability::unplaced);
    // Gravity as the whole model has it, not the nominal one, tells the inertia.
    let last = out.parameters.iter().find(|p| p.name == "q_sin").map_or(gravity, |p| p.value);
    let factor = inertia(rig, last).zip(inertia(rig, gravity)).map_or(1.0, |(a, b)| a / b);
    let entry = |id: &str| catalogue().iter().chain(rig.effects.iter().map(AsRef::as_ref)).find(|e| e.id == id);
    for e in &mut out.effects {
        rescale(factor, entry(&e.id), &mut e.value, &mut e.std_error, &mut e.parameters);
    }
    for e in out.model.iter_mut().flat_map(|m| &mut m.effects) {
        rescale(factor, entry(&e.id), &mut e.value, &mut e.std_error, &mut e.parameters);
    }
    for p in &mut out.parameters {
        if let Some((id, _)) = p.name.split_once('@') {
            rescale(factor, entry(id), &mut p.value, &mut p.std_error, &mut BTreeMap::new());
        }
    }
    Ok(out)
}

/// Multiplies what an effect tells in torques; one by a load is told as a length.
fn rescale(
    factor: f64,
    entry: Option<&Entry>,
    value: &mut f64,
    std_error: &mut f64,
    parameters: &mut BTreeMap<String, f64>,
) {
    let Some(entry) = entry.filter(|e| e.verb == Verb::Force && !e.names(LOAD)) else { return };
    let is_shape = |name: &String| entry.shapes.iter().any(|s| s.name == *name);
    if !entry.value.as_ref().is_some_and(is_shape) {
        *value *= factor;
        *std_error *= factor.abs();
    }
    for (name, _) in entry.also.iter().filter(|(_, law)| entry.strengths.contains(law)) {
        if let Some(x) = parameters.get_mut(name) {
            *x *= factor;
        }
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::model::dynamics::{Dynamics, Instant};
    use crate::motion::Motion;
    use crate::record::{Column, Segment};

    /// Counts to a turn.
    const COUNTS: f64 = 4096.0;
    const STEP_S: f64 = 0.005;
    /// Gravity and viscous friction of the pendulum, over its inertia.
    const TRUTH: [f64; 2] = [41.923, 0.0678];

    /// Half a minute of a free pendulum whose encoder's zero is off.
    fn record(rig: &Rig, off: f64) -> Record {
        let [q, c] = TRUTH;
        let rate = |[x, v]: [f64; 2]| [v, -q * x.sin() - c * v];
        let moved = |s: [f64; 2], by: f64, r: [f64; 2]| [s[0] + by * r[0], s[1] + by * r[1]];
        let (mut state, h) = ([1.9, 0.0], STEP_S / 4.0);
        let mut counts = Vec::new();
        for _ in 0..6000 {
            counts.push(((state[0] + off) * COUNTS / core::f64::consts::TAU).floor() as i32);
            for _ in 0..4 {
                let k1 = rate(state);
                let k2 = rate(moved(state, 0.5 * h, k1));
                let k3 = rate(moved(state, 0.5 * h, k2));
                let k4 = rate(moved(state, h, k3));
                state = [0, 1].map(|i| state[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
            }
        }
        Record::of("(simulated)", rig, vec![Segment::new(0.0, STEP_S, vec![Column::Counts(counts)])])
    }

    fn rig() -> Rig {
        let text = format!(
            "name = \"p\"\nmodel = \"single-pendulum\"\nsample_rate_hz = 200.0\n[[channel]]\nname = \"enc\"\n\
             measures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = {COUNTS}\n"
        );
        Rig::parse(&text, Path::new("rig.toml")).unwrap()
    }

    /// Gravity, friction and the angle are the record's.
    fn tells_the_truth(found: &Explanation, off: f64) {
        let is_off = |name: &str| name.starts_with("imbalance").then_some(-off);
        let truth = |name: &str| match name {
            "c_r" => Some(TRUTH[1]),
            "q_sin" => Some(TRUTH[0]),
            name => is_off(name),
        };
        let told: Vec<_> = found.parameters.iter().filter_map(|p| Some((p, truth(&p.name)?))).collect();
        assert_eq!(told.len(), 3, "{off}: {:?}", found.parameters);
        for (p, truth) in told {
            let misses = (p.value - truth).abs() / p.std_error;
            assert!(misses < 4.0, "{off}: {} {} ± {}, {truth}", p.name, p.value, p.std_error);
        }
    }

    /// Beside an angle by which the zero is off stands the gravity that there is, not its cosine's
    /// share of it; and the model is one of that pendulum, read again or explained once more.
    #[test]
    fn gravity_beside_a_zero_that_is_off_is_its_own() {
        let (rig, off) = (rig(), 0.03);
        let records = [record(&rig, off)];
        let found = explain(&records, &rig, &Settings::default()).unwrap();
        let names: Vec<String> = found.effects.iter().map(|e| e.name()).collect();
        assert_eq!(names, ["imbalance@arm1"], "{}", found.reason);
        tells_the_truth(&found, off);
        let model = IdentifiedModel::parse(&found.model.unwrap().to_toml()).unwrap();
        let motion = Motion::of(&model, Path::new("m.toml"), Some(&rig), 0.0).unwrap();
        let (equations, parameters) = motion.equations().unwrap();
        let (mut alpha, still) = ([0.0], Instant { time: 1.0, tau: 0.0, inputs: &[] });
        assert!(equations.acceleration(&parameters, &[0.7], &[0.0], &still, &mut alpha));
        let wanted = -model.parameter("q_sin").unwrap().value * (0.7 + model.effects[0].value).sin();
        assert!((alpha[0] / wanted - 1.0).abs() < 1e-12, "{alpha:?} {wanted}");
        let given = |model: &IdentifiedModel| Settings { model: Some(model.clone()), ..Settings::default() };
        let again = explain(&records, &rig, &given(&model)).unwrap();
        assert!(again.effects.is_empty() && again.gap.steps[0].value < 1.1, "{:?}", again.gap.steps);
        // Ten times as far off, from a model that is not.
        let mut near = model;
        (near.effects[0].value, near.effects[0].strengths) = (0.25, vec![0.25]);
        let far = explain(&[record(&rig, -0.3)], &rig, &given(&near)).unwrap();
        assert!(far.effects.is_empty(), "{:?}", far.effects);
        tells_the_truth(&far, -0.3);
    }
}
