//! A capture from a device that lives: hello, drive, keep-alives, reconnection, orderly end.

use std::io::ErrorKind;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use whirl_shared::excitation::Law;
use whirl_shared::frame::{Command, Hello};

use super::back_fill::{self, BackFill};
use super::commands::Commands;
use super::device::check_hello;
use super::drive::{Drive, Target};
use super::feed::Feeder;
use super::gate::Gate;
use super::interrupted;
use super::journal::{Journal, Terms, essentials};
use super::level::Leveller;
use super::no_device::{Heard, Wire};
use super::precision::Progression;
use super::recorder::Recorder;
use super::sieve::Sieve;
use super::source::{Link, Source};
use super::stall::Stall;
use super::{CaptureOutcome, CaptureSettings, Progress};
use crate::error::{BadInput, Result, io_words, plain};
use crate::rig::Rig;
use crate::warning::Warning;

/// Without a good frame for this long, a link is taken as lost and opened anew.
pub(super) const SILENCE: Duration = Duration::from_millis(2500);
/// How long the status behind the last sample is waited for.
const LAST_STATUS: Duration = Duration::from_millis(2500);
/// How long the shaker's end is waited for.
pub(super) const STOPPING: Duration = Duration::from_secs(5);

pub(super) struct Session<'a> {
    pub(super) settings: &'a CaptureSettings,
    pub(super) rig: &'a Rig,
    pub(super) source: &'a mut dyn Source,
    pub(super) link: Option<Box<dyn Link>>,
    pub(super) commands: Commands,
    pub(super) drive: Drive,
    /// Until the amplitude is level, nothing is recorded.
    pub(super) level: Option<Leveller>,
    pub(super) back_fill: BackFill,
    pub(super) journal: Option<Journal>,
    pub(super) sieve: Sieve,
    pub(super) gate: Gate,
    pub(super) stall: Stall,
    pub(super) hello: Option<Hello>,
    pub(super) heard: Heard,
    pub(super) bytes: u64,
    pub(super) reconnections: u64,
    /// What was noticed of an earlier, interrupted capture.
    pub(super) resumed: Option<Warning>,
    /// What is to be shown at once, and how many of the device's lines were.
    pub(super) notices: Vec<String>,
    pub(super) shown: u32,
    /// The link was opened anew and nothing good has come yet.
    pub(super) reopened: bool,
    pub(super) last_good: Instant,
    pub(super) last_alive: Instant,
    /// Device's tick at the last keep-alive, and now.
    pub(super) alive_tick: u32,
    pub(super) device_tick: u32,
    /// When the device was last told what to stream.
    pub(super) streamed: Option<Instant>,
    /// When the link is to be opened next, and the pause after that.
    pub(super) retry: (Instant, Duration),
    pub(super) lost_because: String,
    /// Where people look on.
    pub(super) feeder: Option<Feeder>,
    /// What the end waits for, and the estimates that were taken into it.
    pub(super) until: Option<Progression>,
    pub(super) estimates: u64,
}

/// Captures until the end, a fault or the stop flag.
pub(super) fn run(
    settings: &CaptureSettings,
    rig: &Rig,
    source: &mut dyn Source,
    target: Option<Target>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<CaptureOutcome> {
    let resumed = if settings.resume { interrupted::to_resume(settings, rig, target)? } else { None };
    let going_on = resumed.is_some();
    let terms = resumed.unwrap_or_else(|| Terms {
        source: settings.from.clone(),
        started_at: (!source.is_simulated()).then(date),
        seconds: settings.seconds,
        from_drive: target
            .filter(|_| settings.wait_for_drive)
            .map(|t| (t.amplitude_micrometre(), t.frequency_millihertz())),
        settle_s: settings.settle_s.unwrap_or_else(|| settle_s(&*source, target)),
        hello_first: true,
        rows: settings.rows,
        table: target.and_then(|t| t.1).map(|table| table.points().to_vec()).unwrap_or_default(),
        level: None,
        options: interrupted::options(settings),
        rig: essentials(rig, target),
    });
    let mut target = target;
    // What was levelled before the interruption stays so.
    if let (Some(level), Some(target)) = (terms.level, &mut target) {
        target.0.amplitudes_micrometre[0] = (level.commanded_m * 1e6).round() as u32;
    }
    let level = target.filter(|_| settings.level && terms.level.is_none()).and_then(|t| Leveller::new(rig, t));
    let mut recorder = Recorder::new(rig, &settings.output, terms.clone())?;
    if going_on {
        source.resumed();
    }
    let link = source
        .open()
        .map_err(|e| BadInput::new(io_words(&e), "a device").in_file(&settings.from).remedy(source.remedy()))?;
    let (journal, noticed) = if going_on {
        (interrupted::take_up(&mut recorder, &settings.output)?, interrupted::noticed(settings, &recorder))
    } else {
        interrupted::begin(settings, rig, &terms)?
    };
    let now = source.now();
    // Commands of an earlier session may still be answered: see `gate`.
    let first = if source.is_simulated() { 0 } else { numbers_from() };
    let mut session = Session {
        settings,
        rig,
        source,
        link: Some(link),
        commands: Commands::new(first),
        level,
        drive: Drive::new(target, settings.restart_drive, now),
        back_fill: BackFill::default(),
        journal: Some(journal),
        sieve: Sieve::default(),
        gate: Gate::default(),
        stall: Stall::new(now),
        hello: None,
        heard: Heard::default(),
        bytes: 0,
        reconnections: 0,
        resumed: noticed,
        notices: Vec::new(),
        shown: 0,
        reopened: false,
        last_good: now,
        last_alive: now,
        alive_tick: 0,
        device_tick: 0,
        streamed: None,
        retry: (now, Duration::from_millis(50)),
        lost_because: String::new(),
        feeder: settings.feed.clone().map(Feeder::new),
        until: settings.until.clone().map(Progression::new),
        estimates: 0,
    };
    // A zero ends whatever the device may have of a cut frame.
    session.commands.reconnected(now);
    let result = session.capture(&mut recorder, progress);
    session.stop_drive(&mut recorder);
    session.tell(&recorder, progress);
    session.finish(recorder, result)
}

/// What is left to itself before recording, s: nothing where the drive goes on to other frequencies
/// or amplitudes meanwhile.
fn settle_s(source: &dyn Source, target: Option<Target>) -> f64 {
    let goes_on = target.is_some_and(|t| t.0.glide.law != Law::Steady || t.0.steps > 1);
    if goes_on { 0.0 } else { source.settle_s() }
}

/// A number that another session hardly began with.
pub(super) fn numbers_from() -> u16 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    // Its low bits, in steps of a microsecond.
    let number = (since.as_micros() ^ u128::from(std::process::id())) as u16;
    // Not near 0, where a session that numbers its messages plainly begins.
    number | 0x0400
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
        if recorder.ended() {
            // All of a capture that was to be resumed was there already.
            return Ok(());
        }
        // People's time.
        let mut told = Instant::now();
        let (mut asked, mut passed, mut reached) = (None::<Instant>, None::<Instant>, None::<Instant>);
        loop {
            self.turn(recorder)?;
            if let Some(error) = self.source.failed() {
                return Err(error);
            }
            let now = self.source.now();
            if recorder.ended() || self.settings.stop.load(Ordering::Relaxed) || self.is_precise(recorder) {
                return Ok(());
            }
            if self.hello.is_none() || recorder.ask_hello {
                if asked.is_none_or(|t| now.duration_since(t) > Duration::from_millis(500)) {
                    self.ask_hello();
                    asked = Some(now);
                    recorder.ask_hello = false;
                }
                if self.hello.is_none() && now.duration_since(begun).as_secs_f64() > self.settings.handshake_s {
                    if let Some(hello) = &self.gate.stranger {
                        // One of another protocol does not answer.
                        check_hello(hello, self.rig).map_err(|e| e.in_file(&self.settings.from))?;
                    }
                    return Err(self.wire().no_hello(now.duration_since(begun).as_secs_f64()));
                }
            }
            if recorder.reached_end() {
                if reached.is_none() {
                    // An index mark may have been passed since the last hello.
                    self.commands.send(Command::Hello);
                    self.commands.send(Command::Status);
                }
                if now.duration_since(*reached.get_or_insert(now)) > LAST_STATUS {
                    return Ok(());
                }
            }
            if self.hello.is_some() && self.link.is_some() {
                self.drive.poll(&mut self.commands, now)?;
                self.keep_alive(now);
                if let Some(command) = self.back_fill.ask(recorder.gap(), now) {
                    self.commands.send(command);
                }
            }
            if recorder.passed_end() && !recorder.reached_end() {
                if passed.is_none() {
                    // What is still to be restored needs no drive.
                    self.drive.stop(&mut self.commands, now);
                }
                let since = now.duration_since(*passed.get_or_insert(now));
                let stalled = self.stall.lasts(now).as_secs_f64() > self.settings.reconnect_s;
                if stalled || since > back_fill::LONGEST {
                    return Ok(());
                }
            }
            self.watch(now)?;
            if told.elapsed() > Duration::from_millis(200) {
                told = Instant::now();
                self.tell(recorder, progress);
            }
        }
    }

    /// Tells of a device that brings nothing new, and gives it up in time.
    fn watch(&mut self, now: Instant) -> Result<()> {
        if self.hello.is_none() {
            return Ok(());
        }
        let (down, stalled) = (now.duration_since(self.last_good), self.stall.lasts(now));
        let limit = self.settings.reconnect_s + SILENCE.as_secs_f64();
        // Silent altogether, or without a link.
        let lost = self.link.is_none() || 2 * down > stalled;
        if stalled.as_secs_f64() > limit {
            let wire = self.wire();
            return Err(if lost { wire.lost(stalled, self.settings.reconnect_s) } else { wire.stalled(stalled) });
        }
        if self.stall.is_to_be_reported(now) {
            let why = if lost { "the link is silent" } else { "the device answers, but brings nothing new" };
            let limit = self.settings.reconnect_s;
            self.notices.push(format!(
                "warning: no new sample for {:.1} s: {why}. It is given up after {limit} s more (--reconnect-s)",
                stalled.as_secs_f64()
            ));
        }
        Ok(())
    }

    /// Asks for a hello.
    fn ask_hello(&mut self) {
        let sequence = self.commands.send(Command::Hello);
        self.gate.asked(sequence);
    }

    /// Sends what is to be sent, reads once and takes what came.
    pub(super) fn turn(&mut self, recorder: &mut Recorder<'_>) -> Result<()> {
        let now = self.source.now();
        self.be_seen(recorder, now);
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
            Err(e) => self.lose(io_words(&e), now),
        }
        Ok(())
    }

    fn lose(&mut self, why: String, now: Instant) {
        self.link = None;
        self.lost_because = plain(&why);
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
            Err(e) => self.lost_because = plain(&io_words(&e)),
            Ok(link) => {
                self.link = Some(link);
                self.reopened = true;
                self.heard = Heard::default();
                self.retry.0 = now + SILENCE;
                self.commands.reconnected(now);
                self.back_fill.over();
                self.drive.reconnected(now)?;
                self.ask_hello();
                // The frame that was cut must not spoil the next one.
                self.take(&[0], recorder)?;
                self.bytes -= 1;
            }
        }
        Ok(())
    }

    pub(super) fn progress(&self, recorder: &Recorder<'_>) -> Progress {
        let state = if self.drive.stopping() {
            "stopping the drive"
        } else if self.link.is_none() {
            "link lost, trying again"
        } else if self.stall.is_reported() {
            "no new samples"
        } else if self.hello.is_none() {
            "waiting for the device"
        } else if self.drive.starting() {
            "starting the drive"
        } else if self.level.is_some() {
            "levelling the amplitude"
        } else if !recorder.recording() {
            "settling"
        } else if self.back_fill.is_under_way() {
            "recording, and asking for what the link lost"
        } else {
            "recording"
        };
        let lost = recorder.losses().lost();
        Progress {
            state,
            samples: recorder.ticks().saturating_sub(lost),
            lost,
            device_s: recorder.ticks() as f64 / self.rig.sample_rate_hz,
            target_s: recorder.seconds(),
            estimate: match self.precision(recorder) {
                Some(precision) => Some(precision.words()),
                None => recorder.newest_estimate().map(super::estimates::DeviceEstimate::brief),
            },
            notices: self.notices.clone(),
        }
    }

    fn wire(&self) -> Wire<'_> {
        Wire {
            from: &self.settings.from,
            open: self.link.is_some(),
            bytes: self.bytes,
            heard: self.heard,
            old_hello: !self.gate.is_open() && self.gate.stranger.is_some(),
            lost_because: &self.lost_because,
            remedy: self.source.remedy(),
        }
    }
}
