//! The whole application against a host that decodes what comes out.

use std::vec::Vec;

use super::*;
use crate::testing::{Counter, Host, Recorder};
use whirl_shared::block::{Counts, Sample, sample_count, samples};
use whirl_shared::codec::MAX_FRAME;
use whirl_shared::frame::*;
use whirl_shared::sequence::SequenceTracker;
use whirl_shared::tick::{TickEvent, TickTracker};

mod crowded;

type Whole<const B: usize = BLOCKS, const E: usize = EVENTS, const R: usize = REQUESTS> =
    App<(Counter, Counter), Recorder, B, E, R>;

const START: Command = Command::Start { amplitude_micrometre: 15_525, frequency_millihertz: 5_200 };

/// Application and host, ticking together over a perfect link.
struct Rig<const B: usize = BLOCKS, const E: usize = EVENTS, const R: usize = REQUESTS> {
    app: Whole<B, E, R>,
    host: Host,
    tick: u32,
    /// What the host should get.
    truth: Vec<Sample>,
}

/// Counts that swing over several turns, and that turn steadily: the n-th sample's.
fn motion(n: u32) -> [i32; 2] {
    let t = i64::from(n);
    // A parabola there and back every 400 samples, 60 000 counts deep.
    let swing = (t % 400 - 200) * (t % 400 - 200) * 3 / 2 - 60_000;
    [swing as i32, (-1_237 * t) as i32]
}

/// The first difference, instead of thousands of samples.
fn assert_equal(got: &[Sample], want: &[Sample]) {
    assert_eq!(got.len(), want.len());
    if let Some((got, want)) = got.iter().zip(want).find(|(got, want)| got != want) {
        assert_eq!(got, want);
    }
}

impl<const B: usize, const E: usize, const R: usize> Rig<B, E, R> {
    fn new() -> Self {
        let settings = Settings { board: "test bench", boot_id: 77, ..Settings::default() };
        let app = App::with_queues(settings, (Counter(0), Counter(0)), Recorder::default()).unwrap();
        Self { app, host: Host::new(), tick: 0, truth: Vec::new() }
    }

    fn command(&mut self, command: Command) {
        let frame = self.host.frame(command);
        self.app.receive(&frame);
    }

    /// One tick without transmission.
    fn sample(&mut self, missed: u32) {
        self.tick = self.tick.wrapping_add(missed);
        let counts = motion(self.truth.len() as u32);
        let (counter1, counter2) = self.app.inputs_mut();
        (*counter1, *counter2) = (Counter(counts[0] as u16), Counter(counts[1] as u16));
        self.app.tick(missed, self.tick % 13);
        self.truth.push(Sample { tick: self.tick, phase: self.app.drive().phase, counts: Counts::of(&counts) });
        self.tick = self.tick.wrapping_add(1);
    }

    fn transmit(&mut self) {
        let mut out = [0; MAX_FRAME];
        while let Some(length) = self.app.poll_transmit(&mut out) {
            self.host.take(&out[..length]);
        }
    }

    fn run(&mut self, ticks: u32) {
        for _ in 0..ticks {
            if self.tick.is_multiple_of(100) {
                self.command(Command::KeepAlive);
            }
            self.sample(0);
            self.transmit();
        }
    }

    fn messages(&self) -> impl Iterator<Item = &DeviceMessage> {
        self.host.received.iter().map(|envelope| &envelope.message)
    }

    fn samples(&self) -> Vec<Sample> {
        self.messages()
            .filter_map(|message| if let DeviceMessage::Samples(block) = message { Some(block) } else { None })
            .flat_map(samples)
            .collect()
    }

    fn acks(&self) -> Vec<(u16, CommandResult)> {
        let ack = |message: &_| {
            if let DeviceMessage::Ack(ack) = message { Some((ack.command_sequence, ack.result)) } else { None }
        };
        self.messages().filter_map(ack).collect()
    }
}

fn rig() -> Rig {
    Rig::new()
}

#[test]
fn everything_arrives_exactly() {
    let mut rig = rig();
    rig.run(250);
    rig.command(Command::Arm);
    rig.command(START);
    rig.run(5_000);
    rig.command(Command::Stop);
    rig.run(750);

    // Counts, ticks and phases, bit for bit; what is not in a full block yet may be missing at the
    // end.
    let got = rig.samples();
    assert!(rig.truth.len() - got.len() < BLOCK_LEN);
    assert_equal(&got, &rig.truth[..got.len()]);
    // 250 ticks at rest, then the tick that starts it; the phase is that of 5.2 Hz rounded to 2⁻³²
    // turns.
    for (n, sample) in got.iter().enumerate().skip(251).take(5_000) {
        assert_eq!(sample.phase, 44_667_660_u32.wrapping_mul(n as u32 - 251));
    }
    assert!(rig.acks().iter().all(|ack| ack.1 == CommandResult::Done));
    assert_eq!(rig.acks().len(), 63);

    let mut frames = SequenceTracker::new();
    rig.host.received.iter().for_each(|envelope| {
        frames.observe(envelope.sequence);
    });
    assert_eq!((frames.counters().lost, frames.counters().duplicate), (0, 0));
    let status = rig.app.status();
    assert_eq!(status.samples_sent as usize, got.len());
    assert_eq!([status.overruns, status.dropped_samples, status.dropped_frames, status.bad_frames], [0; 4]);
}

#[test]
fn the_first_frame_is_a_hello_that_tells_everything() {
    let mut rig = rig();
    rig.transmit();
    rig.run(30);
    let Some(DeviceMessage::Hello(hello)) = rig.messages().next() else { panic!("no hello") };
    let limits = Settings::default().limits;
    assert_eq!((hello.protocol, hello.schema, hello.boot_id, hello.tick), (PROTOCOL_VERSION, SCHEMA_HASH, 77, 0));
    assert_eq!((hello.board.as_str(), hello.firmware.as_str()), ("test bench", crate::link::FIRMWARE));
    assert_eq!((hello.limits, hello.host_timeout_ms, hello.block_len), (limits, 2_000, BLOCK_LEN as u8));
    assert_eq!((hello.sample_rate_millihertz, &hello.counts_per_turn[..]), (500_000, &[4096; 2][..]));
    // After a change of settings there is another.
    rig.command(Command::SetHostTimeout { ms: 700 });
    rig.run(1);
    let last = rig.messages().filter_map(|m| if let DeviceMessage::Hello(h) = m { Some(h) } else { None }).last();
    assert_eq!(last.map(|hello| (hello.tick, hello.host_timeout_ms)), Some((31, 700)));
}

#[test]
fn the_hello_tells_the_build() {
    let settings = Settings { build: "0123456789abcdef", ..Settings::default() };
    let mut rig = rig();
    rig.app = App::new(settings, (Counter(0), Counter(0)), Recorder::default()).unwrap();
    rig.transmit();
    let Some(DeviceMessage::Hello(hello)) = rig.messages().next() else { panic!("no hello") };
    assert_eq!(hello.firmware.as_str(), std::format!("{} (0123456789abcdef)", crate::link::FIRMWARE));
    let long = Settings { build: "0123456789abcdefg", ..Settings::default() };
    assert_eq!(long.validate().unwrap_err().field, "build (length)");
}

#[test]
fn damaged_out_of_range_and_misplaced_commands_change_nothing() {
    let mut rig = rig();
    let mut quiet = self::rig();
    let good = rig.host.frame(Command::Arm);
    for place in 0..good.len() - 1 {
        for bit in 0..8 {
            let mut bad = good.clone();
            bad[place] ^= 1 << bit;
            rig.app.receive(&bad);
        }
    }
    // Out of step by a truncated frame, then noise; a zero puts it right.
    rig.app.receive(&good[..3]);
    rig.app.receive(&[0, 0xff, 0xff, 0]);
    rig.sample(0);
    quiet.sample(0);
    assert!(rig.app.status().bad_frames > 8 * (good.len() as u32 - 1));
    assert_eq!(rig.app.status(), Status { bad_frames: rig.app.status().bad_frames, ..quiet.app.status() });
    rig.transmit();
    assert_eq!(rig.acks(), []);

    rig.command(START);
    rig.command(Command::SetHostTimeout { ms: 1 });
    rig.sample(0);
    quiet.sample(0);
    rig.transmit();
    let results: Vec<_> = rig.acks().iter().map(|ack| ack.1).collect();
    assert_eq!(results, [CommandResult::WrongState, CommandResult::OutOfRange { limit: 100 }]);
    let status = rig.app.status();
    assert_eq!(status.rejected_commands, 2);
    assert_eq!((status.shaker, rig.app.drive().phase_increment), (ShakerState::Disarmed, 0));
    assert_eq!(rig.app.output_mut(), quiet.app.output_mut());
}

#[test]
fn silence_of_the_host_stops_the_shaker_and_is_reported() {
    let mut rig = rig();
    rig.command(Command::Arm);
    rig.command(START);
    rig.run(1_000);
    let status = rig.app.status();
    assert_eq!(
        (status.shaker, status.amplitude_nanometre, status.frequency_millihertz),
        (ShakerState::Running, 15_525_000, 5_200)
    );
    for _ in 0..2_000 {
        rig.sample(0);
        rig.transmit();
    }
    let status = rig.app.status();
    assert_eq!((status.shaker, status.stop_cause), (ShakerState::Disarmed, StopCause::HostSilent));
    assert_eq!((status.amplitude_nanometre, rig.app.drive().phase_increment), (0, 0));
    assert_eq!(rig.app.output_mut().writes.last(), Some(&0));
    let logs: Vec<_> =
        rig.messages().filter_map(|m| if let DeviceMessage::Log(l) = m { Some(l.level) } else { None }).collect();
    assert_eq!(logs, [1]);
}

#[test]
fn the_tick_runs_over_two_to_the_32() {
    let mut rig = rig();
    rig.run(3);
    // Two leaps of less than 2³¹: a longer gap is ambiguous to the host.
    rig.sample((1 << 31) - 2_000);
    rig.sample((1 << 31) - 2_000);
    rig.run(6_000);
    assert!(rig.tick < 3_000);
    let got = rig.samples();
    assert_equal(&got, &rig.truth[..got.len()]);
    let mut ticks = TickTracker::new();
    for message in rig.messages() {
        if let DeviceMessage::Samples(block) = message {
            ticks.block(block.first_tick, sample_count(block));
        }
    }
    assert_eq!(ticks.expected(), Some((1 << 32) + u64::from(got.last().unwrap().tick) + 1));
    assert_eq!(ticks.counters().missing, (1 << 32) - 4_000);
    assert_eq!(rig.app.status().overruns, u32::MAX - 3_999);
}

#[test]
fn equal_inputs_give_equal_bytes() {
    let run = || {
        let mut rig = rig();
        rig.command(Command::Arm);
        rig.run(10);
        rig.command(START);
        rig.run(2_000);
        rig.sample(5);
        rig.run(100);
        rig.host.bytes
    };
    let bytes = run();
    assert!(bytes.len() > 2_000 * 4);
    assert_eq!(bytes, run());
}

#[test]
fn rows_are_streamed_instead_of_samples_for_as_long_as_that_is_asked() {
    let mut rig = rig();
    rig.command(Command::Arm);
    rig.command(START);
    rig.command(Command::Stream(Streamed::Rows));
    rig.run(1);
    let before = rig.samples().len();
    // The ramp, and a window of twenty periods.
    rig.run(2_500);
    assert_eq!(rig.samples().len(), before);
    let rows = rig.messages().filter(|message| matches!(message, DeviceMessage::Rows(_))).count();
    assert_eq!(rows, crate::identification::ROWS_MESSAGES);
    rig.command(Command::Stream(Streamed::Samples));
    rig.run(100);
    assert!(rig.samples().len() >= before + 90);
}

#[test]
fn a_buffer_that_is_too_small_takes_nothing() {
    let mut rig = rig();
    assert_eq!(rig.app.poll_transmit(&mut [0; MAX_FRAME - 1]), None);
    assert_eq!(rig.app.poll_transmit(&mut []), None);
    rig.transmit();
    assert!(matches!(rig.messages().next(), Some(DeviceMessage::Hello(_))));
}

#[test]
fn the_status_previews_angle_and_turning_rate() {
    let mut rig = rig();
    rig.run(1_001);
    let status =
        rig.messages().filter_map(|m| if let DeviceMessage::Status(s) = m { Some(s) } else { None }).last().unwrap();
    assert_eq!((status.tick, status.latency_max_us), (1_000, 12));
    // Encoder 2 turns by −1237 of 4096 counts a tick: −9060 turns a minute, spread evenly over the
    // circle.
    assert!((f64::from(status.turns_per_minute_milli[1]) / -9_059_937.5 - 1.0).abs() < 1e-3);
    assert!((f64::from(status.rms_angle_mrad[1]) / 1_813.8 - 1.0).abs() < 0.01);
}

#[test]
fn the_two_halves_on_split_queues_send_the_same_bytes() {
    let settings = Settings { board: "test bench", boot_id: 77, ..Settings::default() };
    let mut sampler = Sampler::new(&settings, (Counter(0), Counter(0)), Recorder::default()).unwrap();
    let mut link = Link::new(&settings).unwrap();
    let (mut blocks, mut events) = (Queue::<SampleBlock, BLOCKS>::new(), Queue::<Event, EVENTS>::new());
    let mut requests = Queue::<Request, REQUESTS>::new();
    let (mut blocks_in, mut blocks_out) = blocks.split();
    let (mut events_in, mut events_out) = events.split();
    let (mut requests_in, mut requests_out) = requests.split();
    let mut rig = rig();
    rig.command(Command::Arm);
    rig.run(300);

    let mut host = Host::new();
    let mut out = [0; MAX_FRAME];
    link.receive(&host.frame(Command::Arm), &mut requests_in);
    for tick in 0..300 {
        if tick % 100 == 0 {
            link.receive(&host.frame(Command::KeepAlive), &mut requests_in);
        }
        let counts = motion(tick);
        let ((counter1, counter2), _) = sampler.parts_mut();
        (*counter1, *counter2) = (Counter(counts[0] as u16), Counter(counts[1] as u16));
        sampler.tick(0, tick % 13, &mut blocks_in, &mut events_in, &mut requests_out);
        while let Some(length) = link.poll_transmit(&mut out, &mut blocks_out, &mut events_out) {
            host.take(&out[..length]);
        }
    }
    assert_eq!(host.bytes, rig.host.bytes);
}
