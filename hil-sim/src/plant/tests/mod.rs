//! Tests of the plant against solutions and balances that do not come from its own code.

mod analytic;
mod balance;
mod effect_laws;
mod memory;
mod sticking;

use super::effects::{Effect, combine};
use super::*;
use crate::shaker::{BaseMotion, Command, Shaker, phase_increment};

const TICK: f64 = 0.002;

fn frictionless() -> Parameters {
    Parameters { tau_c1: 0.0, c_r2: 0.0, ..Parameters::PRINTED }
}

fn plant(parameters: &Parameters, effects: &[&str], state: State) -> Plant {
    let effects: Vec<Effect> = effects.iter().map(|text| Effect::parse(text).unwrap()).collect();
    Plant::new(parameters, &combine(&effects).unwrap(), state, TOLERANCE).unwrap()
}

/// A shaker at 5 Hz, tick by tick.
struct Drive {
    shaker: Shaker,
    command: Command,
}

impl Drive {
    fn new(amplitude_m: f64) -> Self {
        let amplitude = (amplitude_m * 1e9) as u32;
        let phase_increment = phase_increment(5.0, 1.0 / TICK).unwrap();
        Self {
            shaker: Shaker::default(),
            command: Command { phase: 0, phase_increment, amplitude_nanometre: [amplitude; 2], ..Command::default() },
        }
    }

    fn next(&mut self) -> BaseMotion {
        let motion = self.shaker.motion(self.command, 0.0, TICK);
        self.command.phase = self.command.phase.wrapping_add(self.command.phase_increment);
        motion
    }
}
