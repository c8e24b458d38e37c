//! A clamped–clamped beam whose ends cannot move, so that it stretches: w⁗ + ẅ − ½ (∫w′²) w″ = 0,
//! lengths along the beam in its length, deflections in √(I/A), time such that the first linear
//! frequency is 1. Galerkin with its first eight linear modes: q̈_i = −(β_i⁴/β_1⁴) q_i − ½
//! (qᵀGq)(Gq)_i/β_1⁴ − d q̇_i, G_ij = ∫ψ_i′ ψ_j′.
//!
//! The modes are those of a uniform clamped beam, cos βL cosh βL = 1, of unit mean square. Checked
//! against the frequencies of the clamped beam's first nonlinear mode (1.022259 at a centre
//! deflection of 1.00 and so on).

use crate::plant_oscillator::Oscillator;
use libm::{cos, cosh, exp, sin};
use std::f64::consts::PI;

/// Modes kept.
pub const MODES: usize = 8;
/// States: amplitudes of the modes, then their rates.
pub const STATES: usize = 2 * MODES;
/// Intervals of Simpson's rule.
const INTERVALS: usize = 4000;

/// The plant.
#[derive(Clone, Debug)]
pub struct Beam {
    beta: [f64; MODES],
    stiffness: [f64; MODES],
    stretch: [[f64; MODES]; MODES],
    /// Damping d, the same for all modes.
    pub damping: f64,
    /// Force on the first mode: amplitude and angular frequency.
    pub force: (f64, f64),
}

/// The k-th root of cos z = 1/cosh z, by Newton's method from (k + ½)π.
fn root(k: usize) -> f64 {
    let mut z = (k as f64 + 0.5) * PI;
    for _ in 0..8 {
        let (f, slope) = (cos(z) - 1.0 / cosh(z), -sin(z) + libm::tanh(z) / cosh(z));
        z -= f / slope;
    }
    z
}

/// Mode shape and slope at x in [0, 1]; growing exponentials are paired so that nothing cancels.
fn shape(beta: f64, x: f64) -> (f64, f64) {
    let z = beta * x;
    // σ = (cosh β − cos β)/(sinh β − sin β), and 1 − σ without cancellation.
    let small = exp(-beta);
    let (c, s) = (cos(beta), sin(beta));
    let denominator = 1.0 - small * small - 2.0 * small * s;
    let rest = (2.0 * small * (c - s) - 2.0 * small * small) / denominator;
    let sigma = 1.0 - rest;
    // cosh z − σ sinh z = e^{−z} + (1 − σ) sinh z.
    let sinh = 0.5 * (exp(z) - exp(-z));
    let cosh_z = 0.5 * (exp(z) + exp(-z));
    let value = exp(-z) + rest * sinh - cos(z) + sigma * sin(z);
    let slope = beta * (-exp(-z) + rest * cosh_z + sin(z) + sigma * cos(z));
    (value, slope)
}

impl Default for Beam {
    fn default() -> Self {
        let beta: [f64; MODES] = std::array::from_fn(|i| root(i + 1));
        let one = beta[0].powi(4);
        let mut stretch = [[0.0; MODES]; MODES];
        for n in 0..=INTERVALS {
            let x = n as f64 / INTERVALS as f64;
            let weight = if n == 0 || n == INTERVALS {
                1.0
            } else if n % 2 == 1 {
                4.0
            } else {
                2.0
            } / (3.0 * INTERVALS as f64);
            let slopes: [f64; MODES] = std::array::from_fn(|i| shape(beta[i], x).1);
            for i in 0..MODES {
                for j in 0..MODES {
                    stretch[i][j] += weight * slopes[i] * slopes[j];
                }
            }
        }
        Self {
            beta,
            stiffness: std::array::from_fn(|i| beta[i].powi(4) / one),
            stretch: stretch.map(|row| row.map(|g| g / one.sqrt())),
            damping: 0.0,
            force: (0.0, 1.0),
        }
    }
}

impl Beam {
    /// Deflection at x in [0, 1] for amplitudes q of the modes.
    pub fn deflection(&self, q: &[f64], x: f64) -> f64 {
        q.iter().zip(&self.beta).map(|(q, beta)| q * shape(*beta, x).0).sum()
    }

    /// Stretching stiffness G, scaled so that the force is ½ (qᵀGq) Gq.
    pub fn stretching(&self) -> &[[f64; MODES]; MODES] {
        &self.stretch
    }

    /// Squares of the linear frequencies.
    pub fn stiffness(&self) -> &[f64; MODES] {
        &self.stiffness
    }
}

impl Oscillator<STATES> for Beam {
    fn rate(&self, t: f64, y: &[f64; STATES]) -> [f64; STATES] {
        let pull: [f64; MODES] = std::array::from_fn(|i| (0..MODES).map(|j| self.stretch[i][j] * y[j]).sum());
        let tension: f64 = 0.5 * (0..MODES).map(|i| pull[i] * y[i]).sum::<f64>();
        std::array::from_fn(|i| {
            if i < MODES {
                return y[MODES + i];
            }
            let j = i - MODES;
            let push = if j == 0 { self.force.0 * cos(self.force.1 * t) } else { 0.0 };
            push - self.stiffness[j] * y[j] - tension * pull[j] - self.damping * y[i]
        })
    }

    fn energy(&self, y: &[f64; STATES]) -> f64 {
        let mut energy = 0.0;
        let mut quadratic = 0.0;
        for i in 0..MODES {
            energy += 0.5 * (y[MODES + i] * y[MODES + i] + self.stiffness[i] * y[i] * y[i]);
            quadratic += (0..MODES).map(|j| y[i] * self.stretch[i][j] * y[j]).sum::<f64>();
        }
        energy + 0.125 * quadratic * quadratic
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant_oscillator::record;

    #[test]
    fn modes_are_clamped_and_of_unit_mean_square_and_energy_is_kept() {
        let beam = Beam::default();
        assert!((beam.beta[0] - 4.730040744862704).abs() < 1e-12);
        for beta in beam.beta {
            let (at_end, slope) = shape(beta, 1.0);
            assert!(at_end.abs() < 1e-9 && slope.abs() < 1e-7 * beta, "{beta}: {at_end} {slope}");
            let mean: f64 =
                (0..4000).map(|i| shape(beta, (f64::from(i) + 0.5) / 4000.0).0.powi(2)).sum::<f64>() / 4000.0;
            assert!((mean - 1.0).abs() < 1e-6, "{beta}: {mean}");
        }
        let mut start = [0.0; STATES];
        start[0] = 2.0;
        let states = record(&beam, start, 0.2, 200).unwrap();
        let energy = beam.energy(&start);
        assert!(states.iter().all(|s| (beam.energy(s) / energy - 1.0).abs() < 1e-8));
    }
}
