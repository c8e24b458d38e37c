//! The single pendulum on a base driven horizontally or vertically, or at rest, in the form (2.6), (2.19):
//!
//! θ″ + c_r θ′ + C11 sign θ′ + Σ_k (q_cos,k cos kθ + q_sin,k sin kθ) + Σ_k (n_cos,k cos kθ + n_sin,k sin kθ) cos τ
//! + Σ_k (p_cos,k cos kθ + p_sin,k sin kθ) sin τ = 0,
//!
//! τ = Ω t (Ω = 1 rad/s for a free system). A horizontal drive x_b = a sin(τ − ψ) puts f = m e a/J into p_cos = −f cos ψ and
//! n_cos = f sin ψ, a vertical one into p_sin and n_sin, gravity into q_sin = 1/r². The names of order k = 1 have no number.
//!
//! The angle enters cos kθ and sin kθ as it was measured: they are bounded, so that the window alone keeps noise in check,
//! and what noise takes from them on average is known ([`WeakModel::attenuation`]).

use super::weak::{Equation, Order, Sample, Term, WeakModel, mean_sign};

/// The dampings that a nominal model may have: id, and the coefficient's name.
pub const DAMPINGS: &[(&str, &str)] = &[("viscous-friction@joint1", "c_r"), ("coulomb-friction@joint1", "C11")];

/// The single pendulum's default nominal damping.
pub const DEFAULT_DAMPINGS: &[&str] = &["viscous-friction@joint1"];

/// Name of a coefficient: function `n`, `p` or `q`, `cos` or `sin`, order k.
pub fn name(function: &str, shape: &str, order: usize) -> String {
    if order == 1 { format!("{function}_{shape}") } else { format!("{function}_{shape}{order}") }
}

fn angle(s: &Sample) -> f64 {
    s.raw[0]
}

fn sign(s: &Sample) -> f64 {
    mean_sign(s.clear_rate[0], s.clear_step[0])
}

/// The weak model with harmonics up to `orders`, at angular frequency `omega` (rad/s; 1 for a free system, `driven` false then).
/// `dampings`: coefficient names of [`DAMPINGS`].
pub fn weak_model(omega: f64, driven: bool, dampings: &[&str], orders: usize) -> WeakModel {
    let mut m = WeakModel::default();
    m.name = "single-pendulum".to_owned();
    let target = vec![m.part("phi1", angle, Order::Second, -1.0 / (omega * omega))];
    let mut terms = Vec::new();
    for damping in dampings {
        let (part, free) = if *damping == "c_r" {
            (m.part("phi1", angle, Order::First, 1.0 / omega), "s⁻¹")
        } else {
            (m.part("sign joint1", sign, Order::Value, 1.0), "s⁻²")
        };
        terms.push(Term { name: (*damping).to_owned(), unit: if driven { "1" } else { free }, parts: vec![part] });
    }
    let unit = if driven { "1" } else { "s⁻²" };
    for function in ["n", "p", "q"] {
        if !driven && function != "q" {
            continue;
        }
        for k in 1..=orders {
            for shape in ["cos", "sin"] {
                let drive = |s: &Sample, function: &str| match function {
                    "n" => s.cos_tau,
                    "p" => s.sin_tau,
                    _ => 1.0,
                };
                let series = move |s: &Sample| {
                    let (sin, cos) = (k as f64 * s.raw[0]).sin_cos();
                    drive(s, function) * if shape == "cos" { cos } else { sin }
                };
                let name = name(function, shape, k);
                let part = m.part(&name, series, Order::Value, 1.0);
                m.attenuation.push((name.clone(), k as f64));
                terms.push(Term { name, unit, parts: vec![part] });
            }
        }
    }
    m.equations.push(Equation { terms, target });
    m
}

#[cfg(test)]
mod tests {
    use super::super::weak::Block;
    use super::*;

    /// The equation's terms at a state, by hand.
    #[test]
    fn series_are_the_equations_terms() {
        let m = weak_model(2.0, true, &["c_r", "C11"], 2);
        let names: Vec<&str> = m.equations[0].terms.iter().map(|t| t.name.as_str()).collect();
        assert_eq!(names[..6], ["c_r", "C11", "n_cos", "n_sin", "n_cos2", "n_sin2"]);
        assert_eq!(names.len(), 14);
        let s = Sample { raw: [0.7, 0.0], cos_tau: 0.6, sin_tau: 0.8, clear_rate: [-3.0, 0.0], ..Sample::default() };
        let value = |name: &str| {
            let t = m.equations[0].terms.iter().find(|t| t.name == name).unwrap();
            let mut out = [0.0];
            m.series[t.parts[0].series].evaluate(&Block::of_samples(&[s]), &mut out);
            out[0]
        };
        assert!((value("p_sin2") - 0.8 * 1.4_f64.sin()).abs() < 1e-15);
        assert!((value("n_cos") - 0.6 * 0.7_f64.cos()).abs() < 1e-15);
        assert!((value("q_sin") - 0.7_f64.sin()).abs() < 1e-15);
        assert_eq!(value("C11"), -1.0);
        assert_eq!(weak_model(1.0, false, &["c_r"], 1).equations[0].terms.len(), 3);
    }
}
