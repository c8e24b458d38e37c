//! Whether effects at a joint are one shape of its angle in pieces.
//!
//! A function of an angle that has no name can be put together from those that have: a spring, a play, a ripple. Several of them at one joint are held against
//! a free function, the harmonics up to [`ORDERS`] in their place: where that does no worse on parts of the record that were not fitted, for all that it
//! has more to fit, nothing speaks for the pieces. From [`PATCHES`] on they are an expansion in any case.

use super::Outcome;
use super::design::base_terms;
use super::effects::Place;
use super::ranking;
use super::state::{State, candidates};

/// Effects that are a function of a joint's angle.
const OF_THE_ANGLE: [&str; 5] = ["torsion-spring", "cubic-stiffness", "quadratic-stiffness", "backlash", "cogging"];
/// So many of them at one joint are a series expansion of a shape, not so many causes.
const PATCHES: usize = 3;
/// Highest order of the free function.
const ORDERS: f64 = 8.0;

/// A joint at which a shape of the angle was patched together from several effects, and their names.
pub(super) fn patched(state: &State, outcome: &Outcome) -> Option<(&'static str, String)> {
    [Place::Joint1, Place::Joint2].into_iter().find_map(|joint| {
        let pieces: Vec<usize> = (state.nominal..state.chosen.len())
            .filter(|&k| {
                let c = &state.chosen[k].candidate;
                c.place == joint && OF_THE_ANGLE.contains(&c.effect.id)
            })
            .collect();
        let names: Vec<&str> = pieces.iter().map(|&k| state.chosen[k].candidate.effect.id).collect();
        let one = pieces.len() >= PATCHES || (pieces.len() > 1 && free_is_as_good(state, outcome, joint, &pieces));
        one.then(|| (joint.name(), names.join(", ")))
    })
}

/// Whether harmonics in the place of the pieces predict held-out parts as well.
fn free_is_as_good(state: &State, outcome: &Outcome, joint: Place, pieces: &[usize]) -> bool {
    let mut at = 2 * base_terms(state.context.driven);
    let mut columns: Vec<usize> = (0..at).collect();
    for (k, chosen) in state.chosen.iter().enumerate() {
        let d = chosen.strengths.len();
        if !pieces.contains(&k) {
            columns.extend(at..at + d);
        }
        at += d;
    }
    for c in candidates(&state.context) {
        let d = c.variant.action.len();
        let order = c.variant.shape.first().map_or(f64::INFINITY, |s| s.1);
        if c.effect.id == "cogging" && c.place == joint && order <= ORDERS {
            columns.extend(at..at + d);
        }
        at += d;
    }
    if at != outcome.design.columns {
        return false;
    }
    let held_out = |columns: &[usize]| ranking::fit(&outcome.design, columns, &outcome.weights).map(|f| f.held_out);
    match (held_out(&columns), held_out(&outcome.own)) {
        (Some(free), Some(named)) => ranking::gain(&named, &free).0 >= 0.0,
        _ => false,
    }
}
