//! The built-in systems that an identification knows: their nominal dampings and physical
//! parameters.

use super::{physical_parameters, single_parameters};
use crate::error::{BadInput, Result};
use crate::model::double_pendulum::{self, Damping};
use crate::model::single_pendulum;
use crate::rig::Rig;
use crate::system::library::Pendulum;
use crate::system::ties::Identified;
use physical_parameters::PhysicalFit;

/// A system with the dampings of its nominal model.
#[derive(Clone, Debug)]
pub enum System {
    /// The single pendulum: names of the dampings' coefficients.
    Single(Vec<&'static str>),
    /// The double pendulum: its dampings.
    Double(Vec<&'static Damping>),
}

impl System {
    /// The system of a rig.
    ///
    /// # Errors
    /// A model that is none of them, a drive that it cannot have, dampings that are unknown or
    /// named twice.
    pub fn of(rig: &Rig) -> Result<Self> {
        match rig.pendulum() {
            Some(Pendulum::Double) => {
                if rig.drive.is_some_and(|d| !Pendulum::Double.takes(d.direction)) {
                    return Err(BadInput::new("\"horizontal\"", "\"vertical\"")
                        .in_file(&rig.path)
                        .at("drive.direction")
                        .remedy("The double pendulum's model has a vertically driven base"));
                }
                Ok(Self::Double(dampings(rig)?))
            }
            Some(Pendulum::Single) => Ok(Self::Single(single_dampings(rig)?)),
            None => Err(BadInput::new(format!("\"{}\"", rig.model), Pendulum::either())
                .in_file(&rig.path)
                .at("model")
                .remedy("`whirl list models` shows the models")),
        }
    }

    /// Ids of the nominal model's dampings.
    pub fn nominal(&self) -> Vec<String> {
        match self {
            Self::Single(names) => {
                let known = single_pendulum::DAMPINGS.iter();
                known.filter(|d| names.contains(&d.1)).map(|d| d.0.to_owned()).collect()
            }
            Self::Double(dampings) => dampings.iter().map(|d| d.id.to_owned()).collect(),
        }
    }

    /// Physical parameters from coefficients and what is known; `None` where nothing follows.
    pub fn physical(&self, identified: &Identified<'_>, rig: &Rig) -> Option<PhysicalFit> {
        match self {
            Self::Single(_) => single_parameters::derive(identified, rig),
            Self::Double(_) => physical_parameters::fit(identified, &rig.known, rig.omega()),
        }
    }
}

/// The nominal dampings of a rig.
pub fn dampings(rig: &Rig) -> Result<Vec<&'static Damping>> {
    let names: Vec<&str> = match &rig.nominal {
        Some(list) => list.iter().map(String::as_str).collect(),
        None => double_pendulum::DEFAULT_DAMPINGS.to_vec(),
    };
    let mut out: Vec<&'static Damping> = Vec::new();
    for name in names {
        let damping = double_pendulum::DAMPINGS.iter().find(|d| d.id == name).ok_or_else(|| {
            let ids: Vec<&str> = double_pendulum::DAMPINGS.iter().map(|d| d.id).collect();
            BadInput::new(format!("\"{name}\""), format!("one of {}", ids.join(", ")))
                .in_file(&rig.path)
                .at("nominal.effects")
                .remedy("Correct the nominal model's dampings")
        })?;
        if out.contains(&damping) {
            return Err(BadInput::new(format!("\"{name}\" a second time"), "each effect once")
                .in_file(&rig.path)
                .at("nominal.effects"));
        }
        out.push(damping);
    }
    Ok(out)
}

fn single_dampings(rig: &Rig) -> Result<Vec<&'static str>> {
    let names: Vec<&str> = match &rig.nominal {
        Some(list) => list.iter().map(String::as_str).collect(),
        None => single_pendulum::DEFAULT_DAMPINGS.to_vec(),
    };
    let mut out = Vec::new();
    for name in names {
        let known = single_pendulum::DAMPINGS.iter().find(|d| d.0 == name);
        let coefficient = known.map(|d| d.1).filter(|c| !out.contains(c)).ok_or_else(|| {
            let ids: Vec<&str> = single_pendulum::DAMPINGS.iter().map(|d| d.0).collect();
            BadInput::new(format!("\"{name}\""), format!("one of {}, each once", ids.join(", ")))
                .in_file(&rig.path)
                .at("nominal.effects")
                .remedy("Correct the nominal model's dampings")
        })?;
        out.push(coefficient);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::identify::{Settings, identify};
    use crate::record::{ReadOptions, Record};
    use crate::rig::single_plant::SinglePlant;

    fn rig() -> Rig {
        Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/single-pendulum.toml")).unwrap()
    }

    #[test]
    fn a_simulated_single_pendulum_gives_back_its_coefficients() {
        let rig = rig();
        let plant = SinglePlant::of(&rig).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("record.parquet");
        crate::simulate::record(&rig, &[], 120.0, 3, &file, &indicatif::ProgressBar::hidden()).unwrap();
        let record = Record::read(&file, &rig, &ReadOptions::default()).unwrap();
        let found = identify(&[record], &rig, &Settings::default()).unwrap();
        assert!(found.within_bound() && found.groups_not_separable.is_empty(), "{:?}", found.groups_not_separable);
        for p in &found.parameters {
            let truth = plant.truth(&p.name, rig.omega(), rig.drive.map(|d| d.direction)).unwrap();
            assert!((p.value - truth).abs() < 4.5 * p.std_error, "{} {} {truth} {}", p.name, p.value, p.std_error);
        }
        let c_r = found.parameter("c_r").unwrap();
        assert!((c_r.value / 0.036 - 1.0).abs() < 1e-3, "{}", c_r.value);
    }

    #[test]
    fn models_and_dampings_that_are_not_there_are_refused() {
        let mut rig = rig();
        rig.nominal = Some(vec!["viscous-friction@joint2".to_owned()]);
        assert!(System::of(&rig).unwrap_err().to_string().contains("coulomb-friction@joint1"));
        rig.nominal = Some(vec!["viscous-friction@joint1".to_owned(), "viscous-friction@joint1".to_owned()]);
        assert!(System::of(&rig).is_err());
        rig.model = "triple-pendulum".to_owned();
        assert!(System::of(&rig).unwrap_err().to_string().contains("list models"));
    }
}
