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
mod tests;
