//! A second channel that is late: encoder 2 shows θ2(t − d) when encoder 1 shows θ1(t).

use std::sync::Arc;

use super::{Compose, Effect, Place, sensor};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "channel-delay",
    places: &[Place::Encoder2],
    unit: "s",
    equation: "θ2(t − d)",
    signature: "residual proportional to encoder 2's velocity in every term",
    confirm: "turn both arms as one rigid body: the encoders must agree at all speeds",
    variants: |_, _| sensor(vec![Arc::new(|_, rate, _| [0.0, -rate[1]])], Compose::Single),
};
