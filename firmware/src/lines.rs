//! Lines beside the shaker's set point: the emergency stop, the trigger.

use embedded_hal::digital::{InputPin, OutputPin, PinState};

/// What an output asks and drives at every tick.
pub trait Lines {
    /// Whether the amplifier's enable line is low behind the emergency stop. Asked while it is
    /// driven high.
    fn is_cut(&mut self) -> bool {
        false
    }

    /// Whether the trigger input is active.
    fn is_triggered(&mut self) -> bool {
        false
    }

    /// Drives the trigger output.
    fn trigger(&mut self, on: bool) {
        let _ = on;
    }
}

/// No such lines.
impl Lines for () {}

/// Three pins. Inputs are pulled up, so that what is not connected neither stops nor starts
/// anything; one that cannot be read counts as a cut line, and as no trigger.
///
/// The emergency stop is a contact between the enable pin and the amplifier, which a resistor pulls
/// to ground: opened, it switches the amplifier off whatever the firmware does. The input sees the
/// line behind the contact.
#[derive(Debug)]
pub struct Pins<S, I, O> {
    /// The enable line behind the emergency stop.
    pub enabled: S,
    /// Trigger input, active low: a contact to ground.
    pub start: I,
    /// Trigger output, active high.
    pub moving: O,
}

impl<S: InputPin, I: InputPin, O: OutputPin> Lines for Pins<S, I, O> {
    fn is_cut(&mut self) -> bool {
        self.enabled.is_low().unwrap_or(true)
    }

    fn is_triggered(&mut self) -> bool {
        self.start.is_low().unwrap_or(false)
    }

    fn trigger(&mut self, on: bool) {
        // A line for other instruments: one that fails must not stop the shaker.
        let _ = self.moving.set_state(PinState::from(on));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dac::{Converter, DacShaker};
    use crate::output::ShakerOutput;
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
        let mut shaker = DacShaker::new(Dac, enable.clone(), 1_000).with_lines(pins);
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
