//! Who a device is, how it is set, and what came before: [`Hello`] and what is in it.

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

use super::{MOST_ENCODERS, PANIC_LEN, TEXT_LEN};

/// Identity, settings and past of a device.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hello {
    /// [`super::PROTOCOL_VERSION`] of the firmware.
    pub protocol: u16,
    /// [`super::SCHEMA_HASH`] of the firmware.
    pub schema: u32,
    /// Changes at every boot, so that a restart is told from a gap.
    pub boot_id: u32,
    /// Sampling tick at which this was sent.
    pub tick: u32,
    /// Firmware name and version.
    pub firmware: String<TEXT_LEN>,
    /// Board name.
    pub board: String<TEXT_LEN>,
    /// Sampling rate in mHz (500 000 at 500 Hz).
    pub sample_rate_millihertz: u32,
    /// Counts a turn of each encoder after decoding.
    pub counts_per_turn: Vec<u32, MOST_ENCODERS>,
    /// Samples in a full block.
    pub block_len: u8,
    /// What the shaker may do.
    pub limits: ShakerLimits,
    /// The shaker stops when the host has been silent for this long, ms.
    pub host_timeout_ms: u32,
    /// Where each encoder's zero is from.
    pub zeros: Vec<Zero, MOST_ENCODERS>,
    /// What ended the boot before this one.
    pub reset: ResetCause,
    /// The message of the panic that ended the boot before this one; empty where there was none.
    pub panic: String<PANIC_LEN>,
    /// Encoders whose sense of counting the device turns round.
    pub reversed: Vec<bool, MOST_ENCODERS>,
    /// Displacement of the base at the set point's highest voltage, µm.
    pub full_scale_micrometre: u32,
    /// Rate of the serial port, baud.
    pub baud: u32,
    /// Where the settings are from.
    pub settings: SettingsSource,
    /// The sensor of the base's motion, whose counts come behind the encoders' in every sample.
    pub base: BaseSensor,
}

/// The sensor of the base's own motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BaseSensor {
    /// What it is.
    pub kind: BaseKind,
    /// What a count is worth: 10⁻¹² m of a position, 10⁻⁹ m/s² of an acceleration.
    pub scale: u32,
}

/// What a sensor of the base's motion is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum BaseKind {
    /// There is none, and no channel of it.
    #[default]
    None,
    /// An encoder: position, counted without end from where it was at power-up or zeroed.
    Encoder,
    /// A transducer of displacement on the converter: position from the middle of its range.
    Position,
    /// An accelerometer on the converter: acceleration from the middle of its range.
    Acceleration,
}

impl BaseSensor {
    /// What a count is worth, m or m/s²; none where there is no sensor.
    #[must_use]
    pub fn per_count(&self) -> Option<f64> {
        let unit = match self.kind {
            BaseKind::None => return None,
            BaseKind::Encoder | BaseKind::Position => 1e12,
            BaseKind::Acceleration => 1e9,
        };
        Some(f64::from(self.scale) / unit)
    }
}

/// Limits of the shaker, kept by the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShakerLimits {
    /// Greatest amplitude of the base, µm.
    pub amplitude_micrometre: u32,
    /// Greatest frequency, mHz.
    pub frequency_millihertz: u32,
    /// Greatest rate at which the amplitude may change, µm/s.
    pub ramp_micrometre_per_s: u32,
    /// Greatest acceleration a(2πf)² of the base, mm/s²: amplitude and frequency limits together
    /// allow more than a shaker can do.
    pub acceleration_millimetre_per_s2: u32,
}

/// Where an encoder's zero is from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Zero {
    /// The same id, in whatever boot, is the same zero; it changes with the zero.
    pub id: u32,
    /// How it was set.
    pub source: ZeroSource,
    /// Count within a turn, 0 to N − 1, at which the encoder's index mark was first seen since this
    /// zero was set.
    pub index: Option<u32>,
}

/// How an encoder's zero was set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ZeroSource {
    /// The place where the arm was when the power came.
    #[default]
    PowerUp,
    /// The place where the arm was when the host sent [`super::Command::ZeroCounts`].
    Commanded,
    /// Carried over a reset in which the arm turned: off by what it turned then.
    Carried,
}

/// What ended the boot before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ResetCause {
    /// The board does not tell.
    #[default]
    Unknown,
    /// The power came, or was low.
    Power,
    /// The reset pin: a button or a debugger.
    Pin,
    /// The firmware or a debugger asked for it.
    Software,
    /// The watchdog: the tick or the thread stood still.
    Watchdog,
    /// A panic or a fault of the processor, whose text is in [`Hello::panic`].
    Panic,
}

/// Where a device's settings are from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SettingsSource {
    /// Those of the image.
    #[default]
    BuiltIn,
    /// Those that were kept.
    Kept,
    /// Others have been kept since: they are in force from the next boot on.
    Changed,
    /// Those that were kept are not possible on this board: those of the image.
    Refused,
    /// The last change could not be kept.
    NotKept,
}
