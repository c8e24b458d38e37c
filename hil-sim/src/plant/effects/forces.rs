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

/// A disturbance of its own frequency, which knows neither the drive nor its phase. It is there before the record too.
pub(super) const TONE: EffectInfo = EffectInfo {
    id: "tone",
    places: JOINTS,
    unit: "N m",
    parameters: &[
        ParameterInfo {
            name: "S",
            unit: "N m",
            default: 0.0,
            meaning: "the part with sin 2 pi f t",
            range: Range::ANY,
        },
        ParameterInfo { name: "f", unit: "Hz", default: 1.0, meaning: "frequency", range: Range::between(0.0, 1e4) },
    ],
    equation: "-(C cos 2 pi f t + S sin 2 pi f t), t the laboratory's time from the record's start",
    range: Range::ANY,
    apply: |a, place, value, p| a.joints[place.index()].tones.push((value, p[0], p[1])),
};
