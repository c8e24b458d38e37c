//! Systems that ship with the program: every TOML file of the folder `library`, embedded when the
//! program is built.
//!
//! To add one, add its file.

use std::path::Path;

use super::language::SystemFile;
use crate::error::Result;
use crate::model::model_file::toml_place::Source;

include!(concat!(env!("OUT_DIR"), "/library.rs"));

/// Name and text of each system, by name.
pub fn all() -> &'static [(&'static str, &'static str)] {
    FILES
}

/// The text of a system.
pub fn text(name: &str) -> Option<&'static str> {
    FILES.iter().find(|(n, _)| *n == name).map(|(_, t)| *t)
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
