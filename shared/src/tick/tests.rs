//! Places on the line of ticks, against a set that remembers every tick.

use super::*;
use proptest::prelude::*;
use std::collections::BTreeSet;
use std::vec::Vec;

#[test]
fn runs_over_the_wrap_of_the_device_tick() {
    let mut tracker = TickTracker::new();
    assert_eq!(tracker.block(u32::MAX - 4, 10), Placed { event: TickEvent::First, start: Some(0xffff_fffb) });
    assert_eq!(tracker.block(5, 10), Placed { event: TickEvent::Contiguous, start: Some(0x1_0000_0005) });
    assert_eq!(tracker.block(25, 10), Placed { event: TickEvent::Gap(10), start: Some(0x1_0000_0019) });
    assert_eq!(tracker.block(15, 10), Placed { event: TickEvent::Late, start: Some(0x1_0000_000f) });
    assert_eq!(tracker.block(15, 10), Placed { event: TickEvent::Duplicate, start: Some(0x1_0000_000f) });
    assert_eq!(tracker.block(u32::MAX - 4, 10).event, TickEvent::Duplicate);
    assert_eq!(tracker.block(30, 10), Placed { event: TickEvent::Overlap(5), start: Some(0x1_0000_001e) });
    let want = TickCounters { received: 45, missing: 0, duplicate: 25, late: 10, restarts: 0, unplaced: 0 };
    assert_eq!(tracker.counters(), want);
    assert_eq!(tracker.expected(), Some(0x1_0000_0028));
}

#[test]
fn a_tick_of_this_boot_has_its_place_and_the_other_way_round() {
    let mut tracker = TickTracker::new();
    assert_eq!((tracker.place(0), tracker.device_tick(0)), (None, None));
    tracker.hello(1, 0);
    tracker.block(u32::MAX - 4, 10);
    tracker.block(25, 10);
    for (tick, place) in [(u32::MAX - 4, 0xffff_fffb), (3, 0x1_0000_0003), (40, 0x1_0000_0028)] {
        assert_eq!((tracker.place(tick), tracker.device_tick(place)), (Some(place), Some(tick)));
    }
    // Before the first block; then no tick has a place until the other boot's first block has come.
    assert_eq!(tracker.place(u32::MAX - 5), None);
    tracker.hello(2, 0);
    assert_eq!((tracker.place(3), tracker.device_tick(0x1_0000_0003)), (None, None));
    tracker.block(7, 10);
    assert_eq!((tracker.place(6), tracker.place(9)), (None, Some(0x1_0000_002c)));
    assert_eq!(tracker.device_tick(0x1_0000_002c), Some(9));
}

#[test]
fn several_wraps() {
    let mut tracker = TickTracker::new();
    let step = 1_u32 << 30;
    for i in 0..20_u32 {
        let placed = tracker.block(step.wrapping_mul(i), 10);
        assert_eq!(placed.start, Some(u64::from(i) << 30));
    }
}

#[test]
fn a_restart_goes_on_behind_the_last_tick() {
    let mut tracker = TickTracker::new();
    assert!(!tracker.hello(7, 0));
    tracker.block(100, 10);
    assert!(!tracker.hello(7, 110));
    assert!(tracker.hello(8, 0));
    assert_eq!(tracker.block(30, 10), Placed { event: TickEvent::Restart(30), start: Some(140) });
    assert_eq!(tracker.block(40, 10), Placed { event: TickEvent::Contiguous, start: Some(150) });
    // What the old boot's ticks would be is behind this one's first.
    assert_eq!(tracker.block(20, 10).event, TickEvent::Unplaced);
    assert_eq!(tracker.counters().restarts, 1);
    assert_eq!(tracker.counters().missing, 30);
}

#[test]
fn a_restart_without_its_hello_is_not_placed_until_a_hello_comes() {
    let mut tracker = TickTracker::new();
    tracker.hello(1, 0);
    tracker.block(5_000_000, 10);
    assert_eq!(tracker.block(10, 10), Placed { event: TickEvent::Unplaced, start: None });
    assert!(tracker.hello(2, 30));
    assert_eq!(tracker.block(20, 10).event, TickEvent::Restart(20));
    assert_eq!(tracker.counters().unplaced, 10);
}

#[test]
fn blocks_before_the_first_hello() {
    let mut tracker = TickTracker::new();
    tracker.block(50, 10);
    assert!(!tracker.hello(3, 75));
    let mut tracker = TickTracker::new();
    tracker.block(50, 10);
    assert!(tracker.hello(3, 0));
    // At the very tick that is due.
    let mut tracker = TickTracker::new();
    tracker.block(50, 10);
    assert!(!tracker.hello(3, 60));
}

#[test]
fn ticks_that_go_back_under_the_same_boot_id_are_a_restart() {
    let mut tracker = TickTracker::new();
    tracker.hello(1, 0);
    tracker.block(5_000, 10);
    // A hello that was overtaken on its way is none.
    assert!(!tracker.hello(1, 5_010 - HELLO_LATE));
    assert!(tracker.hello(1, 5_009 - HELLO_LATE) && tracker.is_restarting());
    // Asked for again before the first block: the same restart.
    assert!(!tracker.hello(1, 4_900 - HELLO_LATE));
    assert_eq!(tracker.block(20, 10), Placed { event: TickEvent::Restart(20), start: Some(5_030) });
    assert!(!tracker.hello(1, 30) && !tracker.is_restarting());
    assert_eq!(tracker.block(30, 10).event, TickEvent::Contiguous);
    assert_eq!(tracker.counters().restarts, 1);
    // Over the wrap of the device's tick nothing goes back.
    let mut tracker = TickTracker::new();
    tracker.hello(1, 0);
    tracker.block(u32::MAX - 9, 10);
    assert!(!tracker.hello(1, 5));
}

#[test]
fn the_newest_block_again_is_a_duplicate() {
    let mut tracker = TickTracker::new();
    tracker.block(0, 10);
    tracker.block(10, 10);
    assert_eq!(tracker.block(10, 10), Placed { event: TickEvent::Duplicate, start: Some(10) });
    assert_eq!((tracker.counters().received, tracker.counters().duplicate), (20, 10));
}

#[test]
fn a_gap_is_filled_from_its_middle_and_each_part_once() {
    let mut tracker = TickTracker::new();
    tracker.block(0, 10);
    tracker.block(60, 10);
    for (first, event) in [
        (30, TickEvent::Late),
        (10, TickEvent::Late),
        (50, TickEvent::Late),
        (30, TickEvent::Duplicate),
        (20, TickEvent::Late),
        (40, TickEvent::Late),
        (40, TickEvent::Duplicate),
    ] {
        assert_eq!(tracker.block(first, 10).event, event, "{first}");
    }
    let want = TickCounters { received: 70, duplicate: 20, late: 50, ..TickCounters::default() };
    assert_eq!(tracker.counters(), want);
}

#[test]
fn as_many_gaps_as_stated_are_remembered_and_nothing_else_takes_their_places() {
    let mut tracker = TickTracker::new();
    let gaps = GAPS as u32;
    tracker.block(0, 10);
    // One gap more than that: the oldest is forgotten.
    for k in 0..=gaps {
        tracker.block(40 + 40 * k, 10);
    }
    let end = 50 + 40 * gaps;
    for first in (end..end + 400).step_by(10) {
        tracker.block(first, 10);
    }
    assert_eq!(tracker.block(10, 10).event, TickEvent::Duplicate);
    for k in 1..=gaps {
        for first in [30 + 40 * k, 20 + 40 * k, 10 + 40 * k] {
            assert_eq!(tracker.block(first, 10).event, TickEvent::Late, "{first}");
        }
    }
    assert_eq!(tracker.counters().missing, 30);
}

#[test]
fn distances_that_are_ambiguous() {
    let after = |ahead: u32| {
        let mut tracker = TickTracker::new();
        tracker.block(0, 10);
        tracker.block(10_u32.wrapping_add(ahead), 10).event
    };
    assert_eq!(after((1 << 31) - 1), TickEvent::Gap((1 << 31) - 1));
    assert_eq!(after(1 << 31), TickEvent::Unplaced);
}

proptest! {
    /// Blocks lost, repeated and swapped, against a set that remembers every tick.
    #[test]
    fn counts_agree_with_a_full_memory(
        start in any::<u32>(), faults in proptest::collection::vec((0u8..12, 1u32..11), 1..300),
    ) {
        let mut sent: Vec<(u64, u32)> = Vec::new();
        let mut tick = u64::from(start);
        for (fault, len) in faults {
            match fault {
                0 => {}
                1 => {
                    let before = sent.last().copied();
                    sent.extend(before);
                    sent.push((tick, len));
                }
                2 => {
                    sent.push((tick + u64::from(len), len));
                    sent.push((tick, len));
                    tick += u64::from(len);
                }
                _ => sent.push((tick, len)),
            }
            tick += u64::from(len);
        }
        let first = sent.first().map_or(0, |block| block.0);
        sent.retain(|block| block.0 >= first);
        let mut tracker = TickTracker::new();
        let (mut ticks, mut total) = (BTreeSet::new(), 0);
        for &(start, len) in &sent {
            let placed = tracker.block(start as u32, len);
            prop_assert_eq!(placed.start, Some(start));
            ticks.extend(start..start + u64::from(len));
            total += u64::from(len);
        }
        let counters = tracker.counters();
        let span = ticks.last().map_or(0, |last| last + 1 - first);
        prop_assert_eq!(counters.received, ticks.len() as u64);
        prop_assert_eq!(counters.duplicate, total - ticks.len() as u64);
        prop_assert_eq!(counters.missing, span - ticks.len() as u64);
    }

    #[test]
    fn anything_is_accounted_for(
        blocks in proptest::collection::vec((any::<u32>(), 1u32..11, any::<Option<u8>>()), 0..1_000),
    ) {
        let mut tracker = TickTracker::new();
        let mut total = 0;
        for (tick, len, boot) in blocks {
            if let Some(boot) = boot {
                tracker.hello(u32::from(boot) % 3, tick);
            }
            tracker.block(tick, len);
            total += u64::from(len);
        }
        let counters = tracker.counters();
        prop_assert_eq!(counters.received + counters.duplicate + counters.unplaced, total);
    }
}
