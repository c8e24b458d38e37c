use std::boxed::Box;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;
use std::vec::Vec;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use whirl_firmware::sweep::{Scale, Sweep};

use super::*;

const SCALE: Scale = Scale { max: WIDTH, full_nanometre: 25_000_000 };
const FIVE_HERTZ: u32 = 42_949_673;

fn sweep(tick: u32) -> Sweep<'static> {
    Sweep {
        phase: FIVE_HERTZ.wrapping_mul(tick),
        phase_increment: FIVE_HERTZ,
        amplitude_nanometre: [15_525_000; 2],
        ..Sweep::default()
    }
}

/// Both slices and the channel, by clocks from tick 0 on: a width is taken over at a wrap, before
/// DMA brings the next.
#[derive(Default)]
struct Chip {
    clock: i64,
    /// By how many clocks the points' slice is ahead of the tick's.
    ahead: i64,
    counts_per_tick: u32,
    clocks_per_count: u32,
    written: u16,
    run: VecDeque<u16>,
    /// What each point went out with.
    out: Vec<u16>,
}

impl Chip {
    fn pass(&mut self, clocks: i64) {
        let (width, end) = (i64::from(WIDTH), self.clock + clocks);
        loop {
            let wrap = (self.clock + self.ahead).div_euclid(width) + 1;
            if wrap * width - self.ahead > end {
                break;
            }
            self.clock = wrap * width - self.ahead;
            self.out.resize(wrap as usize + 1, self.written);
            self.written = self.run.pop_front().unwrap_or(self.written);
        }
        self.clock = end;
    }
}

#[derive(Clone)]
struct Model {
    chip: Rc<RefCell<Chip>>,
    /// Clocks of a register's access.
    slow: Rc<Cell<i64>>,
}

impl Model {
    fn pass(&self) {
        self.chip.borrow_mut().pass(self.slow.get());
    }
}

impl Slices for Model {
    fn since_tick(&self) -> u32 {
        self.pass();
        let chip = self.chip.borrow();
        let counts = chip.clock / i64::from(chip.clocks_per_count);
        (counts % i64::from(chip.counts_per_tick)) as u32
    }
    fn written(&self) -> u16 {
        self.pass();
        self.chip.borrow().written
    }
    fn write(&mut self, width: u16) {
        self.pass();
        self.chip.borrow_mut().written = width;
    }
    fn start(&mut self, widths: &[u16]) {
        self.pass();
        self.chip.borrow_mut().run = widths.iter().copied().collect();
    }
    fn stop(&mut self) {
        self.pass();
        self.chip.borrow_mut().run.clear();
    }
}

fn board(rate_hertz: u32, ahead: i64) -> (Model, Player<Model>) {
    let schedule = schedule(rate_hertz * 1_000).unwrap();
    let clocks_per_count = u32::from(schedule.prescaler) + 1;
    let chip = Chip { ahead, counts_per_tick: schedule.period(), clocks_per_count, ..Chip::default() };
    let model = Model { chip: Rc::new(RefCell::new(chip)), slow: Rc::new(Cell::new(12)) };
    let runs = Box::leak(Box::new([[0; MOST + BEYOND]; 2]));
    (model.clone(), Player::new(model, runs, schedule))
}

/// The interrupt of a tick, so many clocks behind it: as `DacShaker` does it, with so many clocks
/// of work.
fn tick(model: &Model, player: &mut Player<Model>, tick: u32, late: i64, work: i64) {
    let due = i64::from(tick) * player.schedule.points as i64 * i64::from(WIDTH);
    let now = model.chip.borrow().clock;
    model.chip.borrow_mut().pass(due + late - now);
    let points = player.points();
    let (point, standing) = player.standing();
    SCALE.fill(&sweep(tick), player.room(), points, point, standing).unwrap();
    model.chip.borrow_mut().pass(work);
    player.play();
}

#[test]
fn at_the_ticks_it_is_the_accumulator_s_waveform_bit_for_bit() {
    for (rate, ahead) in [(500, 0), (500, 9), (500, -9), (250, 3), (1_000, -3), (2_000, 5)] {
        let (model, mut player) = board(rate, ahead);
        let mut random = ChaCha8Rng::seed_from_u64(12);
        for n in 1..400 {
            // Latency of up to three points, and up to one more until the run is there; any
            // register may be slow.
            let late = i64::from(random.next_u32()) % (3 * i64::from(WIDTH)) * i64::from(n % 3 == 0);
            model.slow.set(4 + i64::from(random.next_u32() % 60));
            tick(&model, &mut player, n, late, 300 + i64::from(random.next_u32() % 3_000));
        }
        let (out, points) = (&model.chip.borrow().out, player.points());
        for n in 100..399 {
            let exact = SCALE.code(sweep(n).start()).unwrap();
            assert_eq!(out[n as usize * points], exact, "{rate} Hz, {ahead} clocks ahead, tick {n}");
        }
        // No point is left out, and none is played twice: in between it is the cosine to a step.
        for (point, &width) in out.iter().enumerate().skip(100 * points) {
            let turns = f64::from(FIVE_HERTZ) / 4_294_967_296.0 * point as f64 / points as f64;
            let exact = 1_875.0 * (1.0 + 0.621 * (std::f64::consts::TAU * turns).cos());
            assert!((f64::from(width) - exact).abs() <= 1.01, "{rate} Hz, point {point}: {width} for {exact}");
        }
    }
}

#[test]
fn where_no_tick_comes_the_last_width_stands_and_is_caught_up_with() {
    let (model, mut player) = board(500, 0);
    for n in (1..200).chain(260..400) {
        tick(&model, &mut player, n, 20, 300);
    }
    let out = &model.chip.borrow().out;
    let points = player.points();
    let halt = &out[200 * points + BEYOND..259 * points];
    assert!(halt.windows(2).all(|w| w[0] == w[1]), "it stands in a halt");
    assert!(out[100 * points..].windows(2).all(|w| w[0].abs_diff(w[1]) <= 5), "it leaps afterwards");
    assert_eq!(out[399 * points], SCALE.code(sweep(399).start()).unwrap());
}

#[test]
fn rest_is_half_of_the_range_and_a_set_point_ends_a_run() {
    let (model, mut player) = board(500, 0);
    assert_eq!(model.chip.borrow().written, 1_875);
    tick(&model, &mut player, 1, 20, 300);
    player.set(WIDTH);
    model.chip.borrow_mut().pass(5 * i64::from(WIDTH));
    assert_eq!(model.chip.borrow().out.last(), Some(&3_750));
}

#[test]
fn rates_are_those_of_which_a_tick_is_whole_points_and_microseconds() {
    for (rate, points) in [
        (250_000, 160),
        (320_000, 125),
        (400_000, 100),
        (500_000, 80),
        (625_000, 64),
        (800_000, 50),
        (1_000_000, 40),
        (1_600_000, 25),
        (2_000_000, 20),
    ] {
        let schedule = schedule(rate).unwrap();
        assert_eq!(schedule.points, points);
        let clocks = (u32::from(schedule.prescaler) + 1) * schedule.period();
        assert_eq!((clocks, microseconds(&schedule)), (points as u32 * 3_750, points as u32 * 25));
        assert_eq!(u64::from(microseconds(&schedule)) * u64::from(rate), 1_000_000_000);
        assert!(schedule.period() / points as u32 >= 375);
    }
    for rate in [0, 100_000, 200_000, 333_333, 300_000, 4_000_000, u32::MAX] {
        assert_eq!(schedule(rate), None, "{rate}");
    }
}
