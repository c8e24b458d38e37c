//! From encoder counts to a trusted equation of motion, and to the physical effect that the model is missing.

pub mod capture;
pub mod error;
pub mod record;
pub mod rig;
pub mod warning;
