//! Which effect is added next: every candidate is added in turn, everything refitted, and the best of those that are significant
//! over the whole list is taken; the simplest within a standard error of it, since simpler ones explain as much.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::design::Design;
use super::explanation::Ranked;
use super::ranking::{self, Weights};

/// Probability of naming anything on a record in which nothing is missing, over the whole list.
pub(super) const FAMILY_WISE: f64 = 0.01;

/// Share of the held-out residual power from which weights are estimated anew with each candidate: those of a model that misses so much misjudge forms that
/// are close to each other.
const STRONG: f64 = 0.15;
/// Difference of that held-out score, −2 ln of a likelihood ratio, up to which two candidates are not told apart: two standard errors, four, times the
/// two and a half by which correlated neighbouring frequencies count too often.
const CLOSE: f64 = 10.0;
/// Share above which the forms of one effect are told apart in this way as well, and the most forms judged below and above it.
const OVERWHELMING: f64 = 0.75;
const RERANKED: [usize; 2] = [20, 60];

/// A candidate whose columns stand behind the model's own, in the order of the offers.
pub(super) struct Offer {
    /// `ID@PLACE`; several forms of one effect have the same.
    pub(super) name: String,
    /// Number of its columns.
    pub(super) strengths: usize,
    /// Whether its first strength is positive: a friction that feeds the motion is none, whatever it explains.
    pub(super) positive: bool,
    /// Number of its shape parameters.
    pub(super) shapes: usize,
}

/// What was chosen.
pub(super) struct Choice {
    /// Its number among the offers.
    pub(super) index: usize,
    /// The fit with it, its strengths last.
    pub(super) fit: ranking::Fit,
    /// Probability by chance.
    pub(super) p_value: f64,
    /// Share of the held-out residual power that it takes away.
    pub(super) share: f64,
    /// Others that held-out data do not tell from it.
    pub(super) twins: Vec<String>,
    /// The next best and its share.
    pub(super) runner_up: Option<(String, f64)>,
}

/// The next effect; none where no candidate is supported. `taken`: what the model has already. `feigned` says whether the sensors
/// alone give such strengths.
pub(super) fn choose(
    (design, own, weights): (&Design, &[usize], &Weights),
    offers: &[Offer],
    taken: &[String],
    step: usize,
    ranking_out: &mut Vec<Ranked>,
    feigned_by_sensors: &dyn Fn(usize, &ranking::Fit) -> bool,
) -> Option<Choice> {
    let plain = ranking::fit(design, own, weights)?;
    let total: f64 = plain.held_out.iter().sum();
    let mut at = own.len();
    let places: Vec<(usize, usize)> = offers
        .iter()
        .map(|o| {
            let d = o.strengths;
            at += d;
            (at - d, d)
        })
        .collect();
    struct Score {
        index: usize,
        gain: f64,
        deviations: f64,
        p: f64,
        held_out: Vec<f64>,
        fit: ranking::Fit,
    }
    let scores: Vec<Score> = (0..offers.len())
        .into_par_iter()
        .filter(|&i| !taken.contains(&offers[i].name))
        .filter_map(|index| {
            let (from, d) = places[index];
            let columns: Vec<usize> = own.iter().copied().chain(from..from + d).collect();
            let fit = ranking::fit(design, &columns, weights)?;
            let (mean, error) = ranking::gain(&plain.held_out, &fit.held_out);
            let p = ranking::p_value(&fit, d);
            Some(Score {
                index,
                gain: mean,
                deviations: mean / error.max(f64::MIN_POSITIVE),
                p,
                held_out: fit.held_out.clone(),
                fit,
            })
        })
        .collect();
    let tests = scores.len().max(1) as f64;
    let mut likelihood: BTreeMap<usize, f64> = BTreeMap::new();
    // The best form of each effect at each place.
    let mut best: BTreeMap<&str, &Score> = BTreeMap::new();
    for s in &scores {
        let entry = best.entry(&offers[s.index].name).or_insert(s);
        if s.gain > entry.gain {
            *entry = s;
        }
    }
    let blocks = plain.held_out.len() as f64;
    if let Some(winner) = best.values().max_by(|a, b| a.gain.total_cmp(&b.gain))
        && winner.gain * blocks > STRONG * total
    {
        // Weights from a model that misses this much are wrong, and so is the order that they give.
        let most = RERANKED[usize::from(winner.gain * blocks > OVERWHELMING * total)];
        let again =
            reranked(design, own, weights, most, &scores.iter().map(|s| (s.gain, places[s.index])).collect::<Vec<_>>());
        for (name, entry) in &mut best {
            let own_forms = scores.iter().zip(&again).filter(|(s, _)| offers[s.index].name == *name);
            if let Some((form, _)) = own_forms.filter(|(_, j)| j.is_finite()).min_by(|a, b| a.1.total_cmp(b.1)) {
                *entry = form;
            }
        }
        likelihood = scores.iter().zip(&again).map(|(s, j)| (s.index, *j)).collect();
    }
    let mut order: Vec<(&&str, &&Score)> = best.iter().collect();
    order.sort_by(|a, b| {
        let j = |s: &Score| likelihood.get(&s.index).copied().unwrap_or(f64::INFINITY);
        j(a.1).total_cmp(&j(b.1)).then(b.1.gain.total_cmp(&a.1.gain))
    });
    ranking_out.extend(order.iter().map(|(name, s)| Ranked {
        name: (**name).to_owned(),
        gain: s.gain * blocks / total,
        deviations: s.deviations,
        p_value: s.p,
        step,
    }));
    // The first strength stands where the candidate's own begin. A friction that feeds the motion is none, whatever it explains.
    let feeds = |s: &Score| {
        let (_, d) = places[s.index];
        offers[s.index].positive && s.fit.all[s.fit.all.len() - d] < 0.0
    };
    // Of those within a standard error of the best, the simplest (Breiman et al. 1984, the one-standard-error rule).
    let complexity = |s: &Score| {
        let o = &offers[s.index];
        o.strengths + o.shapes
    };
    let mut feigned: Vec<usize> = Vec::new();
    let (name, winner) = loop {
        let significant =
            |s: &Score| s.p * tests < FAMILY_WISE && s.gain > 0.0 && !feeds(s) && !feigned.contains(&s.index);
        let (_, strongest) = order.iter().find(|(_, s)| significant(s))?;
        let (name, winner) = order
            .iter()
            .filter(|(_, s)| significant(s))
            .filter(|(_, s)| {
                let (mean, error) = ranking::gain(&s.held_out, &strongest.held_out);
                mean <= error
            })
            .min_by_key(|(_, s)| complexity(s))?;
        // What is overwhelming is no artefact of the sensors.
        let small = winner.gain * blocks < STRONG * total;
        if !(small && feigned_by_sensors(winner.index, &winner.fit)) {
            break (name, winner);
        }
        feigned.push(winner.index);
    };
    let significant = |s: &Score| s.p * tests < FAMILY_WISE && s.gain > 0.0 && !feeds(s) && !feigned.contains(&s.index);
    let runner_up = order.iter().find(|(n, _)| n != name).map(|(n, s)| ((**n).to_owned(), s.gain * blocks / total));
    let twins: Vec<String> = order
        .iter()
        .filter(|(n, s)| n != name && significant(s))
        .filter(|(_, s)| {
            let (mean, error) = ranking::gain(&s.held_out, &winner.held_out);
            let worse = match (likelihood.get(&s.index), likelihood.get(&winner.index)) {
                (Some(a), Some(b)) => a - b,
                _ => f64::INFINITY,
            };
            mean < 2.0 * error || worse < CLOSE
        })
        .map(|(n, _)| (**n).to_owned())
        .collect();
    let share = winner.gain * blocks / total;
    Some(Choice { index: winner.index, fit: winner.fit.clone(), p_value: winner.p, share, twins, runner_up })
}

/// Held-out score of the strongest candidates with weights from their own fits, infinite for the others: Σ n ln s² over equations and frequencies,
/// the concentrated likelihood when the variance of each frequency is unknown. Smaller is better.
fn reranked(
    design: &Design,
    own: &[usize],
    weights: &Weights,
    most: usize,
    scores: &[(f64, (usize, usize))],
) -> Vec<f64> {
    let mut gains: Vec<f64> = scores.iter().map(|s| s.0).collect();
    gains.sort_by(|a, b| b.total_cmp(a));
    let least = gains.get(most - 1).or(gains.last()).copied().unwrap_or(f64::INFINITY);
    scores
        .par_iter()
        .map(|&(gain, (from, d))| {
            if gain < least {
                return f64::INFINITY;
            }
            let columns: Vec<usize> = own.iter().copied().chain(from..from + d).collect();
            let mut w = weights.clone();
            for _ in 0..3 {
                let Some(fit) = ranking::fit_some(design, &columns, &w, |_| true) else { return f64::INFINITY };
                w = ranking::weights(design, &columns, &fit);
            }
            ranking::held_out_likelihood(design, &columns, &w).unwrap_or(f64::INFINITY)
        })
        .collect()
}
