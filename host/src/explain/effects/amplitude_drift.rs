//! An amplitude that drifts over the record, a (1 + ε t/T_record), t from its first sample: a shaker that warms up.

use super::{Compose, DRIVE, Effect, both, plain};

/// Registration.
pub const EFFECT: Effect = Effect {
    id: "amplitude-drift",
    places: DRIVE,
    unit: "1",
    equation: "a (1 + ε t/T_record)",
    signature: "the drive's residual grows along the record",
    confirm: "measure the base's amplitude at the start and at the end",
    variants: |c, _| {
        if !c.driven {
            return Vec::new();
        }
        let (b, [start, length]) = (c.b, c.span_s);
        // Nothing is known of it outside of the record: there the amplitude stays.
        let drifted = move |time: f64| ((time - start) / length).clamp(0.0, 1.0);
        let column = both(move |i, s| drifted(s.time) * s.sin[i] * (b[i][2] * s.cos_tau + b[i][3] * s.sin_tau));
        plain(vec![column], Compose::Single)
    },
};
