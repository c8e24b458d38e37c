//! The single pendulum of (2.6) with one harmonic as an equation that can be integrated, with analytic partial derivatives.
//!
//! θ̈ = −Ω c_r θ̇ − Ω² [C11 sign θ̇ + q_cos cos θ + q_sin sin θ + (n_cos cos θ + n_sin sin θ) cos τ + (p_cos cos θ + p_sin sin θ) sin τ]
//!
//! Parameters in the order of the weak model: the dampings, then n, p (driven) and q, cosine before sine.

use super::dynamics::{Dynamics, Instant};
use super::single_pendulum::weak_model;

/// The single pendulum's equation of motion.
#[derive(Clone, Debug)]
pub struct SinglePendulum {
    omega: f64,
    driven: bool,
    /// Whether each damping is viscous.
    dampings: Vec<bool>,
    names: Vec<String>,
    units: Vec<&'static str>,
    switches: Vec<Vec<f64>>,
}

impl SinglePendulum {
    /// The equation at angular frequency `omega` (rad/s; 1 for a free system, `driven` false then); `dampings`: names of their coefficients.
    pub fn new(omega: f64, driven: bool, dampings: &[&'static str]) -> Self {
        let model = weak_model(omega, driven, dampings, 1);
        let terms = model.equations.first().map_or(&[][..], |e| &e.terms);
        let viscous: Vec<bool> = dampings.iter().map(|d| *d == "c_r").collect();
        let jumps = viscous.contains(&false);
        Self {
            omega,
            driven,
            dampings: viscous,
            names: terms.iter().map(|t| t.name.clone()).collect(),
            units: terms.iter().map(|t| t.unit).collect(),
            switches: if jumps { vec![vec![1.0]] } else { Vec::new() },
        }
    }

    /// Names of the parameters.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Units of the parameters.
    pub fn units(&self) -> &[&'static str] {
        &self.units
    }

    /// Visits each parameter's column and the derivatives of that by angle and rate.
    fn columns(&self, q: f64, v: f64, tau: f64, sign: f64, mut visit: impl FnMut(usize, f64, f64, f64)) {
        let square = self.omega * self.omega;
        let (sin, cos) = q.sin_cos();
        let mut k = 0;
        for viscous in &self.dampings {
            if *viscous {
                visit(k, -self.omega * v, 0.0, -self.omega);
            } else {
                visit(k, -square * sign, 0.0, 0.0);
            }
            k += 1;
        }
        let (sin_tau, cos_tau) = tau.sin_cos();
        let factors = [cos_tau, sin_tau, 1.0];
        for f in if self.driven { &factors[..] } else { &factors[2..] } {
            visit(k, -square * f * cos, square * f * sin, 0.0);
            visit(k + 1, -square * f * sin, -square * f * cos, 0.0);
            k += 2;
        }
    }
}

fn sign(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

impl Dynamics for SinglePendulum {
    fn degrees_of_freedom(&self) -> usize {
        1
    }

    fn parameter_count(&self) -> usize {
        self.names.len()
    }

    fn acceleration(&self, p: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, out: &mut [f64]) -> bool {
        self.acceleration_held(p, q, v, at, &[sign(v[0])], out)
    }

    fn partials(&self, p: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, out: &mut [f64]) -> bool {
        self.partials_held(p, q, v, at, &[sign(v[0])], out)
    }

    fn switches(&self) -> &[Vec<f64>] {
        &self.switches
    }

    fn acceleration_held(&self, p: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, s: &[f64], out: &mut [f64]) -> bool {
        let mut sum = 0.0;
        self.columns(q[0], v[0], at.tau, s.first().copied().unwrap_or(0.0), |k, c, _, _| sum += p[k] * c);
        out[0] = sum;
        sum.is_finite()
    }

    fn partials_held(&self, p: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, s: &[f64], out: &mut [f64]) -> bool {
        let (mut by_q, mut by_v) = (0.0, 0.0);
        self.columns(q[0], v[0], at.tau, s.first().copied().unwrap_or(0.0), |k, c, dq, dv| {
            out[2 + k] = c;
            by_q += p[k] * dq;
            by_v += p[k] * dv;
        });
        (out[0], out[1]) = (by_q, by_v);
        by_q.is_finite() && by_v.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partials_agree_with_differences_and_the_seeds_equation_comes_out() {
        let d = SinglePendulum::new(2.0, true, &["c_r", "C11"]);
        assert_eq!(d.names(), ["c_r", "C11", "n_cos", "n_sin", "p_cos", "p_sin", "q_cos", "q_sin"]);
        let p = [0.036, 0.01, 0.02, -0.03, -1.52, 0.05, 0.04, 1.44];
        let at = Instant { time: 0.0, tau: 0.9, inputs: &[] };
        let (q, v) = ([0.7], [-1.3]);
        let mut out = [0.0; 10];
        assert!(d.partials(&p, &q, &v, &at, &mut out));
        let value = |p: &[f64], q: f64, v: f64| {
            let mut a = [0.0];
            assert!(d.acceleration(p, &[q], &[v], &at, &mut a));
            a[0]
        };
        let h = 1e-6;
        assert!((out[0] - (value(&p, q[0] + h, v[0]) - value(&p, q[0] - h, v[0])) / (2.0 * h)).abs() < 1e-7);
        assert!((out[1] - (value(&p, q[0], v[0] + h) - value(&p, q[0], v[0] - h)) / (2.0 * h)).abs() < 1e-7);
        for k in 0..8 {
            let (mut a, mut b) = (p, p);
            a[k] += h;
            b[k] -= h;
            assert!((out[2 + k] - (value(&a, q[0], v[0]) - value(&b, q[0], v[0])) / (2.0 * h)).abs() < 1e-7, "{k}");
        }
        // (2.1): θ″ = −c_r θ′ − sin θ/r² + f sin τ cos θ.
        let seed = [0.036, 0.0, 0.0, 0.0, -1.52, 0.0, 0.0, 1.44];
        let exact = 4.0 * (-0.036 * (v[0] / 2.0) - 1.44 * q[0].sin() + 1.52 * at.tau.sin() * q[0].cos());
        assert!((value(&seed, q[0], v[0]) - exact).abs() < 1e-12);
        assert_eq!(SinglePendulum::new(1.0, false, &["c_r"]).names(), ["c_r", "q_cos", "q_sin"]);
    }
}
