//! Poincaré sections of the measured record and of the model's own, side by side.

use serde::Serialize;

use super::energy_distance::{EnergyTest, energy_test};
use crate::phase_space::poincare_section::Section;
use crate::phase_space::survey::PhaseSpace;

/// Two sections at one phase of the drive.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SectionComparison {
    /// Phase of the drive, rad.
    pub tau: f64,
    /// Names of the coordinates.
    pub names: Vec<String>,
    /// Measured.
    pub measured: Section,
    /// Of the model's own record.
    pub simulated: Section,
    /// Energy distance and its permutation test; none with too few points.
    pub test: Option<EnergyTest>,
}

/// All sections; none where either record has none or repeats.
pub fn compare(measured: &PhaseSpace, simulated: &PhaseSpace, seed: u64) -> Vec<SectionComparison> {
    let names: Vec<String> = measured.coordinates.iter().map(|c| c.name.clone()).collect();
    // A record that repeats has no exponent; its sections are a few points that no test tells apart
    // by distance.
    if measured.lyapunov.is_none() || simulated.lyapunov.is_none() || simulated.coordinates.len() != names.len() {
        return Vec::new();
    }
    measured
        .sections
        .iter()
        .zip(&simulated.sections)
        .map(|(a, b)| {
            let (x, y) = features(a, b);
            SectionComparison {
                tau: a.tau,
                names: names.clone(),
                measured: a.clone(),
                simulated: b.clone(),
                test: energy_test(&x, &y, seed),
            }
        })
        .collect()
}

/// Points as features of equal weight: cosine and sine of each angle, and each velocity over its
/// scatter in both sections together.
fn features(a: &Section, b: &Section) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let coordinates = a.value.len().min(b.value.len());
    let scale: Vec<f64> = (0..coordinates)
        .map(|c| {
            let all: Vec<f64> = a.velocity[c].iter().chain(&b.velocity[c]).map(|v| f64::from(*v)).collect();
            let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
            let variance = all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / all.len().max(1) as f64;
            if variance > 0.0 { variance.sqrt() } else { 1.0 }
        })
        .collect();
    let points = |s: &Section| -> Vec<Vec<f64>> {
        let n = s.value.iter().map(Vec::len).min().unwrap_or(0);
        (0..n)
            .map(|i| {
                (0..coordinates)
                    .flat_map(|c| {
                        let angle = f64::from(s.value[c][i]);
                        [angle.cos(), angle.sin(), f64::from(s.velocity[c][i]) / scale[c]]
                    })
                    .collect()
            })
            .collect()
    };
    (points(a), points(b))
}
