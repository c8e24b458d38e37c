//! Which tick is this? A free clock tells how many ticks have passed since the last interrupt.
//!
//! A timer's interrupt flag says that a tick is due, not how many: an interrupt that was held up for longer than a period
//! comes once. The difference of a free running clock, each time taken back to when the tick was due, rounded to whole
//! periods, is the number of ticks that have passed.
//!
//! Limits: the clock wraps at 2³² (25 s at 170 MHz); an outage longer than that is told too short by a whole number of wraps.

/// Counts the ticks that an interrupt has missed. All times in clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pacer {
    period: u32,
    due: Option<u32>,
    early: u32,
    late: u32,
    latency: u32,
}

impl Pacer {
    /// Ticks of so many clocks; 0 counts as 1.
    #[must_use]
    pub const fn new(period: u32) -> Self {
        Self { period: if period == 0 { 1 } else { period }, due: None, early: 0, late: 0, latency: 0 }
    }

    /// The interrupt of a tick, `latency` clocks after it was due; `now` is the free clock. The ticks that were missed since the
    /// last one.
    pub fn interrupt(&mut self, now: u32, latency: u32) -> u32 {
        let due = now.wrapping_sub(latency);
        self.latency = self.latency.max(latency);
        let Some(last) = self.due.replace(due) else { return 0 };
        let (elapsed, period) = (u64::from(due.wrapping_sub(last)), u64::from(self.period));
        let passed = ((elapsed + period / 2) / period).max(1);
        // Deviations are below a period, or else it is the first tick that is at fault.
        self.early = self.early.max(u32::try_from((passed * period).saturating_sub(elapsed)).unwrap_or(u32::MAX));
        self.late = self.late.max(u32::try_from(elapsed.saturating_sub(passed * period)).unwrap_or(u32::MAX));
        u32::try_from(passed - 1).unwrap_or(u32::MAX)
    }

    /// Clocks of a tick.
    #[must_use]
    pub const fn period(&self) -> u32 {
        self.period
    }

    /// Most by which a tick was due too early, and too late, after the one before.
    #[must_use]
    pub const fn deviation(&self) -> [u32; 2] {
        [self.early, self.late]
    }

    /// Longest latency.
    #[must_use]
    pub const fn latency(&self) -> u32 {
        self.latency
    }
}

/// Splits the clocks of a tick into a timer's prescaler and reload value, both as written to its registers (one less than they
/// divide by), so that the tick is exact. `None` where there is no such pair of 16 bits each.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_that_were_missed_are_counted_whatever_the_latency() {
        let mut pacer = Pacer::new(50_000);
        let start = 0_u32.wrapping_sub(120_000); // the clock wraps on the way
        let mut missed = 0;
        for (tick, latency) in [(0_u32, 20), (1, 30), (2, 49_000), (3, 12), (6, 10), (7, 0), (100, 49_999), (101, 1)] {
            missed += pacer.interrupt(start.wrapping_add(tick * 50_000 + latency), latency);
        }
        assert_eq!(missed, 2 + 92);
        assert_eq!((pacer.deviation(), pacer.latency()), ([0, 0], 49_999));
    }

    #[test]
    fn deviations_of_the_tick_are_told() {
        let mut pacer = Pacer::new(1_000);
        for due in [0, 1_003, 1_998, 4_000] {
            pacer.interrupt(due, 0);
        }
        assert_eq!(pacer.deviation(), [5, 3]);
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
