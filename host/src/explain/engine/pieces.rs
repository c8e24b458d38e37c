//! Whether effects that were found one after the other are one shape without a name, in pieces.
//!
//! A force of one coordinate that no law of the list has can be put together from several that it
//! has, and each of them then is significant. Where a shape of a coordinate at a place is still
//! clear beside several effects at that place, the shape is looked for in the model before anything
//! was added: where it is the same one, and leaves little more than all effects together, they are
//! its pieces, and none of them has a name there.

use super::evidence::{Outcome, refit};
use super::run::Run;
use super::unknown::{self, Shape};
use crate::explain::explanation::Refused;

/// Fewest effects at one place that may be pieces: one beside a shape may be right.
const PIECES: usize = 2;
/// Power, over that which the pieces leave, that the one shape may leave: its grid has 17 points,
/// and corners between them (by hand: 1.1, 2.7 and 3.7 in three records of other simulators).
const AS_GOOD: f64 = 4.0;

impl Run<'_> {
    /// The outcome as it is, or that of the model before anything was added where what was added is
    /// a shape in pieces.
    pub fn without_pieces(&mut self, outcome: Outcome) -> Outcome {
        let pieces = |shape: &Shape| self.told.result.effects.iter().filter(|f| f.at == shape.unknown.at).count();
        // Of a given model the first step is the one before it was fitted again.
        let is_given = self.told.result.gap.steps.iter().any(|s| s.added.as_deref() == Some("refit"));
        let left = (outcome.evidence.is_shooting() && !is_given && self.told.result.effects.len() >= PIECES)
            .then(|| unknown::shape(&self.setting, &self.told.state, &outcome))
            .flatten();
        let Some(left) = left.filter(|s| s.is_clear && pieces(s) >= PIECES) else { return outcome };
        let power = self.told.result.residual_power;
        let told = self.told.clone();
        let (effects, ranking) = (self.told.result.effects.clone(), self.told.result.ranking.clone());
        if !self.begin_again() {
            return outcome;
        }
        let first = refit(&self.setting, &mut self.told.state, Vec::new()).ok();
        let whole =
            first.as_ref().and_then(|first| unknown::shape(&self.setting, &self.told.state, first)).filter(|s| {
                let of = |s: &Shape| (s.unknown.at.clone(), s.unknown.against.clone());
                let leaves = power[0] * (1.0 - s.unknown.held_out_gain);
                s.is_clear && of(s) == of(&left) && leaves <= AS_GOOD * power[1]
            });
        let (Some(whole), Some(first)) = (whole, first) else {
            self.told = told;
            return outcome;
        };
        let why = format!(
            "with others it stands for one {} at {} that depends on the {} and has no name in the list",
            whole.unknown.kind(),
            whole.unknown.at,
            whole.unknown.against
        );
        self.told.result.refused = effects.iter().map(|f| Refused::new(&f.name(), why.clone())).collect();
        self.told.result.ranking = ranking.into_iter().filter(|r| r.step == 0).collect();
        self.told.result.gap.attractor.truncate(1);
        self.told.result.residual_power = [power[0]; 2];
        first
    }
}
