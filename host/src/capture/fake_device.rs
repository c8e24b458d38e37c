//! A device in memory that keeps to the protocol, with faults by script. It is written from the
//! protocol's text, not from the firmware. Each read moves its clock on by 20 ticks.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard};

use whirl_shared::codec::{Decoder, MAX_FRAME, encode};
use whirl_shared::frame::*;

use super::super::source::{Link, Source};

/// The count of encoder 1 at a tick (of any boot).
pub(super) fn count(tick: i64) -> i32 {
    (1000.0 * (tick as f64 * 0.01).sin()) as i32
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Fault {
    DropFrame,
    FlipBit,
    Repeat,
    SwapWithNext,
    /// So many ticks are never sampled.
    Overrun(u32),
    /// So many blocks find the queue full.
    DeviceDrops(u32),
    /// So many bytes vanish within a frame.
    LoseBytes(usize),
    /// The link is gone for so many ticks.
    Unplug(u32),
    /// The link is there, and nothing comes for so many ticks.
    Silence(u32),
    Restart,
    /// It restarts under the boot id that it had.
    TicksGoBack,
    LeftRunning,
    LeftFaulted,
    Noise,
    Mute,
    WrongSchema,
    WrongProtocol,
    /// Right checksums, other messages.
    Foreign,
    Deaf,
    OtherEncoder,
    OtherRate,
    /// It says that it keeps all, and gives nothing of it.
    NeverRestores,
}

#[derive(Debug)]
pub(super) struct State {
    tick: u32,
    boot_id: u32,
    /// Ticks of the boots before, on the record's line.
    before: i64,
    sequence: u16,
    faults: VecDeque<(u32, Fault)>,
    always: Option<Fault>,
    out: VecDeque<u8>,
    held: Option<Vec<u8>>,
    status: Status,
    next_status: u32,
    gone_until: Option<u32>,
    silent_until: Option<u32>,
    ramp_left: u32,
    target: (u32, u32),
    pub(super) shaker_moved: bool,
    decoder: Decoder<HostMessage>,
    random: u32,
}

impl State {
    pub(super) fn at_rest(&self) -> bool {
        matches!(self.status.shaker, ShakerState::Disarmed) && self.status.amplitude_nanometre == 0
    }

    fn send(&mut self, message: DeviceMessage, fault: Option<Fault>) {
        let samples = matches!(message, DeviceMessage::Samples(_));
        let envelope = Envelope { sequence: self.sequence, message };
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = [0; MAX_FRAME];
        let n = encode(&envelope, &mut frame).unwrap();
        let mut frame = frame[..n].to_vec();
        match fault {
            Some(Fault::DropFrame) => return,
            Some(Fault::FlipBit) => frame[n / 2] ^= if frame[n / 2] == 4 { 1 } else { 4 },
            Some(Fault::LoseBytes(k)) => drop(frame.drain(5..5 + k)),
            Some(Fault::Repeat) => self.out.extend(frame.iter()),
            Some(Fault::SwapWithNext) => {
                self.held = Some(frame);
                return;
            }
            _ => {}
        }
        self.out.extend(frame);
        if samples {
            self.out.extend(self.held.take().unwrap_or_default());
        }
    }

    fn hello(&mut self) {
        let hello = Hello {
            protocol: if self.always == Some(Fault::WrongProtocol) { 99 } else { PROTOCOL_VERSION },
            schema: if self.always == Some(Fault::WrongSchema) { 0x1234_5678 } else { SCHEMA_HASH },
            boot_id: self.boot_id,
            tick: self.tick,
            firmware: "fake 1.0".try_into().unwrap(),
            board: "memory".try_into().unwrap(),
            sample_rate_millihertz: if self.always == Some(Fault::OtherRate) { 1_000_000 } else { 500_000 },
            counts_per_turn: [4096, if self.always == Some(Fault::OtherEncoder) { 1024 } else { 4096 }].into(),
            block_len: BLOCK_LEN as u8,
            limits: ShakerLimits {
                amplitude_micrometre: 20_000,
                frequency_millihertz: 20_000,
                ramp_micrometre_per_s: 20_000,
                acceleration_millimetre_per_s2: 40_000,
            },
            host_timeout_ms: 2000,
            full_scale_micrometre: 25_000,
            ..Hello::default()
        };
        self.send(DeviceMessage::Hello(hello), None);
    }

    fn status(&mut self) {
        self.status.tick = self.tick;
        // It keeps nothing.
        self.status.kept_from = if self.always == Some(Fault::NeverRestores) { 0 } else { self.tick };
        let status = self.status.clone();
        self.next_status = self.tick + 500;
        self.send(DeviceMessage::Status(status), None);
    }

    fn block(&mut self) {
        let fault = self.faults.pop_front_if(|(at, _)| *at <= self.tick).map(|(_, f)| f);
        match fault {
            Some(Fault::Overrun(n)) => {
                self.tick += n;
                self.status.overruns += n;
            }
            Some(Fault::DeviceDrops(n)) => {
                self.tick += n * BLOCK_LEN as u32;
                self.status.dropped_samples += n * BLOCK_LEN as u32;
            }
            Some(Fault::Unplug(n)) => self.gone_until = Some(self.tick.saturating_add(n)),
            Some(Fault::Silence(n)) => self.silent_until = Some(self.tick.saturating_add(n)),
            Some(fault @ (Fault::Restart | Fault::TicksGoBack)) => {
                self.before += i64::from(self.tick);
                self.tick = 0;
                self.next_status = 500;
                self.status = Status::default();
                self.boot_id += u32::from(fault == Fault::Restart);
                self.hello();
            }
            _ => {}
        }
        let counts: Vec<i32> = (0..BLOCK_LEN as u32).map(|i| count(i64::from(self.tick + i))).collect();
        let mut block = SampleBlock {
            first_tick: self.tick,
            phase: self.tick.wrapping_mul(42_949_673),
            phase_increment: 42_949_673,
            amplitude_nanometre: self.status.amplitude_nanometre,
            first: [counts[0], 7].into(),
            deltas: heapless::Vec::new(),
        };
        for w in counts.windows(2) {
            block.deltas.extend([(w[1] - w[0]) as i16, 0]);
        }
        self.tick += BLOCK_LEN as u32;
        self.send(DeviceMessage::Samples(block), fault);
        if self.ramp_left > 0 {
            self.ramp_left -= 1;
            if self.ramp_left == 0 && self.status.shaker == ShakerState::Ramping {
                self.status.shaker = ShakerState::Running;
                self.status.amplitude_nanometre = self.target.0 * 1000;
            }
            if self.ramp_left == 0 && self.status.shaker == ShakerState::Stopping {
                self.status.shaker = ShakerState::Disarmed;
                self.status.amplitude_nanometre = 0;
            }
        }
        if self.tick >= self.next_status {
            self.status();
        }
    }

    fn receive(&mut self, bytes: &[u8]) {
        if matches!(self.always, Some(Fault::Deaf | Fault::Noise | Fault::Mute | Fault::Foreign)) {
            return;
        }
        for &byte in bytes {
            let Some(Ok(envelope)) = self.decoder.push(byte) else { continue };
            let HostMessage::Command(command) = envelope.message;
            let s = &mut self.status;
            let mut result = CommandResult::Done;
            match command {
                Command::Arm => match s.shaker {
                    ShakerState::Disarmed | ShakerState::Armed => s.shaker = ShakerState::Armed,
                    _ => result = CommandResult::WrongState,
                },
                Command::Start { amplitude_micrometre, .. } if amplitude_micrometre > 20_000 => {
                    result = CommandResult::OutOfRange { limit: 20_000 };
                }
                Command::Start { amplitude_micrometre, frequency_millihertz } => {
                    if s.shaker == ShakerState::Armed {
                        s.shaker = ShakerState::Ramping;
                        s.frequency_millihertz = frequency_millihertz;
                        self.target = (amplitude_micrometre, frequency_millihertz);
                        self.ramp_left = 20;
                        self.shaker_moved = true;
                    } else {
                        result = CommandResult::WrongState;
                    }
                }
                Command::Stop | Command::Disarm => {
                    if matches!(s.shaker, ShakerState::Ramping | ShakerState::Running) {
                        s.shaker = ShakerState::Stopping;
                        s.stop_cause = StopCause::Command;
                        self.ramp_left = 5;
                    } else if command == Command::Disarm && s.shaker != ShakerState::Stopping {
                        s.shaker = ShakerState::Disarmed;
                        s.amplitude_nanometre = 0;
                    }
                }
                _ => {}
            }
            self.send(DeviceMessage::Ack(Ack { command_sequence: envelope.sequence, result }), None);
            match command {
                Command::Hello => self.hello(),
                Command::Status => self.status(),
                _ => {}
            }
        }
    }

    /// Moves the clock on and fills `out`.
    fn run(&mut self) {
        match self.always {
            Some(Fault::Mute) => return,
            Some(Fault::Noise) => {
                for _ in 0..400 {
                    self.random = self.random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    self.out.push_back((self.random >> 24) as u8);
                }
                return;
            }
            Some(Fault::Foreign) => {
                let strange = Envelope { sequence: 1, message: (9u8, 77u32, 5u64) };
                let mut frame = [0; 64];
                let n = encode(&strange, &mut frame).unwrap();
                self.out.extend(&frame[..n]);
                return;
            }
            _ => {}
        }
        for _ in 0..2 {
            self.block();
        }
        if self.silent_until.is_some_and(|until| self.tick < until) {
            self.out.clear();
        }
    }
}

/// The device and its plug.
pub(super) struct Fake {
    state: Arc<Mutex<State>>,
}

impl Fake {
    pub(super) fn new() -> Self {
        Self::with(&[])
    }

    /// With faults at ticks (0: always).
    pub(super) fn with(faults: &[(u32, Fault)]) -> Self {
        let always = faults.iter().find(|(at, _)| *at == 0).map(|(_, f)| *f);
        let mut status = Status::default();
        match always {
            Some(Fault::LeftRunning) => {
                status.shaker = ShakerState::Running;
                status.amplitude_nanometre = 3_000_000;
            }
            Some(Fault::LeftFaulted) => status.shaker = ShakerState::Faulted,
            _ => {}
        }
        let state = State {
            tick: 130,
            boot_id: 1,
            before: 0,
            sequence: 65_500,
            faults: faults.iter().filter(|(at, _)| *at > 0).copied().collect(),
            always,
            out: VecDeque::new(),
            held: None,
            status,
            next_status: 400,
            gone_until: None,
            silent_until: None,
            ramp_left: 0,
            target: (0, 0),
            shaker_moved: false,
            decoder: Decoder::new(),
            random: 1,
        };
        Self { state: Arc::new(Mutex::new(state)) }
    }

    /// The same device later, or after a restart.
    pub(super) fn at(tick: u32, boot_id: u32, before: i64) -> Self {
        let fake = Self::new();
        {
            let mut state = fake.state();
            (state.tick, state.boot_id, state.before, state.next_status) = (tick, boot_id, before, tick + 300);
        }
        fake
    }

    pub(super) fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }
}

impl Source for Fake {
    fn open(&mut self) -> io::Result<Box<dyn Link>> {
        let mut state = self.state();
        if let Some(until) = state.gone_until {
            // The device's clock goes on while nobody listens.
            state.run();
            state.out.clear();
            for _ in 0..15 {
                state.run();
                state.out.clear();
            }
            if state.tick < until {
                return Err(io::Error::new(io::ErrorKind::NotFound, "unplugged"));
            }
            state.gone_until = None;
        }
        drop(state);
        Ok(Box::new(Plug(self.state.clone())))
    }

    fn remedy(&self) -> String {
        "Plug it in".to_owned()
    }
}

struct Plug(Arc<Mutex<State>>);

impl Link for Plug {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut state = self.0.lock().unwrap();
        if state.gone_until.is_some() {
            return Err(io::Error::new(io::ErrorKind::BrokenPipe, "unplugged"));
        }
        if state.out.len() < 64 {
            state.run();
        }
        // Pieces of odd length, so that frames are cut.
        let n = buffer.len().min(77).min(state.out.len());
        if n == 0 {
            std::thread::sleep(std::time::Duration::from_millis(2));
            return Err(io::Error::new(io::ErrorKind::TimedOut, "nothing"));
        }
        for (b, byte) in buffer.iter_mut().zip(state.out.drain(..n)) {
            *b = byte;
        }
        Ok(n)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut state = self.0.lock().unwrap();
        if state.gone_until.is_some() {
            return Err(io::Error::new(io::ErrorKind::BrokenPipe, "unplugged"));
        }
        state.receive(bytes);
        Ok(())
    }
}
