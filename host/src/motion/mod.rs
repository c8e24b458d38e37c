//! An identified model in full: its equations, coefficients and effects as expressions, whatever
//! system it is of.
//!
//! What simulates a model file or writes it as code takes a [`Motion`]: each equation e of the
//! model reads
//!
//! Σ_j λ_j X_ej(q, q′, q″, u, τ) + Σ_k s_k Y_ek(q, q̇, q̈, t, τ) = balance_e,
//!
//! λ_j the identified coefficients, X_ej the terms as the model file holds them (a prime is d/dτ,
//! τ = Ω t, or d/dt: [`ModelFile::prime_scale`]), s_k the strengths of the effects and Y_ek what
//! they add, in seconds. Built-in systems are written out as model files first, so that there is
//! one way for all.
//!
//! | file | what |
//! |---|---|
//! | [`stand_in`] | a rig for a model that comes without its rig file |
//! | [`effects`] | effects of the catalogue, and of model files, as expressions |
//! | [`at_coordinates`] | effects of model files without places |
//! | [`built_in`] | the built-in double pendulum with its effects |
//! | [`from_record`] | the state, phase and inputs of a record |
//! | [`simulation`] | a record of the model itself |

pub mod at_coordinates;
pub mod built_in;
pub mod effects;
pub mod from_record;
pub mod simulation;
pub mod stand_in;
pub mod starts;

use std::path::Path;

use crate::effects::on_a_record::{self, Addition, Samples};
use crate::error::{BadInput, Result};
use crate::explain::single_pendulum;
use crate::model::identified::{AddedEffect, IdentifiedModel, System};
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::model::model_file::expression::{Node, Symbol, add, multiply, number, symbol};
use crate::model::parameter::Parameter;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::system::library::Pendulum;

/// One strength of an effect and what it multiplies.
#[derive(Clone, Debug, PartialEq)]
pub struct Strength {
    /// Its name in the effect's law, or its number; empty where there is one only.
    pub name: String,
    /// Its value, as it enters the equations.
    pub value: f64,
    /// What it adds to the left-hand sides: equation, expression in seconds.
    pub adds: Vec<(usize, Node)>,
}

/// What an effect acts on.
#[derive(Clone, Debug, PartialEq)]
pub enum Acts {
    /// The equations of motion.
    Motion(Vec<Strength>),
    /// The drive's phase, which runs ahead of Ω t by the sum of strength times law of time, rad.
    Drive(Vec<(Node, f64)>),
    /// What a sensor shows beside its angle or length: the sensor's number among the rig's, and
    /// strength times law of x and v ([`Symbol::Coordinate`] and [`Symbol::Rate`] 0).
    Sensor(usize, Vec<(Node, f64)>),
    /// What is recorded of a measured input beside its value: its number, and strength times law of
    /// it and of its rate, as for a sensor.
    Input(usize, Vec<(Node, f64)>),
}

/// An effect of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct Effect {
    /// As the model's file tells it.
    pub identified: AddedEffect,
    /// What it adds, for people.
    pub equation: String,
    /// What it acts on.
    pub acts: Acts,
}

impl Effect {
    /// `ID@PLACE`.
    pub fn name(&self) -> String {
        self.identified.name()
    }

    /// Whether it changes what is recorded alone, not the motion.
    pub fn is_of_the_record(&self) -> bool {
        matches!(self.acts, Acts::Sensor(..) | Acts::Input(..))
    }

    /// Whether it has states of its own.
    pub fn remembers(&self) -> bool {
        let Acts::Motion(list) = &self.acts else { return false };
        let mut states = Vec::new();
        list.iter().flat_map(|s| &s.adds).for_each(|(_, of)| of.memories(&mut states));
        !states.is_empty()
    }
}

/// An identified model in full.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Name for people.
    pub name: String,
    /// Method of identification.
    pub method: String,
    /// The rig, bound to the equations.
    pub rig: Rig,
    /// What its channels measure.
    pub bound: ObservedModel,
    /// The equations, the drive's phase with what advances it.
    pub file: ModelFile,
    /// Coefficients, in the order in which the file names them first.
    pub coefficients: Vec<Parameter>,
    /// Effects, in the order in which they were added.
    pub effects: Vec<Effect>,
}

impl Motion {
    /// The model in full. `path`: the model's file; `rig`: its rig, without which a stand-in serves
    /// where it can; `start_s`: time of the first sample of the record that is followed, from which
    /// a drift is counted.
    ///
    /// # Errors
    /// A model of another system or drive than the rig's, parameters or effects that do not belong
    /// to it, effects that need the rig file.
    pub fn of(model: &IdentifiedModel, path: &Path, rig: Option<&Rig>, start_s: f64) -> Result<Self> {
        let rig = match rig {
            Some(rig) => rig.clone(),
            None => stand_in::rig(model, path)?,
        };
        check_drive(model, &rig)
            .map_err(|e| e.at("drive_frequency_hz").remedy("Give the rig file on which the model was identified"))?;
        let (rig, own, effects) = match &model.system {
            System::BuiltIn(_) if model.system.pendulum() == Some(Pendulum::Double) => {
                built_in::double_pendulum(model, &rig, start_s)?
            }
            System::BuiltIn(_) => {
                let (own_rig, own) = single_pendulum::own(model, &rig)?;
                let effects = effects::of_written(&own, model, &own_rig, start_s)?;
                (own_rig, own, effects)
            }
            System::Own(_) => {
                let effects = effects::of_own(model, &rig, start_s)?;
                (rig, model.clone(), effects)
            }
        };
        let Some(bound) = rig.bound.as_deref().cloned() else {
            return Err(BadInput::new("a rig without a model file", "the rig file of this model").at("model"));
        };
        let coefficients = coefficients(&own, &bound.model)?;
        let file = with_phase(&bound.model, &effects);
        if file.equations.len() != file.coordinates.len() {
            // The same refusal as that of a simulation.
            EquationsOfMotion::new(&file, rig.omega())?;
        }
        Ok(Self { name: model.name.clone(), method: model.method.clone(), rig, bound, file, coefficients, effects })
    }

    /// Ω = 2π f_e of the drive, rad/s; none for a free system.
    pub fn omega(&self) -> Option<f64> {
        self.rig.drive.map(|_| self.rig.omega())
    }

    /// The strengths of all effects on the motion, each with its effect.
    pub fn strengths(&self) -> impl Iterator<Item = (&Effect, &Strength)> {
        self.effects.iter().flat_map(|e| match &e.acts {
            Acts::Motion(list) => list.iter().map(move |s| (e, s)).collect(),
            _ => Vec::new(),
        })
    }

    /// Equations that can be integrated over the coordinates alone, and their parameters.
    ///
    /// # Errors
    /// A number of equations that differs from that of the coordinates; an effect with states of
    /// its own.
    pub fn equations(&self) -> Result<(EquationsOfMotion, Vec<f64>)> {
        if let Some((index, e)) = self.effects.iter().enumerate().find(|(_, e)| e.remembers()) {
            let remedy = "`whirl simulate --model` with --initial follows it; leave the effect out of the file here";
            return Err(effects::bad(
                index,
                &e.identified,
                "which has states of its own",
                "effects without `states`",
                remedy,
            ));
        }
        self.following()
    }

    /// The same with the states of effects that remember, [`EquationsOfMotion::hidden`], behind the
    /// coordinates.
    ///
    /// # Errors
    /// A number of equations that differs from that of the coordinates.
    pub fn following(&self) -> Result<(EquationsOfMotion, Vec<f64>)> {
        let mut parameters: Vec<f64> = self.coefficients.iter().map(|c| c.value).collect();
        let mut extra = Vec::new();
        for (k, (effect, strength)) in self.strengths().enumerate().filter(|(_, s)| !s.1.adds.is_empty()) {
            let name = format!("{} {k}", effect.name());
            extra.extend(strength.adds.iter().map(|(e, of)| (*e, name.clone(), of.clone())));
            parameters.push(strength.value);
        }
        Ok((EquationsOfMotion::with_columns(&self.file, self.rig.omega(), &extra)?, parameters))
    }

    /// A state to begin with where none is given: every angle 1 rad, every other coordinate 0.1 of
    /// its unit, at rest.
    pub fn example(&self) -> Vec<f64> {
        let circle = self.file.circle();
        let q = circle.iter().map(|c| if *c { 1.0 } else { 0.1 });
        q.chain(circle.iter().map(|_| 0.0)).collect()
    }

    /// What a sensor shows of what it ought to show.
    pub fn shown(&self, sensor: usize, own: &Samples<'_>) -> Vec<f64> {
        self.put_on(own, |acts| matches!(acts, Acts::Sensor(k, _) if *k == sensor))
    }

    /// What is recorded of an input.
    pub fn recorded(&self, input: usize, own: &Samples<'_>) -> Vec<f64> {
        self.put_on(own, |acts| matches!(acts, Acts::Input(k, _) if *k == input))
    }

    fn put_on(&self, own: &Samples<'_>, is_on: impl Fn(&Acts) -> bool) -> Vec<f64> {
        let laws = |e: &Effect| match &e.acts {
            acts @ (Acts::Sensor(_, laws) | Acts::Input(_, laws)) if is_on(acts) => laws.clone(),
            _ => Vec::new(),
        };
        let all: Vec<Addition> = self.effects.iter().flat_map(laws).collect();
        on_a_record::put_on(own, None, &all)
    }
}

/// Refuses a rig with another drive.
///
/// # Errors
/// Names both drives.
pub fn check_drive(model: &IdentifiedModel, rig: &Rig) -> Result<()> {
    let frequency = rig.drive.map(|d| d.frequency_hz);
    if model.drive_frequency_hz == frequency {
        return Ok(());
    }
    let text = |f: Option<f64>| f.map_or("no drive".to_owned(), |f| format!("a drive of {f} Hz"));
    Err(BadInput::new(text(model.drive_frequency_hz), format!("{}, as in the rig file", text(frequency))))
}

/// Coefficients in the file's order. Of one that each record has for itself, the first record's.
fn coefficients(model: &IdentifiedModel, file: &ModelFile) -> Result<Vec<Parameter>> {
    let names = file.coefficients();
    let of_record = |p: &str| {
        let short = p.rsplit_once('_').filter(|(_, k)| k.parse::<u32>().is_ok());
        short.is_some_and(|(short, _)| names.iter().any(|n| n == short))
    };
    if let Some(p) = model.parameters.iter().find(|p| !names.contains(&p.name) && !of_record(&p.name)) {
        return Err(BadInput::new("a parameter that the equations do not have", names.join(", "))
            .at(format!("parameters.{}", p.name))
            .remedy("Give a model that was identified by the weak form or shooting"));
    }
    let found = |name: &String| {
        let p = model.coefficient(name);
        p.map(|p| Parameter { name: name.clone(), ..p.clone() }).ok_or_else(|| {
            BadInput::new(format!("no {name}"), names.join(", "))
                .at(format!("parameters.{name}"))
                .remedy("Write the model anew with `whirl identify -o`")
        })
    };
    names.iter().map(found).collect()
}

/// The equations with τ and what runs ahead of it in the place of τ.
fn with_phase(file: &ModelFile, effects: &[Effect]) -> ModelFile {
    let mut ahead = number(0.0);
    for e in effects {
        if let Acts::Drive(laws) = &e.acts {
            for (law, strength) in laws {
                ahead = add(ahead, multiply(number(*strength), law.clone()));
            }
        }
    }
    let mut out = file.clone();
    if *ahead == *number(0.0) {
        return out;
    }
    let phase = |s: Symbol| if s == Symbol::Tau { add(symbol(s), ahead.clone()) } else { symbol(s) };
    for e in &mut out.equations {
        e.balance = e.balance.replace(&phase);
        e.terms.iter_mut().for_each(|t| t.of = t.of.replace(&phase));
    }
    out
}

#[cfg(test)]
mod tests;
