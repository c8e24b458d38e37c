//! The vertically (or horizontally) driven double pendulum in physical units.
//!
//! Absolute angles φ1, φ2 (0 hangs down), Δ = φ2 − φ1, base displacement (x_b, y_b), y upward. From
//! the Lagrangian (method section 1.2), with L = ½ J_o1 φ̇1² + ½ J_o2 φ̇2² + H φ̇1 φ̇2 cos Δ +
//! (base and gravity terms):
//! ```text
//! J_o1 φ̈1 + H φ̈2 cos Δ − H φ̇2² sin Δ + S1 ((g + ÿ_b) sin φ1 + ẍ_b cos φ1) = T1 − T2 + D1
//! J_o2 φ̈2 + H φ̈1 cos Δ + H φ̇1² sin Δ + S2 ((g + ÿ_b) sin φ2 + ẍ_b cos φ2) = T2 + D2
//! H = m2 e2 l1,  S1 = m1 e1 + m2 l1,  S2 = m2 e2
//! ```
//! T_j is the torque in joint j on the arm below it (and, with the opposite sign, on the arm above
//! it), D_i the drag of arm i. The nominal rig has T1 = −τ_c1 sign φ̇1 and T2 = −c_r2 (φ̇2 − φ̇1);
//! everything else is an effect ([`effects`]). Units: SI throughout, angles in rad.
//!
//! | file | concern |
//! |---|---|
//! | `parameters` | the nominal rig and its limits |
//! | `laws` | torques in a joint, additions to arms, base and encoders: what effects compile to |
//! | `memory` | torques in a joint that depend on its past motion |
//! | `dynamics` | accelerations for a given state of the dry friction |
//! | `contact` | which joints stick, and which way the others slip |
//! | `motion` | integration over an interval, events located |
//! | `effects/` | the named effects |

mod contact;
mod dynamics;
pub mod effects;
mod laws;
mod memory;
mod motion;
mod parameters;

pub use contact::Dry;
pub use laws::{Additions, DriveAdditions, JointLaw, SensorLaw};
pub use memory::Memory;
pub use parameters::{ParameterError, Parameters};

use contact::Mode;
use dynamics::Mechanics;

/// φ1, φ2 (rad), φ̇1, φ̇2 (rad/s), absolute and unwrapped.
pub type State = [f64; 4];

/// Default tolerance of the integration, rad and rad/s.
pub const TOLERANCE: f64 = 1e-11;

/// A double pendulum in motion.
#[derive(Clone, Debug)]
pub struct Plant {
    mechanics: Mechanics,
    /// Angles without the whole turns in `turns`, so that their resolution does not fall with the
    /// turns.
    state: State,
    turns: [i64; 2],
    mode: Mode,
    tolerance: f64,
}

impl Plant {
    /// A pendulum at rest under its parameters and the plant's share of `additions` (what effects
    /// act on the drive and on the encoders is for [`crate::simulate`] and [`crate::shaker`]).
    ///
    /// # Errors
    /// Parameters that no two rigid arms can have, a state or a tolerance that is not finite.
    pub fn new(
        parameters: &Parameters,
        additions: &Additions,
        state: State,
        tolerance: f64,
    ) -> Result<Self, ParameterError> {
        parameters.validate()?;
        if let Some(value) = state.iter().find(|v| !v.is_finite()) {
            return Err(ParameterError::new("initial", *value, "finite angles and rates"));
        }
        if !(1e-14..=1e-3).contains(&tolerance) {
            return Err(ParameterError::new("tolerance", tolerance, "1e-14 to 1e-3"));
        }
        let mechanics = Mechanics::new(parameters, additions);
        mechanics.validate()?;
        let mut plant = Self { mode: Mode::at(&mechanics, &state), mechanics, state, turns: [0; 2], tolerance };
        plant.settle_contacts(&crate::shaker::BaseMotion::REST);
        Ok(plant)
    }

    /// The present state, unwrapped. At many turns the sum rounds; [`Self::within_turn`] is exact.
    pub fn state(&self) -> State {
        let turned = |i: usize| self.state[i] + self.turns[i] as f64 * core::f64::consts::TAU;
        [turned(0), turned(1), self.state[2], self.state[3]]
    }

    /// The present state with whole turns left out of both angles (which are then within ±2π).
    pub fn within_turn(&self) -> State {
        self.state
    }

    /// Moves the pendulum to another state (a perturbation, a release).
    pub fn set_state(&mut self, state: State) {
        self.state = state;
        self.turns = [0; 2];
        self.mode = Mode::at(&self.mechanics, &state);
        self.settle_contacts(&crate::shaker::BaseMotion::REST);
    }

    /// State of the dry friction of each joint; `None` where there is none.
    pub fn friction(&self) -> [Option<Dry>; 2] {
        self.mode.dry
    }

    /// Kinetic energy and potential energy of gravity with the base at rest, J.
    pub fn energy(&self) -> f64 {
        self.mechanics.energy(&self.state)
    }
}

#[cfg(test)]
mod tests;
