//! Which effect is added next: the best of those that held-out blocks and the scatter between blocks support.

use super::Setting;
use super::candidates::Candidate;
use super::fit::Held;
use super::round::Round;
use super::told::{put_value, unit_of};
use crate::explain::explanation::{Found, Ranked};
use crate::explain::naming::FAMILY_WISE;
use crate::explain::ranking;

/// Least share of the held-out residual that an effect must take away to be named.
const LEAST_GAIN: f64 = 0.01;

/// The next effect.
pub fn choose(
    setting: &Setting<'_>,
    round: &Round,
    chosen: &[Candidate],
    all: &[Candidate],
    step: usize,
    ranked: &mut Vec<Ranked>,
) -> Option<(Candidate, Found)> {
    struct Score<'a> {
        candidate: &'a Candidate,
        gain: f64,
        deviations: f64,
        p: f64,
        share: f64,
        held_out: Vec<f64>,
        held: Held,
    }
    let own: Vec<usize> = (0..round.groups.len())
        .map(|g| {
            let mine = chosen.iter().filter(|c| round.group_of(c) == g);
            round.groups[g].names.len() + mine.map(|c| c.columns.len()).sum::<usize>()
        })
        .collect();
    let mut next = own.clone();
    let mut scores: Vec<Score<'_>> = Vec::new();
    for candidate in all {
        let g = round.group_of(candidate);
        let group = &round.groups[g];
        let from = next[g];
        next[g] += candidate.columns.len();
        let columns: Vec<usize> = (0..own[g]).chain(from..next[g]).collect();
        let signs: Vec<f64> = columns.iter().map(|c| group.signs[*c]).collect();
        let Some(held) = group.blocks.fit(&columns, &signs) else { continue };
        let plain = &group.own.fit.held_out;
        let fit = &held.fit;
        let (mean, error) = ranking::gain(plain, &fit.held_out);
        let whole: f64 = plain.iter().sum();
        // One that would have to drive what it should brake is not there.
        let none = held.held[own[g]..].iter().all(|h| *h);
        scores.push(Score {
            candidate,
            gain: mean,
            deviations: if error > 0.0 { mean / error } else { 0.0 },
            p: if none { 1.0 } else { ranking::p_value(fit, candidate.columns.len()) },
            share: mean * plain.len() as f64 / whole,
            held_out: fit.held_out.clone(),
            held,
        });
    }
    let tests = scores.len().max(1) as f64;
    // The best form of each effect at each place.
    let mut best: Vec<&Score<'_>> = Vec::new();
    for s in &scores {
        match best.iter_mut().find(|b| b.candidate.name() == s.candidate.name()) {
            Some(b) if s.share > b.share => *b = s,
            Some(_) => {}
            None => best.push(s),
        }
    }
    best.sort_by(|a, b| b.share.total_cmp(&a.share));
    ranked.extend(best.iter().map(|s| Ranked {
        name: s.candidate.name(),
        gain: s.share,
        deviations: s.deviations,
        p_value: s.p,
        step,
    }));
    let alone = |s: &Score<'_>| s.p * tests < FAMILY_WISE && s.share > LEAST_GAIN && s.gain > 0.0;
    // A refinement is not named while the simpler effect that it refines is supported itself.
    let supported = |s: &Score<'_>| {
        let simpler = |o: &&&Score<'_>| {
            Some(o.candidate.effect.id) == s.candidate.effect.refines && o.candidate.at == s.candidate.at
        };
        alone(s) && !best.iter().find(simpler).is_some_and(|o| alone(o))
    };
    let top = best.iter().find(|s| supported(s))?;
    // Others in the same equation that held-out data do not tell from it.
    let close: Vec<&&Score<'_>> = best
        .iter()
        .filter(|s| s.candidate.equation == top.candidate.equation && supported(s))
        .filter(|s| {
            let (mean, error) = ranking::gain(&s.held_out, &top.held_out);
            mean <= error || s.candidate.name() == top.candidate.name()
        })
        .collect();
    let winner = close.iter().min_by_key(|s| s.candidate.rank)?;
    let name = winner.candidate.name();
    let runner_up = best.iter().find(|s| s.candidate.name() != name).map(|s| (s.candidate.name(), s.share));
    let c = winner.candidate;
    let mut found = Found {
        indistinguishable_from: close.iter().map(|s| s.candidate.name()).filter(|n| *n != name).collect(),
        equation: c.effect.equation.to_owned(),
        confirm: c.effect.confirm.to_owned(),
        p_value: winner.p,
        held_out_gain: winner.share,
        runner_up,
        ..Found::empty(c.effect.id, &c.at, unit_of(setting, c))
    };
    put_value(c, &winner.held, own[round.group_of(c)], &mut found);
    Some((c.clone(), found))
}
