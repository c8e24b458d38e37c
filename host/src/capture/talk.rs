//! A few words with a device, without a recording: its hello, commands with their answers, whether
//! its arms move.
//!
//! It listens as a capture does: only to what answers its own commands (`super::gate`), and it
//! opens a link that drops anew, as a board's own USB port does when the board restarts.

use std::io::ErrorKind;
use std::time::{Duration, Instant};

use whirl_shared::block::samples;
use whirl_shared::codec::{Decoder, FrameError};
use whirl_shared::frame::{Command, CommandResult, DeviceMessage, Hello, SampleBlock, ShakerState, Status};

use super::commands::{Commands, Outcome};
use super::device::check_protocol;
use super::gate::Gate;
use super::live::numbers_from;
use super::no_device::{Heard, Wire};
use super::source::{self, Link, Source};
use crate::error::{BadInput, Result, io_words, plain};
use crate::rig::Rig;

/// Time between two requests of one thing.
const AGAIN: Duration = Duration::from_millis(500);

/// A device that is talked to.
pub struct Talk {
    from: String,
    source: Box<dyn Source>,
    link: Option<Box<dyn Link>>,
    decoder: Decoder<DeviceMessage>,
    commands: Commands,
    patience: Duration,
    bytes: u64,
    heard: Heard,
    lost_because: String,
}

impl Talk {
    /// Opens a source; `rig` matters to a simulated one. A device may take so long for each of its
    /// answers.
    ///
    /// # Errors
    /// A source that cannot be, cannot be opened or is a file.
    pub fn open(from: &str, rig: &Rig, patience_s: f64) -> Result<Self> {
        if !(0.0..=1e7).contains(&patience_s) {
            return Err(BadInput::new(patience_s.to_string(), "a time in seconds, 0 or more")
                .at("--handshake-s")
                .remedy("Correct the option"));
        }
        let mut source = source::parse(from, rig)?;
        if source.is_replay() {
            return Err(BadInput::new(from, "a device: serial:PORT, tcp:HOST:PORT, rtt or sim")
                .at("--from")
                .remedy("A file answers nothing"));
        }
        let opened = source.open();
        let link = opened.map_err(|e| BadInput::new(io_words(&e), "a device").in_file(from).remedy(source.remedy()))?;
        let first = if source.is_simulated() { 0 } else { numbers_from() };
        let mut commands = Commands::new(first);
        commands.reconnected(source.now());
        Ok(Self {
            from: from.to_owned(),
            source,
            link: Some(link),
            decoder: Decoder::new(),
            commands,
            patience: Duration::from_secs_f64(patience_s),
            bytes: 0,
            heard: Heard::default(),
            lost_because: String::new(),
        })
    }

    /// Sends what is to be sent and takes the messages of one read.
    fn turn(&mut self) -> Vec<DeviceMessage> {
        let out = self.commands.take_bytes();
        let mut buffer = [0; 4096];
        let read = match &mut self.link {
            None => {
                self.source.pause(Duration::from_millis(100));
                self.reopen();
                return Vec::new();
            }
            Some(link) if out.is_empty() => link.read(&mut buffer),
            Some(link) => link.write_all(&out).and_then(|()| link.read(&mut buffer)),
        };
        let n = match read {
            Ok(0) => return self.lose("the stream ended"),
            Ok(n) => n,
            Err(e) if matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                return Vec::new();
            }
            Err(e) => return self.lose(&io_words(&e)),
        };
        self.bytes += n as u64;
        self.heard.bytes += n as u64;
        let mut messages = Vec::new();
        for &byte in &buffer[..n] {
            match self.decoder.push(byte) {
                None => {}
                Some(Ok(envelope)) => messages.push(envelope.message),
                Some(Err(e)) => {
                    self.heard.bad += 1;
                    self.heard.foreign += u64::from(e == FrameError::Malformed);
                }
            }
        }
        if !messages.is_empty() {
            self.heard = Heard::default();
        }
        messages
    }

    fn lose(&mut self, why: &str) -> Vec<DeviceMessage> {
        self.link = None;
        self.lost_because = plain(why);
        Vec::new()
    }

    fn reopen(&mut self) {
        match self.source.open() {
            Ok(link) => {
                self.link = Some(link);
                self.decoder = Decoder::new();
                self.commands.reconnected(self.source.now());
            }
            Err(e) => self.lost_because = plain(&io_words(&e)),
        }
    }

    /// Why nothing came.
    fn silent(&self, old_hello: bool, waited: Duration) -> BadInput {
        let wire = Wire {
            from: &self.from,
            open: self.link.is_some(),
            bytes: self.bytes,
            heard: self.heard,
            old_hello,
            lost_because: &self.lost_because,
            remedy: self.source.remedy(),
        };
        self.source.failed().unwrap_or_else(|| wire.no_hello(waited.as_secs_f64()))
    }

    /// Asks until something comes that `take` wants; none where the patience is over.
    fn until<T>(
        &mut self,
        mut ask: impl FnMut(&mut Commands),
        mut take: impl FnMut(&DeviceMessage) -> Option<T>,
    ) -> Option<T> {
        let begun = self.source.now();
        let mut asked: Option<Instant> = None;
        loop {
            let now = self.source.now();
            if asked.is_none_or(|t| now.duration_since(t) > AGAIN) {
                ask(&mut self.commands);
                asked = Some(now);
            }
            if let Some(found) = self.turn().iter().find_map(&mut take) {
                return Some(found);
            }
            if self.source.failed().is_some() || self.source.now().duration_since(begun) > self.patience {
                return None;
            }
        }
    }

    /// A hello that answers a command sent now.
    ///
    /// # Errors
    /// None comes, or it is of another protocol.
    pub fn hello(&mut self) -> Result<Hello> {
        let gate = std::cell::RefCell::new(Gate::default());
        let found = self.until(
            |commands| {
                let sequence = commands.send(Command::Hello);
                gate.borrow_mut().asked(sequence);
            },
            |message| match message {
                message if gate.borrow_mut().opens(message) => gate.borrow().stranger.clone(),
                _ => None,
            },
        );
        let gate = gate.into_inner();
        match (found, gate.stranger) {
            (Some(hello), _) => check_protocol(&hello).map(|()| hello),
            (None, Some(stranger)) => {
                // One of another protocol does not answer.
                check_protocol(&stranger)?;
                Err(self.silent(true, self.patience))
            }
            (None, None) => Err(self.silent(false, self.patience)),
        }
        .map_err(|e| e.in_file(&self.from))
    }

    /// The device's status, as it is now.
    ///
    /// # Errors
    /// None comes.
    pub fn status(&mut self) -> Result<Status> {
        let found = self.until(
            |commands| {
                commands.send(Command::Status);
            },
            |message| match message {
                DeviceMessage::Status(status) => Some(status.clone()),
                _ => None,
            },
        );
        found.ok_or_else(|| self.silent(false, self.patience))
    }

    /// Sends a command until it is answered.
    ///
    /// # Errors
    /// No answer comes.
    pub fn ask(&mut self, command: Command) -> Result<CommandResult> {
        self.commands.ask(command, self.source.now());
        loop {
            if let Outcome::Silent(command) = self.commands.poll(self.source.now()) {
                return Err(BadInput::new(format!("no answer to {command:?}"), "an acknowledgement")
                    .in_file(&self.from)
                    .remedy("The device does not hear: look at the line from host to device, and its baud rate"));
            }
            if let Some(e) = self.source.failed() {
                return Err(e);
            }
            for message in self.turn() {
                if let DeviceMessage::Ack(ack) = message
                    && let Outcome::Answered(_, result) = self.commands.ack(&ack)
                {
                    return Ok(result);
                }
            }
        }
    }

    /// As [`Self::ask`], for commands that want a shaker that is disarmed: one that rests and is
    /// armed, or has a fault, is disarmed.
    ///
    /// # Errors
    /// A shaker that moves; no answer.
    pub fn ask_at_rest(&mut self, command: Command) -> Result<CommandResult> {
        let result = self.ask(command)?;
        if result != CommandResult::WrongState {
            return Ok(result);
        }
        let state = self.status()?.shaker;
        if !matches!(state, ShakerState::Armed | ShakerState::Faulted | ShakerState::Disarmed) {
            return Err(BadInput::new("a shaker that moves", "a shaker at rest")
                .in_file(&self.from)
                .remedy("End the capture that drives it, or wait until it has stopped by itself"));
        }
        if state != ShakerState::Disarmed {
            self.ask(Command::Disarm)?;
        }
        self.ask(command)
    }

    /// The encoders' counts as they are now.
    ///
    /// # Errors
    /// No sample comes.
    pub fn counts(&mut self) -> Result<Vec<i32>> {
        let found = self.until(
            |commands| {
                commands.send(Command::KeepAlive);
            },
            |message| match message {
                DeviceMessage::Samples(block) => {
                    let mut counts = block.first.to_vec();
                    each_sample(block, |i, count| counts[i] = count);
                    Some(counts)
                }
                _ => None,
            },
        );
        found.ok_or_else(|| self.silent(false, self.patience))
    }

    /// By how many counts each encoder moves within some time: greatest minus least.
    pub fn movement(&mut self, time: Duration) -> Vec<u32> {
        let begun = self.source.now();
        let mut range: Vec<(i32, i32)> = Vec::new();
        while self.source.now().duration_since(begun) < time && self.source.failed().is_none() {
            for message in self.turn() {
                if let DeviceMessage::Samples(block) = message {
                    each_sample(&block, |i, count| match range.get_mut(i) {
                        Some((least, greatest)) => (*least, *greatest) = ((*least).min(count), (*greatest).max(count)),
                        None => range.push((count, count)),
                    });
                }
            }
        }
        range.iter().map(|(least, greatest)| greatest.abs_diff(*least)).collect()
    }

    /// What is simulated lives on in this conversation only.
    pub fn is_simulated(&self) -> bool {
        self.source.is_simulated()
    }
}

/// Channel and count of each sample of a block, the channels of a sample in order.
fn each_sample(block: &SampleBlock, mut take: impl FnMut(usize, i32)) {
    for sample in samples(block) {
        sample.counts.iter().enumerate().for_each(|(i, &count)| take(i, count));
    }
}

#[cfg(test)]
#[path = "talk_tests.rs"]
mod tests;
