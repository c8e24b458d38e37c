//! A link that damages what it carries, and knows what it has done.
//!
//! Frames are what lies between zero bytes. For every frame the link draws, in this order: drop it
//! whole, duplicate it, truncate it (its zero too), swap two neighbouring frames, swap two of its
//! bytes; then for every byte: drop, flip one bit, duplicate. Unplugging swallows everything from
//! the middle of a frame to the middle of a later one. Draws come from one seeded ChaCha8, so that
//! a run repeats.
//!
//! The truth is not what was drawn but what came of it: a frame has *survived* if between two zeros
//! of the output there are exactly its bytes; otherwise it is *damaged* if any byte of it came out,
//! and *vanished* if none did. (A doubled zero harms nobody; a lost zero takes the next frame with
//! it. A receiver that opens its end anew ends a frame there, see [`FaultyLink::reopened`].) The
//! link decodes its clean input to know which samples each frame carried. Memory is bounded
//! whatever the input.

mod account;

use std::collections::VecDeque;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use whirl_shared::block::sample_count;
use whirl_shared::codec::Decoder;
use whirl_shared::frame::DeviceMessage;

pub use account::{Fate, Fates, FaultReport, FaultSettings, LostSamples, MAX_LOST};

/// Longest stretch of input without a zero that is taken as one frame.
const MAX_CHUNK: usize = 4096;

/// A frame that is on its way.
#[derive(Debug)]
struct Pending {
    id: u64,
    clean: Vec<u8>,
    /// First tick and number of its samples, and whether they are sent again.
    samples: Option<(u32, u32, bool)>,
    came_out: bool,
    copies: u64,
    /// Its bytes have all been sent.
    sent: bool,
}

/// The link.
#[derive(Debug)]
pub struct FaultyLink {
    settings: FaultSettings,
    random: ChaCha8Rng,
    decoder: Decoder<DeviceMessage>,
    /// Input since the last zero.
    input: Vec<u8>,
    next_id: u64,
    /// Frames whose fate is not known yet, in order.
    pending: VecDeque<Pending>,
    /// A frame that waits for the next one to pass it: its bytes as damaged.
    held: Option<(u64, Vec<u8>)>,
    /// Output since the last zero, and the frames that its bytes come from.
    segment: Vec<u8>,
    contributors: Vec<u64>,
    /// The output since the last zero is longer than any frame and no longer kept.
    spoiled: bool,
    unplugged_frames: u32,
    unplugged: bool,
    report: FaultReport,
}

impl FaultyLink {
    /// A link; the same seed and input give the same output.
    pub fn new(settings: FaultSettings, seed: u64) -> Self {
        Self {
            settings,
            random: ChaCha8Rng::seed_from_u64(seed),
            decoder: Decoder::new(),
            input: Vec::new(),
            next_id: 0,
            pending: VecDeque::new(),
            held: None,
            segment: Vec::new(),
            contributors: Vec::new(),
            spoiled: false,
            unplugged_frames: 0,
            unplugged: false,
            report: FaultReport::default(),
        }
    }

    /// True with a probability.
    fn chance(&mut self, probability: f64) -> bool {
        // 53 random bits; none are drawn for what never happens, so that a fault left out changes
        // no other.
        probability > 0.0 && ((self.random.next_u64() >> 11) as f64) < probability * 9_007_199_254_740_992.0
    }

    /// A number below `n` (0 for n = 0).
    fn below(&mut self, n: usize) -> usize {
        if n == 0 { 0 } else { (self.random.next_u64() % n as u64) as usize }
    }

    /// Carries bytes; what comes out now.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::with_capacity(bytes.len() + 16);
        self.report.bytes[0] += bytes.len() as u64;
        for &byte in bytes {
            self.input.push(byte);
            if byte == 0 || self.input.len() >= MAX_CHUNK {
                let frame = std::mem::take(&mut self.input);
                self.frame(frame, &mut out);
                self.settle();
            }
        }
        self.report.bytes[1] += out.len() as u64;
        out
    }

    /// Ends the input: what was held back comes out, and every fate is decided (bytes that no zero
    /// ended are damaged).
    pub fn finish(&mut self) -> Vec<u8> {
        let mut out = Vec::new();
        if !self.input.is_empty() {
            let rest = std::mem::take(&mut self.input);
            self.frame(rest, &mut out);
        }
        self.release(&mut out);
        self.segment.clear();
        self.contributors.clear();
        self.settle();
        self.report.bytes[1] += out.len() as u64;
        out
    }

    /// Pulls the plug until [`Self::replug`].
    pub fn unplug(&mut self) {
        if !self.unplugged {
            self.report.unplugged += 1;
        }
        self.unplugged = true;
    }

    /// Puts it in again.
    pub fn replug(&mut self) {
        self.unplugged = false;
        self.unplugged_frames = 0;
    }

    /// The receiver has opened its end anew, and begins a frame there as behind a zero: one that
    /// lacked its zero alone is whole, and one that comes whole now is not spoiled by the rest of
    /// an earlier one.
    pub fn reopened(&mut self) {
        if !self.segment.is_empty() || self.spoiled {
            self.segment.push(0);
            self.segment_ends(true);
            self.settle();
        }
    }

    /// What was done until now. Frames still on their way are not in it; [`Self::finish`] decides
    /// them.
    pub fn report(&self) -> &FaultReport {
        &self.report
    }

    fn frame(&mut self, clean: Vec<u8>, out: &mut Vec<u8>) {
        let id = self.next_id;
        self.next_id += 1;
        let mut samples = None;
        for &byte in &clean {
            let Some(Ok(envelope)) = self.decoder.push(byte) else { continue };
            match envelope.message {
                DeviceMessage::Samples(block) => samples = Some((block.first_tick, sample_count(&block), false)),
                DeviceMessage::Restored(block) => samples = Some((block.first_tick, sample_count(&block), true)),
                _ => {}
            }
        }
        let bytes = self.damaged(&clean);
        self.pending.push_back(Pending { id, clean, samples, came_out: false, copies: 0, sent: false });
        let Some(bytes) = bytes else {
            self.sent(id);
            return;
        };
        if self.held.is_none() && self.chance(self.settings.reorder_frames) {
            self.report.drawn_frames[3] += 1;
            self.held = Some((id, bytes));
            return;
        }
        self.emit(id, &bytes, out);
        self.sent(id);
        self.release(out);
    }

    /// Sends the frame that was held back.
    fn release(&mut self, out: &mut Vec<u8>) {
        if let Some((id, bytes)) = self.held.take() {
            self.emit(id, &bytes, out);
            self.sent(id);
        }
    }

    /// The bytes that are sent for a frame, `None` for none.
    fn damaged(&mut self, clean: &[u8]) -> Option<Vec<u8>> {
        let s = self.settings;
        if self.unplugged {
            return None;
        }
        if self.unplugged_frames > 0 {
            self.unplugged_frames -= 1;
            if self.unplugged_frames > 0 {
                return None;
            }
            // Plugged in again in the middle of this frame.
            let from = self.below(clean.len());
            return Some(clean[from..].to_vec());
        }
        if self.chance(s.unplug) {
            self.report.unplugged += 1;
            self.unplugged_frames = 1 + self.below(s.unplug_frames as usize) as u32;
            let to = self.below(clean.len());
            return (to > 0).then(|| clean[..to].to_vec());
        }
        if self.chance(s.drop_frame) {
            self.report.drawn_frames[0] += 1;
            return None;
        }
        let copies = if self.chance(s.duplicate_frame) {
            self.report.drawn_frames[1] += 1;
            2
        } else {
            1
        };
        let mut bytes = clean.repeat(copies);
        if self.chance(s.truncate_frame) {
            self.report.drawn_frames[2] += 1;
            let keep = self.below(bytes.len());
            bytes.truncate(keep);
        }
        if bytes.len() > 1 && self.chance(s.reorder_bytes) {
            self.report.drawn_frames[4] += 1;
            let at = self.below(bytes.len() - 1);
            bytes.swap(at, at + 1);
        }
        if s.drop_byte > 0.0 || s.flip_byte > 0.0 || s.duplicate_byte > 0.0 {
            let mut damaged = Vec::with_capacity(bytes.len() + 1);
            for byte in bytes {
                if self.chance(s.drop_byte) {
                    self.report.drawn_bytes[0] += 1;
                    continue;
                }
                let mut byte = byte;
                if self.chance(s.flip_byte) {
                    self.report.drawn_bytes[1] += 1;
                    byte ^= 1 << self.below(8);
                }
                damaged.push(byte);
                if self.chance(s.duplicate_byte) {
                    self.report.drawn_bytes[2] += 1;
                    damaged.push(byte);
                }
            }
            bytes = damaged;
        }
        (!bytes.is_empty()).then_some(bytes)
    }

    /// Puts bytes of a frame out and keeps account of what lies between zeros.
    fn emit(&mut self, id: u64, bytes: &[u8], out: &mut Vec<u8>) {
        for &byte in bytes {
            out.push(byte);
            self.segment.push(byte);
            if self.contributors.last() != Some(&id) {
                self.contributors.push(id);
            }
            if byte == 0 || self.segment.len() >= 2 * MAX_CHUNK {
                self.segment_ends(byte == 0);
            }
        }
        if let Some(frame) = self.pending.iter_mut().find(|frame| frame.id == id) {
            frame.came_out |= !bytes.is_empty();
        }
    }

    /// Judges what came out since the last zero: of whom it is whole. Without a zero it was only
    /// too long to be kept.
    fn segment_ends(&mut self, at_zero: bool) {
        let spoiled = std::mem::replace(&mut self.spoiled, !at_zero) || !at_zero;
        let segment = std::mem::take(&mut self.segment);
        for contributor in std::mem::take(&mut self.contributors) {
            if let Some(frame) = self.pending.iter_mut().find(|frame| frame.id == contributor) {
                frame.came_out = true;
                frame.copies += u64::from(!spoiled && frame.clean == segment);
            }
        }
    }

    fn sent(&mut self, id: u64) {
        if let Some(frame) = self.pending.iter_mut().find(|frame| frame.id == id) {
            frame.sent = true;
        }
    }

    /// Decides the fates of frames of which nothing is on its way any more, in order.
    fn settle(&mut self) {
        while let Some(frame) = self.pending.front() {
            if !frame.sent || self.contributors.contains(&frame.id) {
                return;
            }
            let fate = match (frame.copies, frame.came_out) {
                (1.., _) => Fate::Survived,
                (0, true) => Fate::Damaged,
                (0, false) => Fate::Vanished,
            };
            self.report.frames.add(fate, frame.copies, 1);
            if let Some((first_tick, count, again)) = frame.samples {
                self.report.settle(LostSamples { first_tick, count, fate }, frame.copies, again);
            }
            self.pending.pop_front();
        }
    }
}

#[cfg(test)]
mod tests;
