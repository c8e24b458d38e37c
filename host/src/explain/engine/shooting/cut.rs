//! Blocks of windows. A block is what is held out, and what scatter is measured between: a window
//! where there are many. A motion that nothing drives is followed in few, or one; their parts are
//! blocks then, with the window's initial state, fitted to all of it: with K what that is for each
//! column and the target, rows of a block lose S K, S the state's. What blocks leave adds up to what
//! the window leaves.
//!
//! A block has an initial state of its own over the shorter horizon. Fitted to four values for each
//! of its numbers, that takes a quarter of what the block tells, and more of shorter ones: with a
//! sensor for each coordinate a block has eight samples at least. What a model lacks is alike for
//! half a swing; shorter blocks would leave in what is held out what was fitted beside it. Blocks of
//! long records are longer; only where [`FEWEST_BLOCKS`] windows of 32 samples find no room are
//! these the bounds. Where a record is long enough, a block has room for a prediction over the
//! horizon, too: the gap is measured in blocks that are held out.

use std::ops::Range;

use nalgebra::DMatrix;

use super::blocks::Part;
use super::course::Course;
use super::gram::Sums;
use super::normal::Normal;
use super::path::{FEWEST_SAMPLES, Path, Window, samples_of_path, windows};
use super::{BLOCKS, MOST_SAMPLES, longest};
use crate::explain::decidability::FEWEST_BLOCKS;
use crate::explain::engine::prediction;
use crate::explain::engine::setting::Setting;
use crate::explain::engine::state::State;

/// Blocks that a record should give where windows are fewer (by hand): probabilities by their scatter
/// have that many degrees of freedom.
const PARTS: usize = 40;

/// Fewest samples of a block of a long record.
pub const LONG_PART: usize = 2 * FEWEST_SAMPLES;
/// Values of a block for each number of its initial state.
const VALUES: usize = 4;

/// Fewest samples of a block of a short record, of so many numbers of an initial state, sensors and
/// samples in half a swing.
pub fn fewest_of_part(states: usize, sensors: usize, half_swing: f64) -> usize {
    (VALUES * states).div_ceil(sensors.max(1)).max(half_swing.ceil() as usize)
}

/// Whether paths of so many samples have no room for the windows that decide.
pub fn is_short(paths: &[usize]) -> bool {
    windows(paths, LONG_PART, MOST_SAMPLES).len() < FEWEST_BLOCKS
}

/// Blocks that a record has before anything is fitted, and the length of one, s.
pub fn most_blocks(setting: &Setting<'_>, state: &State) -> (usize, f64) {
    let kernels = &setting.geometry.kernels;
    let lengths: Vec<usize> = state.stretches.iter().map(|s| samples_of_path(s, kernels)).collect();
    let all = windows(&lengths, longest(setting, &lengths).max(1), MOST_SAMPLES);
    let parts = blocks_of(setting, &all);
    let samples = all.first().map_or(0, |w| w.count / parts);
    (parts * all.len(), samples as f64 / setting.rig.sample_rate_hz)
}

/// How a window is cut.
#[derive(Clone, Copy)]
pub struct Cut {
    /// Blocks, which are held out one by one.
    pub blocks: usize,
    /// Samples of a segment of a block, which has an initial state of its own.
    pub segment: usize,
}

impl Cut {
    /// The blocks of a window of `count` samples.
    pub fn ranges(self, count: usize) -> impl Iterator<Item = Range<usize>> {
        (0..self.blocks).map(move |b| b * count / self.blocks..(b + 1) * count / self.blocks)
    }
}

/// A block of a window.
pub struct Block {
    /// Its part of the window's sums.
    pub of_window: Sums,
    /// The same with an initial state of its own.
    pub alone: Normal,
    /// Its segments.
    pub segments: Vec<Normal>,
}

/// Blocks of a window, which are held out one by one: where windows are few, since a motion that
/// nothing drives is followed for long, they are parts of one. In chaos all that a window tells is
/// in its end.
pub fn blocks_of(setting: &Setting<'_>, all: &[Window]) -> usize {
    let fewest = all.iter().map(|w| w.count).min().unwrap_or(0);
    let is_free = setting.rig.drive.is_none() && setting.bound.inputs.is_empty();
    let is_long = setting.blocks < BLOCKS || setting.window_s.is_some();
    if !is_free || !is_long || all.len() as f64 >= BLOCKS {
        return 1;
    }
    let of = |samples: usize| PARTS.div_ceil(all.len().max(1)).min(fewest / samples.max(1)).max(1);
    // The gap is measured in blocks that are held out.
    let roomy = of(setting.part.max(setting.room));
    if roomy * all.len() > FEWEST_BLOCKS { roomy } else { of(setting.part) }
}

impl Course<'_> {
    /// A block over every horizon: in its window, with the initial state `solved` there, where it is
    /// not all of it; by itself; in segments.
    pub fn parts(
        &self,
        block: &Block,
        window: &Normal,
        solved: Option<&DMatrix<f64>>,
        is_cut: bool,
    ) -> Option<Vec<Part>> {
        let alone = || Some(Part { gram: block.alone.reduced()?, freedom: self.freedom(&block.alone) });
        let mut out = Vec::with_capacity(3);
        if let Some(solved) = solved {
            let share = block.alone.rows as f64 / window.rows as f64;
            out.push(Part { gram: block.of_window.left_by(solved)?, freedom: share * self.freedom(window) });
        }
        out.push(alone()?);
        if is_cut {
            let mut sum: Option<Part> = None;
            for segment in &block.segments {
                let (gram, freedom) = (segment.reduced()?, self.freedom(segment));
                match &mut sum {
                    Some(part) => {
                        part.gram.add(&gram);
                        part.freedom += freedom;
                    }
                    None => sum = Some(Part { gram, freedom }),
                }
            }
            out.extend(sum);
        }
        Some(out)
    }

    /// Where each block of some windows lies, window by window.
    pub fn places(&self, paths: &[Path], all: &[Window]) -> Vec<Vec<prediction::Range>> {
        let cut = Cut { blocks: blocks_of(self.setting, all), segment: 1 };
        let of = |w: &Window| {
            let first = paths[w.stretch].first + w.first;
            let place =
                |r: Range<usize>| prediction::Range { stretch: w.stretch, begin: first + r.start, end: first + r.end };
            cut.ranges(w.count).map(place).collect()
        };
        all.iter().map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_holds_half_a_swing_and_more_than_its_state() {
        // A swing of 0.85 s at 30 Hz; one of four samples.
        assert_eq!(fewest_of_part(2, 1, 12.8), 13);
        assert_eq!(fewest_of_part(2, 1, 2.0), 8);
        assert_eq!((fewest_of_part(4, 2, 2.0), fewest_of_part(4, 1, 2.0)), (8, 16));
        // Five seconds of it hold as many as decide, and no nine windows of 32 samples.
        assert!(is_short(&[119]) && 119 / fewest_of_part(2, 1, 12.8) >= FEWEST_BLOCKS);
        assert!(!is_short(&[9 * LONG_PART]) && is_short(&[9 * LONG_PART - 1]));
        assert!(!is_short(&[20; 9]) && is_short(&[]));
    }
}
