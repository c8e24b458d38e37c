//! Friction in a joint and drag of an arm.
//!
//! Dry friction (everything with sign v) also holds: at v = 0 the joint sticks as long as the
//! torque needed is within the sum of the levels. Stribeck's, load-dependent and asymmetric
//! friction come on top of the Coulomb level, which may be zero.

use super::{ARMS, EffectInfo, JOINTS, PSI, ParameterInfo, Range};

pub(super) const VISCOUS: EffectInfo = EffectInfo {
    id: "viscous-friction",
    places: JOINTS,
    unit: "N m s",
    parameters: &[],
    equation: "-c v",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, _| a.joints[place.index()].viscous += value,
};

pub(super) const COULOMB: EffectInfo = EffectInfo {
    id: "coulomb-friction",
    places: JOINTS,
    unit: "N m",
    parameters: &[],
    equation: "-tau sign v",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, _| {
        for level in &mut a.joints[place.index()].level {
            *level += value;
        }
    },
};

pub(super) const STRIBECK: EffectInfo = EffectInfo {
    id: "stribeck-friction",
    places: JOINTS,
    unit: "N m",
    parameters: &[ParameterInfo {
        name: "v_s",
        unit: "rad/s",
        default: 1.0,
        meaning: "velocity at which the excess over Coulomb's level has fallen to 1/e",
        range: Range { least: 0.0, greatest: 1e4, above: true, whole: false },
    }],
    equation: "-tau_s exp(-(v/v_s)^2) sign v",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, p| a.joints[place.index()].stribeck.push((value, p[0])),
};

pub(super) const LOAD_DEPENDENT: EffectInfo = EffectInfo {
    id: "load-dependent-friction",
    places: JOINTS,
    unit: "m",
    parameters: &[],
    // The load is the joint's whole force across its axis, from the motion itself; the unit is that
    // of μ times radius.
    equation: "-mu |F| sign v, F the force across the joint's axis (N)",
    range: Range::between(0.0, 0.01),
    apply: |a, place, value, _| a.joints[place.index()].per_load += value,
};

pub(super) const QUADRATIC_DRAG: EffectInfo = EffectInfo {
    id: "quadratic-drag",
    places: ARMS,
    unit: "N m s^2",
    parameters: &[],
    equation: "-k w |w|, w the arm's absolute angular velocity, in that arm's equation only",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, _| a.drag[place.index()] += value,
};

pub(super) const ASYMMETRIC: EffectInfo = EffectInfo {
    id: "asymmetric-friction",
    places: JOINTS,
    unit: "N m",
    parameters: &[],
    equation: "-delta for v > 0, 0 for v < 0: Coulomb's level is greater by delta in the positive direction",
    range: Range::ANY,
    // A negative value takes from the other levels; the plant refuses a sum below zero.
    apply: |a, place, value, _| a.joints[place.index()].level[0] += value,
};

pub(super) const AMPLITUDE_DEPENDENT: EffectInfo = EffectInfo {
    id: "amplitude-dependent-damping",
    places: JOINTS,
    unit: "N m s/rad^2",
    parameters: &[],
    equation: "-c x^2 v",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, _| a.joints[place.index()].amplitude_damping += value,
};

pub(super) const POWER_LAW: EffectInfo = EffectInfo {
    id: "power-law-damping",
    places: JOINTS,
    unit: "N m (s/rad)^p",
    parameters: &[ParameterInfo {
        name: "p",
        unit: "",
        default: 1.5,
        meaning: "power of the velocity",
        range: Range::between(0.2, 4.0),
    }],
    equation: "-c |v|^p sign v",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, p| a.joints[place.index()].power.push((value, p[0])),
};

pub(super) const DRIFT: EffectInfo = EffectInfo {
    id: "friction-drift",
    places: JOINTS,
    unit: "N m",
    parameters: &[],
    equation: "-eps t/T_record sign v, from the record's start",
    range: Range::ANY,
    apply: |a, place, value, _| a.joints[place.index()].drift += value,
};

pub(super) const RIPPLE: EffectInfo = EffectInfo {
    id: "friction-ripple",
    places: JOINTS,
    unit: "N m",
    parameters: &[
        ParameterInfo {
            name: "n",
            unit: "",
            default: 1.0,
            meaning: "order: periods in a turn",
            range: Range { least: 1.0, greatest: 12.0, above: false, whole: true },
        },
        PSI,
    ],
    equation: "-A sin(n x + psi) sign v, on top of Coulomb's level, which must be at least |A|",
    range: Range::ANY,
    apply: |a, place, value, p| a.joints[place.index()].ripple.push((value, p[0], p[1])),
};

pub(super) const DISTRIBUTED_DRAG: EffectInfo = EffectInfo {
    id: "distributed-drag",
    places: ARMS,
    unit: "kg/m^2",
    parameters: &[ParameterInfo {
        name: "length",
        unit: "m",
        default: 0.06,
        meaning: "length from the arm's joint over which the air acts",
        range: Range { least: 0.0, greatest: 10.0, above: true, whole: false },
    }],
    equation: "-k v|v| a length along the arm, v the speed there across the arm; its work on both arms",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, p| a.air[place.index()].push((value, p[0])),
};
