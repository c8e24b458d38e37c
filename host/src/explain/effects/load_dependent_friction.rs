//! Dry friction in proportion to the force across the joint's axis, −μ |F| sign v (Coulomb 1785), unit m: coefficient times bearing
//! radius. Joint 2 carries F = m2 (acceleration of arm 2's centroid − gravity), so that |F|/J_o2 follows from the motion, S2/J_o2 (from B22) and the known e2 and
//! l1. Joint 1 would also need m1 and e1 apart.

use super::{Action, Compose, Effect, Place, Scale, Variant};
use crate::model::weak::{Sample, mean_sign};
use std::sync::Arc;

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "load-dependent-friction",
    places: &[Place::Joint2],
    unit: "m",
    equation: "−μ |F| sign v, F the force across the joint's axis",
    signature: "residual that jumps with the sign of the velocity and grows with speed squared",
    confirm: "add weight to the arm: friction grows in proportion",
    variants: |c, _| {
        let (Some(&e2), Some(&l1)) = (c.known.get("e2"), c.known.get("l1")) else { return Vec::new() };
        let c2 = c.clone();
        // m2/J_o2 = (S2/J_o2)/e2.
        let mass = c.lever(1) / e2;
        let load = move |s: &Sample| {
            let a = -c2.omega * c2.omega / c2.lever(1);
            // ÿ of the base from B23, B24 = −(a S2/J_o2)(cos ψ, sin ψ): ÿ = Ω² (B23 cos τ + B24 sin τ)/(S2/J_o2).
            let base = -a * (c2.b[1][2] * s.cos_tau + c2.b[1][3] * s.sin_tau);
            let x = l1 * (s.accel[0] * s.cos[0] - s.rate[0].powi(2) * s.sin[0])
                + e2 * (s.accel[1] * s.cos[1] - s.rate[1].powi(2) * s.sin[1]);
            let y = l1 * (s.accel[0] * s.sin[0] + s.rate[0].powi(2) * s.cos[0])
                + e2 * (s.accel[1] * s.sin[1] + s.rate[1].powi(2) * s.cos[1])
                + base
                + c2.g;
            mass * x.hypot(y) * mean_sign(s.clear_rate[1] - s.clear_rate[0], s.clear_step[1] - s.clear_step[0])
        };
        let (first, second) = (-1.0 / (c.inertia(0) * c.omega * c.omega), 1.0 / (c.omega * c.omega));
        let other = load.clone();
        let column: [Option<crate::model::weak::Series>; 2] =
            [Some(Arc::new(move |s| first * load(s))), Some(Arc::new(move |s| second * other(s)))];
        vec![Variant {
            shape: Vec::new(),
            action: Action::Force(vec![column]),
            compose: Compose::Single,
            scale: Scale::Plain(1.0),
            refine: None,
        }]
    },
};
