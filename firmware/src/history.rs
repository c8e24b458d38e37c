//! Blocks in memory: those that wait for the link, and those that were streamed and are kept, so
//! that the host can ask for them again.
//!
//! A ring: a new block takes the place of the oldest. The stream goes on behind the last block that
//! it took; what it leaves waiting for longer than [`BACKLOG`] blocks is passed over, so that the
//! stream is never stale for long, and is only kept. What the host asks for is looked for by its
//! ticks, and sent oldest first; blocks that are overwritten meanwhile are left out of the answer.
//!
//! Limits: ticks are compared in wrapping arithmetic, right while the ring spans less than 2³¹ of
//! them.

use core::borrow::BorrowMut;

use whirl_shared::block::sample_count;
use whirl_shared::frame::{BackFilled, SampleBlock};

/// Blocks that boards with 128 kB of memory keep: 20.5 s of samples at 500 Hz, 64 bytes each.
pub const KEPT: usize = 1_024;
/// Blocks that may wait for the link before the stream leaves the oldest of them out: 1.3 s of
/// samples at 500 Hz.
pub const BACKLOG: usize = 63;

/// The ring, in memory that `K` gives.
#[derive(Debug)]
pub(crate) struct History<K> {
    slots: K,
    /// Where the next block goes.
    next: usize,
    /// Blocks in the ring.
    len: usize,
    /// The newest of them that have not been streamed.
    unsent: usize,
    asked: Option<Asked>,
}

/// What the host has asked for.
#[derive(Clone, Copy, Debug)]
struct Asked {
    first_tick: u32,
    ticks: u32,
    /// Samples of these ticks that were sent.
    samples: u32,
    /// Blocks from the next one to be sent to the newest; none before that was looked for.
    behind: Option<usize>,
}

/// A part of the answer to the host.
#[derive(Debug)]
pub(crate) enum Again {
    /// A block in which there are samples that were asked for.
    Block(SampleBlock),
    /// There is nothing more.
    Done(BackFilled),
}

impl<K: BorrowMut<[SampleBlock]>> History<K> {
    /// An empty ring of as many blocks as there is memory for. Without any, nothing is streamed.
    pub const fn new(slots: K) -> Self {
        Self { slots, next: 0, len: 0, unsent: 0, asked: None }
    }

    /// Blocks that there is room for.
    pub fn room(&self) -> usize {
        self.slots.borrow().len()
    }

    /// Takes a block. The samples of the one that the stream passes over for it, 0 where it keeps
    /// up.
    pub fn push(&mut self, block: SampleBlock) -> u32 {
        let room = self.room();
        let mut passed = 0;
        if self.unsent > 0 && self.unsent >= room.min(BACKLOG) {
            passed = self.slot(self.unsent).map_or(0, sample_count);
            self.unsent -= 1;
        }
        let Some(slot) = self.slots.borrow_mut().get_mut(self.next) else { return sample_count(&block) };
        *slot = block;
        self.next = if self.next + 1 < room { self.next + 1 } else { 0 };
        self.len = (self.len + 1).min(room);
        self.unsent += 1;
        if let Some(Asked { behind: Some(behind), .. }) = &mut self.asked {
            *behind = (*behind + 1).min(self.len);
        }
        passed
    }

    /// The block so many before the next one: 1 is the newest.
    fn slot(&self, behind: usize) -> Option<&SampleBlock> {
        if behind == 0 || behind > self.len {
            return None;
        }
        let at = if behind <= self.next { self.next - behind } else { self.next + self.room() - behind };
        self.slots.borrow().get(at)
    }

    /// The next block of the stream.
    pub fn stream(&mut self) -> Option<SampleBlock> {
        let block = self.slot(self.unsent)?.clone();
        self.unsent -= 1;
        Some(block)
    }

    /// Nothing that is there is streamed any more.
    pub fn pass(&mut self) {
        self.unsent = 0;
    }

    /// Tick of the oldest sample.
    pub fn oldest(&self) -> Option<u32> {
        self.slot(self.len).map(|block| block.first_tick)
    }

    /// The host asks for so many ticks from the first one on; what it has asked for before is void.
    pub fn ask(&mut self, first_tick: u32, ticks: u32) {
        self.asked = Some(Asked { first_tick, ticks, samples: 0, behind: None });
    }

    /// The next part of the answer.
    pub fn again(&mut self) -> Option<Again> {
        let asked = self.asked?;
        let behind = asked.behind.unwrap_or_else(|| self.find(asked.first_tick));
        let part = self.slot(behind).and_then(|block| {
            let samples = overlap(block, &asked);
            (samples > 0).then(|| (samples, block.clone()))
        });
        let Some((samples, block)) = part else {
            self.asked = None;
            let Asked { first_tick, ticks, samples, .. } = asked;
            return Some(Again::Done(BackFilled { first_tick, ticks, samples }));
        };
        self.asked = Some(Asked { samples: asked.samples.saturating_add(samples), behind: Some(behind - 1), ..asked });
        Some(Again::Block(block))
    }

    /// The oldest block that ends behind a tick, as [`Self::slot`] counts; 0 where there is none.
    fn find(&self, tick: u32) -> usize {
        // Blocks before `low`, from the oldest on, end too early; those from `high` on do not.
        let (mut low, mut high) = (0, self.len);
        while low < high {
            let middle = low + (high - low) / 2;
            let early = self.slot(self.len - middle).is_some_and(|block| {
                let end = block.first_tick.wrapping_add(sample_count(block));
                end.wrapping_sub(tick).cast_signed() <= 0
            });
            if early { low = middle + 1 } else { high = middle }
        }
        self.len - low
    }
}

/// Samples of a block that were asked for.
fn overlap(block: &SampleBlock, asked: &Asked) -> u32 {
    let start = i64::from(block.first_tick.wrapping_sub(asked.first_tick).cast_signed());
    let end = start + i64::from(sample_count(block));
    // At most the samples of a block.
    (end.min(i64::from(asked.ticks)) - start.max(0)).max(0) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn block(first_tick: u32, samples: usize) -> SampleBlock {
        SampleBlock { first_tick, deltas: core::iter::repeat_n([1, 2], samples - 1).collect(), ..SampleBlock::EMPTY }
    }

    /// A ring in which so many full blocks were put, from a tick on.
    fn ring(room: usize, blocks: u32, from: u32) -> History<Vec<SampleBlock>> {
        let mut history = History::new(std::vec![SampleBlock::EMPTY; room]);
        for n in 0..blocks {
            history.push(block(from.wrapping_add(10 * n), 10));
        }
        history
    }

    /// First ticks of the answer, and its end.
    fn answer(history: &mut History<Vec<SampleBlock>>) -> (Vec<u32>, BackFilled) {
        let mut ticks = Vec::new();
        loop {
            match history.again().expect("an end") {
                Again::Block(block) => ticks.push(block.first_tick),
                Again::Done(end) => return (ticks, end),
            }
        }
    }

    #[test]
    fn the_stream_takes_every_block_once_and_in_order() {
        let mut history = ring(8, 0, 0);
        assert!(history.stream().is_none() && history.oldest().is_none() && history.again().is_none());
        for n in 0..100 {
            assert_eq!(history.push(block(10 * n, 10)), 0);
            if n % 3 == 2 {
                let taken: Vec<_> = core::iter::from_fn(|| history.stream()).map(|block| block.first_tick).collect();
                assert_eq!(taken, [10 * n - 20, 10 * n - 10, 10 * n]);
            }
        }
        // 93 blocks and more ago is overwritten.
        assert_eq!(history.oldest(), Some(920));
    }

    #[test]
    fn a_stream_that_stands_passes_over_the_oldest_and_says_how_many_samples() {
        for (room, waiting) in [(200, BACKLOG as u32), (5, 5)] {
            let mut history = ring(room, 0, 0);
            let passed: u32 = (0..100).map(|n| history.push(block(10 * n, if n == 0 { 3 } else { 10 }))).sum();
            assert_eq!(passed, 3 + 10 * (99 - waiting));
            assert_eq!(history.stream().map(|block| block.first_tick), Some(10 * (100 - waiting)));
            history.pass();
            assert!(history.stream().is_none());
        }
        // Without memory nothing is kept.
        assert_eq!((ring(0, 1, 0).push(block(0, 7)), ring(0, 1, 0).oldest()), (7, None));
    }

    #[test]
    fn what_is_asked_for_comes_oldest_first_over_every_wrap() {
        // 40 ticks before the wrap, and the ring's own wrap among them.
        for from in [0, u32::MAX - 39] {
            let mut history = ring(16, 20, from);
            let at = |n: u32| from.wrapping_add(n);
            assert_eq!(history.oldest(), Some(at(40)));
            // All; more than all; from the middle of a block to the middle of another; nothing any
            // more; nothing yet.
            for (first, ticks, blocks, samples) in [
                (40, 160, 4..20, 160),
                (0, 1_000, 4..20, 160),
                (55, 21, 5..8, 21),
                (0, 40, 0..0, 0),
                (200, 50, 0..0, 0),
                (40, 0, 0..0, 0),
            ] {
                history.ask(at(first), ticks);
                let (got, end) = answer(&mut history);
                assert_eq!(got, blocks.map(|n| at(10 * n)).collect::<Vec<_>>(), "{first} {ticks}");
                assert_eq!(end, BackFilled { first_tick: at(first), ticks, samples });
                assert!(history.again().is_none());
            }
        }
    }

    #[test]
    fn ticks_that_never_were_are_not_in_the_answer() {
        let mut history = ring(16, 2, 0);
        // Ticks 20 to 26 were missed; a block of 4 and one of 1.
        for (first, samples) in [(27, 4), (31, 1), (32, 10)] {
            history.push(block(first, samples));
        }
        history.ask(15, 18);
        assert_eq!(
            answer(&mut history),
            (std::vec![10, 27, 31, 32], BackFilled { first_tick: 15, ticks: 18, samples: 11 })
        );
        history.ask(20, 7);
        assert_eq!(answer(&mut history), (std::vec![], BackFilled { first_tick: 20, ticks: 7, samples: 0 }));
    }

    #[test]
    fn an_answer_goes_on_while_the_ring_is_overwritten_and_leaves_out_what_is() {
        let mut history = ring(16, 16, 0);
        history.ask(0, 160);
        let mut got = Vec::new();
        let mut tick = 160;
        let samples = loop {
            match history.again().unwrap() {
                Again::Block(block) => got.push(block.first_tick),
                Again::Done(end) => break end.samples,
            }
            // Three new blocks to each that is sent again.
            for _ in 0..3 {
                history.push(block(tick, 10));
                tick += 10;
            }
        };
        assert_eq!(got, [0, 30, 60, 90, 120, 150]);
        assert_eq!(samples, 60);
        // A new question takes the place of the old one.
        history.ask(tick - 160, 160);
        assert!(matches!(history.again(), Some(Again::Block(_))));
        history.ask(tick - 10, 10);
        assert_eq!(answer(&mut history).0, [tick - 10]);
    }
}
