//! Samples that the host asks for again.

use super::*;
use crate::history::block_bytes;
use crate::testing::{Counter, Host, Recorder};
use std::vec::Vec;
use whirl_shared::block::{Counts, Sample, samples};
use whirl_shared::codec::MAX_FRAME;
use whirl_shared::frame::*;

/// A device that keeps so many blocks, and the messages that come from it, each with the tick in
/// which it came.
struct Device {
    app: App<(Counter, Counter), Recorder, BLOCKS, EVENTS, REQUESTS, Vec<u8>>,
    host: Host,
    tick: u32,
    came: Vec<(u32, DeviceMessage)>,
    /// Bytes of each tick.
    bytes: Vec<usize>,
    truth: Vec<Sample>,
}

fn device(kept: usize) -> Device {
    let settings = Settings { boot_id: 77, ..Settings::default() };
    let memory = std::vec![0; kept * block_bytes(2)];
    let app = App::with_memory(&settings, (Counter(0), Counter(0)), Recorder::default(), memory).unwrap();
    Device { app, host: Host::new(), tick: 0, came: Vec::new(), bytes: Vec::new(), truth: Vec::new() }
}

impl Device {
    fn ask(&mut self, boot_id: u32, first_tick: u32, ticks: u32) {
        let frame = self.host.frame(Command::BackFill { boot_id, first_tick, ticks });
        self.app.receive(&frame);
    }

    /// Ticks in which the link takes what there is, or nothing.
    fn run(&mut self, ticks: u32, open: bool) {
        for _ in 0..ticks {
            let n = self.truth.len() as i32;
            // Fast enough for long frames: 4000 counts a tick.
            let counts = [n * 4_000, -n * n / 7];
            let (one, two) = self.app.inputs_mut();
            (one.0, two.0) = (counts[0] as u16, counts[1] as u16);
            self.app.tick(0, 0);
            self.truth.push(Sample { tick: self.tick, phase: self.app.drive().phase, counts: Counts::of(&counts) });
            let mut out = [0; MAX_FRAME];
            let mut bytes = 0;
            if open {
                while let Some(length) = self.app.poll_transmit(&mut out) {
                    let before = self.host.received.len();
                    self.host.take(&out[..length]);
                    self.came.extend(self.host.received[before..].iter().map(|e| (self.tick, e.message.clone())));
                    bytes += length;
                }
            } else {
                while self.app.keep_up() {}
            }
            self.bytes.push(bytes);
            self.tick += 1;
        }
    }

    fn restored(&self) -> Vec<Sample> {
        let block =
            |m: &(u32, DeviceMessage)| if let DeviceMessage::Restored(b) = &m.1 { Some(b.clone()) } else { None };
        self.came.iter().filter_map(block).flat_map(|block| samples(&block).collect::<Vec<_>>()).collect()
    }

    fn streamed(&self) -> Vec<(u32, SampleBlock)> {
        let block = |m: &(u32, DeviceMessage)| {
            if let DeviceMessage::Samples(b) = &m.1 { Some((m.0, b.clone())) } else { None }
        };
        self.came.iter().filter_map(block).collect()
    }

    fn ends(&self) -> Vec<BackFilled> {
        let end = |m: &(u32, DeviceMessage)| if let DeviceMessage::BackFilled(end) = m.1 { Some(end) } else { None };
        self.came.iter().filter_map(end).collect()
    }
}

#[test]
fn what_was_streamed_is_sent_again_exactly_and_the_stream_goes_first() {
    let (mut device, mut quiet) = (device(1_024), self::device(1_024));
    for device in [&mut device, &mut quiet] {
        device.run(6_000, true);
    }
    device.ask(77, 1_000, 5_000);
    for device in [&mut device, &mut quiet] {
        device.run(6_000, true);
    }
    assert_eq!(device.restored(), device.truth[1_000..6_000]);
    assert_eq!(device.ends(), [BackFilled { first_tick: 1_000, ticks: 5_000, samples: 5_000 }]);
    // Every block of the stream came in the tick in which it would have come, and none that was
    // sent again with it.
    assert_eq!(device.streamed(), quiet.streamed());
    let of = |tick| device.came.iter().filter(move |(at, _)| *at == tick);
    for (tick, _) in device.streamed() {
        assert!(of(tick).all(|(_, message)| !matches!(message, DeviceMessage::Restored(_))), "tick {tick}");
    }
    // It was acknowledged, and took some ten seconds: a block each 17 ticks or fewer.
    let took = device.came.iter().rev().find(|(_, m)| matches!(m, DeviceMessage::BackFilled(_))).unwrap().0 - 6_000;
    assert!(took < 500 * 17, "{took}");
}

#[test]
fn the_line_is_at_most_seventy_percent_full_in_any_second() {
    let mut device = device(1_024);
    device.run(10_000, true);
    device.ask(77, 0, 10_000);
    device.run(2_000, true);
    assert!(device.ends().is_empty() && device.restored().len() > 500);
    // Not from the first hello on, which no second is to hold twice.
    for second in device.bytes[500..].windows(500) {
        let bytes: usize = second.iter().sum();
        assert!(bytes * 10 * 100 <= 115_200 * 70, "{bytes}");
    }
    let last: usize = device.bytes[11_000..].iter().sum();
    assert!(last * 10 * 100 > 2 * 115_200 * 65, "{last} bytes in two seconds: the line has room left");
}

#[test]
fn ticks_of_another_boot_are_refused() {
    let mut device = device(64);
    device.run(500, true);
    device.ask(76, 0, 500);
    device.run(500, true);
    assert!(device.restored().is_empty() && device.ends().is_empty());
    let result = |m: &(u32, DeviceMessage)| if let DeviceMessage::Ack(ack) = m.1 { Some(ack.result) } else { None };
    assert_eq!(device.came.iter().filter_map(result).collect::<Vec<_>>(), [CommandResult::WrongState]);
}

#[test]
fn a_link_that_took_nothing_for_ten_seconds_has_all_of_it_afterwards() {
    let mut device = device(1_024);
    device.run(1_000, true);
    device.run(5_000, false);
    let status = device.app.status();
    // All but what waits for the link.
    assert_eq!((status.dropped_samples, status.kept_from), (5_000 - 630, 0));
    device.run(100, true);
    let first = device.streamed().iter().map(|(_, block)| block.first_tick).find(|tick| *tick >= 1_000).unwrap();
    assert_eq!(first, 6_000 - 630);
    device.ask(77, 1_000, first - 1_000);
    device.run(8_000, true);
    assert_eq!(device.restored(), device.truth[1_000..first as usize]);
}

#[test]
fn what_is_older_than_the_memory_is_told_to_be_gone() {
    let mut device = device(50);
    device.run(2_005, true);
    assert_eq!(device.app.status().kept_from, 1_500);
    device.ask(77, 1_000, 1_000);
    device.run(2_000, true);
    let restored = device.restored();
    let end = device.ends()[0];
    // Blocks that were overwritten before their turn came are not in the answer either.
    assert_eq!(end.samples as usize, restored.len());
    assert!(restored[0].tick >= 1_500 && restored[restored.len() - 1].tick == 1_999 && restored.len() >= 400);
    assert!(restored.iter().all(|sample| device.truth.contains(sample)));
}

#[test]
fn a_device_without_memory_is_none() {
    let settings = Settings::default();
    let inputs = (Counter(0), Counter(0));
    let none =
        App::<_, _, BLOCKS, EVENTS, REQUESTS, [u8; 61]>::with_memory(&settings, inputs, Recorder::default(), [0; 61]);
    assert_eq!(none.unwrap_err().field, "memory (bytes)");
}
