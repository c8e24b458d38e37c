//! The plant at the other end of an emulated board's pipes: one [`Request`] in, both counters and
//! the base's input out.

use whirl_firmware::QuadratureCounter;
use whirl_firmware::base::BaseInput;
use whirl_firmware::lock_step::Request;

use crate::base_sensor::BaseSensor;
use crate::bench::Bench;
use crate::encoder::Encoder;
use crate::error::SimulationError;
use crate::shaker::{Command, CommandShape};
use crate::virtual_rig::{RigSettings, bench_of, tick_s, two_encoders};

/// Plant and encoders, moved by the board's requests.
#[derive(Debug)]
pub struct EmulatedPlant {
    bench: Bench,
    encoders: (Encoder, Encoder),
    base: Option<BaseSensor>,
    tick_s: f64,
    /// Ticks that the plant has moved on.
    ticks: u64,
    command: Command,
    shape: CommandShape,
    amplifier_on: bool,
}

impl EmulatedPlant {
    /// A plant at power-on. Of the device's settings those of the image count; here are only its
    /// rate and its encoders.
    ///
    /// # Errors
    /// As [`crate::VirtualRig::new`].
    pub fn new(settings: &RigSettings) -> Result<Self, SimulationError> {
        let bench = bench_of(settings)?;
        let shown = bench.shown();
        let encoders = two_encoders(&settings.device, shown)?;
        Ok(Self {
            bench,
            encoders,
            base: settings.base.map(BaseSensor::new),
            tick_s: tick_s(&settings.device),
            ticks: 0,
            command: Command::default(),
            shape: CommandShape::default(),
            amplifier_on: false,
        })
    }

    /// Moves on to the request's tick, under the drive of the tick before it; ticks that the board
    /// has missed go by under the phase that runs on. Both counters as they then stand, and the
    /// base's input.
    ///
    /// # Errors
    /// A request that contradicts itself or the one before; a plant that cannot be integrated
    /// further.
    pub fn exchange(&mut self, request: &Request) -> Result<([u16; 2], u16), SimulationError> {
        let refused = |problem: &str| SimulationError::Board { tick: request.tick, problem: problem.to_owned() };
        if u64::from(request.tick) < self.ticks {
            return Err(refused("it went back in time"));
        }
        let amplitude = request.amplitude_nanometre;
        // At the tick at which it is cut off it still tells of the amplitude that it had.
        if !request.amplifier_on && !self.amplifier_on && amplitude != 0 {
            return Err(refused("it tells of an amplitude with the shaker's amplifier off"));
        }
        self.amplifier_on = request.amplifier_on;
        let moving = request.amplifier_on && request.phase_increment != 0;
        if moving && request.displacement_nanometre != self.shape.displacement(amplitude, request.phase) {
            return Err(refused("what stands at the shaker's output is not what its phase, amplitude and shape say"));
        }
        let previous = self.command.amplitude_nanometre[1];
        self.command = Command {
            phase: request.phase,
            phase_increment: request.phase_increment,
            increment_before: self.command.phase_increment,
            amplitude_nanometre: [previous, request.amplitude_nanometre],
            shape: self.shape,
        };
        while self.ticks < u64::from(request.tick) {
            self.bench.advance(self.command, self.ticks as f64 * self.tick_s)?;
            self.ticks += 1;
            // A board that misses ticks leaves a waveform that goes on by itself.
            self.command.phase = self.command.phase.wrapping_add(self.command.phase_increment);
            self.command.increment_before = self.command.phase_increment;
            self.command.amplitude_nanometre[0] = self.command.amplitude_nanometre[1];
        }
        let shown = self.bench.shown();
        let (first, second) = &mut self.encoders;
        first.turn_to(shown[0]);
        second.turn_to(shown[1]);
        if let Some(sensor) = &mut self.base {
            sensor.measure(self.bench.base());
        }
        Ok(([first.count(), second.count()], self.base.latch()))
    }

    /// The drive's shape is another one from the next request on.
    pub fn reshape(&mut self, shape: CommandShape) {
        self.shape = shape;
    }

    /// The board's chip was reset: its counters begin at 0, the shaker is off, the arms go on.
    pub fn reset(&mut self) {
        self.encoders.0.reset();
        self.encoders.1.reset();
        self.command = Command::default();
        self.shape = CommandShape::default();
        self.amplifier_on = false;
    }

    /// Ticks that the plant has moved on.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VirtualRig;
    use whirl_shared::excitation::{Component, Form};

    #[test]
    fn it_moves_as_the_virtual_rig_s_plant_does() {
        let settings = RigSettings::default();
        let mut rig = VirtualRig::new(&settings).unwrap();
        let mut plant = EmulatedPlant::new(&settings).unwrap();
        for tick in 0..500 {
            let (counts, _) = plant.exchange(&Request { tick, ..Request::default() }).unwrap();
            rig.step().unwrap();
            let streamed = rig.status().tick;
            assert_eq!(streamed, tick + 1);
            if tick == 499 {
                // The rig's plant is one tick ahead.
                assert_eq!(plant.ticks(), 499);
                assert_ne!(counts, [0, 0]);
            }
        }
        plant.exchange(&Request { tick: 500, ..Request::default() }).unwrap();
        assert_eq!(plant.bench.plant().state(), rig.plant().unwrap().state());
    }

    #[test]
    fn a_board_that_contradicts_itself_is_refused() {
        let mut plant = EmulatedPlant::new(&RigSettings::default()).unwrap();
        plant.exchange(&Request { tick: 5, ..Request::default() }).unwrap();
        for (request, part) in [
            (Request { tick: 3, ..Request::default() }, "back in time"),
            (Request { tick: 6, amplitude_nanometre: 1, ..Request::default() }, "amplifier off"),
            (
                Request {
                    tick: 6,
                    amplitude_nanometre: 9_000,
                    phase_increment: 1,
                    amplifier_on: true,
                    displacement_nanometre: 7,
                    ..Request::default()
                },
                "shaker's output",
            ),
        ] {
            let error = plant.exchange(&request).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn a_shape_is_what_the_board_has_told_until_it_is_reset() {
        let mut form = Form::SINE;
        form.0[0].share = 9_000;
        form.0[1] = Component { harmonic: 3, share: 9_000, phase: 77 };
        let mut plant = EmulatedPlant::new(&RigSettings::default()).unwrap();
        let (phase, amplitude_nanometre) = (1 << 29, 9_000_000);
        let mut tick = 0;
        let mut stands = |plant: &mut EmulatedPlant, displacement_nanometre| {
            tick += 1;
            plant.exchange(&Request {
                tick,
                phase,
                phase_increment: 1 << 20,
                amplitude_nanometre,
                displacement_nanometre,
                amplifier_on: true,
                ..Request::default()
            })
        };
        let (sine, sum) =
            (Form::SINE.displacement(amplitude_nanometre, phase), form.displacement(amplitude_nanometre, phase));
        assert!(stands(&mut plant, sine).is_ok() && stands(&mut plant, sum).is_err());
        plant.reshape(CommandShape::Sines(form));
        assert!(stands(&mut plant, sum).is_ok() && stands(&mut plant, sine).is_err());
        assert_eq!(plant.command.shape, CommandShape::Sines(form));
        plant.reset();
        assert!(stands(&mut plant, sine).is_ok());
    }
}
