//! A stiffness that is even in the wrapped angle, −k x².

use super::{Effect, JOINTS, joint_effect};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "quadratic-stiffness",
    places: JOINTS,
    unit: "N m/rad²",
    equation: "−k x²",
    signature: "residual even in the joint's angle",
    confirm: "compare static torques at x and −x",
    variants: |c, place| joint_effect(c, place, |j| j.x * j.x),
};
