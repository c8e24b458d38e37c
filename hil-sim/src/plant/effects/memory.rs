//! Torques in a joint that depend on its past motion, through a state z that begins at 0. z is in
//! rad, but for Dahl's, which is a share of d.

use super::{EffectInfo, JOINTS, ParameterInfo, Range};
use crate::plant::Memory;

/// Over a shorter presliding distance a state that is integrated would make the plant too stiff.
const INTEGRATED_DISTANCE: Range = Range { least: 1e-4, greatest: 10.0, above: false, whole: false };

pub(super) const DAHL: EffectInfo = EffectInfo {
    id: "dahl-friction",
    places: JOINTS,
    unit: "N m",
    parameters: &[ParameterInfo {
        name: "d",
        unit: "rad",
        default: 0.02,
        meaning: "presliding distance, over which friction follows a reversal",
        range: Range { least: 1e-6, greatest: 10.0, above: false, whole: false },
    }],
    equation: "-F z, dz/dt = (v - |v| z)/d",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, p| {
        a.joints[place.index()].memories.push(Memory::Hysteresis {
            stiffness: value / p[0],
            rate: 1.0 / p[0],
            shape: 0.0,
        });
    },
};

/// Maxwell's element: a spring for what is faster than T_r, viscous friction k T_r for what is
/// slower.
pub(super) const RELAXATION: EffectInfo = EffectInfo {
    id: "relaxation",
    places: JOINTS,
    unit: "N m/rad",
    parameters: &[ParameterInfo {
        name: "T_r",
        unit: "s",
        default: 0.1,
        meaning: "time in which the torque of a joint at rest falls to 1/e",
        range: Range::between(1e-4, 1e6),
    }],
    equation: "-k z, dz/dt = v - z/T_r",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, p| {
        a.joints[place.index()].memories.push(Memory::Relaxation { stiffness: value, time: p[0] });
    },
};

/// R. Bouc 1967, Y.-K. Wen 1976, exponent 1. |c| ≤ 1: the element takes energy and gives none.
pub(super) const HYSTERESIS: EffectInfo = EffectInfo {
    id: "hysteresis",
    places: JOINTS,
    unit: "N m/rad",
    parameters: &[
        ParameterInfo {
            name: "b",
            unit: "1/rad",
            default: 10.0,
            meaning: "inverse of the distance over which z saturates, at 1/(b (1 + c))",
            range: Range::between(0.0, 1e6),
        },
        ParameterInfo {
            name: "c",
            unit: "",
            default: 0.5,
            meaning: "shape of the loops: 0 is Dahl's friction, 1 unloads along straight lines",
            range: Range::between(-1.0, 1.0),
        },
    ],
    equation: "-k z, dz/dt = v - b (|v| z + c v |z|)",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, p| {
        a.joints[place.index()].memories.push(Memory::Hysteresis { stiffness: value, rate: p[0], shape: p[1] });
    },
};

/// The angle is counted on through whole turns: a joint that whirls winds the spring up, a turn of
/// it 2πk, as if both arms held its ends. A joint that starts outside the play, |x| > b, pushes as
/// soon as it moves outward, and keeps its lag until it has come back through the play.
pub(super) const PLAY: EffectInfo = EffectInfo {
    id: "play",
    places: JOINTS,
    unit: "N m/rad",
    parameters: &[ParameterInfo {
        name: "b",
        unit: "rad",
        default: 0.05,
        meaning: "half width of the play",
        range: Range::between(0.0, 100.0),
    }],
    equation: "-k z, dz/dt = v where sign(v) (x - z) > b, else 0; x counted on through whole turns",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, p| {
        a.joints[place.index()].memories.push(Memory::Play { stiffness: value, half_width: p[0] });
    },
};

/// C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky 1995: with their F_C and F_S, d =
/// F_C/s0 and r = F_S/F_C − 1.
pub(super) const LUGRE: EffectInfo = EffectInfo {
    id: "lugre-friction",
    places: JOINTS,
    unit: "N m/rad",
    parameters: &[
        ParameterInfo {
            name: "s1",
            unit: "N m s/rad",
            default: 0.0,
            meaning: "damping of the presliding",
            range: Range::NOT_NEGATIVE,
        },
        ParameterInfo {
            name: "d",
            unit: "rad",
            default: 0.02,
            meaning: "presliding distance: Coulomb's level is s0 d",
            range: INTEGRATED_DISTANCE,
        },
        ParameterInfo {
            name: "v_s",
            unit: "rad/s",
            default: 1.0,
            meaning: "velocity at which the excess over Coulomb's level has fallen to 1/e",
            range: Range { least: 0.0, greatest: 1e4, above: true, whole: false },
        },
        ParameterInfo {
            name: "r",
            unit: "",
            default: 0.5,
            meaning: "excess at v = 0 as a share of Coulomb's level",
            range: Range::between(0.0, 100.0),
        },
    ],
    equation: "-s0 z - s1 dz/dt, dz/dt = v - |v| z/(d (1 + r exp(-(v/v_s)^2)))",
    range: Range::NOT_NEGATIVE,
    apply: |a, place, value, p| {
        a.joints[place.index()].memories.push(Memory::Lugre {
            stiffness: value,
            damping: p[0],
            distance: p[1],
            stribeck: p[2],
            excess: p[3],
        });
    },
};
