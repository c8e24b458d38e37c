//! Which sign a coefficient must have so that its law takes energy away.
//!
//! F = Σ λ_j X_j − Y, and q̈_i's inertia in equation e is m = ∂F_e/∂q̈_i at rest. A law v, sign v, v|v| or x² v of coordinate i there opposes the motion
//! where its coefficient has the sign of m.

use super::candidates::{Candidate, dissipative};
use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::{Node, Symbol, multiple};

/// Sign of the inertia of a coordinate in an equation, for coefficients by name; 0 where there is none.
fn inertia(
    model: &ModelFile,
    omega: f64,
    coefficient: &dyn Fn(&str) -> f64,
    equation: usize,
    coordinate: usize,
) -> f64 {
    let by = |n: &Node| {
        model.in_seconds(n, omega).derivative(Symbol::Acceleration(coordinate)).map_or(0.0, |d| d.value(&|_| 0.0))
    };
    let e = &model.equations[equation];
    let m = e.terms.iter().map(|t| coefficient(&t.name) * by(&t.of)).sum::<f64>() - by(&e.balance);
    if m > 0.0 {
        1.0
    } else if m < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// Signs of laws at every coordinate in every equation.
pub struct Signs {
    /// By equation, then coordinate.
    inertia: Vec<Vec<f64>>,
}

impl Signs {
    /// For coefficients by name.
    pub fn new(model: &ModelFile, omega: f64, coefficient: &dyn Fn(&str) -> f64) -> Self {
        let inertia = (0..model.equations.len())
            .map(|e| (0..model.coordinates.len()).map(|i| inertia(model, omega, coefficient, e, i)).collect())
            .collect();
        Self { inertia }
    }

    /// Of an effect's strength; 0 where either sign will do.
    pub fn of_candidate(&self, model: &ModelFile, c: &Candidate) -> f64 {
        let coordinate = model.coordinates.iter().position(|x| x.name == c.at);
        match coordinate {
            Some(i) if c.effect.dissipates => self.inertia[c.equation][i],
            _ => 0.0,
        }
    }

    /// Of one of the model's own coefficients; 0 where either sign will do.
    pub fn of_term(&self, model: &ModelFile, omega: f64, name: &str) -> f64 {
        let mut found: Option<f64> = None;
        for (e, equation) in model.equations.iter().enumerate() {
            for t in equation.terms.iter().filter(|t| t.name == name) {
                let of = model.in_seconds(&t.of, omega);
                let sign = (0..model.coordinates.len()).find_map(|i| {
                    dissipative(i).iter().find_map(|law| multiple(&of, law)).map(|k| k.signum() * self.inertia[e][i])
                });
                match (sign, found) {
                    (None, _) => return 0.0,
                    (Some(s), Some(f)) if s != f => return 0.0,
                    _ => found = sign,
                }
            }
        }
        found.unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_follow_the_inertia() {
        let text = r#"name = "m"
coordinates = [{ name = "q", space = "R" }, { name = "p", space = "S1" }]
inputs = ["u"]
[[equation]]
balance = "u"
terms = { M = "q''", c = "q'", d = "-2*sign(q')", k = "q", s = "q' - p'" }
[[equation]]
balance = "-p''"
terms = { g = "sin(p)", e = "p'*abs(p')" }
"#;
        let model = ModelFile::parse(text, std::path::Path::new("m.toml")).unwrap();
        for (mass, expected) in [(3.0, 1.0), (-3.0, -1.0)] {
            let signs = Signs::new(&model, 1.0, &|n| if n == "M" { mass } else { 0.0 });
            assert_eq!(signs.of_term(&model, 1.0, "c"), expected);
            assert_eq!(signs.of_term(&model, 1.0, "d"), -expected);
            assert_eq!(signs.of_term(&model, 1.0, "k"), 0.0);
            assert_eq!(signs.of_term(&model, 1.0, "s"), 0.0);
            assert_eq!(signs.of_term(&model, 1.0, "e"), 1.0);
        }
    }
}
