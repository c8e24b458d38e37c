//! An identified model as equations that can be integrated, whatever system it is of.

use std::path::Path;

use crate::error::Result;
use crate::model::dynamics::Dynamics;
use crate::model::identified::IdentifiedModel;
use crate::model::model_file::expression::Symbol;
use crate::motion::{Effect, Motion};
use crate::rig::Rig;
use crate::warning::Warning;

/// Equations of motion with their parameters.
pub struct IdentifiedEquations {
    /// The equations.
    pub dynamics: Box<dyn Dynamics>,
    /// Values of the parameters.
    pub parameters: Vec<f64>,
    /// Their names.
    pub names: Vec<String>,
    /// Which of them belong to the base's motion.
    pub of_drive: Vec<bool>,
    /// Effects that do not act on the motion, `ID@PLACE`.
    pub left_out: Vec<String>,
}

impl IdentifiedEquations {
    /// The equations of a model on a rig; `start_s`: time of the record's first sample.
    ///
    /// # Errors
    /// A model of another system or drive, parameters or effects that do not belong to it.
    pub fn of(model: &IdentifiedModel, rig: &Rig, start_s: f64) -> Result<Self> {
        // What is wrong in the model is told without its file's name, which the caller knows.
        let motion = Motion::of(model, Path::new(""), Some(rig), start_s)?;
        let (equations, parameters) = motion.equations()?;
        let names = equations.coefficients().to_vec();
        let terms = || motion.file.equations.iter().flat_map(|e| &e.terms);
        let of_drive = names.iter().map(|n| terms().any(|t| t.name == *n && t.of.any(&|s| s == Symbol::Tau))).collect();
        let left_out = motion.effects.iter().filter(|e| e.is_of_the_record()).map(Effect::name).collect();
        Ok(Self { dynamics: Box::new(equations), parameters, names, of_drive, left_out })
    }

    /// That effects were left out, where some were.
    pub(super) fn warning_of_what_is_left_out(&self) -> Option<Warning> {
        let text = || format!("{} change what is recorded, not the motion", self.left_out.join(", "));
        let advice = "They are not in the simulated record; the prediction horizon feels them";
        (!self.left_out.is_empty()).then(|| Warning::new("effects-left-out", text(), advice))
    }
}
