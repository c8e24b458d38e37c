//! Typed warnings: what was noticed, and what to do about it. They go to standard error, into reports and into JSON.

use serde::Serialize;

/// Something that does not stop the work but that its reader must know.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Warning {
    /// Short stable name, such as `nan-is-gap`.
    pub kind: &'static str,
    /// What was noticed, with the numbers.
    pub message: String,
    /// What to do about it.
    pub advice: String,
}

impl Warning {
    /// A warning with its advice.
    pub fn new(kind: &'static str, message: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { kind, message: message.into(), advice: advice.into() }
    }
}
