//! Outgoing messages → frames with consecutive numbers.

use whirl_shared::block::sample_count;
use whirl_shared::codec::{MAX_FRAME, encode};
use whirl_shared::frame::{DeviceMessage, Envelope};

/// The sending end of the link.
#[derive(Debug, Default)]
pub(crate) struct Stream {
    sequence: u16,
    samples_sent: u32,
}

impl Stream {
    pub const fn new() -> Self {
        Self { sequence: 0, samples_sent: 0 }
    }

    /// Whether any frame fits into a buffer.
    pub fn fits(out: &[u8]) -> bool {
        out.len() >= MAX_FRAME
    }

    /// Encodes a message. Its number is used up, and its samples count as sent, only if that works.
    pub fn encode(&mut self, message: &DeviceMessage, out: &mut [u8]) -> Option<usize> {
        let samples = if let DeviceMessage::Samples(block) = message { sample_count(block) } else { 0 };
        let length = encode(&Envelope { sequence: self.sequence, message }, out).ok()?;
        self.sequence = self.sequence.wrapping_add(1);
        self.samples_sent = self.samples_sent.wrapping_add(samples);
        Some(length)
    }

    /// Samples encoded since boot, wrapping.
    pub fn samples_sent(&self) -> u32 {
        self.samples_sent
    }
}
