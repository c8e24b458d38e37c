//! A value with its error and unit.

use serde::Serialize;

/// One identified parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Standard error (± 1.96 of it is a 95 % interval).
    pub std_error: f64,
    /// Unit.
    pub unit: String,
}
