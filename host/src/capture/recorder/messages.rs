//! What each of a device's messages does to a recording.

use whirl_shared::frame::{BackFilled, DeviceMessage, Estimate, Hello, Log, Rows, SampleBlock, ShakerState, Status};

use super::{Event, Recorder};
use crate::capture::accounting::Verdict;
use crate::capture::device::{check_hello, level};
use crate::capture::estimates::DeviceEstimate;
use crate::capture::sieve::MOST_LINES;
use crate::error::Result;
use crate::record::{DeviceBoot, DeviceLine};

/// Boots that are told of: a device that restarts more often is broken.
const MOST_BOOTS: usize = 1000;

impl Recorder<'_> {
    /// Whether a block has fewer channels than the rig file.
    pub(super) fn lacks(&self, message: &DeviceMessage) -> bool {
        match message {
            DeviceMessage::Samples(block) | DeviceMessage::Restored(block) => {
                block.first.len() < self.rig.channel.len()
            }
            _ => false,
        }
    }

    pub(super) fn take(&mut self, event: &Event) -> Result<()> {
        match event {
            Event::Bad if self.recording => self.accounting.bad_frame(),
            Event::Bad => {}
            Event::Message(envelope) => match &envelope.message {
                DeviceMessage::Hello(hello) => self.hello(hello)?,
                DeviceMessage::Samples(block) => self.block(block)?,
                DeviceMessage::Status(status) => self.status(status),
                DeviceMessage::Estimate(estimate) => self.estimate(estimate)?,
                DeviceMessage::Rows(rows) => self.rows(rows)?,
                DeviceMessage::Log(log) => self.line(log),
                DeviceMessage::Restored(block) => self.restored(block)?,
                DeviceMessage::BackFilled(end) => self.back_filled(end)?,
                DeviceMessage::Excited(excited) => {
                    self.excited = Some(excited.excitation).filter(|excitation| !excitation.is_constant());
                }
                DeviceMessage::Ack(_) => {}
            },
        }
        Ok(())
    }

    fn hello(&mut self, hello: &Hello) -> Result<()> {
        check_hello(hello, self.rig)?;
        let restarted = self.accounting.hello(hello.boot_id, hello.tick)
            || self.rows.as_ref().is_some_and(|rows| rows.goes_back(hello.tick));
        if let Some(rows) = self.rows.as_mut().filter(|_| restarted) {
            rows.restarted();
        }
        if restarted && self.recording {
            self.restarted_behind.get_or_insert(self.accounting.newest().unwrap_or(0));
        }
        self.hello.get_or_insert_with(|| hello.clone());
        // The index mark is passed some time after a boot.
        let same = |boot: &&mut DeviceBoot| boot.boot_id == hello.boot_id && !self.accounting.is_restarting();
        if let Some(boot) = self.boots.last_mut().filter(same) {
            let now = DeviceBoot::of(hello, boot.tick);
            if now.has_zeros_of(boot, now.zeros.len()) {
                *boot = now;
            }
        }
        self.newest_hello = Some(hello.clone());
        Ok(())
    }

    fn line(&mut self, log: &Log) {
        self.said += 1;
        if self.lines.len() < MOST_LINES as usize {
            self.lines.push(DeviceLine {
                tick: self.on_line(log.tick),
                level: level(log.level).to_owned(),
                text: log.text.as_str().to_owned(),
            });
        }
    }

    /// A tick of the device on the record's line: the low 32 bits are the device's, but for
    /// restarts, which the next block puts right.
    fn on_line(&self, tick: u32) -> i64 {
        let newest = match &self.rows {
            Some(rows) => rows.last_tick(),
            None => self.accounting.newest(),
        };
        newest.map_or(i64::from(tick), |newest| {
            newest.saturating_sub(i64::from((newest as u32).wrapping_sub(tick).cast_signed()))
        })
    }

    fn status(&mut self, status: &Status) {
        self.accounting.status(status);
        if let Some((amplitude, frequency)) = self.terms.from_drive
            && status.shaker == ShakerState::Running
            && status.amplitude_nanometre == amplitude.saturating_mul(1000)
            && status.frequency_millihertz == frequency
        {
            self.begin_at.get_or_insert_with(|| status.tick.wrapping_add(self.settle));
        }
        if let Some(rows) = &mut self.rows
            && (self.terms.from_drive.is_none()
                || self.begin_at.is_some_and(|at| at.wrapping_sub(status.tick).cast_signed() <= 0))
        {
            rows.time(status.tick);
        }
        // The last word on overruns comes with the status behind the last sample.
        if self.reached_end() {
            self.ended = true;
        }
    }

    fn block(&mut self, block: &SampleBlock) -> Result<()> {
        if self.rows.is_some() || (self.terms.hello_first && self.hello.is_none()) {
            return Ok(());
        }
        if self.terms.from_drive.is_none() {
            self.begin_at.get_or_insert_with(|| block.first_tick.wrapping_add(self.settle));
        }
        // In wrapping arithmetic: not before that tick.
        self.recording |= self.begin_at.is_some_and(|at| block.first_tick.wrapping_sub(at).cast_signed() >= 0);
        if !self.recording {
            return Ok(());
        }
        if self.accounting.block(block, &mut self.taken) == Verdict::AskHello {
            self.ask_hello = true;
        }
        self.note_boot();
        self.write()
    }

    /// Takes what the device has sent again.
    fn restored(&mut self, block: &SampleBlock) -> Result<()> {
        if self.rows.is_none() && self.recording {
            self.accounting.restored(block, &mut self.taken);
        }
        self.write()
    }

    fn back_filled(&mut self, end: &BackFilled) -> Result<()> {
        if self.rows.is_none() && self.recording {
            self.accounting.back_filled(end, &mut self.taken);
        }
        self.write()
    }

    /// Keeps what the device told of a boot of which the first samples have come.
    fn note_boot(&mut self) {
        let first = self.accounting.first_tick().filter(|_| self.boots.is_empty());
        let Some(tick) = self.accounting.begun().or(first) else { return };
        if let Some(hello) = self.newest_hello.as_ref().filter(|_| self.boots.len() < MOST_BOOTS) {
            self.boots.push(DeviceBoot::of(hello, tick));
        }
    }

    fn rows(&mut self, rows: &Rows) -> Result<()> {
        if self.rows.is_none() || (self.terms.hello_first && self.hello.is_none()) {
            return Ok(());
        }
        // A message may claim anything.
        let start = rows.tick.wrapping_sub(rows.window_ticks).wrapping_add(1);
        if self.terms.from_drive.is_none() {
            self.begin_at.get_or_insert_with(|| start.wrapping_add(self.settle));
        }
        self.recording |= self.begin_at.is_some_and(|at| start.wrapping_sub(at).cast_signed() >= 0);
        if !self.recording {
            return Ok(());
        }
        let metadata = self.metadata();
        let Some(recorder) = &mut self.rows else { return Ok(()) };
        if recorder.windows == 0 {
            self.estimates.begin()?;
        }
        recorder.push(rows, || metadata)
    }

    /// Takes an estimate of the device, if its newest window lies in the record.
    fn estimate(&mut self, estimate: &Estimate) -> Result<()> {
        let first = match &self.rows {
            Some(rows) => rows.first_tick(),
            None => self.accounting.first_tick(),
        };
        let Some(first) = first.filter(|_| self.fits && self.recording && !self.dry) else { return Ok(()) };
        let tick = self.on_line(estimate.tick);
        if tick < first.saturating_add(i64::from(estimate.window_ticks)) - 1 {
            return Ok(());
        }
        let rate = self.metadata().sample_rate_hz;
        self.estimates.push(DeviceEstimate::new(estimate, tick, rate))
    }
}
