//! A capture from a device that lives: hello, drive, keep-alives, reconnection, orderly end.

use std::io::ErrorKind;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use whirl_shared::codec::FrameError;
use whirl_shared::frame::{Command, DeviceMessage, Hello, Streamed};

use super::commands::Commands;
use super::drive::{Drive, Target};
use super::journal::{Journal, Terms, path_of};
use super::no_device::{Heard, Wire};
use super::recorder::{Event, Recorder};
use super::source::{Link, Source};
use super::{CaptureOutcome, CaptureSettings, Progress, outcome};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::warning::Warning;

/// Without a good frame for this long, a link is taken as lost and opened anew.
const SILENCE: Duration = Duration::from_millis(2500);
/// How long the status behind the last sample is waited for.
const LAST_STATUS: Duration = Duration::from_millis(2500);
/// How long the shaker's end is waited for.
const STOPPING: Duration = Duration::from_secs(5);
/// Time between keep-alives; also a quarter of the device's time-out, by its own clock.
const KEEP_ALIVE: Duration = Duration::from_millis(250);

struct Session<'a> {
    settings: &'a CaptureSettings,
    rig: &'a Rig,
    source: &'a mut dyn Source,
    link: Option<Box<dyn Link>>,
    commands: Commands,
    drive: Drive,
    journal: Option<Journal>,
    hello: Option<Hello>,
    heard: Heard,
    bytes: u64,
    reconnections: u64,
    /// The link was opened anew and nothing good has come yet.
    reopened: bool,
    last_good: Instant,
    last_alive: Instant,
    /// Device's tick at the last keep-alive, and now.
    alive_tick: u32,
    device_tick: u32,
    /// When the device was last told what to stream.
    streamed: Option<Instant>,
    /// When the link is to be opened next, and the pause after that.
    retry: (Instant, Duration),
    lost_because: String,
}

/// Captures until the end, a fault or the stop flag.
pub(super) fn run(
    settings: &CaptureSettings,
    rig: &Rig,
    source: &mut dyn Source,
    target: Option<Target>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<CaptureOutcome> {
    let terms = Terms {
        source: settings.from.clone(),
        started_at: (!source.is_simulated()).then(date),
        seconds: settings.seconds,
        from_drive: target
            .filter(|_| settings.wait_for_drive)
            .map(|t| (t.amplitude_micrometre, t.frequency_millihertz)),
        settle_s: settings.settle_s.unwrap_or_else(|| source.settle_s()),
        hello_first: true,
        rows: settings.rows,
    };
    let mut recorder = Recorder::new(rig, &settings.output, terms.clone())?;
    let now = Instant::now();
    let link = source
        .open()
        .map_err(|e| BadInput::new(e.to_string(), "a device").in_file(&settings.from).remedy(source.remedy()))?;
    let journal = Journal::create(&settings.output, &terms)?;
    let mut session = Session {
        settings,
        rig,
        source,
        link: Some(link),
        commands: Commands::new(),
        drive: Drive::new(target, settings.restart_drive, now),
        journal: Some(journal),
        hello: None,
        heard: Heard::default(),
        bytes: 0,
        reconnections: 0,
        reopened: false,
        last_good: now,
        last_alive: now,
        alive_tick: 0,
        device_tick: 0,
        streamed: None,
        retry: (now, Duration::from_millis(50)),
        lost_because: String::new(),
    };
    // A zero ends whatever the device may have of a cut frame.
    session.commands.reconnected(now);
    let result = session.capture(&mut recorder, progress);
    session.stop_drive(&mut recorder);
    session.finish(recorder, result)
}

/// Now, RFC 3339, to the second.
fn date() -> String {
    let now = jiff::Timestamp::now();
    now.round(jiff::Unit::Second).unwrap_or(now).to_string()
}

impl Session<'_> {
    /// Records until the end, the stop flag or a fault.
    fn capture(&mut self, recorder: &mut Recorder<'_>, progress: &mut dyn FnMut(&Progress)) -> Result<()> {
        let begun = self.source.now();
        // People's time.
        let mut told = Instant::now();
        let (mut asked, mut reached) = (None::<Instant>, None::<Instant>);
        loop {
            self.turn(recorder)?;
            if let Some(error) = self.source.failed() {
                return Err(error);
            }
            let now = self.source.now();
            if recorder.ended() || self.settings.stop.load(Ordering::Relaxed) {
                return Ok(());
            }
            if self.hello.is_none() || recorder.ask_hello {
                if asked.is_none_or(|t| now.duration_since(t) > Duration::from_millis(500)) {
                    self.commands.send(Command::Hello);
                    asked = Some(now);
                    recorder.ask_hello = false;
                }
                if self.hello.is_none() && now.duration_since(begun).as_secs_f64() > self.settings.handshake_s {
                    return Err(self.wire().no_hello(now.duration_since(begun).as_secs_f64()));
                }
            }
            if recorder.reached_end() {
                if reached.is_none() {
                    self.commands.send(Command::Status);
                }
                if now.duration_since(*reached.get_or_insert(now)) > LAST_STATUS {
                    return Ok(());
                }
            }
            if self.hello.is_some() && self.link.is_some() {
                self.drive.poll(&mut self.commands, now)?;
                self.keep_alive(now);
            }
            let down = now.duration_since(self.last_good);
            if self.hello.is_some() && down.as_secs_f64() > self.settings.reconnect_s + SILENCE.as_secs_f64() {
                return Err(self.wire().lost(down, self.settings.reconnect_s));
            }
            if told.elapsed() > Duration::from_millis(200) {
                told = Instant::now();
                progress(&self.progress(recorder));
            }
        }
    }

    /// Sends what is to be sent, reads once and takes what came.
    fn turn(&mut self, recorder: &mut Recorder<'_>) -> Result<()> {
        let now = self.source.now();
        if self.link.is_none() {
            return self.reopen(recorder, now);
        }
        let outcome = self.commands.poll(now);
        self.drive.outcome(outcome, &mut self.commands, now)?;
        let Some(link) = &mut self.link else { return Ok(()) };
        let out = self.commands.take_bytes();
        let mut buffer = [0; 4096];
        let read = if out.is_empty() { Ok(()) } else { link.write_all(&out) }.and_then(|()| link.read(&mut buffer));
        match read {
            Ok(0) => self.lose("the stream ended".to_owned(), now),
            Ok(n) => return self.take(&buffer[..n], recorder),
            Err(e) if matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                if self.hello.is_some() && now.duration_since(self.last_good) > SILENCE && now >= self.retry.0 {
                    self.lose("no good frame came any more".to_owned(), now);
                }
            }
            Err(e) => self.lose(e.to_string(), now),
        }
        Ok(())
    }

    /// Takes bytes of the device: first into the journal, up to where the recording ends.
    fn take(&mut self, bytes: &[u8], recorder: &mut Recorder<'_>) -> Result<()> {
        self.bytes += bytes.len() as u64;
        self.heard.bytes += bytes.len() as u64;
        let mut recorded = 0;
        let mut result = Ok(());
        for &byte in bytes {
            let ended = recorder.ended();
            let event = recorder.push(byte);
            recorded += usize::from(!ended);
            result = match event {
                Ok(None) => Ok(()),
                Ok(Some(event)) => self.event(event),
                Err(e) => Err(e),
            };
            if result.is_err() {
                break;
            }
        }
        if let Some(journal) = &mut self.journal {
            journal.write(&bytes[..recorded])?;
        }
        result.map_err(|e| e.in_file(&self.settings.from))
    }

    fn event(&mut self, event: Event) -> Result<()> {
        let now = self.source.now();
        let envelope = match event {
            Event::Bad(e) => {
                self.heard.bad += 1;
                self.heard.foreign += u64::from(e == FrameError::Malformed);
                return Ok(());
            }
            Event::Message(envelope) => envelope,
        };
        self.reconnections += u64::from(core::mem::take(&mut self.reopened));
        self.last_good = now;
        self.heard = Heard::default();
        self.retry.1 = Duration::from_millis(50);
        match envelope.message {
            DeviceMessage::Hello(hello) => {
                self.device_tick = hello.tick;
                if self.settings.rows {
                    self.stream(now);
                }
                self.drive.start(&hello, &mut self.commands, now);
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
                self.device_tick = status.tick;
                self.drive.status(&status, &mut self.commands, now)?;
            }
            DeviceMessage::Ack(ack) => {
                let outcome = self.commands.ack(&ack);
                self.drive.outcome(outcome, &mut self.commands, now)?;
            }
            DeviceMessage::Log(_) | DeviceMessage::Estimate(_) => {}
        }
        Ok(())
    }

    /// Tells the device what to stream, not more often than it can answer: what comes shows whether it has heard.
    fn stream(&mut self, now: Instant) {
        if self.streamed.is_none_or(|t| now.duration_since(t) > Duration::from_millis(300)) {
            let streamed = if self.settings.rows { Streamed::Rows } else { Streamed::Samples };
            self.commands.send(Command::Stream(streamed));
            self.streamed = Some(now);
        }
    }

    /// Tells the device that the host is there, by the host's clock and by the device's (a simulated one may be faster).
    fn keep_alive(&mut self, now: Instant) {
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

    fn lose(&mut self, why: String, now: Instant) {
        self.link = None;
        self.lost_because = why;
        self.retry.0 = now + self.retry.1;
    }

    /// Opens a lost link when its time has come.
    fn reopen(&mut self, recorder: &mut Recorder<'_>, now: Instant) -> Result<()> {
        if now < self.retry.0 {
            // Short, so that Ctrl-C is heard.
            self.source.pause(Duration::from_millis(10).min(self.retry.0 - now));
            return Ok(());
        }
        self.retry = (now + self.retry.1, (self.retry.1 * 2).min(Duration::from_secs(2)));
        match self.source.open() {
            Err(e) => self.lost_because = e.to_string(),
            Ok(link) => {
                self.link = Some(link);
                self.reopened = true;
                self.heard = Heard::default();
                self.retry.0 = now + SILENCE;
                self.commands.reconnected(now);
                self.drive.reconnected(now)?;
                self.commands.send(Command::Hello);
                // The frame that was cut must not spoil the next one.
                self.take(&[0], recorder)?;
                self.bytes -= 1;
            }
        }
        Ok(())
    }

    /// Brings the shaker to rest, whatever has happened before.
    fn stop_drive(&mut self, recorder: &mut Recorder<'_>) {
        if self.settings.rows && self.link.is_some() {
            // The next capture finds samples.
            self.commands.send(Command::Stream(Streamed::Samples));
            if !self.drive.active() {
                // Nobody waits for an answer.
                let _ = self.turn_after_end(recorder);
            }
        }
        if !self.drive.active() || self.link.is_none() {
            return;
        }
        let begun = self.source.now();
        self.drive.stop(&mut self.commands, begun);
        while !self.drive.off() && self.link.is_some() && self.source.now().duration_since(begun) < STOPPING {
            // The record is over; only answers are of interest, and a fault here has nobody to be told to who does not
            // know of it: the device's watchdog stops the shaker.
            let journal = self.journal.take();
            let result = self.turn_after_end(recorder);
            self.journal = journal;
            if result.is_err() {
                return;
            }
        }
    }

    /// As [`Session::turn`], with nothing recorded.
    fn turn_after_end(&mut self, recorder: &mut Recorder<'_>) -> Result<()> {
        recorder.close();
        self.turn(recorder)?;
        self.drive.poll(&mut self.commands, self.source.now())
    }

    fn progress(&self, recorder: &Recorder<'_>) -> Progress {
        let state = if self.link.is_none() {
            "link lost, trying again"
        } else if self.hello.is_none() {
            "waiting for the device"
        } else if self.drive.starting() {
            "starting the drive"
        } else {
            "recording"
        };
        let lost = recorder.losses().lost();
        Progress {
            state,
            samples: recorder.ticks().saturating_sub(lost),
            lost,
            device_s: recorder.ticks() as f64 / self.rig.sample_rate_hz,
            target_s: self.settings.seconds,
            estimate: recorder.newest_estimate().map(super::estimates::DeviceEstimate::brief),
        }
    }

    fn wire(&self) -> Wire<'_> {
        Wire {
            from: &self.settings.from,
            open: self.link.is_some(),
            bytes: self.bytes,
            heard: self.heard,
            lost_because: &self.lost_because,
            remedy: self.source.remedy(),
        }
    }

    /// Ends record and journal.
    fn finish(mut self, recorder: Recorder<'_>, result: Result<()>) -> Result<CaptureOutcome> {
        let recorded = recorder.has_samples();
        let finished = recorder.finish();
        let journal = self.journal.take();
        let frames = path_of(&self.settings.output);
        let finished = match finished {
            Ok(finished) => finished,
            // The record is not whole: the journal is what is left.
            Err(e) => {
                let remedy = format!(
                    "{}. Its bytes are safe: `whirl capture --from file:{} --rig RIG.toml -o REC` makes the record again",
                    e.remedy,
                    frames.display()
                );
                return Err(e.remedy(remedy));
            }
        };
        if let Some(journal) = journal {
            journal.finish(recorded && self.settings.keep_frames)?;
        }
        if let Err(e) = result {
            let remedy = if recorded {
                format!(
                    "{}. {} samples until then are in {}",
                    e.remedy,
                    finished.losses.received,
                    self.settings.output.display()
                )
            } else {
                e.remedy.clone()
            };
            return Err(e.remedy(remedy));
        }
        let Some(done) = outcome(self.settings, finished, self.settings.seconds) else {
            return Err(BadInput::new("no sample", "samples before the end of the capture")
                .in_file(&self.settings.from)
                .remedy("Let it run for longer; with a drive, recording starts when the shaker runs"));
        };
        let mut warnings = done.warnings;
        warnings.append(&mut self.drive.warnings);
        if self.reconnections > 0 {
            warnings.push(Warning::new(
                "reconnected",
                format!("the link was lost {} times (last: {})", self.reconnections, self.lost_because),
                "The gaps are marked and counted; see to the cable",
            ));
        }
        Ok(CaptureOutcome {
            frames: self.settings.keep_frames.then_some(frames),
            bytes: self.bytes,
            reconnections: self.reconnections,
            warnings,
            ..done
        })
    }
}
