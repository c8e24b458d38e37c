//! What is offered to a model: every candidate of the setting, those of lines at the frequencies of
//! what the model leaves.

use super::candidates::Candidate;
use super::residual;
use super::setting::Setting;
use super::state::State;

/// Every candidate beside a state of the model.
pub fn candidates(setting: &Setting<'_>, state: &State) -> Vec<Candidate> {
    setting.candidates(&state.physical, &residual::lines(setting, state))
}
