//! Effects with states: each state has a number in the setting and is followed once along every
//! stretch ([`crate::identify::history`]).

use std::collections::BTreeSet;

use super::candidates::{Candidate, Column};
use super::setting::Setting;
use super::state::State;
use crate::effects::columns::Action;
use crate::model::model_file::expression::{Expression, Symbol, symbol};

/// Shortest time in which a state may settle, periods of the motion and samples: one that settles
/// faster is its own rate, and the rate of a force acts like an inertia.
const SETTLING_PERIODS: f64 = 0.02;
const SETTLING_SAMPLES: f64 = 5.0;

/// Shortest time in which a state may settle, s.
pub fn settles_in(setting: &Setting<'_>) -> f64 {
    (SETTLING_PERIODS * setting.geometry.period_s).max(SETTLING_SAMPLES / setting.rig.sample_rate_hz)
}

/// An action whose states are those that are followed along the record; none where one settles too
/// fast.
pub fn numbered(setting: &Setting<'_>, action: Action) -> Option<Action> {
    // Refined down to the shortest it stays.
    let least_s = (1.0 - 1e-9) * settles_in(setting);
    let settles = action.states().all(|s| !matches!(&**s, Expression::Memory(m, _) if m.settles_s() < least_s));
    settles.then(|| action.with_memories(&|memory, k| symbol(Symbol::Memory(setting.laws.number(memory, k)))))
}

/// Laws of the states of a candidate, as columns.
pub fn laws(setting: &Setting<'_>, candidate: &Candidate) -> Vec<Column> {
    let laws = candidate.remembered().filter_map(|k| setting.laws.law(k));
    laws.map(|(memory, _)| memory.rates().iter().map(|r| (0, r.clone())).collect()).collect()
}

/// Whether its states, if it has any, stay within the finite numbers along the whole record.
pub fn is_followed(setting: &Setting<'_>, candidate: &Candidate) -> bool {
    let finite = |k: usize| setting.raw.iter().all(|s| s.history.as_ref().is_some_and(|h| h.is_finite(k)));
    candidate.remembered().all(finite)
}

/// Lets go of the states of all but a state's effects and some candidates.
pub fn keep<'a>(setting: &Setting<'_>, state: &State, candidates: impl IntoIterator<Item = &'a Candidate>) {
    let tried = candidates.into_iter().flat_map(Candidate::remembered);
    let used: BTreeSet<usize> = state.remembered().into_iter().chain(tried).collect();
    let histories = setting.raw.iter().chain(&state.stretches).filter_map(|s| s.history.as_ref());
    histories.for_each(|h| h.keep(&used));
}
