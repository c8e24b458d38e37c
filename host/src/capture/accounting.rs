//! Where each sample between the first and the last tick has gone: received, or missing and why.
//!
//! Blocks are placed on one line of 64-bit ticks ([`whirl_shared::tick::TickTracker`]) and held
//! back until [`WINDOW`] later ones have come, so that a late block still takes its place; then
//! their samples leave in order, each tick once.
//!
//! What lies behind a gap is held back for longer, as long as the gap may be filled by samples that
//! the device sends again (`super::back_fill` asks for them). It is not waited for any more where
//! - the device says that it does not keep these ticks any more ([`Status::kept_from`]), or never
//!   had them ([`BackFilled`]);
//! - it has answered [`FRUITLESS`] times and nothing new came;
//! - so many samples of the stream have come since the last one that was restored as the account's
//!   patience says;
//! - [`MOST_HELD`] blocks are held back, or the device has restarted.
//!
//! All this is decided by what the device has sent, so that a journal gives the same account as the
//! capture that wrote it.
//!
//! Missing samples are told apart in this order, which keeps received + missing equal to the ticks
//! from first to last:
//! 1. overruns and dropped samples, as far as the device's counters report them (less those that
//!    were restored);
//! 2. damaged: for each gap at most [`BLOCK_LEN`] samples for each frame that was refused since the
//!    block before;
//! 3. lost on the link: the rest.

use std::collections::BTreeMap;
use std::ops::Range;

use whirl_shared::block::sample_count;
use whirl_shared::frame::{BLOCK_LEN, BackFilled, SampleBlock, Status};
use whirl_shared::tick::{HELLO_LATE, TickEvent, TickTracker};

use super::taken::{Taken, samples};
use crate::record::Losses;

/// Blocks held back for late ones: 0.64 s at 500 Hz.
const WINDOW: usize = 32;
/// Answers without anything new after which a gap is left as it is.
const FRUITLESS: u32 = 4;
/// Blocks held back at most: 5 minutes at 500 Hz, 2 MB.
const MOST_HELD: usize = 1 << 14;

/// Samples of a block that wait.
#[derive(Clone, Debug)]
struct Held {
    block: SampleBlock,
    /// Which of them: those before came otherwise, or not at all.
    part: Range<usize>,
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
    /// Samples of the stream for which a gap waits to be filled.
    patience: u64,
    /// Those that came since the last one was restored, while a gap waits; answers since then.
    waited: u64,
    answers: u32,
    /// Tick before which nothing is waited for any more.
    given_up: i64,
    again: Again,
}

/// Samples of the stream that came a second time, farther behind than a link delivers late.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Again {
    pub(super) samples: u64,
    /// Tick that was due when the first of them came.
    pub(super) behind: i64,
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
    /// An account of at most `limit` ticks, in which a gap waits for so many samples of the stream
    /// to be filled.
    pub(super) fn new(limit: Option<i64>, patience: u64) -> Self {
        Self { limit, patience, ..Self::default() }
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
        if let Some(kept) = self.place(status.kept_from) {
            self.give_up(kept);
        }
    }

    /// Nothing before a tick is waited for any more, as far as samples have come.
    fn give_up(&mut self, before: i64) {
        self.given_up = self.given_up.max(before.min(self.newest().unwrap_or(before)));
    }

    /// Where a tick of the device's present boot lies.
    fn place(&self, tick: u32) -> Option<i64> {
        // Ticks are 64-bit counts of samples at some hundred hertz.
        Some(self.tracker.place(tick)? as i64 + self.shift)
    }

    /// Takes a block of the stream; samples whose turn has come go to `out`.
    pub(super) fn block(&mut self, block: &SampleBlock, out: &mut Vec<Taken>) -> Verdict {
        let placed = self.tracker.block(block.first_tick, sample_count(block));
        let verdict = match placed.start {
            Some(start) => self.stream(block, start, placed.event, out),
            None => self.unplaced(block),
        };
        self.wait(sample_count(block).into());
        self.drain(WINDOW, out);
        verdict
    }

    fn unplaced(&mut self, block: &SampleBlock) -> Verdict {
        // The first blocks may come in another order than they were sent in: what lies before the
        // record is not of it.
        let before = self.tracker.expected().map_or(0, |newest| (newest as u32).wrapping_sub(block.first_tick));
        let early = self.restarts == 0 && before as usize <= 2 * WINDOW * BLOCK_LEN && self.losses.received == 0;
        self.losses.dropped_late += if early { 0 } else { sample_count(block).into() };
        Verdict::AskHello
    }

    fn stream(&mut self, block: &SampleBlock, start: u64, event: TickEvent, out: &mut Vec<Taken>) -> Verdict {
        if let TickEvent::Restart(missing) = event {
            self.shift += i64::from(missing == 0);
            let start = start as i64 + self.shift;
            // What is held is of the boot before, and complete.
            self.given_up = start;
            self.drain(0, out);
            self.boots.push(start);
            self.begun = Some(start);
            self.restarts += 1;
        }
        let (start, len) = (start as i64 + self.shift, u64::from(sample_count(block)));
        self.first.get_or_insert(start);
        let behind = self.next.unwrap_or(start).saturating_sub(start).max(0).unsigned_abs();
        let new = self.insert(start, block, self.bad_since_block);
        if new > 0 {
            self.bad_since_block = 0;
        }
        let old = len - new - self.beyond_end(start, len);
        match event {
            TickEvent::Duplicate if new == 0 => {
                self.losses.duplicates += old;
                let newest = self.newest().unwrap_or(start);
                // Perhaps from a device that has restarted unnoticed.
                if newest - start <= i64::from(HELLO_LATE) {
                    return Verdict::Fine;
                }
                self.again = match self.again {
                    Again { samples: 0, .. } => Again { samples: old, behind: newest },
                    Again { samples, behind } => Again { samples: samples + old, behind },
                };
                return Verdict::AskHello;
            }
            TickEvent::Late | TickEvent::Duplicate => {
                let passed = behind.min(old);
                self.losses.late += new;
                self.losses.dropped_late += passed;
                self.losses.duplicates += old - passed;
            }
            _ => self.losses.duplicates += old,
        }
        Verdict::Fine
    }

    /// Takes a block that was sent again: what is missing of it, and nothing else.
    pub(super) fn restored(&mut self, block: &SampleBlock, out: &mut Vec<Taken>) {
        let Some(start) = self.place(block.first_tick) else { return };
        // What has not come yet cannot come again.
        if self.newest().is_none_or(|newest| start + i64::from(sample_count(block)) > newest) {
            return;
        }
        let new = self.insert(start, block, 0);
        if new > 0 {
            self.losses.restored += new;
            (self.waited, self.answers) = (0, 0);
        }
        self.drain(WINDOW, out);
    }

    /// The device has sent all that it has of what it was asked for.
    pub(super) fn back_filled(&mut self, end: &BackFilled, out: &mut Vec<Taken>) {
        let Some(start) = self.place(end.first_tick) else { return };
        let until = start.saturating_add(i64::from(end.ticks));
        self.answers += 1;
        // Frames of the answer may have been lost on their way: these are asked for again.
        let all = self.missing_in(start..until) <= u64::from(end.ticks.saturating_sub(end.samples));
        if all || self.answers >= FRUITLESS {
            self.give_up(until);
            self.answers = 0;
            self.drain(WINDOW, out);
        }
    }

    /// Samples of a block that lie behind the end of the record.
    fn beyond_end(&self, start: i64, len: u64) -> u64 {
        let end = self.end().unwrap_or(i64::MAX);
        start.saturating_add(len as i64).saturating_sub(end).max(0).unsigned_abs().min(len)
    }

    /// Holds what is missing of a block, and says how many samples that is.
    fn insert(&mut self, start: i64, block: &SampleBlock, mut bad_before: u64) -> u64 {
        let end = start.saturating_add(i64::from(sample_count(block))).min(self.end().unwrap_or(i64::MAX));
        let mut at = start.max(self.next.or(self.first).unwrap_or(start));
        let mut new = 0;
        while at < end {
            let before = self.held.range(..=at).next_back();
            if let Some(covered) = before.map(|(start, held)| start + held.part.len() as i64).filter(|end| *end > at) {
                at = covered;
                continue;
            }
            let until = self.held.range(at..).next().map_or(end, |(start, _)| end.min(*start));
            // Both lie within the block.
            let part = (at - start) as usize..(until - start) as usize;
            new += part.len() as u64;
            self.held.insert(at, Held { block: block.clone(), part, bad_before: core::mem::take(&mut bad_before) });
            at = until;
        }
        new
    }

    /// The first ticks that are missing and may still be restored.
    pub(super) fn open(&self) -> Option<Range<i64>> {
        let mut at = self.next.or(self.first)?.max(self.given_up);
        for (&start, held) in &self.held {
            if start > at {
                return Some(at..start);
            }
            at = at.max(start + held.part.len() as i64);
        }
        // What came last lies behind the end.
        let until = self.end()?.min(self.newest()?);
        (until > at).then_some(at..until)
    }

    /// How many of these ticks are missing.
    fn missing_in(&self, ticks: Range<i64>) -> u64 {
        let mut at = ticks.start.max(self.next.or(self.first).unwrap_or(ticks.start));
        let end = ticks.end.min(self.end().unwrap_or(i64::MAX));
        let mut missing = 0;
        let begin = self.held.range(..=at).next_back().map_or(at, |(start, _)| *start);
        for (&start, held) in self.held.range(begin..end.max(begin)) {
            missing += start.saturating_sub(at).max(0).unsigned_abs();
            at = at.max(start + held.part.len() as i64);
        }
        missing + end.saturating_sub(at).max(0).unsigned_abs()
    }

    /// So many samples of the stream came while something may be missing.
    fn wait(&mut self, samples: u64) {
        if self.open().is_none() {
            (self.waited, self.answers) = (0, 0);
            return;
        }
        self.waited += samples;
        if self.waited > self.patience || self.held.len() > MOST_HELD {
            self.give_up(i64::MAX);
        }
    }

    /// Lets the earliest blocks go until `keep` are held, or a gap waits to be filled.
    fn drain(&mut self, keep: usize, out: &mut Vec<Taken>) {
        while self.held.len() > keep {
            let waits = |(start, _): (&i64, _)| self.next.is_some_and(|next| *start > next) && *start > self.given_up;
            if self.held.first_key_value().is_some_and(waits) {
                return;
            }
            let Some((start, held)) = self.held.pop_first() else { return };
            if let Some(next) = self.next
                && start > next
            {
                let gap = start.abs_diff(next);
                self.missing += gap;
                self.losses.gaps += 1;
                self.damaged += gap.min(held.bad_before.saturating_mul(BLOCK_LEN as u64));
            }
            let len = held.part.len();
            samples(&held.block, start - held.part.start as i64, held.part, out);
            self.losses.received += len as u64;
            self.next = Some(start + len as i64);
        }
    }

    /// The end: what is held leaves.
    pub(super) fn finish(&mut self, out: &mut Vec<Taken>) {
        self.given_up = i64::MAX;
        self.drain(0, out);
    }

    /// Ticks of the device's present boot, as it counts them.
    pub(super) fn device_tick(&self, tick: i64) -> Option<u32> {
        self.tracker.device_tick(tick.checked_sub(self.shift)?.try_into().ok()?)
    }

    /// First tick of a boot after the first that has begun since this was asked last.
    pub(super) fn begun(&mut self) -> Option<i64> {
        self.begun.take()
    }

    /// Where the sample of a tick is the first of its boot to leave: the tick at which that boot
    /// begins.
    pub(super) fn boot_before(&mut self, tick: i64) -> Option<i64> {
        let begun = self.boots.partition_point(|first| *first <= tick);
        self.boots.drain(..begun).next_back()
    }

    /// Whether the device has restarted, and no sample of it has come since.
    pub(super) fn is_restarting(&self) -> bool {
        self.tracker.is_restarting()
    }

    /// What came a second time long after the first.
    pub(super) fn again(&self) -> Again {
        self.again
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
        let (overruns, dropped_by_device) =
            (take(self.overruns), take(self.dropped.saturating_sub(self.losses.restored)));
        let damaged = take(self.damaged);
        Losses { overruns, dropped_by_device, damaged, lost_on_link: rest, ..self.losses.clone() }
    }
}

#[cfg(test)]
#[path = "accounting_tests.rs"]
mod tests;
