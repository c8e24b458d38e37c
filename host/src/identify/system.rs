//! The built-in systems that an identification knows: their nominal dampings and physical
//! parameters.

use super::{physical_parameters, single_parameters};
use crate::error::{BadInput, Result};
use crate::model::damping::Damping;
use crate::model::{double_pendulum, single_pendulum};
use crate::rig::Rig;
use crate::system::library::Pendulum;
use crate::system::ties::Identified;
use physical_parameters::PhysicalFit;

/// A system with the dampings of its nominal model.
#[derive(Clone, Debug)]
pub struct System {
    /// Which.
    pub pendulum: Pendulum,
    /// Its dampings, as the rig file lists them.
    pub dampings: Vec<&'static Damping>,
}

impl System {
    /// The system of a rig.
    ///
    /// # Errors
    /// A model that is none of them, a drive that it cannot have, dampings that are unknown or
    /// named twice.
    pub fn of(rig: &Rig) -> Result<Self> {
        let Some(pendulum) = rig.pendulum() else {
            return Err(rig.no_such_model());
        };
        if pendulum == Pendulum::Double && rig.drive.is_some_and(|d| !Pendulum::Double.takes(d.direction)) {
            return Err(BadInput::new("\"horizontal\"", "\"vertical\"")
                .in_file(&rig.path)
                .at("drive.direction")
                .remedy("The double pendulum's model has a vertically driven base"));
        }
        let (all, default) = match pendulum {
            Pendulum::Single => (single_pendulum::DAMPINGS, single_pendulum::DEFAULT_DAMPINGS),
            Pendulum::Double => (double_pendulum::DAMPINGS, double_pendulum::DEFAULT_DAMPINGS),
        };
        let names: Vec<&str> = match &rig.nominal {
            Some(list) => list.iter().map(String::as_str).collect(),
            None => default.to_vec(),
        };
        let dampings = Damping::chosen(names, all)
            .map_err(|e| e.in_file(&rig.path).at("nominal.effects").remedy("Correct the nominal model's dampings"))?;
        Ok(Self { pendulum, dampings })
    }

    /// Ids of the nominal model's dampings; those of the single pendulum in the order of its list.
    pub fn nominal(&self) -> Vec<String> {
        let id = |d: &&Damping| d.id.to_owned();
        match self.pendulum {
            Pendulum::Single => {
                let known = single_pendulum::DAMPINGS.iter();
                known.filter(|d| self.dampings.contains(d)).map(|d| id(&d)).collect()
            }
            Pendulum::Double => self.dampings.iter().map(id).collect(),
        }
    }

    /// Names of the dampings' coefficients in the first equation.
    pub fn coefficients(&self) -> Vec<&'static str> {
        self.dampings.iter().filter_map(|d| d.names[0]).collect()
    }

    /// Physical parameters from coefficients and what is known; `None` where nothing follows.
    pub fn physical(&self, identified: &Identified<'_>, rig: &Rig) -> Option<PhysicalFit> {
        match self.pendulum {
            Pendulum::Single => single_parameters::derive(identified, rig),
            Pendulum::Double => physical_parameters::fit(identified, &rig.known, rig.omega()),
        }
    }
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
