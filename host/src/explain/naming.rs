//! Naming: every candidate is added in turn, everything refitted, and the best of those that are significant over the whole list is taken.

use std::collections::BTreeMap;

use nalgebra::DVector;
use rayon::prelude::*;

use super::artefact;
use super::design::{self, Design};
use super::effects::{Compose, Context, Place, Scale, Variant};
use super::explanation::{Found, Ranked};
use super::ranking::{self, Weights};
use super::state::{Candidate, State};
use super::{Outcome, singular};
use crate::error::Result;
use crate::identify::Geometry;
use crate::signal::angles::AngleSegment;

/// Probability of naming anything on a record in which nothing is missing, over the whole list.
pub(super) const FAMILY_WISE: f64 = 0.01;

/// Fits everything chosen, updates ties, and builds the columns of the candidates behind its own.
pub(super) fn refit(
    state: &mut State,
    raw: &[AngleSegment],
    geometry: &Geometry,
    variants: &[Candidate],
) -> Result<(Design, Weights, Vec<usize>)> {
    let own: Vec<usize> = (0..state.own_columns()).collect();
    let mut weights: Option<Weights> = None;
    // The first rounds settle weights, linearised effects and forms; the last carries the candidates' columns as well.
    let rounds = if state.chosen.iter().any(|k| k.candidate.variant.refine.is_some()) { 4 } else { 2 };
    for round in 0..rounds {
        let last = round + 1 == rounds;
        let list: Vec<&Variant> = state
            .chosen
            .iter()
            .map(|k| &k.candidate.variant)
            .chain(variants.iter().filter(|_| last).map(|k| &k.variant))
            .collect();
        let model = state.model();
        let design = design::build(&state.context, &state.segments, geometry, &list, &model, &state.base);
        let equal = [vec![1.0; design.frequencies + 1], vec![1.0; design.frequencies + 1]];
        let used = weights.clone().unwrap_or(equal);
        let fit = ranking::fit(&design, &own, &used).ok_or_else(singular)?;
        let mut w = ranking::weights(&design, &own, &fit.all);
        if !last {
            // Weights from an unweighted fit are rough: once more.
            let fit = ranking::fit(&design, &own, &w).ok_or_else(singular)?;
            w = ranking::weights(&design, &own, &fit.all);
            state.take(&fit.all, raw);
            state.renew();
            weights = Some(w);
        } else {
            return Ok((design, w, own));
        }
    }
    Err(singular())
}

/// Share of the held-out residual power from which weights are estimated anew with each candidate: those of a model that misses so much misjudge forms that
/// are close to each other.
const STRONG: f64 = 0.15;
/// Difference of that held-out score, −2 ln of a likelihood ratio, up to which two candidates are not told apart: two standard errors, four, times the
/// two and a half by which correlated neighbouring frequencies count too often.
const CLOSE: f64 = 10.0;
/// Share above which the forms of one effect are told apart in this way as well, and the most forms judged below and above it.
const OVERWHELMING: f64 = 0.75;
const RERANKED: [usize; 2] = [20, 60];

/// Effects that take energy away, or in which friction falls with speed: their strengths are positive.
const DISSIPATIVE: [&str; 5] =
    ["viscous-friction", "coulomb-friction", "stribeck-friction", "load-dependent-friction", "quadratic-drag"];

/// The next effect to add.
pub(super) struct Next {
    pub(super) index: usize,
    pub(super) found: Found,
}

pub(super) fn choose(
    state: &State,
    outcome: &Outcome,
    sensors: (&Geometry, [f64; 2]),
    variants: &[Candidate],
    step: usize,
    ranking_out: &mut Vec<Ranked>,
) -> Option<Next> {
    let Outcome { design, weights, own, .. } = outcome;
    let plain = ranking::fit(design, own, weights)?;
    let total: f64 = plain.held_out.iter().sum();
    let taken: Vec<String> = state.chosen.iter().map(|k| k.candidate.name()).collect();
    let mut at = own.len();
    let places: Vec<(usize, usize)> = variants
        .iter()
        .map(|v| {
            let d = v.variant.action.len();
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
    let scores: Vec<Score> = (0..variants.len())
        .into_par_iter()
        .filter(|&i| !taken.contains(&variants[i].name()))
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
    let mut best: BTreeMap<String, &Score> = BTreeMap::new();
    for s in &scores {
        let entry = best.entry(variants[s.index].name()).or_insert(s);
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
            let own_forms = scores.iter().zip(&again).filter(|(s, _)| variants[s.index].name() == *name);
            if let Some((form, _)) = own_forms.filter(|(_, j)| j.is_finite()).min_by(|a, b| a.1.total_cmp(b.1)) {
                *entry = form;
            }
        }
        likelihood = scores.iter().zip(&again).map(|(s, j)| (s.index, *j)).collect();
    }
    let mut order: Vec<(&String, &&Score)> = best.iter().collect();
    order.sort_by(|a, b| {
        let j = |s: &Score| likelihood.get(&s.index).copied().unwrap_or(f64::INFINITY);
        j(a.1).total_cmp(&j(b.1)).then(b.1.gain.total_cmp(&a.1.gain))
    });
    ranking_out.extend(order.iter().map(|(name, s)| Ranked {
        name: (*name).clone(),
        gain: s.gain * blocks / total,
        deviations: s.deviations,
        p_value: s.p,
        step,
    }));
    // The first strength stands where the candidate's own begin. A friction that feeds the motion is none, whatever it explains.
    let feeds = |s: &Score| {
        let (_, d) = places[s.index];
        DISSIPATIVE.contains(&variants[s.index].effect.id) && s.fit.all[s.fit.all.len() - d] < 0.0
    };
    // Of those within a standard error of the best, the simplest (Breiman et al. 1984, the one-standard-error rule).
    let complexity = |s: &Score| {
        let v = &variants[s.index].variant;
        v.action.len() + v.shape.len()
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
        if !(small && artefact::feigned(state, outcome, sensors, &variants[winner.index], &winner.fit)) {
            break (name, winner);
        }
        feigned.push(winner.index);
    };
    let significant = |s: &Score| s.p * tests < FAMILY_WISE && s.gain > 0.0 && !feeds(s) && !feigned.contains(&s.index);
    let runner_up = order.iter().find(|(n, _)| n != name).map(|(n, s)| ((*n).clone(), s.gain * blocks / total));
    let mut twins: Vec<String> = order
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
        .map(|(n, _)| (*n).clone())
        .collect();
    for (a, b) in [("zero-offset@encoder2", "imbalance@arm2"), ("imbalance@arm2", "zero-offset@encoder2")] {
        if *name == a && !twins.iter().any(|t| t == b) {
            twins.push(b.to_owned());
        }
    }
    // Beside a Coulomb level, a level that differs with direction is that level and a constant torque.
    for joint in ["joint1", "joint2"].into_iter().filter(|j| taken.contains(&format!("coulomb-friction@{j}"))) {
        let pair = [format!("asymmetric-friction@{joint}"), format!("constant-force@{joint}")];
        if let Some(at) = pair.iter().position(|p| p == *name)
            && !twins.contains(&pair[1 - at])
        {
            twins.push(pair[1 - at].clone());
        }
    }
    let candidate = &variants[winner.index];
    let (value, error, parameters, unit) = read(&state.context, candidate, &winner.fit.all, &winner.fit.covariance);
    Some(Next {
        index: winner.index,
        found: Found {
            id: candidate.effect.id.to_owned(),
            at: candidate.place.name().to_owned(),
            value,
            std_error: error,
            unit,
            equation: candidate.effect.equation.to_owned(),
            parameters,
            indistinguishable_from: twins,
            p_value: winner.p,
            held_out_gain: winner.gain * blocks / total,
            runner_up,
            confirm: candidate.effect.confirm.to_owned(),
            strengths: Vec::new(),
        },
    })
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

/// Value, standard error, parameters and unit of a candidate whose strengths are the last coefficients.
pub(super) fn read(
    c: &Context,
    candidate: &Candidate,
    x: &DVector<f64>,
    covariance: &nalgebra::DMatrix<f64>,
) -> (f64, f64, BTreeMap<String, f64>, String) {
    let d = candidate.variant.action.len();
    let from = x.len() - d;
    let strengths: Vec<f64> = x.rows(from, d).iter().copied().collect();
    let covariance = covariance.view((from, from), (d, d)).into_owned();
    compose(c, candidate, &strengths, &covariance)
}

pub(super) fn compose(
    c: &Context,
    candidate: &Candidate,
    k: &[f64],
    covariance: &nalgebra::DMatrix<f64>,
) -> (f64, f64, BTreeMap<String, f64>, String) {
    let first = matches!(candidate.place, Place::Joint1 | Place::Arm1);
    let (scale, unit) = match (candidate.variant.scale, c.known.get("J_o2")) {
        (Scale::Plain(f), _) => (f, candidate.effect.unit.to_owned()),
        (Scale::Torque, Some(j)) => (*j, candidate.effect.unit.to_owned()),
        (Scale::Torque, None) => {
            let (j, name) = if first { (c.inertia(0), "J_o1") } else { (1.0, "J_o2") };
            (1.0 / j, format!("{}/({name} kg m²)", candidate.effect.unit))
        }
    };
    let mut parameters: BTreeMap<String, f64> =
        candidate.variant.shape.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect();
    if let (Compose::Shape { torque }, [(form, at), ..]) = (candidate.variant.compose, &candidate.variant.shape[..]) {
        // What is left of the last Gauss–Newton step belongs to the value.
        let (step, error) = match k {
            [k, d] => (d / k, covariance[(1, 1)].max(0.0).sqrt() / k.abs()),
            _ => (0.0, 0.25 * at.abs()),
        };
        let _ = parameters.remove(*form);
        parameters.insert(torque.to_owned(), k[0] * scale);
        return (at + step, error, parameters, candidate.effect.unit.to_owned());
    }
    let (value, error) = match candidate.variant.compose {
        Compose::Single | Compose::Shape { .. } => (k[0], covariance[(0, 0)].sqrt()),
        Compose::Components(name) => {
            parameters.insert(name.to_owned(), k[1] * scale);
            (k[0], covariance[(0, 0)].sqrt())
        }
        Compose::AmplitudePhase(name) => {
            let size = k[0].hypot(k[1]);
            parameters.insert(name.to_owned(), k[1].atan2(k[0]));
            let (a, b) = (k[0] / size, k[1] / size);
            let variance = a * a * covariance[(0, 0)] + 2.0 * a * b * covariance[(0, 1)] + b * b * covariance[(1, 1)];
            (size, variance.max(0.0).sqrt())
        }
    };
    (value * scale, error * scale.abs(), parameters, unit)
}
