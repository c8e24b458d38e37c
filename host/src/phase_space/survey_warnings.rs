//! What a survey warns of.

use super::survey_settings::Settings;
use crate::warning::Warning;
use crate::wording::format::in_seconds;

/// Fewer periodic orbits than a comparison needs.
pub fn few_orbits(found: usize, seconds: f64, settings: &Settings) -> Warning {
    let Settings { longest, tolerance, .. } = settings;
    Warning::new(
        "few-orbits",
        format!(
            "{found} orbits of period ≤ {longest} in {} at a tolerance of {} %",
            in_seconds(seconds),
            100.0 * tolerance
        ),
        format!("Record {:.0} min", (seconds / 15.0).ceil().max(10.0)),
    )
}
