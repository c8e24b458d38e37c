//! Dry friction of constant level, −τ sign v (Coulomb 1785).

use super::{Effect, JOINTS, joint_effect};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "coulomb-friction",
    places: JOINTS,
    unit: "N m",
    equation: "−τ sign v",
    signature: "residual of constant size that jumps with the sign of the velocity",
    confirm: "let the arm swing freely: amplitudes decay linearly and stop at once",
    variants: |c, place| joint_effect(c, place, |j| j.sign()),
};
