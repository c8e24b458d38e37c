//! A linear spring on the wrapped angle, −k x: a cable, a slip ring's brush, a return spring.

use super::{Effect, JOINTS, joint_effect};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "torsion-spring",
    places: JOINTS,
    unit: "N m/rad",
    equation: "−k x",
    signature: "residual proportional to the joint's angle",
    confirm: "hang the arm at several angles from a torque gauge: a cable or spring pulls back",
    variants: |c, place| joint_effect(c, place, |j| j.odd(|x| x, |x| 0.5 * x * x)),
};
