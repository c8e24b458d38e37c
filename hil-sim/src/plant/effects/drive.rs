//! The base's motion beside its fundamental a cos(τ − ψ). τ is the phase that the device recorded.

use super::{DRIVE, EffectInfo, ParameterInfo, Range};

const SIN: ParameterInfo = ParameterInfo {
    name: "sin",
    unit: "m",
    default: 0.0,
    meaning: "B, the part with sin tau",
    range: Range::between(-1.0, 1.0),
};

const HARMONIC_PHASE: ParameterInfo =
    ParameterInfo { name: "phase", unit: "rad", default: 0.0, meaning: "phase beta", range: Range::PHASE };

pub(super) const HORIZONTAL: EffectInfo = EffectInfo {
    id: "horizontal-motion",
    places: DRIVE,
    unit: "m",
    parameters: &[SIN],
    equation: "x_b = A cos tau + B sin tau, toward positive angle; value A; for a vertical drive",
    range: Range::between(-1.0, 1.0),
    apply: |a, _, value, p| {
        a.drive.across[0] += value;
        a.drive.across[1] += p[0];
        a.drive.across_is_horizontal = Some(true);
    },
};

pub(super) const VERTICAL: EffectInfo = EffectInfo {
    id: "vertical-motion",
    places: DRIVE,
    unit: "m",
    parameters: &[SIN],
    equation: "y_b = A cos tau + B sin tau, upward; value A; for a horizontal drive",
    range: Range::between(-1.0, 1.0),
    apply: |a, _, value, p| {
        a.drive.across[0] += value;
        a.drive.across[1] += p[0];
        a.drive.across_is_horizontal = Some(false);
    },
};

pub(super) const HARMONIC_2: EffectInfo = EffectInfo {
    id: "drive-harmonic-2",
    places: DRIVE,
    unit: "",
    parameters: &[HARMONIC_PHASE],
    equation: "r a cos(2 tau - beta) added to the base's displacement along the drive; value r",
    range: Range::between(-1.0, 1.0),
    apply: |a, _, value, p| a.drive.harmonics.push((2.0, value, p[0])),
};

pub(super) const HARMONIC_3: EffectInfo = EffectInfo {
    id: "drive-harmonic-3",
    places: DRIVE,
    unit: "",
    parameters: &[HARMONIC_PHASE],
    equation: "r a cos(3 tau - beta) added to the base's displacement along the drive; value r",
    range: Range::between(-1.0, 1.0),
    apply: |a, _, value, p| a.drive.harmonics.push((3.0, value, p[0])),
};

pub(super) const AMPLITUDE_DRIFT: EffectInfo = EffectInfo {
    id: "amplitude-drift",
    places: DRIVE,
    unit: "",
    parameters: &[],
    equation: "a (1 + eps t/T_record), from the record's start",
    range: Range::between(-1.0, 10.0),
    apply: |a, _, value, _| a.drive.amplitude_drift += value,
};

pub(super) const FREQUENCY_OFFSET: EffectInfo = EffectInfo {
    id: "frequency-offset",
    places: DRIVE,
    unit: "Hz",
    parameters: &[],
    equation: "the base moves at f + df, in phase with the recorded tau at the record's start",
    range: Range::between(-100.0, 100.0),
    apply: |a, _, value, _| a.drive.frequency_offset_hz += value,
};
