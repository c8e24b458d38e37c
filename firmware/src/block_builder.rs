//! Consecutive samples → blocks.
//!
//! A block can hold samples as long as ticks follow each other, the drive's settings stay and no
//! channel moves by more than a 16-bit difference from one tick to the next.

use whirl_shared::block::{Counts, sample_count};
use whirl_shared::frame::{BLOCK_LEN, SampleBlock};

/// One sample with the drive's settings at its tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Reading {
    pub tick: u32,
    pub counts: Counts,
    pub phase: u32,
    pub phase_increment: u32,
    pub amplitude_nanometre: u32,
}

/// The block that is being filled.
#[derive(Debug, Default)]
pub(crate) struct BlockBuilder {
    open: Option<Open>,
}

#[derive(Debug)]
struct Open {
    block: SampleBlock,
    last: Reading,
}

impl BlockBuilder {
    /// Takes a sample. Gives the block before it where the sample cannot be part of that.
    pub fn push(&mut self, reading: Reading) -> Option<SampleBlock> {
        if self.append(reading) {
            return None;
        }
        let block = SampleBlock {
            first_tick: reading.tick,
            phase: reading.phase,
            phase_increment: reading.phase_increment,
            amplitude_nanometre: reading.amplitude_nanometre,
            // There is room for every channel.
            first: reading.counts.iter().copied().collect(),
            deltas: heapless::Vec::new(),
        };
        self.open.replace(Open { block, last: reading }).map(|open| open.block)
    }

    fn append(&mut self, reading: Reading) -> bool {
        let Some(Open { block, last }) = &mut self.open else { return false };
        let follows = reading.tick == last.tick.wrapping_add(1)
            && reading.phase_increment == block.phase_increment
            && reading.phase == last.phase.wrapping_add(block.phase_increment);
        let differences = || reading.counts.iter().zip(last.counts.iter()).map(|(new, old)| new.wrapping_sub(*old));
        let room = sample_count(block) < BLOCK_LEN as u32 && reading.counts.len() == block.first.len();
        if !(follows && room && differences().all(|d| i16::try_from(d).is_ok())) {
            return false;
        }
        // They fit, and there is room for all.
        block.deltas.extend(differences().map(|d| d as i16));
        *last = reading;
        true
    }

    /// Gives the block if it is full.
    pub fn take_full(&mut self) -> Option<SampleBlock> {
        self.open.take_if(|open| sample_count(&open.block) as usize >= BLOCK_LEN).map(|open| open.block)
    }

    /// Gives what there is.
    pub fn flush(&mut self) -> Option<SampleBlock> {
        self.open.take().map(|open| open.block)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;
    use whirl_shared::block::samples;

    fn reading(tick: u32, counts: [i32; 2], phase: u32, increment: u32) -> Reading {
        Reading { tick, counts: Counts::of(&counts), phase, phase_increment: increment, amplitude_nanometre: 9 }
    }

    #[test]
    fn full_blocks_carry_every_sample_exactly() {
        let mut builder = BlockBuilder::default();
        let mut got = Vec::new();
        let mut sizes = Vec::new();
        let mut keep = |block: SampleBlock| {
            sizes.push(sample_count(&block));
            got.extend(samples(&block).map(|s| (s.tick, s.phase, s.counts)));
        };
        let mut want = Vec::new();
        for i in 0..25_u32 {
            let tick = i.wrapping_sub(13); // runs over the wrap of the tick
            let counts = [i32::MAX.wrapping_add(i as i32 * 31), -(i as i32) * 32_000];
            let phase = i.wrapping_mul(0x2345_6789);
            want.push((tick, phase, Counts::of(&counts)));
            builder.push(reading(tick, counts, phase, 0x2345_6789)).into_iter().for_each(&mut keep);
            builder.take_full().into_iter().for_each(&mut keep);
        }
        builder.flush().into_iter().for_each(&mut keep);
        assert_eq!(got, want);
        assert_eq!(sizes, [10, 10, 5]);
    }

    #[test]
    fn whatever_does_not_follow_starts_a_block() {
        for next in [
            reading(2, [0, 0], 20, 10),
            reading(1, [0, 0], 11, 10),
            reading(1, [0, 0], 10, 0),
            reading(1, [40_000, 0], 10, 10),
            reading(1, [0, -32_769], 10, 10),
            reading(0, [0, 0], 10, 10),
        ] {
            let mut builder = BlockBuilder::default();
            assert!(builder.push(reading(0, [0, 0], 0, 10)).is_none());
            let before = builder.push(next).expect("a block of one sample");
            assert_eq!(sample_count(&before), 1);
            let after = builder.flush().unwrap();
            assert_eq!((after.first_tick, &after.first[..]), (next.tick, &next.counts[..]));
        }
    }
}
