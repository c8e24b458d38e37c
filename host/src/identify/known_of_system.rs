//! Whether what is said to be known of a system from bodies agrees with the record.
//!
//! What is known is held fixed where parameters are found ([`crate::system::ties`]). Where more is
//! known than that needs, each quantity is found once more without being known itself: (found −
//! known) over the standard error has Student's t distribution over the jackknife's blocks, the
//! standard error widened by how much the ties are missed all the same. Of several that disagree
//! those are told without which the others agree.
//!
//! Limits: where two quantities are wrong, neither explains the other.

use std::collections::BTreeMap;

use statrs::distribution::{ContinuousCDF, StudentsT};

use super::judgement::{CHANCE, Coefficients, Ties};
use super::known_quantities::{CONTRADICTED, time_base};
use crate::rig::Rig;
use crate::system::mechanism::Mechanism;
use crate::system::ties::{self, Identified};
use crate::warning::Warning;
use crate::wording::format::{quantity, significant};

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
    let fit = ties::fit(mechanism, &b, &BTreeMap::new())?;
    Ties::of(fit.misfit, fit.freedom, c.blocks)
}

/// The disagreement of a quantity with everything else; none where nothing else fixes it, or where
/// chance would do.
fn disagreeing<'a>(
    mechanism: &Mechanism,
    c: &Coefficients<'_>,
    known: &BTreeMap<&'a str, f64>,
    name: &'a str,
) -> Option<Disagreeing<'a>> {
    let b = Identified { names: c.names, values: &c.values, covariance: &c.covariance, metric: &c.covariance };
    let mut others = known.clone();
    let value = others.remove(name)?;
    let fit = ties::fit(mechanism, &b, &others)?;
    let found = fit.found.iter().find(|p| p.name == name)?;
    let misfit = if fit.freedom > 0 { (fit.misfit / fit.freedom as f64).max(1.0) } else { 1.0 };
    let t = (found.value - value).abs() / (misfit.sqrt() * found.std_error);
    let chance = 2.0 * StudentsT::new(0.0, 1.0, (c.blocks - 1) as f64).ok()?.sf(t);
    (chance < CHANCE).then(|| Disagreeing { name, unit: found.unit.clone(), known: value, found: found.value, misfit })
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
    let clock = all.iter().find(|d| d.name == "g").map(|d| (d.known / d.found).sqrt()).filter(|k| k.is_finite());
    if all.iter().any(|d| d.name != "g") {
        all.retain(|d| d.name != "g");
    }
    let first = all.first()?;
    let told = |d: &Disagreeing<'_>| {
        format!("{} = {} instead of {}", d.name, quantity(d.found, &d.unit, 4), quantity(d.known, &d.unit, 4))
    };
    let names: Vec<&str> = all.iter().map(|d| d.name).collect();
    let mut alternatives: Vec<String> = all.iter().map(told).collect();
    if let Some(factor) = clock {
        alternatives.push(time_base(factor, rig.drive.is_some()));
    }
    let text = format!(
        "[known] {} {} with the record by {} %. {}: {}",
        names.join(", "),
        if names.len() == 1 { "disagrees" } else { "disagree" },
        significant(100.0 * (first.known / first.found - 1.0).abs(), 2),
        if alternatives.len() == 1 { "This would agree" } else { "One of these would agree" },
        alternatives.join("; or ")
    );
    let clock = clock.map(|factor| ("time-base".to_owned(), factor.into()));
    let values: serde_json::Map<String, serde_json::Value> =
        all.iter().map(|d| (d.name.to_owned(), d.found.into())).chain(clock).collect();
    let advice = "Measure them again, check their units (metres, kilograms), and correct the rig file";
    Some(Warning::new(CONTRADICTED, text, advice).invalidating().with("would_agree", values))
}
