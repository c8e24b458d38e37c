//! What a board tells the application at boot, with its checks.

use core::fmt;

use heapless::{String, Vec};
use whirl_shared::frame::{
    BaseKind, BaseSensor, MOST_ENCODERS, PANIC_LEN, ResetCause, SettingsSource, ShakerLimits, TEXT_LEN,
};

use crate::kept::Kept;

/// Longest build id, bytes: name, version and build share one text of the hello.
pub const BUILD_LEN: usize = 16;
/// Least host time-out that is accepted, ms.
pub const HOST_TIMEOUT_MIN_MS: u32 = 100;
/// Greatest host time-out that is accepted, ms.
pub const HOST_TIMEOUT_MAX_MS: u32 = 60_000;
/// Least and greatest sampling rate, mHz.
pub const SAMPLE_RATE_MILLIHERTZ: [u32; 2] = [1_000, 100_000_000];
/// Greatest counts a turn: keeps a second's sum of squares within 64 bits.
pub const COUNTS_PER_TURN_MAX: u32 = 1 << 20;
/// Greatest amplitude that fits into 32 bits of nm, µm.
pub const AMPLITUDE_MAX_MICROMETRE: u32 = 2_147_483;

/// What a count of the base's sensor is worth unless set, 10⁻¹² m: 5 µm, a common linear encoder.
const BASE_SCALE: u32 = 5_000_000;

/// Least and greatest rate of the serial port, baud: a full block every 20 ms takes 61 % of
/// 115 200.
pub const BAUD: [u32; 2] = [57_600, 2_000_000];

/// Settings of the application.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Board name, at most [`TEXT_LEN`] bytes.
    pub board: &'static str,
    /// Id of the image's sources, told after the firmware's version; at most [`BUILD_LEN`] bytes,
    /// empty where there is none.
    pub build: &'static str,
    /// Changes at every boot.
    pub boot_id: u32,
    /// Sampling rate, mHz.
    pub sample_rate_millihertz: u32,
    /// Counts a turn of each encoder after decoding: as many as the board has encoders.
    pub counts_per_turn: Vec<u32, MOST_ENCODERS>,
    /// Encoders whose sense of counting is turned round.
    pub reversed: Vec<bool, MOST_ENCODERS>,
    /// Whether the board has an input for the base's motion.
    pub base_input: bool,
    /// What is connected to it.
    pub base: BaseSensor,
    /// What the shaker may do; the ramp rate is also the one in force at boot.
    pub limits: ShakerLimits,
    /// Displacement of the base at the set point's highest voltage, µm: for boards that have such
    /// an output.
    pub full_scale_micrometre: u32,
    /// Rate of the serial port, baud: for boards that have one.
    pub baud: u32,
    /// The shaker stops when no valid command has come for this long, ms.
    pub host_timeout_ms: u32,
    /// What a window of the device's own estimate counts for after the next one, thousandths: 1000
    /// averages for ever, 900 over some ten windows.
    pub forget_per_mille: u16,
    /// What came before this boot.
    pub boot: Boot,
}

/// What came before a boot.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Boot {
    /// What ended the one before.
    pub reset: ResetCause,
    /// The text of the panic that did; empty where none did.
    pub panic: String<PANIC_LEN>,
    /// The encoders as they were carried over; none where they were not.
    pub kept: Option<Kept>,
    /// Where the settings are from.
    pub settings: SettingsSource,
}

impl Default for Settings {
    /// Two encoders, 500 Hz, 4096 counts a turn, 20 mm, 20 Hz, 20 mm/s, 40 m/s², 25 mm, 115 200
    /// baud, 2 s, 0.9.
    fn default() -> Self {
        Self {
            board: "unnamed",
            build: "",
            boot_id: 0,
            sample_rate_millihertz: 500_000,
            counts_per_turn: Vec::from_array([4096; 2]),
            reversed: Vec::from_array([false; 2]),
            base_input: false,
            base: BaseSensor { kind: BaseKind::None, scale: BASE_SCALE },
            limits: ShakerLimits {
                amplitude_micrometre: 20_000,
                frequency_millihertz: 20_000,
                ramp_micrometre_per_s: 20_000,
                acceleration_millimetre_per_s2: 40_000,
            },
            full_scale_micrometre: 25_000,
            baud: 115_200,
            host_timeout_ms: 2_000,
            forget_per_mille: 900,
            boot: Boot::default(),
        }
    }
}

/// A setting that is not possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SettingsError {
    /// The field.
    pub field: &'static str,
    /// Its value (a text's length).
    pub found: u32,
    /// Least value.
    pub min: u32,
    /// Greatest value.
    pub max: u32,
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "setting {}: found {}, expected {} to {}", self.field, self.found, self.min, self.max)
    }
}

impl core::error::Error for SettingsError {}

fn check(field: &'static str, found: u32, min: u32, max: u32) -> Result<(), SettingsError> {
    if (min..=max).contains(&found) { Ok(()) } else { Err(SettingsError { field, found, min, max }) }
}

impl Settings {
    /// Channels of a sample: the encoders, and the base's sensor where there is one.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.counts_per_turn.len() + usize::from(self.base.kind != BaseKind::None)
    }

    /// Checks every field.
    ///
    /// # Errors
    /// The first field whose value is not possible, with the values that are.
    pub fn validate(&self) -> Result<(), SettingsError> {
        let rate = self.sample_rate_millihertz;
        let limits = &self.limits;
        let board_len = u32::try_from(self.board.len()).unwrap_or(u32::MAX);
        check("board (length)", board_len, 1, TEXT_LEN as u32)?;
        check("build (length)", u32::try_from(self.build.len()).unwrap_or(u32::MAX), 0, BUILD_LEN as u32)?;
        check("sample_rate_millihertz", rate, SAMPLE_RATE_MILLIHERTZ[0], SAMPLE_RATE_MILLIHERTZ[1])?;
        // No list is longer than its room.
        let encoders = self.counts_per_turn.len() as u32;
        check("counts_per_turn (encoders)", encoders, 1, MOST_ENCODERS as u32)?;
        check("reversed (encoders)", self.reversed.len() as u32, encoders, encoders)?;
        const COUNTS: [&str; 6] = [
            "counts_per_turn[0]",
            "counts_per_turn[1]",
            "counts_per_turn[2]",
            "counts_per_turn[3]",
            "counts_per_turn[4]",
            "counts_per_turn[5]",
        ];
        for (name, counts) in COUNTS.iter().zip(&self.counts_per_turn) {
            check(name, *counts, 1, COUNTS_PER_TURN_MAX)?;
        }
        check("base", self.base.kind as u32, 0, if self.base_input { BaseKind::Acceleration as u32 } else { 0 })?;
        check("base.scale", self.base.scale, 1, u32::MAX)?;
        check("limits.amplitude_micrometre", limits.amplitude_micrometre, 0, AMPLITUDE_MAX_MICROMETRE)?;
        // At least five samples a period, so that the steps of the output are a waveform.
        check("limits.frequency_millihertz", limits.frequency_millihertz, 1, rate / 5)?;
        check("limits.ramp_micrometre_per_s", limits.ramp_micrometre_per_s, 1, AMPLITUDE_MAX_MICROMETRE)?;
        check("limits.acceleration_millimetre_per_s2", limits.acceleration_millimetre_per_s2, 1, u32::MAX)?;
        check("full_scale_micrometre", self.full_scale_micrometre, 1, AMPLITUDE_MAX_MICROMETRE)?;
        check("baud", self.baud, BAUD[0], BAUD[1])?;
        check("host_timeout_ms", self.host_timeout_ms, HOST_TIMEOUT_MIN_MS, HOST_TIMEOUT_MAX_MS)?;
        check("forget_per_mille", u32::from(self.forget_per_mille), 0, 1_000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn the_default_is_valid() {
        assert_eq!(Settings::default().validate(), Ok(()));
    }

    #[test]
    fn an_error_names_field_value_and_range() {
        let settings = Settings { counts_per_turn: Vec::from_array([4096, 0]), ..Settings::default() };
        assert_eq!(
            settings.validate().unwrap_err().to_string(),
            "setting counts_per_turn[1]: found 0, expected 1 to 1048576"
        );
        let mut settings = Settings::default();
        settings.limits.frequency_millihertz = 200_000;
        assert_eq!(settings.validate().unwrap_err().field, "limits.frequency_millihertz");
        let settings = Settings { host_timeout_ms: 0, ..Settings::default() };
        assert_eq!(settings.validate().unwrap_err().field, "host_timeout_ms");
        for encoders in [0, 1, 3] {
            let counts_per_turn = (0..encoders).map(|_| 4096).collect();
            let settings = Settings { counts_per_turn, ..Settings::default() };
            let field = if encoders == 0 { "counts_per_turn (encoders)" } else { "reversed (encoders)" };
            assert_eq!(settings.validate().unwrap_err().field, field);
        }
        let base = BaseSensor { kind: BaseKind::Encoder, scale: 1 };
        let mut settings = Settings { base, ..Settings::default() };
        assert_eq!(settings.validate().unwrap_err().field, "base");
        settings.base_input = true;
        assert_eq!(settings.validate(), Ok(()));
        settings.base.scale = 0;
        assert_eq!(settings.validate().unwrap_err().field, "base.scale");
        let settings = Settings { forget_per_mille: 1_001, ..Settings::default() };
        assert_eq!(settings.validate().unwrap_err().field, "forget_per_mille");
    }
}
