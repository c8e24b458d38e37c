//! A constant torque on a joint, +Q: a taut cable, a leaning bearing.

use super::{Effect, JOINTS, joint_effect};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "constant-force",
    places: JOINTS,
    unit: "N m",
    equation: "+Q",
    signature: "residual with a mean that depends on nothing",
    confirm: "find the rest position with the frame turned by half a turn",
    // It drives, where other torques oppose.
    variants: |c, place| joint_effect(c, place, |_| -1.0),
};
