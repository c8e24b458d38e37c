//! What is offered to a model: every candidate of the setting, those of lines at the frequencies of
//! what the model leaves.

use super::candidates::Candidate;
use super::residual;
use super::setting::Setting;
use super::state::{Chosen, State};
use crate::model::model_file::expression::{Function, Node, call};

/// Every candidate beside a state of the model.
pub fn candidates(setting: &Setting<'_>, state: &State) -> Vec<Candidate> {
    let all = setting.candidates(&state.physical, &residual::lines(setting, state)).into_iter();
    // What a user wrote down may hold what is taken from as a term.
    let own = || setting.model().equations.iter().flat_map(|e| &e.terms);
    let rubs = setting.is_written() && own().any(|t| holds_a_sign(&t.of));
    let may_take = |c: &Candidate| {
        let Some(id) = &c.entry.takes_from else { return false };
        let stands = |k: &Chosen| k.candidate.entry.id == *id && k.candidate.place == c.place;
        rubs || state.chosen.iter().any(stands)
    };
    all.map(|c| if may_take(&c) { c.of_either_sign() } else { c }).collect()
}

/// Whether the sign of something stands in an expression.
fn holds_a_sign(e: &Node) -> bool {
    let mut found = false;
    let _ = e.with_signs(&mut |a| {
        found = true;
        call(Function::Sign, a.clone())
    });
    found
}
