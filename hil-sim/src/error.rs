//! Errors of the simulated rig.

use crate::integrator::IntegrationError;
use crate::plant::ParameterError;
use crate::plant::effects::EffectError;

/// Why a simulation could not be set up or go on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// A parameter or a setting that cannot be.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// An effect that cannot be, or not on this rig.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// The plant could not be integrated further.
    #[error("the simulated rig failed at {time_s} s: {error}")]
    Integration {
        /// Time of the record, s.
        time_s: f64,
        /// What failed.
        error: IntegrationError,
    },
    /// Another system than the double pendulum could not be followed further.
    #[error("the simulated rig failed: {problem}")]
    Arms {
        /// What failed.
        problem: String,
    },
    /// An emulated board asked for something that cannot be.
    #[error("the emulated board failed at tick {tick}: {problem}")]
    Board {
        /// The tick.
        tick: u32,
        /// What was wrong.
        problem: String,
    },
}
