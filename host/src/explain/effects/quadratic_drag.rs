//! Drag of the air, −k ω |ω| with the arm's absolute angular velocity, in that arm's equation only (Newton 1687; for a rod k = ρ c_d d l⁴/8).

use std::sync::Arc;

use super::{ARMS, Compose, Effect, Place, torque};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "quadratic-drag",
    places: ARMS,
    unit: "N m s²",
    equation: "−k ω |ω|",
    signature: "residual that grows with the square of the arm's speed, against it",
    confirm: "repeat with a paper sail on the arm, or in a draught-free box: k scales with the area",
    variants: |c, place| {
        let i = usize::from(place == Place::Arm2);
        let factor = 1.0 / (c.inertia(i) * c.omega * c.omega);
        let mut column = [None, None];
        column[i] = Some(Arc::new(move |s: &crate::model::weak::Sample| factor * s.rate[i] * s.rate[i].abs()) as _);
        vec![torque(vec![column], Vec::new(), Compose::Single)]
    },
};
