//! Whether effects at a joint are one shape of its position in pieces.
//!
//! A function of a position that has no name can be put together from those that have: a spring, a
//! play, a ripple. Several of them at one joint that turns are held against a free function, the
//! harmonics up to [`ORDERS`] in their place: where that does no worse on parts of the record that
//! were not fitted, for all that it has more to fit, nothing speaks for the pieces. From
//! [`PATCHES`] on they are an expansion in any case: one of two and more laws with a constant force
//! there, or an offset of the sensor that shows the joint, which moves their origin, as well.

use super::Outcome;
use super::candidates::{Candidate, Column};
use super::setting::Setting;
use super::state::State;
use crate::effects::kinds::{is_constant, is_of_position};
use crate::effects::places::Place;
use crate::explain::reason::Patch;
use crate::model::model_file::expression::{Symbol, as_number};
use crate::system::polynomial::Atom;

/// So many of them at one joint are a series expansion of a shape, not so many causes.
const PATCHES: usize = 3;
/// Highest order of the free function.
const ORDERS: f64 = 8.0;

/// A joint at which a shape of the position was patched together from several effects.
pub fn patched(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<Patch> {
    let file = setting.file()?;
    (0..file.joints.len()).map(Place::Joint).find_map(|joint| {
        let pieces: Vec<usize> = (state.nominal..state.chosen.len())
            .filter(|&k| {
                let c = &state.chosen[k].candidate;
                c.place == joint && is_of_position(&c.entry)
            })
            .collect();
        let shifts = (state.nominal..state.chosen.len())
            .filter(|&k| pieces.len() > 1 && shifts(setting, &state.chosen[k].candidate, joint));
        let all: Vec<usize> = pieces.iter().copied().chain(shifts).collect();
        let one =
            all.len() >= PATCHES || (pieces.len() > 1 && free_is_as_good(setting, state, outcome, joint, &pieces));
        let effects = all.iter().map(|&k| state.chosen[k].candidate.entry.id.clone()).collect();
        one.then(|| Patch { joint: joint.name(file), effects })
    })
}

/// Whether an effect moves what a law of a joint's position is, up or along: a constant force there,
/// or an offset of a sensor that shows the joint alone.
fn shifts(setting: &Setting<'_>, c: &Candidate, joint: Place) -> bool {
    if let Some((sensor, laws)) = c.reads() {
        return laws.iter().all(|law| as_number(law).is_some()) && shows(setting, sensor, joint);
    }
    c.place == joint && is_constant(&c.entry)
}

/// Whether a sensor shows a multiple of what moves at a joint.
fn shows(setting: &Setting<'_>, sensor: usize, joint: Place) -> bool {
    let Some(moves) = setting.file().and_then(|file| joint.moves(file)) else { return false };
    let at = |k: Option<usize>| {
        moves.value(&|a| match a {
            Atom::Motion(Symbol::Coordinate(i)) => f64::from(u8::from(Some(*i) == k)),
            _ => 0.0,
        })
    };
    let weights: Vec<[f64; 2]> =
        (0..setting.circle.len()).map(|k| [at(Some(k)) - at(None), setting.bound.shown[(sensor, k)]]).collect();
    let first = weights.iter().find(|w| w[0] != 0.0);
    first.is_some_and(|f| weights.iter().all(|w| w[0] * f[1] == w[1] * f[0]) && f[1] != 0.0)
}

/// Whether harmonics in the place of the pieces predict held-out parts as well.
fn free_is_as_good(setting: &Setting<'_>, state: &State, outcome: &Outcome, joint: Place, pieces: &[usize]) -> bool {
    let harmonics: Vec<Column> = outcome
        .candidates
        .iter()
        .filter(|c| c.place == joint && c.entry.id == "cogging" && c.form.iter().all(|s| s.1 <= ORDERS))
        .flat_map(|c| c.plain(setting, &state.physical))
        .collect();
    if harmonics.is_empty() {
        return false;
    }
    let mut without = state.clone();
    let mut at = 0;
    without.chosen.retain(|_| {
        at += 1;
        !pieces.contains(&(at - 1))
    });
    outcome.is_matched(setting, &without, &harmonics)
}
