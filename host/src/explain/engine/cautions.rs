//! What is to be known of an effect beside its value: a shape at an end of what was tried, and
//! quantities that it rests on and that nothing fixes.

use super::setting::Setting;
use super::state::State;
use crate::effects::changes;
use crate::effects::columns::Action;
use crate::effects::entry::Verb;
use crate::explain::explanation::Explanation;
use crate::system::polynomial::{Atom, Polynomial};
use crate::warning::Warning;
use crate::wording::format::significant;
use crate::wording::names::listed;

/// Id of the warning about a shape at the end of what is tried.
const AT_BOUND: &str = "shape-at-bound";

/// A warning for every shape of an effect that was found at an end of what is tried: the best one
/// lies beyond, and the strength that goes with it is another.
pub fn at_bounds(state: &State, result: &Explanation) -> Vec<Warning> {
    let mut out = Vec::new();
    for (chosen, found) in state.chosen.iter().skip(state.nominal).zip(&result.effects) {
        for shape in chosen.candidate.refined_shapes().into_iter().map(|k| &chosen.candidate.entry.shapes[k]) {
            let (Some(within), Some(value)) = (shape.within, found.parameters.get(&shape.name)) else { continue };
            if within.iter().all(|end| (value - end).abs() > 1e-9 * end.abs()) {
                continue;
            }
            out.push(
                Warning::new(
                    AT_BOUND,
                    format!("{} of {} came out at the end of what is tried ({})", shape.name, found.name(), significant(*value, 3)),
                    "Its best value may lie beyond, and the strength beside it is then another: give the effect a wider range in an effect file (`whirl list effects` prints the entry)",
                )
                .with("effect", found.name())
                .with("parameter", shape.name.as_str())
                .with("value", *value),
            );
        }
    }
    out
}

/// Id of the warning about an effect whose size in an equation is a guess.
const RESTS_ON_OPEN: &str = "effect-rests-on-open";

/// A warning for every effect that changes the bodies' motion or gravity (a tilt, an imbalance, a
/// base that moves otherwise) in several terms, how much of it each has being products of parameters
/// that neither the record nor `[known]` fixes: its shape is then that of whatever values describe
/// the record as well.
pub fn resting_on_open(setting: &Setting<'_>, state: &State, result: &Explanation) -> Vec<Warning> {
    let Some(mechanism) = setting.mechanism() else { return Vec::new() };
    let (open, one) = (&state.physical.openness, Polynomial::number(1.0));
    let mut out = Vec::new();
    for (chosen, found) in state.chosen.iter().skip(state.nominal).zip(&result.effects) {
        let (Action::Force(parts), Verb::Moves | Verb::Turns) = (&chosen.candidate.action, chosen.candidate.entry.verb)
        else {
            continue;
        };
        let mut ratios = changes::ratios(parts, mechanism);
        ratios.retain(|(n, d)| open.is_open(n, d));
        let takes_part =
            |k: usize| ratios.iter().any(|(n, d)| [n, d].iter().any(|p| p.any(&|a| *a == Atom::Parameter(k))));
        let is_open = |k: usize| open.is_open(&Polynomial::atom(Atom::Parameter(k)), &one);
        let all = mechanism.parameters.iter().enumerate();
        let names: Vec<String> =
            all.filter(|(k, _)| takes_part(*k) && is_open(*k)).map(|(_, p)| p.name.clone()).collect();
        if names.is_empty() {
            continue;
        }
        let text = format!(
            "{} rests on {}, which neither this record nor [known] fixes: how much of it acts in each equation is a guess, and what is named beside it may make up for that",
            found.name(),
            listed(&names)
        );
        let advice = if names.len() == 1 { "Measure it" } else { "Measure one of them" };
        out.push(
            Warning::new(RESTS_ON_OPEN, text, format!("{advice}, add it to [known] and run again"))
                .with("effect", found.name())
                .with("parameters", names),
        );
    }
    out
}
