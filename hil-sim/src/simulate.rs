//! Samples of a simulated rig straight from the plant, without firmware or link.
//!
//! The counts are those that the virtual rig gives for the same plant once it runs steadily: the
//! phase advances by the device's integer increment, the amplitude is the device's whole
//! nanometres, and the plant takes the same steps. The drive runs at full amplitude from the start
//! of the settling time. Tick 0 is the record's first sample; settling has negative times.
//!
//! The seed perturbs the initial state: uniformly by up to [`ANGLE_SPREAD`] in both angles and
//! [`RATE_SPREAD`] in both rates (ChaCha8, in the order φ1, φ2, φ̇1, φ̇2). After some tens of drive
//! periods of chaos histories of different seeds are independent.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::base_sensor::{BaseSensor, BaseSettings};
use crate::bench::{Bench, BenchSettings, SecondEncoder};
use crate::encoder::count_of;
use crate::error::SimulationError;
use crate::plant::effects::{self, Effect, EffectError};
use crate::plant::{Additions, ParameterError, Parameters, Plant, State, TOLERANCE};
use crate::shaker::{Command, Direction, phase_increment};

/// Greatest perturbation of an initial angle, rad.
pub const ANGLE_SPREAD: f64 = 0.05;
/// Greatest perturbation of an initial rate, rad/s.
pub const RATE_SPREAD: f64 = 0.5;
/// Longest settling time, s.
pub const SETTLE_MAX_S: f64 = 3600.0;

/// Harmonic motion of the base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveSettings {
    /// Direction.
    pub direction: Direction,
    /// Frequency, Hz; rounded to the device's phase increment.
    pub frequency_hz: f64,
    /// Amplitude, m; rounded to whole nanometres.
    pub amplitude_m: f64,
    /// Lag ψ of the base behind the recorded phase, rad.
    pub psi: f64,
}

/// Settings of a simulation.
#[derive(Clone, Debug)]
pub struct SimulationSettings {
    /// The nominal rig.
    pub parameters: Parameters,
    /// Motion of the base; `None` for a free system.
    pub drive: Option<DriveSettings>,
    /// Counts a turn of each encoder.
    pub counts_per_turn: [u32; 2],
    /// What encoder 2 is fixed to.
    pub second: SecondEncoder,
    /// The sensor of the base's motion, where there is one.
    pub base: Option<BaseSettings>,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// φ1, φ2 (rad), φ̇1, φ̇2 (rad/s) before settling.
    pub initial: State,
    /// The recorded phase before settling, turns · 2⁻³².
    pub initial_phase: u32,
    /// Time simulated before the first sample, s; rounded to whole ticks.
    pub settle_s: f64,
    /// Length of the record, s: what an amplitude drift refers to.
    pub record_s: f64,
    /// Effects beside the nominal model.
    pub effects: Vec<Effect>,
    /// Perturbs `initial`; `None` leaves it as it is.
    pub seed: Option<u64>,
    /// Tolerance of the integration, rad and rad/s.
    pub tolerance: f64,
}

impl Default for SimulationSettings {
    /// The chaotic preset: the printed rig at 1.35 times the amplitude, 500 Hz, 4096 counts, 120 s,
    /// seed 1.
    fn default() -> Self {
        Self {
            parameters: Parameters::PRINTED,
            drive: Some(DriveSettings {
                direction: Direction::Vertical,
                frequency_hz: 5.0,
                amplitude_m: 0.015_525,
                psi: 0.0,
            }),
            counts_per_turn: [4096; 2],
            second: SecondEncoder::Relative,
            base: None,
            sample_rate_hz: 500.0,
            initial: [0.3, 2.0, 0.0, 0.0],
            initial_phase: 0,
            settle_s: 20.0,
            record_s: 120.0,
            effects: Vec::new(),
            seed: Some(1),
            tolerance: TOLERANCE,
        }
    }
}

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Ticks since the record's first sample.
    pub tick: i64,
    /// Counts of both encoders, multi-turn, wrapping at 2³² as the device's do.
    pub counts: [i32; 2],
    /// Counts of the base's sensor; 0 where there is none.
    pub base: i32,
    /// Recorded phase of the drive, turns · 2⁻³²; 0 where there is none.
    pub phase: u32,
    /// Amplitude of the base, nm; 0 where there is no drive.
    pub amplitude_nanometre: u32,
    /// The angles that were rounded to `counts`, the encoders' errors included, rad.
    pub angles: [f64; 2],
}

/// A rig that is being simulated.
#[derive(Clone, Debug)]
pub struct Simulation {
    bench: Bench,
    command: Command,
    counts_per_turn: [u32; 2],
    base: Option<BaseSensor>,
    tick_s: f64,
    /// Tick at which the plant is.
    plant_tick: i64,
}

fn check(name: &str, value: f64, range: core::ops::RangeInclusive<f64>, unit: &str) -> Result<(), ParameterError> {
    if range.contains(&value) {
        return Ok(());
    }
    let expected = format!("{} to {} {unit}", range.start(), range.end());
    Err(ParameterError::new(name, value, expected.trim_end()))
}

/// The effects' sum, checked against the rig's drive.
pub(crate) fn additions(effects: &[Effect], drive: Option<&DriveSettings>) -> Result<Additions, EffectError> {
    let additions = effects::combine(effects)?;
    for effect in effects.iter().filter(|effect| effect.place == effects::Place::Drive) {
        let refused = |found: &str, expected: &str| Err(EffectError::new(&effect.to_string(), found, expected));
        match drive {
            None => return refused("a rig without a drive", "a rig with [drive]"),
            Some(drive) => match (additions.drive.across_is_horizontal, drive.direction) {
                (Some(true), Direction::Horizontal) => {
                    return refused("a horizontal drive", "a vertical one (across a horizontal one: vertical-motion)");
                }
                (Some(false), Direction::Vertical) => {
                    return refused("a vertical drive", "a horizontal one (across a vertical one: horizontal-motion)");
                }
                _ => {}
            },
        }
    }
    Ok(additions)
}

/// The state that a seed makes of an initial one.
pub fn perturbed(initial: State, seed: u64) -> State {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let spread = [ANGLE_SPREAD, ANGLE_SPREAD, RATE_SPREAD, RATE_SPREAD];
    let mut state = initial;
    for (value, spread) in state.iter_mut().zip(spread) {
        // 53 random bits in [−1, 1).
        let unit = (random.next_u64() >> 11) as f64 / 4_503_599_627_370_496.0 - 1.0;
        *value += spread * unit;
    }
    state
}

impl Simulation {
    /// Sets the rig up and lets it settle.
    ///
    /// # Errors
    /// A parameter, setting or effect that cannot be, with its name, value and what is expected; a
    /// plant that cannot be integrated through the settling time.
    pub fn new(settings: &SimulationSettings) -> Result<Self, SimulationError> {
        let rate = settings.sample_rate_hz;
        check("sample_rate_hz", rate, 1.0..=1e5, "Hz")?;
        check("settle_s", settings.settle_s, 0.0..=SETTLE_MAX_S, "s")?;
        check("record_s", settings.record_s, 0.0..=1e9, "s")?;
        for n in settings.counts_per_turn {
            check("counts_per_turn", f64::from(n), 1.0..=1_048_576.0, "")?;
        }
        settings.base.as_ref().map_or(Ok(()), BaseSettings::validate)?;
        let additions = additions(&settings.effects, settings.drive.as_ref())?;
        let mut command = Command { phase: 0, phase_increment: 0, amplitude_nanometre: [0; 2], ..Command::default() };
        if let Some(drive) = &settings.drive {
            check("amplitude_m", drive.amplitude_m, 0.0..=2.0, "m")?;
            check("phase_rad", drive.psi, -1e3..=1e3, "rad")?;
            let increment = phase_increment(drive.frequency_hz, rate).ok_or_else(|| {
                ParameterError::new("frequency_hz", drive.frequency_hz, "above 0 and below half the sampling rate")
            })?;
            let offset = additions.drive.frequency_offset_hz;
            if drive.frequency_hz + offset <= 0.0 {
                let error =
                    EffectError::new("frequency-offset", &offset.to_string(), "a base that still moves forward");
                return Err(error.into());
            }
            let amplitude = (drive.amplitude_m * 1e9).round() as u32;
            command = Command {
                phase: settings.initial_phase,
                phase_increment: increment,
                amplitude_nanometre: [amplitude; 2],
                ..Command::default()
            };
        }
        let initial = settings.seed.map_or(settings.initial, |seed| perturbed(settings.initial, seed));
        let tick_s = 1.0 / rate;
        let bench = Bench::new(&BenchSettings {
            parameters: settings.parameters,
            additions,
            direction: settings.drive.map(|drive| drive.direction).unwrap_or_default(),
            psi: settings.drive.map_or(0.0, |drive| drive.psi),
            record_s: settings.record_s,
            initial,
            tick_s,
            tolerance: settings.tolerance,
            second: settings.second,
        })?;
        let settle_ticks = (settings.settle_s * rate).round() as i64;
        let mut simulation = Self {
            bench,
            command,
            counts_per_turn: settings.counts_per_turn,
            base: settings.base.map(BaseSensor::new),
            tick_s,
            plant_tick: -settle_ticks,
        };
        for _ in 0..settle_ticks + i64::from(simulation.bench.lead()) {
            simulation.advance()?;
        }
        Ok(simulation)
    }

    fn advance(&mut self) -> Result<(), SimulationError> {
        self.bench.advance(self.command, self.plant_tick as f64 * self.tick_s)?;
        self.command.phase = self.command.phase.wrapping_add(self.command.phase_increment);
        self.plant_tick += 1;
        Ok(())
    }

    /// The present sample, before the rig moves on to the next tick.
    ///
    /// # Errors
    /// A plant that cannot be integrated further.
    pub fn next_sample(&mut self) -> Result<Sample, SimulationError> {
        let lead = self.bench.lead();
        let angles = self.bench.shown();
        let base = self.base.as_mut().map_or(0, |sensor| {
            sensor.measure(self.bench.base());
            sensor.counts()
        });
        let sample = Sample {
            tick: self.plant_tick - i64::from(lead),
            // Casts to 32 bits wrap, as the device's counts do.
            counts: [0, 1].map(|i| count_of(angles[i], self.counts_per_turn[i]) as i32),
            base,
            phase: self.command.phase.wrapping_sub(self.command.phase_increment.wrapping_mul(lead)),
            amplitude_nanometre: self.command.amplitude_nanometre[0],
            angles,
        };
        self.advance()?;
        Ok(sample)
    }

    /// The plant, for truths such as its state.
    pub fn plant(&self) -> &Plant {
        self.bench.plant()
    }
}

#[cfg(test)]
mod tests;
