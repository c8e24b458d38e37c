//! What a board has sent, decoded and counted.

use whirl_shared::block::sample_count;
use whirl_shared::codec::Decoder;
use whirl_shared::frame::{Ack, BackFilled, DeviceMessage, Estimate, Excited, Hello, Log, Rows, SampleBlock, Status};
use whirl_shared::sequence::{SequenceCounters, SequenceTracker};
use whirl_shared::tick::{TickCounters, TickTracker};

/// The account of a board's bytes. Samples themselves are not kept.
#[derive(Clone, Debug, Default)]
pub struct Sent {
    /// Good frames.
    pub frames: u64,
    /// Bad ones.
    pub bad: u64,
    /// Samples by their ticks.
    pub samples: TickCounters,
    /// Frames by their numbers.
    pub sequence: SequenceCounters,
    /// Firmware and build of the last hello.
    pub firmware: String,
    /// Every hello.
    pub hellos: Vec<Hello>,
    /// Every status.
    pub statuses: Vec<Status>,
    /// Every answer.
    pub acks: Vec<Ack>,
    /// Every line.
    pub logs: Vec<Log>,
    /// Every estimate of the device.
    pub estimates: Vec<Estimate>,
    /// All regression rows.
    pub rows: Vec<Rows>,
    /// Blocks that were sent again.
    pub restored: Vec<SampleBlock>,
    /// The ends of answers to questions for blocks.
    pub back_filled: Vec<BackFilled>,
    /// What the shaker did.
    pub excited: Vec<Excited>,
}

impl Sent {
    /// Decodes all of it.
    pub fn of(bytes: &[u8]) -> Self {
        let mut decoder = Decoder::<DeviceMessage>::new();
        let mut ticks = TickTracker::new();
        let mut sequence = SequenceTracker::new();
        let mut sent = Self::default();
        for result in bytes.iter().filter_map(|&byte| decoder.push(byte)) {
            let Ok(envelope) = result else {
                sent.bad += 1;
                continue;
            };
            sent.frames += 1;
            sequence.observe(envelope.sequence);
            match envelope.message {
                DeviceMessage::Hello(hello) => {
                    ticks.hello(hello.boot_id, hello.tick);
                    sent.firmware = hello.firmware.as_str().to_owned();
                    sent.hellos.push(hello);
                }
                DeviceMessage::Samples(block) => {
                    ticks.block(block.first_tick, sample_count(&block));
                }
                DeviceMessage::Status(status) => sent.statuses.push(status),
                DeviceMessage::Ack(ack) => sent.acks.push(ack),
                DeviceMessage::Log(log) => sent.logs.push(log),
                DeviceMessage::Estimate(estimate) => sent.estimates.push(estimate),
                DeviceMessage::Rows(rows) => sent.rows.push(rows),
                DeviceMessage::Restored(block) => sent.restored.push(block),
                DeviceMessage::BackFilled(end) => sent.back_filled.push(end),
                DeviceMessage::Excited(excited) => sent.excited.push(excited),
            }
        }
        sent.samples = ticks.counters();
        sent.sequence = sequence.counters();
        sent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulated::{Script, on_this_machine};
    use crate::virtual_rig::RigSettings;

    #[test]
    fn every_sample_of_a_good_line_is_there_and_a_cut_is_counted() {
        let mut frames = on_this_machine(&RigSettings::default(), &Script::new(), 2_000).unwrap();
        let whole = Sent::of(&frames);
        assert_eq!((whole.samples.received, whole.samples.missing, whole.bad), (2_000, 0, 0));
        assert_eq!((whole.statuses.len(), whole.sequence.lost), (4, 0));
        frames.drain(3_000..4_000);
        let cut = Sent::of(&frames);
        assert!(cut.samples.missing > 50 && cut.sequence.lost > 5, "{cut:?}");
    }
}
