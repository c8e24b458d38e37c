//! Records: typed columns in segments of unbroken, evenly spaced samples.
//!
//! A gap in `t` (or in the device's ticks), or a NaN in any channel, ends a segment, unless it is
//! short and what is missing follows from the rows around it to the sensors' noise (`bridge.rs`).
//! Counts stay integers until [`Column::angle`] turns them into radians: a count c stands for the
//! middle of [c, c+1), θ = (c + ½)·2π/N.
//!
//! [`Record::read`] takes every format in [`formats::FORMATS`]; [`writer::RecordWriter`] writes
//! whirl's own.

mod arrays;
mod arrow_schema;
mod bridge;
mod computing;
mod csv;
mod csv_head;
mod csv_row;
mod csv_time;
pub(crate) mod csv_write;
pub mod cut;
mod damage;
mod dates;
pub mod device_boot;
pub mod formats;
mod hdf5;
mod level;
mod lines;
mod lvm;
mod mat;
mod mat_walk;
pub mod names;
mod npy;
mod npz;
mod parquet;
mod parquet_cells;
mod parquet_chunks;
mod parquet_nested;
mod parquet_recovery;
mod parquet_salvage;
mod parquet_source;
mod parquet_structure;
mod parquet_write;
mod quiet;
mod rate;
pub mod regression_rows;
mod resample;
mod rows;
pub(crate) mod sealed_line;
mod segments;
pub mod stream;
mod time_fit;
pub(crate) mod unwrap;
pub mod values;
pub mod writer;

use core::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use whirl_shared::excitation::{Excitation, Table};

pub use self::device_boot::DeviceBoot;
pub use self::formats::ReadOptions;
pub use self::level::Level;
pub use self::parquet::{has_footer, metadata};
pub use self::writer::RecordWriter;
use crate::error::Result;
use crate::rig::{Channel, Rig};
use crate::suspects::Numbering;
use crate::warning::Warning;

/// A measured record.
#[derive(Clone, Debug, Default)]
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
    /// How its rows are counted in the file that it was read from.
    pub numbering: Option<Arc<Numbering>>,
}

/// An unbroken, evenly spaced stretch.
#[derive(Clone, Debug)]
pub struct Segment {
    /// Tick of the first sample (device's own, or rows counted at the sampling rate from the first
    /// row).
    pub first_tick: i64,
    /// Boot of the device from which it is, 0 for the first that the capture saw. Counts of
    /// different boots differ by offsets that nobody knows, unless the device tells that their
    /// zeros are the same ([`Metadata::told_of`]). 0 where the record does not tell boots.
    pub boot: u32,
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Spacing, s.
    pub step_s: f64,
    /// Rms deviation of the rows' `t` from `start_s + i·step_s`, s: what rounding and jitter of the
    /// clock leave.
    pub jitter_s: f64,
    /// One column for each channel of the record, all of equal length.
    pub columns: Vec<Column>,
    /// The drive's phase at each sample, turns · 2⁻³², where the device recorded it.
    pub phase: Option<Vec<u32>>,
    /// Commanded amplitude of the base at each sample, nm, where the device recorded it.
    pub amplitude_nm: Option<Vec<u32>>,
    /// Samples that were not recorded: short gaps, filled from the rows around them.
    pub filled: Vec<Range<usize>>,
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

    /// The samples in SI units: for counts (c + ½)·2π/N rad (with stuck bits the middle of what they
    /// show, [`Channel::middle`]), otherwise value times the unit's factor. Not unwrapped.
    pub fn angle(&self, channel: &Channel) -> Vec<f64> {
        let (scale, middle) = (channel.scale(), channel.middle());
        match self {
            Self::Counts(c) => c.iter().map(|&c| (f64::from(c) + middle) * scale).collect(),
            Self::Values(v) => v.iter().map(|&v| v * scale).collect(),
        }
    }
}

impl Segment {
    /// Columns of equal length, of which nothing else was recorded.
    pub fn new(start_s: f64, step_s: f64, columns: Vec<Column>) -> Self {
        let (first_tick, boot, jitter_s) = (0, 0, 0.0);
        let (phase, amplitude_nm, filled) = (None, None, Vec::new());
        Self { first_tick, boot, start_s, step_s, jitter_s, columns, phase, amplitude_nm, filled }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.columns.first().map_or(0, Column::len)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Samples · step, s.
    pub fn duration_s(&self) -> f64 {
        self.len() as f64 * self.step_s
    }

    /// The samples of these rows.
    ///
    /// # Panics
    /// Rows that are not the segment's.
    pub fn rows(&self, rows: Range<usize>) -> Self {
        let words = |of: &Option<Vec<u32>>| of.as_ref().map(|w| w[rows.clone()].to_vec());
        let columns = self.columns.iter().map(|column| match column {
            Column::Counts(c) => Column::Counts(c[rows.clone()].to_vec()),
            Column::Values(v) => Column::Values(v[rows.clone()].to_vec()),
        });
        Self {
            first_tick: self.first_tick.saturating_add(rows.start as i64),
            boot: self.boot,
            start_s: self.time(rows.start),
            step_s: self.step_s,
            jitter_s: self.jitter_s,
            columns: columns.collect(),
            phase: words(&self.phase),
            amplitude_nm: words(&self.amplitude_nm),
            filled: self.filled_within(&rows),
        }
    }

    /// What was filled of these rows, counted from their first.
    pub fn filled_within(&self, rows: &Range<usize>) -> Vec<Range<usize>> {
        let within = |f: &Range<usize>| {
            let part = f.start.max(rows.start)..f.end.min(rows.end);
            (part.start < part.end).then(|| part.start - rows.start..part.end - rows.start)
        };
        self.filled.iter().filter_map(within).collect()
    }

    /// Time of sample i, s.
    pub fn time(&self, i: usize) -> f64 {
        self.start_s + i as f64 * self.step_s
    }
}

/// Samples that did not arrive, by cause. `received + lost() = ` ticks from first to last.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Losses {
    /// Samples in the record.
    pub received: u64,
    /// Missing samples whose cause is not known, or lost on the link without a trace (dropped
    /// whole).
    pub lost_on_link: u64,
    /// Missing samples whose frames arrived damaged and were refused, or that stand in a damaged
    /// part of the file.
    pub damaged: u64,
    /// Missing samples that the device says it never took (overruns).
    pub overruns: u64,
    /// Missing samples that the device dropped because its queue was full.
    pub dropped_by_device: u64,
    /// Rows with NaN in a channel.
    pub nan_rows: u64,
    /// Samples that arrived more than once (kept once).
    pub duplicates: u64,
    /// Samples that arrived out of order (kept, in their place).
    pub late: u64,
    /// Samples that the link had lost and the device has sent again (kept, in their place; they are
    /// among the received ones).
    pub restored: u64,
    /// Samples that arrived when their place had been passed, or whose place on the device's clock
    /// could not be told: not in the record. Those between its first and last tick are among the
    /// missing ones above.
    pub dropped_late: u64,
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
        [self.lost_on_link, self.damaged, self.overruns, self.dropped_by_device, self.nan_rows]
            .into_iter()
            .fold(0, u64::saturating_add)
    }
}

/// What whirl's own records carry beside the samples.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
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
    /// Sampling rate of the device's clock, Hz (0: not known).
    pub sample_rate_hz: f64,
    /// Tick of the first sample of each boot of the device after the first, increasing; empty where
    /// it never restarted.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub boots: Vec<i64>,
    /// What the device told of its boots, the first one too, increasing in tick; empty where it
    /// told nothing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub device: Vec<DeviceBoot>,
    /// What the device itself said, its first lines.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lines: Vec<DeviceLine>,
    /// What moved the base, where the device told of something else than a sine.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub excitation: Option<Excitation>,
    /// Control points of the table that the host brought to the device ([`Self::table`]).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub table: Vec<i16>,
    /// What the amplitude was levelled to, where it was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub level: Option<Level>,
}

/// A line for people that a device sent.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct DeviceLine {
    /// When, on the record's line of ticks.
    pub tick: i64,
    /// `error`, `warning` or `information`.
    pub level: String,
    /// Its text, as it came.
    pub text: String,
}

impl Metadata {
    /// The table that moved the base, where one did and its points are known.
    pub fn table(&self) -> Option<Table> {
        let name = self.excitation.as_ref()?.table;
        Table::of(&self.table).filter(|table| table.known().name == name)
    }

    /// Boot of the device from which the sample of a tick is, 0 for the first.
    pub fn boot_at(&self, tick: i64) -> u32 {
        // Bounded by the boots that a record lists.
        u32::try_from(self.boots.partition_point(|first| *first <= tick)).unwrap_or(u32::MAX)
    }

    /// What the device told of a boot, 0 for the first.
    pub fn told_of(&self, boot: u32) -> Option<&DeviceBoot> {
        match usize::try_from(boot).ok()?.checked_sub(1) {
            None => self.device.first().filter(|told| self.boots.first().is_none_or(|next| told.tick < *next)),
            Some(i) => self.boots.get(i).and_then(|tick| self.device.iter().find(|told| told.tick == *tick)),
        }
    }
}

impl Record {
    /// Segments of all of a rig's channels, at its rate and without a loss.
    pub fn of(path: impl Into<PathBuf>, rig: &Rig, segments: Vec<Segment>) -> Self {
        let received = segments.iter().map(|s| s.len() as u64).sum();
        Self {
            path: path.into(),
            sample_rate_hz: rig.sample_rate_hz,
            channels: rig.channel.clone(),
            segments,
            losses: Losses { received, ..Losses::default() },
            ..Self::default()
        }
    }

    /// Whether its time is that of the device, ticks and phase of the drive beside it.
    pub fn has_own_time(&self) -> bool {
        self.segments.iter().any(|s| s.phase.is_some())
    }

    /// Reads a record in any of [`formats::FORMATS`], told apart by content and extension.
    ///
    /// # Errors
    /// Names the file, the row or column, the value found, the one expected, and the remedy.
    pub fn read(path: impl AsRef<Path>, rig: &Rig, options: &ReadOptions) -> Result<Self> {
        formats::read(path.as_ref(), rig, options)
    }

    /// Samples over all segments.
    pub fn samples(&self) -> usize {
        self.segments.iter().map(Segment::len).sum()
    }

    /// Length of the longest unbroken stretch, samples.
    pub fn longest_segment(&self) -> usize {
        self.segments.iter().map(Segment::len).max().unwrap_or(0)
    }

    /// Duration of the longest unbroken stretch (samples · step), s.
    pub fn longest_segment_s(&self) -> f64 {
        self.segments.iter().map(Segment::duration_s).fold(0.0, f64::max)
    }

    /// Time from the first sample to one step past the last, gaps included, s.
    pub fn duration_s(&self) -> f64 {
        match (self.segments.first(), self.segments.last()) {
            (Some(first), Some(last)) => last.start_s + last.duration_s() - first.start_s,
            _ => 0.0,
        }
    }
}
