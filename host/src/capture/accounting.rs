//! Where each sample between the first and the last tick has gone: received, or missing and why.
//!
//! Blocks are placed on one line of 64-bit ticks ([`whirl_shared::tick::TickTracker`]) and held back until [`WINDOW`] later ones
//! have come, so that a late block still takes its place; then their samples leave in order, each tick once.
//!
//! Missing samples are told apart in this order, which keeps received + missing equal to the ticks from first to last:
//! 1. overruns and dropped samples, as far as the device's counters report them;
//! 2. damaged: for each gap at most [`BLOCK_LEN`] samples for each frame that was refused since the block before;
//! 3. lost on the link: the rest.

use std::collections::BTreeMap;

use whirl_shared::frame::{BLOCK_LEN, CHANNELS, SampleBlock, Status};
use whirl_shared::tick::{TickEvent, TickTracker};

use crate::record::Losses;

/// Blocks held back for late ones: 0.64 s at 500 Hz.
const WINDOW: usize = 32;
/// A repeated block this far behind (ticks) may be from a device that has restarted unnoticed.
const SUSPICIOUS: u64 = 1000;

/// One sample on its way into the record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Taken {
    pub(super) tick: i64,
    pub(super) counts: [i32; CHANNELS],
    pub(super) phase: u32,
    pub(super) amplitude_nm: u32,
}

/// A block that waits.
#[derive(Clone, Debug)]
struct Held {
    block: SampleBlock,
    /// Samples at its start that came before.
    skip: usize,
    /// Frames refused since the block that came before it.
    bad_before: u64,
}

/// The account of one capture.
#[derive(Debug, Default)]
pub(super) struct Accounting {
    tracker: TickTracker,
    held: BTreeMap<i64, Held>,
    /// What is added to the tracker's ticks: restarts put at least one tick between boots.
    shift: i64,
    next: Option<i64>,
    first: Option<i64>,
    /// Ticks to account for from the first on.
    limit: Option<i64>,
    losses: Losses,
    missing: u64,
    damaged: u64,
    bad_since_block: u64,
    status: Option<Status>,
    restarts: u32,
    /// First ticks of the boots after the first whose samples have not all left yet.
    boots: Vec<i64>,
    /// First tick of a boot that has just begun.
    begun: Option<i64>,
    overruns: u64,
    dropped: u64,
}

/// What a block was, for the one who talks to the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// In order, or plainly explained.
    Fine,
    /// Perhaps from a device that has restarted: ask for a hello.
    AskHello,
}

impl Accounting {
    /// An account of at most `limit` ticks.
    pub(super) fn new(limit: Option<i64>) -> Self {
        Self { limit, ..Self::default() }
    }

    /// Tick behind the last one to account for.
    pub(super) fn end(&self) -> Option<i64> {
        Some(self.first?.saturating_add(self.limit?))
    }

    /// A frame was refused.
    pub(super) fn bad_frame(&mut self) {
        self.losses.bad_frames += 1;
        self.bad_since_block += 1;
    }

    /// Boot id and tick of a hello; true where the device has restarted.
    pub(super) fn hello(&mut self, boot_id: u32, tick: u32) -> bool {
        let restarted = self.tracker.hello(boot_id, tick);
        if restarted && self.first.is_some() {
            self.losses.restarts += 1;
            // Its counters began at zero again.
            self.status = Some(Status::default());
        }
        restarted
    }

    /// The device's counters. Before the first block they set the zero.
    pub(super) fn status(&mut self, status: &Status) {
        if let (Some(before), true) = (&self.status, self.first.is_some()) {
            self.overruns += u64::from(status.overruns.wrapping_sub(before.overruns));
            self.dropped += u64::from(status.dropped_samples.wrapping_sub(before.dropped_samples));
        }
        self.status = Some(status.clone());
    }

    /// Takes a block; samples whose turn has come go to `out`.
    pub(super) fn block(&mut self, block: SampleBlock, out: &mut Vec<Taken>) -> Verdict {
        let len = block.deltas.len() + 1;
        // At most BLOCK_LEN.
        let placed = self.tracker.block(block.first_tick, len as u32);
        let Some(start) = placed.start else {
            // The first blocks may come in another order than they were sent in: what lies before the record is not of it.
            let before = self.tracker.expected().map_or(0, |newest| (newest as u32).wrapping_sub(block.first_tick));
            let early = self.restarts == 0 && before as usize <= 2 * WINDOW * BLOCK_LEN && self.losses.received == 0;
            self.losses.dropped_late += if early { 0 } else { len as u64 };
            return Verdict::AskHello;
        };
        let (mut skip, mut restarted) = (0, false);
        match placed.event {
            TickEvent::Duplicate => {
                self.losses.duplicates += len as u64;
                let behind = self.tracker.expected().unwrap_or(start).saturating_sub(start);
                return if behind > SUSPICIOUS { Verdict::AskHello } else { Verdict::Fine };
            }
            TickEvent::Overlap(n) => {
                self.losses.duplicates += u64::from(n);
                skip = n as usize;
            }
            TickEvent::Restart(missing) => {
                // What is held is of the boot before, and complete.
                self.drain(0, out);
                if missing == 0 {
                    self.shift += 1;
                }
                restarted = true;
            }
            TickEvent::Late | TickEvent::First | TickEvent::Contiguous | TickEvent::Gap(_) | TickEvent::Unplaced => {}
        }
        // Ticks are 64-bit counts of samples at some hundred hertz.
        let start = start as i64 + self.shift;
        if self.next.is_some_and(|next| start + (skip as i64) < next) {
            self.losses.dropped_late += (len - skip) as u64;
            return Verdict::Fine;
        }
        if restarted {
            self.boots.push(start);
            self.begun = Some(start);
            self.restarts += 1;
        }
        if placed.event == TickEvent::Late {
            self.losses.late += len as u64;
        }
        self.first.get_or_insert(start);
        let bad_before = core::mem::take(&mut self.bad_since_block);
        self.held.insert(start + skip as i64, Held { block, skip, bad_before });
        self.drain(WINDOW, out);
        Verdict::Fine
    }

    /// Lets the earliest blocks go until `keep` are held.
    fn drain(&mut self, keep: usize, out: &mut Vec<Taken>) {
        while self.held.len() > keep {
            let Some((start, held)) = self.held.pop_first() else { return };
            let end = self.end().unwrap_or(i64::MAX);
            // Neither such samples nor a gap before them belong to the record.
            if start >= end {
                continue;
            }
            if let Some(next) = self.next
                && start > next
            {
                let gap = start.abs_diff(next);
                self.missing += gap;
                self.losses.gaps += 1;
                self.damaged += gap.min(held.bad_before.saturating_mul(BLOCK_LEN as u64));
            }
            let before = out.len();
            samples(&held.block, start - held.skip as i64, held.skip, out);
            // At most the samples of one block are beyond.
            let beyond = (start + (out.len() - before) as i64).saturating_sub(end).max(0) as usize;
            out.truncate(out.len() - beyond);
            self.losses.received += (out.len() - before) as u64;
            self.next = Some(start + (out.len() - before) as i64);
        }
    }

    /// The end: what is held leaves.
    pub(super) fn finish(&mut self, out: &mut Vec<Taken>) {
        self.drain(0, out);
    }

    /// First tick of a boot after the first that has begun since this was asked last.
    pub(super) fn begun(&mut self) -> Option<i64> {
        self.begun.take()
    }

    /// Where the sample of a tick is the first of its boot to leave: the tick at which that boot begins.
    pub(super) fn boot_before(&mut self, tick: i64) -> Option<i64> {
        let begun = self.boots.partition_point(|first| *first <= tick);
        self.boots.drain(..begun).next_back()
    }

    /// First tick of the record.
    pub(super) fn first_tick(&self) -> Option<i64> {
        self.first
    }

    /// Tick behind the last sample that came (whether it has left or not).
    pub(super) fn newest(&self) -> Option<i64> {
        self.first?;
        self.tracker.expected().map(|t| t as i64 + self.shift)
    }

    /// Samples that are missing, and why.
    pub(super) fn losses(&self) -> Losses {
        let mut rest = self.missing;
        let mut take = |n: u64| {
            let n = n.min(rest);
            rest -= n;
            n
        };
        let (overruns, dropped_by_device) = (take(self.overruns), take(self.dropped));
        let damaged = take(self.damaged);
        Losses { overruns, dropped_by_device, damaged, lost_on_link: rest, ..self.losses.clone() }
    }
}

/// The samples of a block from the `skip`-th on.
fn samples(block: &SampleBlock, start: i64, skip: usize, out: &mut Vec<Taken>) {
    let mut counts = block.first;
    for i in 0..=block.deltas.len() {
        if let Some(delta) = i.checked_sub(1).and_then(|k| block.deltas.get(k)) {
            for (count, &d) in counts.iter_mut().zip(delta) {
                // The device's multi-turn counter wraps in the same way.
                *count = count.wrapping_add(i32::from(d));
            }
        }
        if i >= skip {
            out.push(Taken {
                tick: start + i as i64,
                counts,
                // A block has at most BLOCK_LEN samples.
                phase: block.phase.wrapping_add(block.phase_increment.wrapping_mul(i as u32)),
                amplitude_nm: block.amplitude_nanometre,
            });
        }
    }
}

#[cfg(test)]
#[path = "accounting_tests.rs"]
mod tests;
