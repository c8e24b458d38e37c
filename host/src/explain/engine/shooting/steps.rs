//! Steps of integration so fine that none of them shows in what is left of the windows.
//!
//! What a step leaves of a solution is alike all along a record: it takes a little off an
//! oscillation as a damping would, and shifts it as a stiffness would. A share of the noise in every
//! sample, it adds up to what another law leaves, and that law would be named for it. What half the
//! steps change of a block's sum of squares, δ_b, is 2 r·e + e·e with the residuals r, noise of unit
//! variance, and what steps leave of them, e, coefficients and initial states fitted: Σ δ_b²/4 is
//! nearly Σ e·e, the most by which any law can gain.

use super::super::setting::{MOST_POINTS, Setting};
use super::super::state::State;
use super::course::{Course, List};
use super::{present, signs_of};

/// Squares of the noise that steps may leave in a record: a law must gain many times that to be
/// named, and no coefficient is off by more than a standard error (what is told last is fitted with
/// finer ones where these show).
const MOST_LEFT: f64 = 1.0;
/// Share of them that half the steps leave at most (a method of fifth order: a thousandth): what is
/// made by corners of a law, by rounding or by chaos stays.
const LESS: f64 = 0.25;

/// The search for steps that do not show.
#[derive(Default)]
pub struct Steps {
    /// What was left with half as many points to a sample, and with how many.
    before: Option<(f64, usize)>,
    /// Whether finer ones were in vain.
    over: bool,
}

impl Steps {
    /// Points to a sample by which windows are to be settled again: twice as many where steps show
    /// more than they may, as before where twice as many were in vain; none where steps are well. A
    /// drive's windows are a few of its periods, over which steps do not add up.
    pub fn next(&mut self, setting: &Setting<'_>, state: &State) -> Option<usize> {
        let points = 2 * setting.points;
        if self.over || setting.rig.drive.is_some() || points as f64 > MOST_POINTS {
            return None;
        }
        let left = left(setting, state, points)?;
        match self.before.replace((left, setting.points)) {
            Some((more, coarser)) if left >= LESS * more => {
                self.over = true;
                Some(coarser)
            }
            _ => (left > MOST_LEFT).then_some(points),
        }
    }
}

/// What the setting's steps leave beside those of so many points to a sample, in squares of the
/// noise; where a model leaves more than noise, of what it leaves.
fn left(setting: &Setting<'_>, state: &State, points: usize) -> Option<f64> {
    let followed = state.followed.as_ref()?;
    let (windows, x) = (followed.kept(setting)?, present(state));
    let own: Vec<usize> = (0..x.len()).collect();
    let list = List { x: x.clone(), further: &[], behind: &[], together: false };
    let squares = |points: usize| {
        let course = Course::new(setting, state).with_points(points);
        let linear = course.linear(&followed.paths, &windows, &x)?;
        let signs = signs_of(setting, state, &[], 0);
        let blocks = course.reduced(&followed.paths, &windows, &linear, &list, signs)?;
        Some(blocks.squares_left(&blocks.fit(&own)?.all))
    };
    let (coarse, fine) = (squares(setting.points)?, squares(points)?);
    let of = |(a, b): (&(f64, f64), &(f64, f64))| 0.25 * (a.0 - b.0).powi(2) / (b.0 / b.1.max(1.0)).max(1.0);
    (coarse.len() == fine.len()).then(|| coarse.iter().zip(&fine).map(of).sum())
}
