//! An encoder that counts too many or too few a turn: it shows (1 + s) θ, of the unwrapped angle.

use std::sync::Arc;

use super::{Compose, ENCODERS, Effect, encoder, sensor};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "scale-error",
    places: ENCODERS,
    unit: "1",
    equation: "(1 + s) θ",
    signature: "residuals that grow with the number of turns",
    confirm: "turn the joint ten times by hand and read the encoder",
    variants: |_, place| {
        let k = encoder(place);
        sensor(vec![Arc::new(move |t, _, _| if k == 0 { [t[0], 0.0] } else { [0.0, t[1]] })], Compose::Single)
    },
};
