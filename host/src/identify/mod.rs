//! From a record to the coefficients of the equations of motion, with standard errors.
//!
//! From the measured angles alone: the weak form (method: [`windows`], least squares and
//! covariance: [`regression`]) gives the start, and by default multiple shooting ([`shooting`]) the
//! answer wherever it stands ([`best`]). Physical parameters follow where quantities are known
//! ([`physical_parameters`]).

mod assembly;
pub mod balance_error;
pub mod base_motion;
pub mod best;
pub mod boots;
pub mod built_in;
pub mod card;
pub mod chain_bias;
pub mod energy_balance;
mod few_periods;
mod free_geometry;
pub mod from_rows;
mod geometry;
pub mod harmonic_balance;
pub mod held_inputs;
pub mod history;
pub mod identifiability;
pub mod index_marks;
pub mod input_noise;
pub mod jackknife;
mod judgement;
mod known_jointly;
mod known_of_system;
mod known_quantities;
pub mod model_file;
pub mod noise_bias;
pub mod per_record;
pub mod physical;
pub mod physical_parameters;
pub mod prepared;
pub mod presentation;
pub mod regression;
pub mod remeasured;
pub mod result;
pub mod series;
pub mod shooting;
mod short_record;
pub mod single_parameters;
pub mod slips;
mod standstill;
mod stated_amplitude;
pub mod stopped;
pub mod stretches;
pub mod suspects;
pub mod system;
pub mod taken_off;
pub mod ties;
pub mod track;
mod transforms;
pub mod units;
pub mod weak_form;
pub mod windows;

use serde::Serialize;

use crate::error::Result;
pub use crate::model::parameter::Parameter;
use crate::record::Record;
use crate::rig::Rig;

pub use prepared::{Geometry, Prepared, prepare};
pub use result::{Details, ERROR_BOUND, Identification, RecordUse, Residuals};
pub use weak_form::weak_form;

/// Methods of identification: name, what it does.
pub const METHODS: &[(&str, &str)] = &[
    (
        "weak",
        "weak form: sin⁴ windows over 20 drive periods (10 of the motion when free), integrated by parts; least squares per equation",
    ),
    (
        "shooting",
        "multiple-shooting maximum likelihood from the weak form's start: pieces of 1, 2 and 4 drive periods, quantisation as noise",
    ),
    ("frequency", "harmonic balance of long pieces of n drive periods, closed or not"),
    ("upo", "harmonic balance of extracted unstable periodic orbits"),
];

/// Choices of the weak form. `None`: chosen from the record, as each says; of a free system by what
/// its motion shows (docs/method.md), f_99 being the frequency below which lie 99 % of the
/// acceleration's power.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Settings {
    /// Length of a window, s; by default 20 drive periods, or for a free system 10 periods of its
    /// motion, shorter until the record holds 14 windows, not below 3 periods; under measured
    /// inputs 30 periods of the highest test frequency at most. 4 s where no motion stands above
    /// the noise. What a free system's record is too short for is as long as fits it.
    pub window_s: Option<f64>,
    /// Highest frequency of the test functions, Hz; by default 2 f_e, or for a free system f_99,
    /// more where the motion stands clear of the noise beyond it (up to 3.5 times its dominant
    /// frequency), at most 0.12 of the sampling rate (0.2 with measured inputs).
    pub max_frequency_hz: Option<f64>,
    /// End of the low-pass's pass band, Hz; by default 1.15 times the frequency at which the signal
    /// sinks into the sensors' noise, at least 1.5 times the highest test frequency, at most 0.25
    /// of the sampling rate (0.3 for a free system, 0.4 with measured inputs).
    pub pass_hz: Option<f64>,
    /// Zeros of sensors that are taken off what these show.
    #[serde(skip)]
    pub zeros: Vec<shooting::zeros::ZeroOffset>,
}

/// Identifies a system from one or several records of the same rig by the weak form, and says what
/// the record or the rig file seems to have wrong.
///
/// # Errors
/// As [`weak_form()`].
pub fn identify(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Identification> {
    let mut result = weak_form(records, rig, settings)?;
    let suspects = suspects::after(records, rig, &result);
    result.warnings.extend(suspects);
    let amplitude = stated_amplitude::contradicted(records, rig, &result);
    result.warnings.extend(amplitude);
    stopped::tell_in(&mut result.warnings, records, rig);
    result.warnings.extend(few_periods::warned(records, rig));
    Ok(result)
}

#[cfg(test)]
mod system_tests;
