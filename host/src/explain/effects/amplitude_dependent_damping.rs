//! Damping that grows with the distance from rest, −c x² v (van der Pol 1926, with the other sign).

use super::{Effect, JOINTS, joint_effect};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "amplitude-dependent-damping",
    places: JOINTS,
    unit: "N m s/rad²",
    equation: "−c x² v",
    signature: "damping that grows away from the rest position",
    confirm: "compare decay rates at large and at small amplitude",
    variants: |c, place| joint_effect(c, place, |j| j.x * j.x * j.v),
};
