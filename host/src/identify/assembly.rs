//! Rows of the weak form's equations from the transforms of a window's series: ∫ w_m⁽ᵖ⁾ s dt for
//! every frequency m, see [`super::windows`].

use core::f64::consts::TAU;

use realfft::num_complex::Complex64;

use super::windows::row_count;
use crate::model::weak::{Equation, Order, Part};

/// Coefficients of sin⁴(πu) in e^{−2πiku}, k = 0, 1, 2 (and −1, −2).
const SIN4: [f64; 3] = [0.375, -0.25, 1.0 / 16.0];

/// What all windows of one length have in common.
pub struct Assembly {
    frequencies: usize,
    step_s: f64,
    /// 2π/L, rad/s.
    slope: f64,
    /// Series and order that some column needs, each once.
    pairs: Vec<(usize, Order)>,
    /// For each equation and column (the target last): sums of (pair, factor).
    equations: Vec<Vec<Vec<(usize, f64)>>>,
}

impl Assembly {
    /// For windows of `length` samples, `step_s` apart.
    pub fn new(equations: &[Equation], frequencies: usize, step_s: f64, length: usize) -> Self {
        let mut pairs: Vec<(usize, Order)> = Vec::new();
        let mut sum = |parts: &Vec<Part>| {
            parts
                .iter()
                .map(|part| {
                    let wanted = (part.series, part.order);
                    let place = pairs.iter().position(|p| *p == wanted).unwrap_or_else(|| {
                        pairs.push(wanted);
                        pairs.len() - 1
                    });
                    (place, part.factor)
                })
                .collect::<Vec<_>>()
        };
        let equations = equations
            .iter()
            .map(|e| e.terms.iter().map(|t| &t.parts).chain([&e.target]).map(&mut sum).collect())
            .collect();
        Self { frequencies, step_s, slope: TAU / (length as f64 * step_s), pairs, equations }
    }

    /// Rows of all equations from the bins of a window, series after series, each with M + 3 of
    /// them.
    pub fn rows(&self, bins: &[Complex64]) -> Vec<Vec<f64>> {
        let each = self.frequencies + 3;
        // Bins −2 … M + 2 of the derivative: a real series has S(−n) = conj S(n).
        let mut derived = vec![Complex64::default(); each + 2];
        let integrals: Vec<Vec<Complex64>> = self
            .pairs
            .iter()
            .map(|&(series, order)| {
                let bins = &bins[series * each..(series + 1) * each];
                for (n, (d, bin)) in derived[2..].iter_mut().zip(bins).enumerate() {
                    let omega = self.slope * n as f64;
                    *d = match order {
                        Order::Value => *bin,
                        // ∫ w ṡ = −∫ ẇ s and w_m holds e^{−2πimu}.
                        Order::First => Complex64::new(-omega * bin.im, omega * bin.re),
                        Order::Second => -omega * omega * bin,
                    };
                }
                (derived[0], derived[1]) = (derived[4].conj(), derived[3].conj());
                derived
                    .windows(5)
                    .map(|d| {
                        let sum = d[2] * SIN4[0] + (d[1] + d[3]) * SIN4[1] + (d[0] + d[4]) * SIN4[2];
                        sum * self.step_s
                    })
                    .collect()
            })
            .collect();
        self.equations
            .iter()
            .map(|columns| {
                let mut rows = vec![0.0; row_count(self.frequencies) * columns.len()];
                for (c, parts) in columns.iter().enumerate() {
                    for m in 0..=self.frequencies {
                        let z: Complex64 = parts.iter().map(|(pair, factor)| integrals[*pair][m] * *factor).sum();
                        if m == 0 {
                            rows[c] = z.re;
                        } else {
                            rows[(2 * m - 1) * columns.len() + c] = z.re;
                            rows[2 * m * columns.len() + c] = z.im;
                        }
                    }
                }
                rows
            })
            .collect()
    }
}
