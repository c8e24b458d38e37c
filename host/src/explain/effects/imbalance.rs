//! The centroid off the arm's line by an angle β: m1 e1 sin(φ1 + β) for m1 e1 sin φ1. For arm 2 the couplings turn with it, which is
//! the same as an encoder 2 that shows −β more: tested as that, with the sign turned.

use super::{ARMS, Action, Compose, Effect, Place, Scale, Variant, sensor};
use std::sync::Arc;

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "imbalance",
    places: ARMS,
    unit: "rad",
    equation: "m e sin(φ + β) for m e sin φ",
    signature: "residual proportional to the cosine of the arm's angle, with gravity's and the drive's share",
    confirm: "take the arm off and balance it on an edge",
    variants: |c, place| {
        if place == Place::Arm2 {
            return sensor(vec![Arc::new(|_, _, _| [0.0, -1.0])], Compose::Single);
        }
        // Relative to the whole of S1; m1 e1 is a part of it that known lengths and masses give.
        let (b, share) =
            (c.b[0], c.known.get("m1e1").copied().or_else(|| Some(c.known.get("m1")? * c.known.get("e1")?)));
        let s1 = |m1e1: f64| Some(m1e1 + c.known.get("m2")? * c.known.get("l1")?);
        let scale = share.and_then(|m| Some(s1(m)? / m)).unwrap_or(1.0);
        let column: [Option<crate::model::weak::Series>; 2] =
            [Some(Arc::new(move |s| s.cos[0] * (b[1] + b[2] * s.cos_tau + b[3] * s.sin_tau))), None];
        vec![Variant {
            shape: Vec::new(),
            action: Action::Force(vec![column]),
            compose: Compose::Single,
            scale: Scale::Plain(scale),
            refine: None,
        }]
    },
};
