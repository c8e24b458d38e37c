//! A tone of the base beside the drive: the mains' hum of an amplifier, which keeps its own time
//! and no phase of the drive.

use core::f64::consts::TAU;

/// A sin ω t along the drive, t from the record's start; there at rest, too.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hum {
    /// A, m.
    pub amplitude_m: f64,
    /// ω/2π, Hz.
    pub frequency_hz: f64,
}

impl Hum {
    /// Displacement, velocity, acceleration at a time (s): m, m/s, m/s².
    pub(super) fn at(self, time: f64) -> [f64; 3] {
        if self.amplitude_m == 0.0 {
            return [0.0; 3];
        }
        let omega = TAU * self.frequency_hz;
        let (sin, cos) = libm::sincos(omega * time);
        [self.amplitude_m * sin, self.amplitude_m * omega * cos, -self.amplitude_m * omega * omega * sin]
    }
}
