//! The thread half: bytes from the host to requests, events and blocks to frames.
//!
//! At boot the first frame is a hello. Other messages go before blocks, but never two in a row while blocks wait, so
//! that a flood of commands cannot starve the samples.
//!
//! Every block goes through the device's own identification before it is sent; where the host has asked for rows, it is not sent,
//! and the rows of the window that is complete go in the places of blocks.

use core::borrow::BorrowMut;
use core::fmt::Write;

use heapless::{Deque, String};
use whirl_shared::encoder::CountScale;
use whirl_shared::frame::{
    Ack, BLOCK_LEN, CHANNELS, Command, CommandResult, DeviceMessage, Hello, Log, PROTOCOL_VERSION, ResetCause,
    SCHEMA_HASH, SampleBlock, SettingsSource, Status, Streamed, TEXT_LEN,
};

use crate::adjust::Words;
use crate::console::Console;
use crate::estimate::Estimator;
use crate::event::{Event, Notice, Present, Request, Snapshot};
use crate::identification::Identification;
use crate::queue::{Sink, Source};
use crate::settings::{Settings, SettingsError};
use crate::stream::Stream;
use crate::zero::KeptEncoder;

/// Name and version in [`Hello`].
pub const FIRMWARE: &str = concat!("whirl-firmware ", env!("CARGO_PKG_VERSION"));

/// Answers of this half that wait for the link.
const OWN_EVENTS: usize = 8;

/// The thread half. `E` is an [`Estimator`] of its own, or a reference to one ([`Identification`]).
#[derive(Debug)]
pub struct Link<E = Estimator> {
    settings: Settings,
    scales: [CountScale; CHANNELS],
    console: Console,
    stream: Stream,
    own: Deque<Event, OWN_EVENTS>,
    identification: Identification<E>,
    block_next: bool,
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
        Self::with(settings, Estimator::IDLE)
    }
}

impl<E: BorrowMut<Estimator>> Link<E> {
    /// As [`Link::new`], with an estimator, which begins anew.
    ///
    /// # Errors
    /// A setting that is not possible.
    pub fn with(settings: &Settings, estimator: E) -> Result<Self, SettingsError> {
        settings.validate()?;
        let [Some(scale1), Some(scale2)] = settings.counts_per_turn.map(CountScale::new) else {
            return Err(SettingsError { field: "counts_per_turn", found: 0, min: 1, max: u32::MAX });
        };
        let identification = Identification::new(settings, estimator)?;
        let mut link = Self {
            settings: settings.clone(),
            scales: [scale1, scale2],
            console: Console::new(),
            stream: Stream::new(),
            own: Deque::new(),
            identification,
            block_next: false,
            dropped: 0,
            rejected: 0,
            to_keep: None,
            restart_due: false,
        };
        let zeros = core::array::from_fn(|i| {
            KeptEncoder::zero_at_boot(settings.boot.kept.map(|kept| kept[i]), settings.boot_id)
        });
        let present = Present { tick: 0, host_timeout_ms: settings.host_timeout_ms, zeros };
        link.put_own(Event::Hello(present));
        let reset = settings.boot.reset;
        if matches!(reset, ResetCause::Panic | ResetCause::Watchdog) {
            link.put_own(Event::Log { tick: 0, notice: Notice::Reset(reset) });
        }
        Ok(link)
    }

    /// Takes bytes from the host and passes on the commands in them. A command that finds the queue full is refused as
    /// [`CommandResult::WrongState`]: nothing changed.
    pub fn receive(&mut self, bytes: &[u8], requests: &mut impl Sink<Request>) {
        for &byte in bytes {
            let Some(request) = self.console.push(byte) else { continue };
            if let Err(request) = requests.put(request) {
                // Nothing of it is carried out.
                self.rejected = self.rejected.wrapping_add(1);
                let ack = Ack { command_sequence: request.sequence, result: CommandResult::WrongState };
                self.put_own(Event::Ack(ack));
            } else if let Command::Stream(streamed) = request.command {
                // This half's own; the other one answers.
                self.identification.stream(streamed);
            }
        }
    }

    /// The next frame, if there is one, written to `out`; its length.
    ///
    /// `out` must hold [`whirl_shared::codec::MAX_FRAME`] bytes; with less, nothing is taken and `None` returned.
    pub fn poll_transmit(
        &mut self,
        out: &mut [u8],
        blocks: &mut impl Source<SampleBlock>,
        events: &mut impl Source<Event>,
    ) -> Option<usize> {
        if !Stream::fits(out) {
            return None;
        }
        let streamed = if self.block_next { self.streamed(blocks) } else { None };
        let message = match streamed {
            Some(message) => message,
            None => match self.other(events) {
                Some(message) => message,
                None => self.streamed(blocks)?,
            },
        };
        self.block_next = !matches!(message, DeviceMessage::Samples(_) | DeviceMessage::Rows(_));
        self.stream.encode(message, out)
    }

    /// The next message of the stream: rows that wait, or a block. Blocks that are not sent are taken one at a time, so that this
    /// stays short.
    fn streamed(&mut self, blocks: &mut impl Source<SampleBlock>) -> Option<DeviceMessage> {
        let identification = &mut self.identification;
        if let Some(rows) = identification.take_rows() {
            return Some(DeviceMessage::Rows(rows));
        }
        let block = blocks.take()?;
        identification.block(&block);
        match identification.streamed() {
            Streamed::Samples => Some(DeviceMessage::Samples(block)),
            Streamed::Rows => identification.take_rows().map(DeviceMessage::Rows),
        }
    }

    /// The next message beside the stream.
    #[inline]
    fn other(&mut self, events: &mut impl Source<Event>) -> Option<DeviceMessage> {
        if let Some(estimate) = self.identification.take_estimate() {
            return Some(DeviceMessage::Estimate(estimate));
        }
        loop {
            match self.own.pop_front().or_else(|| events.take())? {
                Event::Keep(words, present) => self.to_keep = Some((words, present)),
                Event::Restart => self.restart_due = true,
                event => return self.message(event),
            }
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
            dropped_frames: status
                .dropped_frames
                .wrapping_add(self.dropped)
                .wrapping_add(self.identification.dropped_frames()),
            bad_frames: self.console.bad_frames(),
            rejected_commands: status.rejected_commands.wrapping_add(self.rejected),
            samples_sent: self.stream.samples_sent(),
            rms_angle_mrad: [0, 1].map(|i| turning[i].rms_mrad(self.scales[i])),
            turns_per_minute_milli: [0, 1].map(|i| turning[i].turns_per_minute_milli(self.scales[i], rate)),
            ..status
        }
    }

    fn put_own(&mut self, event: Event) {
        if self.own.push_back(event).is_err() {
            self.dropped = self.dropped.wrapping_add(1);
        }
    }

    // Messages are as long as the longest of them: not to be moved from call to call.
    #[inline]
    fn message(&self, event: Event) -> Option<DeviceMessage> {
        Some(match event {
            Event::Hello(present) => DeviceMessage::Hello(self.hello(present)),
            Event::Status(snapshot) => DeviceMessage::Status(self.status(snapshot)),
            Event::Ack(ack) => DeviceMessage::Ack(ack),
            Event::Log { tick, notice } => {
                DeviceMessage::Log(Log { tick, level: notice.level(), text: text(notice.text()) })
            }
            Event::Keep(..) | Event::Restart => return None,
        })
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
            counts_per_turn: settings.counts_per_turn,
            block_len: BLOCK_LEN as u8,
            limits: settings.limits,
            host_timeout_ms: present.host_timeout_ms,
            zeros: present.zeros,
            reset: settings.boot.reset,
            panic: settings.boot.panic.clone(),
            reversed: settings.reversed,
            full_scale_micrometre: settings.full_scale_micrometre,
            baud: settings.baud,
            settings: settings.boot.settings,
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
