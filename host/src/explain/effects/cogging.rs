//! Torque that repeats n times a turn, −A sin(n x + ψ): magnets against teeth, balls in a bearing, a brush on segments. Its order is
//! found among 1 … 60. Order 1 is left out at joint 1, where it is gravity.

use super::{Compose, Effect, JOINTS, Place, joint_torque, torque};

/// Highest order that is tried.
const ORDERS: u32 = 60;

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "cogging",
    places: JOINTS,
    unit: "N m",
    equation: "−A sin(n x + ψ)",
    signature: "residual periodic in the joint's angle",
    confirm: "turn the joint by hand: it prefers n positions; or spin it and look for n lines a turn",
    variants: |c, place| {
        let least = if place == Place::Joint1 { 2 } else { 1 };
        (least..=ORDERS)
            .map(|n| {
                let n = f64::from(n);
                let sin = joint_torque(c, place, move |j| (n * j.x).sin());
                let cos = joint_torque(c, place, move |j| (n * j.x).cos());
                torque(vec![sin, cos], vec![("n", n)], Compose::AmplitudePhase("psi"))
            })
            .collect()
    },
};
