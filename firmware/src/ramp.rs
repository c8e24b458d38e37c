//! Linear change of the shaker's amplitude, in integers.
//!
//! n ticks after a ramp's start the amplitude has moved by ⌊n · rate / f_s⌋ nm, the rate in nm/s:
//! never further than the straight line of the set rate, and exactly on it over whole seconds,
//! whatever the sampling rate.

/// An amplitude on its way to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ramp {
    amplitude: u32,
    target: u32,
    rate_micrometre_per_s: u32,
    sample_rate_millihertz: u32,
    /// What is left over of a nanometre, in nm · mHz.
    remainder: u64,
}

impl Ramp {
    /// At rest at zero. A sampling rate of zero counts as 1 mHz.
    #[must_use]
    pub const fn new(rate_micrometre_per_s: u32, sample_rate_millihertz: u32) -> Self {
        let sample_rate_millihertz = if sample_rate_millihertz == 0 { 1 } else { sample_rate_millihertz };
        Self { amplitude: 0, target: 0, rate_micrometre_per_s, sample_rate_millihertz, remainder: 0 }
    }

    /// Present amplitude, nm.
    #[must_use]
    pub const fn amplitude(&self) -> u32 {
        self.amplitude
    }

    /// Whether the amplitude is where it was sent.
    #[must_use]
    pub const fn arrived(&self) -> bool {
        self.amplitude == self.target
    }

    /// Rate, µm/s.
    #[must_use]
    pub const fn rate(&self) -> u32 {
        self.rate_micrometre_per_s
    }

    /// Sets the rate, µm/s.
    pub fn set_rate(&mut self, micrometre_per_s: u32) {
        self.rate_micrometre_per_s = micrometre_per_s;
    }

    /// Sends the amplitude to a target, nm.
    pub fn go_to(&mut self, target_nanometre: u32) {
        self.target = target_nanometre;
        self.remainder = 0;
    }

    /// One tick.
    pub fn step(&mut self) {
        // µm/s = 10⁶ nm · mHz a tick.
        self.remainder += u64::from(self.rate_micrometre_per_s) * 1_000_000;
        let rate = u64::from(self.sample_rate_millihertz);
        let step = u32::try_from(self.remainder / rate).unwrap_or(u32::MAX);
        self.remainder %= rate;
        self.amplitude = if self.amplitude < self.target {
            self.amplitude.saturating_add(step).min(self.target)
        } else {
            self.amplitude.saturating_sub(step).max(self.target)
        };
    }

    /// Zero at once: for a fault, where the output is cut off anyway.
    pub fn cut(&mut self) {
        self.amplitude = 0;
        self.target = 0;
        self.remainder = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn whole_seconds_are_exact_at_an_odd_rate() {
        // 7 µm/s at 333 Hz is 21.02… nm a tick.
        let mut ramp = Ramp::new(7, 333_000);
        ramp.go_to(21_000);
        for second in 1..=3 {
            for _ in 0..333 {
                ramp.step();
            }
            assert_eq!(ramp.amplitude(), 7_000 * second);
        }
        assert!(ramp.arrived());
    }

    #[test]
    fn each_ramp_begins_its_own_line() {
        // 0.6 nm a tick: one nanometre in two ticks, also after what was left over of the last
        // ramp.
        let mut ramp = Ramp::new(3, 5_000_000);
        for target in [100, 200, 300, 0] {
            ramp.go_to(target);
            let before = ramp.amplitude();
            ramp.step();
            assert_eq!(ramp.amplitude(), before);
            ramp.step();
            assert_eq!(ramp.amplitude().abs_diff(before), 1);
        }
    }

    proptest! {
        #[test]
        fn never_faster_than_the_set_rate(
            rate in 1u32..200_000, sampling in 1_000u32..2_000_000, from in 0u32..30_000_000, to in 0u32..30_000_000,
        ) {
            let mut ramp = Ramp::new(rate, sampling);
            ramp.amplitude = from;
            ramp.go_to(to);
            let mut last = from;
            for n in 1..2_000_u128 {
                ramp.step();
                let moved = u128::from(ramp.amplitude().abs_diff(from));
                prop_assert!(moved * u128::from(sampling) <= n * u128::from(rate) * 1_000_000);
                // Toward the target, and at most a nanometre of quantisation above the rate in any
                // one tick.
                prop_assert!(ramp.amplitude().abs_diff(to) <= last.abs_diff(to));
                let step = u128::from(ramp.amplitude().abs_diff(last));
                prop_assert!(step.saturating_sub(1) * u128::from(sampling) <= u128::from(rate) * 1_000_000);
                last = ramp.amplitude();
            }
        }

        #[test]
        fn arrives_in_time(rate in 1u32..200_000, to in 0u32..30_000_000) {
            let mut ramp = Ramp::new(rate, 500_000);
            ramp.go_to(to);
            let ticks = u64::from(to).div_ceil(u64::from(rate) * 2).min(100_000);
            for _ in 0..ticks {
                ramp.step();
            }
            prop_assert!(ramp.arrived() || ticks == 100_000);
        }
    }
}
