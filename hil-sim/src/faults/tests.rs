use whirl_shared::block::samples;
use whirl_shared::codec::{MAX_FRAME, encode};
use whirl_shared::frame::{Envelope, SampleBlock};

use super::*;

/// A stream of sample blocks of ten samples.
fn stream(blocks: u32) -> Vec<u8> {
    let mut out = Vec::new();
    let mut buffer = [0; MAX_FRAME];
    for i in 0..blocks {
        let block = SampleBlock {
            first_tick: 10 * i,
            phase: i.wrapping_mul(12_345_678),
            phase_increment: 42_949_673,
            amplitude_nanometre: 15_525_000,
            first: [i as i32 * 3, -7 * i as i32].into(),
            deltas: (0..9).flat_map(|k| [k, -2 * k]).collect(),
        };
        let envelope = Envelope { sequence: i as u16, message: DeviceMessage::Samples(block) };
        let length = encode(&envelope, &mut buffer).unwrap();
        out.extend_from_slice(&buffer[..length]);
    }
    out
}

/// Ticks that a receiver gets, with repeats, and the frames that it refuses.
fn received(bytes: &[u8]) -> (Vec<u32>, u64) {
    let mut decoder: Decoder<DeviceMessage> = Decoder::new();
    let mut ticks = Vec::new();
    for &byte in bytes {
        if let Some(Ok(envelope)) = decoder.push(byte)
            && let DeviceMessage::Samples(block) = envelope.message
        {
            ticks.extend(samples(&block).map(|sample| sample.tick));
        }
    }
    (ticks, decoder.counters().bad_frames())
}

fn run(settings: FaultSettings, seed: u64, blocks: u32) -> (Vec<u8>, FaultReport) {
    let mut link = FaultyLink::new(settings, seed);
    let mut out = Vec::new();
    // In pieces that split frames anywhere.
    for piece in stream(blocks).chunks(61) {
        out.extend(link.push(piece));
    }
    out.extend(link.finish());
    (out, link.report().clone())
}

/// The report must agree with what a decoder gets, sample by sample.
fn check(settings: FaultSettings, seed: u64, blocks: u32) -> FaultReport {
    let (out, report) = run(settings, seed, blocks);
    let (ticks, bad) = received(&out);
    let mut distinct = ticks.clone();
    distinct.sort_unstable();
    distinct.dedup();
    let total = u64::from(blocks) * 10;
    assert_eq!(report.samples.total(), total, "{report:?}");
    assert_eq!(report.samples.survived, distinct.len() as u64, "{settings:?}");
    assert_eq!(report.samples.repeated, (ticks.len() - distinct.len()) as u64, "{settings:?}");
    assert_eq!(report.frames.total(), u64::from(blocks));
    assert_eq!(report.bytes[1], out.len() as u64);
    let mut missing: Vec<u32> =
        report.lost.iter().flat_map(|lost| lost.first_tick..lost.first_tick + lost.count).collect();
    missing.extend(&distinct);
    missing.sort_unstable();
    assert!(missing.iter().copied().eq(0..blocks * 10), "lost and received ticks must make up all");
    if report.samples.damaged > 0 {
        assert!(bad > 0);
    }
    report
}

#[test]
fn a_link_without_faults_changes_nothing() {
    let (out, report) = run(FaultSettings::default(), 1, 500);
    assert_eq!(out, stream(500));
    assert_eq!((report.samples.survived, report.frames.survived, report.samples.repeated), (5_000, 500, 0));
}

#[test]
fn every_kind_of_fault_is_accounted_for_sample_by_sample() {
    let none = FaultSettings::default();
    let alone = [
        FaultSettings { drop_frame: 0.05, ..none },
        FaultSettings { duplicate_frame: 0.05, ..none },
        FaultSettings { truncate_frame: 0.05, ..none },
        FaultSettings { reorder_frames: 0.05, ..none },
        FaultSettings { reorder_bytes: 0.05, ..none },
        FaultSettings { drop_byte: 1e-3, ..none },
        FaultSettings { flip_byte: 1e-3, ..none },
        FaultSettings { duplicate_byte: 1e-3, ..none },
        FaultSettings { unplug: 0.01, unplug_frames: 20, ..none },
    ];
    for (i, settings) in alone.into_iter().enumerate() {
        let report = check(settings, 7, 2_000);
        let drawn: Vec<u64> = [report.drawn_frames.as_slice(), &report.drawn_bytes, &[report.unplugged]].concat();
        for (k, &count) in drawn.iter().enumerate() {
            assert_eq!(count > 0, i == k, "fault {i}: {drawn:?}");
        }
        let harmless = i == 1 || i == 3;
        assert_eq!(report.samples.damaged + report.samples.vanished == 0, harmless, "fault {i}: {report:?}");
        assert_eq!(report.samples.repeated > 0, i == 1, "fault {i}");
    }
}

#[test]
fn all_faults_together_over_many_seeds() {
    let heavy = FaultSettings {
        drop_frame: 0.03,
        duplicate_frame: 0.03,
        truncate_frame: 0.03,
        reorder_frames: 0.03,
        reorder_bytes: 0.03,
        drop_byte: 1e-3,
        flip_byte: 1e-3,
        duplicate_byte: 1e-3,
        unplug: 0.003,
        unplug_frames: 10,
    };
    for seed in 0..20 {
        check(heavy, seed, 500);
        check(FaultSettings::EVERYTHING, seed, 500);
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_one_others() {
    let run = |seed| run(FaultSettings::EVERYTHING, seed, 2_000).0;
    assert_eq!(run(3), run(3));
    assert_ne!(run(3), run(4));
}

#[test]
fn an_unplugged_link_is_silent() {
    let mut link = FaultyLink::new(FaultSettings::default(), 1);
    let mut out = link.push(&stream(15));
    link.unplug();
    assert!(link.push(&stream(30)).is_empty());
    link.replug();
    out.extend(link.push(&stream(3)));
    out.extend(link.finish());
    let report = link.report();
    assert_eq!(report.unplugged, 1);
    assert_eq!((report.samples.survived, report.samples.vanished), (180, 300), "{report:?}");
    assert_eq!(received(&out).0.len() as u64, report.samples.survived);
}

#[test]
fn noise_without_zeros_needs_no_memory() {
    let mut link = FaultyLink::new(FaultSettings { flip_byte: 0.0, ..FaultSettings::EVERYTHING }, 1);
    for _ in 0..50 {
        link.push(&[0x55; 10_000]);
        let held = link.input.len() + link.segment.len() + link.pending.len() * MAX_CHUNK;
        assert!(held < 8 * MAX_CHUNK, "{held}");
    }
    link.finish();
    assert_eq!(link.report().samples.total(), 0);
}

#[test]
fn a_receiver_that_opens_its_end_anew_ends_a_frame_there() {
    // The plug is pulled somewhere in a frame and put in again somewhere in a later one; the
    // receiver opens its end anew in between.
    let settings = FaultSettings { unplug: 0.05, unplug_frames: 3, ..FaultSettings::default() };
    let mut survived = [0; 2];
    for seed in 0..400 {
        for told in [false, true] {
            let mut link = FaultyLink::new(settings, seed);
            let (mut out, mut silent) = (Vec::new(), 0);
            for frame in stream(60).split_inclusive(|byte| *byte == 0) {
                let came = link.push(frame);
                silent = if came.is_empty() { silent + 1 } else { 0 };
                out.extend(came);
                if silent == 1 {
                    out.push(0);
                    if told {
                        link.reopened();
                    }
                }
            }
            out.extend(link.finish());
            let report = link.report();
            survived[usize::from(told)] += report.samples.survived;
            if told {
                let (ticks, _) = received(&out);
                let lost = report.lost.iter().flat_map(|l| l.first_tick..l.first_tick + l.count);
                assert!(lost.eq((0..600).filter(|tick| !ticks.contains(tick))), "seed {seed}");
                assert_eq!(report.samples.survived, ticks.len() as u64, "seed {seed}");
            }
        }
    }
    // Frames that lacked their zero alone, and whole ones behind a cut one.
    assert!(survived[1] > survived[0] + 100, "{survived:?}");
}

#[test]
fn what_is_sent_again_makes_good_what_was_lost() {
    let frame = |sequence: u16, message: fn(SampleBlock) -> DeviceMessage, first_tick: u32| {
        let deltas = (1..10).flat_map(|k| [k, k]).collect();
        let block = SampleBlock { first_tick, first: [0, 0].into(), deltas, ..SampleBlock::EMPTY };
        let mut buffer = [0; MAX_FRAME];
        let length = encode(&Envelope { sequence, message: message(block) }, &mut buffer).unwrap();
        buffer[..length].to_vec()
    };
    let mut link = FaultyLink::new(FaultSettings::default(), 1);
    link.push(&frame(0, DeviceMessage::Samples, 0));
    link.unplug();
    for (n, first) in [10, 20, 30].into_iter().enumerate() {
        link.push(&frame(n as u16 + 1, DeviceMessage::Samples, first));
    }
    // One that is sent again while the plug is still out is lost again.
    link.push(&frame(4, DeviceMessage::Restored, 30));
    link.replug();
    for (n, first) in [20, 15].into_iter().enumerate() {
        link.push(&frame(n as u16 + 5, DeviceMessage::Restored, first));
    }
    link.finish();
    let report = link.report();
    assert_eq!((report.samples.survived, report.samples.vanished), (10, 30));
    assert_eq!(report.restored, [(20, 10), (15, 10)]);
    assert_eq!(report.missing(), [10, 11, 12, 13, 14, 30, 31, 32, 33, 34, 35, 36, 37, 38, 39]);
}
