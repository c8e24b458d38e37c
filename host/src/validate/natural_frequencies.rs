//! Natural frequencies of the identified model (3.34), and those in the spectrum of a free
//! vibration.
//!
//! About rest, without drive and damping, (3.32) reads [[1 B11] [B21 1]] φ″ + diag(B12, B22) φ = 0,
//! so that (1 − B11 B21) w⁴ − (B12 + B22) w² + B12 B22 = 0 and f = w Ω/2π.
//!
//! A free record: the part of its longest stretch in which no angle exceeds `SMALL` any more (at
//! larger angles a pendulum is slower), the spectra of both sensors, each over its power, added;
//! the two highest peaks at least a quarter apart. Resolution: one over that part's length.

use core::f64::consts::TAU;

use serde::Serialize;

use crate::error::{BadInput, Result};
use crate::identify::{built_in, stretches};
use crate::model::identified::IdentifiedModel;
use crate::record::Record;
use crate::rig::{Rig, as_own};
use crate::signal::spectrum::{fast_length, line_at, welch};
use crate::system::library::Pendulum;
use crate::wording::format::in_seconds;

/// Largest angle of the part of a free vibration that is used, rad.
const SMALL: f64 = 0.35;
/// Relative difference up to which a model's frequency agrees with the measured one.
pub const AGREES: f64 = 0.1;

/// Natural frequencies of model and free vibration.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NaturalFrequencies {
    /// Of the model, Hz, lower first.
    pub model_hz: [f64; 2],
    /// In the free vibration, Hz.
    pub measured_hz: Option<[f64; 2]>,
    /// Resolution of that spectrum, Hz.
    pub resolution_hz: Option<f64>,
}

/// The model's natural frequencies, Hz; None where the coefficients have none.
pub fn of_model(b11: f64, b12: f64, b21: f64, b22: f64, omega: f64) -> Option<[f64; 2]> {
    let (a, b, c) = (1.0 - b11 * b21, b12 + b22, b12 * b22);
    let root = (b * b - 4.0 * a * c).sqrt();
    let squares = [(b - root) / (2.0 * a), (b + root) / (2.0 * a)];
    squares.iter().all(|s| s.is_finite() && *s > 0.0).then(|| squares.map(|s| s.sqrt() * omega / TAU))
}

/// The model's natural frequencies beside those of a free vibration; none where they are not known
/// of the model.
///
/// # Errors
/// As [`of_record`]; a free vibration for a model whose natural frequencies are not known.
pub fn compare(model: &IdentifiedModel, rig: &Rig, free: Option<&Record>) -> Result<Option<NaturalFrequencies>> {
    if model.system.pendulum() != Some(Pendulum::Double) {
        return match free {
            None => Ok(None),
            Some(record) => Err(BadInput::new(
                "a free vibration",
                "none: natural frequencies are known of the built-in double pendulum",
            )
            .in_file(&record.path)
            .at("--free")
            .remedy("Leave --free out")),
        };
    }
    let b = |n: &str| model.parameter(n).map(|p| p.value);
    let of_model = match (b("B11"), b("B12"), b("B21"), b("B22")) {
        (Some(b11), Some(b12), Some(b21), Some(b22)) => of_model(b11, b12, b21, b22, rig.omega()),
        _ => None,
    };
    let Some(model_hz) = of_model else { return Ok(None) };
    let measured = free.map(|record| of_record(record, &Rig { drive: None, ..rig.clone() })).transpose()?;
    Ok(Some(NaturalFrequencies { model_hz, measured_hz: measured.map(|m| m.0), resolution_hz: measured.map(|m| m.1) }))
}

/// The two frequencies of a free vibration, Hz, lower first, and the spectrum's resolution. `rig`:
/// without its drive.
///
/// # Errors
/// A record without angles, or whose small motion is too short for a spectrum with two peaks.
pub fn of_record(record: &Record, rig: &Rig) -> Result<([f64; 2], f64)> {
    let own = as_own::coordinates(rig)?;
    let bound = built_in::bound(&own)?;
    let stretches = stretches::of(record, &own, bound)?;
    let bad = |found: String| {
        BadInput::new(
            found,
            format!("some seconds of free vibration below {SMALL} rad with both natural frequencies in it"),
        )
        .in_file(&record.path)
        .at("--free")
        .remedy("Release the arms from a small angle, without the shaker, and record until they rest")
    };
    let longest = stretches.iter().max_by_key(|s| s.len()).ok_or_else(|| bad("no samples".to_owned()))?;
    let sensors = longest.sensors(bound);
    // Rest is where the motion ends, up to whole turns.
    let end = |x: &Vec<f64>| {
        let last = &x[x.len() - x.len().min(x.len() / 5 + 1)..];
        last.iter().sum::<f64>() / last.len().max(1) as f64
    };
    let rest: Vec<f64> = sensors.iter().map(end).collect();
    let large = |i: &usize| (0..rest.len()).any(|k| (sensors[k][*i] - rest[k]).abs() > SMALL);
    let first = (0..longest.len()).rev().find(large).map_or(0, |i| i + 1);
    let length = longest.len() - first;
    let rate = 1.0 / longest.step_s;
    if length < 64 {
        return Err(bad(format!("{} below that angle", in_seconds(length as f64 / rate))));
    }
    let piece = fast_length(length);
    let mut sum: Vec<f64> = Vec::new();
    let mut spectrum = None;
    for x in &sensors {
        let mut density = welch(&[&x[first..first + piece]], rate, piece).map_err(|e| bad(e.to_string()))?;
        let power: f64 = density.density.iter().skip(3).sum();
        if power > 0.0 {
            density.density.iter_mut().for_each(|d| *d /= power);
        }
        sum.resize(density.density.len(), 0.0);
        sum.iter_mut().zip(&density.density).for_each(|(s, d)| *s += d);
        spectrum = Some(density);
    }
    let Some(mut spectrum) = spectrum else { return Err(bad("no spectrum".to_owned())) };
    spectrum.density = sum;
    let d = &spectrum.density;
    let mut peaks: Vec<usize> =
        (3..d.len().saturating_sub(1)).filter(|m| d[*m] > d[m - 1] && d[*m] >= d[m + 1]).collect();
    peaks.sort_by(|a, b| d[*b].total_cmp(&d[*a]));
    let at = |m: usize| line_at(&spectrum, m).map_or_else(|| spectrum.frequency(m), |l| l.frequency_hz);
    let strongest = peaks.first().copied().ok_or_else(|| bad("no peak".to_owned()))?;
    let one = at(strongest);
    let two = peaks
        .iter()
        .skip(1)
        .map(|m| at(*m))
        .find(|f| f.max(one) / f.min(one) > 1.25)
        .ok_or_else(|| bad(format!("one peak, at {one:.3} Hz")))?;
    Ok(([one.min(two), one.max(two)], spectrum.bin_hz))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_seeds_values_give_the_frequencies_that_recomputing_gives() {
        // Table 3.3's coefficients: 1.348 and 2.912 Hz (method 1.2, errata).
        let f = of_model(0.1167, 0.0781, 1.6149, 0.2562, TAU * 5.0).unwrap();
        assert!((f[0] - 1.348).abs() < 1e-3 && (f[1] - 2.912).abs() < 1e-3, "{f:?}");
        assert!(of_model(2.0, 0.1, 2.0, 0.1, 1.0).is_none());
    }

    #[test]
    fn a_simulated_release_shows_its_natural_frequencies() {
        use crate::record::ReadOptions;
        use crate::rig::plant::Plant;
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml");
        let mut text = std::fs::read_to_string(&path).unwrap();
        text = text.replace("[drive]\ndirection = \"vertical\"\nfrequency_hz = 5.0\n", "");
        text = text.replace("initial = [0.3, 2.0, 0.0, 0.0]", "initial = [0.15, -0.1, 0.0, 0.0]");
        // Dry friction would stop arm 1 before its spectrum has a line.
        text = text.replace("settle_s = 20.0", "settle_s = 0.0").replace("tau_c1 = 6.03e-4", "tau_c1 = 1e-5");
        let rig = Rig::parse(&text, &path).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("free.parquet");
        crate::simulate::record(&rig, &[], 20.0, 1, &file, &indicatif::ProgressBar::hidden()).unwrap();
        let record = Record::read(&file, &rig, &ReadOptions::default()).unwrap();
        let (found, resolution) = of_record(&record, &rig).unwrap();
        let plant = Plant::of(&rig).unwrap();
        let b = |n: &str| plant.truth(n, 1.0).unwrap();
        let exact = of_model(b("B11"), b("B12"), b("B21"), b("B22"), 1.0).unwrap();
        for (f, e) in found.iter().zip(exact) {
            assert!((f - e).abs() < 0.05 * e + resolution, "{found:?} {exact:?}");
        }
    }
}
