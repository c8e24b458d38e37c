//! What an explanation does with the mistakes in a record or rig file that the equations show
//! ([`crate::identify::suspects`]).
//!
//! Some are effects as well: a late channel, a scale that is a little off. What is in the explained
//! model as an effect keeps that name, and the answer stands. Any other comes first: no effect is
//! named where one would be dressed up for it.

use std::collections::BTreeMap;

use super::{Explanation, Reason, Settings, Undecidable, Verdict, any_system};
use crate::identify::suspects;
use crate::record::Record;
use crate::rig::Rig;
use crate::warning::Warning;

/// Suspects that are effects as well, and the effect.
const EFFECTS: [(&str, &str); 4] = [
    ("channel-delay", "channel-delay"),
    ("counts-per-turn", "scale-error"),
    ("channel-scale", "scale-error"),
    ("drive-frequency", "frequency-offset"),
];
/// Suspects that are a reading of the rig file with which the equations fit better.
const READINGS: [&str; 3] = ["channels-exchanged", "channel-unit", "relative-absolute"];
/// Greatest scale error that is an effect, not another encoder.
const EFFECT_SCALE: f64 = 0.1;

/// Puts suspects into an explanation: what it has in its model as an effect keeps that name, any
/// other suspect comes before effects that would be dressed up for it.
pub(super) fn tell_in(result: &mut Explanation, suspects: Vec<Warning>) {
    let settled = matches!(result.verdict, Verdict::Explained | Verdict::NothingMissing);
    // The balance of forces may miss where the motion leaves coefficients open (a linear system on a
    // sine); where predictions miss nothing there is no better reading.
    let as_read = result.verdict == Verdict::NothingMissing;
    let kept: Vec<Warning> = suspects
        .into_iter()
        .filter(|s| !(as_read && READINGS.contains(&s.id)))
        .filter(|s| !(settled && effect_of(s).is_some_and(|id| has(result, id))))
        .map(|s| {
            // Where another effect leaves nothing but noise, a suspect that is one as well is only
            // a second reading.
            let second = settled && effect_of(&s).is_some();
            Warning { invalidates: s.invalidates && !second, ..s }
        })
        .collect();
    if let Some(first) = kept.iter().find(|s| s.invalidates) {
        result.verdict = Verdict::NotDecidable;
        let (text, advice) = (first.text.clone(), first.advice.clone());
        result.reason = Reason::Undecidable(Undecidable::Fault { text, advice });
        result.effects.clear();
        result.model = None;
    }
    result.warnings.extend(kept);
}

/// What is said to be known, or of the drive's amplitude, and the record contradicts.
pub(super) fn known(records: &[Record], rig: &Rig) -> Vec<Warning> {
    records.first().map_or_else(Vec::new, |record| suspects::known(record, rig))
}

/// Whether nothing at all is missing once nothing is said to be known.
pub(super) fn clean_without_known(records: &[Record], rig: &Rig, settings: &Settings) -> bool {
    let alone = Settings { most_effects: Some(0), ..settings.clone() };
    without_known(records, rig, &alone) == Some(Verdict::NothingMissing)
}

/// Whether effects explain a record once nothing is said to be known.
pub(super) fn explained_without_known(records: &[Record], rig: &Rig, settings: &Settings) -> bool {
    without_known(records, rig, settings) == Some(Verdict::Explained)
}

fn without_known(records: &[Record], rig: &Rig, settings: &Settings) -> Option<Verdict> {
    let free = Rig { known: BTreeMap::new(), ..rig.clone() };
    any_system(records, &free, settings).ok().map(|r| r.verdict)
}

/// Whether a suspect leaves nothing for an explanation to find.
pub(super) fn grave(suspect: &Warning) -> bool {
    suspect.invalidates && effect_of(suspect).is_none()
}

/// Whether the explained model has an effect, found or given.
fn has(result: &Explanation, id: &str) -> bool {
    result.effects.iter().any(|e| e.id == id) || result.given.iter().any(|e| e.id == id)
}

/// The effect that a suspect is as well.
fn effect_of(suspect: &Warning) -> Option<&'static str> {
    let (_, effect) = EFFECTS.iter().find(|(id, _)| *id == suspect.id)?;
    let factor = suspect.details.get("factor").and_then(serde_json::Value::as_f64).unwrap_or(1.0);
    (factor > 0.0 && factor.ln().abs() < EFFECT_SCALE).then_some(*effect)
}
