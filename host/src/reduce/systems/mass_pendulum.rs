//! A block on a spring that carries a pendulum (the seed's (5.18)), x in lengths of the bar,
//! energies in m2 l²: ẍ + b11 x + b12 (θ̈ cos θ − θ̇² sin θ) = 0, θ̈ + b21 sin θ + b22 ẍ cos θ = 0.
//! With the first equation times b22/b12 the mass matrix [[b22/b12, b22 cos θ], [b22 cos θ, 1]] is
//! symmetric and V = ½ (b22/b12) b11 x² + b21 (1 − cos θ).

use super::{Mechanical, SystemKind, shipped};

/// Registration.
pub const KIND: SystemKind = SystemKind {
    id: "mass-pendulum",
    about: "x (in bar lengths), theta: x″ + 500 x + ½ (θ″ cos θ − θ′² sin θ) = 0, θ″ + 245.25 sin θ + x″ cos θ = 0 (1/s²); for `whirl reduce`",
    make: || Box::new(MassPendulum::default()),
    file: || shipped("mass-and-pendulum"),
};

/// The system.
pub struct MassPendulum {
    /// k/(m1 + m2), s⁻².
    pub b11: f64,
    /// m2 e/((m1 + m2) l).
    pub b12: f64,
    /// m2 g e/J_o2, s⁻².
    pub b21: f64,
    /// m2 e l/J_o2.
    pub b22: f64,
}

impl Default for MassPendulum {
    /// Table 5.2: m1 = m2 = 0.1 kg, k = 100 N/m, l = e = 0.04 m.
    fn default() -> Self {
        Self { b11: 500.0, b12: 0.5, b21: 245.25, b22: 1.0 }
    }
}

impl Mechanical for MassPendulum {
    fn coordinates(&self) -> Vec<String> {
        vec!["x".into(), "theta".into()]
    }

    fn mass(&self, x: &[f64]) -> Vec<f64> {
        let c = self.b22 * x[1].cos();
        vec![self.b22 / self.b12, c, c, 1.0]
    }

    fn potential(&self, x: &[f64]) -> f64 {
        0.5 * self.b22 / self.b12 * self.b11 * x[0] * x[0] + self.b21 * (1.0 - x[1].cos())
    }

    fn gradient(&self, x: &[f64]) -> Vec<f64> {
        vec![self.b22 / self.b12 * self.b11 * x[0], self.b21 * x[1].sin()]
    }

    fn acceleration(&self, x: &[f64], v: &[f64], out: &mut [f64]) {
        let (s, c) = x[1].sin_cos();
        // The linear system [[1, b12 c], [b22 c, 1]] (ẍ, θ̈).
        let (p, q) = (self.b12 * v[1] * v[1] * s - self.b11 * x[0], -self.b21 * s);
        let determinant = 1.0 - self.b12 * self.b22 * c * c;
        out[0] = (p - self.b12 * c * q) / determinant;
        out[1] = (q - self.b22 * c * p) / determinant;
    }
}
