//! A rig for an identified model that comes without its rig file: channels that measure its
//! coordinates and inputs in SI units.
//!
//! What a rig file says beside that does not enter the equations, with two exceptions. A single
//! pendulum's direction of drive is read off its coefficients: the base's share along the drive is
//! the larger. Effects found on a mechanism rest on its bodies: where the equations are those of a
//! system that ships with the program, its bodies are taken; for other mechanisms the rig file has
//! to be given.

use std::path::Path;
use std::sync::Arc;

use crate::error::{BadInput, Result};
use crate::model::identified::{IdentifiedModel, System};
use crate::model::model_file::{ModelFile, Space};
use crate::rig::measures;
use crate::rig::{Channel, Direction, Drive, Rig};
use crate::system::library::{self, Pendulum};
use crate::system::mechanism::Mechanism;

/// Sampling rate of records of a model whose rig is not given, Hz: that of the boards.
pub const RATE_HZ: f64 = 500.0;

/// The rig of a model's file.
///
/// # Errors
/// A built-in model that there is not, a model file that cannot be read.
pub fn rig(model: &IdentifiedModel, path: &Path) -> Result<Rig> {
    let (id, file, channel) = match &model.system {
        System::BuiltIn(id) => {
            let Some(pendulum) = model.system.pendulum() else {
                return Err(BadInput::new(format!("\"{id}\""), Pendulum::either())
                    .at("model")
                    .remedy("Give a model that `whirl identify -o` or `whirl explain -o` wrote"));
            };
            (id.clone(), None, pendulum.coordinates().iter().map(|n| Channel::new(n, "rad")).collect::<Vec<_>>())
        }
        System::Own(_) => {
            let file = ModelFile::read(path)?;
            let unit = |space: Space| if space == Space::Circle { "rad" } else { "1" };
            let coordinates = file.coordinates.iter().map(|c| Channel::new(&c.name, unit(c.space)));
            let channels = coordinates.chain(file.inputs.iter().map(|u| Channel::new(u, "1"))).collect();
            (path.display().to_string(), Some(file), channels)
        }
    };
    let drive = model.drive_frequency_hz.map(|frequency_hz| Drive {
        direction: direction(model),
        frequency_hz,
        amplitude_m: None,
    });
    let mut rig = Rig {
        name: model.name.clone(),
        model: id,
        sample_rate_hz: RATE_HZ,
        time: crate::record::names::TimeChoice::default(),
        drive,
        channel,
        known: [("g".to_owned(), crate::rig::GRAVITY)].into(),
        nominal: None,
        effects: Vec::new(),
        effect_files: Vec::new(),
        text: String::new(),
        path: path.to_path_buf(),
        bound: None,
    };
    if let Some(mut file) = file {
        if !model.found_with.is_empty() {
            file.mechanism = shipped(&file, rig.omega());
        }
        rig.bound = Some(Arc::new(measures::bound(&rig, file)?));
    }
    Ok(rig)
}

/// Direction of the drive: what a base along it adds is the larger. A double pendulum's is
/// vertical.
fn direction(model: &IdentifiedModel) -> Direction {
    if !model.system.pendulum().is_some_and(|p| p.takes(Direction::Horizontal)) {
        return Direction::Vertical;
    }
    let size = |names: [&str; 2]| {
        let [c, s] = names.map(|n| model.parameter(n).map_or(0.0, |p| p.value));
        c.hypot(s)
    };
    if size(["n_sin", "p_sin"]) > size(["n_cos", "p_cos"]) { Direction::Vertical } else { Direction::Horizontal }
}

/// The mechanism of a system that ships, of which these are the equations, whatever dampings they
/// have.
fn shipped(file: &ModelFile, omega: f64) -> Option<Arc<Mechanism>> {
    library::all().iter().find_map(|(name, text)| {
        let base = library::read(name, text).ok()?.model(Some(&[]), omega).ok()?;
        let same = base.coordinates == file.coordinates
            && base.inputs == file.inputs
            && base.equations.len() == file.equations.len()
            && base.equations.iter().zip(&file.equations).all(|(a, b)| {
                a.balance == b.balance
                    && a.terms.iter().all(|t| b.terms.iter().any(|o| o.name == t.name && o.of == t.of))
            });
        base.mechanism.filter(|_| same)
    })
}
