//! Windows of one length: linearised and solved until their paths stand still.

use nalgebra::{DMatrix, DVector};

use super::super::state::State;
use super::course::{Course, List};
use super::path::windows;
use super::{Followed, MOST_LOST, MOST_SAMPLES};

/// Movement of the path, in the sensors' noise or as a share of what is left, below which it stands
/// still (by hand).
const STILL: f64 = 0.15;
/// Share of the windows under a drive that must have settled (by hand).
const SETTLED: f64 = 0.9;

/// Linearises and solves until paths stand still; the covariance, which windows were followed, and
/// what is left of each.
pub fn stage(
    course: &Course<'_>,
    followed: &mut Followed,
    x: &mut Vec<f64>,
    length: usize,
    passes: usize,
    own: &[usize],
    signs: &[f64],
) -> Option<(DMatrix<f64>, Vec<bool>, Vec<f64>)> {
    let n = course.setting.circle.len();
    let lengths: Vec<usize> = followed.paths.iter().map(|p| p.len(n)).collect();
    let all = windows(&lengths, length, MOST_SAMPLES);
    let applied: Vec<bool> = is_applied(course.state, own.len());
    let chaotic = course.setting.rig.drive.is_some();
    let mut out = None;
    for _ in 0..passes {
        // What is found as an increment was taken off the record after the last linearisation, not
        // here.
        let list = List { x: x.clone(), further: &[], behind: &[], together: false };
        let solved = course.solved(&followed.paths, &all, &list)?;
        let (mut blocks, window_of) = course.blocks(&solved, signs.to_vec(), x);
        let kept: Vec<usize> = (0..solved.len()).filter(|&k| solved[k].is_some()).collect();
        // An increment of nothing shows in no window: its error is not what it is.
        blocks.still.clone_from(&applied);
        if (kept.len() as f64) < (1.0 - MOST_LOST) * all.len() as f64 {
            return None;
        }
        let fit = blocks.fit(own)?;
        blocks.weigh(&blocks.misfits(&fit.all));
        let fit = blocks.fit(own)?;
        let misfits = blocks.misfits(&fit.all);
        let step = DVector::from_iterator(own.len(), own.iter().map(|&c| fit.all[c] - x[c]));
        let (mut greatest, mut near) = (0.0_f64, 0);
        let mut movement = vec![f64::INFINITY; all.len()];
        for &k in &kept {
            let (w, Some(s)) = (&all[k], &solved[k]) else { continue };
            let path = &mut followed.paths[w.stretch];
            let range = 2 * n * w.first..2 * n * (w.first + w.count);
            let states = path.states[range.clone()].to_vec();
            let measured = course.measured(path, w, &states, &list);
            let Some(start) = s.columns.normal.start(&step) else { continue };
            let (after, moved) = s.linear.moved(&states, &s.columns.alpha, &start, &step, &measured);
            if course.is_near(&states, &after) {
                path.states[range].copy_from_slice(&after);
                greatest = greatest.max(moved);
                movement[k] = moved;
                near += 1;
            }
        }
        if (f64::from(near)) < (1.0 - MOST_LOST) * all.len() as f64 {
            return None;
        }
        let left = (misfits.iter().map(|w| w[0]).sum::<f64>() / misfits.len() as f64).sqrt();
        for (c, (to, from)) in x.iter_mut().zip(fit.all.iter()).enumerate() {
            *to = if applied[c] { *to } else { *from };
        }
        let limit = STILL * left.max(1.0);
        // By convergence, never by misfit.
        let of = |(m, s): (&f64, &Option<_>)| if chaotic { *m < limit } else { s.is_some() };
        let still: Vec<bool> = movement.iter().zip(&solved).map(of).collect();
        let of_window = |k: usize| {
            let own = || window_of.iter().zip(&misfits).filter(move |b| *b.0 == k).map(|b| b.1[0]);
            own().sum::<f64>() / own().count() as f64
        };
        let of_window = (0..all.len()).map(of_window).collect();
        out = Some((fit, still, of_window));
        // In chaos some windows never stand still.
        let slowest = if chaotic { nearly_all(&mut movement) } else { greatest };
        if slowest < limit {
            break;
        }
    }
    let (fit, still, of_window) = out?;
    if (still.iter().filter(|s| **s).count() as f64) < (1.0 - MOST_LOST) * all.len() as f64 {
        return None;
    }
    *x = fit.all.iter().copied().collect();
    Some((fit.covariance, still, of_window))
}

/// What nine tenths of some numbers are below.
fn nearly_all(of: &mut [f64]) -> f64 {
    of.sort_by(f64::total_cmp);
    of.get((SETTLED * of.len() as f64) as usize).copied().unwrap_or(f64::INFINITY)
}

/// Which of the own columns are found as increments.
pub fn is_applied(state: &State, count: usize) -> Vec<bool> {
    let mut out = vec![false; state.values.len()];
    for k in &state.chosen {
        out.extend(std::iter::repeat_n(k.candidate.is_applied(), k.strengths.len()));
    }
    out.resize(count, false);
    out
}
