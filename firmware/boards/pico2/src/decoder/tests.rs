use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::vec::Vec;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use whirl_firmware::QuadratureCounter;
use whirl_firmware::quadrature::Encoder;
use whirl_hil_sim::encoder::{Disc, count_of};

use super::*;
use crate::interpreter::StateMachine;

const TAU: f64 = core::f64::consts::TAU;
/// Cycles of the longest round, as the head of this file says.
const ROUND: u64 = 13;

/// The state machine on a disc of 1024 lines.
struct Bench {
    machine: StateMachine,
    disc: Disc,
    edges: VecDeque<u32>,
}

fn pins((a, b): (bool, bool)) -> u32 {
    u32::from(a) | u32::from(b) << 1
}

impl Bench {
    fn new(angle: f64) -> Self {
        let mut machine = StateMachine::new(&program());
        let disc = Disc::new(1_024, angle);
        machine.pins = pins(disc.levels());
        for &instruction in &start().code {
            assert_eq!(machine.execute(instruction), None);
        }
        let mut bench = Self { machine, disc, edges: VecDeque::new() };
        bench.run(2 * ROUND);
        bench
    }

    fn run(&mut self, cycles: u64) {
        (0..cycles).for_each(|_| self.machine.step());
    }

    /// Turns the disc; edges come `cycles` apart.
    fn turn_to(&mut self, angle: f64, cycles: u64) {
        let edges = &mut self.edges;
        self.disc.turn_to(angle, |a, b| edges.push_back(pins((a, b))));
        while let Some(levels) = self.edges.pop_front() {
            self.machine.pins = levels;
            self.run(cycles);
        }
    }

    fn count(&mut self) -> i32 {
        // What is on its way through the machine.
        self.run(2 * ROUND);
        self.machine.entries[COUNT].expect("a count is there from the first round on").cast_signed()
    }
}

#[test]
fn the_program_fits_with_its_table_first() {
    let program = program();
    assert_eq!((program.origin, program.code.len()), (Some(0), 29));
    // The table's entries are jumps without a condition.
    assert!(program.code[..16].iter().all(|code| code & 0xffe0 == 0), "{:04x?}", program.code);
    assert_eq!(start().code.len(), 4);
}

#[test]
fn every_edge_counts_one_in_both_senses_over_many_turns() {
    for start in [0.0, 0.3, 1.1, 2.9, -0.001] {
        let mut bench = Bench::new(start);
        let at = |angle: f64| i32::try_from(count_of(angle, 4_096)).unwrap();
        assert_eq!(bench.count(), 0, "a pair that stands is no edge");
        let mut random = ChaCha8Rng::seed_from_u64(12);
        let mut angle = start;
        for _ in 0..200 {
            angle += (f64::from(random.next_u32()) / f64::from(u32::MAX) - 0.5) * 3.0 * TAU;
            // As fast as the head of the file promises.
            bench.turn_to(angle, ROUND);
            assert_eq!(bench.count(), at(angle) - at(start));
        }
        bench.turn_to(start + 40.0 * TAU, ROUND);
        assert_eq!(bench.count(), 40 * 4_096);
        // In two steps: the disc leaves out what a counter of 16 bits could not tell.
        bench.turn_to(start, ROUND);
        bench.turn_to(start - 40.0 * TAU, ROUND);
        assert_eq!(bench.count(), -40 * 4_096);
    }
}

#[test]
fn a_round_takes_no_longer_than_promised() {
    let mut bench = Bench::new(0.0);
    bench.machine.jump_pin = true;
    let mut longest = 0;
    for step in 0..2_000 {
        let (before, entry) = (bench.machine.cycles, bench.machine.entries[COUNT]);
        bench.turn_to((f64::from(step) + 1.5) * TAU / 4_096.0, 0);
        while bench.machine.entries[COUNT] == entry && bench.machine.cycles < before + 100 {
            bench.machine.step();
        }
        // From the edge to the count that has it: one look that came just too early, and a round.
        longest = longest.max(bench.machine.cycles - before);
    }
    assert!(longest <= 2 * ROUND, "{longest}");
    // 10 MHz by 13 cycles: 769 thousand edges a second. The rig's 20 turns a second are 82
    // thousand.
    assert!(150e6 / f64::from(DIVIDER) / ROUND as f64 > 9.0 * 20.0 * 4_096.0);
}

#[test]
fn the_count_goes_through_zero_and_through_2_to_the_16() {
    let mut bench = Bench::new(0.0);
    let angle = |count: i32| (f64::from(count) + 0.5) * TAU / 4_096.0;
    for count in [1, 0, -1, -2, 1, 32_767, 32_768, 65_535, 65_536, 65_535, -65_537, 0] {
        bench.turn_to(angle(count), ROUND);
        assert_eq!(bench.count(), count);
    }
}

#[test]
fn spikes_on_a_line_and_trembling_lose_nothing() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut bench = Bench::new(0.1);
    let (mut angle, begin) = (0.1, count_of(0.1, 4_096));
    for _ in 0..5_000 {
        angle += (f64::from(random.next_u32() % 7) - 2.5) * TAU / 4_096.0;
        bench.turn_to(angle, ROUND + u64::from(random.next_u32() % 20));
        // A spike of any length on one line; the other one stands meanwhile.
        let quiet = bench.machine.pins;
        bench.machine.pins ^= 1 << (random.next_u32() % 2);
        bench.run(u64::from(random.next_u32() % 30));
        bench.machine.pins = quiet;
        bench.run(ROUND);
        assert_eq!(i64::from(bench.count()), count_of(angle, 4_096) - begin);
    }
}

#[test]
fn both_lines_at_once_move_nothing() {
    let mut bench = Bench::new(0.0);
    for _ in 0..10 {
        bench.machine.pins ^= 3;
        assert_eq!(bench.count(), 0);
    }
}

/// What the library sees of it.
struct Counter(Rc<RefCell<Bench>>, Mark);

impl QuadratureCounter for Counter {
    fn count(&mut self) -> u16 {
        self.0.borrow_mut().count() as u16
    }
    fn index(&mut self) -> Option<u16> {
        let bench = self.0.borrow();
        let entry = bench.machine.entries[MARK].unwrap_or(0);
        self.1.left(entry, bench.machine.jump_pin)
    }
}

/// The places of the turn at which the index is told, with edges so many cycles apart.
fn told_places(cycles: u64) -> Vec<i32> {
    let bench = Rc::new(RefCell::new(Bench::new(0.0)));
    let (mut counter, mut encoder) = (Counter(bench.clone(), Mark::new(0)), Encoder::new(false, 0));
    let (mut told, mut at) = (Vec::new(), 0_i32);
    // 300 counts a tick up, then down, and up again: the mark, three counts from 1000 on, begins
    // and ends within a tick.
    for (ticks, step) in [(60, 300), (40, -300), (20, 0), (60, 301)] {
        for _ in 0..ticks {
            for _ in 0..i32::abs(step) {
                at += i32::signum(step);
                let mut bench = bench.borrow_mut();
                bench.machine.jump_pin = (1_000..1_003).contains(&at.rem_euclid(4_096));
                bench.turn_to((f64::from(at) + 0.5) * TAU / 4_096.0, cycles);
            }
            let latched = counter.count();
            assert_eq!(encoder.extend(latched), at);
            let seen = counter.index().and_then(|seen| encoder.index(seen, latched));
            told.extend(seen.map(|place| place.rem_euclid(4_096)));
        }
    }
    told
}

#[test]
fn the_index_is_told_where_its_mark_ends_and_only_on_the_way_up() {
    // Five times up and, after three down, four times.
    assert_eq!(told_places(2 * ROUND), [1_002; 9]);
    // At nine times the rig's speed a count beside it, within what the library takes for the same
    // place; where the mark was left upward at the very count at which it had been left downward,
    // nothing is new.
    let fast = told_places(ROUND);
    assert!(fast.len() >= 8 && fast.iter().all(|place| (1_001..=1_002).contains(place)), "{fast:?}");
}

#[test]
fn an_index_that_is_not_wired_is_never_told() {
    let mut bench = Bench::new(0.0);
    bench.machine.jump_pin = true;
    let mut mark = Mark::new(0);
    for turn in 1..20 {
        bench.turn_to(f64::from(turn) * 0.7, ROUND);
        let entry = bench.machine.entries[MARK].unwrap();
        assert_eq!(mark.left(entry, bench.machine.jump_pin), None);
    }
}
