//! What a survey warns of.

use super::average_mutual_information::Minimum;
use crate::warning::Warning;

/// Minima of the mutual information that do not settle the delay: all of them, with their depths, and what was taken.
pub fn weak_minima(name: &str, minima: &[Minimum], delay: usize, weak: bool, rate: f64) -> Warning {
    let listed: Vec<String> = minima.iter().take(8).map(|m| format!("{} ({:.1} %)", m.lag, 100.0 * m.depth)).collect();
    let message = match (minima.is_empty(), weak) {
        (true, _) => {
            format!("{name}: the mutual information has no minimum; T_d {delay} samples is where it has decayed")
        }
        (_, true) => {
            format!("{name}: all minima of the mutual information are weak, at lags {} (depth)", listed.join(", "))
        }
        _ => format!(
            "{name}: the first minima of the mutual information are weak; minima at lags {} (depth), T_d {delay} samples taken",
            listed.join(", ")
        ),
    };
    Warning::new(
        "weak-minima",
        message,
        format!(
            "For a driven system about a quarter of the drive period serves as well; {delay} samples are {:.4} s",
            delay as f64 / rate
        ),
    )
}
