//! Systems that ship with the program: every TOML file of the folder `library`, embedded when the
//! program is built.
//!
//! To add one, add its file. Two of them are built in as well ([`Pendulum`]).

use std::path::Path;

use super::language::SystemFile;
use crate::error::Result;
use crate::model::model_file::toml_place::Source;
use crate::rig::Direction;

include!(concat!(env!("OUT_DIR"), "/library.rs"));

/// Name and text of each system, by name.
pub fn all() -> &'static [(&'static str, &'static str)] {
    FILES
}

/// The text of a system.
pub fn text(name: &str) -> Option<&'static str> {
    FILES.iter().find(|(n, _)| *n == name).map(|(_, t)| *t)
}

/// The systems whose name as a rig's model means the program's own equations beside the file: their
/// motion is compiled, their parameters and drives are known by hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pendulum {
    /// One arm, on a base that moves up and down or sideways, or rests.
    Single,
    /// Two arms in a row, on a base that moves up and down, or rests.
    Double,
}

impl Pendulum {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Single, Self::Double];

    /// The one of a model's name.
    pub fn named(model: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|p| p.id() == model)
    }

    /// Its name, which is its file's.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Single => "single-pendulum",
            Self::Double => "double-pendulum",
        }
    }

    /// Their names, as a message tells what was expected.
    pub fn either() -> String {
        format!("\"{}\" or \"{}\"", Self::Double.id(), Self::Single.id())
    }

    /// Its file; that of a base at rest where there is no drive.
    pub fn file(self, is_driven: bool) -> &'static str {
        let name = match (self, is_driven) {
            (Self::Double, false) => "double-pendulum-free",
            _ => self.id(),
        };
        text(name).unwrap_or_default()
    }

    /// Its coordinates: the absolute angles of its arms.
    pub const fn coordinates(self) -> &'static [&'static str] {
        match self {
            Self::Single => &["phi1"],
            Self::Double => &["phi1", "phi2"],
        }
    }

    /// What encoders at its joints show.
    pub const fn encoders(self) -> &'static [&'static str] {
        match self {
            Self::Single => &["theta1"],
            Self::Double => &["theta1", "theta2"],
        }
    }

    /// What its channels may measure.
    pub fn measures(self) -> Vec<&'static str> {
        [self.encoders(), self.coordinates()].concat()
    }

    /// Whether its equations have a base that moves in a direction.
    pub fn takes(self, direction: Direction) -> bool {
        self == Self::Single || direction == Direction::Vertical
    }
}

/// What a system is, its first line of comment.
pub fn about(text: &str) -> &str {
    text.lines().next().map_or("", |l| l.trim_start_matches('#').trim())
}

/// Reads a system.
///
/// # Errors
/// As [`SystemFile::from_source`].
pub fn read(name: &str, text: &str) -> Result<SystemFile> {
    SystemFile::from_source(Source { text: text.to_owned(), path: Path::new(name).to_path_buf() })
}
