//! Previews for the status: rms of each wrapped angle, and mean turning rate, over a second.
//!
//! The interrupt half adds up integers, exactly; the thread half turns them into mrad and turns a
//! minute with micromath. Reduced precision (below 0.5 %), for people to look at: neither recorded
//! as data nor used for any result.

use micromath::F32;
use whirl_shared::encoder::CountScale;

/// One encoder over some ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Turning {
    /// Samples.
    pub samples: u32,
    /// Σ (2c + 1)², c the count within a turn: four times the squares of the angle in counts.
    pub sum_of_squares: u64,
    /// Counts moved.
    pub moved: i64,
}

impl Turning {
    /// Takes one sample: a multi-turn count and how far it has moved since the last.
    pub fn push(&mut self, scale: CountScale, count: i32, difference: i32) {
        let doubled = (2 * scale.wrapped(i64::from(count)) + 1).unsigned_abs();
        self.sum_of_squares = self.sum_of_squares.saturating_add(doubled * doubled);
        self.samples = self.samples.saturating_add(1);
        self.moved = self.moved.saturating_add(i64::from(difference));
    }

    /// rms of the wrapped angle, mrad; 0 without samples.
    #[must_use]
    pub fn rms_mrad(&self, scale: CountScale) -> u32 {
        if self.samples == 0 {
            return 0;
        }
        let mean = F32(self.sum_of_squares as f32 / self.samples as f32);
        // micromath's root is good to 6 %; one step of Newton makes that 0.2 %.
        let root = mean.sqrt();
        let root = F32(0.5) * (root + mean / root);
        let mrad_per_half_count = F32(core::f32::consts::PI * 1_000.0 / scale.counts_per_turn() as f32);
        (root * mrad_per_half_count).round().0 as u32
    }

    /// Mean turning rate, 10⁻³ turns a minute; 0 without samples.
    #[must_use]
    pub fn turns_per_minute_milli(&self, scale: CountScale, sample_rate_millihertz: u32) -> i32 {
        if self.samples == 0 {
            return 0;
        }
        let turns = self.moved as f32 / scale.counts_per_turn() as f32;
        let minutes = self.samples as f32 / (sample_rate_millihertz as f32 * 0.06);
        F32(1_000.0 * turns / minutes).round().0 as i32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rms_and_rate_are_good_to_half_a_percent() {
        for counts_per_turn in [1024, 4096, 1 << 20] {
            let scale = CountScale::new(counts_per_turn).unwrap();
            // 3 turns a second at 500 Hz: uniform on the circle, rms π/√3.
            let mut turning = Turning::default();
            let mut last = 0;
            for i in 1..=500_i64 {
                let count = (i * 3 * i64::from(counts_per_turn) / 500) as i32;
                turning.push(scale, count, count - last);
                last = count;
            }
            let rms = f64::from(turning.rms_mrad(scale));
            assert!((rms / 1813.8 - 1.0).abs() < 5e-3, "{rms}");
            let rate = f64::from(turning.turns_per_minute_milli(scale, 500_000));
            assert!((rate / 180_000.0 - 1.0).abs() < 1e-3, "{rate}");
        }
    }

    #[test]
    fn rms_over_the_whole_range() {
        let scale = CountScale::new(4096).unwrap();
        for count in [0, 1, 5, -6, 100, 1023, -2048, 2047] {
            let mut turning = Turning::default();
            turning.push(scale, count, 0);
            let want = scale.wrapped_radians(i64::from(count)).abs() * 1_000.0;
            let got = f64::from(turning.rms_mrad(scale));
            assert!((got - want).abs() <= 0.5 + 5e-3 * want, "{count}: {got} for {want}");
        }
    }

    #[test]
    fn nothing_is_nothing_and_extremes_do_not_overflow() {
        let scale = CountScale::new(1 << 20).unwrap();
        assert_eq!(Turning::default().rms_mrad(scale), 0);
        assert_eq!(Turning::default().turns_per_minute_milli(scale, 500_000), 0);
        let mut turning = Turning { samples: u32::MAX, sum_of_squares: u64::MAX, moved: i64::MIN };
        turning.push(scale, i32::MIN, i32::MIN);
        let _ = turning.rms_mrad(scale);
        let _ = turning.turns_per_minute_milli(scale, u32::MAX);
    }
}
