//! Which effect is added next: the best of those that held-out blocks and the scatter between blocks support.

use super::Setting;
use super::candidates::Candidate;
use super::fit::Held;
use super::round::Round;
use super::told::{put_value, scale_of, unit_of};
use crate::explain::decision::FAMILY_WISE;
use crate::explain::explanation::{Found, Ranked};
use crate::explain::ranking;

/// Least share of the held-out residual that an effect must take away to be named.
const LEAST_GAIN: f64 = 0.01;

/// How much a candidate explains.
struct Score<'a> {
    candidate: &'a Candidate,
    /// Mean gain of a block, over its standard error, and as a share of the whole.
    gain: f64,
    deviations: f64,
    share: f64,
    /// Probability by chance.
    p: f64,
    held: Held,
    /// Where its strengths stand in the fit.
    from: usize,
    /// Its columns in its group.
    columns: Vec<usize>,
}

/// Every candidate's score.
pub struct Scores<'a> {
    round: &'a Round,
    best: Vec<Score<'a>>,
    tests: f64,
}

/// Scores of every candidate beside what was chosen, the best form of each effect at each place, best first.
pub fn scores<'a>(round: &'a Round, chosen: &[Candidate], all: &'a [Candidate]) -> Scores<'a> {
    let own: Vec<usize> = (0..round.groups.len())
        .map(|g| {
            let mine = chosen.iter().filter(|c| round.group_of(c) == g);
            round.groups[g].names.len() + mine.map(|c| c.columns.len()).sum::<usize>()
        })
        .collect();
    let mut next = own.clone();
    let mut scores: Vec<Score<'a>> = Vec::new();
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
            held,
            from: own[g],
            columns: (from..next[g]).collect(),
        });
    }
    let tests = scores.len().max(1) as f64;
    // The best form of each effect at each place.
    let mut best: Vec<Score<'a>> = Vec::new();
    for s in scores {
        match best.iter_mut().find(|b| b.candidate.name() == s.candidate.name()) {
            Some(b) if s.share > b.share => *b = s,
            Some(_) => {}
            None => best.push(s),
        }
    }
    best.sort_by(|a, b| b.share.total_cmp(&a.share));
    Scores { round, best, tests }
}

impl Scores<'_> {
    /// For the audit.
    pub fn ranked(&self, step: usize) -> impl Iterator<Item = Ranked> + '_ {
        self.best.iter().map(move |s| Ranked {
            name: s.candidate.name(),
            gain: s.share,
            deviations: s.deviations,
            p_value: s.p,
            step,
        })
    }

    /// The next effect, those in `skipped` left out.
    pub fn next(&self, setting: &Setting<'_>, skipped: &[String]) -> Option<(Candidate, Found)> {
        let best: Vec<&Score<'_>> = self.best.iter().filter(|s| !skipped.contains(&s.candidate.name())).collect();
        let alone = |s: &Score<'_>| s.p * self.tests < FAMILY_WISE && s.share > LEAST_GAIN && s.gain > 0.0;
        // A refinement is not named while the simpler effect that it refines is supported itself.
        let supported = |s: &Score<'_>| {
            let simpler = |o: &&&Score<'_>| {
                Some(o.candidate.effect.id) == s.candidate.effect.refines && o.candidate.at == s.candidate.at
            };
            alone(s) && !best.iter().find(simpler).is_some_and(|o| alone(o))
        };
        let Some(top) = best.iter().find(|s| supported(s)) else {
            let (first, p) = self.of_a_pair(&best)?;
            return Some((first.candidate.clone(), found(first, setting, p, Vec::new(), None)));
        };
        // Others in the same equation that held-out data do not tell from it.
        let close: Vec<&&Score<'_>> = best
            .iter()
            .filter(|s| s.candidate.equation == top.candidate.equation && supported(s))
            .filter(|s| {
                let (mean, error) = ranking::gain(&s.held.fit.held_out, &top.held.fit.held_out);
                mean <= error || s.candidate.name() == top.candidate.name()
            })
            .collect();
        let winner = close.iter().min_by_key(|s| s.candidate.rank)?;
        let name = winner.candidate.name();
        let alike = close.iter().map(|s| s.candidate.name()).filter(|n| *n != name).collect();
        let runner_up = best.iter().find(|s| s.candidate.name() != name).map(|s| (s.candidate.name(), s.share));
        Some((winner.candidate.clone(), found(winner, setting, winner.p, alike, runner_up)))
    }

    /// The first of two effects that only together are supported: each hides the other's trace while it is missing (a pendulum that Coulomb
    /// friction stops and whose damping grows with the swing looks viscous), so that a block left out moves the coefficient of one alone. Each
    /// must be significant beside the other, over the list of all pairs. The first, and its probability.
    fn of_a_pair<'b>(&'b self, best: &[&'b Score<'b>]) -> Option<(&'b Score<'b>, f64)> {
        let refines = |a: &Score<'_>, b: &Score<'_>| {
            a.candidate.effect.refines == Some(b.candidate.effect.id) && a.candidate.at == b.candidate.at
        };
        // A refinement stands only beside what it refines, where that is on the list.
        let bears = |a: &Score<'_>, b: &Score<'_>| refines(a, b) || !best.iter().any(|o| refines(a, o));
        let mut pairs = Vec::new();
        let mut tests = 0.0;
        for (k, a) in best.iter().enumerate() {
            for b in &best[k + 1..] {
                let g = self.round.group_of(a.candidate);
                if g != self.round.group_of(b.candidate) || !bears(a, b) || !bears(b, a) {
                    continue;
                }
                tests += 1.0;
                let group = &self.round.groups[g];
                // The probability of the last one's strengths beside the other's, and what is gained.
                let fit = |first: &Score<'_>, last: &Score<'_>| {
                    let columns: Vec<usize> =
                        (0..first.from).chain(first.columns.iter().chain(&last.columns).copied()).collect();
                    let signs: Vec<f64> = columns.iter().map(|c| group.signs[*c]).collect();
                    let held = group.blocks.fit(&columns, &signs)?;
                    if held.held[first.from..].contains(&true) {
                        return None;
                    }
                    let plain = &group.own.fit.held_out;
                    let (gain, _) = ranking::gain(plain, &held.fit.held_out);
                    let share = gain * plain.len() as f64 / plain.iter().sum::<f64>();
                    let inside = !held.held.contains(&true);
                    Some((ranking::p_value(&held.fit, last.columns.len()), share, inside))
                };
                if let (Some((p, share, inside)), Some((q, _, _))) = (fit(a, b), fit(b, a)) {
                    pairs.push((*a, *b, p.max(q), share, inside));
                }
            }
        }
        let supported = |p: &&(&Score<'_>, &Score<'_>, f64, f64, bool)| {
            let single = p.0.share.max(p.1.share).max(0.0);
            p.2 * tests < FAMILY_WISE && p.3 > single + LEAST_GAIN
        };
        // One beside which the model's own coefficients keep their signs unforced comes first: a law that drives one of them to its bound is not
        // the law.
        let better = |x: &&(_, _, f64, f64, bool), y: &&(_, _, f64, f64, bool)| x.4.cmp(&y.4).then(x.3.total_cmp(&y.3));
        let (a, b, p, _, _) = pairs.iter().filter(supported).max_by(better)?;
        // `best` is sorted: the first takes away more by itself.
        Some((if refines(a, b) { b } else { a }, *p))
    }
}

/// What is told of a winner.
fn found(
    winner: &Score<'_>,
    setting: &Setting<'_>,
    p_value: f64,
    indistinguishable_from: Vec<String>,
    runner_up: Option<(String, f64)>,
) -> Found {
    let c = winner.candidate;
    let mut found = Found {
        indistinguishable_from,
        equation: c.effect.equation.to_owned(),
        confirm: c.effect.confirm.to_owned(),
        p_value,
        held_out_gain: winner.share,
        runner_up,
        ..Found::empty(c.effect.id, &c.at, unit_of(setting, c))
    };
    put_value(c, &winner.held, winner.from, scale_of(setting, c), &mut found);
    found
}
