//! Friction that falls with speed, −τ_s exp(−(v/v_s)²) sign v on top of a Coulomb level (Stribeck 1902; Armstrong-Hélouvry,
//! Dupont and Canudas de Wit 1994). v_s is found on a grid of a factor √3, then refined with ∂/∂v_s.

use super::{Compose, Context, Effect, JOINTS, Place, Variant, joint_torque, torque};

/// Velocities v_s that are tried, rad/s.
const VELOCITIES: [f64; 9] = [0.2, 0.35, 0.6, 1.0, 1.7, 3.0, 5.2, 9.0, 15.0];

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "stribeck-friction",
    places: JOINTS,
    unit: "N m",
    equation: "−τ_s exp(−(v/v_s)²) sign v",
    signature: "residual near reversals only",
    confirm: "turn the joint slowly at several constant speeds with a torque gauge: friction falls with speed",
    variants: |c, place| {
        VELOCITIES
            .iter()
            .map(|&v_s| {
                let column = joint_torque(c, place, move |j| (-(j.v / v_s).powi(2)).exp() * j.sign());
                torque(vec![column], vec![("v_s", v_s)], Compose::Single).refined_by(refine)
            })
            .collect()
    },
};

fn refine(c: &Context, place: Place, v_s: f64) -> Variant {
    let v_s = v_s.clamp(0.05, 50.0);
    let level = joint_torque(c, place, move |j| (-(j.v / v_s).powi(2)).exp() * j.sign());
    let change = joint_torque(c, place, move |j| {
        let u = (j.v / v_s).powi(2);
        2.0 * u / v_s * (-u).exp() * j.sign()
    });
    torque(vec![level, change], vec![("v_s", v_s)], Compose::Single).refined_by(refine)
}
