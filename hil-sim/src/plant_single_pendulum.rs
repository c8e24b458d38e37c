//! A single pendulum on a horizontally shaken base, in the seed's dimensionless form (2.1), (4.7):
//! θ″ + c_r θ′ + (1/r²) sin θ − f sin τ cos θ = 0, c_r = 2ξ/r, a prime being d/dτ and τ = Ω t.
//!
//! The same pendulum in physical units is the double pendulum's plant with a second arm of no mass
//! ([`Parameters::single`]): J θ̈ + c θ̇ + m e (g sin θ + ẍ_b cos θ) = 0 with x_b = a sin τ gives
//! c_r = c/(J Ω), 1/r² = m e g/(J Ω²), f = m e a/J.

use crate::plant::Parameters;
use crate::plant_oscillator::Oscillator;

/// The plant. States θ (rad, unwrapped), θ′; its time is τ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SinglePendulum {
    /// c_r.
    pub friction: f64,
    /// 1/r².
    pub stiffness: f64,
    /// f.
    pub drive: f64,
}

impl Default for SinglePendulum {
    /// The seed's: r = 0.8333, c = 2ξ = 0.03, f = 1.52; c_r = 0.036 and 1/r² = 1.44 are the one
    /// consistent reading.
    fn default() -> Self {
        Self { friction: 0.036, stiffness: 1.44, drive: 1.52 }
    }
}

impl Oscillator<2> for SinglePendulum {
    fn rate(&self, t: f64, y: &[f64; 2]) -> [f64; 2] {
        let [theta, rate] = *y;
        let (sin, cos) = libm::sincos(theta);
        [rate, self.drive * libm::sin(t) * cos - self.stiffness * sin - self.friction * rate]
    }

    fn energy(&self, y: &[f64; 2]) -> f64 {
        0.5 * y[1] * y[1] + self.stiffness * (1.0 - libm::cos(y[0]))
    }
}

impl Parameters {
    /// A single pendulum: arm 2 has no mass and nothing touches it, so that it stays where it is.
    /// `j_o1` about joint 1, kg m². Viscous friction in joint 1 is the effect
    /// `viscous-friction@joint1`.
    pub fn single(m1: f64, e1: f64, j_o1: f64, tau_c1: f64, g: f64) -> Self {
        // The smallest mass that is above zero; m2·l1 adds nothing to m1·e1.
        Self { m1, e1, l1: 1.0, m2: f64::MIN_POSITIVE, e2: 0.0, j_o1, j_o2: 1.0, tau_c1, c_r2: 0.0, g }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant_oscillator::record;
    use crate::simulate::{DriveSettings, Simulation, SimulationSettings};
    use core::f64::consts::TAU;

    #[test]
    fn small_swings_follow_the_linear_resonance() {
        // Without friction, θ″ + k θ = F sin τ from rest: θ = F/(k − 1) (sin τ − sin(√k τ)/√k).
        let plant = SinglePendulum { friction: 0.0, stiffness: 1.44, drive: 1e-5 };
        for (i, y) in record(&plant, [0.0, 0.0], 0.1, 200).unwrap().iter().enumerate() {
            let t = 0.1 * i as f64;
            let want = 1e-5 / 0.44 * (t.sin() - (1.2 * t).sin() / 1.2);
            assert!((y[0] - want).abs() < 1e-12, "{i}: {} {want}", y[0]);
        }
    }

    /// Two plants written apart: the dimensionless one, and the double pendulum's with a massless
    /// second arm on the shaker.
    #[test]
    fn the_massless_second_arm_leaves_a_single_pendulum() {
        let (f_e, j, m, e, g) = (1.25, 2.0e-3, 0.2, 0.05, 9.81);
        let omega = TAU * f_e;
        let a = 0.03;
        let settings = SimulationSettings {
            parameters: Parameters::single(m, e, j, 0.0, g),
            drive: Some(DriveSettings {
                direction: crate::shaker::Direction::Horizontal,
                frequency_hz: f_e,
                amplitude_m: a,
                psi: 0.0,
            }),
            sample_rate_hz: 100.0,
            initial: [0.4, 0.0, 1.0, 0.0],
            settle_s: 0.0,
            effects: vec![crate::plant::effects::Effect::parse("viscous-friction@joint1=0.0003").unwrap()],
            seed: None,
            tolerance: 1e-12,
            ..SimulationSettings::default()
        };
        let mut rig = Simulation::new(&settings).unwrap();
        let plant = SinglePendulum {
            friction: 3e-4 / (j * omega),
            stiffness: m * e * g / (j * omega * omega),
            drive: m * e * a / j,
        };
        let states = record(&plant, [0.4, 1.0 / omega], omega / 100.0, 300).unwrap();
        for y in states {
            let [theta1, theta2] = rig.next_sample().unwrap().angles;
            // The device's drive runs at its own 32-bit frequency, 1e-9 off.
            assert!((theta1 - y[0]).abs() < 1e-6, "{theta1} {}", y[0]);
            assert!((theta2 + theta1).abs() < 1e-12, "arm 2 moved: {theta2} {theta1}");
        }
    }
}
