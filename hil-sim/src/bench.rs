//! Plant, shaker and encoders' errors together, one tick at a time: what the direct simulation and
//! the virtual rig share. Both take the same steps, so that from the same state under the same
//! drive they give the same counts.
//!
//! A channel delay d = k T + r (0 ≤ r < T the tick) is kept by ending an integration step r before
//! each tick and holding the angles of k ticks. A negative delay holds encoder 1 back instead: the
//! bench then runs [`Bench::lead`] ticks ahead.

use std::collections::VecDeque;

use crate::error::SimulationError;
use crate::plant::{Additions, Parameters, Plant, SensorLaw, State};
use crate::shaker::{Command, Direction, Shaker};

/// What encoder 2 is fixed to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SecondEncoder {
    /// On arm 1: θ2 = φ2 − φ1.
    #[default]
    Relative,
    /// On the frame: φ2.
    Absolute,
}

/// Settings of a bench.
#[derive(Clone, Debug)]
pub(crate) struct BenchSettings {
    pub(crate) parameters: Parameters,
    pub(crate) additions: Additions,
    pub(crate) direction: Direction,
    pub(crate) psi: f64,
    pub(crate) record_s: f64,
    pub(crate) initial: State,
    pub(crate) tick_s: f64,
    pub(crate) tolerance: f64,
    pub(crate) second: SecondEncoder,
}

/// Several clocks that are fast add up to no clock that stands.
const LEAST_CLOCK: f64 = -0.9;

/// Plant, shaker and encoders.
#[derive(Clone, Debug)]
pub(crate) struct Bench {
    plant: Plant,
    shaker: Shaker,
    sensors: [Vec<SensorLaw>; 2],
    second: SecondEncoder,
    tick_s: f64,
    /// Part of the delay within a tick, s.
    within_tick: f64,
    /// Angles that wait to be shown; the front is shown now.
    held: [VecDeque<f64>; 2],
    /// The same of the base: displacement (m) and acceleration (m/s²) along the drive.
    held_base: VecDeque<[f64; 2]>,
    lead: u32,
    /// Share of the record that is over at the tick that the encoders show; nothing before it begins.
    share: f64,
}

impl Bench {
    pub(crate) fn new(settings: &BenchSettings) -> Result<Self, SimulationError> {
        let plant = Plant::new(&settings.parameters, &settings.additions, settings.initial, settings.tolerance)?;
        // As long as it lasts, not as long as the record says.
        let tick_s = settings.tick_s * (1.0 + settings.additions.clock.max(LEAST_CLOCK));
        let ticks = settings.additions.delay_s / tick_s;
        let whole = ticks.floor();
        let within_tick = settings.additions.delay_s - whole * tick_s;
        // Delays are at most half a second and rates at most 100 kHz.
        let whole = whole as i64;
        let lead = u32::try_from(-whole).unwrap_or(0);
        let mut bench = Self {
            plant,
            shaker: Shaker {
                direction: settings.direction,
                psi: settings.psi,
                additions: settings.additions.drive.clone(),
                record_s: settings.record_s,
            },
            sensors: settings.additions.sensors.clone(),
            second: settings.second,
            tick_s,
            within_tick,
            held: [VecDeque::new(), VecDeque::new()],
            held_base: (0..=lead).map(|_| [0.0; 2]).collect(),
            lead,
            share: 0.0,
        };
        // Before the start the arms are taken to have been at rest.
        let [theta1, theta2] = bench.angles();
        bench.held[0] = (0..=lead).map(|_| theta1).collect();
        bench.held[1] = (0..=whole.max(0)).map(|_| theta2).collect();
        Ok(bench)
    }

    /// True angles at the encoders now.
    fn angles(&self) -> [f64; 2] {
        let state = self.plant.state();
        match self.second {
            SecondEncoder::Relative => [state[0], state[1] - state[0]],
            SecondEncoder::Absolute => [state[0], state[1]],
        }
    }

    /// Ticks by which the plant is ahead of what is shown.
    pub(crate) fn lead(&self) -> u32 {
        self.lead
    }

    /// Angles that the encoders show, before rounding, rad.
    pub(crate) fn shown(&self) -> [f64; 2] {
        [0, 1].map(|i| {
            let angle = self.held[i].front().copied().unwrap_or(0.0);
            self.sensors[i].iter().fold(angle, |angle, law| law.shown(angle, self.share))
        })
    }

    /// Displacement (m) and acceleration (m/s²) of the base along the drive, at the tick that the
    /// encoders show.
    pub(crate) fn base(&self) -> [f64; 2] {
        self.held_base.front().copied().unwrap_or_default()
    }

    /// Moves on by one tick, from `time_s` of the record.
    pub(crate) fn advance(&mut self, command: Command, time_s: f64) -> Result<(), SimulationError> {
        let motion = self.shaker.motion(command, time_s, self.tick_s);
        let failed = |error| SimulationError::Integration { time_s, error };
        let delayed = if self.within_tick > 0.0 {
            let first = self.tick_s - self.within_tick;
            self.plant.advance(&motion, first).map_err(failed)?;
            let delayed = self.angles()[1];
            self.plant.advance(&motion.later(first), self.within_tick).map_err(failed)?;
            delayed
        } else {
            self.plant.advance(&motion, self.tick_s).map_err(failed)?;
            self.angles()[1]
        };
        let along = usize::from(self.shaker.direction == Direction::Vertical);
        self.held_base.push_back([motion.displacement(self.tick_s)[along], motion.acceleration(self.tick_s)[along]]);
        self.held_base.pop_front();
        let shown = [self.angles()[0], delayed];
        for (held, angle) in self.held.iter_mut().zip(shown) {
            held.push_back(angle);
            held.pop_front();
        }
        let shown_s = time_s + self.tick_s * (1.0 - f64::from(self.lead));
        let record_s = self.shaker.record_s;
        self.share = if record_s > 0.0 { shown_s.max(0.0) / record_s } else { 0.0 };
        Ok(())
    }

    pub(crate) fn plant(&self) -> &Plant {
        &self.plant
    }
}
