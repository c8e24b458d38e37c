//! Play between two springs, a dead zone of half width b: −k (x − b) for x > b, −k (x + b) for x < −b, 0 between (Nordin and Gutman 2002).
//! The value is b; k goes into the parameters. b is found on a grid, then refined with ∂/∂b.

use super::{Compose, Context, Effect, JOINTS, Joint, Place, Variant, joint_torque, torque};

/// Half widths b that are tried, rad.
const HALF_WIDTHS: [f64; 12] = [0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.35, 1.75, 2.2, 2.7];

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "backlash",
    places: JOINTS,
    unit: "rad",
    equation: "−k (x − b) for x > b, −k (x + b) for x < −b, 0 between",
    signature: "residual flat in the middle of the joint's travel, straight beyond two corners",
    confirm: "rock the joint by hand: it moves freely over 2b and then meets a spring",
    variants: |c, place| {
        HALF_WIDTHS
            .iter()
            .map(|&b| {
                let column = joint_torque(c, place, move |j| spring(j, b));
                torque(vec![column], vec![("b", b)], Compose::Shape { torque: "k" }).refined_by(refine)
            })
            .collect()
    },
};

/// The spring beyond the dead zone.
fn spring(j: Joint, b: f64) -> f64 {
    j.odd(|x| (x.abs() - b).max(0.0) * x.signum(), |x| 0.5 * (x.abs() - b).max(0.0).powi(2))
}

fn refine(c: &Context, place: Place, b: f64) -> Variant {
    let b = b.clamp(1e-3, 3.0);
    let dead = joint_torque(c, place, move |j| spring(j, b));
    let change = joint_torque(c, place, move |j| {
        j.odd(|x| if x.abs() > b { -x.signum() } else { 0.0 }, |x| -(x.abs() - b).max(0.0))
    });
    torque(vec![dead, change], vec![("b", b)], Compose::Shape { torque: "k" }).refined_by(refine)
}
