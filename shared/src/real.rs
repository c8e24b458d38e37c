//! Real numbers of either precision with the same results on every platform.
//!
//! `num_traits::Float` uses the platform's sine wherever any crate of a build turns its `std`
//! feature on. What the device computes must come out alike on the host, so in double precision
//! cosine and sine are taken from `libm` by name; in single precision they are polynomials (S. L.
//! Moshier's, of the Cephes library's sinf and cosf), of which every operation is rounded alike
//! everywhere. Their argument is a binary fraction of a turn: reducing it to an octant is exact in
//! integers, whatever the number of turns.

use num_traits::{Float, FloatConst};

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// `f32` or `f64`.
pub trait Real: Float + FloatConst + sealed::Sealed {
    /// 0, for constants.
    const ZERO: Self;
    /// cos and sin of an angle within ±π/4, error below 1e-7 (`f32`) or 1 ulp (`f64`).
    fn cos_sin_octant(angle: Self) -> (Self, Self);
    /// The nearest number to an integer.
    fn from_i64(value: i64) -> Self;
    /// The nearest number to an integer of 32 bits.
    fn from_i32(value: i32) -> Self;
    /// The nearest number to a double.
    fn from_f64(value: f64) -> Self;
}

/// cos x ≈ 1 − x²/2 + x⁴·(C4 + C6 x² + C8 x⁴), sin x ≈ x + x³·(S3 + S5 x² + S7 x⁴) on ±π/4:
/// coefficients of least greatest error.
const COS: [f32; 3] = [4.166_664_6e-2, -1.388_731_6e-3, 2.443_315_7e-5];
const SIN: [f32; 3] = [-1.666_665_5e-1, 8.332_161e-3, -1.951_529_6e-4];

impl Real for f32 {
    const ZERO: Self = 0.0;

    // libm's computes in double precision, which a processor with single precision alone emulates
    // at ten times the cost.
    fn cos_sin_octant(angle: Self) -> (Self, Self) {
        let square = angle * angle;
        let cos = 1.0 - 0.5 * square + square * square * (COS[0] + square * (COS[1] + square * COS[2]));
        let sin = angle + angle * square * (SIN[0] + square * (SIN[1] + square * SIN[2]));
        (cos, sin)
    }
    fn from_i64(value: i64) -> Self {
        value as Self
    }
    fn from_i32(value: i32) -> Self {
        value as Self
    }
    fn from_f64(value: f64) -> Self {
        value as Self
    }
}

impl Real for f64 {
    const ZERO: Self = 0.0;

    fn cos_sin_octant(angle: Self) -> (Self, Self) {
        (libm::cos(angle), libm::sin(angle))
    }
    fn from_i64(value: i64) -> Self {
        value as Self
    }
    fn from_i32(value: i32) -> Self {
        value.into()
    }
    fn from_f64(value: f64) -> Self {
        value
    }
}

/// cos and sin of `turns`·2⁻⁶⁴ turns.
///
/// The error is below 1.2e-7 for `f32` and 3.5e-16 for `f64` (two roundings of the angle, one of
/// the result), at any angle.
#[must_use]
pub fn cos_sin_turns<T: Real>(turns: u64) -> (T, T) {
    // Nearest quarter turn and the signed rest within ±1/8 turn.
    let quarter = turns.wrapping_add(1 << 61) >> 62;
    let rest = turns.wrapping_sub(quarter << 62) as i64;
    let angle = T::from_i64(rest) * T::from_f64(core::f64::consts::TAU / 18_446_744_073_709_551_616.0);
    let (cos, sin) = T::cos_sin_octant(angle);
    match quarter & 3 {
        0 => (cos, sin),
        1 => (-sin, cos),
        2 => (-cos, -sin),
        _ => (sin, -cos),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_exact() {
        for (quarter, want) in [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)].into_iter().enumerate() {
            let (c, s): (f64, f64) = cos_sin_turns((quarter as u64) << 62);
            assert_eq!((c + 0.0, s + 0.0), want);
        }
    }

    #[test]
    fn error_bounds_hold_all_round_the_circle() {
        // An odd stride visits the circle evenly; the reference is the double-precision libm on a
        // reduced angle.
        let (mut worst32, mut worst64) = (0.0_f64, 0.0_f64);
        let mut turns = 12_345_u64;
        for _ in 0..200_000 {
            turns = turns.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let angle = (turns as f64) / 18_446_744_073_709_551_616.0 * core::f64::consts::TAU;
            let (c32, s32): (f32, f32) = cos_sin_turns(turns);
            let (c64, s64): (f64, f64) = cos_sin_turns(turns);
            worst32 = worst32.max((f64::from(c32) - c64).abs()).max((f64::from(s32) - s64).abs());
            // The reference angle itself is rounded by up to 2⁻⁵² · 4, hence the looser bound here.
            worst64 = worst64.max((c64 - libm::cos(angle)).abs()).max((s64 - libm::sin(angle)).abs());
        }
        assert!(worst32 < 1.2e-7, "{worst32:e}");
        assert!(worst64 < 2e-15, "{worst64:e}");
    }

    #[test]
    fn unit_length_within_rounding() {
        let mut turns = 1_u64;
        for _ in 0..100_000 {
            turns = turns.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let (c, s): (f64, f64) = cos_sin_turns(turns);
            assert!((c * c + s * s - 1.0).abs() < 4.5e-16);
        }
    }
}
