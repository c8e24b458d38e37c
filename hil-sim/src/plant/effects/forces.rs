//! Torques that depend on nothing, or on time alone.

use super::{EffectInfo, JOINTS, ParameterInfo, Range};

pub(super) const CONSTANT: EffectInfo = EffectInfo {
    id: "constant-force",
    places: JOINTS,
    unit: "N m",
    parameters: &[],
    equation: "+Q",
    range: Range::ANY,
    apply: |a, place, value, _| a.joints[place.index()].constant += value,
};

/// A disturbance of its own frequency, which knows neither the drive nor its phase. It is there
/// before the record too.
pub(super) const TONE: EffectInfo = EffectInfo {
    id: "tone",
    places: JOINTS,
    unit: "N m",
    parameters: &[
        ParameterInfo { name: "f", unit: "Hz", default: 1.0, meaning: "frequency", range: Range::between(0.0, 1e4) },
        ParameterInfo { name: "psi", unit: "rad", default: 0.0, meaning: "phase", range: Range::ANY },
    ],
    equation: "-A cos(2 pi f t - psi), t the laboratory's time from the record's start",
    range: Range::ANY,
    apply: |a, place, value, p| {
        let (sin, cos) = libm::sincos(p[1]);
        a.joints[place.index()].tones.push((value * cos, value * sin, p[0]));
    },
};
