//! What is to be known of an effect beside its value: a shape at an end of what was tried.

use super::state::State;
use crate::explain::explanation::Explanation;
use crate::warning::Warning;
use crate::wording::format::significant;

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
