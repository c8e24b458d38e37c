//! A level of dry friction that is greater by δ in the positive direction: −δ for v > 0, 0 for v < 0. Beside Coulomb friction the same as a constant torque, apart from sticking.

use super::{Effect, JOINTS, joint_effect};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "asymmetric-friction",
    places: JOINTS,
    unit: "N m",
    equation: "−δ where v > 0: a level that differs with direction",
    signature: "residual present in one direction of motion only",
    confirm: "turn the joint by hand both ways with a torque gauge",
    variants: |c, place| joint_effect(c, place, |j| 0.5 * (1.0 + j.sign())),
};
