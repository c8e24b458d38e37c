//! The third harmonic of the base's displacement, y = … + r a cos(3τ − β): a shaker or amplifier that distorts. Its share of ÿ is
//! 3² times its share of y.

use super::{Compose, DRIVE, Effect, both, plain};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "drive-harmonic-3",
    places: DRIVE,
    unit: "1",
    equation: "r a cos(3τ − β) added to the base's displacement",
    signature: "residual proportional to sin φ at 3 times the drive's frequency",
    confirm: "look at the spectrum of an accelerometer on the base",
    variants: |c, _| {
        if !c.driven {
            return Vec::new();
        }
        let size = [0, 1].map(|i: usize| -9.0 * c.b[i][2].hypot(c.b[i][3]));
        let cos = both(move |i, s| size[i] * s.sin[i] * (s.cos_tau * (4.0 * s.cos_tau * s.cos_tau - 3.0)));
        let sin = both(move |i, s| size[i] * s.sin[i] * (s.sin_tau * (3.0 - 4.0 * s.sin_tau * s.sin_tau)));
        plain(vec![cos, sin], Compose::AmplitudePhase("phase"))
    },
};
