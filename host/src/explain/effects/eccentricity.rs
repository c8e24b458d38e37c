//! A disc mounted off its axis, or tilted: the encoder shows θ + e sin(θ + ψ).

use std::sync::Arc;

use super::{Compose, ENCODERS, Effect, encoder, sensor};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "eccentricity",
    places: ENCODERS,
    unit: "rad",
    equation: "θ + e sin(θ + ψ)",
    signature: "residual once a turn, growing with the square of speed",
    confirm: "spin the arm fast: the count rate varies once a turn",
    variants: |_, place| {
        let k = encoder(place);
        let at = move |x: f64| if k == 0 { [x, 0.0] } else { [0.0, x] };
        sensor(
            vec![Arc::new(move |t, _, _| at(t[k].sin())), Arc::new(move |t, _, _| at(t[k].cos()))],
            Compose::AmplitudePhase("psi"),
        )
    },
};
