//! Naming: every candidate is added in turn, everything refitted, and the best of those that are significant over the whole list is taken.

use std::collections::BTreeMap;

use nalgebra::DVector;

use super::artefact;
use super::decision::{self, Choice, Offer, Rows};
use super::design::{self, Design};
use super::effects::{Compose, Context, Place, Scale, Variant};
use super::explanation::{Found, Ranked};
use super::ranking::{self, Weights};
use super::state::{Candidate, State};
use super::{Outcome, singular};
use crate::error::Result;
use crate::identify::Geometry;
use crate::signal::angles::AngleSegment;

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
        let used = weights.clone().unwrap_or_else(|| ranking::equal_weights(&design));
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
    let taken: Vec<String> = state.chosen.iter().map(|k| k.candidate.name()).collect();
    let offers: Vec<Offer> = variants
        .iter()
        .map(|v| Offer {
            name: v.name(),
            strengths: v.variant.action.len(),
            positive: DISSIPATIVE.contains(&v.effect.id),
            shapes: v.variant.shape.len(),
            refines: None,
        })
        .collect();
    let Outcome { design, weights, own, .. } = outcome;
    let feigned = |k: usize, fit: &ranking::Fit| artefact::feigned(state, outcome, sensors, &variants[k], fit);
    let Choice { index, fit, p_value, share, mut twins, runner_up } =
        decision::choose((&Rows { design, weights }, own), &offers, &taken, step, ranking_out, &feigned)?;
    let candidate = &variants[index];
    let name = candidate.name();
    for (a, b) in [("zero-offset@encoder2", "imbalance@arm2"), ("imbalance@arm2", "zero-offset@encoder2")] {
        if name == a && !twins.iter().any(|t| t == b) {
            twins.push(b.to_owned());
        }
    }
    // Beside a Coulomb level, a level that differs with direction is that level and a constant torque.
    for joint in ["joint1", "joint2"].into_iter().filter(|j| taken.contains(&format!("coulomb-friction@{j}"))) {
        let pair = [format!("asymmetric-friction@{joint}"), format!("constant-force@{joint}")];
        if let Some(at) = pair.iter().position(|p| *p == name)
            && !twins.contains(&pair[1 - at])
        {
            twins.push(pair[1 - at].clone());
        }
    }
    let (value, error, parameters, unit) = read(&state.context, candidate, &fit.all, &fit.covariance);
    Some(Next {
        index,
        found: Found {
            id: candidate.effect.id.to_owned(),
            at: candidate.place.name().to_owned(),
            value,
            std_error: error,
            unit,
            equation: candidate.effect.equation.to_owned(),
            parameters,
            indistinguishable_from: twins,
            p_value,
            held_out_gain: share,
            runner_up,
            confirm: candidate.effect.confirm.to_owned(),
            strengths: Vec::new(),
        },
    })
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
