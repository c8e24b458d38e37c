//! Bytes of the wire into a record. What comes out depends on the bytes, the terms and the rig file
//! alone, never on clocks, so that a journal gives the same record as the capture that wrote it.

mod finished;
mod messages;

use std::path::{Path, PathBuf};

use whirl_shared::codec::Decoder;
use whirl_shared::excitation::Excitation;
use whirl_shared::frame::{DeviceMessage, Envelope, Hello, MOST_ENCODERS};

use super::accounting::Accounting;
use super::back_fill::Gap;
use super::estimates::{self, DeviceEstimate, Estimates};
use super::journal::Terms;
use super::rows::RowsRecorder;
use super::taken::Taken;
use crate::error::{BadInput, Result};
use crate::record::writer::Sample;
use crate::record::{DeviceBoot, DeviceLine, Losses, Metadata, RecordWriter};
use crate::rig::Rig;
use crate::rig::measures::BASE;
use crate::warning::Warning;

pub(super) use self::finished::Finished;

/// How long a gap waits to be filled, counted in the samples that come meanwhile, s.
const PATIENCE_S: f64 = 6.0;

/// What came out of one byte.
pub(super) enum Event {
    /// A message of the device.
    Message(Box<Envelope<DeviceMessage>>),
    /// A frame that was refused.
    Bad,
}

/// Counts of the rig file's channels: encoders in their order, the base's sensor behind all of the
/// device's.
fn in_the_rigs_order(rig: &Rig, device: &[i32], counts: &mut Vec<i32>) {
    counts.clear();
    let mut encoders = device.iter().copied();
    for channel in &rig.channel {
        let count = if channel.measures == BASE { device.last().copied() } else { encoders.next() };
        // No block has fewer channels ([`Recorder::lacks`]).
        counts.push(count.unwrap_or(0));
    }
}

/// Decodes, accounts, writes.
pub(super) struct Recorder<'a> {
    rig: &'a Rig,
    output: PathBuf,
    terms: Terms,
    decoder: Decoder<DeviceMessage>,
    accounting: Accounting,
    hello: Option<Hello>,
    /// What the device has told of itself last, and of each boot of which there are samples.
    newest_hello: Option<Hello>,
    boots: Vec<DeviceBoot>,
    recording: bool,
    /// Device's tick at which recording begins, once it is known.
    begin_at: Option<u32>,
    /// Ticks to wait before that.
    settle: u32,
    writer: Option<RecordWriter>,
    /// Instead of the samples.
    rows: Option<RowsRecorder>,
    estimates: Estimates,
    /// Whether the device identifies what this rig is.
    fits: bool,
    taken: Vec<Taken>,
    last_tick: Option<i64>,
    /// Nothing is written.
    dry: bool,
    ended: bool,
    /// Tick behind which the device restarted for the first time.
    restarted_behind: Option<i64>,
    /// What the device said, its first lines, and how many there were.
    lines: Vec<DeviceLine>,
    /// What moved the base, where the device told it.
    excited: Option<Excitation>,
    said: u64,
    /// A hello should be asked for.
    pub(super) ask_hello: bool,
    warnings: Vec<Warning>,
}

impl<'a> Recorder<'a> {
    /// Checks that the rig can be recorded.
    ///
    /// # Errors
    /// More channels than a device has encoders, or a channel that is neither counts nor the base.
    pub(super) fn new(rig: &'a Rig, output: &Path, terms: Terms) -> Result<Self> {
        let encoders = rig.channel.iter().filter(|c| c.measures != BASE);
        if encoders.clone().count() > MOST_ENCODERS {
            return Err(BadInput::new(
                format!("{} channels", encoders.count()),
                format!("at most {MOST_ENCODERS} encoders"),
            )
            .in_file(&rig.path)
            .at("channel")
            .remedy("The first [[channel]] is encoder 1, the second encoder 2"));
        }
        if let Some(c) = encoders.clone().find(|c| c.unit != "count") {
            return Err(BadInput::new(format!("unit \"{}\"", c.unit), "unit \"count\": a device sends encoder counts")
                .in_file(&rig.path)
                .at(format!("channel \"{}\"", c.name))
                .remedy("Give the channel unit = \"count\" and counts_per_turn"));
        }
        let unfit = estimates::unfit(rig);
        let fits = unfit.is_none();
        if let Some(error) = unfit.filter(|_| terms.rows) {
            return Err(error.remedy("Capture samples: leave --rows out"));
        }
        // Terms bound it to 1e7 s, rates are at most some kilohertz; it saturates beyond 49 days.
        let settle = (terms.settle_s * rig.sample_rate_hz).round() as u32;
        let limit = terms.seconds.map(|s| ((s * rig.sample_rate_hz).round() as i64).max(1));
        Ok(Self {
            rig,
            output: output.to_path_buf(),
            recording: false,
            begin_at: None,
            settle,
            decoder: Decoder::new(),
            accounting: Accounting::new(limit, (PATIENCE_S * rig.sample_rate_hz) as u64),
            hello: None,
            newest_hello: None,
            boots: Vec::new(),
            writer: None,
            rows: terms.rows.then(|| RowsRecorder::new(output.to_path_buf(), limit)),
            estimates: Estimates::new(output),
            fits,
            taken: Vec::new(),
            last_tick: None,
            dry: false,
            ended: false,
            restarted_behind: None,
            lines: Vec::new(),
            excited: None,
            said: 0,
            terms,
            ask_hello: false,
            warnings: Vec::new(),
        })
    }

    /// As [`Self::new`], to see what a record would hold: nothing is written.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(super) fn dry(rig: &'a Rig, output: &Path, terms: Terms) -> Result<Self> {
        Ok(Self { dry: true, ..Self::new(rig, output, terms)? })
    }

    /// Tick of the last sample of the record.
    ///
    /// # Errors
    /// A full disk.
    pub(super) fn into_last_tick(mut self) -> Result<Option<i64>> {
        self.accounting.finish(&mut self.taken);
        self.write()?;
        Ok(self.last_tick)
    }

    /// Begins anew, on other terms.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(super) fn renew(&mut self, change: impl FnOnce(&mut Terms)) -> Result<&Terms> {
        let mut terms = self.terms.clone();
        change(&mut terms);
        *self = Self::new(self.rig, &self.output.clone(), terms)?;
        Ok(&self.terms)
    }

    /// Takes one byte of the wire.
    ///
    /// # Errors
    /// A device of another protocol, encoder or rate; a full disk.
    pub(super) fn push(&mut self, byte: u8) -> Result<Option<Event>> {
        let event = match self.decoder.push(byte) {
            None => return Ok(None),
            // Fewer channels than the device has said that it has.
            Some(Ok(envelope)) if self.lacks(&envelope.message) => Event::Bad,
            Some(Ok(envelope)) => Event::Message(Box::new(envelope)),
            Some(Err(_)) => Event::Bad,
        };
        if !self.ended {
            self.take(&event)?;
        }
        Ok(Some(event))
    }

    /// The first ticks that are missing and may be had from the device.
    pub(super) fn gap(&self) -> Option<Gap> {
        if self.rows.is_some() || !self.recording || self.ended {
            return None;
        }
        let open = self.accounting.open()?;
        Some(Gap {
            boot_id: self.newest_hello.as_ref()?.boot_id,
            first_tick: self.accounting.device_tick(open.start)?,
            ticks: u32::try_from(open.end.abs_diff(open.start)).unwrap_or(u32::MAX),
        })
    }

    /// Whether samples go into the record.
    pub(super) fn recording(&self) -> bool {
        self.recording
    }

    /// Estimates of the device until now.
    pub(super) fn estimates(&self) -> u64 {
        self.estimates.count
    }

    /// The device's newest estimate.
    pub(super) fn newest_estimate(&self) -> Option<&DeviceEstimate> {
        self.estimates.last.as_ref()
    }

    /// Writes what the accounting let go.
    fn write(&mut self) -> Result<()> {
        if self.dry {
            self.last_tick = self.taken.last().map(|s| s.tick).or(self.last_tick);
            self.taken.clear();
            return Ok(());
        }
        if self.writer.is_none() && !self.taken.is_empty() {
            self.estimates.begin()?;
            self.writer = Some(RecordWriter::create(&self.output, &self.metadata(), self.rig)?);
        }
        if let Some(writer) = &mut self.writer {
            let mut counts = Vec::new();
            for s in self.taken.drain(..) {
                in_the_rigs_order(self.rig, &s.counts, &mut counts);
                if let Some(tick) = self.accounting.boot_before(s.tick) {
                    writer.boot(tick);
                    writer.device(&self.boots);
                }
                writer.push(&Sample { tick: s.tick, counts: &counts, phase: s.phase, amplitude_nm: s.amplitude_nm })?;
                self.last_tick = Some(s.tick);
            }
        }
        Ok(())
    }

    fn metadata(&self) -> Metadata {
        let of_hello = |f: fn(&Hello) -> &str| self.hello.as_ref().map(|h| f(h).to_owned()).unwrap_or_default();
        Metadata {
            rig: self.rig.text.clone(),
            firmware: of_hello(|h| h.firmware.as_str()),
            board: of_hello(|h| h.board.as_str()),
            started_at: self.terms.started_at.clone(),
            source: self.terms.source.clone(),
            written_by: concat!("whirl ", env!("CARGO_PKG_VERSION")).to_owned(),
            sample_rate_hz: self
                .hello
                .as_ref()
                .map_or(self.rig.sample_rate_hz, |h| f64::from(h.sample_rate_millihertz) / 1000.0),
            boots: Vec::new(),
            device: self.boots.clone(),
            lines: Vec::new(),
            excitation: self.excited,
            table: self.terms.table.clone(),
            level: self.terms.level,
        }
    }

    /// Whether the last sample to be recorded has come, or is known to be lost, and nothing before
    /// it is waited for.
    pub(super) fn reached_end(&self) -> bool {
        self.passed_end() && self.accounting.open().is_none()
    }

    /// Whether the device is behind the last sample to be recorded.
    pub(super) fn passed_end(&self) -> bool {
        if let Some(rows) = &self.rows {
            return rows.full;
        }
        self.accounting.end().zip(self.accounting.newest()).is_some_and(|(end, newest)| newest >= end)
    }

    /// Whether the recording is complete: the status behind the last sample has come too.
    pub(super) fn ended(&self) -> bool {
        self.ended
    }

    /// Nothing more is recorded.
    pub(super) fn close(&mut self) {
        self.ended = true;
    }

    /// Whether a sample is in the record or on its way.
    pub(super) fn has_samples(&self) -> bool {
        match &self.rows {
            Some(rows) => rows.windows > 0,
            None => self.accounting.first_tick().is_some(),
        }
    }

    /// Losses until now.
    pub(super) fn losses(&self) -> Losses {
        let losses = self.accounting.losses();
        match &self.rows {
            Some(rows) => {
                let missing = self.ticks().saturating_sub(rows.covered());
                let gaps = rows.runs().saturating_sub(1);
                Losses { received: rows.covered(), lost_on_link: missing, gaps, ..losses }
            }
            None => losses,
        }
    }

    /// Ticks from the first sample to behind the newest.
    pub(super) fn ticks(&self) -> u64 {
        let span = match &self.rows {
            Some(rows) => rows.last_tick().map(|tick| tick + 1).zip(rows.first_tick()),
            None => self.accounting.newest().zip(self.accounting.first_tick()),
        };
        span.map_or(0, |(newest, first)| newest.saturating_sub(first).unsigned_abs())
    }

    /// Device time to record, s.
    pub(super) fn seconds(&self) -> Option<f64> {
        self.terms.seconds
    }

    /// What is left to itself before the first sample, s.
    pub(super) fn settle_s(&self) -> f64 {
        self.terms.settle_s
    }

    /// Options of the command that a continuation must have too.
    pub(super) fn options(&self) -> &[String] {
        &self.terms.options
    }

    /// Where the samples come from.
    pub(super) fn source(&self) -> &str {
        &self.terms.source
    }
}

#[cfg(test)]
#[path = "recorder_tests.rs"]
mod tests;
