//! What is left of an effect in finer steps of integration.
//!
//! Columns are integrated with as many points to a sample as the motion asks for. A law may turn
//! much faster than the motion: a torque A sin(n q + ψ) turns by n q' h from one point to the next, and
//! from about π on its points show a slow force that is none. With several times as many points it is
//! what it is, whatever n, q' and h are; an effect whose gain does not outlast that was made by the
//! steps.

use super::super::setting::Setting;
use super::super::state::State;
use super::course::{Course, List};
use super::{present, signs_of};

/// Times as many points: a turn of up to three whole ones from point to point shows.
const FINER: usize = 4;
/// Share of its gain that an effect must keep (by hand).
const LEAST_KEPT: f64 = 0.5;

/// Whether the effect that was put into the model last takes off with finer steps what it does with
/// the setting's; so too where either cannot be integrated, where it takes off nothing in these
/// windows, and where it is found as an increment of what sensors or inputs show.
pub fn outlasts_finer_steps(setting: &Setting<'_>, state: &State) -> bool {
    if state.chosen.last().is_none_or(|k| k.candidate.is_applied()) {
        return true;
    }
    let gains = gain(setting, state, setting.points).zip(gain(setting, state, FINER * setting.points));
    gains.is_none_or(|(coarse, fine)| coarse <= 0.0 || fine >= LEAST_KEPT * coarse)
}

/// The logarithm of what is left of windows that were not fitted without the last effect over what is
/// left with it; the other columns are fitted both times.
fn gain(setting: &Setting<'_>, state: &State, points: usize) -> Option<f64> {
    let (followed, x) = (state.followed.as_ref()?, present(state));
    let windows = followed.kept(setting)?;
    let all: Vec<usize> = (0..x.len()).collect();
    let others = x.len().checked_sub(state.chosen.last()?.strengths.len())?;
    let course = Course::new(setting, state).with_points(points);
    let linear = course.linear(&followed.paths, &windows, &x)?;
    let list = List { x, further: &[], behind: &[], together: false };
    let mut blocks = course.reduced(&followed.paths, &windows, &linear, &list, signs_of(setting, state, &[], 0))?;
    blocks.weigh(&blocks.misfits(&blocks.fit(&all)?.all));
    let without = blocks.without(others..all.len()).held_out(&all[..others])?;
    Some((without / blocks.held_out(&all)?).ln())
}
