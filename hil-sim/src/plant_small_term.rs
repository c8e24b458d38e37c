//! A forced oscillator with a small cubic stiffness (the seed's (6.1)): ẍ + kx + cẋ + a x³ = F cos
//! ωt. Dimensionless.

use core::f64::consts::TAU;

use crate::integrator::IntegrationError;
use crate::plant_oscillator::{Oscillator, record};

/// The plant. States x, ẋ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmallTerm {
    /// k.
    pub stiffness: f64,
    /// c.
    pub friction: f64,
    /// a, small beside k.
    pub cubic: f64,
    /// F.
    pub force: f64,
    /// ω.
    pub omega: f64,
}

impl Oscillator<2> for SmallTerm {
    fn rate(&self, t: f64, y: &[f64; 2]) -> [f64; 2] {
        let [x, v] = *y;
        [v, self.force * libm::cos(self.omega * t) - self.stiffness * x - self.friction * v - self.cubic * x * x * x]
    }

    fn energy(&self, y: &[f64; 2]) -> f64 {
        0.5 * (y[1] * y[1] + self.stiffness * y[0] * y[0]) + 0.25 * self.cubic * y[0].powi(4)
    }
}

impl SmallTerm {
    /// One period of the steady motion, `samples` of x evenly over it, and the force at each.
    ///
    /// # Errors
    /// A state that leaves the finite numbers.
    pub fn steady(&self, samples: usize) -> Result<(Vec<f64>, Vec<f64>), IntegrationError> {
        let period = TAU / self.omega;
        // Until the start has decayed by 1e-11, whole periods.
        let settle = (50.0 / self.friction / period).ceil();
        let settled = record(self, [0.0, 0.0], settle * period, 2)?;
        // The force repeats, so that time may start again at 0.
        let states = record(self, settled[1], period / samples as f64, samples)?;
        let force = (0..samples).map(|i| self.force * libm::cos(TAU * i as f64 / samples as f64)).collect();
        Ok((states.iter().map(|s| s[0]).collect(), force))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_the_cubic_term_it_is_the_linear_resonance() {
        let plant = SmallTerm { stiffness: 1.0, friction: 0.1, cubic: 0.0, force: 0.2, omega: 0.9 };
        let (x, _) = plant.steady(50).unwrap();
        let (a, b) = (1.0 - 0.81, 0.1 * 0.9);
        let size = 0.2 / (a * a + b * b);
        for (i, x) in x.iter().enumerate() {
            let phase = TAU * i as f64 / 50.0;
            let want = size * (a * phase.cos() + b * phase.sin());
            assert!((x - want).abs() < 1e-8, "{i} {x} {want}");
        }
    }
}
