//! The player on a model of its timers and its DMA channel, clock by clock.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::boxed::Box;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::vec::Vec;

use super::*;
use crate::sweep::{CATCH_UP, Scale, Sweep};

const FIVE_HERTZ: u32 = 42_949_673;

fn sweep(tick: u32) -> Sweep<'static> {
    Sweep {
        phase: FIVE_HERTZ.wrapping_mul(tick),
        phase_increment: FIVE_HERTZ,
        amplitude_nanometre: [15_525_000; 2],
        ..Sweep::default()
    }
}

/// Both timers and the channel, by clocks from tick 0 on.
#[derive(Default)]
struct Chip {
    clock: i64,
    /// By how many clocks the points' timer is ahead of the tick's.
    ahead: i64,
    clocks_per_point: i64,
    clocks_per_count: i64,
    counts_per_tick: i64,
    /// Clocks of a register's access.
    slow: i64,
    /// A code goes out with the wrap behind the one that brings it, as a pulse's width does.
    buffered: bool,
    written: u16,
    run: VecDeque<u16>,
    /// What was out at each point's end (one whose wrap fell into the start of a run is some clocks
    /// late), and every code that was out, one after the other.
    points: Vec<u16>,
    out: Vec<u16>,
}

impl Chip {
    fn pass(&mut self, clocks: i64) {
        let end = self.clock + clocks;
        loop {
            let wrap = (self.clock + self.ahead).div_euclid(self.clocks_per_point) + 1;
            let at = wrap * self.clocks_per_point - self.ahead;
            if at > end {
                break;
            }
            self.clock = at;
            let stood = *self.out.last().unwrap();
            self.points.resize(wrap as usize, stood);
            if self.buffered {
                self.out.push(self.written);
            }
            if let Some(code) = self.run.pop_front() {
                self.write(code);
            }
        }
        self.clock = end;
    }

    fn write(&mut self, code: u16) {
        self.written = code;
        if !self.buffered {
            self.out.push(code);
        }
    }
}

/// As a board's registers: `B` where codes are buffered.
#[derive(Clone)]
struct Model<const B: bool>(Rc<RefCell<Chip>>);

impl<const B: bool> Model<B> {
    fn access(&self) -> std::cell::RefMut<'_, Chip> {
        let mut chip = self.0.borrow_mut();
        let slow = chip.slow;
        chip.pass(slow);
        chip
    }
}

impl<const B: bool> Channel for Model<B> {
    const MAX: u16 = if B { 3_750 } else { 4_095 };
    const AHEAD: usize = if B { 1 } else { 0 };
    const UNCLEAR: u32 = 8;

    fn since_tick(&self) -> u32 {
        let chip = self.access();
        (chip.clock / chip.clocks_per_count % chip.counts_per_tick) as u32
    }
    fn write(&mut self, code: u16) {
        self.access().write(code);
    }
    fn start(&mut self, codes: &[u16]) {
        self.access().run = codes.iter().copied().collect();
    }
    fn left(&self) -> usize {
        self.access().run.len()
    }
    fn stop(&mut self) {
        self.access().run.clear();
    }
}

/// A board: its player, and its chip.
struct Board<const B: bool> {
    chip: Rc<RefCell<Chip>>,
    player: Player<Model<B>>,
    per_tick: i64,
}

impl<const B: bool> Board<B> {
    const SCALE: Scale = Scale { max: Model::<B>::MAX, full_nanometre: 25_000_000 };

    fn new(timer_hertz: u32, rate_hertz: u32, ahead: i64) -> Self {
        let schedule = schedule(timer_hertz, rate_hertz * 1_000).unwrap();
        let chip = Chip {
            ahead,
            clocks_per_point: i64::from(schedule.point_reload) + 1,
            clocks_per_count: i64::from(schedule.prescaler) + 1,
            counts_per_tick: i64::from(schedule.period()),
            slow: 12,
            buffered: B,
            out: Vec::from([0]),
            ..Chip::default()
        };
        let per_tick = chip.clocks_per_count * chip.counts_per_tick;
        let chip = Rc::new(RefCell::new(chip));
        let runs = Box::leak(Box::new([[0; MOST + BEYOND]; 2]));
        let player = Player::new(Model(Rc::clone(&chip)), runs, schedule);
        // Rest is half of the range.
        assert_eq!(chip.borrow().written, Model::<B>::MAX / 2 + Model::<B>::MAX % 2);
        Self { chip, player, per_tick }
    }

    /// The interrupt of a tick, so many clocks behind it, with so many of work, as
    /// [`crate::dac::DacShaker`] does it.
    fn tick(&mut self, tick: u32, late: i64, work: i64) {
        let now = self.chip.borrow().clock;
        self.pass(i64::from(tick) * self.per_tick + late - now);
        let points = self.player.points();
        let (point, standing) = self.player.standing();
        Self::SCALE.fill(&sweep(tick), self.player.room(), points, point, standing).unwrap();
        self.pass(work);
        self.player.play();
    }

    fn pass(&self, clocks: i64) {
        self.chip.borrow_mut().pass(clocks);
    }

    fn clocks(&self, points: i64) -> i64 {
        points * self.chip.borrow().clocks_per_point
    }

    fn below(&self, random: &mut ChaCha8Rng, points: i64) -> i64 {
        i64::from(random.next_u32()) % self.clocks(points)
    }

    /// Greatest step of a run that catches up; codes are whole.
    fn slew(&self) -> u16 {
        let points = self.player.points() as f64;
        let own = 15_525_000.0 * std::f64::consts::TAU * f64::from(FIVE_HERTZ) / 4_294_967_296.0 / points;
        let own = own * f64::from(Model::<B>::MAX) / 50e6;
        (f64::from(CATCH_UP) * own + 2.0) as u16
    }

    fn steps(&self, from: usize) -> u16 {
        let chip = self.chip.borrow();
        chip.out[from..].windows(2).map(|pair| pair[0].abs_diff(pair[1])).max().unwrap_or(0)
    }
}

/// Timers of the NUCLEO boards (170 and 90 MHz; a tick's counts are no whole number of points) and
/// of the Pico 2.
fn in_time<const B: bool>(timer_hertz: u32) {
    for (rate, ahead) in [(500, 0), (500, 9), (500, -9), (250, 3), (1_000, -3), (2_000, 5)] {
        let mut board = Board::<B>::new(timer_hertz, rate, ahead);
        let mut random = ChaCha8Rng::seed_from_u64(12);
        for n in 1..400 {
            // Latency of up to three points; then as long as a run takes, and any register may be
            // slow.
            let late = board.below(&mut random, 3) * i64::from(n % 3 == 0);
            let work = board.below(&mut random, 3);
            board.chip.borrow_mut().slow = 4 + i64::from(random.next_u32() % 60);
            board.tick(n, late, work);
        }
        let (chip, points) = (board.chip.borrow(), board.player.points());
        for n in 100..399 {
            let exact = Board::<B>::SCALE.code(sweep(n).start()).unwrap();
            assert_eq!(chip.points[n as usize * points], exact, "{rate} Hz, {ahead} clocks ahead, tick {n}");
        }
        // No point is left out, and none is played twice: in between it is the cosine to a step.
        let half = f64::from(Model::<B>::MAX) / 2.0;
        for (point, &code) in chip.points.iter().enumerate().skip(100 * points) {
            let turns = f64::from(FIVE_HERTZ) / 4_294_967_296.0 * point as f64 / points as f64;
            let exact = half * (1.0 + 0.621 * libm::cos(std::f64::consts::TAU * turns));
            assert!((f64::from(code) - exact).abs() <= 1.01, "{rate} Hz, point {point}: {code} for {exact}");
        }
    }
}

#[test]
fn at_the_ticks_it_is_the_accumulator_s_waveform_bit_for_bit() {
    in_time::<false>(170_000_000);
    in_time::<false>(90_000_000);
    in_time::<true>(150_000_000);
}

/// Ticks in a row, then some that are missed, over and over; interrupts come late, now and then
/// when the last run has ended. `work` in points.
fn missed<const B: bool>(timer_hertz: u32, rate: u32, mut work: impl FnMut(u32, u32) -> i64) {
    let mut board = Board::<B>::new(timer_hertz, rate, -7);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut tick = 1;
    for round in 0..600 {
        for n in 0..10 {
            let points = if random.next_u32().is_multiple_of(4) { 14 } else { 1 };
            let late = board.below(&mut random, points);
            let points = work(round, n);
            let work = board.below(&mut random, points);
            board.chip.borrow_mut().slow = 4 + i64::from(random.next_u32() % 60);
            board.tick(tick, late, work);
            tick += 1;
        }
        tick += random.next_u32() % 100;
    }
    let (most, slew) = (board.steps(40), board.slew());
    assert!(most <= slew, "{rate} Hz: {most} codes, {slew} allowed");
    // What is caught up with goes as fast as it may: an output that stood would show less.
    assert!(most + 1 >= slew, "{rate} Hz: {most} codes of {slew}");
}

#[test]
fn after_missed_ticks_no_step_is_more_than_one_slew_limit() {
    for rate in [250, 500, 1_000] {
        missed::<false>(170_000_000, rate, |_, _| 3);
        missed::<false>(90_000_000, rate, |_, _| 3);
        missed::<true>(150_000_000, rate, |_, _| 3);
    }
}

#[test]
fn nor_where_a_run_takes_longer_than_its_lead() {
    // The first one behind the missed ticks, and one in the middle of those that came.
    let work = |round: u32, n: u32| if n == 5 * (round % 2) { 16 } else { 3 };
    for rate in [250, 500, 1_000] {
        missed::<false>(170_000_000, rate, work);
        missed::<true>(150_000_000, rate, work);
    }
}

fn halted<const B: bool>(timer_hertz: u32) {
    let mut board = Board::<B>::new(timer_hertz, 500, 0);
    for n in (1..225).chain(260..400) {
        board.tick(n, 20, 300);
    }
    board.pass(board.clocks(2));
    let (chip, points) = (board.chip.borrow(), board.player.points());
    // One point more where codes are buffered.
    let halt = &chip.points[225 * points + BEYOND + 1..259 * points];
    assert!(halt.windows(2).all(|w| w[0] == w[1]), "it stands in a halt");
    // It has gone on for a while before.
    assert!(chip.points[225 * points - 4..225 * points + 4].windows(2).any(|w| w[0] != w[1]));
    assert_eq!(chip.points[399 * points], Board::<B>::SCALE.code(sweep(399).start()).unwrap());
}

#[test]
fn where_no_tick_comes_the_last_code_stands_and_is_caught_up_with() {
    halted::<false>(170_000_000);
    halted::<true>(150_000_000);
}

fn stopped<const B: bool>(timer_hertz: u32) {
    let mut board = Board::<B>::new(timer_hertz, 500, 0);
    for n in 1..50 {
        board.tick(n, 20, 300);
    }
    board.pass(board.clocks(3));
    board.player.set(Model::<B>::MAX);
    board.pass(2 * board.per_tick);
    let chip = board.chip.borrow();
    let stands = chip.points.iter().rev().take(100).all(|&code| code == Model::<B>::MAX);
    assert!(stands, "a set point ends a run");
    drop(chip);
    // The next run goes on from there.
    let from = board.chip.borrow().out.len() - 1;
    for n in 60..100 {
        board.tick(n, 20, 300);
    }
    board.pass(board.clocks(2));
    assert!(board.steps(from) <= board.slew(), "{} codes", board.steps(from));
    assert_eq!(
        board.chip.borrow().points[99 * board.player.points()],
        Board::<B>::SCALE.code(sweep(99).start()).unwrap()
    );
}

#[test]
fn a_set_point_ends_a_run_and_the_next_one_goes_on_from_it() {
    stopped::<false>(90_000_000);
    stopped::<true>(150_000_000);
}

#[test]
fn rates_whose_tick_has_more_points_than_there_is_room_for_are_none() {
    for timer_hertz in [170_000_000, 90_000_000, 150_000_000] {
        for (rate_hertz, points) in [(100, None), (125, None), (200, None), (250, Some(MOST)), (2_000, Some(20))] {
            let found = schedule(timer_hertz, rate_hertz * 1_000);
            assert_eq!(found.map(|found| found.points), points, "{timer_hertz} Hz, {rate_hertz} Hz");
        }
        assert_eq!(schedule(timer_hertz, 2_500_000), None);
    }
}
