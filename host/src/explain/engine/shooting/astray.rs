//! Windows whose paths were led to another solution of the model than the record's: a path that was
//! settled with another model, or a velocity that only just reaches zero, which a linearisation
//! leaves on the side where it is, and a step of integration passes over where it turns back at
//! once.
//!
//! Where a few windows are left worse than the others, each is followed by a simulation whose
//! initial state is fitted over longer and longer beginnings, with finer steps; what comes nearer to
//! the record is linearised about instead, with these. Far worse ones that no simulation follows
//! begin at the smoothed record again.

use nalgebra::DVector;
use rayon::prelude::*;

use super::super::setting::Setting;
use super::super::state::{Moving, State};
use super::path::{FEWEST_SAMPLES, FINER, Path, Window, windows};
use super::{Fitted, Followed, MOST_SAMPLES, PASSES, grown, remember};
use crate::identify::track::Track;

/// What is left of a window, beside the median of all, from which its path is taken to have been
/// led astray (by hand).
const ASTRAY: f64 = 10.0;
/// The same from which a simulation is tried, and the share of the windows that may be left so: the
/// mean square of a window's noise is known to some hundredths, and what a model lacks shows in
/// many (by hand).
const APART: f64 = 2.0;
const FEW: f64 = 0.1;
/// Share of what is left of a window that a simulation may leave to take its place (by hand).
const NEARER: f64 = 0.7;

/// A fit once more with windows that were led astray about other paths, and with what effects
/// remember of these; as it is where that leaves no less.
pub fn back(setting: &Setting<'_>, state: &State, found: Fitted) -> Fitted {
    let (followed, x, _) = &found;
    let mut sorted: Vec<f64> = followed.left.iter().copied().filter(|l| l.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let (Some(&middle), Some(length)) = (sorted.get(sorted.len() / 2), followed.length) else { return found };
    let worse = |by: f64| -> Vec<bool> { followed.left.iter().map(|l| *l > by * middle.max(1.0)).collect() };
    let (far, apart) = (worse(ASTRAY), worse(APART));
    let n = setting.circle.len();
    let lengths: Vec<usize> = followed.paths.iter().map(|p| p.len(n)).collect();
    let windows = windows(&lengths, length, MOST_SAMPLES);
    let count = apart.iter().filter(|a| **a).count();
    let simulated = if count > 0 && count as f64 <= (FEW * windows.len() as f64).max(1.0) {
        simulated(setting, state, followed, x, &windows, &apart)
    } else {
        vec![None; windows.len()]
    };
    if !far.contains(&true) && simulated.iter().all(Option::is_none) {
        return found;
    }
    let smoothed: Vec<Path> = state.stretches.iter().map(|s| Path::smoothed(s, &setting.geometry.kernels)).collect();
    let mut again = followed.clone();
    for ((w, states), far) in windows.iter().zip(&simulated).zip(&far) {
        let range = 2 * n * w.first..2 * n * (w.first + w.count);
        let to = &mut again.paths[w.stretch].states[range.clone()];
        match states {
            Some(states) => {
                to.copy_from_slice(states);
                again.paths[w.stretch].finer.push(w.first..w.first + w.count);
            }
            None if *far => to.copy_from_slice(&smoothed[w.stretch].states[range]),
            None => {}
        }
    }
    let mut remembering = state.clone();
    remember(setting, &mut remembering, &again);
    match grown(setting, &remembering, again, &[(length, PASSES[2])]) {
        Some(back) if back.0.left() < followed.left() => back,
        _ => found,
    }
}

/// Of windows that stand `apart` what a simulation shows that comes nearer to the record:
/// coordinates and rates at every sample.
fn simulated(
    setting: &Setting<'_>,
    state: &State,
    followed: &Followed,
    x: &[f64],
    windows: &[Window],
    apart: &[bool],
) -> Vec<Option<Vec<f64>>> {
    let x = DVector::from_column_slice(x);
    let of = |track: &Track<'_>, k: usize| {
        let w = windows.get(k).filter(|_| apart[k])?;
        let record = setting.record_of.get(w.stretch).copied().unwrap_or(0);
        let Moving { equations, parameters, .. } = state.motion_of(setting, &x, record)?;
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let problem = track.problem(&equations, track.spacing_s / (FINER * setting.points) as f64, &at);
        let path = &followed.paths[w.stretch];
        let (piece, guess) = track.piece(w.stretch, path.first + w.first, w.count)?;
        let doubled = (0..usize::BITS).map(|k| FEWEST_SAMPLES << k).take_while(|l| *l < w.count);
        let lengths: Vec<usize> = doubled.chain([w.count]).collect();
        let (begin, left) = problem.fit_state(&piece, &guess, &parameters, &lengths, &mut problem.room(false))?;
        // What is no number is no nearer.
        let is_nearer = left < NEARER * followed.left[k];
        if !is_nearer {
            return None;
        }
        let states = problem.course(&piece, &begin, &parameters)?;
        Some(in_turns_of(states, path.of(w, setting.circle.len()), &setting.circle))
    };
    state.on_track(setting, |track| (0..windows.len()).into_par_iter().map(|k| of(track, k)).collect())
}

/// States whose angles begin in the turn in which a path's do.
fn in_turns_of(mut states: Vec<f64>, path: &[f64], circle: &[bool]) -> Vec<f64> {
    let turn = core::f64::consts::TAU;
    let off = |k: usize| if circle[k] { turn * ((path[k] - states[k]) / turn).round() } else { 0.0 };
    let off: Vec<f64> = (0..circle.len()).map(off).collect();
    for state in states.chunks_exact_mut(2 * circle.len()) {
        state.iter_mut().zip(&off).for_each(|(x, by)| *x += by);
    }
    states
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_are_told_in_the_turns_of_a_path() {
        let turn = core::f64::consts::TAU;
        let path = [3.0 * turn + 0.1, 20.0, 1.0, 2.0];
        let states = vec![0.1, 20.5, 1.0, 2.0, 0.3, 21.0, 1.5, 2.5];
        let told = in_turns_of(states, &path, &[true, false]);
        assert_eq!(told[1..4], [20.5, 1.0, 2.0]);
        assert!((told[0] - path[0]).abs() < 1e-12 && (told[4] - path[0] - 0.2).abs() < 1e-12);
    }
}
