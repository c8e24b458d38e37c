//! Torques that depend on a joint's angle. x is wrapped to [−π, π): where a torque is not periodic
//! it jumps at ±π, and the integration ends a step there.

use super::{EffectInfo, JOINTS, PSI, ParameterInfo, Range};

pub(super) const TORSION_SPRING: EffectInfo = EffectInfo {
    id: "torsion-spring",
    places: JOINTS,
    unit: "N m/rad",
    parameters: &[],
    equation: "-k x",
    range: Range::ANY,
    apply: |a, place, value, _| a.joints[place.index()].stiffness[0] += value,
};

pub(super) const QUADRATIC: EffectInfo = EffectInfo {
    id: "quadratic-stiffness",
    places: JOINTS,
    unit: "N m/rad^2",
    parameters: &[],
    equation: "-k x^2",
    range: Range::ANY,
    apply: |a, place, value, _| a.joints[place.index()].stiffness[1] += value,
};

pub(super) const CUBIC: EffectInfo = EffectInfo {
    id: "cubic-stiffness",
    places: JOINTS,
    unit: "N m/rad^3",
    parameters: &[],
    equation: "-k x^3",
    range: Range::ANY,
    apply: |a, place, value, _| a.joints[place.index()].stiffness[2] += value,
};

pub(super) const QUINTIC: EffectInfo = EffectInfo {
    id: "quintic-stiffness",
    places: JOINTS,
    unit: "N m/rad^5",
    parameters: &[],
    equation: "-k x^5",
    range: Range::ANY,
    apply: |a, place, value, _| a.joints[place.index()].quintic += value,
};

/// Play between two springs: no torque inside the dead zone.
pub(super) const BACKLASH: EffectInfo = EffectInfo {
    id: "backlash",
    places: JOINTS,
    unit: "rad",
    parameters: &[ParameterInfo {
        name: "k",
        unit: "N m/rad",
        default: 0.01,
        meaning: "stiffness at the ends of the play",
        range: Range::NOT_NEGATIVE,
    }],
    equation: "-k (x - b) for x > b, -k (x + b) for x < -b, 0 between: a dead zone of half width b",
    range: Range::between(0.0, core::f64::consts::PI),
    apply: |a, place, value, p| a.joints[place.index()].backlash.push((value, p[0])),
};

pub(super) const COGGING: EffectInfo = EffectInfo {
    id: "cogging",
    places: JOINTS,
    unit: "N m",
    parameters: &[
        ParameterInfo {
            name: "n",
            unit: "",
            default: 6.0,
            meaning: "order: periods in a turn",
            range: Range { least: 1.0, greatest: 60.0, above: false, whole: true },
        },
        PSI,
    ],
    equation: "-A sin(n x + psi)",
    range: Range::ANY,
    apply: |a, place, value, p| a.joints[place.index()].cogging.push((value, p[0], p[1])),
};

pub(super) const MODULATION: EffectInfo = EffectInfo {
    id: "stiffness-modulation",
    places: JOINTS,
    unit: "N m/rad",
    parameters: &[PSI],
    equation: "-A cos(tau - psi) x",
    range: Range::ANY,
    apply: |a, place, value, p| {
        let (sin, cos) = libm::sincos(p[0]);
        a.joints[place.index()].modulation[0] += value * cos;
        a.joints[place.index()].modulation[1] += value * sin;
    },
};

pub(super) const LOCAL: EffectInfo = EffectInfo {
    id: "local-force",
    places: JOINTS,
    unit: "N m/rad",
    parameters: &[
        ParameterInfo { name: "x0", unit: "rad", default: 0.0, meaning: "angle", range: Range::between(-3.2, 3.2) },
        ParameterInfo {
            name: "d",
            unit: "rad",
            default: 0.3,
            meaning: "reach",
            // The law is cut where it is farthest, at (π/d)² of its exponent.
            range: Range { least: 0.01, greatest: 0.8, above: false, whole: false },
        },
    ],
    equation: "-k u exp(-(u/d)^2), u = x - x0 wrapped",
    range: Range::ANY,
    apply: |a, place, value, p| a.joints[place.index()].local.push((value, p[0], p[1])),
};
