//! Blocks in memory: those that wait for the link, and those that were streamed and are kept, so
//! that the host can ask for them again.
//!
//! A ring of places in plain bytes, each long enough for a full block of the device's channels: a
//! new block takes the place of the oldest. The stream goes on behind the last block that it took;
//! what it leaves waiting for longer than [`BACKLOG`] blocks is passed over, so that the stream is
//! never stale for long, and is only kept. What the host asks for is looked for by its ticks, and
//! sent oldest first; blocks that are overwritten meanwhile are left out of the answer.
//!
//! Numbers are kept as wide as they are, not packed as on the wire: this is copied in far
//! fewer instructions, and is no longer where arms whirl.
//!
//! Limits: ticks are compared in wrapping arithmetic, right while the ring spans less than 2³¹ of
//! them.

use core::borrow::BorrowMut;

use heapless::Vec;
use whirl_shared::block::sample_count;
use whirl_shared::frame::{BLOCK_LEN, BackFilled, SampleBlock};

/// Bytes that boards with 128 kB of memory keep: of two encoders 1 057 blocks, 21 s at 500 Hz; of
/// three channels 780, 15.6 s.
pub const KEPT: usize = 65_536;
/// First tick, phase, its increment, amplitude; channels and differences.
const HEAD: usize = 4 * 4 + 2;
/// Blocks that may wait for the link before the stream leaves the oldest of them out: 1.3 s of
/// samples at 500 Hz.
pub const BACKLOG: usize = 63;

/// Bytes of a full block of so many channels.
pub const fn block_bytes(channels: usize) -> usize {
    HEAD + channels * (4 + 2 * (BLOCK_LEN - 1))
}

/// The ring, in memory that `K` gives.
#[derive(Debug)]
pub(crate) struct History<K> {
    bytes: K,
    /// Bytes of a place, and how many places there are.
    place: usize,
    room: usize,
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

impl<K: BorrowMut<[u8]>> History<K> {
    /// An empty ring of as many blocks of so many channels as there is memory for. Without room for
    /// any, nothing is streamed; nor is a block of more channels.
    pub fn new(bytes: K, channels: usize) -> Self {
        let place = block_bytes(channels);
        let room = bytes.borrow().len() / place;
        Self { bytes, place, room, next: 0, len: 0, unsent: 0, asked: None }
    }

    /// Blocks that there is room for.
    pub fn room(&self) -> usize {
        self.room
    }

    /// Takes a block. The samples of the one that the stream passes over for it, 0 where it keeps
    /// up.
    pub fn push(&mut self, block: &SampleBlock) -> u32 {
        let mut passed = 0;
        if self.unsent > 0 && self.unsent >= self.room.min(BACKLOG) {
            passed = self.slot(self.unsent).map_or(0, |(_, samples)| samples);
            self.unsent -= 1;
        }
        let start = self.next * self.place;
        let slot = self.bytes.borrow_mut().get_mut(start..start + self.place);
        if slot.and_then(|slot| write(block, slot)).is_none() {
            return passed + sample_count(block);
        }
        self.next = if self.next + 1 < self.room { self.next + 1 } else { 0 };
        self.len = (self.len + 1).min(self.room);
        self.unsent += 1;
        if let Some(Asked { behind: Some(behind), .. }) = &mut self.asked {
            *behind = (*behind + 1).min(self.len);
        }
        passed
    }

    /// The bytes of the block so many before the next one: 1 is the newest.
    fn bytes(&self, behind: usize) -> Option<&[u8]> {
        if behind == 0 || behind > self.len {
            return None;
        }
        let at = if behind <= self.next { self.next - behind } else { self.next + self.room - behind };
        self.bytes.borrow().get(at * self.place..(at + 1) * self.place)
    }

    /// First tick and samples of that block.
    fn slot(&self, behind: usize) -> Option<(u32, u32)> {
        let (head, _) = self.bytes(behind)?.split_first_chunk::<HEAD>()?;
        let [a, b, c, d, .., channels, deltas] = *head;
        Some((u32::from_le_bytes([a, b, c, d]), u32::from(deltas / channels.max(1)) + 1))
    }

    /// That block.
    fn block(&self, behind: usize) -> Option<SampleBlock> {
        read(self.bytes(behind)?)
    }

    /// The next block of the stream.
    pub fn stream(&mut self) -> Option<SampleBlock> {
        let block = self.block(self.unsent)?;
        self.unsent -= 1;
        Some(block)
    }

    /// Nothing that is there is streamed any more.
    pub fn pass(&mut self) {
        self.unsent = 0;
    }

    /// Tick of the oldest sample.
    pub fn oldest(&self) -> Option<u32> {
        self.slot(self.len).map(|(first_tick, _)| first_tick)
    }

    /// The host asks for so many ticks from the first one on; what it has asked for before is void.
    pub fn ask(&mut self, first_tick: u32, ticks: u32) {
        self.asked = Some(Asked { first_tick, ticks, samples: 0, behind: None });
    }

    /// The next part of the answer. None where there is none, and once before the first part, which
    /// is looked for then: no call is long.
    pub fn again(&mut self) -> Option<Again> {
        let asked = self.asked?;
        let Some(behind) = asked.behind else {
            self.asked = Some(Asked { behind: Some(self.find(asked.first_tick)), ..asked });
            return None;
        };
        let part = self.slot(behind).and_then(|(first_tick, samples)| {
            let samples = overlap(first_tick, samples, &asked);
            (samples > 0).then_some(samples).zip(self.block(behind))
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
            let early = self.slot(self.len - middle).is_some_and(|(first_tick, samples)| {
                first_tick.wrapping_add(samples).wrapping_sub(tick).cast_signed() <= 0
            });
            if early { low = middle + 1 } else { high = middle }
        }
        self.len - low
    }
}

/// A block into its place; none, and nothing is written, where it has more channels than fit.
fn write(block: &SampleBlock, into: &mut [u8]) -> Option<()> {
    let (counts, differences) = (4 * block.first.len(), 2 * block.deltas.len());
    let (head, rest) = into.get_mut(..HEAD + counts + differences)?.split_first_chunk_mut::<HEAD>()?;
    let words = [block.first_tick, block.phase, block.phase_increment, block.amplitude_nanometre];
    for (place, word) in head.as_chunks_mut().0.iter_mut().zip(words) {
        *place = word.to_le_bytes();
    }
    // At most seven, and nine times as many.
    (head[HEAD - 2], head[HEAD - 1]) = (block.first.len() as u8, block.deltas.len() as u8);
    let (first, deltas) = rest.split_at_mut_checked(counts)?;
    for (place, count) in first.as_chunks_mut().0.iter_mut().zip(&block.first) {
        *place = count.to_le_bytes();
    }
    for (place, delta) in deltas.as_chunks_mut().0.iter_mut().zip(&block.deltas) {
        *place = delta.to_le_bytes();
    }
    Some(())
}

/// The block of a place.
fn read(from: &[u8]) -> Option<SampleBlock> {
    let (head, rest) = from.split_first_chunk::<HEAD>()?;
    let word = |n: usize| head.as_chunks().0.get(n).map_or(0, |word| u32::from_le_bytes(*word));
    let (counts, differences) = (usize::from(head[HEAD - 2]), usize::from(head[HEAD - 1]));
    let (first, rest) = rest.split_at_checked(4 * counts)?;
    let deltas = rest.get(..2 * differences)?;
    let mut block = SampleBlock {
        first_tick: word(0),
        phase: word(1),
        phase_increment: word(2),
        amplitude_nanometre: word(3),
        first: Vec::new(),
        deltas: Vec::new(),
    };
    // There is room: they were in such lists. Lengthened once: that is less than to push each.
    block.first.resize_default(counts).ok()?;
    block.deltas.resize_default(differences).ok()?;
    for (count, bytes) in block.first.iter_mut().zip(first.as_chunks().0) {
        *count = i32::from_le_bytes(*bytes);
    }
    for (delta, bytes) in block.deltas.iter_mut().zip(deltas.as_chunks().0) {
        *delta = i16::from_le_bytes(*bytes);
    }
    Some(block)
}

/// Samples of a block, by its first tick and their number, that were asked for.
fn overlap(first_tick: u32, samples: u32, asked: &Asked) -> u32 {
    let start = i64::from(first_tick.wrapping_sub(asked.first_tick).cast_signed());
    let end = start + i64::from(samples);
    // At most the samples of a block.
    (end.min(i64::from(asked.ticks)) - start.max(0)).max(0) as u32
}

#[cfg(test)]
mod tests;
