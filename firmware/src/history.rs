//! Blocks in memory: those that wait for the link, and those that were streamed and are kept, so
//! that the host can ask for them again.
//!
//! A ring of bytes, each block as long as its numbers are (its length, first tick and samples, then
//! postcard, as on the wire): a new block takes the place of the oldest ones. The stream goes on behind the last block
//! that it took; what it leaves waiting for longer than [`BACKLOG`] blocks is passed over, so that
//! the stream is never stale for long, and is only kept. What the host asks for is looked for by
//! its ticks, and sent oldest first; blocks that are overwritten meanwhile are left out of the
//! answer.
//!
//! Limits: ticks are compared in wrapping arithmetic, right while the ring spans less than 2³¹ of
//! them.

use core::borrow::BorrowMut;

use whirl_shared::block::sample_count;
use whirl_shared::codec::samples_frame_len;
use whirl_shared::frame::{BackFilled, MOST_CHANNELS, SampleBlock};

/// Bytes that boards with 128 kB of memory keep. A block of two whirling encoders of 4096 counts is
/// some 60 bytes: 20 s at 500 Hz.
pub const KEPT: usize = 65_536;
/// Length, first tick and number of samples of a block.
const HEAD: usize = 2 + 4 + 1;
/// More bytes than any block takes.
pub const LONGEST_KEPT: usize = HEAD + samples_frame_len(MOST_CHANNELS);
/// Blocks that may wait for the link before the stream leaves the oldest of them out: 1.3 s of
/// samples at 500 Hz.
pub const BACKLOG: usize = 63;

/// The ring, in memory that `K` gives. Places count on and on, wrapping; the byte of a place is at
/// its remainder by the room.
#[derive(Debug)]
pub(crate) struct History<K> {
    bytes: K,
    /// Blocks in the ring, by where they begin.
    oldest: usize,
    next: usize,
    len: usize,
    /// The newest of them that have not been streamed, and where the first of these begins.
    unsent: usize,
    stream: usize,
    asked: Option<Asked>,
}

/// What the host has asked for.
#[derive(Clone, Copy, Debug)]
struct Asked {
    first_tick: u32,
    ticks: u32,
    /// Samples of these ticks that were sent.
    samples: u32,
    /// Where the next block to be sent begins; none before that was looked for.
    at: Option<usize>,
}

/// A part of the answer to the host.
#[derive(Debug)]
pub(crate) enum Again {
    /// A block in which there are samples that were asked for.
    Block(SampleBlock),
    /// There is nothing more.
    Done(BackFilled),
}

impl<K: BorrowMut<[u8]>> History<K> {
    /// An empty ring. In less than [`LONGEST_KEPT`] bytes nothing may find room.
    pub const fn new(bytes: K) -> Self {
        Self { bytes, oldest: 0, next: 0, len: 0, unsent: 0, stream: 0, asked: None }
    }

    /// Bytes that there are.
    pub fn room(&self) -> usize {
        self.bytes.borrow().len()
    }

    /// The place so many bytes behind one.
    fn behind(&self, place: usize, bytes: usize) -> usize {
        let (sum, room) = (place + bytes, self.room());
        // Neither is more than the room.
        if sum < room { sum } else { sum - room }
    }

    fn write(&mut self, place: usize, from: &[u8]) {
        let (first, second) = from.split_at(from.len().min(self.room() - place));
        let bytes = self.bytes.borrow_mut();
        bytes[place..place + first.len()].copy_from_slice(first);
        bytes[..second.len()].copy_from_slice(second);
    }

    /// As many bytes as there are places in `into`.
    fn read(&self, place: usize, into: &mut [u8]) {
        let bytes = self.bytes.borrow();
        let (first, second) = into.split_at_mut(into.len().min(bytes.len() - place));
        first.copy_from_slice(&bytes[place..place + first.len()]);
        second.copy_from_slice(&bytes[..second.len()]);
    }

    /// The head of the block that begins at a place: its bytes, first tick and samples.
    fn head(&self, place: usize) -> (usize, u32, u32) {
        let mut head = [0; HEAD];
        self.read(place, &mut head);
        let [a, b, c, d, e, f, samples] = head;
        (usize::from(u16::from_le_bytes([a, b])), u32::from_le_bytes([c, d, e, f]), samples.into())
    }

    /// Where the block behind the one at a place begins.
    fn following(&self, place: usize) -> usize {
        self.behind(place, self.head(place).0)
    }

    /// The block that begins at a place.
    fn block(&self, place: usize) -> Option<SampleBlock> {
        let mut whole = [0; LONGEST_KEPT];
        let out = whole.get_mut(..self.head(place).0)?;
        self.read(place, out);
        postcard::from_bytes(out.get(HEAD..)?).ok()
    }

    /// Takes a block. The samples of the one that the stream passes over for it, 0 where it keeps
    /// up.
    pub fn push(&mut self, block: &SampleBlock) -> u32 {
        let samples = sample_count(block);
        let mut bytes = [0; LONGEST_KEPT];
        let Ok(written) = postcard::to_slice(block, &mut bytes[HEAD..]) else { return samples };
        let length = HEAD + written.len();
        if length >= self.room() {
            return samples;
        }
        // A block is less than 2¹⁶ bytes and 2⁸ samples.
        bytes[..2].copy_from_slice(&(length as u16).to_le_bytes());
        bytes[2..6].copy_from_slice(&block.first_tick.to_le_bytes());
        bytes[6] = samples as u8;
        let mut passed = if self.unsent >= BACKLOG { self.pass_one() } else { 0 };
        // Never full to the last byte: the end is told from the beginning by its place.
        while self.len > 0 && self.free() <= length {
            if self.unsent == self.len {
                passed += self.pass_one();
            }
            let behind = self.following(self.oldest);
            if let Some(asked) = &mut self.asked
                && asked.at == Some(self.oldest)
            {
                asked.at = Some(behind);
            }
            self.oldest = behind;
            self.len -= 1;
        }
        self.write(self.next, &bytes[..length]);
        if self.unsent == 0 {
            self.stream = self.next;
        }
        self.next = self.behind(self.next, length);
        self.len += 1;
        self.unsent += 1;
        passed
    }

    /// Bytes that hold no block.
    fn free(&self) -> usize {
        match (self.len, self.next > self.oldest) {
            (0, _) => self.room(),
            (_, true) => self.room() - (self.next - self.oldest),
            (_, false) => self.oldest - self.next,
        }
    }

    /// The stream passes over a block: its samples.
    fn pass_one(&mut self) -> u32 {
        self.stream().map_or(0, |block| sample_count(&block))
    }

    /// The next block of the stream.
    pub fn stream(&mut self) -> Option<SampleBlock> {
        if self.unsent == 0 {
            return None;
        }
        let block = self.block(self.stream);
        self.stream = self.following(self.stream);
        self.unsent -= 1;
        block
    }

    /// Nothing that is there is streamed any more.
    pub fn pass(&mut self) {
        self.unsent = 0;
    }

    /// Tick of the oldest sample.
    pub fn oldest(&self) -> Option<u32> {
        (self.len > 0).then(|| self.head(self.oldest).1)
    }

    /// The host asks for so many ticks from the first one on; what it has asked for before is void.
    pub fn ask(&mut self, first_tick: u32, ticks: u32) {
        self.asked = Some(Asked { first_tick, ticks, samples: 0, at: None });
    }

    /// The next part of the answer.
    pub fn again(&mut self) -> Option<Again> {
        let asked = self.asked?;
        let place = asked.at.or_else(|| self.find(asked.first_tick)).filter(|at| self.len > 0 && *at != self.next);
        let part = place.and_then(|at| {
            let block = self.block(at)?;
            let samples = overlap(&block, &asked);
            (samples > 0).then_some((at, samples, block))
        });
        let Some((at, samples, block)) = part else {
            self.asked = None;
            let Asked { first_tick, ticks, samples, .. } = asked;
            return Some(Again::Done(BackFilled { first_tick, ticks, samples }));
        };
        let behind = self.following(at);
        self.asked = Some(Asked { samples: asked.samples.saturating_add(samples), at: Some(behind), ..asked });
        Some(Again::Block(block))
    }

    /// Where the oldest block begins that ends behind a tick.
    fn find(&self, tick: u32) -> Option<usize> {
        let mut at = self.oldest;
        for _ in 0..self.len {
            let (length, first, samples) = self.head(at);
            if first.wrapping_add(samples).wrapping_sub(tick).cast_signed() > 0 {
                return Some(at);
            }
            at = self.behind(at, length);
        }
        None
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
        SampleBlock {
            first_tick,
            first: heapless::Vec::from_slice(&[5, 9]).unwrap(),
            deltas: core::iter::repeat_n(1, 2 * (samples - 1)).collect(),
            ..SampleBlock::EMPTY
        }
    }

    /// Bytes that a block takes.
    fn size(block: &SampleBlock) -> usize {
        HEAD + postcard::to_slice(block, &mut [0; 400]).unwrap().len()
    }

    /// A ring in which so many full blocks were put, from a tick on.
    fn ring(room: usize, blocks: u32, from: u32) -> History<Vec<u8>> {
        let mut history = History::new(std::vec![0; room]);
        for n in 0..blocks {
            history.push(&block(from.wrapping_add(10 * n), 10));
        }
        history
    }

    /// First ticks of the answer, and its end.
    fn answer(history: &mut History<Vec<u8>>) -> (Vec<u32>, BackFilled) {
        let mut ticks = Vec::new();
        loop {
            match history.again().expect("an end") {
                Again::Block(block) => ticks.push(block.first_tick),
                Again::Done(end) => return (ticks, end),
            }
        }
    }

    /// Room for so many full blocks with ticks of two bytes.
    fn room(blocks: usize) -> usize {
        blocks * size(&block(1_000, 10)) + 1
    }

    #[test]
    fn the_stream_takes_every_block_once_and_in_order() {
        let mut history = ring(room(8), 0, 0);
        assert!(history.stream().is_none() && history.oldest().is_none() && history.again().is_none());
        for n in 0..100 {
            let tick = 1_000 + 10 * n;
            assert_eq!(history.push(&block(tick, 10)), 0);
            if n % 3 == 2 {
                let taken: Vec<_> = core::iter::from_fn(|| history.stream()).collect();
                assert_eq!(taken, [tick - 20, tick - 10, tick].map(|t| block(t, 10)));
            }
        }
        assert_eq!(history.oldest(), Some(1_000 + 920));
    }

    /// Blocks of every length, over the ring's end at every place: the newest that fit are there, and
    /// nothing else.
    #[test]
    fn the_ring_holds_the_newest_blocks_that_fit() {
        for bytes in (LONGEST_KEPT..LONGEST_KEPT + 700).step_by(31) {
            let (mut history, mut all, mut seed) = (ring(bytes, 0, 0), Vec::new(), 1_u32);
            for n in 0..400_u32 {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let (channels, more) = (1 + seed as usize / 7 % MOST_CHANNELS, seed as usize / 97 % 10);
                let first_tick = (200 - 10 * 200 + 10 * n as i32) as u32;
                let new = SampleBlock {
                    first_tick,
                    phase: seed >> (seed % 32),
                    first: (0..channels).map(|k| (seed >> k) as i32).collect(),
                    deltas: (0..channels * more).map(|k| (seed >> (k % 24)) as i16).collect(),
                    ..SampleBlock::EMPTY
                };
                history.push(&new);
                all.push(new);
                let mut left = bytes;
                let fits = |block: &&SampleBlock| {
                    let fits = size(block) < left;
                    left = left.saturating_sub(size(block));
                    fits
                };
                let kept: Vec<&SampleBlock> = all.iter().rev().take_while(fits).collect();
                assert_eq!(history.oldest(), kept.last().map(|block| block.first_tick));
                if n % 20 == 0 {
                    history.ask(all[0].first_tick, 10_000);
                    for block in kept.iter().rev() {
                        assert!(matches!(history.again(), Some(Again::Block(got)) if got == **block));
                    }
                    assert!(matches!(history.again(), Some(Again::Done(_))));
                }
            }
        }
    }

    #[test]
    fn a_stream_that_stands_passes_over_the_oldest_and_says_how_many_samples() {
        for (blocks, waiting) in [(200, BACKLOG as u32), (5, 5)] {
            let mut history = ring(room(blocks).max(LONGEST_KEPT), 0, 0);
            let waiting = if blocks == 5 { (history.room() - 1) as u32 / (room(1) as u32 - 1) } else { waiting };
            let passed: u32 = (0..100).map(|n| history.push(&block(1_000 + 10 * n, if n == 0 { 3 } else { 10 }))).sum();
            assert_eq!(passed, 3 + 10 * (99 - waiting));
            assert_eq!(history.stream().map(|block| block.first_tick), Some(1_000 + 10 * (100 - waiting)));
            history.pass();
            assert!(history.stream().is_none());
        }
        // Without memory nothing is kept.
        assert_eq!((ring(0, 1, 0).push(&block(0, 7)), ring(0, 1, 0).oldest()), (7, None));
    }

    #[test]
    fn what_is_asked_for_comes_oldest_first_over_every_wrap() {
        // From 1000 on, and 40 ticks before the wrap.
        for from in [1_000, u32::MAX - 39] {
            let mut history = ring(room(200), 20, from);
            let at = |n: u32| from.wrapping_add(n);
            assert_eq!(history.oldest(), Some(at(0)));
            // All; more than all; from the middle of a block to the middle of another; nothing any
            // more; nothing yet.
            for (first, ticks, blocks, samples) in [
                (0, 200, 0..20, 200),
                (0_u32.wrapping_sub(50), 1_000, 0..20, 200),
                (55, 21, 5..8, 21),
                (0_u32.wrapping_sub(40), 40, 0..0, 0),
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
        let mut history = ring(room(16), 2, 0);
        // Ticks 20 to 26 were missed; a block of 4 and one of 1.
        for (first, samples) in [(27, 4), (31, 1), (32, 10)] {
            history.push(&block(first, samples));
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
        let mut history = ring(room(16), 16, 1_000);
        history.ask(1_000, 160);
        let mut got = Vec::new();
        let mut tick = 1_160;
        let samples = loop {
            match history.again().unwrap() {
                Again::Block(block) => got.push(block.first_tick - 1_000),
                Again::Done(end) => break end.samples,
            }
            // Three new blocks to each that is sent again.
            for _ in 0..3 {
                history.push(&block(tick, 10));
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
