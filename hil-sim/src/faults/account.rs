//! What a faulty link is to do, and the account of what came of it.

use std::collections::BTreeSet;

/// Probabilities of faults, each for every frame or every byte.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaultSettings {
    /// A frame is dropped whole.
    pub drop_frame: f64,
    /// A frame comes twice.
    pub duplicate_frame: f64,
    /// A frame is cut off at a random byte, its zero included.
    pub truncate_frame: f64,
    /// A frame comes after the one that follows it.
    pub reorder_frames: f64,
    /// Two neighbouring bytes of a frame change places.
    pub reorder_bytes: f64,
    /// A byte is dropped.
    pub drop_byte: f64,
    /// One bit of a byte is inverted.
    pub flip_byte: f64,
    /// A byte comes twice.
    pub duplicate_byte: f64,
    /// The link is unplugged in the middle of a frame.
    pub unplug: f64,
    /// Frames for which it then stays unplugged: drawn evenly from 1 to this (0 counts as 1).
    pub unplug_frames: u32,
}

impl FaultSettings {
    /// Every kind of fault, each a few times in a thousand frames.
    pub const EVERYTHING: Self = Self {
        drop_frame: 2e-3,
        duplicate_frame: 2e-3,
        truncate_frame: 2e-3,
        reorder_frames: 2e-3,
        reorder_bytes: 2e-3,
        drop_byte: 2e-5,
        flip_byte: 2e-5,
        duplicate_byte: 2e-5,
        unplug: 2e-4,
        unplug_frames: 200,
    };
}

/// What became of frames or samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fates {
    /// Came out whole at least once.
    pub survived: u64,
    /// Came out, but not whole.
    pub damaged: u64,
    /// Did not come out at all.
    pub vanished: u64,
    /// Further whole copies of survivors.
    pub repeated: u64,
}

impl Fates {
    pub(super) fn add(&mut self, fate: Fate, copies: u64, by: u64) {
        match fate {
            Fate::Survived => self.survived += by,
            Fate::Damaged => self.damaged += by,
            Fate::Vanished => self.vanished += by,
        }
        self.repeated += copies.saturating_sub(1) * by;
    }

    /// All that went in.
    pub fn total(&self) -> u64 {
        self.survived + self.damaged + self.vanished
    }
}

/// What became of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It came out whole.
    Survived,
    /// It came out, but not whole.
    Damaged,
    /// It did not come out.
    Vanished,
}

/// Samples that did not survive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LostSamples {
    /// Tick of the first.
    pub first_tick: u32,
    /// Number.
    pub count: u32,
    /// What became of their frame.
    pub fate: Fate,
}

/// Everything that the link has done, and what came of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FaultReport {
    /// Bytes in and out.
    pub bytes: [u64; 2],
    /// Faults drawn: frames dropped, duplicated, truncated, reordered, with bytes reordered.
    pub drawn_frames: [u64; 5],
    /// Faults drawn: bytes dropped, flipped, duplicated.
    pub drawn_bytes: [u64; 3],
    /// Times the link was unplugged.
    pub unplugged: u64,
    /// Frames of all kinds.
    pub frames: Fates,
    /// Samples in them, as they were streamed.
    pub samples: Fates,
    /// Streamed blocks that did not survive, in order; at most [`MAX_LOST`] of them.
    pub lost: Vec<LostSamples>,
    /// First tick and number of samples of the blocks that were sent again and came out whole, in
    /// order; at most [`MAX_LOST`].
    pub restored: Vec<(u32, u32)>,
}

impl FaultReport {
    /// The fate of samples is known, of which so many whole copies came out; they were sent again,
    /// or streamed.
    pub(super) fn settle(&mut self, samples: LostSamples, copies: u64, again: bool) {
        let survived = samples.fate == Fate::Survived;
        if again {
            if survived && self.restored.len() < MAX_LOST {
                self.restored.push((samples.first_tick, samples.count));
            }
            return;
        }
        self.samples.add(samples.fate, copies, u64::from(samples.count));
        if !survived && self.lost.len() < MAX_LOST {
            self.lost.push(samples);
        }
    }

    /// Ticks whose samples did not come out in any frame, in order of size (of a device that does
    /// not restart).
    pub fn missing(&self) -> Vec<u32> {
        let restored: BTreeSet<u32> = self.restored.iter().flat_map(|&(first, count)| ticks(first, count)).collect();
        let lost = self.lost.iter().flat_map(|lost| ticks(lost.first_tick, lost.count));
        let missing: BTreeSet<u32> = lost.filter(|tick| !restored.contains(tick)).collect();
        missing.into_iter().collect()
    }
}

fn ticks(first: u32, count: u32) -> impl Iterator<Item = u32> {
    (0..count).map(move |i| first.wrapping_add(i))
}

/// Most entries of [`FaultReport::lost`].
pub const MAX_LOST: usize = 1 << 20;
