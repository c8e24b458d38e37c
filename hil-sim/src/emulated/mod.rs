//! The firmware on an emulated board (QEMU's mps2-an386, a Cortex-M4F), in lock-step with the
//! plant.
//!
//! ```text
//!  plant ──counts──▶ from_plant ──▶ ┌──────────────┐
//!  (here)                           │ QEMU: image  │ UART0 ◀──▶ file, or TCP for `whirl capture --from tcp:…`
//!        ◀──drive── to_plant ◀───── └──────────────┘
//! ```
//!
//! The pipes are semihosting files of the image; while the board waits for the plant its clock
//! stands still. With the [`Script`] as the only host, a run's bytes are the same at every repeat,
//! and the same as those of [`crate::VirtualRig`] under that script ([`on_this_machine`]).

mod emulator;
mod plant;
mod script;
mod sent;

pub use emulator::{Account, Emulation, EmulatorError, EmulatorSettings, Serial, run};
pub use plant::EmulatedPlant;
pub use script::{Script, board_settings, on_this_machine, watched_on_this_machine};
pub use sent::Sent;
