//! Order within a tick, early blocks, full queues, missed ticks.

mod channels;

use heapless::spsc::Queue;
use std::cell::RefCell;
use std::rc::Rc;
use std::vec::Vec;
use std::{format, vec};

use super::*;
use crate::event::Notice;
use crate::quadrature::QuadratureCounter;
use crate::testing::{Counter, Recorder};
use whirl_shared::block::samples;
use whirl_shared::frame::{Ack, Command, CommandResult};

/// A sampler with queues of its own.
struct Bench<const B: usize = 64, const E: usize = 64> {
    sampler: Sampler<(Counter, Counter), Recorder>,
    blocks: Queue<SampleBlock, B>,
    events: Queue<Event, E>,
    requests: Queue<Request, 16>,
}

impl<const B: usize, const E: usize> Bench<B, E> {
    fn new() -> Self {
        let sampler = Sampler::new(&Settings::default(), (Counter(0), Counter(0)), Recorder::default()).unwrap();
        Self { sampler, blocks: Queue::new(), events: Queue::new(), requests: Queue::new() }
    }

    fn tick(&mut self, missed: u32) {
        self.sampler.tick(missed, 3, &mut self.blocks, &mut self.events, &mut self.requests);
    }

    fn ticks(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.tick(0);
        }
    }

    fn request(&mut self, command: Command) {
        self.requests.enqueue(Request { sequence: 9, command }).unwrap();
    }

    fn blocks(&mut self) -> Vec<SampleBlock> {
        core::iter::from_fn(|| self.blocks.dequeue()).collect()
    }

    fn events(&mut self) -> Vec<Event> {
        core::iter::from_fn(|| self.events.dequeue()).collect()
    }
}

/// Bench with the default queues.
fn bench() -> Bench {
    Bench::new()
}

fn spans(blocks: &[SampleBlock]) -> Vec<(u32, u32)> {
    blocks.iter().map(|block| (block.first_tick, sample_count(block))).collect()
}

const START: Command = Command::Start { amplitude_micrometre: 1_000, frequency_millihertz: 5_000 };

#[test]
fn counters_are_read_before_the_output_is_written() {
    type Trace = Rc<RefCell<Vec<&'static str>>>;
    struct Traced(Trace, &'static str);
    impl QuadratureCounter for Traced {
        fn count(&mut self) -> u16 {
            self.0.borrow_mut().push(self.1);
            0
        }
    }
    impl ShakerOutput for Traced {
        type Error = ();
        fn write(&mut self, _: i32) -> Result<(), ()> {
            self.0.borrow_mut().push(self.1);
            Ok(())
        }
    }
    let trace = Trace::default();
    let part = |name| Traced(trace.clone(), name);
    let mut sampler = Sampler::new(&Settings::default(), (part("1"), part("2")), part("write")).unwrap();
    let (mut blocks, mut events): (Queue<SampleBlock, 4>, Queue<Event, 8>) = (Queue::new(), Queue::new());
    let mut requests: Queue<Request, 8> = Queue::new();
    for command in [Command::Arm, START] {
        requests.enqueue(Request { sequence: 0, command }).unwrap();
    }
    sampler.tick(0, 0, &mut blocks, &mut events, &mut requests);
    trace.borrow_mut().clear();
    sampler.tick(0, 0, &mut blocks, &mut events, &mut requests);
    assert_eq!(*trace.borrow(), ["1", "2", "write"]);
}

#[test]
fn a_request_acts_from_the_next_tick_on() {
    let mut bench = bench();
    bench.request(Command::Arm);
    bench.request(START);
    bench.tick(0);
    // The sample of the tick that carried them out still says rest; the state is that of now.
    assert_eq!(bench.sampler.drive(), Drive { state: ShakerState::Ramping, ..Drive::default() });
    bench.tick(0);
    let drive = bench.sampler.drive();
    assert_eq!((drive.phase, drive.phase_increment, drive.amplitude_nanometre), (0, 42_949_673, 0));
    bench.tick(0);
    let drive = bench.sampler.drive();
    assert_eq!((drive.phase, drive.amplitude_nanometre), (42_949_673, 40_000));
}

#[test]
fn blocks_end_where_the_drive_changes() {
    let mut bench = bench();
    bench.ticks(12);
    bench.request(Command::Arm); // carried out in tick 12
    bench.tick(0);
    bench.ticks(2);
    bench.request(START); // carried out in tick 15; ramp from 16, 25 ticks long
    bench.ticks(31);
    bench.request(Command::Stop); // carried out in tick 46; ramp from 47, 25 ticks, one more at zero
    bench.ticks(44);
    let blocks = bench.blocks();
    let starts: Vec<u32> = blocks.iter().map(|block| block.first_tick).collect();
    assert_eq!(starts, [0, 10, 13, 16, 26, 36, 41, 47, 57, 67, 73]);
    // In a row without holes, and each with the drive's settings as they were.
    let end = spans(&blocks).iter().fold(0, |end, &(first, count)| {
        assert_eq!(first, end);
        first + count
    });
    assert_eq!(end, 83);
    for block in &blocks {
        assert_eq!(block.phase_increment != 0, (16..73).contains(&block.first_tick), "{block:?}");
        let amplitude = match block.first_tick {
            tick @ 16..41 => 40_000 * (tick - 16),
            41..47 => 1_000_000,
            tick @ 47..73 => 1_000_000 - 40_000 * (tick - 47),
            _ => 0,
        };
        assert_eq!(block.amplitude_nanometre, amplitude, "{block:?}");
    }
}

#[test]
fn missed_ticks_are_counted_and_skipped() {
    let mut bench = bench();
    bench.ticks(4);
    bench.tick(3);
    bench.ticks(9);
    let blocks = bench.blocks();
    assert_eq!(spans(&blocks), [(0, 4), (7, 10)]);
    let status = bench.sampler.snapshot().status;
    assert_eq!((status.overruns, status.tick, status.dropped_samples), (3, 17, 0));
}

#[test]
fn the_phase_keeps_up_with_missed_ticks() {
    let mut bench = bench();
    bench.request(Command::Arm);
    bench.request(START);
    bench.tick(0); // the run begins with tick 1
    bench.ticks(4);
    bench.tick(6);
    assert_eq!(bench.sampler.drive().phase, 10 * 42_949_673);
    let block = bench.blocks().pop().unwrap();
    assert_eq!((block.first_tick, sample_count(&block)), (1, 4));
}

#[test]
fn another_start_while_ramping_begins_a_block() {
    let mut bench = bench();
    bench.request(Command::Arm);
    bench.request(START);
    bench.ticks(5);
    bench.request(Command::Start { amplitude_micrometre: 2_000, frequency_millihertz: 5_000 });
    bench.ticks(11);
    assert_eq!(spans(&bench.blocks()), [(0, 1), (1, 5), (6, 10)]);
}

#[test]
fn a_full_block_queue_is_counted_in_samples() {
    // A queue of three slots holds two blocks.
    let mut bench: Bench<3> = Bench::new();
    bench.ticks(47);
    assert_eq!(bench.sampler.snapshot().status.dropped_samples, 20);
    assert_eq!(spans(&bench.blocks()), [(0, 10), (10, 10)]);
    bench.ticks(3);
    assert_eq!(spans(&bench.blocks()), [(40, 10)]);
}

#[test]
fn a_full_event_queue_is_counted() {
    let mut bench: Bench<64, 2> = Bench::new();
    for _ in 0..3 {
        bench.request(Command::KeepAlive);
    }
    bench.tick(0);
    assert_eq!(bench.events().len(), 1);
    assert_eq!(bench.sampler.snapshot().status.dropped_frames, 2);
}

#[test]
fn multi_turn_counts_over_the_16_bit_wrap() {
    let mut bench = bench();
    let mut want = Vec::new();
    for i in 0..40_i32 {
        let (one, two) = (i * 9_000, -i * 30_000);
        bench.sampler.inputs.0 = Counter(one as u16);
        bench.sampler.inputs.1 = Counter(two as u16);
        want.push([one, two]);
        bench.tick(0);
    }
    let got: Vec<_> = bench.blocks().iter().flat_map(|block| samples(block).collect::<Vec<_>>()).collect();
    assert_eq!(got.iter().map(|sample| sample.counts).collect::<Vec<_>>(), want);
}

#[test]
fn zeroing_starts_a_block_at_zero() {
    let mut bench = bench();
    bench.sampler.inputs.0 = Counter(50_000);
    bench.ticks(5);
    bench.request(Command::ZeroCounts);
    bench.tick(0);
    bench.sampler.inputs.0 = Counter(50_007);
    bench.ticks(10);
    let blocks = bench.blocks();
    assert_eq!(spans(&blocks), [(0, 6), (6, 10)]);
    assert_eq!((blocks[0].first[0], blocks[1].first[0]), (50_000 - 65_536, 7));
    // The jump is none of the turning rate's.
    bench.ticks(484);
    assert_eq!(bench.sampler.snapshot().turning[0].moved, 0);
}

#[test]
fn a_status_each_second_even_where_its_tick_was_missed() {
    let mut bench = bench();
    bench.ticks(499);
    assert_eq!(bench.events(), []);
    bench.tick(0);
    let status_ticks = |events: Vec<Event>| -> Vec<u32> {
        let tick = |event: &Event| if let Event::Status(snapshot) = event { Some(snapshot.status.tick) } else { None };
        events.iter().filter_map(tick).collect()
    };
    assert_eq!(status_ticks(bench.events()), [500]);
    bench.ticks(490);
    bench.tick(30);
    bench.ticks(479);
    assert_eq!(status_ticks(bench.events()), [1_021, 1_500]);
    bench.tick(u32::MAX);
    bench.ticks(500);
    assert_eq!(bench.events().len(), 2);
}

#[test]
fn the_greatest_latency_is_that_since_the_last_status() {
    let mut bench = bench();
    bench.sampler.tick(0, 17, &mut bench.blocks, &mut bench.events, &mut bench.requests);
    bench.ticks(499);
    bench.ticks(500);
    let latencies: Vec<u32> = bench
        .events()
        .iter()
        .filter_map(|event| if let Event::Status(s) = event { Some(s.status.latency_max_us) } else { None })
        .collect();
    assert_eq!(latencies, [17, 3]);
}

#[test]
fn requests_are_bounded_in_a_tick_and_answered_in_order() {
    let mut bench = bench();
    for command in [Command::Hello, START, Command::Status, Command::Arm, Command::KeepAlive] {
        bench.request(command);
    }
    bench.tick(0);
    let first = bench.events();
    bench.tick(0);
    let kinds = |events: &[Event]| {
        events.iter().map(|event| format!("{event:?}")[..3].into()).collect::<Vec<std::string::String>>()
    };
    assert_eq!(kinds(&first), ["Ack", "Hel", "Ack", "Exc", "Ack", "Sta", "Ack"]);
    assert_eq!(first[2], Event::Ack(Ack { command_sequence: 9, result: CommandResult::WrongState }));
    assert_eq!(kinds(&bench.events()), ["Ack"]);
    assert_eq!(bench.sampler.snapshot().status.rejected_commands, 1);
}

#[test]
fn counts_that_were_latched_are_those_of_the_next_tick_alone() {
    let mut bench = bench();
    bench.sampler.inputs.0 = Counter(100);
    bench.sampler.inputs.1 = Counter(200);
    bench.sampler.latch();
    // What moves between the latch and the tick is the next sample's.
    bench.sampler.inputs.0 = Counter(107);
    bench.sampler.inputs.1 = Counter(190);
    bench.ticks(10);
    let got: Vec<_> = samples(&bench.blocks()[0]).map(|sample| sample.counts).collect();
    assert_eq!(got[..3], [[100, 200], [107, 190], [107, 190]]);
}

#[test]
fn the_light_follows_host_and_shaker_over_each_second() {
    let mut bench = bench();
    // Ticks of a second in which it is on.
    fn lit(bench: &mut Bench) -> usize {
        (0..500)
            .filter(|_| {
                let on = bench.sampler.light();
                bench.tick(0);
                on
            })
            .count()
    }
    assert_eq!([lit(&mut bench), lit(&mut bench)], [30, 30]);
    bench.request(Command::KeepAlive);
    bench.ticks(500);
    assert_eq!(lit(&mut bench), 470);
    // Two seconds after the host was heard last.
    bench.ticks(500);
    assert_eq!(lit(&mut bench), 30);
    bench.request(Command::Arm);
    bench.ticks(500);
    assert_eq!(lit(&mut bench), 250);
}

#[test]
fn silence_of_the_host_is_told() {
    let mut bench = bench();
    bench.request(Command::Arm);
    bench.ticks(1_100);
    let notices: Vec<_> = bench
        .events()
        .into_iter()
        .filter_map(|event| if let Event::Log { tick, notice } = event { Some((tick, notice)) } else { None })
        .collect();
    assert_eq!(notices, vec![(1_001, Notice::HostSilent)]);
}
