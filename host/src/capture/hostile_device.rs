//! Devices and wires in memory that do what they should not. Time is the wire's own: each read
//! takes 20 ms of it.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use whirl_shared::codec::{Decoder, MAX_FRAME, encode};
use whirl_shared::frame::*;

use super::super::source::{Link, Source};

/// Reads of good samples before it begins: 2 s.
const GOOD: u32 = 100;

pub(super) struct State {
    pub(super) reads: u32,
    tick: u32,
    boot: u32,
    sequence: u16,
    random: u32,
    out: VecDeque<u8>,
    decoder: Decoder<HostMessage>,
    kind: &'static str,
    /// Blocks that were sent, for those that repeat them.
    sent: Vec<Vec<u8>>,
}

impl State {
    fn random(&mut self) -> u32 {
        self.random = self.random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        self.random >> 8
    }

    fn frame(&mut self, message: DeviceMessage) -> Vec<u8> {
        let mut frame = [0; MAX_FRAME];
        let n = encode(&Envelope { sequence: self.sequence, message }, &mut frame).unwrap();
        self.sequence = self.sequence.wrapping_add(1);
        frame[..n].to_vec()
    }

    fn send(&mut self, message: DeviceMessage) {
        let frame = self.frame(message);
        self.out.extend(frame);
    }

    fn hello(&mut self) -> DeviceMessage {
        let late = self.reads > GOOD;
        DeviceMessage::Hello(Hello {
            protocol: if late && self.kind == "another protocol later" { 99 } else { PROTOCOL_VERSION },
            schema: SCHEMA_HASH,
            boot_id: self.boot,
            tick: self.tick,
            firmware: "hostile".try_into().unwrap(),
            board: "wire".try_into().unwrap(),
            sample_rate_millihertz: 500_000,
            counts_per_turn: [if late && self.kind == "another encoder later" { 1000 } else { 4096 }, 4096].into(),
            block_len: 10,
            host_timeout_ms: 2000,
            ..Hello::default()
        })
    }

    fn block_at(&self, tick: u32) -> DeviceMessage {
        let extreme = self.kind == "extreme counts";
        let mut deltas = heapless::Vec::new();
        for _ in 0..9 {
            deltas.extend(if extreme { [i16::MAX, i16::MIN] } else { [1, -1] });
        }
        DeviceMessage::Samples(SampleBlock {
            first_tick: tick,
            phase: if extreme { u32::MAX } else { 0 },
            phase_increment: if extreme { u32::MAX } else { 0 },
            amplitude_nanometre: if extreme { u32::MAX } else { 0 },
            first: if extreme { [i32::MAX, i32::MIN] } else { [tick as i32, 7] }.into(),
            deltas,
        })
    }

    /// The next ten samples, in order.
    fn block(&mut self) -> Vec<u8> {
        let message = self.block_at(self.tick);
        self.tick = self.tick.wrapping_add(10);
        let frame = self.frame(message);
        self.sent.push(frame.clone());
        frame
    }

    fn good(&mut self) {
        let frame = self.block();
        self.out.extend(frame);
        if self.reads.is_multiple_of(50) {
            let status = Status { tick: self.tick, ..Status::default() };
            self.send(DeviceMessage::Status(status));
        }
    }

    fn status(&mut self, overruns: u32) {
        let status = Status { tick: self.tick, overruns, dropped_samples: overruns, ..Status::default() };
        self.send(DeviceMessage::Status(status));
    }

    fn log(&mut self, text: &str) {
        let log = Log { tick: self.tick, level: 0, text: text.try_into().unwrap() };
        self.send(DeviceMessage::Log(log));
    }

    /// What it does in 20 ms.
    fn misbehave(&mut self) {
        if !self.spoils_the_wire() {
            self.says_nonsense();
        }
    }

    /// Bytes that are damaged, repeated or out of order; whether this device is of that kind.
    fn spoils_the_wire(&mut self) -> bool {
        let n = self.reads;
        match self.kind {
            "zeros" | "zeros from the start" => self.out.extend([0; 4096]),
            "ones" => self.out.extend([255; 4096]),
            "noise" | "noise from the start" => (0..4096).for_each(|_| {
                let byte = self.random() as u8;
                self.out.push_back(byte);
            }),
            "one block again and again" => self.out.extend(self.sent[0].clone()),
            "the last second again and again" => {
                let again = self.sent[self.sent.len() - 50 + (n as usize % 50)].clone();
                self.out.extend(again);
            }
            "cut frames" => {
                let frame = self.block();
                self.out.extend(&frame[..frame.len() / 2]);
                self.out.push_back(0);
            }
            "no zero at all" => self.out.extend([7; 4096]),
            "half of the bits" => {
                let mut frame = self.block();
                let at = self.random() as usize % frame.len();
                frame[at] ^= 1 << (n % 8);
                self.out.extend(frame);
            }
            "each byte twice" => {
                let frame = self.block();
                self.out.extend(frame.iter().flat_map(|b| [*b, *b]));
            }
            "every second frame" => {
                let frame = self.block();
                self.out.extend(frame.iter().filter(|_| n.is_multiple_of(2)));
            }
            "pieces of a second in reverse" => {
                // 48 blocks, the later half first.
                if n.is_multiple_of(48) {
                    let frames: Vec<_> = (0..48).map(|_| self.block()).collect();
                    for k in (24..48).chain(0..24) {
                        self.out.extend(&frames[k]);
                    }
                }
            }
            "a piece of a second too late" => {
                // 480 samples come 0.96 s after their place has been passed.
                if n.is_multiple_of(150) {
                    let late: Vec<_> = (0..48).map(|_| self.block()).collect();
                    for _ in 0..48 {
                        let frame = self.block();
                        self.out.extend(frame);
                    }
                    self.out.extend(late.concat());
                } else {
                    self.good();
                }
            }
            _ => return false,
        }
        true
    }

    /// Whole frames that say what cannot be.
    fn says_nonsense(&mut self) {
        let n = self.reads;
        match self.kind {
            "answers only" => {}
            "statuses only" => self.status(0),
            "statuses without end" => (0..60).for_each(|_| self.status(0)),
            "a restart at each block" | "a restart now and then" => {
                if self.kind.ends_with("block") || n.is_multiple_of(100) {
                    self.boot += 1;
                    self.tick = 0;
                    let hello = self.hello();
                    self.send(hello);
                }
                self.good();
            }
            "hellos of ever other boots" => (0..30).for_each(|_| {
                self.boot += 1;
                let hello = self.hello();
                self.send(hello);
            }),
            "hellos of one boot" | "another protocol later" | "another encoder later" => (0..30).for_each(|_| {
                let hello = self.hello();
                self.send(hello);
            }),
            "one jump of the clock" => {
                self.tick = self.tick.wrapping_add(if n == GOOD + 1 { 3000 } else { 0 });
                self.good();
            }
            "one jump of the clock by 24 days" => {
                let to = if n == GOOD + 1 { 1 << 30 } else { self.tick };
                self.good();
                let far = self.block_at(to);
                self.send(far);
            }
            "a jump at each block" => {
                self.tick = self.tick.wrapping_add(1 << 20);
                self.good();
            }
            "a clock that runs backwards" => {
                self.tick = self.tick.wrapping_sub(20);
                self.good();
            }
            "escapes in lines" => {
                self.log("\u{1b}[2J\u{7}\nfault");
                self.good();
            }
            "lines without end" => (0..60).for_each(|_| self.log("the same again")),
            "counters that jump" => {
                let overruns = self.random();
                self.status(overruns);
                self.good();
            }
            "rows that nobody asked for" => {
                let mut rows = heapless::Vec::new();
                rows.push([f32::NAN.into(); regression::ROW_LEN]).unwrap();
                self.send(DeviceMessage::Rows(Rows {
                    tick: n,
                    window_ticks: u32::MAX,
                    window: n,
                    phase_increment: 0,
                    amplitude_nanometre: 0,
                    frequency: 255,
                    last_frequency: 0,
                    rows,
                }));
            }
            "extreme counts" | "old bytes first" | "an old hello first" | "sequence numbers at random" => {
                self.sequence = if self.kind.starts_with("seq") { self.random() as u16 } else { self.sequence };
                self.good();
            }
            "silence" | "an end" | "errors" => {}
            kind => panic!("{kind}"),
        }
    }

    fn receive(&mut self, bytes: &[u8]) {
        let bad = self.reads > GOOD || self.kind.ends_with("from the start");
        if self.kind == "an old hello first"
            || (bad && ["silence", "noise", "zeros"].iter().any(|k| self.kind.starts_with(k)))
        {
            return;
        }
        for &byte in bytes {
            let Some(Ok(envelope)) = self.decoder.push(byte) else { continue };
            self.send(DeviceMessage::Ack(Ack { command_sequence: envelope.sequence, result: CommandResult::Done }));
            match envelope.message {
                HostMessage::Command(Command::Hello) => {
                    let hello = self.hello();
                    self.send(hello);
                }
                HostMessage::Command(Command::Status) => self.status(0),
                HostMessage::Command(_) => {}
            }
        }
    }
}

pub(super) struct Wire {
    pub(super) state: Arc<Mutex<State>>,
    start: Instant,
}

impl Wire {
    pub(super) fn new(kind: &'static str, seed: u32) -> Self {
        let mut state = State {
            reads: 0,
            tick: 1000,
            boot: 7,
            sequence: 0,
            random: seed,
            out: VecDeque::new(),
            decoder: Decoder::new(),
            kind,
            sent: Vec::new(),
        };
        if kind.starts_with("old bytes") || kind.starts_with("an old hello") {
            // What a probe's buffer may hold: another boot, far ahead, with its answers.
            (state.boot, state.tick) = (3, 900_000);
            for sequence in 0..40 {
                state.send(DeviceMessage::Ack(Ack { command_sequence: sequence, result: CommandResult::Done }));
                let hello = state.hello();
                state.send(hello);
                state.good();
            }
            (state.boot, state.tick) = (7, 1000);
            state.sent.clear();
        }
        Self { state: Arc::new(Mutex::new(state)), start: Instant::now() }
    }
}

impl Source for Wire {
    fn open(&mut self) -> io::Result<Box<dyn Link>> {
        Ok(Box::new(End(self.state.clone())))
    }

    fn now(&self) -> Instant {
        self.start + Duration::from_millis(20) * self.state.lock().unwrap().reads
    }

    fn pause(&mut self, _: Duration) {
        self.state.lock().unwrap().reads += 1;
    }

    fn remedy(&self) -> String {
        "Plug it in".to_owned()
    }
}

struct End(Arc<Mutex<State>>);

impl Link for End {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let state = &mut *self.0.lock().unwrap();
        state.reads += 1;
        if state.reads > GOOD || state.kind.ends_with("from the start") {
            match state.kind {
                "an end" => return Ok(0),
                "errors" => return Err(io::Error::other("a fault\u{1b}[31m")),
                _ => state.misbehave(),
            }
        } else {
            state.good();
        }
        let n = buffer.len().min(state.out.len());
        if n == 0 {
            return Err(io::ErrorKind::TimedOut.into());
        }
        buffer.iter_mut().zip(state.out.drain(..n)).for_each(|(to, byte)| *to = byte);
        // A line has no room for more.
        state.out.truncate(1 << 16);
        Ok(n)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.lock().unwrap().receive(bytes);
        Ok(())
    }
}
