//! Which tick is this? A free clock tells how many ticks have passed since the last interrupt.
//!
//! A timer's interrupt flag says that a tick is due, not how many: an interrupt that was held up
//! for longer than a period comes once. The free clock counts in step with the tick's timer, from
//! the same source, and like that timer goes on while a debugger holds the processor (the
//! processor's own cycle counter does not: after a halt nobody knows how many ticks it lasted). The
//! tick is the number of whole periods on it, so that one reading tells everything: a processor
//! that is held between two instructions cannot make two readings contradict each other.
//!
//! The board clears the interrupt's flag first and reads the clock then. A tick that falls between
//! is told at once, and its own interrupt finds nothing new. The counters count for a tick only
//! where the clock before and after they were read shows the same one ([`Pacer::latch`]).
//!
//! Limits: the clock wraps at 2³² (200 s at 21.25 MHz); an outage longer than that is told too
//! short by whole wraps.

/// Counts the ticks that an interrupt has missed. All times in clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pacer {
    period: u32,
    /// When the present tick was due.
    due: u32,
    latency: u32,
}

/// An interrupt that belongs to a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passed {
    /// Ticks that were missed since the last one.
    pub missed: u32,
    /// How late it is, clocks.
    pub latency: u32,
}

impl Pacer {
    /// Ticks of so many clocks (0 counts as 1), the first one period after `start`, at which tick's
    /// timer and clock were started: the clock first, or at once.
    #[must_use]
    pub const fn new(period: u32, start: u32) -> Self {
        Self { period: if period == 0 { 1 } else { period }, due: start, latency: 0 }
    }

    /// An interrupt at `now`. None where its tick has been told already.
    pub fn interrupt(&mut self, now: u32) -> Option<Passed> {
        let elapsed = now.wrapping_sub(self.due);
        let latency = elapsed % self.period;
        let missed = (elapsed / self.period).checked_sub(1)?;
        self.due = now.wrapping_sub(latency);
        self.latency = self.latency.max(latency);
        Some(Passed { missed, latency })
    }

    /// An interrupt, with the counters that belong to its tick: `latch` reads them, again where the
    /// tick has gone meanwhile, since a debugger may halt between any two instructions. None where
    /// the tick has been told already.
    pub fn latch(&mut self, mut clock: impl FnMut() -> u32, mut latch: impl FnMut()) -> Option<Passed> {
        let mut told: Option<Passed> = None;
        loop {
            if let Some(passed) = self.interrupt(clock()) {
                let before = told.map_or(0, |told| told.missed + 1);
                told = Some(Passed { missed: passed.missed.saturating_add(before), ..passed });
            }
            latch();
            if self.same_tick(clock()) {
                return told;
            }
        }
    }

    /// Whether the present tick is still the last that was due.
    fn same_tick(&self, now: u32) -> bool {
        self.since(now) < self.period
    }

    /// Clocks since the present tick was due.
    #[must_use]
    pub fn since(&self, now: u32) -> u32 {
        now.wrapping_sub(self.due)
    }

    /// Clocks of a tick.
    #[must_use]
    pub const fn period(&self) -> u32 {
        self.period
    }

    /// Longest latency.
    #[must_use]
    pub const fn latency(&self) -> u32 {
        self.latency
    }
}

/// Splits the clocks of a tick into a timer's prescaler and reload value, both as written to its
/// registers (one less than they divide by), so that the tick is exact. `None` where there is no
/// such pair of 16 bits each.
#[must_use]
pub fn divide(clocks: u32) -> Option<(u16, u16)> {
    (1..=65_536_u32).take_while(|&prescaler| prescaler <= clocks).find_map(|prescaler| {
        let reload = clocks / prescaler;
        if !clocks.is_multiple_of(prescaler) {
            return None;
        }
        Some((u16::try_from(prescaler - 1).ok()?, u16::try_from(reload - 1).ok()?))
    })
}

/// How a board's timers make the tick and the shaker's points of one clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Prescaler of the tick's timer and of the free clock, as in its register.
    pub prescaler: u16,
    /// Reload value of the tick's timer.
    pub reload: u16,
    /// Points of a tick.
    pub points: usize,
    /// Reload value of the points' timer, which has no prescaler.
    pub point_reload: u16,
}

impl Schedule {
    /// At a timer's clock and a sampling rate; the greatest number of points that divides a tick
    /// exactly and is not above `points_per_second`. `None` where the rate cannot be had exactly.
    #[must_use]
    pub fn new(timer_hertz: u32, rate_millihertz: u32, points_per_second: u32) -> Option<Self> {
        let (clocks, rate) = (u64::from(timer_hertz) * 1_000, u64::from(rate_millihertz).max(1));
        if !clocks.is_multiple_of(rate) {
            return None;
        }
        let per_tick = u32::try_from(clocks / rate).ok()?;
        let (prescaler, reload) = divide(per_tick)?;
        let most = u64::from(points_per_second) * 1_000 / rate;
        // A board of at most 2³² points a second: `most` is what it has room for.
        let points = (1..=u32::try_from(most).ok()?.max(1)).rev().find(|&n| per_tick.is_multiple_of(n))?;
        let point_reload = u16::try_from(per_tick / points - 1).ok()?;
        Some(Self { prescaler, reload, points: points as usize, point_reload })
    }

    /// Counts of the free clock in a tick.
    #[must_use]
    pub const fn period(&self) -> u32 {
        self.reload as u32 + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};
    use std::cell::RefCell;

    #[test]
    fn ticks_that_were_missed_are_counted_whatever_the_latency() {
        let start = 0_u32.wrapping_sub(120_000); // the clock wraps on the way
        let mut pacer = Pacer::new(50_000, start);
        let mut missed = 0;
        for (tick, latency) in [(1_u32, 20), (2, 30), (3, 49_000), (4, 12), (7, 10), (8, 0), (101, 49_999), (102, 1)] {
            let passed = pacer.interrupt(start.wrapping_add(tick * 50_000 + latency)).unwrap();
            assert_eq!(passed.latency, latency);
            missed += passed.missed;
        }
        assert_eq!((missed, pacer.latency()), (2 + 92, 49_999));
    }

    #[test]
    fn a_tick_is_told_once() {
        let mut pacer = Pacer::new(1_000, 7);
        assert_eq!(pacer.interrupt(1_006), None);
        assert_eq!(pacer.interrupt(1_007), Some(Passed { missed: 0, latency: 0 }));
        assert_eq!(pacer.interrupt(2_006), None);
        assert_eq!(pacer.interrupt(4_010), Some(Passed { missed: 2, latency: 3 }));
        assert_eq!(pacer.interrupt(4_500), None);
        assert_eq!((pacer.same_tick(5_006), pacer.same_tick(5_007)), (true, false));
    }

    /// A processor that a debugger halts, its interrupt flag, and a tick's timer that runs on.
    /// Times in ns, which are clocks.
    struct Halted {
        now: u64,
        /// When the halt comes, and how long it lasts.
        halt: (u64, u64),
        /// Interrupts until here have been taken.
        cleared: u64,
        /// All that the processor was halted.
        lost: u64,
    }

    const PERIOD: u64 = 2_000_000;

    impl Halted {
        /// Work for so long; the halt falls into it where its time has come.
        fn work(&mut self, ns: u64) {
            let (at, length) = self.halt;
            self.now += ns;
            if self.now > at && length > 0 {
                self.now += length;
                self.lost += length;
                self.halt.1 = 0;
            }
        }

        /// Sleeps until a tick is due; the interrupt's entry takes 100 ns.
        fn wait(&mut self) {
            let due = (self.cleared / PERIOD + 1) * PERIOD;
            self.work(due.saturating_sub(self.now) + 100);
        }

        /// Takes the flag of all ticks until now.
        fn clear(&mut self) {
            self.cleared = self.now;
            self.work(50);
        }
    }

    /// Runs a handler over one halt; the number of samples that say a wrong tick.
    fn wrong(halt: (u64, u64), mut handler: impl FnMut(&mut Halted) -> Option<(u64, u64)>) -> u32 {
        let mut board = Halted { now: 0, halt, cleared: 0, lost: 0 };
        let mut wrong = 0;
        while board.now < halt.0 + halt.1 + 10 * PERIOD {
            board.wait();
            // The tick that is told, and the time at which the counters were read.
            if let Some((told, read)) = handler(&mut board) {
                wrong += u32::from(told != read / PERIOD);
            }
            board.work(20_000);
        }
        wrong
    }

    /// 10 000 halts of 5 to 40 ms at any instruction.
    fn halts() -> impl Iterator<Item = (u64, u64)> {
        let mut rng = ChaCha8Rng::seed_from_u64(19);
        let mut below = move |end: u64| (u64::from(rng.next_u32()) * end) >> 32;
        (0..10_000).map(move |n| {
            // Every other one falls into the interrupt itself.
            let at = 10 * PERIOD + if n % 2 == 0 { below(3 * PERIOD) } else { below(2) * PERIOD + below(600) };
            (at, 5_000_000 + below(35_000_000))
        })
    }

    #[test]
    fn after_a_debugger_s_halt_every_sample_says_its_tick() {
        for halt in halts() {
            let mut pacer = Pacer::new(PERIOD as u32, 0);
            let mut tick = 0;
            let wrong = wrong(halt, |board| {
                board.clear();
                let (board, mut read) = (RefCell::new(board), 0);
                let clock = || {
                    let mut board = board.borrow_mut();
                    let now = board.now as u32;
                    board.work(50);
                    now
                };
                let told = pacer.latch(clock, || {
                    let mut board = board.borrow_mut();
                    read = board.now;
                    board.work(50);
                });
                tick += told.map_or(0, |told| 1 + u64::from(told.missed));
                told.map(|_| (tick, read))
            });
            assert_eq!(wrong, 0, "{halt:?}");
        }
    }

    /// What a cycle counter makes of it, which stands while the processor is halted: the model
    /// tells the difference.
    #[test]
    fn a_clock_that_stands_in_a_halt_would_be_wrong_each_time() {
        let wrong_halts = halts().filter(|&halt| {
            let (mut tick, mut last) = (0_u64, None);
            wrong(halt, |board| {
                let latency = board.now % PERIOD;
                board.work(50);
                let due = (board.now - board.lost).saturating_sub(latency);
                board.clear();
                let elapsed = last.replace(due).map_or(PERIOD, |last: u64| due.saturating_sub(last));
                tick += ((elapsed + PERIOD / 2) / PERIOD).max(1);
                Some((tick, board.now))
            }) > 0
        });
        assert!(wrong_halts.count() > 9_900);
    }

    #[test]
    fn points_divide_the_tick_exactly_at_every_usual_rate() {
        for timer_hertz in [170_000_000, 90_000_000] {
            for (rate_hertz, most) in [(250, 160), (500, 80), (1_000, 40), (2_000, 20)] {
                let schedule = Schedule::new(timer_hertz, rate_hertz * 1_000, 40_000).unwrap();
                let clocks = (u32::from(schedule.prescaler) + 1) * schedule.period();
                assert_eq!(clocks, timer_hertz / rate_hertz);
                assert_eq!(schedule.points as u32 * (u32::from(schedule.point_reload) + 1), clocks);
                assert!(schedule.points <= most && schedule.points as u32 * rate_hertz >= 20_000, "{schedule:?}");
            }
        }
        assert_eq!(Schedule::new(170_000_000, 500_000, 40_000).unwrap().points, 80);
        assert_eq!(Schedule::new(170_000_000, 333_333, 40_000), None);
        assert_eq!(Schedule::new(170_000_000, 0, 40_000), None);
    }

    #[test]
    fn timers_divide_exactly() {
        // 170 MHz and 90 MHz to 500 Hz.
        assert_eq!(divide(340_000), Some((7, 42_499)));
        assert_eq!(divide(180_000), Some((2, 59_999)));
        assert_eq!(divide(50_000), Some((0, 49_999)));
        assert_eq!(divide(0), None);
        // A prime beyond 16 bits.
        assert_eq!(divide(65_537), None);
        for clocks in [1, 340_000, 1_000_000, 4_294_967_295] {
            if let Some((prescaler, reload)) = divide(clocks) {
                assert_eq!((u64::from(prescaler) + 1) * (u64::from(reload) + 1), u64::from(clocks));
            }
        }
    }
}
