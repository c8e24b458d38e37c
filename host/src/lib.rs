//! From encoder counts to a trusted equation of motion, and to the physical effect that the model is missing.

pub mod error;
pub mod inspect;
pub mod record;
pub mod report;
pub mod rig;
pub mod signal;
pub mod warning;
