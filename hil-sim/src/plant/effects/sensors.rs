//! What encoders make of their angles. They act on the measurement alone, before it is rounded to
//! counts.

use super::{ENCODERS, EffectInfo, PSI, Place, Range};
use crate::plant::laws::SensorLaw;

pub(super) const ZERO_OFFSET: EffectInfo = EffectInfo {
    id: "zero-offset",
    places: ENCODERS,
    unit: "rad",
    parameters: &[],
    equation: "theta + b",
    range: Range::between(-100.0, 100.0),
    apply: |a, place, value, _| a.sensors[place.index()].push(SensorLaw::Offset(value)),
};

pub(super) const ZERO_DRIFT: EffectInfo = EffectInfo {
    id: "zero-drift",
    places: ENCODERS,
    unit: "rad",
    parameters: &[],
    equation: "theta + b t/T, t from the record's start, T its length",
    range: Range::between(-100.0, 100.0),
    apply: |a, place, value, _| a.sensors[place.index()].push(SensorLaw::Drift(value)),
};

pub(super) const SCALE_ERROR: EffectInfo = EffectInfo {
    id: "scale-error",
    places: ENCODERS,
    unit: "",
    parameters: &[],
    equation: "(1 + s) theta, of the unwrapped angle",
    range: Range::between(-0.5, 0.5),
    apply: |a, place, value, _| a.sensors[place.index()].push(SensorLaw::Scale(value)),
};

pub(super) const ECCENTRICITY: EffectInfo = EffectInfo {
    id: "eccentricity",
    places: ENCODERS,
    unit: "rad",
    parameters: &[PSI],
    equation: "theta + e sin(theta + psi)",
    range: Range::between(-1.0, 1.0),
    apply: |a, place, value, p| a.sensors[place.index()].push(SensorLaw::Eccentricity(value, p[0])),
};

pub(super) const CHANNEL_DELAY: EffectInfo = EffectInfo {
    id: "channel-delay",
    places: &[Place::Encoder2],
    unit: "s",
    parameters: &[],
    equation: "encoder 2 shows theta2(t - d) when encoder 1 shows theta1(t): positive, later than encoder 1",
    range: Range::between(-0.5, 0.5),
    apply: |a, _, value, _| a.delay_s += value,
};

/// The device's clock, by which samples are taken and the shaker is driven.
pub(super) const TIME_BASE: EffectInfo = EffectInfo {
    id: "time-base",
    places: &[Place::Frame],
    unit: "",
    parameters: &[],
    equation: "a second of the record's t lasts 1 + s seconds, the drive's period with it; every coefficient is another, \
        so that [known] quantities contradict the record",
    range: Range::between(-0.5, 1.0),
    apply: |a, _, value, _| a.clock += value,
};
