//! Viscous friction of a bearing, −c v (Petroff 1883): grease and seals.

use super::{Effect, JOINTS, joint_effect};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "viscous-friction",
    places: JOINTS,
    unit: "N m s",
    equation: "−c v",
    signature: "residual proportional to the joint's velocity",
    confirm: "let the arm swing freely: amplitudes decay exponentially",
    variants: |c, place| joint_effect(c, place, |j| j.v),
};
