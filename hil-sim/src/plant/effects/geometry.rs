//! Where the arms' masses and gravity point.

use super::{ARMS, EffectInfo, Place, Range};

/// The centroid of arm i lies e_i from its joint at φ_i + β instead of φ_i. The line of arm 1 runs
/// to joint 2 (so that m2 l1 stays at φ1), that of arm 2 is what encoder 2 shows; J_o1 and J_o2 do
/// not change.
pub(super) const IMBALANCE: EffectInfo = EffectInfo {
    id: "imbalance",
    places: ARMS,
    unit: "rad",
    parameters: &[],
    equation: "the arm's centroid at phi + beta: m e sin(phi + beta) for m e sin phi",
    range: Range::between(-core::f64::consts::PI, core::f64::consts::PI),
    apply: |a, place, value, _| a.imbalance[place.index()] += value,
};

/// Gravity turned toward positive angles; the drive keeps its direction.
pub(super) const FRAME_TILT: EffectInfo = EffectInfo {
    id: "frame-tilt",
    places: &[Place::Frame],
    unit: "rad",
    parameters: &[],
    equation: "g sin(phi - beta) for g sin phi (the arms hang at beta); the drive is not turned",
    range: Range::between(-core::f64::consts::PI, core::f64::consts::PI),
    apply: |a, _, value, _| a.tilt += value,
};
