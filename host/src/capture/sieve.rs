//! Frames of the wire, and which of them are recorded.
//!
//! A device or a line may send without end what says nothing. The journal grows by what can matter
//! to the record only:
//! - a frame is at most as long as the decoder must see to refuse it; of zeros in a row, none but
//!   the one that ends a frame;
//! - of frames refused in a row, the first [`MOST_REFUSED`]: more than any gap's account of damaged
//!   samples uses (see [`super::accounting`]), which then counts what is missing as lost;
//! - answers to commands never, lines for people up to [`MOST_LINES`];
//! - while no new sample comes, [`STALLED_BYTES`].
//!
//! What is left out of the journal is not recorded either, so that the record stays a function of
//! the journal.

use whirl_shared::block::sample_count;
use whirl_shared::codec::{Decoder, FrameError, MAX_FRAME};
use whirl_shared::frame::{DeviceMessage, Envelope};

/// Frames refused in a row that are recorded: at ten samples each, 80 s of damage at 500 Hz.
const MOST_REFUSED: u32 = 4096;
/// Lines for people that are recorded.
pub(super) const MOST_LINES: u32 = 1000;
/// Bytes recorded since the last new sample: 90 s of a serial line at 115 200 baud.
const STALLED_BYTES: usize = 1 << 20;

/// A frame with its zero.
pub(super) struct Frame {
    pub(super) bytes: Vec<u8>,
    pub(super) message: Result<Envelope<DeviceMessage>, FrameError>,
    /// It brings samples (or rows) that lie behind all before.
    pub(super) new: bool,
    /// It belongs into the journal.
    pub(super) recorded: bool,
}

/// Cuts bytes into frames.
#[derive(Default)]
pub(super) struct Sieve {
    decoder: Decoder<DeviceMessage>,
    bytes: Vec<u8>,
    refused: u32,
    lines: u32,
    /// Device's tick behind the newest sample, or of the newest row.
    newest: Option<u32>,
    boot: Option<u32>,
    /// Bytes recorded since the last new sample.
    stalled: usize,
}

impl Sieve {
    /// Takes a byte; the one that ends a frame gives it.
    pub(super) fn push(&mut self, byte: u8) -> Option<Frame> {
        // MAX_FRAME bytes without a zero are one too many for any frame: the decoder refuses what
        // has them.
        if byte == 0 || self.bytes.len() < MAX_FRAME {
            self.bytes.push(byte);
        }
        let message = match self.decoder.push(byte) {
            Some(message) => message,
            None => {
                if byte == 0 {
                    self.bytes.clear();
                }
                return None;
            }
        };
        let bytes = core::mem::take(&mut self.bytes);
        let new = message.as_ref().is_ok_and(|envelope| self.is_new(&envelope.message));
        let recorded = self.matters(&message, new, bytes.len());
        if recorded {
            self.stalled = if new { 0 } else { self.stalled + bytes.len() };
        }
        Some(Frame { bytes, message, new, recorded })
    }

    /// Whether a message moves the device's clock on.
    fn is_new(&mut self, message: &DeviceMessage) -> bool {
        let tick = match message {
            DeviceMessage::Hello(hello) => {
                if self.boot.replace(hello.boot_id).is_some_and(|before| before != hello.boot_id) {
                    self.newest = None;
                }
                return false;
            }
            DeviceMessage::Samples(block) => block.first_tick.wrapping_add(sample_count(block)),
            DeviceMessage::Rows(rows) => rows.tick,
            _ => return false,
        };
        // In wrapping arithmetic: ahead of what there was.
        let new = self.newest.is_none_or(|newest| tick.wrapping_sub(newest).cast_signed() > 0);
        if new {
            self.newest = Some(tick);
        }
        new
    }

    fn matters(&mut self, message: &Result<Envelope<DeviceMessage>, FrameError>, new: bool, length: usize) -> bool {
        let Ok(envelope) = message else {
            self.refused = self.refused.saturating_add(1);
            return self.refused <= MOST_REFUSED && self.stalled + length <= STALLED_BYTES;
        };
        self.refused = 0;
        match &envelope.message {
            DeviceMessage::Ack(_) => false,
            DeviceMessage::Log(_) => {
                self.lines = self.lines.saturating_add(1);
                // One more, which tells that there were more.
                self.lines <= MOST_LINES + 1
            }
            // It may tell of a restart.
            DeviceMessage::Hello(_) => self.stalled + length <= 2 * STALLED_BYTES,
            _ => new || self.stalled + length <= STALLED_BYTES,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whirl_shared::codec::encode;
    use whirl_shared::frame::{Ack, CommandResult, Hello, Log, SampleBlock, Status};

    fn frame(message: DeviceMessage) -> Vec<u8> {
        let mut bytes = [0; MAX_FRAME];
        let n = encode(&Envelope { sequence: 0, message }, &mut bytes).unwrap();
        bytes[..n].to_vec()
    }

    fn block(first_tick: u32) -> Vec<u8> {
        let (phase, phase_increment, amplitude_nanometre) = (0, 0, 0);
        let deltas = heapless::Vec::from_slice(&[1; 18]).unwrap();
        frame(DeviceMessage::Samples(SampleBlock {
            first_tick,
            phase,
            phase_increment,
            amplitude_nanometre,
            first: [0; 2].into(),
            deltas,
        }))
    }

    /// What of these bytes is recorded.
    fn recorded(sieve: &mut Sieve, bytes: &[u8]) -> Vec<u8> {
        let frames = bytes.iter().filter_map(|b| sieve.push(*b));
        frames.filter(|f| f.recorded).flat_map(|f| f.bytes).collect()
    }

    /// Frames and refused frames that a decoder finds.
    fn found(bytes: &[u8]) -> (u64, u64) {
        let mut decoder = Decoder::<DeviceMessage>::new();
        bytes.iter().for_each(|b| drop(decoder.push(*b)));
        (decoder.counters().frames, decoder.counters().bad_frames())
    }

    #[test]
    fn what_is_left_out_changes_nothing_that_a_decoder_finds() {
        let ack = Ack { command_sequence: 1, result: CommandResult::Done };
        let overlong = [vec![9; 100_000], vec![0]].concat();
        let parts =
            [block(0), vec![0; 5000], overlong, block(10), vec![7, 0], frame(DeviceMessage::Ack(ack)), block(20)];
        let bytes = parts.concat();
        let kept = recorded(&mut Sieve::default(), &bytes);
        // All but the answer to a command.
        assert_eq!((found(&bytes), found(&kept)), ((4, 2), (3, 2)));
        assert!(kept.len() < 3 * block(0).len() + MAX_FRAME + 10, "{}", kept.len());
    }

    #[test]
    fn what_says_nothing_new_is_bounded_and_new_samples_are_not() {
        let mut sieve = Sieve::default();
        let refused: usize = (0..100_000).map(|_| recorded(&mut sieve, &[7, 7, 7, 0]).len()).sum();
        assert_eq!(refused, 4 * MOST_REFUSED as usize);
        let line = frame(DeviceMessage::Log(Log { tick: 0, level: 0, text: "again".try_into().unwrap() }));
        let lines: usize = (0..5000).map(|_| recorded(&mut sieve, &line).len()).sum();
        assert_eq!(lines, line.len() * (MOST_LINES as usize + 1));
        let mut sieve = Sieve::default();
        assert_eq!(recorded(&mut sieve, &block(500)), block(500));
        for bytes in [block(500), block(100), frame(DeviceMessage::Status(Status::default()))] {
            let mut sieve = Sieve::default();
            assert_eq!(recorded(&mut sieve, &block(500)), block(500));
            let repeated: usize = (0..100_000).map(|_| recorded(&mut sieve, &bytes).len()).sum();
            assert!(repeated <= STALLED_BYTES && repeated > STALLED_BYTES - MAX_FRAME, "{repeated}");
            // What is new is recorded all the same, over the wrap of the ticks too, and opens the
            // way for the rest.
            assert_eq!(recorded(&mut sieve, &block(510)), block(510));
            assert_eq!(recorded(&mut sieve, &bytes), bytes);
        }
        assert!(!sieve.push(0).is_some_and(|f| f.recorded));
    }

    #[test]
    fn a_hello_is_recorded_for_twice_as_long_as_the_rest_and_damage_as_long_as_it() {
        let (status, damaged) = (frame(DeviceMessage::Status(Status::default())), [7, 7, 7, 0]);
        let hello = frame(DeviceMessage::Hello(Hello::default()));
        let mut sieve = Sieve::default();
        let mut total = 0;
        while total < STALLED_BYTES / 2 {
            total += recorded(&mut sieve, &status).len();
        }
        assert_eq!(recorded(&mut sieve, &damaged), damaged);
        while !recorded(&mut sieve, &status).is_empty() {}
        while !recorded(&mut sieve, &damaged).is_empty() {}
        // It may tell of a restart.
        let more: usize = (0..40_000).map(|_| recorded(&mut sieve, &hello).len()).sum();
        assert!(more.abs_diff(STALLED_BYTES) <= 2 * MAX_FRAME, "{more}");
    }
}
