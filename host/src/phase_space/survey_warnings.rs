//! What a survey warns of.

use super::average_mutual_information::Minimum;
use super::survey_settings::Settings;
use crate::warning::Warning;
use crate::wording::format::{duration, in_seconds};

/// That a delay is no clear one.
pub const WEAK_MINIMA: &str = "weak-minima";

/// Minima of the mutual information that do not settle the delay: all of them, with their depths,
/// and what was taken.
pub fn weak_minima(name: &str, minima: &[Minimum], delay: usize, weak: bool, rate: f64) -> Warning {
    let listed: Vec<String> = minima.iter().take(8).map(|m| format!("{} ({:.1} %)", m.lag, 100.0 * m.depth)).collect();
    let message = match (minima.is_empty(), weak) {
        (true, _) => {
            format!(
                "{name}: no clear delay (its mutual information has no minimum); the {delay} samples after which it has decayed are used"
            )
        }
        (_, true) => {
            format!("{name}: no clear delay (minima of the mutual information, all weak: lag {})", listed.join(", "))
        }
        _ => format!(
            "{name}: no clear delay (minima of the mutual information: lag {}; the first are weak); {delay} samples are used",
            listed.join(", ")
        ),
    };
    Warning::new(
        WEAK_MINIMA,
        message,
        format!(
            "The delay ({}) affects exponent and dimension only; under a drive a quarter of its period serves as well",
            duration(delay as f64 / rate)
        ),
    )
}

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
        format!(
            "Raise the tolerance to {} %, or record {:.0} min",
            160.0 * tolerance,
            (seconds / 15.0).ceil().max(10.0)
        ),
    )
}
