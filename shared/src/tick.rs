//! The device's 32-bit sampling ticks as one line of 64-bit ticks that never runs backwards.
//!
//! A block of samples is placed by the difference between its first tick and the one expected,
//! modulo 2³², in [−2³¹, 2³¹): zero continues, a positive one is a gap of so many samples, a
//! negative one is late or repeated. After a restart of the device (another boot id) its ticks
//! begin at 0 again; they are put directly behind the last one known, which is the shortest the
//! outage can have been: its true length is known to no clock of the device. So is a device whose
//! ticks go back under the same boot id: one without an id of its own, or a replay. A hello tells
//! the tick at which it was sent, which is behind that of every block before it; one that lies more
//! than [`HELLO_LATE`] ticks before what has come is from another start.
//!
//! Limits: gaps of 2³¹ ticks or more (49 days at 500 Hz) are ambiguous. Blocks more than
//! [`LATE_LIMIT`] ticks behind are not placed: the device has probably restarted without its hello
//! having come, and should be asked for one. The last [`GAPS`] gaps are remembered; what comes late
//! for an older one counts as repeated.

use heapless::Deque;

/// How far behind a block may come, ticks (35 minutes at 500 Hz).
pub const LATE_LIMIT: u32 = 1 << 20;
/// By how many ticks of samples a hello may have been overtaken on its way (0.64 s at 500 Hz).
pub const HELLO_LATE: u32 = 320;
/// Gaps into which late blocks can still be put.
pub const GAPS: usize = 16;

/// What a block is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TickEvent {
    /// The first block.
    First,
    /// It follows the last one.
    Contiguous,
    /// This many samples are missing before it.
    Gap(u64),
    /// It was missing until now.
    Late,
    /// All of it came before.
    Duplicate,
    /// So many of its samples came before; the rest continues.
    Overlap(u32),
    /// The device began anew; at least this many samples are missing before it.
    Restart(u64),
    /// Too far behind to be placed; nothing was counted.
    Unplaced,
}

/// A block on the line of ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placed {
    /// What it is.
    pub event: TickEvent,
    /// Tick of its first sample; `None` where it cannot be placed.
    pub start: Option<u64>,
}

/// Samples since the tracker was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TickCounters {
    /// Samples that came, each counted once.
    pub received: u64,
    /// Samples that did not come (yet).
    pub missing: u64,
    /// Samples that came again.
    pub duplicate: u64,
    /// Samples that came late.
    pub late: u64,
    /// Restarts of the device.
    pub restarts: u64,
    /// Samples of blocks that could not be placed.
    pub unplaced: u64,
}

#[derive(Clone, Copy, Debug)]
struct Span {
    start: u64,
    end: u64,
}

/// Places the sample blocks of one device.
#[derive(Clone, Debug, Default)]
pub struct TickTracker {
    boot_id: Option<u32>,
    /// The device's and the extended tick that should come next.
    expected: Option<(u32, u64)>,
    /// Extended tick of the first sample of this boot that came.
    origin: u64,
    restarted: bool,
    gaps: Deque<Span, GAPS>,
    counters: TickCounters,
}

impl TickTracker {
    /// A tracker that takes the first block's tick as it is.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes boot id and tick of a hello; whether the device has restarted since the last block or
    /// hello.
    ///
    /// Where blocks came before the first hello, a hello whose tick lies before theirs is from
    /// another boot; later, where it has another id or lies more than [`HELLO_LATE`] ticks before
    /// them.
    pub fn hello(&mut self, boot_id: u32, tick: u32) -> bool {
        let behind = |(expected, _): (u32, u64)| expected.wrapping_sub(tick).cast_signed();
        let behind = self.expected.filter(|_| !self.restarted).map(behind);
        let restarted = match self.boot_id.replace(boot_id) {
            Some(before) => before != boot_id || behind.is_some_and(|ticks| ticks > HELLO_LATE.cast_signed()),
            None => behind.is_some_and(|ticks| ticks > 0),
        };
        if restarted {
            self.counters.restarts += 1;
            self.restarted = true;
        }
        restarted
    }

    /// Takes the first tick and the number of samples of a block.
    pub fn block(&mut self, first_tick: u32, samples: u32) -> Placed {
        let len = u64::from(samples);
        let Some((device, expected)) = self.expected else {
            self.restarted = false;
            return self.begin(first_tick, u64::from(first_tick), len, TickEvent::First);
        };
        if core::mem::take(&mut self.restarted) {
            let missing = u64::from(first_tick);
            self.counters.missing += missing;
            return self.begin(first_tick, expected.saturating_add(missing), len, TickEvent::Restart(missing));
        }
        let ahead = first_tick.wrapping_sub(device) as i32;
        if ahead >= 0 {
            let missing = u64::from(ahead.unsigned_abs());
            let start = expected.saturating_add(missing);
            let event = if missing == 0 { TickEvent::Contiguous } else { TickEvent::Gap(missing) };
            if missing > 0 {
                self.counters.missing += missing;
                self.remember(Span { start: expected, end: start });
            }
            return self.extend(first_tick, start, len, event);
        }
        let behind = ahead.unsigned_abs();
        let start = expected.checked_sub(u64::from(behind)).filter(|&start| start >= self.origin);
        let (Some(start), true) = (start, behind <= LATE_LIMIT) else {
            self.counters.unplaced += len;
            return Placed { event: TickEvent::Unplaced, start: None };
        };
        self.place_behind(first_tick, Span { start, end: start.saturating_add(len) }, expected)
    }

    fn place_behind(&mut self, first_tick: u32, block: Span, expected: u64) -> Placed {
        let len = block.end - block.start;
        if block.end > expected {
            // Lossless: the repeated part is shorter than the block.
            let repeated = (expected - block.start) as u32;
            self.counters.duplicate += u64::from(repeated);
            self.counters.received += len - u64::from(repeated);
            self.expected = Some((first_tick.wrapping_add(len as u32), block.end));
            return Placed { event: TickEvent::Overlap(repeated), start: Some(block.start) };
        }
        let event = if self.fill(block) {
            self.counters.late += len;
            self.counters.received += len;
            self.counters.missing = self.counters.missing.saturating_sub(len);
            TickEvent::Late
        } else {
            self.counters.duplicate += len;
            TickEvent::Duplicate
        };
        Placed { event, start: Some(block.start) }
    }

    fn begin(&mut self, first_tick: u32, start: u64, len: u64, event: TickEvent) -> Placed {
        self.origin = start;
        self.extend(first_tick, start, len, event)
    }

    fn extend(&mut self, first_tick: u32, start: u64, len: u64, event: TickEvent) -> Placed {
        self.counters.received += len;
        self.expected = Some((first_tick.wrapping_add(len as u32), start.saturating_add(len)));
        Placed { event, start: Some(start) }
    }

    fn remember(&mut self, gap: Span) {
        if self.gaps.is_full() {
            self.gaps.pop_front();
        }
        // There is room now.
        let _ = self.gaps.push_back(gap);
    }

    /// Takes a block out of the gap in which it lies; whether there is one.
    fn fill(&mut self, block: Span) -> bool {
        let Some(gap) = self.gaps.iter_mut().find(|gap| gap.start <= block.start && block.end <= gap.end) else {
            return false;
        };
        let rest = Span { start: block.end, end: gap.end };
        gap.end = block.start;
        if rest.start < rest.end {
            self.remember(rest);
        }
        true
    }

    /// Where a tick of the present boot lies; `None` before its first block that came, and before
    /// that block.
    #[must_use]
    pub fn place(&self, tick: u32) -> Option<u64> {
        let (device, extended) = self.expected.filter(|_| !self.restarted)?;
        let ahead = tick.wrapping_sub(device).cast_signed();
        extended.checked_add_signed(i64::from(ahead)).filter(|place| *place >= self.origin)
    }

    /// The device's tick at a place of the present boot: the other way round.
    #[must_use]
    pub fn device_tick(&self, place: u64) -> Option<u32> {
        let (device, extended) = self.expected.filter(|_| !self.restarted)?;
        // Modulo 2³², as the device counts.
        Some(device.wrapping_add(place.wrapping_sub(extended) as u32))
    }

    /// Extended tick that should come next; `None` before the first block.
    #[must_use]
    pub fn expected(&self) -> Option<u64> {
        self.expected.map(|(_, extended)| extended)
    }

    /// Whether the device has restarted and no block has come since.
    #[must_use]
    pub fn is_restarting(&self) -> bool {
        self.restarted
    }

    /// What was seen until now.
    #[must_use]
    pub fn counters(&self) -> TickCounters {
        self.counters
    }
}

#[cfg(test)]
mod tests;
