//! Motion of the base across its drive, x_b = A cos τ + B sin τ, toward positive angle: a shaker whose guide has play or is not upright.
//! Left-hand sides get S_i ẍ_b cos φ_i.

use super::{Compose, DRIVE, Effect, both, plain};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "horizontal-motion",
    places: DRIVE,
    unit: "m",
    equation: "x_b = A cos τ + B sin τ; value A, parameter sin = B",
    signature: "residual proportional to cos φ at the drive's frequency",
    confirm: "put an accelerometer across the base, or a dial gauge",
    variants: |c, _| {
        if !c.driven {
            return Vec::new();
        }
        let lever = [c.lever(0), c.lever(1)];
        let column = |sine: bool| both(move |i, s| -lever[i] * s.cos[i] * if sine { s.sin_tau } else { s.cos_tau });
        plain(vec![column(false), column(true)], Compose::Components("sin"))
    },
};
