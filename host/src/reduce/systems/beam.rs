//! A clamped beam that stretches, w⁗ + ẅ − ½ (∫w′²) w″ = 0, in the amplitudes of its first eight
//! linear modes; time such that the first linear frequency is 1, deflections in √(I/A).
//!
//! The modes by collocation of the exact clamped–clamped shapes; G_ij = ∫ψ_i′ψ_j′ in closed form
//! (J. F. Felgar, *Formulas for integrals containing characteristic functions of a vibrating beam*,
//! 1950): for i ≠ j of one parity ∫ψ_i′ψ_j′ = 4 β_i² β_j² (σ_iβ_i − σ_jβ_j)·((−1)^{i+j} +
//! 1)/(β_j⁴ − β_i⁴), and ∫ψ_i′² = σ_iβ_i (σ_iβ_i − 2).

use super::{Mechanical, SystemKind};

/// Registration.
pub const KIND: SystemKind = SystemKind {
    id: "clamped-beam",
    about: "q1 … q8, amplitudes of the linear modes (unit mean square, in √(I/A)): w⁗ + w″ₜ − ½ (∫w′²) w″ = 0, ω1 = 1; for `whirl reduce`",
    make: || Box::new(Beam::default()),
    file: || Beam::default().file(),
};

const MODES: usize = 8;

/// The system.
pub struct Beam {
    stiffness: [f64; MODES],
    stretch: [[f64; MODES]; MODES],
}

impl Default for Beam {
    fn default() -> Self {
        // cos z cosh z = 1 by fixed-point iteration z = (k + ½)π − (−1)^k asin(1/cosh z)… which
        // contracts fast.
        let mut beta = [0.0; MODES];
        for (k, b) in beta.iter_mut().enumerate() {
            let centre = (k as f64 + 1.5) * std::f64::consts::PI;
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            let mut z = centre;
            for _ in 0..60 {
                z = centre + sign * (1.0 / z.cosh()).asin();
            }
            *b = z;
        }
        let sigma = beta.map(|b| (b.cosh() - b.cos()) / (b.sinh() - b.sin()));
        let scale = beta[0] * beta[0];
        let mut stretch = [[0.0; MODES]; MODES];
        for i in 0..MODES {
            for j in 0..MODES {
                let g = if i == j {
                    sigma[i] * beta[i] * (sigma[i] * beta[i] - 2.0)
                } else if (i + j) % 2 == 0 {
                    8.0 * (beta[i] * beta[j]).powi(2) * (sigma[i] * beta[i] - sigma[j] * beta[j])
                        / (beta[j].powi(4) - beta[i].powi(4))
                } else {
                    0.0
                };
                stretch[i][j] = g / scale;
            }
        }
        Self { stiffness: beta.map(|b| (b / beta[0]).powi(4)), stretch }
    }
}

impl Beam {
    fn pull(&self, q: &[f64]) -> ([f64; MODES], f64) {
        let pull: [f64; MODES] = std::array::from_fn(|i| q.iter().zip(&self.stretch[i]).map(|(q, g)| q * g).sum());
        let square = q.iter().zip(&pull).map(|(q, p)| q * p).sum();
        (pull, square)
    }

    /// As a system file.
    fn file(&self) -> String {
        let stiffness: Vec<String> =
            self.stiffness.iter().enumerate().map(|(i, k)| format!("{k:.6}*q{}^2", i + 1)).collect();
        let mut stretch = Vec::new();
        for i in 0..MODES {
            // G is symmetric: what stands above its diagonal counts twice.
            for j in (i..MODES).filter(|&j| self.stretch[i][j] != 0.0) {
                let twice = if i == j { 1.0 } else { 2.0 };
                stretch.push(format!("({:.6})*q{}*q{}", twice * self.stretch[i][j], i + 1, j + 1));
            }
        }
        let coordinates: Vec<String> = (1..=MODES).map(|i| format!("q{i} = \"1\"")).collect();
        let squares: Vec<String> = (1..=MODES).map(|i| format!("q{i}'^2")).collect();
        format!(
            "# A clamped beam that stretches, in the amplitudes of its linear modes.\n\
             # `whirl reduce` takes m = 1, k = 1, s = 1 (dimensionless).\n\
             name = \"clamped beam\"\n\
             coordinates = {{ {} }}\n\
             parameters = {{ m = \"1\", k = \"1\", s = \"1\" }}\n\
             kinetic = \"m/2*({})\"\n\
             potential = \"k/2*({}) + s/8*({})^2\"\n",
            coordinates.join(", "),
            squares.join(" + "),
            stiffness.join(" + "),
            stretch.join(" + ")
        )
    }

    /// Deflection at the centre, where the odd modes are zero, for the amplitudes q.
    pub fn centre(q: &[f64]) -> f64 {
        // ψ(½) of the symmetric modes, from the clamped shape cosh − cos − σ (sinh − sin) halfway.
        let beam = Self::default();
        q.iter()
            .enumerate()
            .map(|(k, q)| {
                let b = beam.stiffness[k].sqrt().sqrt() * 4.730_040_744_862_704;
                let z = 0.5 * b;
                let sigma = (b.cosh() - b.cos()) / (b.sinh() - b.sin());
                q * ((-z).exp() + (1.0 - sigma) * z.sinh() - z.cos() + sigma * z.sin())
            })
            .sum()
    }
}

impl Mechanical for Beam {
    fn coordinates(&self) -> Vec<String> {
        (1..=MODES).map(|i| format!("q{i}")).collect()
    }

    fn mass(&self, _x: &[f64]) -> Vec<f64> {
        (0..MODES * MODES).map(|i| if i % (MODES + 1) == 0 { 1.0 } else { 0.0 }).collect()
    }

    fn constant_mass(&self) -> bool {
        true
    }

    fn potential(&self, q: &[f64]) -> f64 {
        let (_, square) = self.pull(q);
        0.5 * q.iter().zip(&self.stiffness).map(|(q, k)| k * q * q).sum::<f64>() + 0.125 * square * square
    }

    fn gradient(&self, q: &[f64]) -> Vec<f64> {
        let (pull, square) = self.pull(q);
        (0..q.len()).map(|i| self.stiffness[i] * q[i] + 0.5 * square * pull[i]).collect()
    }

    fn acceleration(&self, q: &[f64], _v: &[f64], out: &mut [f64]) {
        for (o, g) in out.iter_mut().zip(self.gradient(q)) {
            *o = -g;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_modes_stretching_is_the_published_one() {
        // ∫ψ1′² = 12.3026, βL = 4.7300 for the clamped beam; ψ1(½) = 1.5882.
        let beam = Beam::default();
        let beta = 4.730_040_744_862_704_f64;
        assert!((beam.stretch[0][0] * beta * beta - 12.3026).abs() < 1e-3, "{}", beam.stretch[0][0] * beta * beta);
        assert!((Beam::centre(&[1.0, 0.0, 0.0]) - 1.5882).abs() < 1e-3);
    }
}
