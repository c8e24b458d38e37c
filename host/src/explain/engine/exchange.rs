//! Another effect in the place of one that was found while others were missing: a search that adds
//! one after the other takes what stands in for several, and would keep it. Of nested laws that
//! predict alike the simpler stays: Stribeck's friction at a velocity beyond the motion is
//! Coulomb's, a damping of power 2 is a drag.

use rayon::prelude::*;

use super::candidates::Candidate;
use super::evidence::{Evidence, Outcome};
use super::setting::Setting;
use super::shooting::blocks::Blocks;
use super::state::{Chosen, State};
use crate::explain::decision::{Evidence as _, OF_A_FAMILY};
use crate::explain::explanation::Found;
use crate::explain::ranking::{self, Fit};

/// Share by which what a simpler law leaves may exceed what the other does. Without it Coulomb's
/// friction in both joints and a drag of a free double pendulum came out as Stribeck's friction and
/// a ripple; with it as they are, to 0.1 % (docs/explain.md, step 5).
const AS_LITTLE: f64 = 0.01;

/// Share of the gain of what was chosen by which the next best may have been less (by hand).
const AS_GOOD: f64 = 0.05;
/// Times the noise from which what is left is more than that, as for the verdict (`decidability`).
pub const MISSES: f64 = 1.05;

/// An effect in the place of one of those found.
pub struct Exchange {
    /// What it takes the place of, by its number among the chosen.
    pub gone: usize,
    /// The candidate.
    pub index: usize,
    /// The fit with it, its strengths last.
    pub fit: Fit,
    /// Probability by chance.
    pub p_value: f64,
    /// Share of what is left that it takes away more than the other; what it may leave more, with a
    /// minus, where it is simpler.
    pub promised: f64,
    /// Share of what is left without either that it takes away.
    pub share: f64,
    /// Others in that place that held-out data do not tell from it.
    pub twins: Vec<String>,
}

/// A candidate in the place of what was taken away.
struct Tried {
    index: usize,
    fit: Fit,
    p: f64,
}

/// The best exchange of an effect for a candidate that is not `taken`: for what predicts clearly
/// better and is not larger, or refines it where it remembers (about the motion of a model that
/// lacks much, columns that are alike are not told apart; about that of the model with either they
/// are); where there is none, for a simpler law that predicts as well. `effects`: those found, in
/// their order. Effects that were taken off the record stay.
pub fn best(
    setting: &Setting<'_>,
    state: &State,
    outcome: &Outcome,
    taken: &dyn Fn(&Candidate) -> bool,
    effects: &[Found],
) -> Option<Exchange> {
    let Evidence::Shooting(blocks) = &outcome.evidence else { return None };
    let free: Vec<usize> = places(&outcome.candidates, outcome.own.len());
    let offers: Vec<usize> = (0..outcome.candidates.len()).filter(|&i| !taken(&outcome.candidates[i])).collect();
    let mut at = state.values.len();
    let (mut better, mut simpler): (Vec<Exchange>, Vec<Exchange>) = (Vec::new(), Vec::new());
    for (k, Chosen { candidate: old, strengths }) in state.chosen.iter().enumerate() {
        let gone = at..at + strengths.len();
        at = gone.end;
        if k < state.nominal || old.is_applied() {
            continue;
        }
        let without = blocks.without(gone.clone());
        let rest: Vec<usize> = outcome.own.iter().copied().filter(|c| !gone.contains(c)).collect();
        let Some(neither) = without.fit(&rest) else { continue };
        let of = |&i: &usize| {
            let c = &outcome.candidates[i];
            // A larger law joins beside the old one first, which then goes if it is nothing; but what
            // refines one that remembers is no law beside it.
            if size(c) > size(old) && !remembers_more(c, old) {
                return None;
            }
            instead(&without, &rest, i, c, free[i], offers.len())
        };
        let tried: Vec<Tried> = offers.par_iter().filter_map(of).collect();
        // About the motion of a model that still misses something, laws that are alike are hardly
        // told apart: one that leaves less is tried, and one that was as good when the other was
        // chosen.
        let misses = sum(&outcome.fit) > MISSES * blocks.noise();
        let close = effects.get(k - state.nominal).and_then(|f| {
            let (name, share) = f.runner_up.as_ref()?;
            // What held-out data do not tell apart is listed, and stays as it was chosen.
            let listed = f.indistinguishable_from.contains(name);
            (!listed && *share >= (1.0 - AS_GOOD) * f.held_out_gain).then_some(name)
        });
        let alike = |t: &Tried| {
            let new = &outcome.candidates[t.index];
            let was_close = || close.is_some_and(|name| *name == new.name(setting));
            let same = misses && new.place == old.place && size(new) == size(old);
            same && (sum(&t.fit) < sum(&outcome.fit) || was_close())
        };
        let (clear, others): (Vec<Tried>, Vec<Tried>) =
            tried.into_iter().partition(|t| brings(&without, outcome, t) || alike(t));
        let as_good = |t: &Tried| {
            let (loss, error) = ranking::gain(&t.fit.held_out, &outcome.fit.held_out);
            let new = &outcome.candidates[t.index];
            // Columns of laws that jump, or remember, hold to first order only: what was not told
            // apart in the beginning is tried.
            let twin = || {
                let twins = effects.get(k - state.nominal).map_or(&[][..], |f| &f.indistinguishable_from);
                new.place == old.place && new.form.is_empty() && twins.contains(&new.name(setting))
            };
            // The shapes of its grid may lie far from that at which it is the law which it underlies.
            let underlies = || {
                let refined = old.entry.refines.as_ref() == Some(&new.entry.id);
                new.place == old.place && !new.form.is_empty() && refined
            };
            let as_little = sum(&t.fit) <= (1.0 + AS_LITTLE) * sum(&outcome.fit);
            // Of two of one size the one that the other refines.
            let refined = old.entry.refines.as_ref() == Some(&new.entry.id) && new.place == old.place;
            let simpler = size(new) < size(old) || (refined && size(new) == size(old));
            simpler && (loss <= 2.0 * error || as_little || twin() || underlies())
        };
        let exchange = |(Tried { index, fit, p }, twins): (Tried, Vec<String>)| Exchange {
            gone: k,
            index,
            p_value: p,
            promised: promised(&outcome.candidates[index], old, 1.0 - sum(&fit) / sum(&outcome.fit)),
            share: 1.0 - sum(&fit) / sum(&neither),
            twins,
            fit,
        };
        better.extend(simplest(setting, &outcome.candidates, clear).map(exchange));
        let others: Vec<Tried> = others.into_iter().filter(as_good).collect();
        simpler.extend(simplest(setting, &outcome.candidates, others).map(exchange).map(|e| Exchange {
            promised: -AS_LITTLE,
            twins: [vec![old.name(setting)], e.twins].concat(),
            ..e
        }));
    }
    let most = |a: &Exchange, b: &Exchange| a.promised.total_cmp(&b.promised).then(a.share.total_cmp(&b.share));
    better.into_iter().max_by(most).or_else(|| simpler.into_iter().max_by(most))
}

/// Other laws, not larger, that in the place of each effect found predict as well: within two
/// standard errors of what the model leaves. A list that was made while others were missing lacks
/// those that were told apart by what these left.
pub fn twins(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Vec<Vec<String>> {
    let Evidence::Shooting(blocks) = &outcome.evidence else { return Vec::new() };
    let free: Vec<usize> = places(&outcome.candidates, outcome.own.len());
    let chosen = |c: &Candidate| state.chosen.iter().any(|k| k.candidate.name(setting) == c.name(setting));
    let offers: Vec<usize> = (0..outcome.candidates.len()).filter(|&i| !chosen(&outcome.candidates[i])).collect();
    let mut at = state.values.len();
    let mut all = Vec::new();
    for (k, Chosen { candidate: old, strengths }) in state.chosen.iter().enumerate() {
        let gone = at..at + strengths.len();
        at = gone.end;
        if k < state.nominal {
            continue;
        }
        // What is taken off the record has its increment alone here.
        if old.is_applied() {
            all.push(Vec::new());
            continue;
        }
        let without = blocks.without(gone.clone());
        let rest: Vec<usize> = outcome.own.iter().copied().filter(|c| !gone.contains(c)).collect();
        let of = |&i: &usize| {
            let c = &outcome.candidates[i];
            let tried = (size(c) <= size(old)).then(|| instead(&without, &rest, i, c, free[i], offers.len()))??;
            let (loss, error) = ranking::gain(&tried.fit.held_out, &outcome.fit.held_out);
            (loss.abs() <= 2.0 * error).then(|| c.name(setting))
        };
        let mut names: Vec<String> = offers.par_iter().filter_map(of).collect();
        names.sort();
        names.dedup();
        all.push(names);
    }
    all
}

/// What a law in the place of another promises: the share of what is left that it takes away more;
/// where it is simpler and that is hardly anything, to leave as little.
fn promised(new: &Candidate, old: &Candidate, share: f64) -> f64 {
    if size(new) < size(old) && share < AS_LITTLE { -AS_LITTLE } else { share.max(AS_LITTLE) }
}

/// Whether a law refines another that has states.
pub fn remembers_more(c: &Candidate, old: &Candidate) -> bool {
    !old.entry.states.is_empty() && c.entry.refines.as_ref() == Some(&old.entry.id) && c.place == old.place
}

/// Strengths and shape parameters of a candidate, without those by which a shape is refined.
fn size(c: &Candidate) -> usize {
    c.entry.strengths.len() + c.form.len()
}

/// Sum of squares of what was not fitted.
pub fn sum(fit: &Fit) -> f64 {
    fit.held_out.iter().sum()
}

/// The simplest within a standard error of the best, and the names of others within two.
fn simplest(setting: &Setting<'_>, candidates: &[Candidate], tried: Vec<Tried>) -> Option<(Tried, Vec<String>)> {
    let best = tried.iter().min_by(|a, b| sum(&a.fit).total_cmp(&sum(&b.fit)))?.fit.held_out.clone();
    let within = |t: &Tried, errors: f64| {
        let (mean, error) = ranking::gain(&t.fit.held_out, &best);
        mean <= errors * error
    };
    // Of one size what refines nothing: beside a constant, friction of one direction is Coulomb's.
    let size_of = |t: &Tried| (size(&candidates[t.index]), candidates[t.index].entry.refines.is_some());
    let order = |a: &&Tried, b: &&Tried| size_of(a).cmp(&size_of(b)).then(sum(&a.fit).total_cmp(&sum(&b.fit)));
    let winner = tried.iter().filter(|t| within(t, 1.0)).min_by(order)?.index;
    let name = |t: &Tried| candidates[t.index].name(setting);
    let mut twins: Vec<String> = tried.iter().filter(|t| within(t, 2.0)).map(name).collect();
    twins.retain(|t| *t != candidates[winner].name(setting));
    twins.sort();
    twins.dedup();
    Some((tried.into_iter().find(|t| t.index == winner)?, twins))
}

/// First column of each candidate.
fn places(candidates: &[Candidate], own: usize) -> Vec<usize> {
    let mut at = own;
    let first = |c: &Candidate| {
        at += c.strengths();
        at - c.strengths()
    };
    candidates.iter().map(first).collect()
}

/// The fit with a candidate in the place of what was taken away, where it is supported.
fn instead(
    without: &Blocks,
    rest: &[usize],
    index: usize,
    candidate: &Candidate,
    first: usize,
    offers: usize,
) -> Option<Tried> {
    let d = candidate.strengths();
    let columns: Vec<usize> = rest.iter().copied().chain(first..first + d).collect();
    if without.p_of_even_noise(&columns, d)? * (offers as f64) >= OF_A_FAMILY {
        return None;
    }
    let fit = without.fit(&columns)?;
    if candidate.entry.positive[0] && fit.all[fit.all.len() - d] <= 0.0 {
        return None;
    }
    let p = ranking::p_value(&fit, d);
    (p * (offers as f64) < OF_A_FAMILY).then_some(Tried { index, fit, p })
}

/// Whether a candidate predicts what was not fitted clearly better than what is in its place.
fn brings(without: &Blocks, outcome: &Outcome, t: &Tried) -> bool {
    let (gain, error) = ranking::gain(&outcome.fit.held_out, &t.fit.held_out);
    let clear = gain > 0.0 && gain > without.least_deviations() * error;
    clear && gain * t.fit.held_out.len() as f64 > without.least_gain(sum(&outcome.fit))
}
