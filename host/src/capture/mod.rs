//! From a device's bytes to a record in which every sample is accounted for.
//!
//! ```text
//! source ─ bytes ─▶ journal (REC.frames)
//!             └───▶ decoder ─▶ accounting ─▶ record (REC)
//!                      └─────▶ session: hello, drive, keep-alives, reconnection ─▶ commands to the device
//! ```
//!
//! - A link that drops is tried again, with growing pauses, for `reconnect_s`; the device's clock
//!   goes on, the gap is marked and counted. A device that restarts begins a new segment.
//! - Where the rig has `[drive]` and its amplitude is known, the shaker is armed and started,
//!   recording begins when it runs, and it is stopped at the end, after an error and on Ctrl-C. The
//!   device's own watchdog covers the rest.
//! - Nothing is recorded before the device has answered (`gate`). One that answers and brings
//!   nothing new is told, and given up (`stall`).
//! - The record is a function of the journal, see [`journal`]; it grows by what matters (`sieve`).
//!   Memory is flat.
//! - What an interrupted capture leaves can be made a record, or gone on with, see [`interrupted`].

mod accounting;
mod back_fill;
mod commands;
mod device;
mod drive;
mod ending;
pub mod estimates;
pub mod excite;
pub mod feed;
mod file;
mod gate;
mod hearing;
pub mod interrupted;
pub mod journal;
pub mod level;
mod live;
mod no_device;
pub mod precision;
pub mod progress;
mod recorder;
mod replay;
mod rows;
mod rtt;
pub mod serial;
pub mod setting_keys;
mod sieve;
pub mod sim;
pub mod source;
mod stall;
mod table;
mod taken;
pub mod talk;
mod target;
mod tcp;
mod watching;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde::Serialize;

use self::excite::Excite;
use self::feed::Feed;
use self::precision::{Precision, Until};
use self::recorder::Finished;
use self::target::{needs_measured_base, target};
use crate::error::{BadInput, Result};
use crate::record::{DeviceLine, Level, Losses};
use crate::rig::Rig;
use crate::warning::Warning;

pub use self::progress::Progress;

/// How a capture is made.
#[derive(Clone, Debug)]
pub struct CaptureSettings {
    /// Source, in one of the forms of [`source::SOURCES`].
    pub from: String,
    /// The record; an existing one is replaced.
    pub output: PathBuf,
    /// Device time to record from the first sample on, s; none: until `stop`, or the end of a file.
    pub seconds: Option<f64>,
    /// How long a lost link is tried again, s. Default 60.
    pub reconnect_s: f64,
    /// How long the device may take to answer at the start, s. Default 5.
    pub handshake_s: f64,
    /// Amplitude of the base, m; before that of the rig file.
    pub amplitude_m: Option<f64>,
    /// What the shaker does beyond one sine.
    pub excite: Excite,
    /// Before the record begins, command what makes the base's channel show the amplitude that is
    /// wanted. Default false.
    pub level: bool,
    /// Start the shaker where the rig has a drive. Default true.
    pub drive: bool,
    /// Record from the moment on at which the shaker runs at its amplitude, not from the first
    /// sample. Default true.
    pub wait_for_drive: bool,
    /// Device time for which the running drive (or, without one, the rig) is left to itself before
    /// recording, s; before that of the source (`sim` takes it from `[plant]`, others have none).
    pub settle_s: Option<f64>,
    /// Effects put into a simulated rig, as the command line has them: for the commands that are
    /// told after an interruption.
    pub effects: Vec<String>,
    /// Record the regression rows of the device's own identification instead of samples. Default
    /// false.
    pub rows: bool,
    /// Start the shaker again where it has stopped by itself: after the link was lost, or the
    /// device has restarted. Default false: who comes near a rig that stands still is to find it
    /// so.
    pub restart_drive: bool,
    /// Go on in the record of a capture that was interrupted, on the terms of its journal. Default
    /// false.
    pub resume: bool,
    /// Keep the journal after a clean end. Default false.
    pub keep_frames: bool,
    /// End once the device's estimate says that a parameter is known so well.
    pub until: Option<Until>,
    /// Where a copy of what comes is left for people to see, while it comes. A simulated rig then
    /// runs in real time.
    pub feed: Option<Arc<Feed>>,
    /// Set from elsewhere (Ctrl-C) to end the capture in order.
    pub stop: Arc<AtomicBool>,
}

impl CaptureSettings {
    /// The defaults, for a source and a record.
    pub fn new(from: impl Into<String>, output: impl Into<PathBuf>) -> Self {
        Self {
            from: from.into(),
            output: output.into(),
            seconds: None,
            reconnect_s: 60.0,
            handshake_s: 5.0,
            amplitude_m: None,
            excite: Excite::default(),
            level: false,
            drive: true,
            wait_for_drive: true,
            settle_s: None,
            effects: Vec::new(),
            rows: false,
            restart_drive: false,
            resume: false,
            keep_frames: false,
            until: None,
            feed: None,
            stop: Arc::default(),
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// Names the option, the value found and the one expected.
    pub fn validate(&self) -> Result<()> {
        let bad = |option: &str, found: f64, expected: &str| {
            Err(BadInput::new(found.to_string(), expected).at(option).remedy("Correct the option"))
        };
        if let Some(s) = self.seconds.filter(|s| !(s.is_finite() && *s > 0.0 && *s <= 1e8)) {
            return bad("--seconds", s, "a time in seconds above 0");
        }
        for (option, s) in [
            ("--reconnect-s", self.reconnect_s),
            ("--handshake-s", self.handshake_s),
            ("--settle-s", self.settle_s.unwrap_or(0.0)),
        ] {
            if !(0.0..=1e7).contains(&s) {
                return bad(option, s, "a time in seconds, 0 or more");
            }
        }
        if let Some(a) = self.amplitude_m.filter(|a| !(0.0..=2.0).contains(a)) {
            return bad("--amplitude-m", a, "an amplitude in metres, 0 to 2");
        }
        Ok(())
    }
}

/// What a capture gave.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaptureOutcome {
    /// The record.
    pub record: PathBuf,
    /// The journal, where it was kept.
    pub frames: Option<PathBuf>,
    /// Samples in the record and those missing, by cause.
    pub losses: Losses,
    /// Tick of the first sample.
    pub first_tick: i64,
    /// Tick of the last sample.
    pub last_tick: i64,
    /// Device time from the first sample to one step past the last, s.
    pub duration_s: f64,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// Firmware name and version.
    pub firmware: String,
    /// Board.
    pub board: String,
    /// Bytes that came from the device.
    pub bytes: u64,
    /// Times that the link was lost and found again.
    pub reconnections: u64,
    /// The file of the device's own estimates, where there were any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimates: Option<PathBuf>,
    /// The last of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimate: Option<estimates::DeviceEstimate>,
    /// Windows of rows, where these were recorded instead of samples; `losses` are then those of
    /// the samples under them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rows: Option<RowsOutcome>,
    /// What the amplitude was levelled to, where that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub level: Option<Level>,
    /// What the device said, its first lines.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub device_log: Vec<DeviceLine>,
    /// Whether `seconds`, or before it the precision of `until`, was reached (true where no time
    /// was asked for).
    pub complete: bool,
    /// Of the parameter whose precision was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub until: Option<Precision>,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

/// Windows of a record of rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct RowsOutcome {
    /// In the record.
    pub windows: u64,
    /// Lost, in part or whole.
    pub windows_lost: u64,
    /// Unbroken stretches.
    pub runs: u64,
}

/// Captures a record.
///
/// # Errors
/// Settings, source or rig file that cannot be; a device that is silent, speaks another protocol or
/// has other encoders than the rig file says; a wire with noise; a link that is lost for longer
/// than `reconnect_s`; a full disk. What was captured until then is a readable record, and the
/// message says so.
pub fn run(settings: &CaptureSettings, rig: &Rig, progress: &mut dyn FnMut(&Progress)) -> Result<CaptureOutcome> {
    settings.validate()?;
    // Before the device is spoken to.
    settings.until.as_ref().map_or(Ok(()), |until| until.check(rig))?;
    let mut source = source::parse(&settings.from, rig)?;
    run_from(settings, rig, &mut *source, progress)
}

/// As [`run`], from a source that is there already; `settings.from` is its name.
///
/// # Errors
/// As [`run`].
pub fn run_from(
    settings: &CaptureSettings,
    rig: &Rig,
    source: &mut dyn source::Source,
    progress: &mut dyn FnMut(&Progress),
) -> Result<CaptureOutcome> {
    settings.validate()?;
    if source.is_replay() {
        if settings.resume {
            return Err(BadInput::new(format!("--resume from {}", settings.from), "a device")
                .at("--resume")
                .remedy("Name the device of the interrupted capture; without --resume the bytes are made a record"));
        }
        if settings.until.is_some() {
            return Err(BadInput::new(format!("--until from {}", settings.from), "a device")
                .at("--until")
                .remedy("Leave it out: all that a file holds is taken"));
        }
        if settings.level {
            return Err(BadInput::new(format!("--level-amplitude from {}", settings.from), "a device")
                .at("--level-amplitude")
                .remedy("Leave it out: a file's amplitude is what it was"));
        }
        return replay::run(settings, rig, source, progress);
    }
    settings.until.as_ref().map_or(Ok(()), |until| until.check(rig))?;
    let target = target(settings, rig)?;
    if settings.level {
        level::check(settings, rig, target)?;
    }
    let unknown = target.is_none() && settings.drive && rig.drive.is_some();
    let mut outcome = live::run(settings, rig, source, target, progress)?;
    if unknown {
        outcome.warnings.push(Warning::new(
            "drive-left-alone",
            format!("{} has [drive] but no amplitude_m: the shaker was left alone", rig.path.display()),
            "Give --amplitude-m, or drive.amplitude_m in the rig file; --no-drive says that this is meant",
        ));
    }
    outcome.warnings.extend(needs_measured_base(target, rig));
    Ok(outcome)
}

/// The outcome of a finished recording; none where it has no sample.
fn outcome(settings: &CaptureSettings, finished: Finished, seconds: Option<f64>) -> Option<CaptureOutcome> {
    let (first_tick, last_tick) = (finished.first_tick?, finished.last_tick?);
    let sample_rate_hz = finished.metadata.sample_rate_hz;
    let duration_s = last_tick.abs_diff(first_tick).saturating_add(1) as f64 / sample_rate_hz;
    let mut warnings = finished.warnings;
    // Half a sample short of it is all of it; of rows, all windows that fit.
    let all = |s: f64| finished.full.unwrap_or(duration_s + 0.5 / sample_rate_hz >= s);
    let complete = seconds.is_none_or(all);
    if let (false, Some(s)) = (complete, seconds) {
        warnings.push(Warning::new(
            "short",
            format!("{duration_s:.3} s of {s} s are in the record"),
            "Capture again, or use what there is",
        ));
    }
    Some(CaptureOutcome {
        record: settings.output.clone(),
        frames: None,
        losses: finished.losses,
        first_tick,
        last_tick,
        duration_s,
        sample_rate_hz,
        firmware: finished.metadata.firmware,
        board: finished.metadata.board,
        bytes: 0,
        reconnections: 0,
        estimates: finished.estimates,
        estimate: finished.estimate,
        rows: finished.rows,
        level: finished.metadata.level,
        device_log: finished.lines,
        complete,
        until: None,
        warnings,
    })
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;

#[cfg(test)]
mod sim_tests;
