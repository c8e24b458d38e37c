//! What is offered to a model: every candidate of the setting, those of lines at the frequencies of
//! what the model leaves.

use super::candidates::Candidate;
use super::residual;
use super::setting::Setting;
use super::state::{Chosen, State};

/// Every candidate beside a state of the model.
pub fn candidates(setting: &Setting<'_>, state: &State) -> Vec<Candidate> {
    let all = setting.candidates(&state.physical, &residual::lines(setting, state)).into_iter();
    let may_take = |c: &Candidate| {
        let Some(id) = &c.entry.takes_from else { return false };
        // What a user wrote down may hold it as a term.
        let stands = |k: &Chosen| k.candidate.entry.id == *id && k.candidate.place == c.place;
        setting.is_written() || state.chosen.iter().any(stands)
    };
    all.map(|c| if may_take(&c) { c.of_either_sign() } else { c }).collect()
}
