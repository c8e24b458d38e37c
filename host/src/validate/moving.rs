//! An identified model as equations that can be integrated, whatever system it is of.

use std::collections::BTreeMap;

use super::motion_model::MotionModel;
use crate::error::{BadInput, Result};
use crate::explain::engine::given;
use crate::explain::single_pendulum;
use crate::model::dynamics::Dynamics;
use crate::model::identified::{IdentifiedModel, System};
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::model::model_file::expression::Symbol;
use crate::motion::at_coordinates;
use crate::rig::Rig;
use crate::rig::measures::Bound;

/// Equations of motion with their parameters.
pub struct Moving {
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
    /// Whether terms beside the nominal ones may jump where the integrator does not look.
    pub jumps: bool,
}

impl Moving {
    /// The equations of a model on a rig; `span_s`: time of the record's first sample and the record's length.
    ///
    /// # Errors
    /// A model of another system or drive, parameters or effects that do not belong to it.
    pub fn of(model: &IdentifiedModel, rig: &Rig, span_s: [f64; 2]) -> Result<Self> {
        let frequency = rig.drive.map(|d| d.frequency_hz);
        if model.drive_frequency_hz != frequency {
            let text = |f: Option<f64>| f.map_or("no drive".to_owned(), |f| format!("a drive of {f} Hz"));
            return Err(BadInput::new(
                text(model.drive_frequency_hz),
                format!("{}, as in the rig file", text(frequency)),
            )
            .at("drive_frequency_hz")
            .remedy("Give a model that was identified on this rig"));
        }
        if rig.model == "single-pendulum" {
            let (own, model) = single_pendulum::own(model, rig)?;
            return Self::own(&model, &own, span_s[0]);
        }
        if rig.bound.is_some() {
            return Self::own(model, rig, span_s[0]);
        }
        let double = MotionModel::of(model, rig, span_s)?;
        let names = double.base.names().to_vec();
        Ok(Self {
            parameters: double.parameters.clone(),
            of_drive: names.iter().map(|n| n.starts_with('B') && (n.ends_with('3') || n.ends_with('4'))).collect(),
            names,
            left_out: double.left_out.clone(),
            jumps: double.has_forces(),
            dynamics: Box::new(double),
        })
    }

    /// The equations of a system of one's own; `start_s`: time of the record's first sample.
    fn own(model: &IdentifiedModel, rig: &Rig, start_s: f64) -> Result<Self> {
        let Some(bound) = &rig.bound else {
            return Err(BadInput::new("a rig without a model file", "a system of your own"));
        };
        if let Some(m) = given::motion(model, rig, bound, start_s)? {
            let names = m.motion.coefficients().to_vec();
            let of_drive = of_drive(&names, bound);
            let (parameters, left_out) = (m.parameters, m.left_out);
            return Ok(Self { dynamics: Box::new(m.motion), parameters, names, of_drive, left_out, jumps: false });
        }
        if let System::BuiltIn(id) = &model.system {
            return Err(BadInput::new(format!("model = \"{id}\""), "a system of your own, as in the rig file")
                .at("model")
                .remedy("Give a model that was identified on this rig"));
        }
        let (motion, parameters) = at_its_coordinates(model, bound, rig.omega())?;
        let names = motion.coefficients().to_vec();
        let of_drive = of_drive(&names, bound);
        Ok(Self { dynamics: Box::new(motion), parameters, names, of_drive, left_out: Vec::new(), jumps: false })
    }
}

/// A model whose effects stand at coordinates, or which has none, and its parameters.
fn at_its_coordinates(model: &IdentifiedModel, bound: &Bound, omega: f64) -> Result<(EquationsOfMotion, Vec<f64>)> {
    let mut terms = Vec::new();
    let mut strengths = BTreeMap::new();
    for (k, (found, e)) in at_coordinates::of(model, &bound.model)?.into_iter().zip(&model.effects).enumerate() {
        for (j, (of, s)) in found.columns.into_iter().zip(&e.strengths).enumerate() {
            let name = format!("{}@{} {k} {j}", e.id, e.at);
            strengths.insert(name.clone(), *s);
            terms.push((found.equation, name, of));
        }
    }
    let motion = EquationsOfMotion::with_columns(&bound.model, omega, &terms)?;
    let all = motion.coefficients();
    // A coefficient of its own for each record has the record's number behind it.
    let short = |name: &str| match name.rsplit_once('_') {
        Some((short, k)) if k.parse::<u32>().is_ok() => short.to_owned(),
        _ => name.to_owned(),
    };
    let known = |name: &str| all.iter().any(|c| c == name || *c == short(name));
    if let Some(p) = model.parameters.iter().find(|p| !known(&p.name)) {
        return Err(BadInput::new("a parameter that the equations do not have", all.join(", "))
            .at(format!("parameters.{}", p.name))
            .remedy("Give a model that was identified on this rig, by the weak form or shooting"));
    }
    let value = |n: &String| {
        let given = model.coefficient(n).map(|p| p.value);
        given.or_else(|| strengths.get(n).copied()).ok_or_else(|| {
            BadInput::new(format!("no {n}"), all.join(", "))
                .at(format!("parameters.{n}"))
                .remedy("Write the model anew with `whirl identify -o`")
        })
    };
    let parameters = all.iter().map(value).collect::<Result<_>>()?;
    Ok((motion, parameters))
}

/// Which coefficients stand with the drive's phase.
fn of_drive(names: &[String], bound: &Bound) -> Vec<bool> {
    let terms = || bound.model.equations.iter().flat_map(|e| &e.terms);
    names.iter().map(|n| terms().any(|t| t.name == *n && t.of.any(&|s| s == Symbol::Tau))).collect()
}
