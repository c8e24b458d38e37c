//! Systems as files: a mechanism from points, bodies, joints, forces and energies, its equations of
//! motion from its Lagrangian.
//!
//! ```toml
//! name = "pendulum"
//! coordinates = { theta = "angle" }
//! gravity = "down"
//! parameters = { S = "kg m", J = "kg m^2" }
//! [points]
//! base = "[0, 0]"
//! [[body]]
//! name = "arm"
//! from = "base"
//! angle = "theta"
//! first_moment = "S"
//! inertia = "J"
//! [[joint]]
//! name = "pivot"
//! at = "base"
//! moves = "theta"
//! [nominal]
//! effects = ["viscous-friction@pivot"]
//! ```
//!
//! With L = T − V, equation e is d/dt ∂L/∂q_e′ − ∂L/∂q_e = Q_e. It is linear in products of
//! parameters; those of one equation whose expressions depend on each other are one coefficient
//! (Gautier and Khalil 1990; Gautier 1991), and every coefficient is divided by that of the
//! equation's own inertia. What follows is a [`crate::model::model_file::ModelFile`], which
//! everything works on, with a [`mechanism::Mechanism`] that says what its coefficients are made
//! of. `docs/model-file.md` is the user's page.
//!
//! | file | what |
//! |---|---|
//! | [`polynomial`], [`derivative`] | sums of products in a normal form, and their derivatives |
//! | [`words`] | names, vectors and functions in expressions |
//! | [`dimensions`] | whether their units agree |
//! | [`language`], [`reader`] | the file's keys |
//! | [`points`], [`bodies`], [`joints`], [`forces`], [`sensors`] | what they hold |
//! | [`reactions`] | what a joint carries, and the force across it |
//! | [`lagrange`] | equations of motion, product by product |
//! | [`base_parameters`] | which products a record can tell apart |
//! | [`equations`] | the equations as a model file |
//! | [`mechanism`] | coefficients as functions of parameters, quantities |
//! | [`ties`], [`open_directions`], [`openness`] | parameters from coefficients, and what stays open |
//! | [`library`] | systems that ship with the program |

pub mod base_parameters;
pub mod bodies;
pub mod derivative;
pub mod dimensions;
pub mod equations;
pub mod forces;
pub mod joints;
pub mod lagrange;
pub mod language;
pub mod library;
pub mod mechanism;
pub mod open_directions;
pub mod open_parameter;
pub mod openness;
pub mod points;
pub mod polynomial;
pub mod reactions;
pub mod reader;
mod row;
pub mod sensors;
pub mod ties;
pub mod words;

use crate::error::Result;
use crate::model::model_file::ModelFile;
use crate::model::model_file::toml_place::Source;

/// The model file that a text is, or the one that follows from the system file that it is;
/// `nominal` are the effects of a rig file that names some, `omega` is the drive's angular
/// frequency (rad/s; 1 without one).
///
/// # Errors
/// Names file, line and column, what was found and what was expected.
pub fn model_of(source: Source, nominal: Option<&[String]>, omega: f64) -> Result<ModelFile> {
    if language::is_system(source.table()?.get_ref()) {
        return language::SystemFile::from_source(source)?.model(nominal, omega);
    }
    ModelFile::from_source(source)
}

#[cfg(test)]
mod tests;
