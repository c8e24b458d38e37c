//! Where an encoder's zero is from, whether its arm rests, and what its index mark says.
//!
//! The counters know nothing of where an arm hangs: zero is the pose at power-up, or that of a
//! command. Whether counts of two boots have the same zero is told by the zero's id. Over a reset
//! that leaves the memory alone ([`keeps_memory`]) the count is carried ([`crate::kept`]): of an
//! arm that rests nothing is lost, of one that turns what it turned meanwhile, so that its zero has
//! another id.
//!
//! An index mark is seen once a turn. It is taken where the arm turns up, since a mark is some
//! counts wide and its two edges lie at different ones. Its count is told to the host; if it is
//! found elsewhere later, counts have been lost or won (noise on a line, a hand that turned too
//! fast), which is told once.

use whirl_shared::frame::{ResetCause, Zero, ZeroSource};

/// Counts by which an index may be found beside its first place: half a line, since the mark's edge
/// and those of the lines pass filters of their own.
const INDEX_TOLERANCE: u32 = 2;

/// Whether memory and the encoders' supply have lasted over a reset. Not over the reset pin: a
/// button may be held while arms turn, and so may a debugger.
#[must_use]
pub const fn keeps_memory(cause: ResetCause) -> bool {
    matches!(cause, ResetCause::Software | ResetCause::Watchdog | ResetCause::Panic)
}

/// An encoder as it is carried over a reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct KeptEncoder {
    /// Multi-turn count at the last tick.
    pub count: i32,
    /// Its zero.
    pub zero: Zero,
    /// Whether the arm had rested.
    pub at_rest: bool,
}

impl KeptEncoder {
    /// The zero after a reset.
    #[must_use]
    pub fn zero_at_boot(kept: Option<Self>, boot_id: u32) -> Zero {
        match kept {
            None => Zero { id: boot_id, source: ZeroSource::PowerUp, index: None },
            Some(kept) if kept.at_rest => kept.zero,
            Some(_) => Zero { id: boot_id, source: ZeroSource::Carried, index: None },
        }
    }
}

/// What is known of one encoder's place.
#[derive(Clone, Debug)]
pub struct Reference {
    zero: Zero,
    counts_per_turn: u32,
    count: i32,
    anchor: i32,
    resting_ticks: u32,
    /// Ticks within one count of each other that are rest: a second, longer than any swing's
    /// turning point.
    rest_ticks: u32,
    slip_told: bool,
}

/// What an index mark says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Index {
    /// Seen for the first time.
    First,
    /// Not where it was.
    Slipped,
    /// Nothing new.
    Same,
}

impl Reference {
    /// After a boot.
    #[must_use]
    pub fn new(kept: Option<KeptEncoder>, boot_id: u32, counts_per_turn: u32, ticks_per_second: u32) -> Self {
        let count = kept.map_or(0, |kept| kept.count);
        Self {
            zero: KeptEncoder::zero_at_boot(kept, boot_id),
            counts_per_turn: counts_per_turn.max(1),
            count,
            anchor: count,
            resting_ticks: 0,
            rest_ticks: ticks_per_second.max(1),
            slip_told: false,
        }
    }

    /// Takes a tick's count.
    pub fn observe(&mut self, count: i32) {
        self.count = count;
        if count.wrapping_sub(self.anchor).unsigned_abs() > 1 {
            self.anchor = count;
            self.resting_ticks = 0;
        } else {
            self.resting_ticks = self.resting_ticks.saturating_add(1);
        }
    }

    /// The index mark has been passed upward at a multi-turn count.
    pub fn index(&mut self, count: i32) -> Index {
        let turn = i64::from(self.counts_per_turn);
        // 0 to 2²⁰: a turn.
        let place = i64::from(count).rem_euclid(turn) as u32;
        let Some(first) = self.zero.index else {
            self.zero.index = Some(place);
            return Index::First;
        };
        let apart = place.abs_diff(first);
        let apart = apart.min(self.counts_per_turn.saturating_sub(apart));
        if apart <= INDEX_TOLERANCE || core::mem::replace(&mut self.slip_told, true) {
            return Index::Same;
        }
        Index::Slipped
    }

    /// The present place is zero from now on.
    pub fn set_zero(&mut self, id: u32) {
        self.zero = Zero { id, source: ZeroSource::Commanded, index: None };
        self.count = 0;
        self.anchor = 0;
        self.slip_told = false;
    }

    /// The zero.
    #[must_use]
    pub const fn zero(&self) -> Zero {
        self.zero
    }

    /// What is to be carried over a reset.
    #[must_use]
    pub const fn kept(&self) -> KeptEncoder {
        KeptEncoder { count: self.count, zero: self.zero, at_rest: self.resting_ticks >= self.rest_ticks }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference() -> Reference {
        Reference::new(None, 7, 4_096, 500)
    }

    #[test]
    fn an_arm_that_rests_keeps_its_zero_and_one_that_turns_does_not() {
        let mut resting = reference();
        let mut turning = reference();
        for tick in 0..600 {
            // Trembling about an edge is rest.
            resting.observe(1_000 + tick % 2);
            turning.observe(10 * tick);
        }
        let kept = resting.kept();
        assert_eq!((kept.count, kept.at_rest), (1_001, true));
        assert_eq!(KeptEncoder::zero_at_boot(Some(kept), 8), Zero { id: 7, source: ZeroSource::PowerUp, index: None });
        let kept = turning.kept();
        assert!(!kept.at_rest);
        let zero = KeptEncoder::zero_at_boot(Some(kept), 8);
        assert_eq!((zero.id, zero.source), (8, ZeroSource::Carried));
        assert_eq!(KeptEncoder::zero_at_boot(None, 9).id, 9);
    }

    #[test]
    fn a_turning_point_is_not_rest() {
        let mut reference = reference();
        for tick in 0..2_000_i32 {
            // Three counts there and back each second.
            reference.observe(if (tick / 250) % 2 == 0 { 0 } else { 3 });
            assert!(!reference.kept().at_rest, "{tick}");
        }
    }

    #[test]
    fn the_index_is_told_once_and_so_is_its_slip() {
        let mut reference = reference();
        assert_eq!(reference.index(-5), Index::First);
        assert_eq!(reference.zero().index, Some(4_091));
        for count in [-5 + 4_096, -5 - 3 * 4_096, -4, -7] {
            assert_eq!(reference.index(count), Index::Same, "{count}");
        }
        assert_eq!(reference.index(-2), Index::Slipped);
        assert_eq!(reference.index(40), Index::Same);
        // A mark at the seam of a turn.
        reference.set_zero(3);
        assert_eq!(reference.zero(), Zero { id: 3, source: ZeroSource::Commanded, index: None });
        assert_eq!(
            (reference.index(0), reference.index(-1), reference.index(-9)),
            (Index::First, Index::Same, Index::Slipped)
        );
    }

    #[test]
    fn only_resets_that_leave_power_and_memory_alone_keep_it() {
        for (cause, keeps) in [
            (ResetCause::Unknown, false),
            (ResetCause::Power, false),
            (ResetCause::Pin, false),
            (ResetCause::Software, true),
            (ResetCause::Watchdog, true),
            (ResetCause::Panic, true),
        ] {
            assert_eq!(keeps_memory(cause), keeps, "{cause:?}");
        }
    }
}
