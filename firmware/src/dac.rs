//! A digital-to-analog converter into a power amplifier with an enable pin.

use core::fmt;

use embedded_hal::digital::OutputPin;

use crate::output::ShakerOutput;
use crate::sweep::{Scale, Sweep};

/// A converter; embedded-hal 1 has no trait for one.
pub trait Converter {
    /// Greatest code, at which the output is highest (4095 of 12 bits).
    const MAX: u16;

    /// Sets the output, which stands from now on; `code` is at most [`Self::MAX`].
    fn set(&mut self, code: u16);

    /// Points of a tick that it plays by a clock of its own, evenly, the first at the tick; 1 where
    /// it cannot.
    fn points(&self) -> usize {
        1
    }

    /// The last point of this tick of which nothing can be changed any more, and the code that
    /// stands there.
    fn standing(&mut self) -> (usize, u16) {
        (0, Self::MAX / 2)
    }

    /// Where the next points go: room for a tick's and [`crate::sweep::BEYOND`] more.
    fn room(&mut self) -> &mut [u16] {
        &mut []
    }

    /// Plays what is in the room, behind what [`Self::standing`] told; the last one then stands.
    fn play(&mut self) {}
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

/// The shaker's set point as a voltage: half of the range is rest, its ends are −full scale and
/// +full scale. The enable pin is active high; beside it there may be others ([`crate::lines`]).
#[derive(Debug)]
pub struct DacShaker<D, E> {
    converter: D,
    enable: E,
    scale: Scale,
}

impl<D: Converter, E: OutputPin> DacShaker<D, E> {
    /// Code of rest.
    pub const REST: u16 = D::MAX / 2 + D::MAX % 2;

    /// The displacement at the highest code is `full_scale_nanometre`; zero counts as 1 nm.
    pub const fn new(converter: D, enable: E, full_scale_nanometre: u32) -> Self {
        let full_nanometre = if full_scale_nanometre == 0 { 1 } else { full_scale_nanometre };
        Self { converter, enable, scale: Scale { max: D::MAX, full_nanometre } }
    }
}

impl<D: Converter, E: OutputPin> ShakerOutput for DacShaker<D, E> {
    type Error = DacShakerError<E::Error>;

    fn write(&mut self, displacement_nanometre: i32) -> Result<(), Self::Error> {
        let beyond = DacShakerError::BeyondFullScale(displacement_nanometre);
        self.converter.set(self.scale.code(displacement_nanometre).ok_or(beyond)?);
        Ok(())
    }

    fn sweep(&mut self, sweep: &Sweep<'_>) -> Result<(), Self::Error> {
        let points = self.converter.points();
        if points < 2 {
            return self.write(sweep.start());
        }
        let (now, standing) = self.converter.standing();
        let filled = self.scale.fill(sweep, self.converter.room(), points, now, standing);
        filled.ok_or_else(|| DacShakerError::BeyondFullScale(sweep.start()))?;
        self.converter.play();
        Ok(())
    }

    fn enable(&mut self, on: bool) -> Result<(), Self::Error> {
        self.enable.set_state(on.into()).map_err(DacShakerError::Enable)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::BEYOND;
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
        // Without a clock of its own it is a staircase.
        let sweep = Sweep { phase: 0, phase_increment: 9, amplitude_nanometre: [12_500_000; 2], ..Sweep::default() };
        shaker.sweep(&sweep).unwrap();
        assert_eq!(shaker.converter.0, 3_071);
    }

    /// Plays four points a tick.
    struct Playing {
        room: [u16; 4 + BEYOND],
        played: [u16; 4 + BEYOND],
        out: usize,
    }

    impl Converter for Playing {
        const MAX: u16 = 4_095;
        fn set(&mut self, code: u16) {
            self.played = [code; 4 + BEYOND];
        }
        fn points(&self) -> usize {
            4
        }
        fn standing(&mut self) -> (usize, u16) {
            (self.out, self.played[self.out])
        }
        fn room(&mut self) -> &mut [u16] {
            &mut self.room
        }
        fn play(&mut self) {
            self.played = self.room;
        }
    }

    #[test]
    fn a_converter_with_a_clock_plays_the_points_up_to_the_next_tick() {
        let converter = Playing { room: [7; 4 + BEYOND], played: [2_048; 4 + BEYOND], out: 1 };
        let mut shaker = DacShaker::new(converter, Pin(false), 1_000_000);
        let sweep =
            Sweep { phase: 1 << 30, phase_increment: 1 << 24, amplitude_nanometre: [500_000; 2], ..Sweep::default() };
        shaker.sweep(&sweep).unwrap();
        let played = shaker.converter.played;
        // Points that are out already are left alone; the one at the next tick is exact; what
        // follows goes on.
        assert_eq!(played[..2], [7, 7]);
        assert_eq!(
            Some(played[4]),
            shaker.scale.code(sweep.shape.displacement(500_000, sweep.phase + sweep.phase_increment))
        );
        assert!(played[2..].windows(2).all(|pair| pair[0] > pair[1]), "{played:?}");
        let beyond = Sweep { amplitude_nanometre: [2_000_000; 2], phase: 0, ..sweep };
        assert_eq!(shaker.sweep(&beyond), Err(DacShakerError::BeyondFullScale(2_000_000)));
        assert_eq!(shaker.converter.played, played);
        shaker.write(0).unwrap();
        assert_eq!(shaker.converter.played, [2_048; 4 + BEYOND]);
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
