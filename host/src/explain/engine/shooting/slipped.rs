//! Whether slips of single counts show in what windows leave
//! ([`crate::identify::slips`](mod@crate::identify::slips)).

use rayon::prelude::*;

use super::super::setting::Setting;
use super::super::state::State;
use super::course::List;
use super::linear::Linear;
use super::path::Window;
use super::strips::{Along, Strip};
use super::{Ground, present};
use crate::identify::slips::{Seen, Step, believed, greatest_step};

/// Whether slips of counts show in what a model leaves; none where it follows no windows.
pub fn shows_slips(setting: &Setting<'_>, state: &State) -> Option<bool> {
    Ground::new(setting, state)?.shows_slips(&state.sensors(setting).count)
}

impl Ground<'_> {
    /// In windows, and in those half of which are of one and half of the next: a step at the end of
    /// a window is taken for its state. None where the latter have no solution.
    fn shows_slips(&self, count: &[Option<f64>]) -> Option<bool> {
        if count.iter().all(Option::is_none) {
            return Some(false);
        }
        let Self { course, paths, windows, linear } = self;
        let follows = |(a, b): &(&Window, &Window)| a.stretch == b.stretch && a.first + a.count == b.first;
        let between = windows.iter().zip(windows.iter().skip(1)).filter(follows);
        let between: Vec<Window> = between.map(|(a, _)| Window { first: a.first + a.count / 2, ..*a }).collect();
        let joined = course.linear(paths, &between, &present(course.state))?;
        let all: Vec<(&Window, &Option<Linear>)> =
            windows.iter().zip(linear).chain(between.iter().zip(&joined)).collect();
        let steps: Vec<Step> =
            all.into_par_iter().filter_map(|(w, linear)| self.step(w, linear.as_ref()?, count)).collect();
        Some(!believed(&steps).is_empty())
    }

    fn step(&self, w: &Window, linear: &Linear, count: &[Option<f64>]) -> Option<Step> {
        let Self { course, paths, .. } = self;
        let path = &paths[w.stretch];
        let m = 2 * course.setting.circle.len();
        let states = path.of(w, m / 2);
        let list = List { x: present(course.state), further: &[], behind: &[], together: false };
        let measured = course.measured(path, w, states, &list);
        let own = Strip { lead: linear.size, columns: 0..0, trail: 1 };
        let along =
            Along { alpha: &[], columns: 0, measured: &measured, samples: 0..w.count, last: w.count.checked_sub(1)? };
        let rows = linear.head(states, &own, &along).0.transpose();
        // States of effects begin as they are.
        let (by_state, target) = (rows.columns(0, m).into_owned(), -rows.column(rows.ncols() - 1));
        let seen = Seen { readings: &measured.values, sigma: measured.sigma, count };
        greatest_step(&target, &by_state, &seen, w.stretch, path.first + w.first)
    }
}
