//! Tests of the account: every sample is in one class, and the classes are right.

use heapless::Vec as Fixed;
use rand::{Rng, SeedableRng};

use super::*;

fn block(first_tick: u32, n: usize) -> SampleBlock {
    let mut deltas = Fixed::<i16, _, u8>::new();
    for i in 1..n {
        deltas.extend([i as i16, -1]);
    }
    SampleBlock {
        first_tick,
        phase: first_tick.wrapping_mul(7),
        phase_increment: 7,
        amplitude_nanometre: 5,
        first: [first_tick as i32, 100].into(),
        deltas,
    }
}

/// From a device that keeps nothing of these ticks.
fn status(overruns: u32, dropped_samples: u32) -> Status {
    Status { overruns, dropped_samples, ..Status::default() }
}

fn ticks(out: &[Taken]) -> Vec<i64> {
    out.iter().map(|s| s.tick).collect()
}

#[test]
fn samples_are_rebuilt_from_differences() {
    let (mut a, mut out) = (Accounting::default(), vec![]);
    a.block(&block(40, 4), &mut out);
    a.finish(&mut out);
    assert_eq!(out.iter().map(|s| s.counts).collect::<Vec<_>>(), [[40, 100], [41, 99], [43, 98], [46, 97]]);
    assert_eq!(out.iter().map(|s| s.phase).collect::<Vec<_>>(), [280, 287, 294, 301]);
    assert_eq!(a.losses(), Losses { received: 4, ..Losses::default() });
}

#[test]
fn late_and_repeated_blocks_take_their_place_once() {
    let (mut a, mut out) = (Accounting::default(), vec![]);
    for k in [0u32, 1, 3, 2, 2, 4, 3, 5] {
        a.block(&block(k * 10, 10), &mut out);
    }
    a.finish(&mut out);
    assert_eq!(ticks(&out), (0..60).collect::<Vec<_>>());
    let l = a.losses();
    assert_eq!((l.received, l.late, l.duplicates, l.lost(), l.gaps), (60, 10, 20, 0, 0));
}

#[test]
fn causes_are_told_apart_and_add_up() {
    let (mut a, mut out) = (Accounting::default(), vec![]);
    a.status(&status(1000, 500));
    a.block(&block(0, 10), &mut out);
    // 10 samples damaged: one refused frame.
    a.bad_frame();
    a.block(&block(20, 10), &mut out);
    // 30 dropped by the device, 3 overruns, 20 lost without a trace.
    a.status(&status(1003, 530));
    a.block(&block(60, 10), &mut out);
    a.block(&block(73, 10), &mut out);
    a.block(&block(103, 10), &mut out);
    a.finish(&mut out);
    let l = a.losses();
    let missing = 103 + 10 - 50;
    assert_eq!((l.received, l.lost(), l.gaps), (50, missing, 4));
    assert_eq!((l.overruns, l.dropped_by_device, l.damaged, l.lost_on_link), (3, 30, 10, 20));
}

#[test]
fn a_restart_begins_a_new_stretch() {
    let (mut a, mut out) = (Accounting::default(), vec![]);
    a.hello(1, 0);
    a.status(&status(7, 0));
    a.block(&block(500, 10), &mut out);
    a.hello(2, 0);
    // Counters of the new boot: 2 overruns since its start.
    a.status(&status(2, 0));
    a.block(&block(0, 10), &mut out);
    a.block(&block(12, 10), &mut out);
    a.finish(&mut out);
    let l = a.losses();
    assert_eq!((l.restarts, l.received, l.overruns, l.lost()), (1, 30, 2, 3));
    assert_eq!(ticks(&out)[9..11], [509, 511]);
    assert_eq!(ticks(&out).last(), Some(&532));
    // The new boot is told once, and before its first sample.
    assert_eq!([a.begun(), a.begun()], [Some(511), None]);
    assert_eq!([510, 511, 512].map(|tick| a.boot_before(tick)), [None, Some(511), None]);
}

#[test]
fn a_hello_that_is_no_restart_leaves_the_account_alone() {
    let (mut a, mut out) = (Accounting::default(), vec![]);
    // Before the first sample a restart is none of the record's.
    a.hello(1, 0);
    a.hello(2, 0);
    a.status(&status(7, 0));
    a.block(&block(0, 10), &mut out);
    a.hello(2, 10);
    a.status(&status(9, 0));
    a.block(&block(15, 10), &mut out);
    a.finish(&mut out);
    let l = a.losses();
    assert_eq!((l.restarts, l.overruns, l.lost_on_link, l.received), (0, 2, 3, 20));
    assert_eq!((a.begun(), a.boot_before(15)), (None, None));
}

#[test]
fn ticks_that_go_back_without_a_hello_are_counted_and_one_is_asked_for() {
    let (mut a, mut out) = (Accounting::default(), vec![]);
    for k in 0..100 {
        assert_eq!(a.block(&block(k * 10, 10), &mut out), Verdict::Fine);
    }
    // What a link may deliver late is not asked about.
    assert_eq!(a.block(&block(680, 10), &mut out), Verdict::Fine);
    assert_eq!(a.block(&block(670, 10), &mut out), Verdict::AskHello);
    assert_eq!(a.block(&block(660, 10), &mut out), Verdict::AskHello);
    for k in 69..110 {
        a.block(&block(k * 10, 10), &mut out);
    }
    assert_eq!(a.again(), Again { samples: 20, behind: 1000 });
    // Those from 680 on, once more than the record has them.
    assert_eq!(a.losses().duplicates, 30 + 310);
    a.finish(&mut out);
    assert_eq!(ticks(&out), (0..1100).collect::<Vec<_>>());
}

#[test]
fn any_mess_adds_up() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    for round in 0..300u32 {
        let (mut a, mut out) = (Accounting::default(), vec![]);
        // Near the wrap of the device's ticks.
        let base = u32::MAX - round * 5;
        let mut blocks: Vec<u32> = (0..200).map(|k| base.wrapping_add(k * 10)).collect();
        for _ in 0..40 {
            let i = rng.next_u32() as usize % (blocks.len() - 3);
            match rng.next_u32() % 3 {
                0 => drop(blocks.remove(i)),
                1 => blocks.swap(i, i + 1 + rng.next_u32() as usize % 2),
                _ => blocks.insert(i + 2, blocks[i]),
            }
        }
        let (mut overruns, mut dropped) = (0, 0);
        a.status(&status(0, 0));
        for &first in &blocks {
            match rng.next_u32() % 20 {
                0 => a.bad_frame(),
                1 => {
                    overruns += rng.next_u32() % 4;
                    dropped += rng.next_u32() % 30;
                    a.status(&status(overruns, dropped));
                }
                _ => {}
            }
            a.block(&block(first, 10), &mut out);
        }
        a.finish(&mut out);
        let l = a.losses();
        let t = ticks(&out);
        assert!(t.windows(2).all(|w| w[0] < w[1]));
        assert_eq!(l.received, t.len() as u64);
        let span = t[t.len() - 1].abs_diff(t[0]) + 1;
        assert_eq!(l.received + l.lost(), span, "{l:?}");
    }
}

#[test]
fn a_gap_across_the_end_is_not_of_the_record() {
    let (mut a, mut out) = (Accounting::new(Some(25), 0), vec![]);
    for first in [100, 110, 150] {
        a.block(&block(first, 10), &mut out);
    }
    a.finish(&mut out);
    assert_eq!((out.len(), a.losses().lost(), a.losses().gaps), (20, 0, 0));
    let (mut a, mut out) = (Accounting::new(Some(25), 0), vec![]);
    for first in [100, 120, 150] {
        a.block(&block(first, 10), &mut out);
    }
    a.finish(&mut out);
    assert_eq!((ticks(&out).last(), a.losses().received, a.losses().lost()), (Some(&124), 15, 10));
}

#[test]
fn what_comes_behind_its_time_or_from_nowhere_is_counted_and_not_kept() {
    let (mut a, mut out) = (Accounting::default(), vec![]);
    // 48 blocks come when 60 later ones have passed them.
    for k in (0..10).chain(58..118).chain(10..58) {
        a.block(&block(k * 10, 10), &mut out);
    }
    // A device that has restarted and has not said so: 2000 ticks and more behind nothing of this
    // boot.
    assert_eq!(a.block(&block(u32::MAX - 5000, 10), &mut out), Verdict::AskHello);
    a.finish(&mut out);
    let l = a.losses();
    assert_eq!((l.received, l.lost(), l.gaps), (700, 480, 1));
    assert_eq!((l.late, l.dropped_late, l.duplicates), (0, 490, 0));
    assert_eq!(l.received + l.lost(), 1180);
}

#[test]
fn a_block_that_begins_before_its_time_gives_its_rest() {
    let (mut a, mut out) = (Accounting::default(), vec![]);
    a.block(&block(0, 10), &mut out);
    a.block(&block(6, 10), &mut out);
    a.finish(&mut out);
    assert_eq!(ticks(&out), (0..16).collect::<Vec<_>>());
    // Of the second block the samples from its fifth on, with their own counts and phases.
    let (mut b, mut whole) = (Accounting::default(), vec![]);
    b.block(&block(6, 10), &mut whole);
    b.finish(&mut whole);
    assert_eq!(out[10..], whole[4..]);
    let l = a.losses();
    assert_eq!((l.received, l.duplicates, l.lost(), l.gaps), (16, 4, 0, 0));
}

#[test]
fn a_late_block_takes_its_place_as_long_as_none_behind_it_has_left() {
    let blocks = |behind: u32| {
        let (mut a, mut out) = (Accounting::default(), vec![]);
        for k in (0..1).chain(2..2 + behind).chain(1..2) {
            a.block(&block(k * 10, 10), &mut out);
        }
        a.finish(&mut out);
        (a.losses().late, a.losses().dropped_late, a.losses().lost())
    };
    assert_eq!(blocks(WINDOW as u32), (10, 0, 0));
    assert_eq!(blocks(WINDOW as u32 + 1), (0, 10, 10));
}

#[test]
fn what_lies_before_the_first_block_is_not_of_the_record() {
    let (mut a, mut out) = (Accounting::default(), vec![]);
    a.block(&block(1000, 10), &mut out);
    for first in [990, 370] {
        assert_eq!(a.block(&block(first, 10), &mut out), Verdict::AskHello);
        assert_eq!(a.losses().dropped_late, 0, "{first}");
    }
    // More than twice as far before it as a block is waited for.
    assert_eq!(a.block(&block(369, 10), &mut out), Verdict::AskHello);
    assert_eq!(a.losses().dropped_late, 10);
    a.finish(&mut out);
    // Once samples have left, none is early.
    a.block(&block(980, 10), &mut out);
    let l = a.losses();
    assert_eq!((ticks(&out), l.received, l.dropped_late), ((1000..1010).collect(), 10, 20));
}

#[test]
fn damage_accounts_for_no_more_than_its_frames_held() {
    let (mut a, mut out) = (Accounting::default(), vec![]);
    a.block(&block(0, 10), &mut out);
    a.bad_frame();
    a.bad_frame();
    a.block(&block(50, 10), &mut out);
    // Noise between two blocks that follow each other has damaged no sample.
    a.bad_frame();
    a.block(&block(60, 10), &mut out);
    a.finish(&mut out);
    let l = a.losses();
    assert_eq!((l.bad_frames, l.damaged, l.lost_on_link, l.gaps), (3, 20, 20, 1));
}

/// An account in which a gap waits for 1000 samples, with the ticks from 0 on, and those from 600
/// to 650 and from 700 on.
fn waiting() -> (Accounting, Vec<Taken>) {
    let (mut a, mut out) = (Accounting::new(None, 1_000), vec![]);
    a.hello(1, 0);
    for first in (0..500).chain(600..650).chain(700..800).step_by(10) {
        a.block(&block(first, 10), &mut out);
    }
    (a, out)
}

fn answer(first_tick: u32, ticks: u32, samples: u32) -> BackFilled {
    BackFilled { first_tick, ticks, samples }
}

#[test]
fn what_is_sent_again_takes_its_place_and_the_next_gap_is_asked_for() {
    let (mut a, mut out) = waiting();
    assert_eq!((a.open(), a.device_tick(500)), (Some(500..600), Some(500)));
    // All before the gap may have left; nothing behind it has.
    assert_eq!(ticks(&out), (0..500).collect::<Vec<_>>()[..out.len()]);
    // In any order, twice, with more than what is missing.
    for first in [540, 500, 510, 520, 530, 540, 595, 560, 550, 570, 580, 585] {
        a.restored(&block(first, 10), &mut out);
    }
    assert_eq!(a.open(), Some(650..700));
    a.restored(&block(650, 10), &mut out);
    assert_eq!(a.open(), Some(660..700));
    for first in [660, 670, 680, 690] {
        a.restored(&block(first, 10), &mut out);
    }
    assert_eq!(a.open(), None);
    a.back_filled(&answer(650, 50, 50), &mut out);
    a.finish(&mut out);
    assert_eq!(ticks(&out), (0..800).collect::<Vec<_>>());
    let l = a.losses();
    assert_eq!((l.received, l.restored, l.lost(), l.gaps), (800, 150, 0, 0));
    assert_eq!((l.duplicates, l.late, l.dropped_late), (0, 0, 0));
}

#[test]
fn what_the_device_does_not_have_is_not_waited_for() {
    // It never had 40 of a hundred ticks: overruns.
    let (mut a, mut out) = waiting();
    for first in (500..560).step_by(10) {
        a.restored(&block(first, 10), &mut out);
    }
    a.back_filled(&answer(500, 100, 60), &mut out);
    assert_eq!(a.open(), Some(650..700));
    // It keeps nothing before tick 680 any more, and says so.
    a.status(&Status { kept_from: 680, ..Status::default() });
    assert_eq!(a.open(), Some(680..700));
    a.status(&Status { kept_from: 790, ..Status::default() });
    assert_eq!(a.open(), None);
    a.finish(&mut out);
    let l = a.losses();
    assert_eq!((l.received, l.restored, l.lost(), l.gaps), (710, 60, 90, 2));
    // What comes now has no place any more.
    a.restored(&block(650, 10), &mut out);
    assert_eq!((a.losses().received, ticks(&out).len()), (710, 710));
}

#[test]
fn an_answer_that_was_damaged_on_its_way_is_asked_for_again_but_not_for_ever() {
    let (mut a, mut out) = waiting();
    for first in [500, 510, 590] {
        a.restored(&block(first, 10), &mut out);
    }
    a.back_filled(&answer(500, 100, 100), &mut out);
    assert_eq!(a.open(), Some(520..590));
    for n in 1..FRUITLESS {
        assert_eq!(a.open(), Some(520..590), "{n}");
        a.back_filled(&answer(520, 70, 70), &mut out);
    }
    assert_eq!(a.open(), Some(650..700));
    a.finish(&mut out);
    assert_eq!((a.losses().lost(), a.losses().restored), (120, 30));
}

#[test]
fn a_device_that_never_answers_is_waited_for_as_long_as_was_said() {
    let (mut a, mut out) = waiting();
    let mut first = 800;
    while a.open().is_some() {
        a.block(&block(first, 10), &mut out);
        first += 10;
    }
    // 140 samples had come behind the first gap; both are given up.
    assert_eq!(first, 800 + 1_010 - 150);
    assert_eq!((a.losses().lost(), a.losses().gaps), (150, 2));
    // A restart gives up what is open, and samples of the boot before have no place any more.
    let (mut a, mut out) = waiting();
    a.hello(2, 0);
    assert_eq!((a.open(), a.device_tick(500)), (Some(500..600), None));
    a.block(&block(30, 10), &mut out);
    a.restored(&block(500, 10), &mut out);
    assert_eq!(a.open(), None);
    a.finish(&mut out);
    assert_eq!((a.losses().restored, a.losses().received, a.losses().lost()), (0, 660, 180));
}

#[test]
fn a_gap_across_the_end_is_filled_up_to_it() {
    let (mut a, mut out) = (Accounting::new(Some(45), 1_000), vec![]);
    a.hello(1, 100);
    for first in [100, 110, 180] {
        a.block(&block(first, 10), &mut out);
    }
    assert_eq!(a.open(), Some(120..145));
    for first in [120, 130, 140] {
        a.restored(&block(first, 10), &mut out);
    }
    assert_eq!(a.open(), None);
    a.finish(&mut out);
    assert_eq!(ticks(&out), (100..145).collect::<Vec<_>>());
    assert_eq!((a.losses().restored, a.losses().lost()), (25, 0));
}
