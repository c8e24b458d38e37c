//! Accelerations from a model file: Σ_j λ_j X_j = Y is linear in the accelerations, M(λ, q, …) q̈ = r, and is solved for them.
//!
//! M_ei = Σ_j λ_j ∂X_j/∂q̈_i − ∂Y/∂q̈_i and r_e = Y₀ − Σ_j λ_j X_j₀, where X₀ is X without accelerations. LU with partial pivoting;
//! a pivot below 1e-12 of the row's size counts as singular.

use core::cell::RefCell;

use super::expression::{Node, Symbol, as_number, number, symbol};
use super::tape::Tape;
use super::{ModelFile, Space};
use crate::error::Result;
use crate::model::dynamics::{Dynamics, Instant};

/// Where a tape's output goes.
#[derive(Clone, Copy, Debug)]
struct Entry {
    equation: usize,
    /// Index of the coefficient; none for the balance.
    coefficient: Option<usize>,
    /// Acceleration that it multiplies; none for the rest.
    acceleration: Option<usize>,
}

/// A model file that can be integrated.
#[derive(Clone, Debug)]
pub struct EquationsOfMotion {
    coefficients: Vec<String>,
    circle: Vec<bool>,
    tape: Tape,
    entries: Vec<Entry>,
}

thread_local! {
    /// Registers, outputs, values, matrix with its right-hand side.
    static SCRATCH: RefCell<[Vec<f64>; 4]> = const { RefCell::new([Vec::new(), Vec::new(), Vec::new(), Vec::new()]) };
}

impl EquationsOfMotion {
    /// Compiles a model file for a drive of angular frequency `omega` (rad/s; 1 without one).
    ///
    /// # Errors
    /// A number of equations that differs from that of the coordinates.
    pub fn new(model: &ModelFile, omega: f64) -> Result<Self> {
        let n = model.coordinates.len();
        if model.equations.len() != n {
            return Err(model
                .bad(format!("{} equations for {n} coordinates", model.equations.len()), "as many equations as coordinates")
                .at("equation")
                .remedy("A simulation needs one equation for each coordinate"));
        }
        let coefficients = model.coefficients();
        let (mut entries, mut nodes): (Vec<Entry>, Vec<Node>) = (Vec::new(), Vec::new());
        let mut put = |equation: usize, coefficient: Option<usize>, e: &Node| {
            let e = model.in_seconds(e, omega);
            for i in 0..n {
                // Terms are linear in accelerations: a file with others is refused.
                if let Some(d) = e.derivative(Symbol::Acceleration(i))
                    && as_number(&d) != Some(0.0)
                {
                    entries.push(Entry { equation, coefficient, acceleration: Some(i) });
                    nodes.push(d);
                }
            }
            let rest = e.replace(&|s| if matches!(s, Symbol::Acceleration(_)) { number(0.0) } else { symbol(s) });
            if as_number(&rest) != Some(0.0) {
                entries.push(Entry { equation, coefficient, acceleration: None });
                nodes.push(rest);
            }
        };
        for (e, equation) in model.equations.iter().enumerate() {
            put(e, None, &equation.balance);
            for term in &equation.terms {
                let index = coefficients.iter().position(|c| *c == term.name);
                put(e, index, &term.of);
            }
        }
        let circle = model.coordinates.iter().map(|c| c.space == Space::Circle).collect();
        Ok(Self { coefficients, circle, tape: Tape::new(&nodes), entries })
    }

    /// Names of the parameters, in the order of [`Dynamics::acceleration`]'s `parameters`.
    pub fn coefficients(&self) -> &[String] {
        &self.coefficients
    }
}

impl Dynamics for EquationsOfMotion {
    fn degrees_of_freedom(&self) -> usize {
        self.circle.len()
    }

    fn parameter_count(&self) -> usize {
        self.coefficients.len()
    }

    fn acceleration(&self, parameters: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, out: &mut [f64]) -> bool {
        let n = self.circle.len();
        SCRATCH.with_borrow_mut(|[registers, outputs, values, matrix]| {
            values.clear();
            values.extend(self.tape.symbols().iter().map(|s| match *s {
                Symbol::Coordinate(i) if self.circle[i] => wrapped(q[i]),
                Symbol::Coordinate(i) | Symbol::Raw(i) => q[i],
                Symbol::Rate(i) | Symbol::ClearRate(i) => v[i],
                Symbol::Input(k) | Symbol::RawInput(k) => at.inputs.get(k).copied().unwrap_or(0.0),
                Symbol::Tau => at.tau,
                Symbol::Acceleration(_) | Symbol::InputRate(_) => 0.0,
            }));
            outputs.clear();
            outputs.resize(self.entries.len(), 0.0);
            self.tape.at(values, registers, outputs);
            matrix.clear();
            matrix.resize(n * (n + 1), 0.0);
            for (entry, x) in self.entries.iter().zip(outputs.iter()) {
                // X on the left, Y on the right; the rest of X goes to the right.
                let x = entry.coefficient.map_or(-*x, |c| parameters[c] * x);
                match entry.acceleration {
                    Some(i) => matrix[entry.equation * (n + 1) + i] += x,
                    None => matrix[entry.equation * (n + 1) + n] -= x,
                }
            }
            solve(matrix, n, out)
        })
    }
}

/// An angle wrapped to [−π, π).
pub fn wrapped(x: f64) -> f64 {
    let tau = core::f64::consts::TAU;
    x - tau * (x / tau + 0.5).floor()
}

/// Solves an n × n system with its right-hand side in column n; false where it is singular or not finite.
fn solve(a: &mut [f64], n: usize, out: &mut [f64]) -> bool {
    let w = n + 1;
    let size = a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if !a.iter().all(|x| x.is_finite()) || size == 0.0 {
        return false;
    }
    for k in 0..n {
        let row_size = (0..n).map(|j| a[k * w + j].abs()).fold(0.0, f64::max);
        let pivot = (k..n).max_by(|&i, &j| a[i * w + k].abs().total_cmp(&a[j * w + k].abs())).unwrap_or(k);
        if a[pivot * w + k].abs() <= 1e-12 * row_size || a[pivot * w + k] == 0.0 {
            return false;
        }
        if pivot != k {
            (0..w).for_each(|j| a.swap(k * w + j, pivot * w + j));
        }
        for i in k + 1..n {
            let f = a[i * w + k] / a[k * w + k];
            if f != 0.0 {
                (k..w).for_each(|j| a[i * w + j] -= f * a[k * w + j]);
            }
        }
    }
    for k in (0..n).rev() {
        let sum: f64 = (k + 1..n).map(|j| a[k * w + j] * out[j]).sum();
        out[k] = (a[k * w + n] - sum) / a[k * w + k];
    }
    out[..n].iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// The double pendulum's accelerations satisfy its equations, coefficient by coefficient.
    #[test]
    fn accelerations_satisfy_the_equations() {
        let text = r#"
name = "double pendulum"
coordinates = [{ name = "p", space = "S1" }, { name = "q", space = "S1" }]
inputs = ["u"]
[[equation]]
balance = "u - p''"
terms = { B1 = "q''*cos(q - p) - q'^2*sin(q - p)", B2 = "sin(p)", C = "p' - q'" }
[[equation]]
balance = "-q''"
terms = { B3 = "p''*cos(q - p) + p'^2*sin(q - p)", B4 = "sin(q)*cos(tau)", D = "q' - p'" }
"#;
        let model = ModelFile::parse(text, Path::new("m.toml")).unwrap();
        let motion = EquationsOfMotion::new(&model, 3.0).unwrap();
        assert_eq!(motion.coefficients(), ["B1", "B2", "C", "B3", "B4", "D"]);
        let p = [0.12, 40.0, 0.3, 1.6, 90.0, 0.5];
        let (q, v) = ([0.7, 7.1], [2.0, -3.0]);
        let at = Instant { time: 0.0, tau: 0.4, inputs: &[5.0] };
        let mut a = [0.0; 2];
        assert!(motion.acceleration(&p, &q, &v, &at, &mut a));
        // Primes are by τ = 3 t.
        let (v, a) = (v.map(|x| x / 3.0), a.map(|x| x / 9.0));
        let d = q[1] - q[0];
        let e1 = p[0] * (a[1] * d.cos() - v[1] * v[1] * d.sin()) + p[1] * q[0].sin() + p[2] * (v[0] - v[1]) - 5.0 + a[0];
        let e2 = p[3] * (a[0] * d.cos() + v[0] * v[0] * d.sin())
            + p[4] * q[1].sin() * 0.4_f64.cos()
            + p[5] * (v[1] - v[0])
            + a[1];
        assert!(e1.abs() < 1e-12 && e2.abs() < 1e-12, "{e1:e} {e2:e}");
        assert!(!motion.acceleration(&[f64::NAN; 6], &q, &v, &at, &mut [0.0; 2]));
    }
}
