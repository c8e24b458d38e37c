//! What the firmware and the host must agree on, and nothing else.
#![no_std]

pub mod frame;
