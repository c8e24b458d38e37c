//! Whether a record's rows follow each other at the rate that the rig file says.

use std::path::Path;

use crate::error::{BadInput, Result};
use crate::rig::{Rig, UNKNOWN_RATE};
use crate::wording::format::shortest;

/// Greatest relative difference between the record's sampling rate and the rig file's.
const RATE_TOLERANCE: f64 = 0.005;

/// Greatest rate that times can mean in any unit, Hz.
const FASTEST_HZ: f64 = 1e15;

/// The record's rate, Hz; an error where the rig file says another.
pub(super) fn check(path: &Path, rig: &Rig, count: u64, step: f64) -> Result<f64> {
    let (rate, nominal) = (1.0 / step, rig.sample_rate_hz);
    let near = (rate / nominal - 1.0).abs() <= RATE_TOLERANCE;
    if nominal == UNKNOWN_RATE {
        // Nothing says the rate but these times, whose unit may still be found to be another one.
        return if count < 2 || rate <= FASTEST_HZ { Ok(rate) } else { Err(no_clock(path, step)) };
    }
    if count > 1 && !near {
        let other = [("ms", 1e3), ("us", 1e6), ("ns", 1e9), ("min", 1.0 / 60.0)]
            .into_iter()
            .find(|(_, n)| (rate * n / nominal - 1.0).abs() <= RATE_TOLERANCE);
        if let Some((unit, _)) = other {
            return Err(BadInput::new(
                format!("times {step} apart"),
                format!("{} s, as sample_rate_hz = {nominal} of {} says", 1.0 / nominal, rig.path.display()),
            )
            .in_file(path)
            .at("time")
            .remedy(format!(
                "The time is in {unit}: say time_unit = \"{unit}\" in the rig file, or --time COLUMN:{unit}"
            )));
        }
        return Err(BadInput::new(
            format!("rows {} s apart ({} Hz)", shortest(step), shortest(rate)),
            format!("{nominal} Hz (sample_rate_hz of {}) within 0.5 %", rig.path.display()),
        )
        .in_file(path)
        .at(format!("column {}", time_of(rig)))
        .remedy(rate_remedy(time_of(rig), rate, nominal)));
    }
    Ok(rate)
}

/// The error for times that no sampler has, where the rig file says no rate.
fn no_clock(path: &Path, step: f64) -> BadInput {
    BadInput::new(format!("rows {} s apart, from the first on", shortest(step)), "rows 1e-7 to 1e6 s apart")
        .in_file(path)
        .at("column t")
        .remedy("The times must be in seconds: correct the column, or say its unit with --time COLUMN:UNIT")
}

/// What the time's column is called, as far as the rig file says it.
fn time_of(rig: &Rig) -> &str {
    rig.time.column.as_deref().unwrap_or("t")
}

/// What to do where the record's rate, Hz, by the column `time`, is not the rig file's.
fn rate_remedy(time: &str, rate: f64, nominal: f64) -> String {
    // A rate that is off by a thousand or more is another unit of time.
    let unit =
        [(1e3, "ms"), (1e6, "µs"), (1e9, "ns")].into_iter().find(|(k, _)| (rate * k / nominal - 1.0).abs() < 0.05);
    match unit {
        Some((factor, unit)) => {
            format!("{time} is in {unit}, it seems: divide it by {factor:.0}, since it must be in seconds")
        }
        // No rig file may say it: these are no seconds.
        None if !crate::rig::RATES.contains(&rate) => format!("{time} must be in seconds: correct the column"),
        None => format!(
            "Set sample_rate_hz = {} in the rig file if that is the record's rate; otherwise {time} must be in seconds, or hold dates. A clock that is uneven on purpose is made even by --resample",
            shortest(rate)
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_that_no_sampler_has_are_the_records_fault() {
        let rig = Rig::of_columns(&["x".to_owned()], crate::record::names::TimeChoice::default());
        let told = |step| check(Path::new("r.csv"), &rig, 3, step).map_err(|e| e.to_string());
        assert_eq!(told(0.5), Ok(2.0));
        let e = told(5e-324).unwrap_err();
        assert!(e.starts_with("r.csv: column t: found rows 5e-324 s apart"), "{e}");
        assert!(check(Path::new("r.csv"), &rig, 1, 5e-324).is_ok());
    }

    #[test]
    fn another_unit_of_time_is_named() {
        assert!(rate_remedy("t", 500.0 / 1e9, 500.0).starts_with("t is in ns, it seems: divide it by 1000000000"));
        assert!(rate_remedy("t", 0.5, 500.0).starts_with("t is in ms"));
        assert!(rate_remedy("t", 1e190, 500.0).starts_with("t must be in seconds"));
        assert!(
            rate_remedy("Timestamp", 250.0, 500.0).contains("otherwise Timestamp must be in seconds, or hold dates")
        );
        assert!(rate_remedy("t", 250.0, 500.0).starts_with("Set sample_rate_hz = 250 in the rig file"));
    }
}
