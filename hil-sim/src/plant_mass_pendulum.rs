//! A block on a spring that carries a pendulum (the seed's (5.18), Table 5.2), in physical units.
//!
//! Block m1 at horizontal position X on a spring k; point mass m2 at the end of a massless bar of
//! length l, angle θ from hanging. From the Lagrangian ½(m1+m2) Ẋ² + m2 l Ẋ θ̇ cos θ + ½ m2 l²
//! θ̇² − ½ k X² − m2 g l (1 − cos θ): (m1+m2) Ẍ + m2 l (θ̈ cos θ − θ̇² sin θ) + k X = 0, m2 l² θ̈ +
//! m2 l Ẍ cos θ + m2 g l sin θ = 0.

use crate::plant_oscillator::Oscillator;
use libm::{cos, sin};

/// The five releases from rest of the seed's section 5.3.3, (X/l, θ).
pub const RELEASES: [[f64; 2]; 5] = [[0.125, 0.385], [0.250, 0.733], [0.375, 1.10], [0.500, 1.54], [0.575, 1.892]];

/// The plant. States X, θ, Ẋ, θ̇ (m, rad, s).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassPendulum {
    /// Block, kg.
    pub m1: f64,
    /// Bob, kg.
    pub m2: f64,
    /// Spring, N/m.
    pub k: f64,
    /// Length of the bar, m.
    pub l: f64,
    /// Gravity, m/s².
    pub g: f64,
}

impl Default for MassPendulum {
    /// Table 5.2.
    fn default() -> Self {
        Self { m1: 0.1, m2: 0.1, k: 100.0, l: 0.04, g: 9.81 }
    }
}

impl Oscillator<4> for MassPendulum {
    fn rate(&self, _t: f64, y: &[f64; 4]) -> [f64; 4] {
        let [x, q, vx, vq] = *y;
        let (s, c) = (sin(q), cos(q));
        let Self { m1, m2, k, l, g } = *self;
        // The bar's tension from the bob's motion, then the block's balance: eliminating θ̈ leaves
        // (m1 + m2 sin²θ) Ẍ.
        let block = (m2 * l * vq * vq * s + m2 * g * s * c - k * x) / (m1 + m2 * s * s);
        [vx, vq, block, -(block * c + g * s) / l]
    }

    fn energy(&self, y: &[f64; 4]) -> f64 {
        let [x, q, vx, vq] = *y;
        let (s, c) = (sin(q), cos(q));
        let (bob_x, bob_y) = (vx + self.l * vq * c, self.l * vq * s);
        0.5 * self.m1 * vx * vx
            + 0.5 * self.m2 * (bob_x * bob_x + bob_y * bob_y)
            + 0.5 * self.k * x * x
            + self.m2 * self.g * self.l * (1.0 - c)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant_oscillator::record;

    #[test]
    fn keeps_its_energy_and_a_heavy_block_leaves_a_plain_pendulum() {
        let plant = MassPendulum::default();
        let states = record(&plant, [0.575 * 0.04, 1.892, 0.0, 0.0], 0.005, 4000).unwrap();
        let start = plant.energy(&states[0]);
        assert!(states.iter().all(|s| (plant.energy(s) / start - 1.0).abs() < 1e-8));
        let heavy = MassPendulum { m1: 1e9, ..plant };
        let end = record(&heavy, [0.0, 1e-3, 0.0, 0.0], 0.01, 101).unwrap()[100];
        assert!((end[1] - 1e-3 * (9.81_f64 / 0.04).sqrt().cos()).abs() < 1e-8, "{end:?}");
    }
}
