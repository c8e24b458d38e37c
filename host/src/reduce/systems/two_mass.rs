//! Two masses, the first on a spring with a cubic part (the seed's (5.9)): M = 1, V = x1² + x2² −
//! x1 x2 + x1⁴/4.

use super::{Mechanical, SystemKind, shipped};

/// Registration.
pub const KIND: SystemKind = SystemKind {
    id: "two-mass",
    about: "x1, x2: x1″ = −2x1 + x2 − x1³, x2″ = x1 − 2x2 (dimensionless); for `whirl reduce`",
    make: || Box::new(TwoMass),
    file: || shipped("two-masses"),
};

/// The system.
pub struct TwoMass;

impl Mechanical for TwoMass {
    fn coordinates(&self) -> Vec<String> {
        vec!["x1".into(), "x2".into()]
    }

    fn mass(&self, _x: &[f64]) -> Vec<f64> {
        vec![1.0, 0.0, 0.0, 1.0]
    }

    fn constant_mass(&self) -> bool {
        true
    }

    fn potential(&self, x: &[f64]) -> f64 {
        x[0] * x[0] + x[1] * x[1] - x[0] * x[1] + 0.25 * x[0].powi(4)
    }

    fn gradient(&self, x: &[f64]) -> Vec<f64> {
        vec![2.0 * x[0] - x[1] + x[0].powi(3), 2.0 * x[1] - x[0]]
    }

    fn acceleration(&self, x: &[f64], _v: &[f64], out: &mut [f64]) {
        out[0] = -2.0 * x[0] + x[1] - x[0].powi(3);
        out[1] = x[0] - 2.0 * x[1];
    }
}
