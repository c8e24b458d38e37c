//! What a device that identifies sends: its estimate, and the regression rows from which a host can
//! make its own.
//!
//! Both are of the double pendulum with the default dampings, see [`crate::regressor`]. Their
//! numbers are floats that never leave the form in which they were computed: [`Binary32`] is IEEE
//! 754 binary32, [`Binary24`] its upper three bytes, rounded.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::regressor::{Row, UNKNOWNS1, UNKNOWNS2};

/// IEEE 754 binary32, little-endian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Binary32(pub [u8; 4]);

impl From<f32> for Binary32 {
    fn from(value: f32) -> Self {
        Self(value.to_le_bytes())
    }
}

impl From<Binary32> for f32 {
    fn from(Binary32(bytes): Binary32) -> Self {
        Self::from_le_bytes(bytes)
    }
}

/// Sign, exponent and the upper 15 bits of the mantissa of IEEE 754 binary32, rounded to nearest,
/// ties to even, little-endian: relative error at most 2⁻¹⁶ = 1.5e-5.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Binary24(pub [u8; 3]);

impl From<f32> for Binary24 {
    fn from(value: f32) -> Self {
        let bits = value.to_bits();
        let rounded = if value.is_finite() {
            // A carry out of the mantissa goes into the exponent, as it should.
            bits.wrapping_add(0x7f + (bits >> 8 & 1))
        } else {
            bits
        };
        let [_, a, b, c] = rounded.to_le_bytes();
        Self([a, b, c])
    }
}

impl From<Binary24> for f32 {
    fn from(Binary24([a, b, c]): Binary24) -> Self {
        Self::from_le_bytes([0, a, b, c])
    }
}

/// An unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Unknown {
    /// Its value, non-dimensional.
    pub value: Binary32,
    /// Its standard error.
    pub std_error: Binary32,
}

/// What is known of an equation; `U` an array of [`Unknown`]s.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum EquationEstimate<U> {
    /// All unknowns.
    Known {
        /// Values and standard errors.
        unknowns: U,
        /// Condition of the rows, 1 or more: by how much they inflate the standard errors, as an
        /// rms over the unknowns ([`crate::least_squares`]).
        condition: Binary32,
        /// rms of the rows' residuals, non-dimensional.
        residual_rms: Binary32,
    },
    /// Too few windows yet.
    TooFewWindows,
    /// Not identifiable: the rows do not determine an unknown, by its place in the equation.
    Undetermined(u8),
    /// Not identifiable: the motion repeats itself, locked to the drive.
    Repeating,
}

/// The device's own estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Estimate {
    /// Tick of the newest window's last sample.
    pub tick: u32,
    /// Length of a window, ticks: twenty drive periods, to the nearest even tick.
    pub window_ticks: u32,
    /// Windows since the last gap or change of the drive; each overlaps the one before by half.
    pub windows: u32,
    /// What a window counts for after the next one, thousandths.
    pub forget_per_mille: u16,
    /// Advance of the drive's phase in a tick, turns · 2⁻³².
    pub phase_increment: u32,
    /// Commanded amplitude of the base, nm.
    pub amplitude_nanometre: u32,
    /// B11 B12 B13 B14 C11 C12.
    pub first: EquationEstimate<[Unknown; UNKNOWNS1]>,
    /// B21 B22 B23 B24 C2.
    pub second: EquationEstimate<[Unknown; UNKNOWNS2]>,
}

/// Numbers of a row of both equations: columns and target of the first, then of the second.
pub const ROW_LEN: usize = UNKNOWNS1 + 1 + UNKNOWNS2 + 1;
/// Most rows in a message: real and imaginary part at two frequencies.
pub const ROWS_LEN: usize = 4;

/// Regression rows of a window at consecutive m, the real and the imaginary part of each (which is
/// zero at m = 0).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rows {
    /// Tick of the window's last sample.
    pub tick: u32,
    /// Length of the window, ticks.
    pub window_ticks: u32,
    /// Number of the window since the last gap or change of the drive, from 1; each overlaps the
    /// one before by half.
    pub window: u32,
    /// Advance of the drive's phase in a tick, turns · 2⁻³².
    pub phase_increment: u32,
    /// Commanded amplitude of the base, nm.
    pub amplitude_nanometre: u32,
    /// m of the first two rows.
    pub frequency: u8,
    /// Highest m of the window.
    pub last_frequency: u8,
    /// The rows.
    pub rows: Vec<[Binary24; ROW_LEN], ROWS_LEN>,
}

/// A row of both equations as it is sent.
#[must_use]
pub fn row_to_wire(row: &Row<f32>) -> [Binary24; ROW_LEN] {
    let ((first, target1), (second, target2)) = (row.first, row.second);
    let mut all = first.into_iter().chain([target1]).chain(second).chain([target2]);
    // As many as there are places.
    core::array::from_fn(|_| all.next().map_or_else(Binary24::default, Binary24::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floats_survive_and_are_rounded_to_nearest() {
        for value in [0.0, -0.0, 1.0, -0.113_1, 3.4e38, 1e-40, f32::INFINITY, f32::MIN_POSITIVE] {
            assert_eq!(f32::from(Binary32::from(value)).to_bits(), value.to_bits());
        }
        assert!(f32::from(Binary32::from(f32::NAN)).is_nan() && f32::from(Binary24::from(f32::NAN)).is_nan());
        assert_eq!(f32::from(Binary24::from(f32::NEG_INFINITY)), f32::NEG_INFINITY);
        assert_eq!(f32::from(Binary24::from(f32::MAX)), f32::INFINITY);
        let mut worst = 0.0_f32;
        for n in 0..100_000_u32 {
            let value = f32::from_bits(0x3c00_0000 + n * 1_237);
            let short = f32::from(Binary24::from(-value));
            worst = worst.max((short / -value - 1.0).abs());
        }
        assert!((1.4e-5..=1.53e-5).contains(&worst), "{worst}");
        // Ties go to even: 1 + 2⁻¹⁶ is half a step above 1, 1 + 3·2⁻¹⁶ half a step below 1 + 2⁻¹⁴.
        assert_eq!(f32::from(Binary24::from(1.0 + 1.0 / 65_536.0)), 1.0);
        assert_eq!(f32::from(Binary24::from(1.0 + 3.0 / 65_536.0)), 1.0 + 1.0 / 16_384.0);
    }

    #[test]
    fn a_row_is_sent_in_order() {
        let row = Row { first: ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 7.0), second: ([8.0, 9.0, 10.0, 11.0, 12.0], 13.0) };
        let wire = row_to_wire(&row).map(f32::from);
        assert_eq!(wire, core::array::from_fn(|i| (i + 1) as f32));
    }
}
