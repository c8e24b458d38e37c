//! Records: typed columns in segments of unbroken, evenly spaced samples.
//!
//! A gap in `t` (or in the device's ticks), or a NaN in any channel, ends a segment; nothing is interpolated over.
//! Counts stay integers until [`Column::angle`] turns them into radians: a count c stands for the middle of
//! [c, c+1), θ = (c + ½)·2π/N.

use std::path::PathBuf;

use serde::Serialize;

use crate::rig::Channel;
use crate::warning::Warning;

/// A measured record.
#[derive(Clone, Debug)]
pub struct Record {
    /// File it was read from.
    pub path: PathBuf,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// The channels, in the order of the rig file; every segment has one column for each.
    pub channels: Vec<Channel>,
    /// Unbroken stretches, in order of time.
    pub segments: Vec<Segment>,
    /// What did not arrive.
    pub losses: Losses,
    /// Things noticed while reading.
    pub warnings: Vec<Warning>,
    /// Metadata of a record of whirl's own.
    pub metadata: Option<Metadata>,
}

/// An unbroken, evenly spaced stretch.
#[derive(Clone, Debug)]
pub struct Segment {
    /// Tick of the first sample (device's own, or rows counted at the sampling rate from the first row).
    pub first_tick: i64,
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Spacing, s.
    pub step_s: f64,
    /// One column for each channel of the record, all of equal length.
    pub columns: Vec<Column>,
    /// The drive's phase at each sample, turns · 2⁻³², where the device recorded it.
    pub phase: Option<Vec<u32>>,
    /// Commanded amplitude of the base at each sample, nm, where the device recorded it.
    pub amplitude_nm: Option<Vec<u32>>,
}

/// Samples of one channel.
#[derive(Clone, Debug, PartialEq)]
pub enum Column {
    /// Encoder counts, multi-turn.
    Counts(Vec<i32>),
    /// Values in the channel's unit.
    Values(Vec<f64>),
}

impl Column {
    /// Number of samples.
    pub fn len(&self) -> usize {
        match self {
            Self::Counts(c) => c.len(),
            Self::Values(v) => v.len(),
        }
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The samples in SI units: for counts (c + ½)·2π/N rad, otherwise value times the unit's factor. Not unwrapped.
    pub fn angle(&self, channel: &Channel) -> Vec<f64> {
        let scale = channel.scale();
        match self {
            Self::Counts(c) => c.iter().map(|&c| (f64::from(c) + 0.5) * scale).collect(),
            Self::Values(v) => v.iter().map(|&v| v * scale).collect(),
        }
    }
}

impl Segment {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.columns.first().map_or(0, Column::len)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Time of sample i, s.
    pub fn time(&self, i: usize) -> f64 {
        self.start_s + i as f64 * self.step_s
    }
}

/// Samples that did not arrive, by cause. `received + lost() = ` ticks from first to last.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Losses {
    /// Samples in the record.
    pub received: u64,
    /// Missing samples whose cause is not known, or lost on the link without a trace (dropped whole).
    pub lost_on_link: u64,
    /// Missing samples whose frames arrived damaged and were refused.
    pub damaged: u64,
    /// Missing samples that the device says it never took (overruns).
    pub overruns: u64,
    /// Missing samples that the device dropped because its queue was full.
    pub dropped_by_device: u64,
    /// Rows with NaN in a channel.
    pub nan_rows: u64,
    /// Samples that arrived more than once (kept once).
    pub duplicates: u64,
    /// Frames refused by the checksum or the decoder.
    pub bad_frames: u64,
    /// Gaps in time.
    pub gaps: u64,
    /// Device restarts seen.
    pub restarts: u64,
}

impl Losses {
    /// All missing samples.
    pub fn lost(&self) -> u64 {
        self.lost_on_link + self.damaged + self.overruns + self.dropped_by_device + self.nan_rows
    }
}

/// What whirl's own records carry beside the samples.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Metadata {
    /// Text of the rig file at capture.
    pub rig: String,
    /// Firmware name and version, or the simulator's.
    pub firmware: String,
    /// Board.
    pub board: String,
    /// Start of the record, RFC 3339 (a simulated record has none).
    pub started_at: Option<String>,
    /// Where the samples came from (`serial:…`, `tcp:…`, `sim`, `simulate`).
    pub source: String,
    /// Version of whirl that wrote it.
    pub written_by: String,
}

impl Record {
    /// Samples over all segments.
    pub fn samples(&self) -> usize {
        self.segments.iter().map(Segment::len).sum()
    }

    /// Index of the channel that measures a quantity.
    pub fn channel_of(&self, measures: &str) -> Option<usize> {
        self.channels.iter().position(|c| c.measures == measures)
    }
}
