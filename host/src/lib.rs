//! From encoder counts to a trusted equation of motion, and to the physical effect that the model is missing.

pub mod boards;
pub mod capture;
pub mod cli;
pub mod effects;
pub mod error;
pub mod explain;
pub mod export;
pub mod files;
pub mod identify;
pub mod inspect;
pub mod model;
pub mod motion;
pub mod phase_space;
pub mod record;
pub mod reduce;
pub mod report;
#[cfg(feature = "sim")]
pub mod reproduce;
pub mod rig;
pub mod signal;
#[cfg(feature = "sim")]
pub mod simulate;
pub mod suspects;
pub mod system;
pub mod validate;
pub mod warning;
