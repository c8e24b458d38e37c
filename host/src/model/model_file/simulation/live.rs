//! A system that a user wrote down as what turns the encoders of a simulated device: from
//! `[plant]`'s initial state on, for as long as it is asked to.

use std::collections::VecDeque;
use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use whirl_hil_sim::{Arms, SimulationError};

use super::plant::Plant;
use super::{FINEST, Surroundings, TOLERANCE, shown};
use crate::error::{BadInput, Result};
use crate::model::integrate::{Settings, solve};
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;

/// Samples that are integrated at once.
const AHEAD: usize = 256;
/// Greatest perturbation of an initial coordinate by a seed, as of the built-in rigs: rad or m.
const SPREAD: f64 = 0.05;

/// The system.
pub struct Live {
    motion: EquationsOfMotion,
    coefficients: Vec<f64>,
    bound: Arc<ObservedModel>,
    step_s: f64,
    /// The state of the newest sample that was integrated.
    state: Vec<f64>,
    /// What the sensors show at the samples to come; the front is now.
    angles: VecDeque<Vec<f64>>,
}

impl core::fmt::Debug for Live {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Live").field("state", &self.state).finish_non_exhaustive()
    }
}

impl Live {
    /// The system of a rig, its coordinates perturbed by a seed.
    ///
    /// # Errors
    /// One that inputs or the drive's phase move, which a device here does not give; a plant that
    /// is missing; equations that cannot be integrated.
    pub fn of(rig: &Rig, bound: &Arc<ObservedModel>, seed: Option<u64>) -> Result<Self> {
        let model = &*bound.model;
        if !model.inputs.is_empty() || model.uses_phase() {
            return Err(BadInput::new(
                "a system that a drive or measured inputs move",
                "a free one, or a built-in pendulum",
            )
            .in_file(&rig.path)
            .at("model")
            .remedy("`whirl simulate` simulates it; a simulated device moves the built-in pendulums' base alone"));
        }
        let plant = Plant::of(rig, model, 1.0, seed.unwrap_or(0))?;
        let motion = EquationsOfMotion::new(model, rig.omega())?;
        let mut initial = plant.initial.clone();
        if let Some(seed) = seed {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let n = model.coordinates.len();
            initial.iter_mut().take(n).for_each(|q| *q += SPREAD * (2.0 * random.random::<f64>() - 1.0));
        }
        let mut live = Self {
            state: motion.with_states(&initial, &[]),
            coefficients: plant.coefficients.clone(),
            motion,
            bound: bound.clone(),
            step_s: 1.0 / rig.sample_rate_hz,
            angles: VecDeque::new(),
        };
        live.angles.push_back(live.shown(&live.state));
        live.go_on().map_err(|e| BadInput::new(e.to_string(), "").in_file(&rig.path).at("[plant]"))?;
        Ok(live)
    }

    fn shown(&self, state: &[f64]) -> Vec<f64> {
        (0..self.bound.sensors.len()).map(|row| shown(&self.bound, row, state)).collect()
    }

    /// Integrates the next samples.
    fn go_on(&mut self) -> core::result::Result<(), SimulationError> {
        let nothing = Surroundings { inputs: Vec::new(), omega: 0.0, advances: Vec::new() };
        let settings = Settings {
            start_s: 0.0,
            step_s: self.step_s,
            count: AHEAD + 1,
            tolerance: TOLERANCE,
            inputs: 0,
            finest: FINEST,
        };
        let states = solve(&self.motion, &self.coefficients, &self.state, &nothing, &settings);
        let Some((states, last)) = states.and_then(|s| s.last().cloned().map(|last| (s, last))) else {
            return Err(SimulationError::Arms { problem: "a motion that leaves the finite numbers".to_owned() });
        };
        for state in &states[1..] {
            let shown = self.shown(state);
            self.angles.push_back(shown);
        }
        self.state = last;
        Ok(())
    }
}

impl Arms for Live {
    fn advance(&mut self) -> core::result::Result<(), SimulationError> {
        if self.angles.len() < 2 {
            self.go_on()?;
        }
        self.angles.pop_front();
        Ok(())
    }

    fn angles(&self) -> &[f64] {
        self.angles.front().map_or(&[], Vec::as_slice)
    }
}
