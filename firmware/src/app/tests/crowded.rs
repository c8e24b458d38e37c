//! More than the link or the queues take, and what is no frame.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::*;

#[test]
fn a_stalled_link_loses_blocks_and_tells_how_many_samples() {
    let mut rig: Rig<4> = Rig::new();
    rig.run(30);
    for _ in 0..100 {
        rig.sample(0);
    }
    assert_eq!(rig.app.status().dropped_samples, 70);
    rig.transmit();
    rig.run(20);
    let mut ticks = TickTracker::new();
    let mut gaps = Vec::new();
    for message in rig.messages() {
        if let DeviceMessage::Samples(block) = message
            && let TickEvent::Gap(missing) = ticks.block(block.first_tick, sample_count(block)).event
        {
            gaps.push(missing);
        }
    }
    // What the host finds missing is what the device says it dropped.
    assert_eq!(gaps, [70]);
    let got = rig.samples();
    assert!(got.iter().all(|sample| rig.truth.contains(sample)));
}

#[test]
fn a_flood_of_commands_is_answered_in_full_and_starves_nothing() {
    let mut rig: Rig<BLOCKS, EVENTS, 4> = Rig::new();
    for _ in 0..6 {
        rig.command(Command::KeepAlive);
    }
    rig.run(1);
    // Three fit into the queue; the rest is refused at once, and every one is answered.
    let mut acks = rig.acks();
    acks.sort_by_key(|ack| ack.0);
    let refused = acks.iter().filter(|ack| ack.1 == CommandResult::WrongState).count();
    assert_eq!((acks.len(), refused), (7, 4));
    assert_eq!(rig.app.status().rejected_commands, 4);

    // With blocks waiting, at most one other frame goes before each.
    for _ in 0..10 {
        for _ in 0..3 {
            rig.command(Command::KeepAlive);
        }
        rig.sample(0);
    }
    let before = rig.host.received.len();
    rig.transmit();
    let first_block = rig.messages().skip(before).position(|message| matches!(message, DeviceMessage::Samples(_)));
    assert!(first_block <= Some(1), "{first_block:?}");
}

#[test]
fn answers_that_find_no_room_are_told_in_the_status() {
    let mut rig: Rig<BLOCKS, 2> = Rig::new();
    for _ in 0..3 {
        rig.command(Command::KeepAlive);
    }
    rig.sample(0);
    assert_eq!(rig.app.status().dropped_frames, 2);
}

#[test]
fn noise_on_the_link_moves_nothing() {
    let mut rig = rig();
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut noise = [0; 64];
    for _ in 0..5_000 {
        random.fill_bytes(&mut noise);
        rig.app.receive(&noise);
        rig.sample(0);
        rig.transmit();
    }
    assert_eq!(rig.acks(), []);
    assert!(rig.app.status().bad_frames > 1_000);
    assert_eq!(rig.app.output_mut(), &Recorder { writes: std::vec![0], ..Recorder::default() });
    assert_eq!(rig.samples(), rig.truth);
}
