//! Shape parameters between those of the grid, before anything is chosen: a magnet that reaches
//! twice as far as the one that was tried leaves what another effect takes up, and follows no path.
//!
//! The best forms of the effects that bring most are moved by half a spacing of their grid either
//! way, one shape parameter at a time or two together (a spring that yields early on one side and
//! late on the other is much like another), then by less; windows are as they were.

use std::collections::BTreeMap;
use std::ops::Range;

use super::candidates::Candidate;
use super::exchange::{MISSES, remembers_more, sum};
use super::setting::Setting;
use super::shooting::Ground;
use super::shooting::blocks::Blocks;
use super::state::State;
use super::{frames, memory};
use crate::effects::entry::{Form, Shape};
use crate::explain::decision::{LEFT_BY_MOVED, OF_A_FAMILY};
use crate::explain::ranking;

/// Effects whose forms are moved, the share of the best one's gain that they bring, and the
/// probability by chance below which they bring something (by hand).
const MOST: usize = 6;
const LEAST_GAIN: f64 = 0.1;
const CHANCE: f64 = 0.05;
/// Share of what is left that a moved form must take away beside the model (by hand; what it leaves
/// when it was refitted is judged by the search).
const MUCH_OF_IT: f64 = 0.25;
/// Share of its gain by which what a law refines may be worse, and it is not moved beside the model
/// (by hand): there the simpler one is named, which it may then replace.
const AS_GOOD: f64 = 0.05;
/// Times that forms are moved, beside the model and in the place of a law in it.
const ROUNDS: usize = 6;
const ROUNDS_INSTEAD: usize = 12;
/// Forms of a scan that are followed along the record at a time.
const TOGETHER: usize = 40;
/// Half the spacing of a grid of one value, as a factor.
const ALONE: f64 = 1.5;

/// A form that is moved: the candidate, the steps of its shape parameters, and its gain.
struct Moved {
    candidate: Candidate,
    steps: Vec<Step>,
    gain: f64,
    moved: bool,
}

/// A candidate, what it takes away where it was not fitted, its probability by chance, and whether
/// it is none of those that are chosen among already.
#[derive(Clone)]
struct Offered {
    candidate: Candidate,
    gain: f64,
    p_value: f64,
    is_new: bool,
}

/// How far a shape parameter is moved.
#[derive(Clone, Copy)]
enum Step {
    /// By a difference.
    By(f64),
    /// By a factor.
    Times(f64),
}

impl Step {
    /// Half a grid's spacing about a value: a factor where all values are of one sign by their
    /// bounds.
    fn of(shape: &Shape, at: f64) -> Self {
        let nearest = |distance: &dyn Fn(f64) -> f64| {
            let others = shape.grid.iter().map(|x| distance(*x)).filter(|d| *d > 0.0 && d.is_finite());
            others.fold(f64::INFINITY, f64::min)
        };
        let spacing = nearest(&|x| (x - at).abs());
        let bounds = shape.within.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let one_sign = shape.grid.iter().chain(&bounds).all(|x| x * at >= 0.0) && at != 0.0;
        let factor = nearest(&|x| (x / at).ln().abs());
        match (one_sign, spacing.is_finite()) {
            (true, true) => Self::Times((0.5 * factor).exp()),
            (true, false) => Self::Times(ALONE),
            (false, true) => Self::By(0.5 * spacing),
            (false, false) => Self::By(0.5 * at.abs().max(1.0)),
        }
    }

    fn half(self) -> Self {
        match self {
            Self::By(x) => Self::By(0.5 * x),
            Self::Times(x) => Self::Times(x.sqrt()),
        }
    }

    fn both(self, at: f64) -> [f64; 2] {
        match self {
            Self::By(x) => [at - x, at + x],
            Self::Times(x) => [at / x, at * x],
        }
    }
}

/// Adds to candidates, and to their blocks, forms of those that bring most which bring more: beside
/// the model, and those of laws that refine one that was found and remembers in its place.
pub fn add(
    ground: &Ground<'_>,
    setting: &Setting<'_>,
    state: &State,
    candidates: &mut Vec<Candidate>,
    blocks: &mut Blocks,
) {
    let own: Vec<usize> = (0..state.own_columns()).collect();
    // What is left is noise: nothing is hidden by the wrong form.
    let Some(plain) = blocks.fit(&own).filter(|plain| sum(plain) >= MISSES * blocks.noise()) else { return };
    let beside = Seat { gone: 0..0, rest: own.clone() };
    let blocks_left = plain.held_out.len() as f64;
    let mut offered = beside.offered(state, blocks, candidates);
    // What nothing else explains may be the frame.
    let left = sum(&plain) - blocks.noise();
    let greatest = offered.iter().map(|o| o.gain * blocks_left).fold(0.0, f64::max);
    if greatest < (1.0 - LEFT_BY_MOVED) * left {
        offered.extend(beside.yielding(ground, setting, state, candidates));
    }
    let mut better = beside.moved(ground, setting, state, offered);
    // A form that was fitted to what is left comes before others only where it is much of it: a wide
    // magnet takes something of every shape.
    better.retain(|m| m.gain * blocks_left > MUCH_OF_IT * sum(&plain));
    let mut better: Vec<Candidate> = better.into_iter().map(|m| m.candidate.of_moved_form()).collect();
    let mut at = state.values.len();
    for (k, chosen) in state.chosen.iter().enumerate() {
        let gone = at..at + chosen.strengths.len();
        at = gone.end;
        let old = &chosen.candidate;
        if k < state.nominal || old.is_applied() {
            continue;
        }
        let all: Vec<Candidate> = candidates.iter().filter(|c| remembers_more(c, old)).cloned().collect();
        let Some(found) = evidence_of(ground, &all) else { continue };
        let seat = Seat { rest: own.iter().copied().filter(|c| !gone.contains(c)).collect(), gone };
        // The law in the model was fitted with columns by which its shape is refined, so that the new
        // one has them as well; and without, for where they are too much alike to be fitted.
        for Moved { candidate, .. } in seat.moved(ground, setting, state, seat.offered(state, &found, &all)) {
            let refined = candidate.clone().refined(setting, &state.physical);
            better.extend(Some(refined).filter(|c| memory::is_followed(setting, c)));
            better.push(candidate);
        }
    }
    if evidence_of(ground, &better).is_some_and(|found| blocks.join(&found)) {
        candidates.extend(better);
    }
}

/// The columns of some candidates; none where there are no candidates.
fn evidence_of(ground: &Ground<'_>, all: &[Candidate]) -> Option<Blocks> {
    let further: Vec<&Candidate> = all.iter().collect();
    if further.is_empty() { None } else { ground.evidence(&further, false, &[]) }
}

/// Where a candidate would stand: beside the model's own columns, or in the place of some.
struct Seat {
    gone: Range<usize>,
    rest: Vec<usize>,
}

impl Seat {
    /// What each candidate takes away where it was not fitted, and its probability by chance.
    fn gains(&self, state: &State, blocks: &Blocks, all: &[Candidate]) -> Vec<(f64, f64)> {
        let without = (!self.gone.is_empty()).then(|| blocks.without(self.gone.clone()));
        let blocks = without.as_ref().unwrap_or(blocks);
        let nothing = (f64::NEG_INFINITY, 1.0);
        let Some(plain) = blocks.fit(&self.rest) else { return vec![nothing; all.len()] };
        let mut at = state.own_columns();
        let of = |c: &Candidate| {
            let from = at;
            at += c.strengths();
            let columns: Vec<usize> = self.rest.iter().copied().chain(from..at).collect();
            let Some(fit) = blocks.fit(&columns) else { return nothing };
            let feeds = c.entry.positive[0] && fit.all[self.rest.len()] <= 0.0;
            let gain = if feeds { f64::NEG_INFINITY } else { ranking::gain(&plain.held_out, &fit.held_out).0 };
            (gain, ranking::p_value(&fit, c.strengths()))
        };
        all.iter().map(of).collect()
    }

    /// The same with the candidates.
    fn offered(&self, state: &State, blocks: &Blocks, all: &[Candidate]) -> Vec<Offered> {
        let gains = self.gains(state, blocks, all);
        let of = |(candidate, (gain, p_value)): (&Candidate, (f64, f64))| Offered {
            candidate: candidate.clone(),
            gain,
            p_value,
            is_new: false,
        };
        all.iter().zip(gains).map(of).collect()
    }

    /// The best form of a frame that gives way, over a grid of frequencies.
    fn yielding(
        &self,
        ground: &Ground<'_>,
        setting: &Setting<'_>,
        state: &State,
        candidates: &[Candidate],
    ) -> Vec<Offered> {
        let best = |scan: frames::Scan| {
            let mut best: Option<(f64, Candidate)> = None;
            for forms in scan.forms.chunks(TOGETHER) {
                let some = scan.candidates(setting, state, forms);
                if let Some(found) = evidence_of(ground, &some) {
                    let gains = self.gains(state, &found, &some).into_iter().map(|g| g.0);
                    best = gains.zip(some).chain(best).max_by(|a, b| a.0.total_cmp(&b.0));
                }
                memory::keep(setting, state, candidates.iter().chain(best.as_ref().map(|b| &b.1)));
            }
            let whole = [scan.whole(setting, state, &best?.1)?];
            self.offered(state, &evidence_of(ground, &whole)?, &whole).pop().map(|o| Offered { is_new: true, ..o })
        };
        frames::scans(setting, state, candidates).into_iter().filter_map(best).collect()
    }

    /// Forms that bring more than those of the grid.
    fn moved(&self, ground: &Ground<'_>, setting: &Setting<'_>, state: &State, offered: Vec<Offered>) -> Vec<Moved> {
        let mut open = most_promising(setting, offered, &state.moved_in_vain);
        // In the place of a law that was fitted with its shape a form has to be as near.
        let rounds = if self.gone.is_empty() { ROUNDS } else { ROUNDS_INSTEAD };
        for _ in 0..rounds {
            let tried: Vec<(usize, Candidate)> = open
                .iter()
                .enumerate()
                .flat_map(|(k, m)| beside(setting, state, m).into_iter().map(move |c| (k, c)))
                .collect();
            let all: Vec<Candidate> = tried.iter().map(|t| t.1.clone()).collect();
            let Some(found) = evidence_of(ground, &all) else { break };
            let before: Vec<f64> = open.iter().map(|m| m.gain).collect();
            for ((k, candidate), (gain, _)) in tried.into_iter().zip(self.gains(state, &found, &all)) {
                if gain > open[k].gain {
                    open[k] = Moved { candidate, gain, moved: true, steps: open[k].steps.clone() };
                }
            }
            // What still gets better goes on in steps as large.
            let stays = open.iter_mut().zip(&before).filter(|(m, before)| m.gain == **before);
            stays.flat_map(|(m, _)| &mut m.steps).for_each(|s| *s = s.half());
        }
        open.retain(|m| m.moved);
        open
    }
}

/// The best form of each effect that has shape parameters to be moved, for those that bring most and
/// were not moved in vain.
fn most_promising(setting: &Setting<'_>, offered: Vec<Offered>, in_vain: &[String]) -> Vec<Moved> {
    let mut best: BTreeMap<String, usize> = BTreeMap::new();
    for (i, o) in offered.iter().enumerate() {
        let entry = best.entry(o.candidate.name(setting)).or_insert(i);
        if o.gain > offered[*entry].gain {
            *entry = i;
        }
    }
    let greatest = best.values().map(|&i| offered[i].gain).fold(0.0, f64::max);
    let is_moved = |&i: &usize| {
        let (o, c) = (&offered[i], &offered[i].candidate);
        let of_lines = c.entry.shapes.iter().any(|s| s.of_lines) && !frames::gives_way(c);
        let brings = o.gain > LEAST_GAIN * greatest && o.p_value < CHANCE;
        let simpler = c.entry.refines.as_ref().map(|r| format!("{r}@{}", c.place_name(setting)));
        // That it does nearly as well says nothing where it is not named for it.
        let named = |k: &usize| offered[*k].p_value * (offered.len() as f64) < OF_A_FAMILY;
        let base = simpler.and_then(|name| best.get(&name).copied()).filter(named).map(|k| offered[k].gain);
        let refines_well = base.is_none_or(|base| base < (1.0 - AS_GOOD) * o.gain);
        let stays = of_lines || in_vain.contains(&c.name(setting));
        brings && refines_well && !stays && c.entry.bounded_shapes().next().is_some()
    };
    let mut order: Vec<usize> = best.values().copied().filter(is_moved).collect();
    order.sort_by(|&a, &b| offered[b].gain.total_cmp(&offered[a].gain).then(a.cmp(&b)));
    order.truncate(MOST);
    let of = |i: usize| {
        let Offered { candidate, gain, is_new, .. } = offered[i].clone();
        let steps = candidate.entry.bounded_shapes().map(|k| Step::of(&candidate.entry.shapes[k], candidate.form[k].1));
        Moved { steps: steps.collect(), gain, moved: is_new, candidate }
    };
    order.into_iter().map(of).collect()
}

/// The forms on either side of one, within their bounds.
fn beside(setting: &Setting<'_>, state: &State, m: &Moved) -> Vec<Candidate> {
    let shapes: Vec<usize> = m.candidate.entry.bounded_shapes().collect();
    let moved = |form: &Form, which: usize, side: usize| {
        let (k, mut form) = (shapes[which], form.clone());
        let [low, high] = m.candidate.entry.shapes[k].within.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        form[k].1 = m.steps[which].both(form[k].1)[side].clamp(low, high);
        form
    };
    let mut all: Vec<Form> = Vec::new();
    for (i, side) in (0..shapes.len()).flat_map(|i| [(i, 0), (i, 1)]) {
        let one = moved(&m.candidate.form, i, side);
        let others = (i + 1..shapes.len()).flat_map(|j| [(j, 0), (j, 1)]);
        all.extend(others.map(|(j, side)| moved(&one, j, side)));
        all.push(one);
    }
    let other = all.into_iter().filter(|form| *form != m.candidate.form);
    let at = other.filter_map(|form| m.candidate.at(setting, form, &state.physical));
    at.filter(|c| memory::is_followed(setting, c)).collect()
}
