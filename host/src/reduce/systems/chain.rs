//! Sixty unit masses between fixed ends, ground springs 0.3 x + x³, neighbours coupled such that
//! the first linear frequency is 1.

use std::f64::consts::PI;

use super::{Mechanical, SystemKind};

/// Registration.
pub const KIND: SystemKind = SystemKind {
    id: "chain",
    about: "x1 … x60: x_i″ = −0.3 x_i − x_i³ + 263.97 (x_{i−1} − 2x_i + x_{i+1}), ends fixed (dimensionless); for `whirl reduce`",
    make: || Box::new(Chain::default()),
    file: || Chain::default().file(),
};

/// The system.
pub struct Chain {
    masses: usize,
    ground: f64,
    cubic: f64,
    coupling: f64,
}

impl Default for Chain {
    fn default() -> Self {
        let masses = 60;
        let (ground, cubic) = (0.3, 1.0);
        // ω1² = ground + 2 κ (1 − cos(π/(n+1))) = 1.
        let coupling = (1.0 - ground) / (2.0 - 2.0 * (PI / (masses + 1) as f64).cos());
        Self { masses, ground, cubic, coupling }
    }
}

impl Chain {
    /// As a system file.
    fn file(&self) -> String {
        let n = self.masses;
        let sum = |term: &dyn Fn(usize) -> String| (1..=n).map(term).collect::<Vec<_>>().join(" + ");
        let neighbours = |i: usize| if i == 1 { "x1^2".to_owned() } else { format!("(x{i} - x{})^2", i - 1) };
        format!(
            "# Masses in a row between fixed ends, springs to the ground and between neighbours.\n\
             # `whirl reduce` takes m = 1, k = {}, n = {}, c = {:.2} (dimensionless).\n\
             name = \"chain\"\n\
             coordinates = {{ {} }}\n\
             parameters = {{ m = \"1\", k = \"1\", n = \"1\", c = \"1\" }}\n\
             kinetic = \"m/2*({})\"\n\
             potential = \"k/2*({}) + n/4*({}) + c/2*({} + x{n}^2)\"\n",
            self.ground,
            self.cubic,
            self.coupling,
            (1..=n).map(|i| format!("x{i} = \"1\"")).collect::<Vec<_>>().join(", "),
            sum(&|i| format!("x{i}'^2")),
            sum(&|i| format!("x{i}^2")),
            sum(&|i| format!("x{i}^4")),
            sum(&neighbours)
        )
    }
}

impl Mechanical for Chain {
    fn coordinates(&self) -> Vec<String> {
        (1..=self.masses).map(|i| format!("x{i}")).collect()
    }

    fn size(&self) -> usize {
        self.masses
    }

    fn mass(&self, _x: &[f64]) -> Vec<f64> {
        let n = self.masses;
        (0..n * n).map(|i| if i % (n + 1) == 0 { 1.0 } else { 0.0 }).collect()
    }

    fn constant_mass(&self) -> bool {
        true
    }

    fn potential(&self, x: &[f64]) -> f64 {
        let springs: f64 = x.iter().map(|x| x * x * (0.5 * self.ground + 0.25 * self.cubic * x * x)).sum();
        let ends = x.first().map_or(0.0, |x| x * x) + x.last().map_or(0.0, |x| x * x);
        springs + 0.5 * self.coupling * (x.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum::<f64>() + ends)
    }

    fn gradient(&self, x: &[f64]) -> Vec<f64> {
        let mut g = vec![0.0; x.len()];
        self.acceleration(x, &[], &mut g);
        g.iter().map(|a| -a).collect()
    }

    fn energy(&self, x: &[f64], v: &[f64]) -> f64 {
        0.5 * v.iter().map(|v| v * v).sum::<f64>() + self.potential(x)
    }

    fn acceleration(&self, x: &[f64], _v: &[f64], out: &mut [f64]) {
        let n = x.len();
        for i in 0..n {
            let left = if i > 0 { x[i - 1] } else { 0.0 };
            let right = if i + 1 < n { x[i + 1] } else { 0.0 };
            out[i] = self.coupling * (left + right - 2.0 * x[i]) - x[i] * (self.ground + self.cubic * x[i] * x[i]);
        }
    }
}
