//! What a live capture does with what it hears: frame by frame into journal and record, and answers
//! to it.

use std::time::{Duration, Instant};

use whirl_shared::codec::FrameError;
use whirl_shared::frame::{Command, DeviceMessage, Log, SampleBlock, SettingsSource, Streamed};

use super::device::{check_drive, check_hello, level};
use super::journal::{End, Journal};
use super::level::{self, Verdict};
use super::live::Session;
use super::no_device::Heard;
use super::recorder::Recorder;
use super::sieve::{Frame, Sieve};
use crate::error::{Result, plain};
use crate::record::DeviceBoot;

/// Time between keep-alives; also a quarter of the device's time-out, by its own clock.
const KEEP_ALIVE: Duration = Duration::from_millis(250);
/// Lines of a device that are shown while it is captured; all that are kept are in the record.
const MOST_SHOWN: u32 = 100;

impl Session<'_> {
    /// Takes bytes of the device: frame by frame, first into the journal, then into the record.
    pub(super) fn take(&mut self, bytes: &[u8], recorder: &mut Recorder<'_>) -> Result<()> {
        self.bytes += bytes.len() as u64;
        self.heard.bytes += bytes.len() as u64;
        for &byte in bytes {
            let Some(frame) = self.sieve.push(byte) else { continue };
            if !self.gate.is_open() && !self.knock(&frame) {
                self.hear(&frame);
                continue;
            }
            if let Ok(DeviceMessage::Hello(hello)) = frame.message.as_ref().map(|envelope| &envelope.message) {
                // One that does not fit ends the capture, and must not stand in the way of resuming
                // it.
                check_hello(hello, self.rig).map_err(|e| e.in_file(&self.settings.from))?;
                if let Some(target) = self.drive.target() {
                    check_drive(hello, target, self.rig)?;
                }
            }
            let recorded = frame.recorded && self.level.is_none();
            if let (true, false, Some(journal)) = (recorded, recorder.ended(), &mut self.journal) {
                journal.write(&frame.bytes)?;
                for &byte in &frame.bytes {
                    recorder.push(byte).map_err(|e| e.in_file(&self.settings.from))?;
                }
            }
            if let Ok(DeviceMessage::Samples(block)) = frame.message.as_ref().map(|envelope| &envelope.message) {
                self.level_by(block, recorder)?;
            }
            self.event(frame).map_err(|e| e.in_file(&self.settings.from))?;
        }
        Ok(())
    }

    /// Levels the amplitude by what the base's channel shows; then journal and record begin, on the
    /// terms that came out.
    fn level_by(&mut self, block: &SampleBlock, recorder: &mut Recorder<'_>) -> Result<()> {
        let (Some(leveller), Some(hello), Some(target)) = (&mut self.level, &self.hello, self.drive.target()) else {
            return Ok(());
        };
        // At the end, or after a fault, it is nobody's any more.
        if recorder.ended() || self.drive.stopping() {
            return Ok(());
        }
        let now = self.source.now();
        match leveller.block(block, level::most(hello, target))? {
            Verdict::Waiting => {}
            Verdict::Command(micrometre) => self.drive.adjust(micrometre, &mut self.commands, now),
            Verdict::Level(level) => {
                self.level = None;
                self.notices.push(level::told(&level));
                let terms = recorder.renew(|terms| {
                    terms.from_drive = Some((target.amplitude_micrometre(), target.frequency_millihertz()));
                    terms.level = Some(level);
                })?;
                if let Some(journal) = self.journal.take() {
                    journal.finish(End::Removed)?;
                }
                self.journal = Some(Journal::create(&self.settings.output, terms)?);
                // What was told before is to be told again.
                self.sieve = Sieve::default();
                self.commands.send(Command::Hello);
                self.commands.send(Command::Status);
            }
        }
        Ok(())
    }

    /// Whether this frame opens the gate: with it, all begins.
    fn knock(&mut self, frame: &Frame) -> bool {
        let opens = frame.message.as_ref().is_ok_and(|envelope| self.gate.opens(&envelope.message));
        if opens {
            self.sieve = Sieve::default();
            self.stall.over(self.source.now());
        }
        opens
    }

    /// Counts a frame as heard, or as noise.
    fn hear(&mut self, frame: &Frame) {
        match &frame.message {
            Err(e) => {
                self.heard.bad += 1;
                self.heard.foreign += u64::from(*e == FrameError::Malformed);
            }
            Ok(_) => {
                self.last_good = self.source.now();
                self.heard = Heard::default();
            }
        }
    }

    fn event(&mut self, frame: Frame) -> Result<()> {
        self.hear(&frame);
        let now = self.source.now();
        if frame.new {
            self.stall.over(now);
        }
        let Ok(envelope) = frame.message else { return Ok(()) };
        self.reconnections += u64::from(core::mem::take(&mut self.reopened));
        self.retry.1 = Duration::from_millis(50);
        if let Some(feeder) = &mut self.feeder {
            feeder.message(&envelope.message);
        }
        match envelope.message {
            DeviceMessage::Hello(hello) => {
                self.device_tick = hello.tick;
                if self.settings.rows {
                    self.stream(now);
                }
                self.drive.start(&hello, &mut self.commands, now);
                if let Some(before) = self.hello.as_ref().filter(|before| before.boot_id != hello.boot_id) {
                    let restart = DeviceBoot::of(&hello, 0).after(&DeviceBoot::of(before, 0));
                    self.notice(format!("the device restarted: {restart}"));
                }
                if self.hello.is_none() && hello.settings == SettingsSource::Refused {
                    self.notices.push(
                        "warning: the settings in the device's flash are not possible on this board: it runs with those of its \
                         image (`whirl device show`)"
                            .to_owned(),
                    );
                }
                if self.hello.is_none() {
                    // The zero of the device's counters.
                    self.commands.send(Command::Status);
                }
                self.hello = Some(hello);
            }
            DeviceMessage::Samples(block) => {
                self.device_tick = block.first_tick;
                if self.settings.rows && self.hello.is_some() {
                    self.stream(now);
                }
            }
            DeviceMessage::Rows(rows) => {
                self.device_tick = rows.tick;
                if !self.settings.rows && self.hello.is_some() {
                    self.stream(now);
                }
            }
            DeviceMessage::Status(status) => {
                if self.settings.rows && self.device_tick != status.tick {
                    // Rows are seldom: the sampler's clock shows that it works.
                    self.stall.over(now);
                }
                self.device_tick = status.tick;
                self.drive.status(&status, &mut self.commands, now)?;
            }
            DeviceMessage::Ack(ack) => {
                let outcome = self.commands.ack(&ack);
                self.drive.outcome(outcome, &mut self.commands, now)?;
            }
            DeviceMessage::Log(log) => self.show(&log),
            DeviceMessage::Restored(_) => self.back_fill.heard(now),
            DeviceMessage::BackFilled(_) => self.back_fill.over(),
            DeviceMessage::Estimate(_) | DeviceMessage::Excited(_) => {}
        }
        Ok(())
    }

    /// Shows a line of the device.
    fn show(&mut self, log: &Log) {
        self.notice(format!("the device says ({}, tick {}): {}", level(log.level), log.tick, plain(&log.text)));
    }

    /// Shows what the device says or does, as long as it is not too much.
    fn notice(&mut self, text: String) {
        self.shown = self.shown.saturating_add(1);
        if self.shown <= MOST_SHOWN {
            self.notices.push(text);
        } else if self.shown == MOST_SHOWN + 1 {
            self.notices.push("the device says more, which is not shown: the record has the first lines".to_owned());
        }
    }

    /// Tells the device what to stream, not more often than it can answer: what comes shows whether
    /// it has heard.
    fn stream(&mut self, now: Instant) {
        if self.streamed.is_none_or(|t| now.duration_since(t) > Duration::from_millis(300)) {
            let streamed = if self.settings.rows { Streamed::Rows } else { Streamed::Samples };
            self.commands.send(Command::Stream(streamed));
            self.streamed = Some(now);
        }
    }

    /// Tells the device that the host is there, by the host's clock and by the device's (a
    /// simulated one may be faster).
    pub(super) fn keep_alive(&mut self, now: Instant) {
        let by_device = self.hello.as_ref().is_some_and(|h| {
            let quarter = u64::from(h.host_timeout_ms) * u64::from(h.sample_rate_millihertz) / 4_000_000;
            u64::from(self.device_tick.wrapping_sub(self.alive_tick)) >= quarter.max(1)
        });
        if by_device || now.duration_since(self.last_alive) > KEEP_ALIVE {
            self.commands.send(Command::KeepAlive);
            self.last_alive = now;
            self.alive_tick = self.device_tick;
        }
    }
}
