//! Angles on the circle, and the drive's phase at the samples of a record.

use core::f64::consts::{PI, TAU};

/// Where the phase of the drive comes from.
#[derive(Clone, Debug)]
pub enum Phase {
    /// Recorded by the device, turns · 2⁻³² at each sample.
    Device(Vec<u32>),
    /// τ = Ω t with this Ω, rad/s (0 for a free system).
    Clock(f64),
}

/// The angle wrapped to [−π, π).
pub fn wrap(angle: f64) -> f64 {
    let turned = angle - TAU * ((angle + PI) / TAU).floor();
    if turned >= PI { turned - TAU } else { turned }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wraps_to_the_half_open_turn() {
        for (angle, want) in [(0.0, 0.0), (PI, -PI), (-PI, -PI), (3.0 * PI + 0.5, -PI + 0.5), (-0.1, -0.1)] {
            assert!((wrap(angle) - want).abs() < 1e-12, "{angle}");
        }
    }
}
