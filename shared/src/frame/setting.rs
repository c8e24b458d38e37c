//! A device's setting, as [`super::Command::Set`] carries it.

use serde::{Deserialize, Serialize};

use super::BaseKind;

/// A setting with its new value. Channels count from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Setting {
    /// Counts a turn of an encoder after decoding.
    CountsPerTurn {
        /// Encoder.
        channel: u8,
        /// Counts.
        counts: u32,
    },
    /// Whether the device turns an encoder's sense of counting round.
    Reversed {
        /// Encoder.
        channel: u8,
        /// Turned round.
        reversed: bool,
    },
    /// Sampling rate.
    SampleRate {
        /// mHz.
        millihertz: u32,
    },
    /// Greatest amplitude of the base.
    AmplitudeLimit {
        /// µm.
        micrometre: u32,
    },
    /// Greatest frequency.
    FrequencyLimit {
        /// mHz.
        millihertz: u32,
    },
    /// Greatest rate at which the amplitude may change.
    RampLimit {
        /// µm/s.
        micrometre_per_s: u32,
    },
    /// Greatest acceleration of the base.
    AccelerationLimit {
        /// mm/s².
        millimetre_per_s2: u32,
    },
    /// Time of silence after which the shaker stops, at boot.
    HostTimeout {
        /// ms.
        ms: u32,
    },
    /// Displacement of the base at the set point's highest voltage.
    FullScale {
        /// µm.
        micrometre: u32,
    },
    /// Rate of the serial port.
    Baud {
        /// Baud.
        rate: u32,
    },
    /// All of them as the image has them.
    BuiltIn,
    /// What the sensor of the base's motion is.
    Base {
        /// What it is.
        kind: BaseKind,
    },
    /// What a count of it is worth.
    BaseScale {
        /// 10⁻¹² m or 10⁻⁹ m/s².
        scale: u32,
    },
}
