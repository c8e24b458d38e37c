//! What a record's amplitude was levelled to.

use serde::{Deserialize, Serialize};

/// The base's amplitude as a capture that levels it found it, before the record began.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Level {
    /// What was wanted, m.
    pub wanted_m: f64,
    /// What is commanded during the record, m.
    pub commanded_m: f64,
    /// What the base's channel shows of that, by the rig file's gain, m.
    pub measured_m: f64,
    /// Standard error of that, m.
    pub std_error_m: f64,
    /// Measured over commanded.
    pub gain: f64,
}
