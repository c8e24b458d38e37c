//! The drive's phase and displacement: y = a cos τ, the phase τ an integer.
//!
//! The phase is an accumulator of 32 bits in turns · 2⁻³²; each tick adds `increment` =
//! round(f·2³²/f_s), f and f_s in mHz. What the device adds up is therefore what the host knows,
//! exactly, at any later tick. Rounding the increment moves the frequency by at most f_s·2⁻³³
//! (5.8e-8 Hz at 500 Hz); [`exact_frequency`] gives the frequency that results.
//!
//! cos comes after an exact reduction to an octant ([`crate::real`]); the displacement in nm is
//! rounded once. Error of the displacement: at most 0.5 nm + 1.2e-7 a.

use core::f64::consts::TAU;

use crate::real::{Real, cos_sin_turns};

/// Turns · 2⁻³² in one turn.
const TURN: f64 = 4_294_967_296.0;

/// The phase of the drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PhaseAccumulator {
    /// Phase at the present tick, turns · 2⁻³².
    pub phase: u32,
    /// Advance in one tick, turns · 2⁻³².
    pub increment: u32,
}

impl PhaseAccumulator {
    /// Goes on by a number of ticks.
    pub fn advance(&mut self, ticks: u32) {
        self.phase = self.phase.wrapping_add(self.increment.wrapping_mul(ticks));
    }
}

/// round(f·2³²/f_s), ties away from zero; `None` where f_s is zero or f is not below f_s/2.
#[must_use]
pub fn phase_increment(frequency_millihertz: u32, sample_rate_millihertz: u32) -> Option<u32> {
    let (f, rate) = (u64::from(frequency_millihertz), u64::from(sample_rate_millihertz));
    if 2 * f >= rate {
        return None;
    }
    // f < 2³¹, so the sum stays below 2⁶⁴.
    u32::try_from(((f << 32) + rate / 2) / rate).ok()
}

/// The frequency in Hz that an increment makes at a sampling rate.
#[must_use]
pub fn exact_frequency(increment: u32, sample_rate_millihertz: u32) -> f64 {
    f64::from(increment) * (f64::from(sample_rate_millihertz) / 1000.0) / TURN
}

/// A phase in radians, [0, 2π).
#[must_use]
pub fn phase_radians(phase: u32) -> f64 {
    f64::from(phase) * (TAU / TURN)
}

/// cos and sin of a phase; error below 1.2e-7 (`f32`) or 3.5e-16 (`f64`).
#[must_use]
pub fn cos_sin<T: Real>(phase: u32) -> (T, T) {
    cos_sin_turns(u64::from(phase) << 32)
}

/// A cosine in 2⁻³¹.
#[must_use]
pub fn fixed(cos: f32) -> i64 {
    // A product with a power of two is exact, so cos·2³¹ is an integer for |cos| ≥ 2⁻⁷ and rounded
    // below 2⁻³¹ otherwise.
    (cos * 2_147_483_648.0) as i64
}

/// A number of nm in 2⁻³¹, rounded half away from zero, so that the waveform is symmetric; saturates
/// at ±(2³¹ − 1) nm.
#[must_use]
pub fn rounded(product: i64) -> i32 {
    let rounded = (product.saturating_abs().saturating_add(1 << 30)) >> 31;
    (product.signum() * rounded).clamp(-i64::from(i32::MAX), i64::from(i32::MAX)) as i32
}

/// The base's displacement a cos τ in nm, upward positive (for a vertical drive); saturates at
/// ±(2³¹ − 1) nm.
///
/// The phase, the amplitude and the product are integers; only the cosine is in single precision.
#[must_use]
pub fn displacement(amplitude_nanometre: u32, phase: u32) -> i32 {
    rounded(i64::from(amplitude_nanometre) * fixed(cos_sin(phase).0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn increments_are_rounded_exactly() {
        assert_eq!(phase_increment(5_000, 500_000), Some(42_949_673)); // 42 949 672.96
        assert_eq!(phase_increment(5_200, 500_000), Some(44_667_660)); // 44 667 659.8784
        assert_eq!(phase_increment(0, 500_000), Some(0));
        assert_eq!(phase_increment(125_000, 500_000), Some(1 << 30));
        assert_eq!(phase_increment(249_999, 500_000).map(|i| i < 1 << 31), Some(true));
        assert_eq!(phase_increment(250_000, 500_000), None);
        assert_eq!(phase_increment(5_000, 0), None);
        assert_eq!(phase_increment(u32::MAX, u32::MAX), None);
        assert_eq!(phase_increment(u32::MAX / 2, u32::MAX), Some((1 << 31) - 1));
    }

    #[test]
    fn increment_error_is_at_most_half_a_unit() {
        for f in (1..250_000).step_by(37) {
            let increment = phase_increment(f, 500_000).unwrap();
            let error = i128::from(increment) * 500_000 - (i128::from(f) << 32);
            assert!(2 * error.abs() <= 500_000, "{f} mHz");
            assert!((exact_frequency(increment, 500_000) - f64::from(f) / 1e3).abs() <= 500.0 / TURN / 2.0 * 1.000_001);
        }
    }

    #[test]
    fn accumulator_jumps_as_it_steps() {
        let mut steps = PhaseAccumulator { phase: 0xf000_0000, increment: 44_667_660 };
        let mut jump = steps;
        for _ in 0..123_457 {
            steps.advance(1);
        }
        jump.advance(123_457);
        assert_eq!(steps, jump);
        // (0xf000_0000 + 123 457 · 44 667 660) modulo 2³².
        assert_eq!(jump.phase, 0xe3ea_ee0c);
    }

    #[test]
    fn displacement_error_is_bounded() {
        for amplitude in [0, 1, 999, 11_500_000, 15_525_000, 20_000_000, i32::MAX as u32] {
            let bound = 0.5 + 1.2e-7 * f64::from(amplitude);
            let mut phase = 7_u32;
            for _ in 0..60_000 {
                phase = phase.wrapping_add(0x9e37_79b9);
                let exact = f64::from(amplitude) * libm::cos(phase_radians(phase));
                let error = (f64::from(displacement(amplitude, phase)) - exact).abs();
                assert!(error <= bound, "amplitude {amplitude} phase {phase}: {error}");
            }
        }
    }

    #[test]
    fn displacement_is_symmetric_and_never_beyond_the_amplitude() {
        for phase in (0..u32::MAX - 4_000_037).step_by(4_000_037) {
            let y = displacement(15_525_000, phase);
            assert_eq!(y, -displacement(15_525_000, phase.wrapping_add(1 << 31)));
            assert!(y.unsigned_abs() <= 15_525_000);
        }
        assert_eq!(displacement(15_525_000, 0), 15_525_000);
        assert_eq!(displacement(15_525_000, 1 << 30), 0);
        assert_eq!(displacement(u32::MAX, 0), i32::MAX);
        assert_eq!(displacement(u32::MAX, 1 << 31), -i32::MAX);
    }

    #[test]
    fn harmonics_of_the_drive_sample_are_below_a_ten_millionth() {
        // One turn of 1000 samples: the amplitude at 2ω and 3ω of what is written is rounding
        // alone.
        let (n, a) = (1000_u32, 15_525_000_u32);
        for order in [0_u64, 2, 3, 5] {
            let (mut re, mut im) = (0.0, 0.0);
            for i in 0..n {
                let phase = ((u64::from(i) << 32) / u64::from(n)) as u32;
                let angle = TAU * ((order * u64::from(i)) % u64::from(n)) as f64 / f64::from(n);
                let y = f64::from(displacement(a, phase));
                re += y * libm::cos(angle);
                im += y * libm::sin(angle);
            }
            let size = 2.0 / f64::from(n) * libm::sqrt(re * re + im * im) / f64::from(a);
            assert!(size < 1e-7, "order {order}: {size:e}");
        }
    }
}
