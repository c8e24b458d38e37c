//! Lost, repeated and late frames from their numbers, in wrapping arithmetic.
//!
//! The number of a frame is compared with that of the newest one by their difference d modulo 2¹⁶
//! in [−2¹⁵, 2¹⁵):
//!
//! | d | means |
//! |---|---|
//! | 1 | next |
//! | 2 … 2¹⁵ − 1 | d − 1 lost |
//! | 0 … −63 | seen already: repeated; not seen: late, and one lost frame fewer |
//! | −64 … −2¹⁵ | the sender has started anew |
//!
//! Limits: numbers alone cannot tell a gap of 2¹⁵ frames or more from a restart (10 minutes at the
//! device's 52 frames a second), nor a restart within the first 64 frames from repeats. The
//! device's boot id tells restarts ([`SequenceTracker::restart_at`]), and [`crate::tick`] counts
//! what is missing in samples over any outage.

/// Frames back from the newest one for which it is remembered whether they came.
pub const HISTORY: u16 = 64;

/// What a frame's number says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SequenceEvent {
    /// The first frame.
    First,
    /// The one after the newest.
    Next,
    /// This many are missing between the newest and this one.
    Gap(u16),
    /// It came before.
    Duplicate,
    /// It was missing until now.
    Late,
    /// The sender began anew.
    Restart,
}

/// What was seen since the tracker was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SequenceCounters {
    /// Frames that came, each counted once.
    pub received: u64,
    /// Frames that did not come (yet).
    pub lost: u64,
    /// Frames that came again.
    pub duplicate: u64,
    /// Frames that came after a later one.
    pub late: u64,
    /// Restarts of the sender.
    pub restarts: u64,
}

/// Follows the frame numbers of one sender.
#[derive(Clone, Copy, Debug, Default)]
pub struct SequenceTracker {
    newest: Option<u16>,
    /// Bit i: the frame i before the newest has come.
    seen: u64,
    /// How many numbers, the newest included, lie between the first frame and it; at most 64.
    span: u16,
    counters: SequenceCounters,
}

impl SequenceTracker {
    /// A tracker that takes the first number as it is.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the number of a frame.
    pub fn observe(&mut self, sequence: u16) -> SequenceEvent {
        let Some(newest) = self.newest else {
            self.begin(sequence);
            return SequenceEvent::First;
        };
        let ahead = sequence.wrapping_sub(newest) as i16;
        if ahead > 0 {
            let ahead = ahead.unsigned_abs();
            self.newest = Some(sequence);
            self.seen = self.seen.checked_shl(u32::from(ahead)).unwrap_or(0) | 1;
            self.span = self.span.saturating_add(ahead).min(HISTORY);
            self.counters.received += 1;
            self.counters.lost += u64::from(ahead - 1);
            return if ahead == 1 { SequenceEvent::Next } else { SequenceEvent::Gap(ahead - 1) };
        }
        let behind = ahead.unsigned_abs();
        if behind >= HISTORY {
            self.counters.restarts += 1;
            self.begin(sequence);
            return SequenceEvent::Restart;
        }
        let bit = 1_u64 << behind;
        if self.seen & bit != 0 {
            self.counters.duplicate += 1;
            return SequenceEvent::Duplicate;
        }
        self.seen |= bit;
        self.counters.received += 1;
        self.counters.late += 1;
        // One from before the first was never counted as lost.
        if behind < self.span {
            self.counters.lost = self.counters.lost.saturating_sub(1);
        }
        SequenceEvent::Late
    }

    /// The sender is known to have started anew (another boot id in its hello), and this frame is
    /// its first here. To be called instead of [`Self::observe`].
    pub fn restart_at(&mut self, sequence: u16) -> SequenceEvent {
        self.counters.restarts += 1;
        self.begin(sequence);
        SequenceEvent::Restart
    }

    fn begin(&mut self, sequence: u16) {
        self.newest = Some(sequence);
        self.seen = 1;
        self.span = 1;
        self.counters.received += 1;
    }

    /// What was seen until now.
    #[must_use]
    pub fn counters(&self) -> SequenceCounters {
        self.counters
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;
    use std::vec::Vec;

    fn events(numbers: &[u16]) -> (Vec<SequenceEvent>, SequenceCounters) {
        let mut tracker = SequenceTracker::new();
        let events = numbers.iter().map(|&n| tracker.observe(n)).collect();
        (events, tracker.counters())
    }

    #[test]
    fn each_case_over_the_wrap() {
        use SequenceEvent::{Duplicate, First, Gap, Late, Next};
        let (list, counters) = events(&[65_533, 65_534, 1, 65_535, 65_535, 2, 0, 1]);
        assert_eq!(list, [First, Next, Gap(2), Late, Duplicate, Next, Late, Duplicate]);
        assert_eq!(counters, SequenceCounters { received: 6, lost: 0, duplicate: 2, late: 2, restarts: 0 });
    }

    #[test]
    fn limits_of_what_numbers_can_tell() {
        assert_eq!(events(&[0, 32_767]).0[1], SequenceEvent::Gap(32_766));
        assert_eq!(events(&[0, 32_768]).0[1], SequenceEvent::Restart);
        assert_eq!(events(&[0, 32_768]).1, SequenceCounters { received: 2, restarts: 1, ..Default::default() });
        assert_eq!(events(&[100, 36]).0[1], SequenceEvent::Restart);
        assert_eq!(events(&[100, 37]).0[1], SequenceEvent::Late);
        assert_eq!(events(&[100, 37]).1.lost, 0);
        // A late frame from before the first was never counted as lost.
        for early in [8, 9] {
            let want = SequenceCounters { received: 3, lost: 2, late: 1, ..Default::default() };
            assert_eq!(events(&[10, 13, early]).1, want, "{early}");
        }
    }

    #[test]
    fn a_known_restart_is_no_duplicate() {
        let mut tracker = SequenceTracker::new();
        for n in 0..5 {
            tracker.observe(n);
        }
        tracker.restart_at(0);
        assert_eq!(tracker.observe(1), SequenceEvent::Next);
        let want = SequenceCounters { received: 7, lost: 0, duplicate: 0, late: 0, restarts: 1 };
        assert_eq!(tracker.counters(), want);
    }

    proptest! {
        /// Frames with losses, repeats and short delays against a set that remembers everything.
        #[test]
        fn counts_agree_with_a_full_memory(
            start in any::<u16>(), faults in proptest::collection::vec((0u8..12, 1u8..30), 1..400),
        ) {
            let mut sent = Vec::new();
            let mut number = u64::from(start);
            for (fault, extent) in faults {
                match fault {
                    0 => number += u64::from(extent), // lost
                    1 => sent.push(number.saturating_sub(1)), // repeated
                    2 => {
                        // two swapped
                        sent.push(number + 1);
                        sent.push(number);
                        number += 2;
                    }
                    _ => {
                        sent.push(number);
                        number += 1;
                    }
                }
            }
            prop_assume!(!sent.is_empty());
            let first = sent[0];
            sent.retain(|&n| n >= first);
            let mut tracker = SequenceTracker::new();
            for &n in &sent {
                tracker.observe(n as u16);
            }
            let distinct: BTreeSet<u64> = sent.iter().copied().collect();
            let newest = distinct.last().copied().unwrap();
            let got = tracker.counters();
            prop_assert_eq!(got.received, distinct.len() as u64);
            prop_assert_eq!(got.duplicate, (sent.len() - distinct.len()) as u64);
            prop_assert_eq!(got.lost, newest - first + 1 - distinct.len() as u64);
            prop_assert_eq!(got.restarts, 0);
        }

        #[test]
        fn any_numbers_are_accounted_for(numbers in proptest::collection::vec(any::<u16>(), 0..2_000)) {
            let (_, counters) = events(&numbers);
            prop_assert_eq!(counters.received + counters.duplicate, numbers.len() as u64);
        }
    }
}
