//! A base that moves at f + Δf, in phase with the recorded τ at the record's first sample: a generator off its stated frequency. To first order
//! in 2π Δf t; whirl applies what it finds and looks again.

use core::f64::consts::TAU;

use super::{Action, Compose, DRIVE, Effect, Scale, Variant, both};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "frequency-offset",
    places: DRIVE,
    unit: "Hz",
    equation: "τ + 2π Δf t",
    signature: "the drive's phase runs away along the record",
    confirm: "count the drive's periods over ten minutes",
    variants: |c, _| {
        if !c.driven {
            return Vec::new();
        }
        let (b, [start, _]) = (c.b, c.span_s);
        let column = both(move |i, s| TAU * (s.time - start) * s.sin[i] * (b[i][3] * s.cos_tau - b[i][2] * s.sin_tau));
        let action = Action::Runaway(column);
        vec![Variant { shape: Vec::new(), action, compose: Compose::Single, scale: Scale::Plain(1.0), refine: None }]
    },
};
