//! The sensor of the base's own motion: an encoder or a displacement transducer (position), or an
//! accelerometer, with noise, an offset and an error of its gain.
//!
//! A reading of x (m or m/s²) is round((gain · x + offset + n)/scale), n normal with standard
//! deviation `noise` (ChaCha8 and the polar method: a seed gives the same noise on every machine).
//! An encoder's counts wrap at 2¹⁶ as its counter does; a converter's are clipped to 16 bits.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use whirl_firmware::base::BaseInput;

use crate::plant::ParameterError;

/// Half the range of a converter's counts.
const MIDDLE: f64 = 32_768.0;

/// What a sensor of the base shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BaseQuantity {
    /// Position, counted by an encoder without end.
    #[default]
    Counted,
    /// Position, by a converter.
    Position,
    /// Acceleration, by a converter.
    Acceleration,
}

/// How the sensor of the base's motion is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseSettings {
    /// What it shows.
    pub quantity: BaseQuantity,
    /// m or m/s² a count, as the rig file has it.
    pub scale: f64,
    /// What the sensor shows of 1.
    pub gain: f64,
    /// What it shows at 0, m or m/s².
    pub offset: f64,
    /// Standard deviation of its noise, m or m/s².
    pub noise: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl BaseSettings {
    /// Checks every value.
    ///
    /// # Errors
    /// The first that cannot be, with what is expected.
    pub fn validate(&self) -> Result<(), ParameterError> {
        for (name, value, least) in
            [("scale of the base's sensor", self.scale, 1e-15), ("noise of the base's sensor", self.noise, 0.0)]
        {
            if !(least..=1e15).contains(&value) {
                return Err(ParameterError::new(name, value, &format!("{least:e} to 1e15")));
            }
        }
        for (name, value) in [("gain of the base's sensor", self.gain), ("offset of the base's sensor", self.offset)] {
            if !(-1e6..=1e6).contains(&value) {
                return Err(ParameterError::new(name, value, "-1e6 to 1e6"));
            }
        }
        Ok(())
    }
}

/// The sensor of the base's motion.
#[derive(Clone, Debug)]
pub struct BaseSensor {
    settings: BaseSettings,
    random: ChaCha8Rng,
    /// The second of a pair of normal numbers.
    spare: Option<f64>,
    counts: i64,
}

impl BaseSensor {
    /// A sensor that shows 0 until it is first moved.
    #[must_use]
    pub fn new(settings: BaseSettings) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(settings.seed);
        random.set_stream(1);
        Self { settings, random, spare: None, counts: 0 }
    }

    /// Shows the base's displacement (m) or acceleration (m/s²) along the drive from now on.
    pub(crate) fn measure(&mut self, [displacement, acceleration]: [f64; 2]) {
        self.show(match self.settings.quantity {
            BaseQuantity::Counted | BaseQuantity::Position => displacement,
            BaseQuantity::Acceleration => acceleration,
        });
    }

    /// Shows a value from now on, m or m/s².
    pub fn show(&mut self, value: f64) {
        let BaseSettings { quantity, scale, gain, offset, noise, .. } = self.settings;
        let noise = if noise > 0.0 { noise * self.normal() } else { 0.0 };
        let counts = ((gain * value + offset + noise) / scale).round();
        self.counts = match quantity {
            BaseQuantity::Counted => counts as i64,
            BaseQuantity::Position | BaseQuantity::Acceleration => counts.clamp(-MIDDLE, MIDDLE - 1.0) as i64,
        };
    }

    /// The counts that are shown: those of an encoder from its zero, those of a converter from the
    /// middle of its range.
    #[must_use]
    pub fn counts(&self) -> i32 {
        // Wraps as the device's do.
        self.counts as i32
    }

    fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        loop {
            let [x, y] = [0, 1].map(|_| (self.random.next_u64() >> 11) as f64 / 4_503_599_627_370_496.0 - 1.0);
            let square = x * x + y * y;
            if square > 0.0 && square < 1.0 {
                let factor = libm::sqrt(-2.0 * libm::log(square) / square);
                self.spare = Some(y * factor);
                return x * factor;
            }
        }
    }
}

impl BaseInput for BaseSensor {
    fn latch(&mut self) -> u16 {
        match self.settings.quantity {
            BaseQuantity::Counted => self.counts as u16,
            BaseQuantity::Position | BaseQuantity::Acceleration => (self.counts as i16 as u16).wrapping_add(1 << 15),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(quantity: BaseQuantity, noise: f64) -> BaseSensor {
        BaseSensor::new(BaseSettings { quantity, scale: 1e-6, gain: 1.01, offset: 2e-3, noise, seed: 7 })
    }

    #[test]
    fn gain_offset_and_range_are_the_sensors() {
        let mut lvdt = sensor(BaseQuantity::Position, 0.0);
        for (x, counts) in [(0.0, 2_000), (0.01, 12_100), (-0.01, -8_100), (1.0, 32_767), (-1.0, -32_768)] {
            lvdt.show(x);
            assert_eq!(lvdt.counts(), counts);
            assert_eq!(i32::from(lvdt.latch()) - 32_768, counts);
        }
        let mut encoder = sensor(BaseQuantity::Counted, 0.0);
        encoder.show(0.1);
        assert_eq!((encoder.counts(), encoder.latch()), (103_000, (103_000 - 65_536) as u16));
    }

    #[test]
    fn noise_has_its_size_and_is_the_same_at_every_repeat() {
        let run = || -> Vec<i32> {
            let mut s = sensor(BaseQuantity::Position, 5e-6);
            (0..20_000)
                .map(|_| {
                    s.show(0.0);
                    s.counts() - 2_000
                })
                .collect()
        };
        let counts = run();
        let mean = counts.iter().map(|c| f64::from(*c)).sum::<f64>() / 20_000.0;
        let square = counts.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>() / 20_000.0;
        // Rounding adds 1/12.
        assert!(mean.abs() < 0.15 && (square / (25.0 + 1.0 / 12.0) - 1.0).abs() < 0.03, "{mean} {square}");
        assert_eq!(counts, run());
    }
}
