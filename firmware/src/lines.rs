//! Lines beside the shaker's set point: the emergency stop, the trigger.

use embedded_hal::digital::{InputPin, OutputPin, PinState};

use crate::output::ShakerOutput;
use crate::sweep::Sweep;

/// Three pins. Inputs are pulled up, so that what is not connected neither stops nor starts
/// anything; one that cannot be read counts as a cut line, and as no trigger.
///
/// The emergency stop is a contact between the enable pin and the amplifier, which a resistor pulls
/// to ground: opened, it switches the amplifier off whatever the firmware does. The input sees the
/// line behind the contact.
#[derive(Debug)]
pub struct Pins<S, I, T> {
    /// The enable line behind the emergency stop.
    pub enabled: S,
    /// Trigger input, active low: a contact to ground.
    pub start: I,
    /// Trigger output, active high.
    pub moving: T,
}

/// An output with an enable pin, and these three.
#[derive(Debug)]
pub struct WithLines<O, S, I, T> {
    output: O,
    pins: Pins<S, I, T>,
    /// The enable pin is high.
    on: bool,
}

impl<O: ShakerOutput, S: InputPin, I: InputPin, T: OutputPin> WithLines<O, S, I, T> {
    /// The output's amplifier is off.
    pub const fn new(output: O, pins: Pins<S, I, T>) -> Self {
        Self { output, pins, on: false }
    }
}

impl<O: ShakerOutput, S: InputPin, I: InputPin, T: OutputPin> ShakerOutput for WithLines<O, S, I, T> {
    type Error = O::Error;

    fn write(&mut self, displacement_nanometre: i32) -> Result<(), Self::Error> {
        self.output.write(displacement_nanometre)
    }

    fn sweep(&mut self, sweep: &Sweep<'_>) -> Result<(), Self::Error> {
        self.output.sweep(sweep)
    }

    fn enable(&mut self, on: bool) -> Result<(), Self::Error> {
        self.on = on;
        self.output.enable(on)
    }

    fn is_cut(&mut self) -> bool {
        // What is off anyway tells nothing of the contact.
        self.on && self.pins.enabled.is_low().unwrap_or(true)
    }

    fn is_triggered(&mut self) -> bool {
        self.pins.start.is_low().unwrap_or(false)
    }

    fn trigger(&mut self, on: bool) {
        // A line for other instruments: one that fails must not stop the shaker.
        let _ = self.pins.moving.set_state(PinState::from(on));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dac::{Converter, DacShaker};
    use core::convert::Infallible;
    use std::cell::Cell;
    use std::rc::Rc;

    /// A line that several pins are on.
    #[derive(Clone)]
    struct Line(Rc<Cell<bool>>);

    impl embedded_hal::digital::ErrorType for Line {
        type Error = Infallible;
    }

    impl InputPin for Line {
        fn is_high(&mut self) -> Result<bool, Infallible> {
            Ok(self.0.get())
        }
        fn is_low(&mut self) -> Result<bool, Infallible> {
            Ok(!self.0.get())
        }
    }

    impl OutputPin for Line {
        fn set_low(&mut self) -> Result<(), Infallible> {
            self.0.set(false);
            Ok(())
        }
        fn set_high(&mut self) -> Result<(), Infallible> {
            self.0.set(true);
            Ok(())
        }
    }

    struct Dac;

    impl Converter for Dac {
        const MAX: u16 = 4_095;
        fn set(&mut self, _: u16) {}
    }

    #[test]
    fn a_cut_line_is_seen_while_it_is_driven_and_nothing_connected_does_nothing() {
        let line = |high| Line(Rc::new(Cell::new(high)));
        let (enable, behind, start, moving) = (line(false), line(true), line(true), line(false));
        let pins = Pins { enabled: behind.clone(), start: start.clone(), moving: moving.clone() };
        let mut shaker = WithLines::new(DacShaker::new(Dac, enable.clone(), 1_000), pins);
        // Pulled up.
        assert!(!shaker.is_cut() && !shaker.is_triggered());
        shaker.enable(true).unwrap();
        assert!(!shaker.is_cut() && enable.0.get());
        behind.0.set(false);
        assert!(shaker.is_cut());
        // What is off anyway tells nothing of the contact.
        shaker.enable(false).unwrap();
        assert!(!shaker.is_cut());
        start.0.set(false);
        assert!(shaker.is_triggered());
        shaker.trigger(true);
        assert!(moving.0.get());
        shaker.trigger(false);
        assert!(!moving.0.get());
        let mut without = DacShaker::new(Dac, enable, 1_000);
        without.enable(true).unwrap();
        assert!(!without.is_cut() && !without.is_triggered());
    }
}
