//! The second harmonic of the base's displacement, y = … + r a cos(2τ − β): a shaker or amplifier that distorts. Its share of ÿ is
//! 2² times its share of y.

use super::{Compose, DRIVE, Effect, both, plain};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "drive-harmonic-2",
    places: DRIVE,
    unit: "1",
    equation: "r a cos(2τ − β) added to the base's displacement",
    signature: "residual proportional to sin φ at 2 times the drive's frequency",
    confirm: "look at the spectrum of an accelerometer on the base",
    variants: |c, _| {
        if !c.driven {
            return Vec::new();
        }
        let size = [0, 1].map(|i: usize| -4.0 * c.b[i][2].hypot(c.b[i][3]));
        let cos = both(move |i, s| size[i] * s.sin[i] * (2.0 * s.cos_tau * s.cos_tau - 1.0));
        let sin = both(move |i, s| size[i] * s.sin[i] * (2.0 * s.sin_tau * s.cos_tau));
        plain(vec![cos, sin], Compose::AmplitudePhase("phase"))
    },
};
