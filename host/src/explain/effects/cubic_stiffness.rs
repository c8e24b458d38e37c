//! A hardening or softening spring on the wrapped angle, −k x³ (Duffing 1918).

use super::{Effect, JOINTS, joint_effect};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "cubic-stiffness",
    places: JOINTS,
    unit: "N m/rad³",
    equation: "−k x³",
    signature: "residual that grows with the cube of the joint's angle",
    confirm: "measure static torques at large angles, or the frequency against amplitude",
    variants: |c, place| joint_effect(c, place, |j| j.odd(|x| x.powi(3), |x| 0.25 * x.powi(4))),
};
