//! Blocks that the emulated board sends again.

use std::collections::BTreeMap;

use whirl_firmware::history::{KEPT, block_bytes};
use whirl_firmware::lock_step::Order;
use whirl_hil_sim::RigSettings;
use whirl_hil_sim::emulated::{Script, board_settings, on_this_machine};
use whirl_shared::block::{Counts, samples};
use whirl_shared::codec::Decoder;
use whirl_shared::frame::{BackFilled, Command, CommandResult, DeviceMessage, SampleBlock};

use crate::image;

/// Counts by ticks.
fn by_tick<'a>(blocks: impl IntoIterator<Item = &'a SampleBlock>) -> BTreeMap<u32, Counts> {
    blocks.into_iter().flat_map(samples).map(|sample| (sample.tick, sample.counts)).collect()
}

fn streamed(frames: &[u8]) -> Vec<SampleBlock> {
    let mut decoder = Decoder::<DeviceMessage>::new();
    let messages = frames.iter().filter_map(|&byte| decoder.push(byte)?.ok());
    let block = |message| if let DeviceMessage::Samples(block) = message { Some(block) } else { None };
    messages.filter_map(|envelope| block(envelope.message)).collect()
}

fn ask(boot_id: u32, first_tick: u32, ticks: u32) -> Command {
    Command::BackFill { boot_id, first_tick, ticks }
}

#[test]
fn ten_seconds_are_sent_again_as_they_were_streamed_and_as_on_this_machine() {
    let ticks = 14_000;
    let script = Script::new().drive(0, ticks, 5_000, 15_525, 5_000).command(6_003, ask(1, 1_000, 5_000));
    let Some((emulation, sent)) = image::emulate(&script, ticks) else { return };
    assert_eq!(sent.back_filled, [BackFilled { first_tick: 1_000, ticks: 5_000, samples: 5_000 }]);
    let (streamed, restored) = (by_tick(&streamed(&emulation.frames)), by_tick(&sent.restored));
    assert!((1_000..6_000).all(|tick| restored.get(&tick).is_some_and(|counts| streamed.get(&tick) == Some(counts))));
    // The stream has lost nothing by it.
    assert_eq!((sent.samples.missing, sent.statuses.last().unwrap().dropped_samples), (0, 0));
    let rig = RigSettings { device: board_settings(&sent.firmware), ..RigSettings::default() };
    assert_eq!(rig.kept_bytes, KEPT);
    assert!(on_this_machine(&rig, &script, ticks).unwrap() == emulation.frames);
}

#[test]
fn what_a_link_did_not_take_for_ten_seconds_is_there_afterwards() {
    let script = Script::new().order(600, Order::BlockLink(5_000)).command(6_000, ask(1, 0, 6_000));
    let Some((emulation, sent)) = image::emulate(&script, 16_000) else { return };
    // The estimate goes on, too: it has every sample.
    let dropped = sent.statuses.last().unwrap().dropped_samples;
    assert!((4_360..=4_380).contains(&dropped) && sent.samples.missing == u64::from(dropped), "{dropped}");
    let mut all = streamed(&emulation.frames);
    all.extend(sent.restored);
    let all = by_tick(&all);
    assert!((0..15_990).all(|tick| all.contains_key(&tick)));
    assert_eq!(sent.back_filled.len(), 1);
}

#[test]
fn what_is_older_than_the_memory_or_of_another_boot_is_not_there() {
    let script = Script::new().command(12_000, ask(2, 0, 500)).command(12_100, ask(1, 0, 2_000));
    let Some((_, sent)) = image::emulate(&script, 13_000) else { return };
    assert_eq!(
        sent.acks.iter().map(|ack| ack.result).collect::<Vec<_>>(),
        [CommandResult::WrongState, CommandResult::Done]
    );
    let kept_from = sent.statuses.last().unwrap().kept_from;
    let status_tick = sent.statuses.last().unwrap().tick;
    // Blocks of ten, the last of which is not full yet.
    let kept = 10 * (KEPT / block_bytes(2)) as u32;
    assert!((kept..kept + 20).contains(&(status_tick - kept_from)), "{status_tick} {kept_from}");
    let end = sent.back_filled[0];
    assert_eq!((sent.back_filled.len(), end.first_tick, end.ticks), (1, 0, 2_000));
    let first = sent.restored[0].first_tick;
    assert!((12_100 - kept..2_000).contains(&first) && end.samples <= 2_000 - first, "{first} {end:?}");
}
