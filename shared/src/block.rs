//! The samples of a [`SampleBlock`], one by one.
//!
//! Sample i: tick `first_tick + i`, phase `phase + i·phase_increment`, counts
//! `first + Σ_{n<i} deltas[n]`, all in wrapping arithmetic (ticks and phases modulo 2³², counts
//! modulo 2³² in two's complement).

use crate::frame::{CHANNELS, SampleBlock};

/// One sample of both encoders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// Sampling tick, wrapping.
    pub tick: u32,
    /// Phase of the drive at that tick, in turns · 2⁻³².
    pub phase: u32,
    /// Multi-turn counts, wrapping.
    pub counts: [i32; CHANNELS],
}

/// Number of samples in a block (at least 1).
#[must_use]
pub fn sample_count(block: &SampleBlock) -> u32 {
    block.deltas.len() as u32 + 1
}

/// The samples of a block in order of time.
pub fn samples(block: &SampleBlock) -> impl Iterator<Item = Sample> + '_ {
    let mut next = Sample { tick: block.first_tick, phase: block.phase, counts: block.first };
    let first = core::iter::once(next);
    first.chain(block.deltas.iter().map(move |delta| {
        next.tick = next.tick.wrapping_add(1);
        next.phase = next.phase.wrapping_add(block.phase_increment);
        for (count, &difference) in next.counts.iter_mut().zip(delta) {
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

    #[test]
    fn samples_run_over_every_wrap() {
        let block = SampleBlock {
            first_tick: u32::MAX,
            phase: 0xffff_fff0,
            phase_increment: 0x20,
            amplitude_nanometre: 1,
            first: [i32::MAX, 5],
            deltas: Vec::from_slice(&[[1, -7], [-2, i16::MIN]]).unwrap(),
        };
        let list: StdVec<_> = samples(&block).collect();
        assert_eq!(sample_count(&block), 3);
        assert_eq!(
            list,
            [
                Sample { tick: u32::MAX, phase: 0xffff_fff0, counts: [i32::MAX, 5] },
                Sample { tick: 0, phase: 0x10, counts: [i32::MIN, -2] },
                Sample { tick: 1, phase: 0x30, counts: [i32::MAX - 1, -2 - 32768] },
            ]
        );
    }
}
