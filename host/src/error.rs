//! The one error that a person sees for bad input: file, place, value found, value expected, remedy (exit status 2).

use std::fmt;
use std::path::{Path, PathBuf};

/// Result of anything that reads what a user or a wire supplied.
pub type Result<T> = std::result::Result<T, BadInput>;

/// Bad input or usage. Printed on one line: `FILE: PLACE: found FOUND, expected EXPECTED. REMEDY`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadInput {
    /// File (or port, or option) that holds the bad value.
    pub file: Option<PathBuf>,
    /// Where in it: row, column, key, byte.
    pub place: Option<String>,
    /// What was found there.
    pub found: String,
    /// What was expected instead (may be empty where `found` says it all).
    pub expected: String,
    /// What to do about it.
    pub remedy: String,
}

impl BadInput {
    /// What was found and what was expected, without a place yet.
    pub fn new(found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { file: None, place: None, found: found.into(), expected: expected.into(), remedy: String::new() }
    }

    /// Names the file (kept if one is named already: the innermost knows best).
    pub fn in_file(mut self, file: impl AsRef<Path>) -> Self {
        self.file.get_or_insert_with(|| file.as_ref().to_path_buf());
        self
    }

    /// Names the place in the file (kept if one is named already).
    pub fn at(mut self, place: impl Into<String>) -> Self {
        self.place.get_or_insert_with(|| place.into());
        self
    }

    /// Says what to do about it.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = remedy.into();
        self
    }

    /// An operating system's error on a file.
    pub fn io(file: impl AsRef<Path>, error: &std::io::Error) -> Self {
        Self::new(error.to_string(), "").in_file(file)
    }
}

impl fmt::Display for BadInput {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}: ", file.display())?;
        }
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        if self.expected.is_empty() {
            write!(f, "{}", self.found)?;
        } else {
            write!(f, "found {}, expected {}", self.found, self.expected)?;
        }
        if !self.remedy.is_empty() {
            write!(f, ". {}", self.remedy)?;
        }
        Ok(())
    }
}

impl std::error::Error for BadInput {}

/// A text from a file, device or system as one line of a terminal: control characters are escaped.
pub fn plain(text: &str) -> String {
    text.chars().flat_map(|c| if c.is_control() { c.escape_default().collect::<Vec<_>>() } else { vec![c] }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_never_reach_a_terminal() {
        assert_eq!(plain("\u{1b}[2Ja\nµ\u{9b}"), "\\u{1b}[2Ja\\nµ\\u{9b}");
    }
}
