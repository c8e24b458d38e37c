//! Several known quantities that disagree with the record together, where none of them does alone.
//!
//! With everything known the ties are missed by T² (Hotelling; [`super::judgement::Ties`]). Where
//! that is no chance, quantities are let go one after the other, each time the one without which the
//! ties are missed least, until what is left may be chance. What they come out as without being
//! known is one explanation; the scale of a measured input with which all of them agree another, and
//! the shorter one.

use std::collections::BTreeMap;

use super::Parameter;
use super::judgement::{CHANCE, Coefficients, Ties};
use super::known_of_system::{Scaled, can_be, scaled};
use super::known_quantities::CONTRADICTED;
use crate::model::model_file::ModelFile;
use crate::system::mechanism::Mechanism;
use crate::system::ties::{self, Identified, TiesFit};
use crate::warning::Warning;
use crate::wording::format::{quantity, significant};
use crate::wording::names::listed;

/// A warning where what is known cannot be true together.
pub(super) fn contradicted(
    mechanism: &Mechanism,
    c: &Coefficients<'_>,
    model: Option<&ModelFile>,
    known: &BTreeMap<&str, f64>,
) -> Option<Warning> {
    if c.blocks <= c.names.len() {
        return None;
    }
    let by_chance = |misfit: f64, freedom: usize| Ties::of(misfit, freedom, c.blocks).map(|t| t.chance >= CHANCE);
    let whole = fit(mechanism, c, known)?;
    if by_chance(whole.misfit, whole.freedom)? {
        return None;
    }
    let (names, fit) = let_go(mechanism, c, known, &by_chance)?;
    let found: Vec<&Parameter> = names.iter().filter_map(|n| fit.found.iter().find(|p| p.name == *n)).collect();
    let inputs = model.into_iter().flat_map(|m| (0..m.inputs.len()).map(move |k| (m, k)));
    // One degree of freedom is the scale's own.
    let agrees = |s: &Scaled| {
        let freedom = whole.freedom.saturating_sub(1);
        freedom == 0 || by_chance(s.misfit * freedom as f64, freedom) == Some(true)
    };
    let gains: Vec<Scaled> = inputs.filter_map(|i| scaled(mechanism, c, known, i)).filter(agrees).collect();
    let instead = |p: &&Parameter| {
        let stated = known.get(p.name.as_str())?;
        Some(format!("{} = {} instead of {}", p.name, quantity(p.value, &p.unit, 4), quantity(*stated, &p.unit, 4)))
    };
    // A mass or a length below 0 is no remedy, and without it the others are none either.
    let can_be =
        found.iter().all(|p| known.get(p.name.as_str()).is_none_or(|stated| can_be(p.value, *stated, &p.unit)));
    let values: Vec<String> = found.iter().filter(|_| can_be).filter_map(instead).collect();
    // Gravity is the last to be wrong.
    let rather =
        if names.iter().any(|n| n == "g") { ", or the scale of a sensor of lengths, or the time base" } else { "" };
    let mut alternatives: Vec<String> = gains
        .iter()
        .map(|s| format!("{} reads {} times what acts (its sensor's scale)", s.input, significant(s.factor, 4)))
        .collect();
    if !values.is_empty() {
        alternatives.push(listed(&values) + rather);
    }
    let agree = match alternatives.len() {
        0 => String::new(),
        1 => format!(". This would agree: {}", alternatives[0]),
        _ => format!(". Either of these would agree: {}", alternatives.join("; or ")),
    };
    let disagree = if names.len() == 1 { "disagrees with the record" } else { "disagree with the record together" };
    let text = format!("[known] {} {disagree}{agree}", listed(&names));
    let scales = gains.iter().map(|s| (format!("input-gain@{}", s.input), (s.factor - 1.0).into()));
    let found = found.iter().filter(|_| can_be).map(|p| (p.name.clone(), p.value.into()));
    let would_agree: serde_json::Map<String, serde_json::Value> = found.chain(scales).collect();
    let advice = "Measure them again, check their units (metres, kilograms) and the scale of each measured input, and correct the rig file";
    Some(Warning::new(CONTRADICTED, text, advice).invalidating().with("would_agree", would_agree))
}

fn fit(mechanism: &Mechanism, c: &Coefficients<'_>, known: &BTreeMap<&str, f64>) -> Option<TiesFit> {
    let b = Identified { names: c.names, values: &c.values, covariance: &c.covariance, metric: &c.covariance };
    ties::fit(mechanism, &b, known)
}

/// The quantities without which the others may be true, gravity last, and the fit without them.
fn let_go<'a>(
    mechanism: &Mechanism,
    c: &Coefficients<'_>,
    known: &BTreeMap<&'a str, f64>,
    by_chance: &impl Fn(f64, usize) -> Option<bool>,
) -> Option<(Vec<String>, TiesFit)> {
    let mut left = known.clone();
    let mut gone = Vec::new();
    while !left.is_empty() {
        let last = left.keys().all(|name| *name == "g");
        let without = |name: &'a str| {
            let mut others = left.clone();
            others.remove(name);
            Some((name, fit(mechanism, c, &others)?))
        };
        let candidates = left.keys().copied().filter(|name| last || *name != "g").filter_map(without);
        let (name, fit) = candidates.min_by(|a, b| a.1.misfit.total_cmp(&b.1.misfit))?;
        left.remove(name);
        gone.push(name.to_owned());
        if fit.freedom == 0 || by_chance(fit.misfit, fit.freedom).unwrap_or(true) {
            gone.sort_unstable();
            return Some((gone, fit));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::model::model_file::toml_place::Source;

    const TEXT: &str = r#"name = "arm on a motor"
coordinates = { q = "angle" }
inputs = { torque = "N m" }
gravity = "down"
parameters = { J = "kg m^2", S = "kg m" }
[points]
axis = "[0, 0]"
[[body]]
name = "arm"
from = "axis"
angle = "q"
first_moment = "S"
inertia = "J"
[[joint]]
name = "shaft"
at = "axis"
moves = "q"
[[force]]
does_work_on = "q"
value = "torque"
[nominal]
effects = ["viscous-friction@shaft"]
"#;

    /// A torque read 1.06 times too large makes inertia and first moment 1.06 times what they are:
    /// neither alone explains the other, the input's scale or both do.
    #[test]
    fn two_quantities_disagree_together() {
        let source = Source { text: TEXT.to_owned(), path: Path::new("arm.toml").to_path_buf() };
        let model = crate::system::model_of(source, None, 1.0).unwrap();
        let mechanism = model.mechanism.clone().unwrap();
        let of = |scale: f64| -> Vec<f64> {
            let value = |name: &str| match name {
                "J" => 0.0023 * scale,
                "S" => 0.011 * scale,
                "g" => 9.81,
                _ => 0.0011 * scale,
            };
            mechanism.parameters.iter().map(|p| value(&p.name)).collect()
        };
        let names: Vec<String> = mechanism.coefficients.iter().map(|c| c.name.clone()).collect();
        let coefficients = |scale: f64| {
            let values = DVector::from_fn(names.len(), |k, _| mechanism.value(&names[k], &of(scale)).unwrap());
            let covariance = DMatrix::from_diagonal(&values.map(|x| (1e-4 * x).powi(2)));
            Coefficients { names: &names, values, covariance, blocks: 40 }
        };
        let known = BTreeMap::from([("J", 0.0023), ("S", 0.011), ("g", 9.81)]);
        assert!(contradicted(&mechanism, &coefficients(1.0), Some(&model), &known).is_none());
        let warning = contradicted(&mechanism, &coefficients(1.06), Some(&model), &known).unwrap();
        assert!(warning.invalidates && warning.text.contains("[known] J and S disagree"), "{}", warning.text);
        let of = |name: &str| warning.details["would_agree"][name].as_f64().unwrap();
        assert!((of("J") - 1.06 * 0.0023).abs() < 1e-7, "{}", warning.text);
        assert!((of("input-gain@torque") - 0.06).abs() < 1e-4, "{}", warning.text);
    }
}
