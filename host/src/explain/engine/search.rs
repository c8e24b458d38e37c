//! The search for effects: one after the other, each kept where it keeps what it promised, none that is nothing beside the others in the end.

use super::candidates::Candidate;
use super::evidence::{Outcome, refit};
use super::run::Run;
use super::setting::Setting;
use super::state::{Chosen, State};
use super::{shooting, tell};
use crate::error::Result;
use crate::explain::decidability::EXPLAINED_GAP;
use crate::explain::decision::{self, Choice, Offer};
use crate::explain::explanation::{Explanation, Found, Refused};
use crate::explain::ranking::Fit;
use crate::explain::{LEAST_PROGRESS, MOST_EFFECTS, Settings};

/// Share by which what a law without a shape leaves may exceed what one with a shape does.
const AS_LITTLE: f64 = 0.01;
/// Standard errors from nothing at which a name stands.
const CLEAR: f64 = 2.0;
/// Share of its promise at a strength of nothing that an effect must keep.
const LEAST_KEPT: f64 = 0.5;

/// `ID@PLACE` of a found effect.
pub fn named(f: &Found) -> String {
    format!("{}@{}", f.id, f.at)
}

impl Run<'_> {
    /// Adds effects until nothing more is supported; none where nothing can be decided.
    ///
    /// # Errors
    /// A record that does not determine the nominal model.
    pub fn search(&mut self, undecidable: bool, settings: &Settings) -> Result<Outcome> {
        let most = if undecidable { 0 } else { settings.most_effects.unwrap_or(MOST_EFFECTS) };
        let refitted = settings.model.is_some().then(|| "refit".to_owned());
        let mut search = Search { refused: Vec::new(), kept: None };
        loop {
            let candidates = self.setting.candidates(&self.state.physical);
            let outcome = refit(&self.setting, &mut self.state, candidates);
            if outcome.is_err() && self.setting.shooting && self.result.effects.is_empty() {
                // What no window can be followed in is left to the balance of forces.
                self.setting.shooting = false;
                continue;
            }
            let gap = outcome.as_ref().map_or(f64::NAN, |o| self.gap(&o.fit.train));
            let kept = self.result.effects.is_empty() || search.keeps(outcome.as_ref().ok(), gap, &self.result);
            let outcome = match (kept, search.kept.take()) {
                (false, Some((better, outcome))) => {
                    if let Some(f) = self.result.effects.pop() {
                        search.refuse(&f);
                    }
                    self.state = better;
                    if !self.setting.shooting {
                        self.result.refused.extend(search.refused);
                        return Ok(outcome);
                    }
                    outcome
                }
                _ => {
                    let outcome = outcome?;
                    let added = self.result.effects.last().map(named).or_else(|| refitted.clone());
                    self.push(added, gap, &outcome)?;
                    outcome
                }
            };
            if self.result.effects.len() >= most {
                return Ok(outcome);
            }
            let next = choose(&self.setting, &self.state, &outcome, &search.names(), &mut self.result);
            self.result.refused.extend(search.refused.iter().cloned());
            let Some((found, candidate)) = next else { return Ok(outcome) };
            let (found, candidate) = simpler(&self.setting, &self.state, &outcome, found, candidate);
            self.result.effects.push(found);
            search.kept = Some((self.state.clone(), outcome));
            let joined = Chosen::new(&self.setting, candidate, &self.state.physical);
            self.state.chosen.push(joined);
        }
    }

    /// Takes effects away again that beside those found after them are nothing: no name stands whose strengths are within two standard errors of none.
    ///
    /// # Errors
    /// As [`Run::search`].
    pub fn without_traces(&mut self, mut outcome: Outcome) -> Result<Outcome> {
        while let Some(k) = without_trace(&self.setting, &self.state, &outcome) {
            let _ = self.state.chosen.remove(k);
            let gone = named(&self.result.effects.remove(k - self.state.nominal));
            let why = "beside the effects found after it its strength is within two standard errors of nothing";
            self.result.refused.push(Refused::new(&gone, why.to_owned()));
            self.state.stretches = self.state.taken_off(&self.setting, &self.setting.raw);
            outcome = refit(&self.setting, &mut self.state, Vec::new())?;
            self.replace_last(&gone, &outcome)?;
        }
        Ok(outcome)
    }
}

/// Where the search for effects stands.
struct Search {
    /// Effects that did not keep what they promised.
    refused: Vec<Refused>,
    /// The state before the last effect was added, and its fit.
    kept: Option<(State, Outcome)>,
}

impl Search {
    fn refuse(&mut self, found: &Found) {
        let why = "with it in the model predictions come no nearer to the record than without it";
        self.refused.push(Refused::new(&named(found), why.to_owned()));
    }

    /// `ID@PLACE` of what was refused.
    fn names(&self) -> Vec<String> {
        self.refused.iter().map(|r| format!("{}@{}", r.id, r.at)).collect()
    }

    /// Whether the last effect stays: a wrong model makes many look significant, each must also bring predictions nearer.
    fn keeps(&self, after: Option<&Outcome>, gap: f64, result: &Explanation) -> bool {
        let (Some((_, before)), Some(after)) = (&self.kept, after) else { return false };
        match (before.left(), after.left()) {
            (Some(b), Some(a)) => {
                let promised = result.effects.last().map_or(0.0, |f| f.held_out_gain);
                a < (1.0 - LEAST_KEPT * promised.max(0.0)) * b
            }
            _ => {
                let previous = result.gap.steps.last().map_or(f64::INFINITY, |s| s.value);
                gap <= (1.0 - LEAST_PROGRESS) * previous || previous <= EXPLAINED_GAP
            }
        }
    }
}

/// The next effect and what is told of it.
fn choose(
    setting: &Setting<'_>,
    state: &State,
    outcome: &Outcome,
    refused: &[String],
    result: &mut Explanation,
) -> Option<(Found, Candidate)> {
    let step = result.effects.len();
    // A step that is chosen for again, after its effect was refused, is told once.
    result.ranking.retain(|r| r.step != step);
    let Outcome { candidates, evidence, own, fit } = outcome;
    let taken: Vec<String> =
        state.chosen.iter().map(|k| k.candidate.name(setting)).chain(refused.iter().cloned()).collect();
    let offers: Vec<Offer> = candidates
        .iter()
        .map(|c| Offer {
            name: c.name(setting),
            strengths: c.strengths(),
            positive: c.entry.positive[0],
            shapes: c.form.len(),
            refines: c.entry.refines.as_ref().map(|r| format!("{r}@{}", c.place_name(setting))),
        })
        .collect();
    let feigned = |k: usize, with: &Fit| evidence.feigned(setting, state, &fit.all, &candidates[k], with);
    let judged = evidence.judged();
    let together = |indices: &[usize]| -> Option<Box<dyn decision::Evidence>> {
        let some: Vec<&Candidate> = indices.iter().map(|&i| &candidates[i]).collect();
        let found = setting.shooting.then(|| shooting::evidence(setting, state, (&some, true), &[]));
        Some(Box::new(found.flatten()?))
    };
    let told = (&mut result.ranking, &mut result.refused);
    let Choice { index, fit, p_value, share, twins, runner_up } =
        decision::choose((&*judged, own), &offers, &taken, step, told, &feigned, &together)?;
    let candidate = &candidates[index];
    let d = candidate.strengths();
    let from = fit.all.len() - d;
    let strengths: Vec<f64> = fit.all.rows(from, d).iter().copied().collect();
    let covariance = fit.covariance.view((from, from), (d, d)).into_owned();
    let reported = tell::value(setting, &state.physical, candidate, &strengths, &covariance);
    let found = Found {
        p_value,
        held_out_gain: share,
        indistinguishable_from: twins,
        runner_up,
        ..tell::found(setting, candidate, reported)
    };
    Some((found, candidate.clone()))
}

/// Of a law with a shape and one without at the same place, which held-out data do not tell apart to first order, the one without where it leaves as little when
/// everything is refitted: Stribeck's friction at a velocity beyond the motion is Coulomb's.
fn simpler(
    setting: &Setting<'_>,
    state: &State,
    outcome: &Outcome,
    mut found: Found,
    candidate: Candidate,
) -> (Found, Candidate) {
    if !setting.shooting || candidate.refined_shape().is_none() {
        return (found, candidate);
    }
    let plain = |c: &&Candidate| {
        c.form.is_empty() && c.place == candidate.place && found.indistinguishable_from.contains(&c.name(setting))
    };
    let Some(other) = outcome.candidates.iter().find(plain).cloned() else { return (found, candidate) };
    let left = |c: &Candidate| {
        let mut trial = state.clone();
        trial.chosen.push(Chosen::new(setting, c.clone(), &state.physical));
        refit(setting, &mut trial, Vec::new()).ok().and_then(|o| o.left())
    };
    match (left(&candidate), left(&other)) {
        (Some(shaped), Some(plain)) if plain <= (1.0 + AS_LITTLE) * shaped => {
            let name = other.name(setting);
            for twin in found.indistinguishable_from.iter_mut().filter(|t| **t == name) {
                *twin = candidate.name(setting);
            }
            (found.id, found.equation) = (other.entry.id.clone(), other.entry.equation.clone());
            found.confirm.clone_from(&other.entry.confirm);
            (found, other)
        }
        _ => (found, candidate),
    }
}

/// The effect that is furthest from being anything, if one is within [`CLEAR`] standard errors of nothing.
fn without_trace(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<usize> {
    let mut at = state.values.len();
    let mut weakest: Option<(usize, f64)> = None;
    for (k, chosen) in state.chosen.iter().enumerate() {
        // What is found as an increment has its strength in the state.
        let applied = if chosen.candidate.is_applied() { 1.0 } else { 0.0 };
        let clear = (0..chosen.candidate.entry.strengths.len()).map(|i| {
            let error = outcome.fit.covariance[(at + i, at + i)].max(0.0).sqrt();
            (outcome.fit.all[at + i] + applied * chosen.strengths[i]).abs() / error.max(f64::MIN_POSITIVE)
        });
        let clear = clear.fold(0.0, f64::max);
        at += chosen.strengths.len();
        if k >= state.nominal && clear < CLEAR && weakest.is_none_or(|w| clear < w.1) {
            weakest = Some((k, clear));
        }
    }
    weakest.map(|w| w.0).filter(|_| setting.shooting)
}
