//! QEMU's mps2-an386 for the firmware: peripherals, semihosting, stack. The binaries are the rig,
//! the test cases and the measurements.
#![no_std]

#[cfg(target_os = "none")]
pub mod flash;
#[cfg(target_os = "none")]
pub mod machine;
#[cfg(target_os = "none")]
pub mod meter;
#[cfg(target_os = "none")]
pub mod semihosting;
#[cfg(target_os = "none")]
pub mod stack;
