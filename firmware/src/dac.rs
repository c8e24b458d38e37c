//! A digital-to-analog converter into a power amplifier with an enable pin.

use core::fmt;

use embedded_hal::digital::OutputPin;

use crate::output::ShakerOutput;

/// A converter; embedded-hal 1 has no trait for one.
pub trait Converter {
    /// Greatest code, at which the output is highest (4095 of 12 bits).
    const MAX: u16;

    /// Sets the output; `code` is at most [`Self::MAX`].
    fn set(&mut self, code: u16);
}

/// Why a [`DacShaker`] could not be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DacShakerError<E> {
    /// The enable pin failed.
    Enable(E),
    /// The displacement is beyond the full scale, nm.
    BeyondFullScale(i32),
}

impl<E: fmt::Debug> fmt::Display for DacShakerError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Enable(error) => write!(f, "amplifier enable failed: {error:?}"),
            Self::BeyondFullScale(found) => write!(f, "displacement of {found} nm is beyond the full scale"),
        }
    }
}

/// The shaker's set point as a voltage: half of the range is rest, its ends are −full scale and +full scale. The enable pin
/// is active high.
#[derive(Debug)]
pub struct DacShaker<D, E> {
    converter: D,
    enable: E,
    full_scale_nanometre: u32,
}

impl<D: Converter, E: OutputPin> DacShaker<D, E> {
    /// Code of rest.
    pub const REST: u16 = D::MAX / 2 + D::MAX % 2;

    /// The displacement at the highest code is `full_scale_nanometre`; zero counts as 1 nm.
    pub const fn new(converter: D, enable: E, full_scale_nanometre: u32) -> Self {
        Self {
            converter,
            enable,
            full_scale_nanometre: if full_scale_nanometre == 0 { 1 } else { full_scale_nanometre },
        }
    }
}

impl<D: Converter, E: OutputPin> ShakerOutput for DacShaker<D, E> {
    type Error = DacShakerError<E::Error>;

    fn write(&mut self, displacement_nanometre: i32) -> Result<(), Self::Error> {
        let (y, scale, max) =
            (i64::from(displacement_nanometre), i64::from(self.full_scale_nanometre), i64::from(D::MAX));
        // 0 to max for −scale to scale, rounded: (y + scale)·max/(2·scale).
        let code = ((y + scale) * max + scale).div_euclid(2 * scale);
        match u16::try_from(code) {
            Ok(code) if y.abs() <= scale => {
                self.converter.set(code);
                Ok(())
            }
            _ => Err(DacShakerError::BeyondFullScale(displacement_nanometre)),
        }
    }

    fn enable(&mut self, on: bool) -> Result<(), Self::Error> {
        self.enable.set_state(on.into()).map_err(DacShakerError::Enable)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::convert::Infallible;

    struct Dac(u16);

    impl Converter for Dac {
        const MAX: u16 = 4_095;
        fn set(&mut self, code: u16) {
            assert!(code <= Self::MAX);
            self.0 = code;
        }
    }

    struct Pin(bool);

    impl embedded_hal::digital::ErrorType for Pin {
        type Error = Infallible;
    }

    impl OutputPin for Pin {
        fn set_low(&mut self) -> Result<(), Infallible> {
            self.0 = false;
            Ok(())
        }
        fn set_high(&mut self) -> Result<(), Infallible> {
            self.0 = true;
            Ok(())
        }
    }

    #[test]
    fn codes_run_over_the_range_and_rest_is_in_the_middle() {
        let mut shaker = DacShaker::new(Dac(7), Pin(false), 25_000_000);
        for (y, code) in [(-25_000_000, 0), (0, 2_048), (25_000_000, 4_095), (12_500_000, 3_071), (6_105, 2_048)] {
            shaker.write(y).unwrap();
            assert_eq!(shaker.converter.0, code, "{y} nm");
        }
        assert_eq!(DacShaker::<Dac, Pin>::REST, 2_048);
    }

    #[test]
    fn beyond_full_scale_is_refused_and_written_nowhere() {
        let mut shaker = DacShaker::new(Dac(7), Pin(false), 1_000);
        for y in [1_001, -1_001, i32::MAX, i32::MIN] {
            assert_eq!(shaker.write(y), Err(DacShakerError::BeyondFullScale(y)));
        }
        assert_eq!(shaker.converter.0, 7);
    }

    #[test]
    fn the_enable_pin_follows() {
        let mut shaker = DacShaker::new(Dac(7), Pin(false), 1_000);
        shaker.enable(true).unwrap();
        assert!(shaker.enable.0);
        shaker.enable(false).unwrap();
        assert!(!shaker.enable.0);
    }
}
