//! The rig's application: samples the encoders and the base's motion, drives the shaker, talks to
//! the host.
//!
//! It is generic over embedded-hal 1 traits and allocates nothing. Two halves are joined by
//! lock-free queues:
//!
//! ```text
//!  interrupt, 500 Hz                              thread
//!  ┌───────────────────────────┐    blocks    ┌──────────────────────┐
//!  │ Sampler                   │ ───────────▶ │ Link                 │ ──▶ frames
//!  │  encoders, shaker, blocks │    events    │  stream, console,    │
//!  │                           │ ───────────▶ │  preview             │
//!  │                           │ ◀─────────── │                      │ ◀── bytes
//!  └───────────────────────────┘   requests   └──────────────────────┘
//! ```
//!
//! A board owns [`sampler::Sampler`] in its sampling interrupt and [`link::Link`] in its thread,
//! with `heapless::spsc` queues split between them; a host test, a simulator or an emulated board
//! owns both as one [`app::App`]. The bytes that come out are the same.
//!
//! The order within a tick is fixed: read all inputs → the sample carries the drive's phase at
//! this tick → write the displacement of this tick → advance phase and ramp → carry out requests,
//! which act from the next tick on.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod adjust;
pub mod app;
pub mod base;
pub mod dac;
pub mod estimate;
pub mod event;
pub mod history;
pub mod identification;
pub mod inputs;
pub mod kept;
pub mod led;
pub mod lines;
pub mod link;
pub mod lock_step;
pub mod output;
pub mod pacing;
pub mod player;
pub mod preview;
pub mod quadrature;
pub mod queue;
pub mod ramp;
pub mod sampler;
pub mod settings;
pub mod shaker;
pub mod store;
pub mod sweep;
pub mod zero;

mod allowance;
mod block_builder;
mod console;
mod excite;
mod stream;
#[cfg(test)]
mod testing;

pub use app::App;
pub use inputs::{Inputs, WithBase};
pub use output::ShakerOutput;
pub use quadrature::QuadratureCounter;
pub use settings::{Settings, SettingsError};
pub use shaker::Drive;
