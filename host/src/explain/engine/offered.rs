//! What is offered to a model: every candidate of the setting, and finer laws of what was found
//! already, at the shapes that it was found with.

use super::candidates::Candidate;
use super::memory;
use super::residual;
use super::setting::Setting;
use super::state::State;

/// Every candidate beside a state of the model.
pub fn candidates(setting: &Setting<'_>, state: &State) -> Vec<Candidate> {
    let lines = residual::lines(setting, state);
    let mut out = setting.candidates(&state.physical, &lines);
    let finer = finer(setting, state, &out);
    out.extend(finer);
    out
}

/// Laws that refine one with a memory at its place, with the shapes that they share with what was
/// found there (LuGre's friction with Dahl's distance and Stribeck's velocity): at those of a grid
/// they differ from it by more than by what they add.
fn finer(setting: &Setting<'_>, state: &State, all: &[Candidate]) -> Vec<Candidate> {
    let mut out: Vec<Candidate> = Vec::new();
    for found in state.chosen.iter().skip(state.nominal).map(|c| &c.candidate) {
        let refines = |c: &&Candidate| {
            let is_finer = c.entry.refines.as_deref() == Some(&found.entry.id) && c.place == found.place;
            is_finer && !found.entry.states.is_empty()
        };
        for c in all.iter().filter(refines) {
            let here = || state.chosen.iter().map(|c| &c.candidate).filter(|c| c.place == found.place);
            let as_found = |name: &str| here().flat_map(|c| &c.form).find(|s| s.0 == name).map(|s| s.1);
            let form: Vec<_> = c.form.iter().map(|(n, x)| (n.clone(), as_found(n).unwrap_or(*x))).collect();
            let is_new =
                form != c.form && !out.iter().any(|o| o.place == c.place && o.entry.id == c.entry.id && o.form == form);
            out.extend(c.at(setting, form, &state.physical).filter(|c| is_new && memory::is_followed(setting, c)));
        }
    }
    out
}
