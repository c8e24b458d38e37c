//! Torques that depend on nothing.

use super::{EffectInfo, JOINTS, Range};

pub(super) const CONSTANT: EffectInfo = EffectInfo {
    id: "constant-force",
    places: JOINTS,
    unit: "N m",
    parameters: &[],
    equation: "+Q",
    range: Range::ANY,
    apply: |a, place, value, _| a.joints[place.index()].constant += value,
};
