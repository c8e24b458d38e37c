//! The next effect, and what is told of it.

use nalgebra::{DMatrix, DVector};

use super::candidates::Candidate;
use super::evidence::{Evidence, Outcome};
use super::search::Search;
use super::setting::Setting;
use super::state::State;
use super::{shooting, tell};
use crate::explain::decision::{self, Audit, Choice, Offer, Rows};
use crate::explain::explanation::{Explanation, Found, Limit, Ranked};
use crate::explain::ranking::Fit;

/// The next effect and what is told of it.
pub fn choose(
    setting: &Setting<'_>,
    state: &State,
    outcome: &Outcome,
    search: &Search,
    result: &mut Explanation,
) -> Option<(Found, Candidate)> {
    let step = result.effects.len();
    let Outcome { candidates, evidence, own, fit } = outcome;
    let refused = search.names();
    let offers: Vec<Offer> = candidates
        .iter()
        .map(|c| Offer {
            name: c.name(setting),
            strengths: c.strengths(),
            positive: c.entry.positive[0],
            shapes: c.form.len(),
            refines: c.entry.refines.as_ref().map(|r| format!("{r}@{}", c.place_name(setting))),
            taken: search.has(setting, state, c, &refused),
            moved: c.is_moved,
        })
        .collect();
    let feigned = |k: usize, with: &Fit| evidence.feigned(setting, state, &fit.all, &candidates[k], with);
    let rows;
    let judged: &dyn decision::Evidence = match evidence {
        Evidence::Weak(design, weights) => {
            rows = Rows { design, weights };
            &rows
        }
        Evidence::Shooting(blocks) => blocks,
    };
    let together = |indices: &[usize]| -> Option<Box<dyn decision::Evidence>> {
        let some: Vec<&Candidate> = indices.iter().map(|&i| &candidates[i]).collect();
        let found = setting.shooting.then(|| shooting::evidence(setting, state, &some, true, &[]));
        Some(Box::new(found.flatten()?))
    };
    let selection = decision::Selection { evidence: judged, own, offers: &offers };
    let mut audit = Audit::default();
    let choice = decision::choose(&selection, step, &mut audit, &feigned, &together);
    rank(&mut result.ranking, step, audit.ranking);
    result.refused = audit.refused;
    let limit = |(k, strengths): (usize, DVector<f64>)| limit_of(setting, state, &candidates[k], &strengths);
    result.detection_limits = audit.limits.into_iter().filter_map(limit).collect();
    let Choice { index, fit, p_value, share, twins, runner_up } = choice?;
    let candidate = &candidates[index];
    let found = Found {
        p_value,
        held_out_gain: share,
        indistinguishable_from: twins,
        runner_up,
        ..tell_of(setting, state, candidate, &fit)
    };
    Some((found, candidate.clone()))
}

/// Puts the candidates of a step into the ranking. A step that is chosen for again, after its effect
/// was refused, is told once, with those that are not offered any more.
fn rank(ranking: &mut Vec<Ranked>, step: usize, found: Vec<Ranked>) {
    let (before, others): (Vec<Ranked>, Vec<Ranked>) =
        core::mem::take(ranking).into_iter().partition(|r| r.step == step);
    let gone = before.into_iter().filter(|r| found.iter().all(|f| f.name != r.name));
    let (better, worse): (Vec<Ranked>, Vec<Ranked>) =
        gone.partition(|r| found.first().is_none_or(|best| r.gain > best.gain));
    *ranking = others.into_iter().chain(better).chain(found).chain(worse).collect();
}

/// What is told of strengths from which on a candidate would have been named; none where its value
/// has no size in the laboratory's units.
fn limit_of(setting: &Setting<'_>, state: &State, candidate: &Candidate, strengths: &DVector<f64>) -> Option<Limit> {
    let none = DMatrix::zeros(strengths.len(), strengths.len());
    let (reported, unit) = tell::value(setting, &state.physical, candidate, strengths.as_slice(), &none);
    let value = reported.value.abs();
    let told = Limit { id: candidate.entry.id.clone(), at: candidate.place_name(setting), value, unit };
    (value.is_finite() && value > 0.0).then_some(told)
}

/// What is told of a candidate whose strengths stand last in a fit.
pub fn tell_of(setting: &Setting<'_>, state: &State, candidate: &Candidate, fit: &Fit) -> Found {
    let d = candidate.strengths();
    let from = fit.all.len() - d;
    let strengths: Vec<f64> = fit.all.rows(from, d).iter().copied().collect();
    let covariance = fit.covariance.view((from, from), (d, d)).into_owned();
    let (reported, unit) = tell::value(setting, &state.physical, candidate, &strengths, &covariance);
    tell::found(setting, candidate, reported, unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_refused_once_stays_in_the_ranking() {
        let of = |list: &[(&str, f64)], step| -> Vec<Ranked> {
            let one = |&(name, gain): &(&str, f64)| Ranked {
                name: name.to_owned(),
                gain,
                deviations: 0.0,
                p_value: 0.1,
                step,
            };
            list.iter().map(one).collect()
        };
        let mut ranking = of(&[("best", 0.9), ("next", 0.4), ("last", 0.1)], 0);
        rank(&mut ranking, 1, of(&[("other", 0.2)], 1));
        rank(&mut ranking, 0, of(&[("next", 0.4)], 0));
        let told: Vec<(&str, usize)> = ranking.iter().map(|r| (r.name.as_str(), r.step)).collect();
        assert_eq!(told, [("other", 1), ("best", 0), ("next", 0), ("last", 0)]);
    }
}
