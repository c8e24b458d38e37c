//! The path that shooting is linearised about: coordinates and rates at every sample of a stretch,
//! and windows of it.
//!
//! At first the record's own low-passed coordinates and their slopes; then what the model's
//! linearised solutions are, window by window.

use std::ops::Range;

use crate::identify::stretches::Stretch;
use crate::identify::windows::Kernels;

/// Fewest samples of a window: an initial state and what is left of it.
pub const FEWEST_SAMPLES: usize = 16;

/// Samples of a stretch that the low-pass leaves.
pub fn samples_of_path(s: &Stretch, kernels: &Kernels) -> usize {
    s.len().saturating_sub(2 * kernels.full.reach())
}

/// A path along a stretch.
#[derive(Clone, Debug)]
pub struct Path {
    /// Sample of the stretch at which it begins.
    pub first: usize,
    /// Coordinates, then rates, 2n for each sample.
    pub states: Vec<f64>,
    /// Samples over which steps of integration are finer: a velocity turns there, and turns back,
    /// within one.
    pub finer: Vec<Range<usize>>,
}

/// By how much steps are finer there (by hand: with steps of an eighth two windows that had been left
/// at 25 and 6.5 times the noise's power were left at 1).
pub const FINER: usize = 8;

impl Path {
    /// The smoothed record.
    pub fn smoothed(s: &Stretch, kernels: &Kernels) -> Self {
        let n = s.coordinates.len();
        let reach = kernels.full.reach();
        let count = samples_of_path(s, kernels);
        let mut states = vec![0.0; 2 * n * count];
        let (mut smooth, mut slope) = (Vec::new(), Vec::new());
        for (k, x) in s.coordinates.iter().enumerate() {
            kernels.full.apply(x, &mut smooth, &mut slope);
            for (i, (q, v)) in smooth.iter().zip(&slope).enumerate() {
                states[2 * n * i + k] = *q;
                states[2 * n * i + n + k] = *v;
            }
        }
        Self { first: reach, states, finer: Vec::new() }
    }

    /// By how much steps of integration are finer in a window.
    pub fn fineness(&self, w: &Window) -> usize {
        let overlaps = |r: &Range<usize>| r.start < w.first + w.count && w.first < r.end;
        if self.finer.iter().any(overlaps) { FINER } else { 1 }
    }

    /// States of a window.
    pub fn of(&self, w: &Window, coordinates: usize) -> &[f64] {
        let m = 2 * coordinates;
        &self.states[m * w.first..m * (w.first + w.count)]
    }

    /// Samples.
    pub fn len(&self, coordinates: usize) -> usize {
        self.states.len() / (2 * coordinates).max(1)
    }
}

/// Some consecutive samples of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Stretch.
    pub stretch: usize,
    /// First sample of the path.
    pub first: usize,
    /// Samples.
    pub count: usize,
}

/// Windows of `length` samples over all paths, behind one another; where they hold more than `most`
/// samples, some that are spread evenly.
pub fn windows(lengths: &[usize], length: usize, most: usize) -> Vec<Window> {
    let mut all = Vec::new();
    for (stretch, &samples) in lengths.iter().enumerate() {
        // Whole windows that share the stretch evenly; a short stretch is one.
        let count = if samples >= length { samples / length } else { usize::from(samples >= FEWEST_SAMPLES) };
        let Some(own) = samples.checked_div(count) else { continue };
        all.extend((0..count).map(|k| Window { stretch, first: k * own, count: own }));
    }
    let kept = all.len().min((most / length.max(1)).max(1));
    (0..kept).map(|k| all[k * all.len() / kept]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_that_reach_into_a_part_have_its_steps() {
        let path = Path { first: 0, states: Vec::new(), finer: vec![100..200, 400..410] };
        let of = |first, count| path.fineness(&Window { stretch: 0, first, count });
        assert_eq!([of(0, 100), of(50, 51), of(150, 20), of(199, 100), of(200, 100)], [1, FINER, FINER, FINER, 1]);
    }

    #[test]
    fn windows_share_a_stretch_evenly() {
        let all = windows(&[1000, 90, 15], 100, 100_000);
        assert_eq!(all.len(), 11);
        assert_eq!(all[9], Window { stretch: 0, first: 900, count: 100 });
        assert_eq!(all[10], Window { stretch: 1, first: 0, count: 90 });
        assert_eq!(windows(&[1000], 100, 500).len(), 5);
        // Few more than are wanted lose few.
        assert_eq!(windows(&[1000], 100, 900).len(), 9);
        assert!(windows(&[0], 100, 500).is_empty());
        // A stretch of ten and a half windows has ten longer ones.
        assert_eq!(windows(&[1050], 100, 100_000)[9], Window { stretch: 0, first: 945, count: 105 });
    }
}
