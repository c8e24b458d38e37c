//! Gravity turned by β against the frame, the drive not: g sin(φ − β), so that the arms hang at +β.

use super::{Compose, Effect, Place, both, plain};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "frame-tilt",
    places: &[Place::Frame],
    unit: "rad",
    equation: "g sin(φ − β) for g sin φ",
    signature: "residual proportional to the cosine of both arms' angles, without the drive's share",
    confirm: "put a level on the frame",
    variants: |c, _| {
        let b = c.b;
        plain(vec![both(move |i, s| -b[i][1] * s.cos[i])], Compose::Single)
    },
};
