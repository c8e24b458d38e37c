//! The search for effects: one after the other, each kept where it keeps what it promised, none
//! that is nothing beside the others in the end.

use nalgebra::DVector;

use super::candidates::Candidate;
use super::chosen::{choose, tell_of};
use super::evidence::{Evidence, Outcome, refit};
use super::exchange::{self, Exchange, MISSES};
use super::followed_on::LONGER;
use super::run::Run;
use super::setting::Setting;
use super::shooting::Followed;
use super::state::{Chosen, State};
use super::traces::{is_of_many, without_trace};
use super::{offered, shooting, tones};
use crate::error::Result;
use crate::explain::decidability::EXPLAINED_GAP;
use crate::explain::decision::{LEFT_BY_MOVED, OF_A_FAMILY};
use crate::explain::explanation::{Explanation, Found, Refused};
use crate::explain::{LEAST_PROGRESS, MOST_EFFECTS, Settings};

/// Most exchanges that are tried.
const MOST_EXCHANGES: usize = 16;
/// Times that the search goes on after effects were taken away.
const MOST_RESUMED: usize = 3;
/// Share of its promise at a strength of nothing that an effect must keep (by hand).
const LEAST_KEPT: f64 = 0.5;
/// Growth of a gap from which an effect is none, whatever it leaves in the windows of shooting (by
/// hand: of 95 records two had such a one, both wrong; no right one grew by 2 %). A gap that is more
/// than noise has to fall: of 332 records three had an effect with which it did not, all wrong.
const FARTHER: f64 = 1.05;
/// Why an effect is refused.
const NO_NEARER: &str = "with it in the model predictions come no nearer to the record than without it";
const BY_STEPS: &str = "it changes faster than the samples follow: with finer steps of integration it explains nothing";

impl Run<'_> {
    /// Adds effects until nothing more is supported, none where nothing can be decided, and takes
    /// away those that are nothing beside the others: what had stood in for another makes room for
    /// it.
    ///
    /// # Errors
    /// A record that does not determine the nominal model.
    pub fn search(&mut self, undecidable: bool, settings: &Settings) -> Result<Outcome> {
        let most = if undecidable { 0 } else { settings.most_effects.unwrap_or(MOST_EFFECTS) };
        let refitted = settings.model.is_some().then(|| "refit".to_owned());
        let mut search = Search::default();
        let outcome = self.added(&mut search, most, refitted.as_ref(), None)?;
        let outcome = self.cleared(&mut search, most, outcome)?;
        if undecidable {
            return Ok(outcome);
        }
        let mut outcome = if settings.model.is_none() { self.in_shorter_windows(most, outcome)? } else { outcome };
        for blocks in LONGER {
            let (kept, before) = (self.told.clone(), self.setting.blocks);
            let Some(longer) = self.followed_on(blocks)? else { break };
            search.in_longer = true;
            let mut again = self.added(&mut search, most, None, Some(longer))?;
            again = self.cleared(&mut search, most, again)?;
            if settings.model.is_none() {
                again = self.searched_again(most, again)?;
            }
            if !self.is_followed(&again)? {
                (self.told, self.setting.blocks) = (kept, before);
                break;
            }
            outcome = again;
        }
        Ok(outcome)
    }

    /// Adds to what no effect is told apart from those that are as good in its place now that all are
    /// in the model.
    pub fn tell_twins(&mut self, outcome: &Outcome) {
        // The list of a single one was made beside nothing else.
        if self.told.result.effects.len() < 2 {
            return;
        }
        let all = exchange::twins(&self.setting, &self.told.state, outcome);
        for (found, names) in self.told.result.effects.iter_mut().zip(all) {
            let known = found.indistinguishable_from.clone();
            found.indistinguishable_from.extend(names.into_iter().filter(|n| !known.contains(n)));
        }
    }

    /// Takes away what is nothing beside the others, and goes on with what had no room for it.
    pub(super) fn cleared(&mut self, search: &mut Search, most: usize, mut outcome: Outcome) -> Result<Outcome> {
        for _ in 0..MOST_RESUMED {
            let (cleared, gone) = self.without_traces(search, outcome)?;
            if !gone {
                return Ok(cleared);
            }
            outcome = self.added(search, most, None, Some(cleared))?;
        }
        Ok(self.without_traces(search, outcome)?.0)
    }

    /// Adds effects until nothing more is supported, from an outcome that is known already or from
    /// the state.
    pub(super) fn added(
        &mut self,
        search: &mut Search,
        most: usize,
        refitted: Option<&String>,
        mut known: Option<Outcome>,
    ) -> Result<Outcome> {
        loop {
            if let Some(outcome) = known.take() {
                match self.next(search, outcome, most) {
                    Some(outcome) => return Ok(outcome),
                    None => continue,
                }
            }
            let candidates = offered::candidates(&self.setting, &self.told.state);
            let begun = self.told.result.effects.is_empty().then(|| self.told.state.clone());
            let outcome = refit(&self.setting, &mut self.told.state, candidates);
            if let (true, true, Some(begun)) = (outcome.is_err(), self.setting.shooting, begun) {
                // What no window can be followed in is left to the balance of forces.
                (self.setting.shooting, self.told.state) = (false, begun);
                continue;
            }
            let gap = outcome.as_ref().map_or(f64::NAN, |o| self.gap(o));
            let kept = self.told.result.effects.is_empty()
                || search.keeps(&self.told.state, outcome.as_ref().ok(), gap, &self.told.result);
            let is_made_by_steps = kept && search.kept.is_some() && self.is_made_by_steps();
            let outcome = match (kept && !is_made_by_steps, search.kept.take()) {
                (false, Some(before)) => {
                    let is_moved = self.told.state.chosen.last().is_some_and(|c| c.candidate.is_moved);
                    let exchanged = before.gone.is_some();
                    let refused = self.told.result.effects.last().cloned();
                    (self.told.result.effects, self.told.state) = (before.effects, before.state);
                    if is_moved && !exchanged {
                        self.told.state.moved_in_vain.extend(refused.as_ref().map(Found::name));
                    } else {
                        let why = if is_made_by_steps { BY_STEPS } else { NO_NEARER };
                        search.refuse(refused.as_ref(), exchanged, why);
                    }
                    if !self.setting.shooting {
                        self.told.result.refuse(core::mem::take(&mut search.refused));
                        return Ok(before.outcome);
                    }
                    before.outcome
                }
                (_, before) => {
                    let outcome = outcome?;
                    let added = self.told.result.effects.last().map(Found::name).or_else(|| refitted.cloned());
                    self.push(added, gap, &outcome)?;
                    // Beside another effect what was no better may be.
                    search.vain.clear();
                    search.try_again();
                    if let Some(gone) = before.and_then(|b| b.gone) {
                        self.told.result.forget(&gone);
                    }
                    outcome
                }
            };
            if let Some(outcome) = self.next(search, outcome, most) {
                return Ok(outcome);
            }
        }
    }

    /// Whether steps of integration made what the last effect explains.
    fn is_made_by_steps(&self) -> bool {
        self.setting.shooting && !shooting::outlasts_finer_steps(&self.setting, &self.told.state)
    }

    /// Puts the next effect into the model, or another in the place of one that was found; the
    /// outcome as it is where nothing more is supported.
    fn next(&mut self, search: &mut Search, outcome: Outcome, most: usize) -> Option<Outcome> {
        let effects = self.told.result.effects.clone();
        // What was found while others were missing may have stood in for them.
        if let Some((candidate, promised, gone)) = self.exchanged(search, &outcome) {
            self.join(search, candidate, outcome, effects, promised, Some(gone));
            return None;
        }
        if effects.len() >= most {
            return Some(outcome);
        }
        let next = choose(&self.setting, &self.told.state, &outcome, search, &mut self.told.result);
        self.told.result.refuse(search.refused.iter().cloned());
        let next = next.or_else(|| self.tone(search, &outcome));
        let Some((found, candidate)) = next else { return Some(outcome) };
        let promised = found.held_out_gain;
        self.told.result.effects.push(found);
        self.join(search, candidate, outcome, effects, promised, None);
        None
    }

    /// A force in the laboratory's time, where nothing else is supported.
    fn tone(&mut self, search: &Search, outcome: &Outcome) -> Option<(Found, Candidate)> {
        let (candidates, tests) = tones::candidates(&self.setting, &self.told.state, outcome);
        let further: Vec<&Candidate> = candidates.iter().collect();
        if further.is_empty() {
            return None;
        }
        let blocks = shooting::evidence(&self.setting, &self.told.state, &further, false, &[])?;
        let (own, fit) = (outcome.own.clone(), outcome.fit.clone());
        let outcome = Outcome { candidates, evidence: Evidence::Shooting(blocks), own, fit };
        let result = &self.told.result;
        let told = (result.ranking.clone(), result.refused.clone(), result.detection_limits.clone());
        let next = choose(&self.setting, &self.told.state, &outcome, search, &mut self.told.result);
        // The frequency was the best of many.
        let next = next.filter(|(found, _)| found.p_value * tests < OF_A_FAMILY);
        if next.is_none() {
            let result = &mut self.told.result;
            (result.ranking, result.refused, result.detection_limits) = told;
        }
        next
    }

    /// Puts a candidate into the model, in the place of another or beside the others, and keeps
    /// what there was before.
    fn join(
        &mut self,
        search: &mut Search,
        candidate: Candidate,
        outcome: Outcome,
        effects: Vec<Found>,
        promised: f64,
        gone: Option<Gone>,
    ) {
        let mut state = self.told.state.clone();
        if let Some(gone) = &gone {
            let _ = state.chosen.remove(gone.index);
        }
        state.chosen.push(Chosen::new(&self.setting, candidate, &self.told.state.physical));
        if let Some(gone) = &gone {
            // From nothing the windows would be led astray, where what goes is most of what moves them.
            let x = gone.fit.clone().resize_vertically(state.own_columns(), 0.0);
            state.take(&self.setting, &x);
        }
        let state = core::mem::replace(&mut self.told.state, state);
        search.kept = Some(Before { state, outcome, effects, promised, gone: gone.map(|g| g.name) });
    }

    /// Another effect in the place of one that was found, which is told at the end of the others:
    /// the candidate, what it promises, and what goes.
    fn exchanged(&mut self, search: &mut Search, outcome: &Outcome) -> Option<(Candidate, f64, Gone)> {
        if search.exchanges >= MOST_EXCHANGES {
            return None;
        }
        // One that was refused beside a model which lacked others may be right in the place of one.
        let never = [&search.vain[..], &search.traces].concat();
        let taken = |c: &Candidate| search.has(&self.setting, &self.told.state, c, &never);
        let Exchange { gone, index, fit, p_value, promised, share, twins } =
            exchange::best(&self.setting, &self.told.state, outcome, &taken, &self.told.result.effects)?;
        search.exchanges += 1;
        let candidate = outcome.candidates[index].clone();
        let old = self.told.result.effects.remove(gone - self.told.state.nominal).name();
        let found = tell_of(&self.setting, &self.told.state, &candidate, &fit);
        let found = Found { p_value, held_out_gain: share, indistinguishable_from: twins, ..found };
        self.told.result.effects.push(found);
        Some((candidate, promised, Gone { index: gone, name: old, fit: fit.all }))
    }

    /// Takes effects away again that beside those found after them are nothing: no name stands
    /// that would not be taken now. Also whether there were any.
    fn without_traces(&mut self, search: &mut Search, mut outcome: Outcome) -> Result<(Outcome, bool)> {
        let mut any = false;
        while let Some((k, limit)) = without_trace(&self.setting, &self.told.state, &outcome) {
            let of_many = if is_of_many(&self.told.state.chosen[k].candidate) { "frequencies" } else { "forms" };
            let why = format!(
                "beside the other effects its strength is within {limit:.1} standard errors of nothing, as the best of so many {of_many} may be by chance"
            );
            // It is not tried again beside whatever takes its place.
            let gone = self.told.result.effects[k - self.told.state.nominal].name();
            search.tried.extend([gone.clone(), gone.clone()]);
            search.traces.push(gone);
            let Some((without, refused)) = self.taken_away(k, why)? else { break };
            search.refused.push(refused);
            (outcome, any) = (without, true);
        }
        Ok((outcome, any))
    }

    /// Takes what was chosen as the `k`-th away and fits the others; none, and everything as it was,
    /// where these cannot be fitted.
    pub(super) fn taken_away(&mut self, k: usize, why: String) -> Result<Option<(Outcome, Refused)>> {
        let kept = self.told.clone();
        let _ = self.told.state.chosen.remove(k);
        let gone = self.told.result.effects.remove(k - self.told.state.nominal).name();
        let refused = Refused::new(&gone, why);
        self.told.result.refuse([refused.clone()]);
        self.told.state.take_off(&self.setting);
        let candidates = offered::candidates(&self.setting, &self.told.state);
        let Ok(without) = refit(&self.setting, &mut self.told.state, candidates) else {
            self.told = kept;
            return Ok(None);
        };
        self.told.result.forget(&gone);
        self.tell_last(&without)?;
        Ok(Some((without, refused)))
    }
}

/// An effect that another takes the place of.
struct Gone {
    /// Its number among the chosen.
    index: usize,
    name: String,
    /// Coefficients with the other in its place, whose strengths stand last.
    fit: DVector<f64>,
}

/// What there was before the last effect was added.
struct Before {
    state: State,
    outcome: Outcome,
    effects: Vec<Found>,
    /// Share of what is left that the effect should take away; with a minus, what it may leave
    /// more.
    promised: f64,
    /// What it takes the place of.
    gone: Option<String>,
}

/// Where the search for effects stands.
#[derive(Default)]
pub(super) struct Search {
    /// Effects that did not keep what they promised.
    refused: Vec<Refused>,
    /// Effects and places that were tried in vain, each as often as it was.
    tried: Vec<String>,
    kept: Option<Before>,
    /// Effects that were no better in the place of another.
    vain: Vec<String>,
    /// Effects that were nothing beside what was found after them: in the place of that they would
    /// come back, and go again.
    traces: Vec<String>,
    /// Exchanges that were tried.
    exchanges: usize,
    /// Whether windows are longer than those of the first search.
    in_longer: bool,
}

impl Search {
    /// A search in longer windows, from the beginning.
    pub(super) fn in_longer() -> Self {
        Self { in_longer: true, ..Self::default() }
    }

    /// Lets effects in again that were refused once.
    fn try_again(&mut self) {
        let times = |name: &str| self.tried.iter().filter(|t| *t == name).count();
        self.refused.retain(|r| times(&r.name()) > 1);
    }

    fn refuse(&mut self, found: Option<&Found>, exchanged: bool, why: &str) {
        if exchanged {
            self.vain.extend(found.map(Found::name));
            return;
        }
        self.refused.extend(found.map(|f| Refused::new(&f.name(), why.to_owned())));
        self.tried.extend(found.map(Found::name));
    }

    /// `ID@PLACE` of what was refused.
    pub(super) fn names(&self) -> Vec<String> {
        self.refused.iter().map(Refused::name).collect()
    }

    /// Whether a candidate is in the model or among some names, or its form was refused.
    pub(super) fn has(&self, setting: &Setting<'_>, state: &State, c: &Candidate, names: &[String]) -> bool {
        let name = c.name(setting);
        let is_chosen = state.chosen.iter().any(|k| k.candidate.name(setting) == name);
        is_chosen || names.contains(&name) || c.is_moved && state.moved_in_vain.contains(&name)
    }

    /// Whether the last effect stays: a wrong model makes many look significant, each must also
    /// bring predictions nearer.
    fn keeps(&self, state: &State, after: Option<&Outcome>, gap: f64, result: &Explanation) -> bool {
        let (Some(before), Some(after)) = (&self.kept, after) else { return false };
        let is_moved = before.gone.is_none() && state.chosen.last().is_some_and(|c| c.candidate.is_moved);
        // What is left over longer windows is more; the model before could not be followed there.
        let length = |s: &State| s.followed.as_ref().map_or(0, Followed::samples);
        if before.promised > 0.0 && length(state) > length(&before.state) {
            return true;
        }
        let previous = result.gap.steps.last().map_or(f64::INFINITY, |s| s.value);
        // What shows over whole stretches alone moves a short prediction neither way.
        let is_off = !self.in_longer && previous > MISSES && gap >= previous;
        if before.promised > 0.0 && (is_off || gap > FARTHER * previous) {
            return false;
        }
        match (before.outcome.left(), after.left()) {
            (Some(b), Some(a)) if before.promised < 0.0 => a <= (1.0 - before.promised) * b,
            // Of the noise's power 1 is left where nothing is missing.
            (Some(b), Some(a)) if is_moved => a - 1.0 < LEFT_BY_MOVED * (b - 1.0).max(0.0),
            (Some(b), Some(a)) => a < (1.0 - LEAST_KEPT * before.promised) * b,
            _ => gap <= (1.0 - LEAST_PROGRESS) * previous || previous <= EXPLAINED_GAP,
        }
    }
}
