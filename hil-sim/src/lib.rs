//! The rig without the rig: the independent truth against which identification is judged.
//!
//! | module | what |
//! |---|---|
//! | [`plant`] | the driven double pendulum in physical units, dry friction with true sticking, the named effects |
//! | [`plant_single_pendulum`] | the horizontally driven single pendulum, dimensionless |
//! | [`plant_oscillator`] | two masses, block with pendulum, chain, clamped beam: systems for reduced-order models, a file each |
//! | [`plant_yielding_frame`] | a double pendulum whose pivot gives way along one direction |
//! | [`integrator`] | Dormand–Prince 8(5,3) with adaptive steps |
//! | [`shaker`] | the base's motion between ticks |
//! | [`encoder`] | quadrature edges and decoder |
//! | [`simulate`] | samples straight from the plant |
//! | [`virtual_rig`] | the firmware and the plant in lock-step |
//! | [`emulated`] | the firmware's image on an emulated board, and the plant in lock-step |
//! | [`faults`] | a link that damages what it carries, and knows what it did |
//! | [`transport`] | ways to the virtual rig: in process, TCP, pseudo-terminal |
//!
//! Nothing here is shared with the host's analysis: the plant is written from the Lagrangian, with
//! its own integrator. Everything is deterministic; transcendental functions come from `libm` by
//! name, so that a seed gives the same counts on every machine.

pub mod base_sensor;
mod bench;
#[cfg(unix)]
pub mod emulated;
pub mod encoder;
pub mod error;
pub mod faults;
pub mod integrator;
pub mod plant;
pub mod plant_beam;
pub mod plant_chain;
pub mod plant_mass_pendulum;
pub mod plant_oscillator;
pub mod plant_single_pendulum;
pub mod plant_small_term;
pub mod plant_two_mass;
pub mod plant_yielding_frame;
pub mod shaker;
pub mod simulate;
pub mod transport;
pub mod virtual_rig;

pub use base_sensor::{BaseQuantity, BaseSettings};
pub use bench::SecondEncoder;
pub use error::SimulationError;
pub use faults::{FaultReport, FaultSettings, FaultyLink};
pub use plant::Parameters;
pub use plant::effects::Effect;
pub use shaker::Direction;
pub use simulate::{DriveSettings, Sample, Simulation, SimulationSettings};
pub use virtual_rig::{Arms, RigSettings, VirtualRig};
