//! What trajectories leave of every sample, and how far forces move what the sensors show at once:
//! for forces that are faster than any window's columns can be looked through.

use rayon::prelude::*;

use super::super::candidates::Candidate;
use super::Ground;
use super::course::List;
use super::present;

/// A window's samples.
pub struct LeftOver {
    /// The stretch, and its sample at which the window begins.
    pub stretch: usize,
    pub first: usize,
    /// What is left of each sensor's readings, in units of its noise.
    pub left: Vec<Vec<f64>>,
    /// By column of the candidates and by sensor: acceleration of what it shows, in units of its
    /// noise a second squared.
    pub pushed: Vec<Vec<Vec<f64>>>,
}

impl Ground<'_> {
    /// Of candidates, about the settled paths; none where their columns have no value.
    pub fn left_over(&self, further: &[&Candidate]) -> Option<Vec<LeftOver>> {
        let Self { course, paths, windows, linear } = self;
        let list = List { x: present(course.state), further, behind: &[], together: false };
        let (own, columns) = (list.x.len(), further.iter().map(|c| c.strengths()).sum::<usize>());
        let forced = course.forced(paths, windows, linear, &list)?;
        let points = course.setting.points;
        let of = |(w, alpha): (&super::Window, Option<Vec<f64>>)| {
            let alpha = alpha?;
            let path = &paths[w.stretch];
            let n = course.setting.circle.len();
            let states = path.of(w, n);
            let shown = course.measured(path, w, states, &list);
            let sensors = shown.shown.len();
            let form = |weights: &[f64], of: &dyn Fn(usize) -> f64| -> f64 {
                weights.iter().enumerate().filter(|w| *w.1 != 0.0).map(|(i, w)| w * of(i)).sum()
            };
            let left = |s: usize| -> Vec<f64> {
                let predicted = |k: usize| form(&shown.shown[s], &|i| states[2 * n * k + i]);
                (0..w.count).map(|k| (shown.values[k * sensors + s] - predicted(k)) / shown.sigma[s]).collect()
            };
            let pushed = |c: usize, s: usize| -> Vec<f64> {
                let size = own + columns;
                let at = |k: usize| form(&shown.shown[s], &|i| alpha[(k * points * n + i) * size + own + c]);
                (0..w.count).map(|k| at(k) / shown.sigma[s]).collect()
            };
            Some(LeftOver {
                stretch: w.stretch,
                first: path.first + w.first,
                left: (0..sensors).map(left).collect(),
                pushed: (0..columns).map(|c| (0..sensors).map(|s| pushed(c, s)).collect()).collect(),
            })
        };
        Some(windows.par_iter().zip(forced).filter_map(of).collect())
    }
}
