//! Samples of blocks, on their way into the record.

use std::ops::Range;

use whirl_shared::block::{self, Counts};
use whirl_shared::frame::SampleBlock;

/// One sample on its way into the record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Taken {
    pub(super) tick: i64,
    pub(super) counts: Counts,
    pub(super) phase: u32,
    pub(super) amplitude_nm: u32,
}

/// Some of the samples of a block that begins at a tick.
pub(super) fn samples(block: &SampleBlock, start: i64, part: Range<usize>, out: &mut Vec<Taken>) {
    for (i, sample) in block::samples(block).enumerate() {
        if part.contains(&i) {
            out.push(Taken {
                tick: start + i as i64,
                counts: sample.counts,
                phase: sample.phase,
                amplitude_nm: block.amplitude_nanometre,
            });
        }
    }
}
