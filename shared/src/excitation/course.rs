//! The increments of a phase whose frequency glides.

use super::{Excitation, Glide, Law, STAIR, ticks};
use crate::waveform::phase_increment;

/// Binary places of numbers from 1 to 2.
const PLACES: u32 = 62;

/// 2^(2⁻¹), 2^(2⁻²), …, 2^(2⁻³²), in 2⁻⁶².
pub(super) const ROOTS: [u64; 32] = {
    let mut roots = [0; 32];
    let mut root: u128 = 2 << PLACES;
    let mut i = 0;
    while i < 32 {
        root = (root << PLACES).isqrt();
        // Below 2 · 2⁶².
        roots[i] = root as u64;
        i += 1;
    }
    roots
};

/// a b of two numbers in 2⁻⁶².
const fn times(a: u64, b: u64) -> u64 {
    // Both are below 2, the product below 4.
    ((a as u128 * b as u128) >> PLACES) as u64
}

/// log₂(hi/lo) in 2⁻³², for 0 < lo ≤ hi: cut, not rounded.
pub(super) fn log2(hi: u32, lo: u32) -> u64 {
    let mut whole = u64::from(hi.leading_zeros().abs_diff(lo.leading_zeros()));
    let mut ratio = (u128::from(hi) << PLACES) / (u128::from(lo.max(1)) << whole);
    if ratio < 1 << PLACES {
        whole = whole.saturating_sub(1);
        ratio <<= 1;
    }
    // In [1, 2).
    let mut ratio = ratio as u64;
    let mut log = whole;
    for _ in 0..32 {
        ratio = times(ratio, ratio);
        let bit = ratio >> (PLACES + 1);
        ratio >>= bit;
        log = log << 1 | bit;
    }
    log
}

/// lo · 2^e, e in 2⁻³² and below 32, rounded.
pub(super) fn scaled(lo: u32, exponent: u64) -> u32 {
    let mut power = 1_u64 << PLACES;
    for (i, root) in ROOTS.iter().enumerate() {
        if exponent >> (31 - i) & 1 == 1 {
            power = times(power, *root);
        }
    }
    let whole = (exponent >> 32) as u32;
    let product = (u128::from(lo) * u128::from(power)) << whole.min(31);
    u32::try_from((product + (1 << (PLACES - 1))) >> PLACES).unwrap_or(u32::MAX)
}

/// Where a gliding frequency is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Course {
    law: Law,
    back: bool,
    /// Increments of the phase at both ends, the lower one first, and whether it begins there.
    pub(super) ends: [u32; 2],
    rises: bool,
    /// log₂ of their ratio, in 2⁻³².
    log: u64,
    /// Stairs from one end to the other, and those that have been taken there (and back).
    pub(super) stairs: u32,
    pub(super) taken: u32,
    /// Ticks that are left of this one.
    left: u32,
}

impl Course {
    /// At its beginning; none where a frequency is not below half the sampling rate.
    #[must_use]
    pub fn new(excitation: &Excitation, sample_rate_millihertz: u32) -> Option<Self> {
        let Glide { law, back, to_millihertz, ms } = excitation.glide;
        let from = phase_increment(excitation.frequency_millihertz, sample_rate_millihertz)?;
        let to = if law == Law::Steady { from } else { phase_increment(to_millihertz, sample_rate_millihertz)? };
        let ends = [from.min(to), from.max(to)];
        let log = if law == Law::Logarithmic { log2(ends[1], ends[0].max(1)) } else { 0 };
        let stairs = (ticks(ms, sample_rate_millihertz) / STAIR).max(1);
        Some(Self { law, back, ends, rises: from <= to, log, stairs, taken: 0, left: STAIR })
    }

    /// Advance of the phase in a tick now, turns · 2⁻³².
    #[must_use]
    pub fn increment(&self) -> u32 {
        let [lo, hi] = self.ends;
        let gone = self.taken.min(2 * self.stairs - self.taken.min(2 * self.stairs));
        let up = u64::from(if self.rises { gone } else { self.stairs - gone });
        let all = u64::from(self.stairs);
        match self.law {
            Law::Steady => lo,
            // Between both ends.
            Law::Linear => lo + ((u64::from(hi - lo) * up + all / 2) / all) as u32,
            Law::Logarithmic if up == all => hi,
            // 37 bits of the logarithm, 26 of the longest glide's stairs.
            Law::Logarithmic => scaled(lo, self.log * up / all).min(hi),
        }
    }

    /// A tick has gone by; whether the increment may have changed.
    pub fn advance(&mut self) -> bool {
        if self.law == Law::Steady || (!self.back && self.taken == self.stairs) {
            return false;
        }
        self.left -= 1;
        if self.left > 0 {
            return false;
        }
        self.left = STAIR;
        self.taken += 1;
        if self.taken == 2 * self.stairs {
            self.taken = 0;
        }
        true
    }
}
