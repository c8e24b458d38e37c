//! Another effect in the place of one that was found while others were missing: a search that adds one after the other takes what stands in for several, and would keep it.

use rayon::prelude::*;

use super::candidates::Candidate;
use super::evidence::{Evidence, Outcome};
use super::setting::Setting;
use super::shooting::blocks::Blocks;
use super::state::State;
use crate::explain::decision::{Evidence as _, FAMILY_WISE};
use crate::explain::ranking::{self, Fit};

/// An effect that predicts what was not fitted better than one of those found.
pub struct Exchange {
    /// What it takes the place of, by its number among the chosen.
    pub gone: usize,
    /// The candidate.
    pub index: usize,
    /// The fit with it, its strengths last.
    pub fit: Fit,
    /// Probability by chance.
    pub p_value: f64,
    /// Share of what is left that it takes away more than the other.
    pub promised: f64,
    /// Share of what is left without either that it takes away.
    pub share: f64,
}

/// The best exchange of one of several effects for a candidate that is not `taken`; none where none predicts clearly better. Effects that were taken off the record stay.
pub fn best(setting: &Setting<'_>, state: &State, outcome: &Outcome, taken: &[String]) -> Option<Exchange> {
    let Evidence::Shooting(blocks) = &outcome.evidence else { return None };
    if state.chosen.len() < state.nominal + 2 {
        return None;
    }
    let free: Vec<usize> = places(&outcome.candidates, outcome.own.len());
    let offers: Vec<usize> =
        (0..outcome.candidates.len()).filter(|&i| !taken.contains(&outcome.candidates[i].name(setting))).collect();
    let mut at = state.values.len();
    let mut found: Vec<Exchange> = Vec::new();
    for (k, chosen) in state.chosen.iter().enumerate() {
        let gone = at..at + chosen.strengths.len();
        at = gone.end;
        if k < state.nominal || chosen.candidate.is_applied() {
            continue;
        }
        let without = blocks.without(gone.clone());
        let rest: Vec<usize> = outcome.own.iter().copied().filter(|c| !gone.contains(c)).collect();
        let Some(neither) = without.fit(&rest) else { continue };
        let of = |&i: &usize| instead(&without, &rest, outcome, (i, &outcome.candidates[i], free[i]), &offers);
        let tried: Vec<(usize, Fit, f64)> = offers.par_iter().filter_map(of).collect();
        let sum = |fit: &Fit| fit.held_out.iter().sum::<f64>();
        let best = tried.into_iter().min_by(|a, b| sum(&a.1).total_cmp(&sum(&b.1)));
        found.extend(best.map(|(index, fit, p_value)| Exchange {
            gone: k,
            index,
            p_value,
            promised: 1.0 - sum(&fit) / sum(&outcome.fit),
            share: 1.0 - sum(&fit) / sum(&neither),
            fit,
        }));
    }
    found.into_iter().max_by(|a, b| a.promised.total_cmp(&b.promised))
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

/// The fit with a candidate in the place of what was taken away, where it is supported and clearly better.
fn instead(
    without: &Blocks,
    rest: &[usize],
    outcome: &Outcome,
    (index, candidate, first): (usize, &Candidate, usize),
    offers: &[usize],
) -> Option<(usize, Fit, f64)> {
    let d = candidate.strengths();
    let columns: Vec<usize> = rest.iter().copied().chain(first..first + d).collect();
    let fit = without.fit(&columns)?;
    if candidate.entry.positive[0] && fit.all[fit.all.len() - d] <= 0.0 {
        return None;
    }
    let p = ranking::p_value(&fit, d);
    let (gain, error) = ranking::gain(&outcome.fit.held_out, &fit.held_out);
    let total: f64 = outcome.fit.held_out.iter().sum();
    let clear = gain > 0.0 && gain > without.least_deviations() * error;
    let counts = gain * fit.held_out.len() as f64 > without.least_gain(total);
    (p * (offers.len() as f64) < FAMILY_WISE && clear && counts).then_some((index, fit, p))
}
