//! What the firmware of a virtual rig is wired to, and what moves.

use whirl_firmware::app::{BLOCKS, EVENTS, REQUESTS};
use whirl_firmware::base::BaseInput;
use whirl_firmware::inputs::Latched;
use whirl_firmware::{App, Inputs, QuadratureCounter, ShakerOutput};

use crate::base_sensor::BaseSensor;
use crate::bench::Bench;
use crate::encoder::Encoder;
use crate::error::SimulationError;
use crate::shaker::Command;

/// The shaker's power stage: remembers, and fails or is cut off on request.
#[derive(Clone, Debug, Default)]
pub(super) struct PowerStage {
    pub(super) broken: bool,
    pub(super) cut: bool,
    pub(super) triggered: bool,
    pub(super) trigger: bool,
    pub(super) written: i32,
}

impl ShakerOutput for PowerStage {
    type Error = ();

    fn write(&mut self, displacement_nanometre: i32) -> Result<(), Self::Error> {
        self.written = displacement_nanometre;
        if self.broken { Err(()) } else { Ok(()) }
    }

    fn is_cut(&mut self) -> bool {
        self.cut
    }

    fn is_triggered(&mut self) -> bool {
        self.triggered
    }

    fn trigger(&mut self, on: bool) {
        self.trigger = on;
    }
}

/// The device, with its blocks in memory of its own.
pub(super) type Device = App<Wired, PowerStage, BLOCKS, EVENTS, REQUESTS, Vec<u8>>;

/// What is wired to it.
#[derive(Clone, Debug)]
pub(super) struct Wired {
    pub(super) encoders: Vec<Encoder>,
    pub(super) base: Option<BaseSensor>,
}

impl Inputs for Wired {
    const BASE: bool = true;

    fn encoders(&self) -> usize {
        self.encoders.len()
    }

    fn latch(&mut self, into: &mut Latched) {
        for (place, encoder) in into.0.iter_mut().zip(&mut self.encoders) {
            *place = encoder.count();
        }
    }

    fn index(&mut self, encoder: usize) -> Option<u16> {
        self.encoders.get_mut(encoder)?.index()
    }

    fn latch_base(&mut self) -> u16 {
        self.base.latch()
    }
}

/// What turns the encoders of a virtual rig in the place of this crate's double pendulum: another
/// system, which the shaker does not move.
pub trait Arms: core::fmt::Debug + Send {
    /// Moves on by one tick.
    ///
    /// # Errors
    /// A motion that cannot be followed further.
    fn advance(&mut self) -> Result<(), SimulationError>;

    /// The angles at the encoders now, rad: as many as the device has encoders.
    fn angles(&self) -> &[f64];
}

/// What moves.
#[derive(Debug)]
pub(super) enum Moving {
    Bench(Box<Bench>),
    Arms(Box<dyn Arms>),
}

impl Moving {
    pub(super) fn advance(&mut self, command: Command, time_s: f64) -> Result<(), SimulationError> {
        match self {
            Self::Bench(bench) => bench.advance(command, time_s),
            Self::Arms(arms) => arms.advance(),
        }
    }

    /// Turns the encoders, and shows the base.
    pub(super) fn show(&self, wired: &mut Wired) {
        match self {
            Self::Bench(bench) => {
                for (encoder, angle) in wired.encoders.iter_mut().zip(bench.shown()) {
                    encoder.turn_to(angle);
                }
                if let Some(sensor) = &mut wired.base {
                    sensor.measure(bench.base());
                }
            }
            Self::Arms(arms) => {
                for (encoder, angle) in wired.encoders.iter_mut().zip(arms.angles()) {
                    encoder.turn_to(*angle);
                }
            }
        }
    }
}
