//! Windows of another length: a motion that nothing drives, followed on in longer ones once
//! everything was found in shorter ones; shorter ones where nothing is found at all. Neither where a
//! length was asked for.

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

/// Windows that a motion that is followed on should give: the fewest that decide, then whole
/// stretches, parts of which are held out.
pub(super) const LONGER: [f64; 2] = [(FEWEST_BLOCKS + 1) as f64, shooting::WHOLE];

/// Length of shorter windows beside those in which nothing was found, how many effects are sought
/// there, and the share of what was left above the noise that may be left with them (by hand: a
/// clearance of 0.02 rad in a shaft, which is not found, leaves 0.16 with a ripple in its place).
const SHORTER: f64 = 0.125;
const MOST_IN_SHORTER: usize = 2;
const SETTLED: f64 = 0.05;

impl Run<'_> {
    /// Where nothing is supported although more than noise is left, the search once more in windows
    /// of [`SHORTER`] the length: the linear problem holds about a path that the model follows, and
    /// what it lacks may have led it so far from the record that no column has its place there (a
    /// ripple, by one of its periods). What is found is then fitted, and the search goes on, in the
    /// windows that there were. Kept where hardly more than noise is left there: of a model that still
    /// misses something no name stands that the full windows do not support.
    ///
    /// # Errors
    /// As [`Run::push`].
    pub(super) fn in_shorter_windows(&mut self, most: usize, outcome: Outcome) -> Result<Outcome> {
        let Evidence::Shooting(blocks) = &outcome.evidence else { return Ok(outcome) };
        let misses = exchange::sum(&outcome.fit) > exchange::MISSES * blocks.noise();
        let kept = self.told.clone();
        let samples = self.told.state.followed.as_ref().map_or(0, Followed::samples);
        let nothing = self.told.result.effects.is_empty() && most > 0 && samples > 0;
        // A short record has no room for any.
        let nothing = nothing && self.setting.window_s.is_none() && self.setting.blocks >= shooting::BLOCKS;
        if !misses || !nothing || !self.begin_again() {
            return Ok(outcome);
        }
        let whole: usize = self.told.state.stretches.iter().map(|s| s.len()).sum();
        self.setting.blocks = whole as f64 / (SHORTER * samples as f64);
        let found = self.found_in_windows(most.min(MOST_IN_SHORTER));
        self.setting.blocks = shooting::BLOCKS;
        let again = match found {
            Ok(Some(mut search)) => self.in_windows_again(&mut search, most),
            _ => Ok(None),
        };
        match again {
            Ok(Some(again)) if again.left().zip(outcome.left()).is_some_and(|(a, b)| a - 1.0 < SETTLED * (b - 1.0)) => {
                Ok(again)
            }
            _ => {
                self.told = kept;
                Ok(outcome)
            }
        }
    }

    /// The search in windows of the setting's length, from the model before anything was added; none
    /// where nothing is found.
    fn found_in_windows(&mut self, most: usize) -> Result<Option<Search>> {
        self.told.state.followed = None;
        let candidates = offered::candidates(&self.setting, &self.told.state);
        let first = refit(&self.setting, &mut self.told.state, candidates)?;
        let mut search = Search::default();
        let found = self.added(&mut search, most, None, Some(first))?;
        self.cleared(&mut search, most, found)?;
        Ok((!self.told.result.effects.is_empty()).then_some(search))
    }

    /// What was found in other windows, fitted in the setting's, and what is found beside it.
    fn in_windows_again(&mut self, search: &mut Search, most: usize) -> Result<Option<Outcome>> {
        let candidates = offered::candidates(&self.setting, &self.told.state);
        let again = refit(&self.setting, &mut self.told.state, candidates)?;
        self.tell_last(&again)?;
        let again = self.added(search, most, None, Some(again))?;
        let again = self.cleared(search, most, again)?;
        Ok((!self.told.result.effects.is_empty()).then_some(again))
    }

    /// The model found in windows so long that there are `blocks` of them, where nothing drives the
    /// motion and it can be followed for so long. How fast a swing dies is known from a window to the
    /// power -3/2 of its length, and laws of damping differ in nothing else; about a model that lacks
    /// them longer windows lead astray.
    ///
    /// # Errors
    /// As [`Run::push`].
    pub(super) fn followed_on(&mut self, blocks: f64) -> Result<Option<Outcome>> {
        let is_asked = self.setting.window_s.is_some();
        let goes_on = self.setting.shooting && self.setting.rig.drive.is_none() && !is_asked;
        if !goes_on || !self.setting.bound.inputs.is_empty() {
            return Ok(None);
        }
        let samples = |state: &State| state.followed.as_ref().map_or(0, Followed::samples);
        let (before, windows) = (self.told.state.clone(), (self.setting.blocks, self.setting.points));
        self.setting.blocks = blocks;
        let candidates = offered::candidates(&self.setting, &self.told.state);
        let mut longer = refit(&self.setting, &mut self.told.state, candidates);
        // What steps of integration leave adds up over longer windows.
        let mut steps = shooting::Steps::default();
        while let (Ok(_), Some(points)) = (&longer, steps.next(&self.setting, &self.told.state)) {
            self.setting.points = points;
            let candidates = offered::candidates(&self.setting, &self.told.state);
            longer = refit(&self.setting, &mut self.told.state, candidates);
        }
        if let Ok(longer) = longer
            && samples(&self.told.state) > samples(&before)
            && longer.power(&self.setting, &self.told.state)? < HOPELESS
        {
            self.tell_again(&longer)?;
            return Ok(Some(longer));
        }
        (self.told.state, (self.setting.blocks, self.setting.points)) = (before, windows);
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
        let mut search = Search::in_longer();
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
