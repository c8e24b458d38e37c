//! Equations of motion in the form that identification uses: linear in their unknown coefficients.

pub mod damping;
pub mod double_pendulum;
pub mod double_pendulum_dynamics;
pub mod dynamics;
pub mod flow;
pub mod identified;
pub mod integrate;
pub mod model_file;
pub mod parameter;
pub mod refused;
pub mod single_pendulum;
mod tableau;
pub mod vectors;
pub mod weak;

use crate::system::library::Pendulum;

/// Built-in models: id, and what it is with its equations.
pub const MODELS: &[(&str, &str)] = &[
    SINGLE_PENDULUM,
    (
        Pendulum::Double.id(),
        "vertically driven or free; θ1, θ2 (or φ1, φ2) rad: φ1″ + B11 (φ2″ cos Δ − φ2′² sin Δ) + (B12 + B13 cos τ + B14 sin τ) sin φ1 \
     + C11 sign φ1′ − C12 (φ2′ − φ1′) = 0, φ2″ + B21 (φ1″ cos Δ + φ1′² sin Δ) + (B22 + B23 cos τ + B24 sin τ) sin φ2 + C2 (φ2′ − φ1′) = 0",
    ),
];

const SINGLE_PENDULUM: (&str, &str) = (
    Pendulum::Single.id(),
    "horizontally or vertically driven, or free; θ1 (or φ1) rad: θ″ + c_r θ′ + q_cos cos θ + q_sin sin θ + (n_cos cos θ + n_sin sin θ) cos τ \
     + (p_cos cos θ + p_sin sin θ) sin τ = 0",
);
