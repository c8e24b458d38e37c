//! Sine and cosine of many angles at once, within 3e-16 of the exact values, eight at a time where
//! the processor can (pulp).
//!
//! An angle is a multiple of π/4 and a rest of at most π/8 (in three parts, after Cody and
//! Waite, *Software Manual for the Elementary Functions*, 1980): sine and cosine follow by the
//! addition theorem from a table of eight and the power series of the rest. Beyond |x| = 1e5 rad
//! the standard library, whose reduction of large angles is exact. Our own because libraries fix
//! the width of their vectors when they are compiled: `wide`, compiled for the narrowest, took 8 %
//! of an identification.

use core::f64::consts::FRAC_1_SQRT_2;

use pulp::{Arch, NullaryFnOnce};

/// Largest angle of the fast way, rad.
const FAST: f64 = 1e5;
/// 4/π.
const PER_TURN: f64 = 8.0 / core::f64::consts::TAU;
/// π/4 in three parts, the first two of 33 bits: times a whole number below 2¹⁸ they are exact.
const PARTS: [f64; 3] = [7.853_981_633_670_628e-1, 3.038_550_253_151_983e-11, 1.011_133_124_397_975_3e-21];
/// sin kπ/4; cos kπ/4 = sin (k + 2)π/4.
const TABLE: [f64; 8] = [0.0, FRAC_1_SQRT_2, 1.0, FRAC_1_SQRT_2, 0.0, -FRAC_1_SQRT_2, -1.0, -FRAC_1_SQRT_2];

/// Angles worked through at once.
const LANES: usize = 8;

/// Writes sin x and cos x (rad); the three slices are of one length.
pub fn sin_cos(x: &[f64], sin: &mut [f64], cos: &mut [f64]) {
    Arch::new().dispatch(All { x, sin, cos });
}

struct All<'a> {
    x: &'a [f64],
    sin: &'a mut [f64],
    cos: &'a mut [f64],
}

impl NullaryFnOnce for All<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (xs, last) = self.x.as_chunks::<LANES>();
        let (sins, last_sin) = self.sin.as_chunks_mut::<LANES>();
        let (coss, last_cos) = self.cos.as_chunks_mut::<LANES>();
        for ((x, sin), cos) in xs.iter().zip(sins).zip(coss) {
            (*sin, *cos) = each(x);
        }
        // What is left over is computed as all others, whatever its place.
        let mut padded = [0.0; LANES];
        padded[..last.len()].copy_from_slice(last);
        let (sin, cos) = each(&padded);
        last_sin.copy_from_slice(&sin[..last.len()]);
        last_cos.copy_from_slice(&cos[..last.len()]);
    }
}

/// Sine and cosine of four angles.
pub fn four(x: [f64; 4]) -> ([f64; 4], [f64; 4]) {
    Arch::new().dispatch(Four { x })
}

struct Four {
    x: [f64; 4],
}

impl NullaryFnOnce for Four {
    type Output = ([f64; 4], [f64; 4]);

    #[inline(always)]
    fn call(self) -> Self::Output {
        each(&self.x)
    }
}

#[inline(always)]
fn each<const N: usize>(x: &[f64; N]) -> ([f64; N], [f64; N]) {
    if x.iter().all(|x| x.abs() < FAST) { reduced(x) } else { (x.map(f64::sin), x.map(f64::cos)) }
}

/// The same for |x| below [`FAST`].
#[inline(always)]
fn reduced<const N: usize>(x: &[f64; N]) -> ([f64; N], [f64; N]) {
    /// Added, it rounds to a whole number, which then stands in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let mut rest = [0.0; N];
    let (mut sin_of, mut cos_of) = ([0.0; N], [0.0; N]);
    for i in 0..N {
        let shifted = x[i] * PER_TURN + ROUND;
        let k = shifted - ROUND;
        rest[i] = ((x[i] - k * PARTS[0]) - k * PARTS[1]) - k * PARTS[2];
        let place = shifted.to_bits() as usize;
        (sin_of[i], cos_of[i]) = (TABLE[place % 8], TABLE[(place + 2) % 8]);
    }
    let (ds, dc) = series(&rest);
    let (mut sin, mut cos) = ([0.0; N], [0.0; N]);
    for i in 0..N {
        sin[i] = sin_of[i] * dc[i] + cos_of[i] * ds[i];
        cos[i] = cos_of[i] * dc[i] - sin_of[i] * ds[i];
    }
    (sin, cos)
}

/// sin d and cos d of small d by their power series.
#[inline(always)]
fn series<const N: usize>(d: &[f64; N]) -> ([f64; N], [f64; N]) {
    /// 1/n! with alternating signs, highest first, of the odd and even powers.
    const ODD: [f64; 6] = [
        -1.0 / 1_307_674_368e3,
        1.0 / 6_227_020_800.0,
        -1.0 / 39_916_800.0,
        1.0 / 362_880.0,
        -1.0 / 5040.0,
        1.0 / 120.0,
    ];
    const EVEN: [f64; 6] =
        [-1.0 / 87_178_291_200.0, 1.0 / 479_001_600.0, -1.0 / 3_628_800.0, 1.0 / 40_320.0, -1.0 / 720.0, 1.0 / 24.0];
    let (mut sin, mut cos) = ([0.0; N], [0.0; N]);
    for ((d, sin), cos) in d.iter().zip(&mut sin).zip(&mut cos) {
        let square = d * d;
        let odd = ODD.iter().fold(0.0, |sum, term| sum * square + term);
        let even = EVEN.iter().fold(0.0, |sum, term| sum * square + term);
        *sin = d + d * square * (odd * square - 1.0 / 6.0);
        *cos = 1.0 - square * (0.5 - square * even);
    }
    (sin, cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_standard_library() {
        let x: Vec<f64> = (0..9999)
            .map(|i| (0.37 * f64::from(i)).sin() * 10f64.powi(i % 9 - 3))
            .chain([0.0, -0.0, f64::NAN, 1e300])
            .collect();
        let (mut s, mut c) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        sin_cos(&x, &mut s, &mut c);
        for ((x, s), c) in x.iter().zip(&s).zip(&c) {
            let (es, ec) = x.sin_cos();
            assert!(x.is_nan() && s.is_nan() || (s - es).abs() < 3e-16 && (c - ec).abs() < 3e-16, "{x} {s} {c}");
        }
    }
}
