//! Whether what is said to be known of a system from bodies agrees with the record.
//!
//! What is known is held fixed where parameters are found ([`crate::system::ties`]). Where more is
//! known than that needs, each quantity is found once more without being known itself: (found −
//! known) over the standard error has Student's t distribution over the jackknife's blocks, the
//! standard error widened by how much the ties are missed all the same. Of several that disagree
//! those are told without which the others agree.
//!
//! A measured input beside it: read γ times too large, it leaves γ⁻¹ of the coefficients of its
//! terms (or γ of all others, where it stands without one). The γ at which the ties are missed least
//! with everything known is told where it does as well.
//!
//! Sensors of lengths that all read γ times what they show make gravity γ times what it is: told
//! beside it and the clock.
//!
//! Where two quantities are wrong, neither explains the other: [`super::known_jointly`].

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::judgement::{CHANCE, Coefficients, Ties};
use super::known_jointly;
use super::known_quantities::{CONTRADICTED, time_base};
use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::units::Unit;
use crate::rig::Rig;
use crate::system::mechanism::Mechanism;
use crate::system::ties::{self, Identified};
use crate::warning::Warning;
use crate::wording::format::{quantity, significant};
use crate::wording::names::listed;

/// Factor on the least misfit within which another quantity stands as well for the disagreement.
const AS_WELL: f64 = 2.0;

/// A quantity that disagrees.
struct Disagreeing<'a> {
    name: &'a str,
    unit: String,
    known: f64,
    found: f64,
    /// What the ties miss by without it, over its degrees of freedom; those of chance are 1.
    misfit: f64,
}

/// The test of the ties between coefficients of a system from bodies, whatever is known; none where
/// there are none, or too few blocks to judge.
pub(super) fn ties(mechanism: &Mechanism, c: &Coefficients<'_>) -> Option<Ties> {
    let b = Identified { names: c.names, values: &c.values, covariance: &c.covariance, metric: &c.covariance };
    if is_singular(c) {
        return None;
    }
    let fit = ties::fit(mechanism, &b, &BTreeMap::new())?;
    Ties::of(fit.misfit, fit.freedom, c.blocks)
}

/// Whether a jackknife's covariance is of no more blocks than coefficients: in the directions that it
/// does not have any distance is without end.
fn is_singular(c: &Coefficients<'_>) -> bool {
    c.blocks <= c.names.len()
}

/// The disagreement of a quantity with everything else; none where nothing else fixes it, where
/// chance would do, or where blocks are too few to say.
fn disagreeing<'a>(
    mechanism: &Mechanism,
    c: &Coefficients<'_>,
    known: &BTreeMap<&'a str, f64>,
    name: &'a str,
) -> Option<Disagreeing<'a>> {
    let b = Identified { names: c.names, values: &c.values, covariance: &c.covariance, metric: &c.covariance };
    if is_singular(c) {
        return None;
    }
    let mut others = known.clone();
    let value = others.remove(name)?;
    let fit = ties::fit(mechanism, &b, &others)?;
    let found = fit.found.iter().find(|p| p.name == name)?;
    let misfit = if fit.freedom > 0 { (fit.misfit / fit.freedom as f64).max(1.0) } else { 1.0 };
    let t = (found.value - value).abs() / (misfit.sqrt() * found.std_error);
    let chance = 2.0 * StudentsT::new(0.0, 1.0, (c.blocks - 1) as f64).ok()?.sf(t);
    (chance < CHANCE).then(|| Disagreeing { name, unit: found.unit.clone(), known: value, found: found.value, misfit })
}

/// A scale of a measured input with which everything that is known agrees.
pub(super) struct Scaled {
    pub(super) input: String,
    /// γ: what is read over what acts.
    pub(super) factor: f64,
    /// What the ties miss by, over its degrees of freedom; those of chance are 1.
    pub(super) misfit: f64,
}

/// Greatest factor on an input that is looked for, and evaluations of the search.
const MOST_SCALED: f64 = 2.0;
const EVALUATIONS: usize = 40;

/// Powers of an input's scale by which coefficients are found too small: 1 for those of its terms,
/// or −1 for all others. None where terms with and without the input share a coefficient.
fn scaled_by(model: &ModelFile, names: &[String], input: usize) -> Option<Vec<f64>> {
    let own = |s: Symbol| matches!(s, Symbol::Input(k) | Symbol::RawInput(k) | Symbol::InputRate(k) if k == input);
    let beside = model.equations.iter().any(|e| e.balance.any(&own));
    let terms = || model.equations.iter().flat_map(|e| &e.terms);
    let with = |name: &String| terms().filter(|t| t.name == *name).any(|t| t.of.any(&own));
    let without = |name: &String| terms().filter(|t| t.name == *name).any(|t| !t.of.any(&own));
    let mixed = names.iter().any(|name| with(name) && (beside || without(name)));
    let exponents = names.iter().map(|name| if with(name) { 1.0 } else { -f64::from(u8::from(beside)) }).collect();
    (!mixed && (beside || names.iter().any(with))).then_some(exponents)
}

/// The scale of an input that agrees best with everything that is known.
pub(super) fn scaled(
    mechanism: &Mechanism,
    c: &Coefficients<'_>,
    known: &BTreeMap<&str, f64>,
    (model, input): (&ModelFile, usize),
) -> Option<Scaled> {
    let exponents = scaled_by(model, c.names, input)?;
    let at = |log: f64| {
        let by = DVector::from_iterator(exponents.len(), exponents.iter().map(|e| (e * log).exp()));
        let values = c.values.component_mul(&by);
        let covariance = DMatrix::from_fn(by.len(), by.len(), |i, j| by[i] * c.covariance[(i, j)] * by[j]);
        let b = Identified { names: c.names, values: &values, covariance: &covariance, metric: &covariance };
        ties::fit(mechanism, &b, known)
            .map_or(f64::INFINITY, |fit| fit.misfit / fit.freedom.saturating_sub(1).max(1) as f64)
    };
    let most = MOST_SCALED.ln();
    let log = least_of(&at, [-most, most], EVALUATIONS);
    // At the edge it is not the least.
    (log.abs() < 0.99 * most).then(|| Scaled {
        input: model.inputs[input].clone(),
        factor: log.exp(),
        misfit: at(log).max(1.0),
    })
}

/// Where a function with one least value in an interval has it, by golden section.
fn least_of(at: &impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2], evaluations: usize) -> f64 {
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let inner = |low: f64, high: f64| (high - golden * (high - low), low + golden * (high - low));
    let (mut left, mut right) = inner(low, high);
    let (mut at_left, mut at_right) = (at(left), at(right));
    for _ in 2..evaluations {
        if at_left < at_right {
            (high, right, at_right) = (right, left, at_left);
            left = inner(low, high).0;
            at_left = at(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = inner(low, high).1;
            at_right = at(right);
        }
    }
    0.5 * (low + high)
}

/// Whether a value may be taken instead of a known one: masses, lengths and inertias keep their
/// sign.
pub(super) fn can_be(found: f64, known: f64, unit: &str) -> bool {
    let signed = ["kg", "m", "mm", "kg m", "kg m²", "kg m^2"].contains(&unit);
    !signed || found * known > 0.0
}

/// Units of inputs that are motions.
const MOTION: [&str; 3] = ["m", "m/s", "m/s2"];

/// Sensors of lengths, where gravity alone of what is known has a length in it: all of them read γ
/// times what they show make it γ times what it is, and nothing else.
fn lengths(mechanism: &Mechanism, rig: &Rig, known: &BTreeMap<&str, f64>) -> Vec<usize> {
    let Some(bound) = rig.bound.as_ref() else { return Vec::new() };
    // A measured force beside masses that are open makes these as much smaller.
    let inputs: Vec<&str> = bound.inputs.iter().map(|c| rig.channel[*c].si_unit()).collect();
    let open = known.keys().all(|name| *name == "g");
    if inputs.iter().any(|unit| !open || MOTION.contains(unit)) {
        return Vec::new();
    }
    let kilogram = Unit::of_channel("kg");
    let is_mass = |name: &&str| {
        let own = mechanism.parameters.iter().map(|p| (&p.name, &p.unit));
        let quantities = mechanism.quantities.iter().map(|q| (&q.name, &q.unit));
        own.chain(quantities).any(|(n, unit)| n == name && *unit == kilogram)
    };
    if rig.drive.is_some() || !known.keys().all(|name| *name == "g" || is_mass(name)) {
        return Vec::new();
    }
    let sensors = bound.sensors.iter().enumerate();
    sensors.filter(|(_, channel)| rig.channel[**channel].si_unit() == "m").map(|(k, _)| k).collect()
}

/// That sensors of lengths read so many times what they show.
fn lengths_read(rig: &Rig, sensors: &[usize], factor: f64) -> Option<String> {
    let bound = rig.bound.as_ref()?;
    let names: Vec<String> = sensors.iter().map(|k| rig.channel[bound.sensors[*k]].measures.clone()).collect();
    let factor = significant(factor, 4);
    match &names[..] {
        [] => None,
        [one] => Some(format!("{one} reads {factor} times what it is (its sensor's scale)")),
        all => Some(format!("{} read {factor} times what they are (their sensors' scale)", listed(all))),
    }
}

/// A warning where something that is said to be known does not agree with the record.
pub(super) fn contradicted(mechanism: &Mechanism, c: &Coefficients<'_>, rig: &Rig) -> Option<Warning> {
    let known = mechanism.known(&rig.known, rig.says_gravity());
    if c.blocks < 3 {
        return None;
    }
    let mut all: Vec<Disagreeing<'_>> =
        known.keys().filter_map(|name| disagreeing(mechanism, c, &known, name)).collect();
    let least = all.iter().map(|d| d.misfit).fold(f64::INFINITY, f64::min);
    all.retain(|d| d.misfit <= AS_WELL * least);
    // Gravity is the last to be wrong, but a clock that is off looks like it: measured κ times too
    // long, time makes every acceleration, and so g, κ⁻² of what it is.
    let gravity = all.iter().find(|d| d.name == "g").map(|d| d.found / d.known);
    let clock = gravity.map(|g| (1.0 / g).sqrt()).filter(|k| k.is_finite());
    if all.iter().any(|d| d.name != "g") {
        all.retain(|d| d.name != "g");
    }
    let Some(first) = all.first() else {
        return known_jointly::contradicted(mechanism, c, rig.bound.as_ref().map(|b| &*b.model), &known);
    };
    let model = rig.bound.as_ref().map(|b| &b.model);
    let inputs = model.iter().flat_map(|m| (0..m.inputs.len()).map(|k| (&***m, k)));
    let gains: Vec<Scaled> =
        inputs.filter_map(|i| scaled(mechanism, c, &known, i)).filter(|s| s.misfit <= AS_WELL * least).collect();
    let told = |d: &Disagreeing<'_>| {
        format!("{} = {} instead of {}", d.name, quantity(d.found, &d.unit, 4), quantity(d.known, &d.unit, 4))
    };
    let names: Vec<&str> = all.iter().map(|d| d.name).collect();
    let can: Vec<_> = all.iter().filter(|d| can_be(d.found, d.known, &d.unit)).collect();
    let mut alternatives: Vec<String> = can.iter().copied().map(told).collect();
    if let Some(factor) = clock {
        alternatives.push(time_base(factor, rig.drive.is_some()));
    }
    let lengths = gravity.map(|g| (lengths(mechanism, rig, &known), g));
    alternatives.extend(lengths.as_ref().and_then(|(sensors, g)| lengths_read(rig, sensors, *g)));
    alternatives.extend(
        gains
            .iter()
            .map(|s| format!("{} reads {} times what acts (its sensor's scale)", s.input, significant(s.factor, 4))),
    );
    let agree = match &alternatives[..] {
        [] => "No value that can be would agree: a sign, a scale or two exchanged columns may be wrong".to_owned(),
        [one] => format!("This would agree: {one}"),
        all => format!("One of these would agree: {}", all.join("; or ")),
    };
    let text = format!(
        "[known] {} {} with the record by {} %. {agree}",
        names.join(", "),
        if names.len() == 1 { "disagrees" } else { "disagree" },
        significant(100.0 * (first.known / first.found - 1.0).abs(), 2),
    );
    let scales = gains.iter().map(|s| (format!("input-gain@{}", s.input), (s.factor - 1.0).into()));
    let clock = clock.map(|factor| ("time-base".to_owned(), factor.into()));
    let of_lengths = lengths.iter().flat_map(|(sensors, g)| sensors.iter().map(move |k| (k + 1, g - 1.0)));
    let scales = scales.chain(of_lengths.map(|(k, error)| (format!("scale-error@encoder{k}"), error.into())));
    let values: serde_json::Map<String, serde_json::Value> =
        can.iter().map(|d| (d.name.to_owned(), d.found.into())).chain(clock).chain(scales).collect();
    let advice = "Measure them again, check their units (metres, kilograms), and correct the rig file";
    Some(Warning::new(CONTRADICTED, text, advice).invalidating().with("would_agree", values))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::model::model_file::toml_place::Source;

    const TEXT: &str = r#"name = "pendulum on a shaken bar"
coordinates = { th = "angle" }
inputs = { base = "m/s^2" }
gravity = "down"
parameters = { J = "kg m^2", S = "kg m" }
[points]
p = "[0, 0]"
[[body]]
name = "arm"
from = "p"
angle = "th"
first_moment = "S"
inertia = "J"
[[joint]]
name = "hinge"
at = "p"
moves = "th"
[[force]]
does_work_on = "sin(th)"
value = "-S*base"
[nominal]
effects = ["viscous-friction@hinge"]
"#;

    #[test]
    fn a_length_of_the_other_sign_is_no_remedy() {
        assert!(!can_be(-0.0852, 0.15, "m") && !can_be(-0.1, 0.2, "kg") && !can_be(-1e-3, 2e-3, "kg m²"));
        assert!(can_be(0.0852, 0.15, "m") && can_be(-1.0, 2.0, "N m"));
    }

    /// An accelerometer that reads 1.05 times what acts makes gravity 1.05 times what it is.
    #[test]
    fn an_inputs_scale_agrees_where_it_does_as_well() {
        let source = Source { text: TEXT.to_owned(), path: Path::new("p.toml").to_path_buf() };
        let model = crate::system::model_of(source, None, 1.0).unwrap();
        let mechanism = model.mechanism.clone().unwrap();
        let truth: Vec<f64> = mechanism
            .parameters
            .iter()
            .map(|p| match p.name.as_str() {
                "J" => 0.04,
                "S" => 0.11,
                "g" => 9.81,
                _ => 0.003,
            })
            .collect();
        let names: Vec<String> = mechanism.coefficients.iter().map(|c| c.name.clone()).collect();
        let powers = scaled_by(&model, &names, 0).unwrap();
        assert_eq!(powers.iter().filter(|p| **p == 1.0).count(), 1, "{names:?} {powers:?}");
        let true_value = |k: usize| mechanism.value(&names[k], &truth).unwrap();
        let values = DVector::from_fn(names.len(), |k, _| true_value(k) * 1.05_f64.powf(-powers[k]));
        let covariance = DMatrix::from_diagonal(&values.map(|x| (1e-3 * x).powi(2)));
        let c = Coefficients { names: &names, values, covariance, blocks: 30 };
        let known = BTreeMap::from([("J", 0.04), ("g", 9.81)]);
        let g = disagreeing(&mechanism, &c, &known, "g").unwrap();
        assert!((g.found - 1.05 * 9.81).abs() < 1e-3, "{}", g.found);
        let base = scaled(&mechanism, &c, &known, (&model, 0)).unwrap();
        assert!((base.factor - 1.05).abs() < 1e-4 && base.misfit <= AS_WELL * g.misfit, "{}", base.factor);
    }
}
