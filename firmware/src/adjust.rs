//! Settings that a host may change, and the words in which they are kept.
//!
//! A change is checked together with all the others as they will be in force, and takes force at
//! the next boot: rate, counts and limits never change under a run. What is kept is a list of words
//! behind the number of its layout; another layout, or values that are not possible, are as if
//! nothing had been kept.

use whirl_shared::frame::{BaseKind, BaseSensor, CommandResult, Setting, ShakerLimits};

use crate::settings::{Settings, SettingsError};

/// Encoders that there is room for, whatever this build has.
const ENCODERS: usize = 6;
/// Words of kept settings.
pub const WORDS: usize = 12 + ENCODERS;
/// Number of this layout.
const LAYOUT: u32 = 2;

/// Kept settings.
pub type Words = [u32; WORDS];

impl Settings {
    /// With one of them changed; `built_in` are those of the image.
    ///
    /// # Errors
    /// What the host is to be answered.
    pub fn with(&self, setting: Setting, built_in: &Self) -> Result<Self, CommandResult> {
        let mut new = self.clone();
        let no_channel = CommandResult::OutOfRange { limit: (new.reversed.len() as u32).saturating_sub(1) };
        match setting {
            Setting::CountsPerTurn { channel, counts } => {
                *new.counts_per_turn.get_mut(usize::from(channel)).ok_or(no_channel)? = counts;
            }
            Setting::Reversed { channel, reversed } => {
                *new.reversed.get_mut(usize::from(channel)).ok_or(no_channel)? = reversed;
            }
            Setting::SampleRate { millihertz } => new.sample_rate_millihertz = millihertz,
            Setting::AmplitudeLimit { micrometre } => new.limits.amplitude_micrometre = micrometre,
            Setting::FrequencyLimit { millihertz } => new.limits.frequency_millihertz = millihertz,
            Setting::RampLimit { micrometre_per_s } => new.limits.ramp_micrometre_per_s = micrometre_per_s,
            Setting::AccelerationLimit { millimetre_per_s2 } => {
                new.limits.acceleration_millimetre_per_s2 = millimetre_per_s2;
            }
            Setting::HostTimeout { ms } => new.host_timeout_ms = ms,
            Setting::FullScale { micrometre } => new.full_scale_micrometre = micrometre,
            Setting::Baud { rate } => new.baud = rate,
            Setting::BuiltIn => return Ok(built_in.clone()),
            Setting::Base { kind } => new.base.kind = kind,
            Setting::BaseScale { scale } => new.base.scale = scale,
        }
        match new.validate() {
            Ok(()) => Ok(new),
            Err(SettingsError { found, min, max, .. }) => {
                Err(CommandResult::OutOfRange { limit: if found < min { min } else { max } })
            }
        }
    }

    /// The words to be kept.
    #[must_use]
    pub fn to_words(&self) -> Words {
        let ShakerLimits {
            amplitude_micrometre,
            frequency_millihertz,
            ramp_micrometre_per_s,
            acceleration_millimetre_per_s2,
        } = self.limits;
        let reversed = self.reversed.iter().rev().fold(0, |all, one| all << 1 | u32::from(*one));
        let mut counts = self.counts_per_turn.iter().copied();
        let mut next = || counts.next().unwrap_or(0);
        let counts: [u32; ENCODERS] = core::array::from_fn(|_| next());
        let [c0, c1, c2, c3, c4, c5] = counts;
        [
            LAYOUT,
            c0,
            c1,
            c2,
            c3,
            c4,
            c5,
            reversed,
            self.sample_rate_millihertz,
            amplitude_micrometre,
            frequency_millihertz,
            ramp_micrometre_per_s,
            acceleration_millimetre_per_s2,
            self.host_timeout_ms,
            self.full_scale_micrometre,
            self.baud,
            self.base.kind as u32,
            self.base.scale,
        ]
    }

    /// These with kept words in the place of their own; none where that is not possible.
    #[must_use]
    pub fn with_words(&self, words: &Words) -> Option<Self> {
        let &[
            LAYOUT,
            c0,
            c1,
            c2,
            c3,
            c4,
            c5,
            reversed,
            sample_rate_millihertz,
            amplitude_micrometre,
            frequency_millihertz,
            ramp_micrometre_per_s,
            acceleration_millimetre_per_s2,
            host_timeout_ms,
            full_scale_micrometre,
            baud,
            kind,
            scale,
        ] = words
        else {
            return None;
        };
        let encoders = self.counts_per_turn.len();
        if u64::from(reversed) >> encoders != 0 {
            return None;
        }
        let kind = match kind {
            0 => BaseKind::None,
            1 => BaseKind::Encoder,
            2 => BaseKind::Position,
            3 => BaseKind::Acceleration,
            _ => return None,
        };
        let new = Self {
            counts_per_turn: [c0, c1, c2, c3, c4, c5].into_iter().take(encoders).collect(),
            reversed: (0..encoders).map(|i| reversed >> i & 1 != 0).collect(),
            base: BaseSensor { kind, scale },
            sample_rate_millihertz,
            limits: ShakerLimits {
                amplitude_micrometre,
                frequency_millihertz,
                ramp_micrometre_per_s,
                acceleration_millimetre_per_s2,
            },
            host_timeout_ms,
            full_scale_micrometre,
            baud,
            ..self.clone()
        };
        new.validate().is_ok().then_some(new)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_changes_its_own_and_is_kept() {
        let built_in = Settings { base_input: true, ..Settings::default() };
        let mut all = built_in.clone();
        for (n, setting) in [
            Setting::CountsPerTurn { channel: 1, counts: 8_192 },
            Setting::Reversed { channel: 0, reversed: true },
            Setting::Reversed { channel: 1, reversed: true },
            Setting::SampleRate { millihertz: 1_000_000 },
            Setting::AmplitudeLimit { micrometre: 9_000 },
            Setting::FrequencyLimit { millihertz: 12_000 },
            Setting::RampLimit { micrometre_per_s: 5_000 },
            Setting::AccelerationLimit { millimetre_per_s2: 30_000 },
            Setting::HostTimeout { ms: 900 },
            Setting::FullScale { micrometre: 12_000 },
            Setting::Baud { rate: 230_400 },
            Setting::Base { kind: BaseKind::Position },
            Setting::BaseScale { scale: 800_000 },
        ]
        .into_iter()
        .enumerate()
        {
            let before = all.to_words();
            all = all.with(setting, &built_in).unwrap();
            let changed = before.iter().zip(all.to_words()).filter(|&(a, b)| *a != b).count();
            assert_eq!(changed, 1, "setting {n}");
            assert_eq!(built_in.with_words(&all.to_words()), Some(all.clone()));
        }
        assert_eq!(all.with(Setting::BuiltIn, &built_in), Ok(built_in));
    }

    #[test]
    fn what_is_not_possible_is_refused_with_its_limit() {
        let built_in = Settings::default();
        for (setting, limit) in [
            (Setting::CountsPerTurn { channel: 2, counts: 1 }, 1),
            (Setting::Reversed { channel: 255, reversed: false }, 1),
            (Setting::CountsPerTurn { channel: 0, counts: 0 }, 1),
            (Setting::CountsPerTurn { channel: 0, counts: u32::MAX }, 1 << 20),
            (Setting::HostTimeout { ms: 5 }, 100),
            // This board has no input for it.
            (Setting::Base { kind: BaseKind::Encoder }, 0),
            (Setting::BaseScale { scale: 0 }, 1),
            (Setting::Baud { rate: 9_600 }, 57_600),
            // Five samples a period at the greatest frequency.
            (Setting::SampleRate { millihertz: 50_000 }, 10_000),
        ] {
            assert_eq!(built_in.with(setting, &built_in), Err(CommandResult::OutOfRange { limit }), "{setting:?}");
        }
        for (place, value) in [(0, 1), (0, 0), (1, 0), (7, 4), (15, 1), (16, 1), (16, 9), (17, 0)] {
            let mut words = built_in.to_words();
            words[place] = value;
            assert_eq!(built_in.with_words(&words), None, "word {place}");
        }
    }
}
