//! Windows that were left out beside those that count.

use super::super::setting::Setting;
use super::super::state::State;
use super::path::{Window, windows};
use super::{Followed, MOST_SAMPLES};

impl Followed {
    /// When each window begins, s, and whether it counts; empty where all do.
    pub fn counted(&self, setting: &Setting<'_>, state: &State) -> Vec<(f64, bool)> {
        let n = setting.circle.len();
        let lengths: Vec<usize> = self.paths.iter().map(|p| p.len(n)).collect();
        let all = self.length.map_or_else(Vec::new, |length| windows(&lengths, length, MOST_SAMPLES));
        if self.still.len() != all.len() || !self.still.contains(&false) {
            return Vec::new();
        }
        let begins_s = |w: &Window| state.stretches[w.stretch].time(self.paths[w.stretch].first + w.first);
        all.iter().map(begins_s).zip(self.still.iter().copied()).collect()
    }
}
