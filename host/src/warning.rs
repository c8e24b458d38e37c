//! Typed warnings: what was noticed, and what to do about it. They go to standard error, into
//! reports and into JSON.

use serde::Serialize;
use serde_json::{Map, Value};

/// Something that does not stop the work but that its reader must know.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Warning {
    /// Short stable name, such as `nan-is-gap`.
    pub id: &'static str,
    /// What was noticed, with the numbers.
    pub text: String,
    /// What to do about it.
    pub advice: String,
    /// Whether the answer beside it cannot stand: the exit status is then 1.
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub invalidates: bool,
    /// What the text says, as numbers: row, time, channel, value (keys as the warning's id needs
    /// them).
    #[serde(flatten)]
    pub details: Map<String, Value>,
}

impl Warning {
    /// A warning with its advice.
    pub fn new(id: &'static str, text: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { id, text: text.into(), advice: advice.into(), invalidates: false, details: Map::new() }
    }

    /// The answer beside this warning cannot stand.
    pub fn invalidating(mut self) -> Self {
        self.invalidates = true;
        self
    }

    /// Adds a number or name that the text holds, for programs that read the JSON.
    pub fn with(mut self, key: &str, value: impl Into<Value>) -> Self {
        self.details.insert(key.to_owned(), value.into());
        self
    }
}
