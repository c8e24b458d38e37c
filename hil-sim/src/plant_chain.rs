//! A chain of 60 masses between fixed ends, each on a hardening spring to the ground: ẍ_i = −g
//! x_i − γ x_i³ + κ (x_{i−1} − 2x_i + x_{i+1}) − d ẋ_i + F φ_i cos Ωt, with φ the chain's first
//! linear mode of unit norm. Dimensionless.

use crate::plant_oscillator::Oscillator;
use libm::{cos, sin};
use std::f64::consts::PI;

/// Number of masses.
pub const MASSES: usize = 60;
/// Number of states.
pub const STATES: usize = 2 * MASSES;

/// The plant. States x, then ẋ.
#[derive(Clone, Debug)]
pub struct Chain {
    /// Linear ground spring.
    pub ground: f64,
    /// Cubic ground spring γ.
    pub cubic: f64,
    /// Spring between neighbours κ.
    pub coupling: f64,
    /// Damping d.
    pub damping: f64,
    /// Amplitude F of the force, and its angular frequency Ω.
    pub force: (f64, f64),
}

impl Default for Chain {
    /// Ground 0.3, cubic 1, coupling such that ω1 = 1, ζ = 0.5 %, no force.
    fn default() -> Self {
        let half = sin(PI / (2.0 * (MASSES + 1) as f64));
        Self { ground: 0.3, cubic: 1.0, coupling: 0.7 / (4.0 * half * half), damping: 0.01, force: (0.0, 1.0) }
    }
}

impl Chain {
    /// First linear mode at mass i, 1 at its greatest.
    pub fn mode(i: usize) -> f64 {
        let centre = sin(PI * (MASSES / 2) as f64 / (MASSES + 1) as f64);
        sin(PI * (i + 1) as f64 / (MASSES + 1) as f64) / centre
    }

    /// At rest on the first linear mode with this displacement at the centre.
    pub fn release(amplitude: f64) -> [f64; STATES] {
        std::array::from_fn(|i| if i < MASSES { amplitude * Self::mode(i) } else { 0.0 })
    }
}

impl Oscillator<STATES> for Chain {
    fn rate(&self, t: f64, y: &[f64; STATES]) -> [f64; STATES] {
        // Unit norm of the mode: Σ sin² = (n + 1)/2.
        let push = self.force.0 * cos(self.force.1 * t) * (2.0 / (MASSES + 1) as f64).sqrt();
        std::array::from_fn(|i| {
            if i < MASSES {
                return y[MASSES + i];
            }
            let j = i - MASSES;
            let x = y[j];
            let left = if j == 0 { 0.0 } else { y[j - 1] };
            let right = if j + 1 == MASSES { 0.0 } else { y[j + 1] };
            let force = if push == 0.0 { 0.0 } else { push * sin(PI * (j + 1) as f64 / (MASSES + 1) as f64) };
            self.coupling * (left - 2.0 * x + right) - x * (self.ground + self.cubic * x * x) - self.damping * y[i]
                + force
        })
    }

    fn energy(&self, y: &[f64; STATES]) -> f64 {
        let mut energy = 0.0;
        let mut before = 0.0;
        for j in 0..MASSES {
            let (x, v) = (y[j], y[MASSES + j]);
            let stretch = x - before;
            energy +=
                0.5 * (v * v + self.ground * x * x + self.coupling * stretch * stretch) + 0.25 * self.cubic * x.powi(4);
            before = x;
        }
        energy + 0.5 * self.coupling * before * before
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant_oscillator::record;

    #[test]
    fn swings_at_one_when_small_and_loses_energy_at_the_damping_rate() {
        let plant = Chain::default();
        assert!((plant.coupling - 264.0).abs() < 1.0);
        let states = record(&plant, Chain::release(1e-3), 2.0 * PI, 6).unwrap();
        let (start, end) = (plant.energy(&states[0]), plant.energy(&states[5]));
        assert!((end / start - (-0.01 * 10.0 * PI).exp()).abs() < 1e-3, "{}", end / start);
        assert!((states[5][30] / states[0][30] - (-0.005 * 10.0 * PI).exp()).abs() < 1e-3);
    }
}
