//! What a step is measured by: the gap over short windows, and simulations continued beyond what was fitted.

use std::collections::BTreeMap;

use super::candidates::Candidate;
use super::prediction;
pub use super::prediction::motion;
use super::round::{Round, signs_of, terms};
use super::told::Unit;
use super::{Coefficient, Setting, Simulation};
use crate::error::Result;
use crate::explain::explanation::{Explanation, Step};
use crate::identify::general::track::Track;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;

/// The model of a step as equations of motion.
pub struct Moving {
    motion: EquationsOfMotion,
}

impl Moving {
    /// With what was chosen; none where there are not as many equations as coordinates.
    ///
    /// # Errors
    /// As [`EquationsOfMotion::with_columns`].
    pub fn new(setting: &Setting<'_>, chosen: &[Candidate]) -> Result<Option<Self>> {
        let model = &*setting.bound.model;
        if model.equations.len() != model.coordinates.len() {
            return Ok(None);
        }
        let motion = EquationsOfMotion::with_columns(model, setting.rig.omega(), &terms(chosen))?;
        Ok(Some(Self { motion }))
    }

    /// Parameters from coefficients by name.
    fn parameters(&self, by_name: &BTreeMap<String, f64>) -> Vec<f64> {
        self.motion.coefficients().iter().map(|n| by_name.get(n).copied().unwrap_or(0.0)).collect()
    }

    /// The gap with coefficients by name.
    pub fn gap(
        &self,
        setting: &Setting<'_>,
        by_name: &BTreeMap<String, f64>,
        track: &Track<'_>,
        horizon_s: f64,
    ) -> f64 {
        let p = self.parameters(by_name);
        prediction::gap(&self.motion, &p, track, horizon_s, setting.block_s)
    }
}

/// Measures the gap of a step, its coefficients from the blocks that it is not measured on.
///
/// # Errors
/// As [`Moving::new`].
pub fn gap(
    setting: &Setting<'_>,
    round: &Round,
    chosen: &[Candidate],
    track: &Track<'_>,
    added: Option<String>,
    result: &mut Explanation,
) -> Result<()> {
    let value = Moving::new(setting, chosen)?
        .map_or(f64::NAN, |m| m.gap(setting, &round.coefficients(chosen, |f| &f.train), track, result.gap.horizon_s));
    result.gap.steps.push(Step { added, value });
    Ok(())
}

/// Simulation errors of a step; `own_signs` are those that the model's own coefficients keep.
///
/// # Errors
/// As [`Moving::new`].
pub fn simulate(
    setting: &Setting<'_>,
    (round, own_signs): (&Round, &BTreeMap<String, f64>),
    chosen: &[Candidate],
    track: &Track<'_>,
    simulations: &mut [Simulation],
    unit: &Unit,
) -> Result<()> {
    let Some(moving) = Moving::new(setting, chosen)? else { return Ok(()) };
    let whole = moving.parameters(&round.coefficients(chosen, |f| &f.all));
    let signs = signs_of(setting, own_signs, round, chosen, moving.motion.coefficients());
    let longest = (0..setting.stretches.len()).max_by_key(|&k| (setting.stretches[k].len(), usize::MAX - k));
    for simulation in simulations {
        let found =
            longest.and_then(|k| prediction::simulate(&moving.motion, (&whole, &signs), track, k, simulation.fitted));
        let value = found.as_ref().map_or(f64::NAN, |(_, error)| error * unit.factor);
        simulation.steps.push(Step { added: chosen.last().map(Candidate::name), value });
        let names = moving.motion.coefficients().iter().cloned();
        simulation.parameters = found
            .map_or_else(Vec::new, |(p, _)| names.zip(p).map(|(name, value)| Coefficient { name, value }).collect());
    }
    Ok(())
}
