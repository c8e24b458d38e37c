//! A motion that nothing drives, followed on in longer windows once everything was found in shorter
//! ones.

use super::evidence::{Evidence, Outcome, refit};
use super::run::Run;
use super::search::Search;
use super::shooting::Followed;
use super::state::State;
use super::{exchange, offered, shooting};
use crate::error::Result;
use crate::explain::decidability::{EXCUSED, FEWEST_BLOCKS};

/// What is left, in units of the noise's power, from which no search in longer windows is begun (by
/// hand: a swing whose two frictions were named there had left 10 before).
const HOPELESS: f64 = 100.0;

impl Run<'_> {
    /// The model found in windows as long as the fewest that decide leave room for, where nothing
    /// drives the motion and it can be followed for so long. How fast a swing dies is known from a
    /// window to the power -3/2 of its length, and laws of damping differ in nothing else; about a
    /// model that lacks them longer windows lead astray.
    ///
    /// # Errors
    /// As [`Run::push`].
    pub(super) fn followed_on(&mut self) -> Result<Option<Outcome>> {
        let goes_on = self.setting.shooting && self.setting.rig.drive.is_none();
        if !goes_on || !self.setting.bound.inputs.is_empty() {
            return Ok(None);
        }
        let samples = |state: &State| state.followed.as_ref().map_or(0, Followed::samples);
        let before = self.told.state.clone();
        self.setting.blocks = (FEWEST_BLOCKS + 1) as f64;
        let candidates = offered::candidates(&self.setting, &self.told.state);
        let longer = refit(&self.setting, &mut self.told.state, candidates);
        let windows = self.told.state.followed.as_ref().map_or(0, |f| f.windows(&self.setting).0);
        if let Ok(longer) = longer
            && windows >= FEWEST_BLOCKS
            && samples(&self.told.state) > samples(&before)
            && longer.power(&self.setting, &self.told.state)? < HOPELESS
        {
            self.tell_again(&longer)?;
            return Ok(Some(longer));
        }
        self.told.state = before;
        self.setting.blocks = shooting::BLOCKS;
        Ok(None)
    }

    /// Whether what was found in longer windows leaves nearly noise alone: where it does not, what
    /// is missing adds up over them, and shorter ones show more of it.
    ///
    /// # Errors
    /// As [`Run::push`].
    pub(super) fn is_followed(&self, outcome: &Outcome) -> Result<bool> {
        Ok(outcome.power(&self.setting, &self.told.state)? <= EXCUSED * EXCUSED)
    }

    /// Where more than noise is left of a motion that is followed on, the search once more from the
    /// model before anything was added, in the same windows: what was named first, in shorter ones,
    /// may have stood in for several. Kept where less is left.
    pub(super) fn searched_again(&mut self, most: usize, outcome: Outcome) -> Result<Outcome> {
        let Evidence::Shooting(blocks) = &outcome.evidence else { return Ok(outcome) };
        let misses = exchange::sum(&outcome.fit) > exchange::MISSES * blocks.noise();
        let kept = self.told.clone();
        if !misses || self.told.result.effects.is_empty() || !self.begin_again() {
            return Ok(outcome);
        }
        let candidates = offered::candidates(&self.setting, &self.told.state);
        let mut search = Search::default();
        let again = refit(&self.setting, &mut self.told.state, candidates).and_then(|again| {
            self.tell_again(&again)?;
            let again = self.added(&mut search, most, None, Some(again))?;
            self.cleared(&mut search, most, again)
        });
        match again {
            Ok(again) if again.left().zip(outcome.left()).is_some_and(|(a, b)| a < b) => Ok(again),
            _ => {
                self.told = kept;
                Ok(outcome)
            }
        }
    }
}
