//! Where the shaker's displacement goes.

use core::fmt;

use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;

use crate::sweep::Sweep;

/// The shaker's set-point output.
pub trait ShakerOutput {
    /// What can go wrong.
    type Error;

    /// Sets the base's displacement, nm, positive upward (vertical drive) or toward positive angle
    /// (horizontal drive).
    ///
    /// # Errors
    /// Whatever keeps the displacement from being set; the shaker then goes into its faulted state.
    fn write(&mut self, displacement_nanometre: i32) -> Result<(), Self::Error>;

    /// Moves the base from this tick to the next. An output that has no clock of its own stands
    /// where the tick is.
    ///
    /// # Errors
    /// As for [`Self::write`].
    fn sweep(&mut self, sweep: &Sweep<'_>) -> Result<(), Self::Error> {
        self.write(sweep.start())
    }

    /// Switches the power amplifier; outputs without a switch do nothing. It is on from arming to
    /// disarming.
    ///
    /// # Errors
    /// As for [`Self::write`].
    fn enable(&mut self, on: bool) -> Result<(), Self::Error> {
        let _ = on;
        Ok(())
    }

    /// Whether the emergency stop has cut the enable line: told by an input behind it, since
    /// the line itself is cut without the firmware. Asked at every tick.
    fn is_cut(&mut self) -> bool {
        false
    }

    /// Whether the trigger input is active: a start that waits for it begins then. Asked at every
    /// tick while one waits.
    fn is_triggered(&mut self) -> bool {
        false
    }

    /// The trigger output: on from the tick before the first displacement of a start until the base
    /// is at rest.
    fn trigger(&mut self, on: bool) {
        let _ = on;
    }
}

impl<O: ShakerOutput + ?Sized> ShakerOutput for &mut O {
    type Error = O::Error;

    fn write(&mut self, displacement_nanometre: i32) -> Result<(), Self::Error> {
        (**self).write(displacement_nanometre)
    }

    fn sweep(&mut self, sweep: &Sweep<'_>) -> Result<(), Self::Error> {
        (**self).sweep(sweep)
    }

    fn enable(&mut self, on: bool) -> Result<(), Self::Error> {
        (**self).enable(on)
    }

    fn is_cut(&mut self) -> bool {
        (**self).is_cut()
    }

    fn is_triggered(&mut self) -> bool {
        (**self).is_triggered()
    }

    fn trigger(&mut self, on: bool) {
        (**self).trigger(on);
    }
}

/// Why a [`PwmShaker`] could not be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PwmShakerError<P, E> {
    /// The PWM channel failed.
    Pwm(P),
    /// The enable pin failed.
    Enable(E),
    /// The displacement is beyond the full scale, nm.
    BeyondFullScale(i32),
}

impl<P: fmt::Debug, E: fmt::Debug> fmt::Display for PwmShakerError<P, E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pwm(error) => write!(f, "PWM output failed: {error:?}"),
            Self::Enable(error) => write!(f, "amplifier enable failed: {error:?}"),
            Self::BeyondFullScale(found) => write!(f, "displacement of {found} nm is beyond the full scale"),
        }
    }
}

/// A filtered PWM channel into a power amplifier with an enable pin (active high).
///
/// Duty cycle ½ is rest; 0 and 1 are −full scale and +full scale.
#[derive(Debug)]
pub struct PwmShaker<P, E> {
    pwm: P,
    enable: E,
    full_scale_nanometre: u32,
}

impl<P: SetDutyCycle, E: OutputPin> PwmShaker<P, E> {
    /// The displacement at full duty cycle is `full_scale_nanometre`; zero counts as 1 nm.
    pub const fn new(pwm: P, enable: E, full_scale_nanometre: u32) -> Self {
        Self { pwm, enable, full_scale_nanometre: if full_scale_nanometre == 0 { 1 } else { full_scale_nanometre } }
    }
}

impl<P: SetDutyCycle, E: OutputPin> ShakerOutput for PwmShaker<P, E> {
    type Error = PwmShakerError<P::Error, E::Error>;

    fn write(&mut self, displacement_nanometre: i32) -> Result<(), Self::Error> {
        let (y, scale) = (i64::from(displacement_nanometre), i64::from(self.full_scale_nanometre));
        let max = i64::from(self.pwm.max_duty_cycle());
        // 0 to max for −scale to scale, rounded: (y + scale)·max/(2·scale).
        let duty = ((y + scale) * max + scale).div_euclid(2 * scale);
        match u16::try_from(duty) {
            Ok(duty) if y.abs() <= scale => self.pwm.set_duty_cycle(duty).map_err(PwmShakerError::Pwm),
            _ => Err(PwmShakerError::BeyondFullScale(displacement_nanometre)),
        }
    }

    fn enable(&mut self, on: bool) -> Result<(), Self::Error> {
        self.enable.set_state(on.into()).map_err(PwmShakerError::Enable)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Recorder;
    use core::convert::Infallible;

    struct Pwm {
        max: u16,
        duty: u16,
    }

    impl embedded_hal::pwm::ErrorType for Pwm {
        type Error = Infallible;
    }

    impl SetDutyCycle for Pwm {
        fn max_duty_cycle(&self) -> u16 {
            self.max
        }
        fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
            assert!(duty <= self.max);
            self.duty = duty;
            Ok(())
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
    fn duty_runs_over_its_range() {
        for (max, duties) in [(1_000, [0, 500, 1_000, 750, 500]), (u16::MAX, [0, 32_768, u16::MAX, 49_151, 32_768])] {
            let mut shaker = PwmShaker::new(Pwm { max, duty: 7 }, Pin(false), 20_000_000);
            for (y, duty) in [-20_000_000, 0, 20_000_000, 10_000_000, 100].into_iter().zip(duties) {
                shaker.write(y).unwrap();
                assert_eq!(shaker.pwm.duty, duty, "{y} nm");
            }
        }
    }

    #[test]
    fn beyond_full_scale_is_refused_and_written_nowhere() {
        let mut shaker = PwmShaker::new(Pwm { max: 1_000, duty: 7 }, Pin(false), 1_000);
        for y in [1_001, -1_001, i32::MAX, i32::MIN] {
            assert_eq!(shaker.write(y), Err(PwmShakerError::BeyondFullScale(y)));
        }
        assert_eq!(shaker.pwm.duty, 7);
    }

    #[test]
    fn the_enable_pin_follows() {
        let mut shaker = PwmShaker::new(Pwm { max: 1_000, duty: 7 }, Pin(false), 1_000);
        shaker.enable(true).unwrap();
        assert!(shaker.enable.0);
        shaker.enable(false).unwrap();
        assert!(!shaker.enable.0);
    }

    #[test]
    fn a_borrowed_output_does_what_the_output_does() {
        let mut recorder = Recorder::default();
        let mut borrowed = &mut recorder;
        ShakerOutput::enable(&mut borrowed, true).unwrap();
        ShakerOutput::write(&mut borrowed, 5).unwrap();
        // Without a clock of its own the base stands where the tick is.
        let sweep = Sweep { phase: 0, phase_increment: 1 << 30, amplitude_nanometre: [700, 900], ..Sweep::default() };
        ShakerOutput::sweep(&mut borrowed, &sweep).unwrap();
        assert_eq!((recorder.enabled, &recorder.writes[..]), (true, &[5, 700][..]));
        recorder.fail_write = true;
        assert!(ShakerOutput::sweep(&mut &mut recorder, &sweep).is_err());
    }
}
