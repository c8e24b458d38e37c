//! An encoder whose zero is not where the arm hangs: it shows θ + b.

use std::sync::Arc;

use super::{Compose, ENCODERS, Effect, encoder, sensor};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "zero-offset",
    places: ENCODERS,
    unit: "rad",
    equation: "θ + b",
    signature: "residual proportional to the cosine of angles, gravity's and the drive's share alike",
    confirm: "let the arms hang at rest and read the encoders",
    variants: |_, place| {
        let k = encoder(place);
        sensor(vec![Arc::new(move |_, _, _| if k == 0 { [1.0, 0.0] } else { [0.0, 1.0] })], Compose::Single)
    },
};
