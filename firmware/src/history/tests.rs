use super::*;
use std::vec::Vec;
use whirl_shared::frame::MOST_CHANNELS;

fn block(first_tick: u32, samples: usize) -> SampleBlock {
    SampleBlock {
        first_tick,
        first: heapless::Vec::from_slice(&[5, 9]).unwrap(),
        deltas: core::iter::repeat_n(1, 2 * (samples - 1)).collect(),
        ..SampleBlock::EMPTY
    }
}

/// A ring of two channels in which so many full blocks were put, from a tick on.
fn ring(room: usize, blocks: u32, from: u32) -> History<Vec<u8>> {
    let mut history = History::new(std::vec![0; room * block_bytes(2)], 2);
    for n in 0..blocks {
        history.push(&block(from.wrapping_add(10 * n), 10));
    }
    history
}

/// The next part of the answer.
fn part(history: &mut History<Vec<u8>>) -> Option<Again> {
    history.again().or_else(|| history.again())
}

/// First ticks of the answer, and its end.
fn answer(history: &mut History<Vec<u8>>) -> (Vec<u32>, BackFilled) {
    let mut ticks = Vec::new();
    loop {
        match part(history).expect("an end") {
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
        let tick = 1_000 + 10 * n;
        assert_eq!(history.push(&block(tick, 10)), 0);
        if n % 3 == 2 {
            let taken: Vec<_> = core::iter::from_fn(|| history.stream()).collect();
            assert_eq!(taken, [tick - 20, tick - 10, tick].map(|t| block(t, 10)));
        }
    }
    assert_eq!(history.oldest(), Some(1_000 + 920));
}

/// Blocks of every length, with every number of channels up to that of the places: the newest
/// are there as they were, and nothing else.
#[test]
fn the_ring_holds_the_newest_blocks() {
    for channels in 1..=MOST_CHANNELS {
        // A few bytes are over.
        let bytes = 7 * block_bytes(channels) + channels;
        let (mut history, mut all, mut seed) = (History::new(std::vec![0; bytes], channels), Vec::new(), 1_u32);
        for n in 0..400_u32 {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let (channels, more) = (1 + seed as usize / 7 % channels, seed as usize / 97 % 10);
            let new = SampleBlock {
                first_tick: (10 * n).wrapping_sub(1_800),
                phase: seed,
                phase_increment: seed ^ 0x55,
                amplitude_nanometre: !seed,
                first: (0..channels).map(|k| (seed >> k) as i32).collect(),
                deltas: (0..channels * more).map(|k| (seed >> (k % 24)) as i16).collect(),
            };
            history.push(&new);
            all.push(new);
            let kept = &all[all.len().saturating_sub(7)..];
            assert_eq!(history.oldest(), Some(kept[0].first_tick));
            history.ask(kept[0].first_tick, 10_000);
            for block in kept {
                assert!(matches!(part(&mut history), Some(Again::Block(got)) if got == *block));
            }
            assert!(matches!(part(&mut history), Some(Again::Done(_))));
            assert_eq!(history.stream().as_ref(), all.last());
        }
        // A block of more channels finds no place, and what is there stays.
        if channels < MOST_CHANNELS {
            let wide = SampleBlock {
                first: core::iter::repeat_n(1, channels + 1).collect(),
                deltas: core::iter::repeat_n(1, 9 * (channels + 1)).collect(),
                ..SampleBlock::EMPTY
            };
            assert_eq!((history.push(&wide), history.stream()), (10, None));
            assert_eq!(history.oldest(), Some(all[393].first_tick));
        }
    }
}

#[test]
fn a_stream_that_stands_passes_over_the_oldest_and_says_how_many_samples() {
    for (blocks, waiting) in [(200, BACKLOG as u32), (5, 5)] {
        let mut history = ring(blocks, 0, 0);
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
        let mut history = ring(200, 20, from);
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
    let mut history = ring(16, 2, 0);
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
    let mut history = ring(16, 16, 1_000);
    history.ask(1_000, 160);
    let mut got = Vec::new();
    let mut tick = 1_160;
    let samples = loop {
        match part(&mut history).unwrap() {
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
    assert!(matches!(part(&mut history), Some(Again::Block(_))));
    history.ask(tick - 10, 10);
    assert_eq!(answer(&mut history).0, [tick - 10]);
}
