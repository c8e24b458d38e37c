//! The record as a whole: rate, length, segments, gaps, losses, timing.

use serde::Serialize;

use crate::record::{DeviceBoot, Losses, Record};
use crate::rig::Rig;

/// A stretch of time without samples.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// Time of the last sample before it, s.
    pub after_s: f64,
    /// Time from that sample to the next, s.
    pub length_s: f64,
    /// Samples missing in it, by the ticks.
    pub samples: i64,
}

/// The record as a whole.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecordSummary {
    /// File name (without folders).
    pub file: String,
    /// Name of the rig.
    pub rig: String,
    /// Model id.
    pub model: String,
    /// Samples.
    pub samples: u64,
    /// Samples that are missing.
    pub lost: u64,
    /// Unbroken stretches.
    pub segments: usize,
    /// Samples in the longest of them.
    pub longest_segment: usize,
    /// Time of the first sample, s.
    pub start_s: f64,
    /// From first to last sample, s.
    pub duration_s: f64,
    /// Sampling rate of the record, Hz.
    pub sample_rate_hz: f64,
    /// Sampling rate of the rig file, Hz.
    pub stated_rate_hz: f64,
    /// Record's rate over the rig file's, minus one.
    pub rate_deviation: f64,
    /// Largest deviation of a segment's start from the grid of ticks of the first segment, s.
    pub start_jitter_s: f64,
    /// Standard deviation of the steps of the device's phase about their mean, in sampling
    /// intervals, where recorded.
    pub phase_jitter: Option<f64>,
    /// Drive frequency of the rig file, Hz.
    pub drive_hz: Option<f64>,
    /// Losses by cause.
    pub losses: Losses,
    /// Gaps, the first 1000.
    pub gaps: Vec<Gap>,
    /// Where one of whirl's own records came from.
    pub origin: Option<Origin>,
}

/// Where a record came from: its metadata without the rig file's text, which may hold a simulated
/// rig's truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Origin {
    /// Firmware name and version, or the simulator's.
    pub firmware: String,
    /// Board.
    pub board: String,
    /// Start of the record, RFC 3339.
    pub started_at: Option<String>,
    /// Source of the samples.
    pub source: String,
    /// Version of whirl that wrote it.
    pub written_by: String,
    /// The device's boots of which samples are in it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub boots: Vec<DeviceBoot>,
}

/// Summarises a record.
pub fn summarise(record: &Record, rig: &Rig) -> RecordSummary {
    let rate = record.sample_rate_hz;
    let first = record.segments.iter().find(|s| !s.is_empty());
    let last = record.segments.iter().rev().find(|s| !s.is_empty());
    let start_s = first.map_or(0.0, |s| s.start_s);
    let end_s = last.map_or(0.0, |s| s.time(s.len() - 1));
    let gaps = record
        .segments
        .windows(2)
        .filter(|w| !w[0].is_empty() && !w[1].is_empty())
        .take(1000)
        .map(|w| {
            let after_s = w[0].time(w[0].len() - 1);
            let samples = w[1].first_tick.saturating_sub(w[0].first_tick).saturating_sub(w[0].len() as i64);
            Gap { after_s, length_s: w[1].start_s - after_s, samples }
        })
        .collect();
    let start_jitter_s = first.map_or(0.0, |f| {
        let grid = |tick: i64| f.start_s + tick.saturating_sub(f.first_tick) as f64 / rate;
        record.segments.iter().map(|s| (s.start_s - grid(s.first_tick)).abs()).fold(0.0, f64::max)
    });
    RecordSummary {
        file: record.path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
        rig: rig.name.clone(),
        model: rig.model.clone(),
        samples: record.samples() as u64,
        lost: record.losses.lost(),
        segments: record.segments.len(),
        longest_segment: record.segments.iter().map(|s| s.len()).max().unwrap_or(0),
        start_s,
        duration_s: end_s - start_s,
        sample_rate_hz: rate,
        stated_rate_hz: rig.sample_rate_hz,
        rate_deviation: rate / rig.sample_rate_hz - 1.0,
        start_jitter_s,
        phase_jitter: phase_jitter(record),
        drive_hz: rig.drive.map(|d| d.frequency_hz),
        losses: record.losses.clone(),
        gaps,
        origin: record.metadata.as_ref().map(|m| Origin {
            firmware: m.firmware.clone(),
            board: m.board.clone(),
            started_at: m.started_at.clone(),
            source: m.source.clone(),
            written_by: m.written_by.clone(),
            boots: m.device.clone(),
        }),
    }
}

/// Spread of the phase's steps over their mean; none without a phase or where it stands still.
fn phase_jitter(record: &Record) -> Option<f64> {
    let steps: Vec<f64> = record
        .segments
        .iter()
        .filter_map(|s| s.phase.as_ref())
        .flat_map(|p| p.windows(2).map(|w| f64::from(w[1].wrapping_sub(w[0]) as i32)))
        .collect();
    let mean = steps.iter().sum::<f64>() / steps.len().max(1) as f64;
    if steps.len() < 2 || mean == 0.0 {
        return None;
    }
    let variance = steps.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / steps.len() as f64;
    Some(variance.sqrt() / mean.abs())
}
