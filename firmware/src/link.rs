//! The thread half: bytes from the host to requests, events and blocks to frames.
//!
//! At boot the first frame is a hello. Other messages go before blocks, but never two in a row
//! while blocks wait, so that a flood of commands cannot starve the samples.
//!
//! Every block goes through the device's own identification before it is sent; where the host has
//! asked for rows, it is not sent, and the rows of the window that is complete go in the places of
//! blocks.
//!
//! Every block is kept, too, and sent again where the host asks for it ([`crate::history`]): when
//! nothing else waits, and while the line has room (`allowance.rs`).

use core::borrow::BorrowMut;
use core::fmt::Write;

use heapless::{Deque, String, Vec};
use whirl_shared::block::sample_count;
use whirl_shared::encoder::CountScale;
use whirl_shared::frame::{
    Ack, BLOCK_LEN, Command, CommandResult, DeviceMessage, Hello, Log, MOST_ENCODERS, PROTOCOL_VERSION, ResetCause,
    SCHEMA_HASH, SampleBlock, SettingsSource, Status, Streamed, TEXT_LEN,
};

use crate::adjust::Words;
use crate::allowance::Allowance;
use crate::console::Console;
use crate::estimate::Estimator;
use crate::event::{Event, Notice, Present, Request, Snapshot};
use crate::history::{Again, History, KEPT, block_bytes};
use crate::identification::Identification;
use crate::queue::{Sink, Source};
use crate::settings::{Settings, SettingsError};
use crate::stream::Stream;
use crate::zero::KeptEncoder;

/// Name and version in [`Hello`].
pub const FIRMWARE: &str = concat!("whirl-firmware ", env!("CARGO_PKG_VERSION"));

/// Answers of this half that wait for the link.
const OWN_EVENTS: usize = 8;
/// How often the link must have had nothing to send before a block is sent again: boards ask once a
/// millisecond, and so have no such block in the tick of one that is streamed.
const QUIET: u8 = 2;

/// The thread half. `E` is an [`Estimator`] of its own, or a reference to one ([`Identification`]);
/// `K` is memory for the blocks that are kept, its own or a reference.
#[derive(Debug)]
pub struct Link<E = Estimator, K = [u8; KEPT]> {
    settings: Settings,
    scales: Vec<CountScale, MOST_ENCODERS>,
    console: Console,
    stream: Stream,
    own: Deque<Event, OWN_EVENTS>,
    identification: Identification<E>,
    history: History<K>,
    allowance: Allowance,
    /// How often there was nothing to send since the last block.
    quiet: u8,
    block_next: bool,
    /// The last that the host was told is a sine of one amplitude.
    constant: bool,
    /// Samples that the stream has passed over, wrapping.
    passed: u32,
    dropped: u32,
    rejected: u32,
    to_keep: Option<(Words, Present)>,
    restart_due: bool,
}

impl Link {
    /// With a hello waiting to be sent.
    ///
    /// # Errors
    /// A setting that is not possible.
    pub fn new(settings: &Settings) -> Result<Self, SettingsError> {
        Self::with(settings, Estimator::IDLE, [0; KEPT])
    }
}

impl<E: BorrowMut<Estimator>, K: BorrowMut<[u8]>> Link<E, K> {
    /// As [`Link::new`], with an estimator, which begins anew, and memory for blocks.
    ///
    /// # Errors
    /// A setting that is not possible; memory for not even a block.
    pub fn with(settings: &Settings, estimator: E, memory: K) -> Result<Self, SettingsError> {
        settings.validate()?;
        let (bytes, channels) = (memory.borrow().len(), settings.channels());
        let history = History::new(memory, channels);
        if history.room() == 0 {
            let bounded = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
            let (found, min) = (bounded(bytes), bounded(block_bytes(channels)));
            return Err(SettingsError { field: "memory (bytes)", found, min, max: u32::MAX });
        }
        // Validated: none is 0.
        let scales = settings.counts_per_turn.iter().filter_map(|n| CountScale::new(*n)).collect();
        let identification = Identification::new(settings, estimator)?;
        let mut link = Self {
            settings: settings.clone(),
            scales,
            console: Console::new(),
            stream: Stream::new(),
            own: Deque::new(),
            identification,
            history,
            allowance: Allowance::new(settings.baud, settings.sample_rate_millihertz, settings.channels()),
            quiet: 0,
            block_next: false,
            constant: true,
            passed: 0,
            dropped: 0,
            rejected: 0,
            to_keep: None,
            restart_due: false,
        };
        let kept = |i: usize| settings.boot.kept.and_then(|kept| kept.get(i).copied());
        let zero = |i: usize| KeptEncoder::zero_at_boot(kept(i), settings.boot_id);
        let zeros = (0..settings.counts_per_turn.len()).map(zero).collect();
        let present = Present { tick: 0, host_timeout_ms: settings.host_timeout_ms, zeros };
        link.put_own(Event::Hello(present));
        let reset = settings.boot.reset;
        if matches!(reset, ResetCause::Panic | ResetCause::Watchdog) {
            link.put_own(Event::Log { tick: 0, notice: Notice::Reset(reset) });
        }
        Ok(link)
    }

    /// Takes bytes from the host and passes on the commands in them. A command that finds the queue
    /// full is refused as [`CommandResult::WrongState`]: nothing changed.
    pub fn receive(&mut self, bytes: &[u8], requests: &mut impl Sink<Request>) {
        for &byte in bytes {
            let Some(request) = self.console.push(byte) else { continue };
            if let Err(request) = requests.put(request) {
                // Nothing of it is carried out.
                self.rejected = self.rejected.wrapping_add(1);
                let ack = Ack { command_sequence: request.sequence, result: CommandResult::WrongState };
                self.put_own(Event::Ack(ack));
                continue;
            }
            // This half's own; the other one answers.
            match request.command {
                Command::Stream(streamed) => self.identification.stream(streamed),
                // Until it is told what became of it: before its first block comes.
                Command::Excite { .. } => self.identification.assume_sine(false),
                Command::BackFill { boot_id, first_tick, ticks } if boot_id == self.settings.boot_id => {
                    self.history.ask(first_tick, ticks);
                }
                _ => {}
            }
        }
    }

    /// The next frame, if there is one, written to `out`; its length.
    ///
    /// `out` must hold [`whirl_shared::codec::MAX_FRAME`] bytes; with less, nothing is taken and
    /// `None` returned.
    pub fn poll_transmit(
        &mut self,
        out: &mut [u8],
        blocks: &mut impl Source<SampleBlock>,
        events: &mut impl Source<Event>,
    ) -> Option<usize> {
        if !Stream::fits(out) {
            return None;
        }
        let streamed = if self.block_next { self.streamed(blocks, out) } else { None };
        // Each puts its own message into the frame: messages are as long as the longest of them, not to be moved
        // from call to call.
        streamed.or_else(|| self.other(events, out)).or_else(|| self.streamed(blocks, out)).or_else(|| self.again(out))
    }

    /// Puts a message into a frame; its length.
    fn put(&mut self, message: &DeviceMessage, out: &mut [u8]) -> Option<usize> {
        use DeviceMessage::{Restored, Rows, Samples};
        self.block_next = !matches!(message, Samples(_) | Rows(_));
        if matches!(message, Samples(_) | Rows(_) | Restored(_)) {
            self.quiet = 0;
        }
        let length = self.stream.encode(message, out)?;
        self.allowance.sent(length);
        Some(length)
    }

    /// Takes a block in, without sending any: for a link that takes nothing at the moment. Whether
    /// there was one; one at a time, so that this stays short.
    pub fn keep_up(&mut self, blocks: &mut impl Source<SampleBlock>) -> bool {
        let Some(block) = blocks.take() else { return false };
        self.identification.block(&block);
        self.allowance.sampled(sample_count(&block));
        self.passed = self.passed.wrapping_add(self.history.push(&block));
        if self.identification.streamed() == Streamed::Rows {
            self.history.pass();
        }
        true
    }

    /// The next message of the stream: rows that wait, or a block. Blocks are taken in one at a
    /// time, so that this stays short.
    fn streamed(&mut self, blocks: &mut impl Source<SampleBlock>, out: &mut [u8]) -> Option<usize> {
        if let Some(rows) = self.identification.take_rows() {
            return self.put(&DeviceMessage::Rows(rows), out);
        }
        self.keep_up(blocks);
        match self.identification.streamed() {
            Streamed::Samples => {
                let message = DeviceMessage::Samples(self.history.stream()?);
                self.put(&message, out)
            }
            Streamed::Rows => {
                let message = DeviceMessage::Rows(self.identification.take_rows()?);
                self.put(&message, out)
            }
        }
    }

    /// What the host has asked for again, where nothing else waits.
    fn again(&mut self, out: &mut [u8]) -> Option<usize> {
        if self.quiet < QUIET {
            self.quiet += 1;
            return None;
        }
        if !self.allowance.is_enough() {
            return None;
        }
        let message = match self.history.again()? {
            Again::Block(block) => DeviceMessage::Restored(block),
            Again::Done(end) => DeviceMessage::BackFilled(end),
        };
        self.put(&message, out)
    }

    /// The next message beside the stream.
    fn other(&mut self, events: &mut impl Source<Event>, out: &mut [u8]) -> Option<usize> {
        if let Some(estimate) = self.identification.take_estimate() {
            return self.put(&DeviceMessage::Estimate(estimate), out);
        }
        loop {
            let message = match self.own.pop_front().or_else(|| events.take())? {
                Event::Hello(present) => DeviceMessage::Hello(self.hello(present)),
                Event::Status(snapshot) => DeviceMessage::Status(self.status(snapshot)),
                Event::Ack(ack) => DeviceMessage::Ack(ack),
                Event::Excited(excited) => {
                    self.identification.assume_sine(excited.excitation.is_sine());
                    // Of a sine the blocks tell all; but after something else it is told.
                    let constant = excited.excitation.is_constant();
                    if core::mem::replace(&mut self.constant, constant) && constant {
                        continue;
                    }
                    DeviceMessage::Excited(excited)
                }
                Event::Log { tick, notice } => {
                    DeviceMessage::Log(Log { tick, level: notice.level(), text: text(notice.text()) })
                }
                Event::Keep(words, present) => {
                    self.to_keep = Some((words, present));
                    continue;
                }
                Event::Restart => {
                    self.restart_due = true;
                    continue;
                }
            };
            return self.put(&message, out);
        }
    }

    /// Settings that the board is to keep; [`Self::kept`] then tells the host what became of it.
    pub fn settings_to_keep(&self) -> Option<Words> {
        self.to_keep.as_ref().map(|(words, _)| *words)
    }

    /// The settings of [`Self::settings_to_keep`] have been kept, or could not be.
    pub fn kept(&mut self, done: bool) {
        if let Some((_, present)) = self.to_keep.take() {
            self.settings.boot.settings = if done { SettingsSource::Changed } else { SettingsSource::NotKept };
            self.put_own(Event::Hello(present));
        }
    }

    /// Whether the board is to restart, now that all is sent.
    pub fn restart_due(&self) -> bool {
        self.restart_due
    }

    /// A status with this half's counters put in.
    pub fn status(&self, snapshot: Snapshot) -> Status {
        let Snapshot { status, turning } = snapshot;
        let rate = self.settings.sample_rate_millihertz;
        Status {
            dropped_samples: status.dropped_samples.wrapping_add(self.passed),
            dropped_frames: status
                .dropped_frames
                .wrapping_add(self.dropped)
                .wrapping_add(self.identification.dropped_frames()),
            bad_frames: self.console.bad_frames(),
            rejected_commands: status.rejected_commands.wrapping_add(self.rejected),
            samples_sent: self.stream.samples_sent(),
            rms_angle_mrad: turning.iter().zip(&self.scales).map(|(t, scale)| t.rms_mrad(*scale)).collect(),
            turns_per_minute_milli: turning
                .iter()
                .zip(&self.scales)
                .map(|(t, scale)| t.turns_per_minute_milli(*scale, rate))
                .collect(),
            kept_from: self.history.oldest().unwrap_or(status.tick),
            ..status
        }
    }

    fn put_own(&mut self, event: Event) {
        if self.own.push_back(event).is_err() {
            self.dropped = self.dropped.wrapping_add(1);
        }
    }

    fn hello(&self, present: Present) -> Hello {
        let settings = &self.settings;
        Hello {
            protocol: PROTOCOL_VERSION,
            schema: SCHEMA_HASH,
            boot_id: settings.boot_id,
            tick: present.tick,
            firmware: firmware(settings.build),
            board: text(settings.board),
            sample_rate_millihertz: settings.sample_rate_millihertz,
            counts_per_turn: settings.counts_per_turn.clone(),
            block_len: BLOCK_LEN as u8,
            limits: settings.limits,
            host_timeout_ms: present.host_timeout_ms,
            zeros: present.zeros,
            reset: settings.boot.reset,
            panic: settings.boot.panic.clone(),
            reversed: settings.reversed.clone(),
            full_scale_micrometre: settings.full_scale_micrometre,
            baud: settings.baud,
            settings: settings.boot.settings,
            base: settings.base,
        }
    }
}

/// Name, version and build: `whirl-firmware 0.1.0 (1a2b3c4d)`.
fn firmware(build: &str) -> String<TEXT_LEN> {
    let mut whole = text(FIRMWARE);
    if !build.is_empty() {
        // It fits: the settings' check keeps it short.
        let _ = write!(whole, " ({build})");
    }
    whole
}

/// As much of a text as fits.
fn text<const N: usize>(whole: &str) -> String<N> {
    let mut text = String::new();
    for character in whole.chars() {
        if text.push(character).is_err() {
            break;
        }
    }
    text
}
