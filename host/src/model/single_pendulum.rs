//! The single pendulum on a base driven horizontally or vertically, or at rest, in the form (2.6),
//! (2.19):
//!
//! θ″ + c_r θ′ + C11 sign θ′ + Σ_k (q_cos,k cos kθ + q_sin,k sin kθ)
//! + Σ_k (n_cos,k cos kθ + n_sin,k sin kθ) cos τ
//! + Σ_k (p_cos,k cos kθ + p_sin,k sin kθ) sin τ = 0,
//!
//! τ = Ω t (Ω = 1 rad/s for a free system). A horizontal drive x_b = a sin(τ − ψ) puts f = m e a/J
//! into p_cos = −f cos ψ and n_cos = f sin ψ, a vertical one into p_sin and n_sin, gravity into
//! q_sin = 1/r². The names of order k = 1 have no number.

use super::damping::Damping;

/// The dampings that a nominal model may have.
pub const DAMPINGS: &[Damping] = &[
    Damping { id: "viscous-friction@joint1", names: [Some("c_r"), None], viscous: true },
    Damping { id: "coulomb-friction@joint1", names: [Some("C11"), None], viscous: false },
];

/// The single pendulum's default nominal damping.
pub const DEFAULT_DAMPINGS: &[&str] = &["viscous-friction@joint1"];

/// Name of a coefficient: function `n`, `p` or `q`, `cos` or `sin`, order k.
pub fn name(function: &str, shape: &str, order: usize) -> String {
    if order == 1 { format!("{function}_{shape}") } else { format!("{function}_{shape}{order}") }
}
