//! Whether the base moved by the amplitude that the rig file states (`drive.amplitude_m`).
//!
//! No parameter is computed from it, since gravity fixes it: of the double pendulum a = g √(B23² +
//! B24²)/(B22 Ω²), of every other system that has one its parameter `a`. Where the base is
//! measured, a is its channel's line at the drive's frequency over the gain that gravity gives it.
//! ln of the ratio over its standard error is judged as in [`super::known_quantities`].
//!
//! Limits: a time base that is off (or another g) moves a by the same factor as l1 = g B21/(B22
//! Ω²), so that a record tells an amplitude from a time base only where l1 is known: without it
//! both are named.

use statrs::distribution::{ContinuousCDF, StudentsT};

use super::Identification;
use super::judgement::{CHANCE, Coefficients};
use super::known_quantities::coefficient;
use crate::record::Record;
use crate::rig::measures::BASE;
use crate::rig::{GRAVITY, Rig};
use crate::signal::spectrum::amplitude_at;
use crate::system::library::Pendulum;
use crate::warning::Warning;
use crate::wording::format::{quantity, significant};

/// Relative difference that is told: no shaker is told its amplitude more truly.
const LEAST: f64 = 0.01;
/// The same of an amplitude that the device was told to make another one than the rig file's.
const OVERRULED: f64 = 1e-3;

/// A warning where the record's base moved otherwise than stated.
pub(super) fn contradicted(records: &[Record], rig: &Rig, result: &Identification) -> Option<Warning> {
    let stated = rig.drive?.amplitude_m.filter(|a| *a > 0.0)?;
    // Of a record that is at fault itself nothing further is said.
    if result.warnings.iter().any(|w| w.invalidates) || records.iter().any(|r| overruled(r, stated)) {
        return None;
    }
    let blocks = result.details.jackknife_blocks;
    let (found, error, how) = measured(records, rig, result)
        .map(|(a, error)| (a, error, "as its channel shows"))
        .or_else(|| by_gravity(rig, result).map(|(a, error)| (a, error, "as gravity tells")))?;
    let missed = (stated / found).ln();
    let t = StudentsT::new(0.0, 1.0, (blocks.max(2) - 1) as f64).ok()?;
    if blocks < 3 || missed.abs() < LEAST || 2.0 * t.sf(missed.abs() / error) >= CHANCE {
        return None;
    }
    let mut advice = "Correct the rig file: `whirl capture` and `whirl plan` go by it. No parameter is computed from it, so that these stand".to_owned();
    if rig.pendulum() == Some(Pendulum::Double) && !rig.known.contains_key("l1") {
        advice += &format!(
            ". Where it is sure, the time base (or the drive's frequency) is off by a factor of {}, and l1 with it: l1 under [known] tells which",
            significant((missed / 2.0).exp(), 4)
        );
    }
    Some(
        Warning::new(
            "drive-amplitude",
            format!(
                "drive.amplitude_m is {}, but the base moved by {} in this record, {how}",
                quantity(stated, "m", 4),
                quantity(found, "m", 4)
            ),
            advice,
        )
        .with("stated_m", stated)
        .with("value_m", found)
        .with("std_error", found * error),
    )
}

/// Whether the device was told another amplitude than the rig file's: that says nothing of this
/// record then.
fn overruled(record: &Record, stated: f64) -> bool {
    let told = record.segments.iter().filter_map(|s| s.amplitude_nm.as_deref()).flatten();
    told.clone().any(|nm| (1e-9 * f64::from(*nm) / stated - 1.0).abs() > OVERRULED)
}

/// Amplitude, m, and its relative standard error, by the coefficients.
fn by_gravity(rig: &Rig, result: &Identification) -> Option<(f64, f64)> {
    if rig.bound.is_some() || rig.pendulum() != Some(Pendulum::Double) {
        return result.parameter("a").filter(|a| a.value > 0.0).map(|a| (a.value, a.std_error / a.value));
    }
    let c = Coefficients::of(result);
    let ((b22, of_b22), (b25, of_b25)) = (coefficient(&c, "B22")?, coefficient(&c, "B25")?);
    let g = rig.known.get("g").copied().unwrap_or(GRAVITY);
    let error = c.variance(&(of_b25 / b25 - of_b22 / b22)).sqrt();
    let found = g * b25 / (b22 * rig.omega().powi(2));
    (found > 0.0 && found.is_finite() && error.is_finite()).then_some((found, error))
}

/// The same where a channel measures the base.
fn measured(records: &[Record], rig: &Rig, result: &Identification) -> Option<(f64, f64)> {
    let channel = rig.channel.iter().position(|c| c.measures == BASE)?;
    let gain = result.parameter("base_gain").filter(|p| p.value > 0.0)?;
    let frequency_hz = rig.drive?.frequency_hz;
    let (record, segment) =
        records.iter().flat_map(|r| r.segments.iter().map(move |s| (r, s))).max_by_key(|(_, s)| s.len())?;
    let of = &record.channels[channel];
    let shown = segment.columns[channel].angle(of);
    let line = amplitude_at(&shown, 1.0 / segment.step_s, frequency_hz).norm();
    let line = if of.unit == "m/s2" { line / rig.omega().powi(2) } else { line };
    (line > 0.0).then_some((line / gain.value, gain.std_error / gain.value))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::identify::judgement::tests::identified;
    use crate::record::Segment;

    /// The chaotic rig with an amplitude stated, and coefficients that l1 = 63.5 mm and a base that
    /// moved by 15.525 mm give.
    fn told(stated: f64, l1: bool, device_nm: Option<u32>) -> Option<Warning> {
        let mut rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml")).unwrap();
        rig.drive.as_mut().unwrap().amplitude_m = Some(stated);
        if !l1 {
            rig.known.remove("l1");
        }
        let second = rig.omega().powi(2);
        let b22 = 9.81 * 1.68 / (0.0635 * second);
        let result = identified(&[("B22", b22), ("B23", -0.015_525 * b22 * second / 9.81), ("B24", 0.0)]);
        let amplitude_nm = device_nm.map(|nm| vec![nm; 10]);
        let segment = Segment { amplitude_nm, ..Segment::new(0.0, 0.002, Vec::new()) };
        let record = Record::of("r.parquet", &rig, vec![segment]);
        contradicted(&[record], &rig, &result)
    }

    #[test]
    fn an_amplitude_that_gravity_contradicts_is_named() {
        let w = told(0.031_05, true, None).unwrap();
        assert!(w.id == "drive-amplitude" && !w.invalidates, "{w:?}");
        assert!(w.text.contains("is 31.05 mm") && w.text.contains("by 15.53 mm"), "{}", w.text);
        assert!((w.details["value_m"].as_f64().unwrap() / 0.015_525 - 1.0).abs() < 1e-9);
        // A known length agrees, so that the time base does not stand for it.
        assert!(!w.advice.contains("time base"), "{}", w.advice);
        assert!(told(0.031_05, false, None).unwrap().advice.contains("off by a factor of 1.414, and l1 with it"));
        // Right, within a shaker's errors, or another one by the command line.
        for (stated, device) in [(0.015_525, None), (0.015_6, None), (0.031_05, Some(15_525_000))] {
            assert_eq!(told(stated, false, device), None, "{stated}");
        }
        assert!(told(0.031_05, false, Some(31_050_000)).is_some());
    }
}
