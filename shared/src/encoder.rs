//! Counts ↔ angles on the circle and on the line.
//!
//! A count c says that the angle lies in [c, c+1) counts: θ = (c + ½)·2π/N, in radians, N counts a
//! turn. Wrapped angles lie in [−π, π). Counts stay integers as long as they can: wrapping and
//! unwrapping them is exact.
//!
//! Limits: a 16-bit hardware counter is followed over any number of turns as long as it moves by
//! less than 2¹⁵ counts between two readings; multi-turn counts of 32 bits wrap after 2³¹ counts
//! (29 h at 5 turns a second of 4096 counts), which [`Unwrapper::wrapping32`] extends.

use core::f64::consts::{PI, TAU};
use core::num::NonZeroU32;

/// Counts a turn of an encoder after decoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CountScale {
    counts_per_turn: NonZeroU32,
}

impl CountScale {
    /// `None` where `counts_per_turn` is zero.
    #[must_use]
    pub const fn new(counts_per_turn: u32) -> Option<Self> {
        match NonZeroU32::new(counts_per_turn) {
            Some(counts_per_turn) => Some(Self { counts_per_turn }),
            None => None,
        }
    }

    /// N.
    #[must_use]
    pub const fn counts_per_turn(self) -> u32 {
        self.counts_per_turn.get()
    }

    /// Angle of one count, rad.
    #[must_use]
    pub fn resolution(self) -> f64 {
        TAU / f64::from(self.counts_per_turn())
    }

    /// (c + ½)·2π/N, unwrapped, rad. Counts beyond ±2⁵² lose their half.
    #[must_use]
    pub fn radians(self, count: i64) -> f64 {
        (count as f64 + 0.5) * TAU / f64::from(self.counts_per_turn())
    }

    /// The same on the circle, [−π, π), rad: the turns are taken off in integers.
    #[must_use]
    pub fn wrapped_radians(self, count: i64) -> f64 {
        // The middle of a count is never at ±π for even N; for odd N the middle count's is exactly
        // −π or π.
        let angle = self.radians(self.wrapped(count));
        if angle >= PI { angle - TAU } else { angle }
    }

    /// The count within one turn, [−⌊N/2⌋, N − ⌊N/2⌋).
    #[must_use]
    pub fn wrapped(self, count: i64) -> i64 {
        let n = i64::from(self.counts_per_turn());
        let half = n / 2;
        let rest = count.rem_euclid(n);
        if rest >= n - half { rest - n } else { rest }
    }

    /// The count in which an (unwrapped) angle lies, ⌊θN/2π⌋; `None` where θ is not finite or
    /// beyond ±2⁵³ counts.
    #[must_use]
    pub fn count(self, radians: f64) -> Option<i64> {
        let counts = libm::floor(radians / TAU * f64::from(self.counts_per_turn()));
        (counts.abs() <= 9_007_199_254_740_992.0).then_some(counts as i64)
    }
}

/// An angle wrapped to [−π, π); NaN where it is not finite.
///
/// The error is that of one rounding of 2π times the number of turns: at most 1e-15 rad for each
/// turn taken off.
#[must_use]
pub fn wrap(radians: f64) -> f64 {
    let wrapped = radians - TAU * libm::floor((radians + PI) / TAU);
    // Rounding may leave a value just outside.
    if wrapped >= PI {
        wrapped - TAU
    } else if wrapped < -PI {
        -PI
    } else {
        wrapped
    }
}

/// Follows an angle over turns: the shortest step is taken, of two equal ones the negative.
///
/// Limit: steps of less than π.
#[derive(Clone, Copy, Debug, Default)]
pub struct AngleUnwrapper {
    last: Option<f64>,
}

impl AngleUnwrapper {
    /// The angle nearest to the last one that differs from `radians` by whole turns. What is not
    /// finite is returned as it is and forgotten.
    pub fn push(&mut self, radians: f64) -> f64 {
        if !radians.is_finite() {
            return radians;
        }
        let unwrapped = match self.last {
            Some(last) => last + wrap(radians - last),
            None => radians,
        };
        self.last = Some(unwrapped);
        unwrapped
    }
}

/// Follows an integer that is known modulo a period. Steps of up to half a period are followed; of
/// two equally long ones the negative is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unwrapper {
    period: i64,
    last: Option<i64>,
}

impl Unwrapper {
    /// For values modulo `period`; `None` where it is zero.
    #[must_use]
    pub const fn new(period: u32) -> Option<Self> {
        if period == 0 { None } else { Some(Self { period: period as i64, last: None }) }
    }

    /// For the wrapping 32-bit counts of [`crate::frame::SampleBlock`].
    #[must_use]
    pub const fn wrapping32() -> Self {
        Self { period: 1 << 32, last: None }
    }

    /// The value nearest to the last one that is equal to `value` modulo the period; the first is
    /// taken as it is. Saturates at the ends of `i64`.
    pub fn push(&mut self, value: i64) -> i64 {
        let unwrapped = match self.last {
            Some(last) => {
                // Both remainders lie in [0, period), so nothing overflows before the sum.
                let step = (value.rem_euclid(self.period) - last.rem_euclid(self.period)).rem_euclid(self.period);
                let step = if 2 * step >= self.period { step - self.period } else { step };
                last.saturating_add(step)
            }
            None => value,
        };
        self.last = Some(unwrapped);
        unwrapped
    }

    /// Forgets the past: the next value is taken as it is.
    pub fn restart(&mut self) {
        self.last = None;
    }
}

/// Sense of turning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Toward smaller counts.
    Negative,
    /// No count passed.
    Still,
    /// Toward greater counts.
    Positive,
}

impl Direction {
    /// Of a difference of counts.
    #[must_use]
    pub const fn of(difference: i32) -> Self {
        match difference {
            0 => Self::Still,
            1.. => Self::Positive,
            _ => Self::Negative,
        }
    }

    /// −1, 0 or 1.
    #[must_use]
    pub const fn sign(self) -> i32 {
        match self {
            Self::Negative => -1,
            Self::Still => 0,
            Self::Positive => 1,
        }
    }
}

/// Extends a 16-bit hardware counter to multi-turn counts of 32 bits, both wrapping.
///
/// The first reading is taken with its sign ([−2¹⁵, 2¹⁵)), so that the zero of the hardware counter
/// is the zero of the position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MultiTurn {
    last: u16,
    position: i32,
    difference: i16,
}

impl MultiTurn {
    /// Position 0 at hardware count 0.
    #[must_use]
    pub const fn new() -> Self {
        Self { last: 0, position: 0, difference: 0 }
    }

    /// Takes a reading and returns the position.
    pub fn update(&mut self, hardware: u16) -> i32 {
        self.difference = hardware.wrapping_sub(self.last) as i16;
        self.last = hardware;
        self.position = self.position.wrapping_add(i32::from(self.difference));
        self.position
    }

    /// Position at the last reading.
    #[must_use]
    pub const fn position(&self) -> i32 {
        self.position
    }

    /// Sense of the last step.
    #[must_use]
    pub const fn direction(&self) -> Direction {
        Direction::of(self.difference as i32)
    }

    /// Calls the place of the last reading `position`.
    pub fn preset(&mut self, position: i32) {
        self.position = position;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scale(n: u32) -> CountScale {
        CountScale::new(n).unwrap()
    }

    #[test]
    fn the_middle_of_a_count_is_its_angle() {
        assert_eq!(scale(4).resolution(), PI / 2.0);
        assert_eq!(scale(4).radians(0), PI / 4.0);
        assert_eq!(scale(4).radians(-1), -PI / 4.0);
        assert_eq!(scale(4).wrapped_radians(2), -3.0 * PI / 4.0);
        assert!((scale(4096).radians(4096) - TAU * (1.0 + 0.5 / 4096.0)).abs() < 1e-15);
        // N = 1: every angle is the middle of the turn, which is −π on [−π, π).
        assert_eq!(scale(1).wrapped_radians(5), -PI);
        assert_eq!(CountScale::new(0), None);
    }

    #[test]
    fn counts_within_a_turn() {
        assert_eq!([2047, 2048, -2048, -2049, 4096].map(|c| scale(4096).wrapped(c)), [2047, -2048, -2048, 2047, 0]);
        assert_eq!([2, 3, -2, -3, 5].map(|c| scale(5).wrapped(c)), [2, -2, -2, 2, 0]);
    }

    #[test]
    fn counts_that_are_none() {
        assert_eq!(scale(4096).count(f64::NAN), None);
        assert_eq!(scale(4096).count(f64::INFINITY), None);
        assert_eq!(scale(4096).count(1e300), None);
        assert!(wrap(f64::INFINITY).is_nan());
    }

    #[test]
    fn wrap_is_half_open() {
        assert_eq!(wrap(PI), -PI);
        assert_eq!(wrap(-PI), -PI);
        assert_eq!(wrap(0.0), 0.0);
        assert!(wrap(PI - 1e-15) > 3.0);
        let just_below = f64::from_bits((-PI).to_bits() + 1);
        assert!((-PI..PI).contains(&wrap(just_below)));
    }

    #[test]
    fn rounding_at_odd_multiples_of_pi_leaves_no_angle_outside() {
        for k in -2_000_i32..2_000 {
            let mut angle = f64::from(2 * k + 1) * PI;
            (0..4).for_each(|_| angle = angle.next_down());
            for _ in 0..9 {
                let wrapped = wrap(angle);
                assert!((-PI..PI).contains(&wrapped) && wrapped.abs() > PI - 1e-10, "{angle}: {wrapped}");
                angle = angle.next_up();
            }
        }
    }

    #[test]
    fn unwrapping_the_angle_survives_what_is_not_finite() {
        let mut unwrapper = AngleUnwrapper::default();
        assert_eq!(unwrapper.push(3.0), 3.0);
        assert!(unwrapper.push(f64::NAN).is_nan());
        assert!((unwrapper.push(-3.0) - (TAU - 3.0)).abs() < 1e-15);
    }

    #[test]
    fn unwrapping_modulo_a_turn() {
        let mut unwrapper = Unwrapper::new(1024).unwrap();
        let list = [1020, 1023, 2, 1000, 488, 1000].map(|c| unwrapper.push(c));
        // 1000 → 488 is half a turn back, and back again half a turn back: of two equal steps the
        // negative.
        assert_eq!(list, [1020, 1023, 1026, 1000, 488, -24]);
        assert_eq!(Unwrapper::new(0), None);
        // Begun anew, a value is taken as it is.
        unwrapper.restart();
        assert_eq!([1023, 2].map(|c| unwrapper.push(c)), [1023, 1026]);
    }

    #[test]
    fn direction_is_that_of_the_last_step() {
        let mut turns = MultiTurn::new();
        let mut seen = std::vec::Vec::new();
        for reading in [3, 3, 65_535, 0] {
            turns.update(reading);
            seen.push(turns.direction().sign());
        }
        assert_eq!(seen, [1, 0, -1, 1]);
    }

    #[test]
    fn positions_wrap_at_the_ends_and_can_be_extended() {
        let mut turns = MultiTurn::new();
        let mut line = Unwrapper::wrapping32();
        turns.preset(i32::MAX - 5);
        let mut position = 0;
        for _ in 0..10 {
            position = line.push(i64::from(turns.update(turns.last.wrapping_add(1))));
        }
        assert_eq!(position, i64::from(i32::MAX) + 5);
    }

    proptest! {
        #[test]
        fn a_count_is_recovered_from_its_angle(count in -1_000_000_000_i64..1_000_000_000, n in 1_u32..100_000) {
            prop_assert_eq!(scale(n).count(scale(n).radians(count)), Some(count));
        }

        #[test]
        fn wrapped_differs_by_whole_turns(count in any::<i64>(), n in any::<u32>().prop_filter("zero", |&n| n > 0)) {
            let wrapped = scale(n).wrapped(count);
            prop_assert!((wrapped - count % i64::from(n)) % i64::from(n) == 0);
            let half = i64::from(n / 2);
            prop_assert!((-half..i64::from(n) - half).contains(&wrapped));
            prop_assert!((-PI..PI).contains(&scale(n).wrapped_radians(count)));
        }

        #[test]
        fn wrap_differs_by_whole_turns(angle in -1e6_f64..1e6) {
            let wrapped = wrap(angle);
            prop_assert!((-PI..PI).contains(&wrapped));
            let turns = (angle - wrapped) / TAU;
            prop_assert!((turns - libm::round(turns)).abs() < 1e-9);
        }

        #[test]
        fn multi_turn_follows_any_walk(steps in proptest::collection::vec(-32_768_i32..32_768, 1..500)) {
            let mut turns = MultiTurn::new();
            let mut position = 0_i64;
            for step in steps {
                position += i64::from(step);
                prop_assert_eq!(i64::from(turns.update(position as u16)), position);
            }
        }

        #[test]
        fn unwrapping_follows_any_walk_below_half_a_period(
            period in 3_u32..1 << 20, start in -1_000_i64..1_000, steps in proptest::collection::vec(-1.0_f64..1.0, 1..300),
        ) {
            let mut unwrapper = Unwrapper::new(period).unwrap();
            let mut position = start;
            prop_assert_eq!(unwrapper.push(start), start);
            for step in steps {
                position += (step * f64::from((period - 1) / 2)) as i64;
                prop_assert_eq!(unwrapper.push(position.rem_euclid(i64::from(period))), position);
            }
        }

        #[test]
        fn angle_unwrapping_follows_any_walk(steps in proptest::collection::vec(-3.1_f64..3.1, 1..300)) {
            let mut unwrapper = AngleUnwrapper::default();
            let mut angle = 0.0;
            for step in steps {
                angle += step;
                let got = unwrapper.push(wrap(angle));
                prop_assert!((got - angle).abs() < 1e-9);
            }
        }

        #[test]
        fn nothing_overflows(values in proptest::collection::vec(any::<i64>(), 1..50), period in 1_u32..) {
            let mut unwrapper = Unwrapper::new(period).unwrap();
            for value in values {
                unwrapper.push(value);
            }
        }
    }
}
