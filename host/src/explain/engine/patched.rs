//! Whether effects at a joint are one shape of its position in pieces.
//!
//! A function of a position that has no name can be put together from those that have: a spring, a
//! play, a ripple. Several of them at one joint that turns are held against a free function, the
//! harmonics up to [`ORDERS`] in their place: where that does no worse on parts of the record that
//! were not fitted, for all that it has more to fit, nothing speaks for the pieces. From
//! [`PATCHES`] on they are an expansion in any case: one of two and more laws with a constant force
//! there, or an offset of the sensor that shows the joint, which moves their origin, as well. A force
//! about some place whose form is free is such a shape already: what stands beside it mends it.
//!
//! Laws of one sensor that nearly cancel (a scale a x and an eccentricity b sin x with b near −a)
//! stand for a bend of its scale that neither is: what their sum leaves is of higher order, and
//! their strengths say nothing.

use super::Outcome;
use super::candidates::{Candidate, Column};
use super::setting::Setting;
use super::state::{Chosen, State};
use crate::effects::kinds::{is_constant, is_of_position};
use crate::effects::places::Place;
use crate::explain::reason::Patch;
use crate::identify::stretches::Stretch;
use crate::model::model_file::expression::{Node, Symbol, as_number};
use crate::system::polynomial::Atom;

/// So many of them at one joint are a series expansion of a shape, not so many causes.
const PATCHES: usize = 3;
/// Highest order of the free function.
const ORDERS: f64 = 8.0;

/// Rms of a sum of laws of one sensor, over that of the smallest of them, below which they cancel.
const CANCELS: f64 = 1.0 / 3.0;
/// Readings at which they are compared.
const READINGS: usize = 2000;

/// A joint at which a shape of the position was patched together from several effects, or a sensor
/// whose scale was.
pub fn patched(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<Patch> {
    at_a_joint(setting, state, outcome).or_else(|| at_a_sensor(setting, state))
}

/// A sensor with laws that nearly cancel over what it showed.
fn at_a_sensor(setting: &Setting<'_>, state: &State) -> Option<Patch> {
    let all: usize = setting.raw.iter().map(Stretch::len).sum();
    (0..setting.bound.sensors.len()).find_map(|sensor| {
        let own: Vec<&Chosen> = state.chosen[state.nominal..]
            .iter()
            .filter(|k| k.candidate.reads().is_some_and(|(s, laws)| s == sensor && laws.iter().all(is_bent)))
            .collect();
        if own.len() < 2 {
            return None;
        }
        let shown: Vec<f64> = setting.raw.iter().flat_map(|s| s.sensors(&setting.bound).swap_remove(sensor)).collect();
        let shown = shown.iter().step_by(all.div_ceil(READINGS).max(1));
        let of = |k: &&Chosen| -> Vec<f64> {
            let laws = k.candidate.reads().map_or(&[][..], |r| r.1);
            let at = |x: f64| laws.iter().zip(&k.strengths).map(|(law, s)| s * law.value(&|_| x)).sum();
            shown.clone().map(|x| at(*x)).collect()
        };
        let parts: Vec<Vec<f64>> = own.iter().map(of).collect();
        let effects = own.iter().map(|k| k.candidate.entry.id.clone()).collect();
        let place = own[0].candidate.place_name(setting);
        cancel(&parts).then_some(Patch { place, effects, is_bend: true })
    })
}

/// Whether a law of a sensor depends on what it shows, and on nothing else.
fn is_bent(law: &Node) -> bool {
    as_number(law).is_none() && !law.any(&|s| s != Symbol::Coordinate(0))
}

/// Whether a sum is far less than the smallest of its parts.
fn cancel(parts: &[Vec<f64>]) -> bool {
    let readings = parts.first().map_or(0, Vec::len);
    let sum: Vec<f64> = (0..readings).map(|i| parts.iter().map(|p| p[i]).sum()).collect();
    let least = parts.iter().map(|p| rms_about_mean(p)).fold(f64::INFINITY, f64::min);
    rms_about_mean(&sum) < CANCELS * least
}

fn rms_about_mean(x: &[f64]) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len().max(1) as f64;
    (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / x.len().max(1) as f64).sqrt()
}

/// A joint at which a shape of the position was patched together from several effects.
fn at_a_joint(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<Patch> {
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
        let several = pieces.len() > 1;
        let is_bump = |&k: &usize| state.chosen[k].candidate.entry.id == "local-force";
        let one = all.len() >= PATCHES
            || several && (pieces.iter().any(is_bump) || free_is_as_good(setting, state, outcome, joint, &pieces));
        let effects = all.iter().map(|&k| state.chosen[k].candidate.entry.id.clone()).collect();
        one.then(|| Patch { place: joint.name(file), effects, is_bend: false })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_and_an_eccentricity_over_a_third_of_a_turn_cancel_and_over_turns_do_not() {
        let over = |range: f64, scale: f64, sine: f64| {
            let x = || (-400..=400).map(|i| range * f64::from(i) / 400.0);
            cancel(&[x().map(|x| scale * x).collect(), x().map(|x| sine * x.sin()).collect()])
        };
        // Pixels that are not square, 0.0025 sin 2x over 1.2 rad, as they were once named.
        assert!(over(1.2, -0.0106, 0.0153));
        assert!(!over(30.0, -0.0106, 0.0153));
        assert!(!over(1.2, 0.0106, 0.0153));
        assert!(!over(1.2, -0.0106, 0.004));
    }
}
