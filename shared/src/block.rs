//! The samples of a [`SampleBlock`], one by one.
//!
//! Sample i: tick `first_tick + i`, phase `phase + i·phase_increment`, counts of channel k of C
//! `first[k] + Σ_{n<i} deltas[n·C + k]`, all in wrapping arithmetic (ticks and phases modulo 2³²,
//! counts modulo 2³² in two's complement).

use core::ops::Deref;

use crate::frame::{BLOCK_LEN, MOST_CHANNELS, SampleBlock};

/// The counts of all channels at one tick, as a list.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    values: [i32; MOST_CHANNELS],
    len: u8,
}

impl Counts {
    /// As many as fit.
    #[must_use]
    pub fn of(counts: &[i32]) -> Self {
        let mut out = Self::default();
        for (value, count) in out.values.iter_mut().zip(counts) {
            *value = *count;
            out.len += 1;
        }
        out
    }
}

impl Deref for Counts {
    type Target = [i32];

    fn deref(&self) -> &[i32] {
        &self.values[..usize::from(self.len)]
    }
}

impl PartialEq for Counts {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl Eq for Counts {}

impl<const N: usize> PartialEq<[i32; N]> for Counts {
    fn eq(&self, other: &[i32; N]) -> bool {
        **self == other[..]
    }
}

/// One sample of all channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// Sampling tick, wrapping.
    pub tick: u32,
    /// Phase of the drive at that tick, in turns · 2⁻³².
    pub phase: u32,
    /// Multi-turn counts, wrapping.
    pub counts: Counts,
}

/// Number of samples in a block, at least 1. A block that is none ([`is_whole`]) has as many as its
/// whole differences make.
#[must_use]
pub fn sample_count(block: &SampleBlock) -> u32 {
    (block.deltas.len() / block.first.len().max(1)) as u32 + 1
}

/// Whether a block has a channel, and of each as many differences, no more than fit.
#[must_use]
pub fn is_whole(block: &SampleBlock) -> bool {
    let channels = block.first.len();
    channels > 0 && block.deltas.len().is_multiple_of(channels) && block.deltas.len() < BLOCK_LEN * channels
}

/// The samples of a block in order of time.
pub fn samples(block: &SampleBlock) -> impl Iterator<Item = Sample> + '_ {
    let mut next = Sample { tick: block.first_tick, phase: block.phase, counts: Counts::of(&block.first) };
    let first = core::iter::once(next);
    first.chain(block.deltas.chunks_exact(block.first.len().max(1)).map(move |delta| {
        next.tick = next.tick.wrapping_add(1);
        next.phase = next.phase.wrapping_add(block.phase_increment);
        for (count, &difference) in next.counts.values.iter_mut().zip(delta) {
            *count = count.wrapping_add(i32::from(difference));
        }
        next
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use heapless::Vec;
    use std::vec::Vec as StdVec;

    fn block(first: &[i32], deltas: &[i16]) -> SampleBlock {
        SampleBlock {
            first_tick: u32::MAX,
            phase: 0xffff_fff0,
            phase_increment: 0x20,
            amplitude_nanometre: 1,
            first: Vec::from_slice(first).unwrap(),
            deltas: Vec::from_slice(deltas).unwrap(),
        }
    }

    #[test]
    fn samples_run_over_every_wrap() {
        let block = block(&[i32::MAX, 5], &[1, -7, -2, i16::MIN]);
        let list: StdVec<_> = samples(&block).collect();
        assert_eq!(sample_count(&block), 3);
        let sample = |tick, phase, counts: [i32; 2]| Sample { tick, phase, counts: Counts::of(&counts) };
        assert_eq!(
            list,
            [
                sample(u32::MAX, 0xffff_fff0, [i32::MAX, 5]),
                sample(0, 0x10, [i32::MIN, -2]),
                sample(1, 0x30, [i32::MAX - 1, -2 - 32768]),
            ]
        );
    }

    #[test]
    fn blocks_hold_one_to_seven_channels_and_broken_ones_are_none() {
        for channels in 1..=MOST_CHANNELS {
            let first: StdVec<i32> = (0..channels as i32).collect();
            let deltas: StdVec<i16> = (0..9 * channels as i16).collect();
            let block = block(&first, &deltas);
            assert!(is_whole(&block) && sample_count(&block) == 10);
            let last = samples(&block).last().unwrap();
            let sum = |k: usize| k as i32 + (0..9).map(|n| (n * channels + k) as i32).sum::<i32>();
            assert_eq!(*last.counts, (0..channels).map(sum).collect::<StdVec<_>>());
        }
        for (first, deltas) in [(0, 0), (0, 9), (2, 3), (1, 10), (3, 30)] {
            let block = block(&[7; 3][..first], &[1; 30][..deltas]);
            assert!(!is_whole(&block), "{first} {deltas}");
            assert_eq!(samples(&block).count(), sample_count(&block) as usize);
        }
        assert_eq!(Counts::of(&[1; 9]).len(), MOST_CHANNELS);
    }
}
