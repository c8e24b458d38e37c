//! Damping from decays: c of M ẍ + c M ẋ + ∂V/∂x = 0, from the action of each window.
//!
//! Averaged over a period the power is −c ⟨ẋᵀM ẋ⟩ = −c ω² T2 and the energy changes as ω dI, I = ω
//! T2: hence İ = −c I, at every amplitude. c is the slope of ln I against time, each decay with its
//! own level, by least squares. Standard error from the scatter about the lines, raised for its
//! correlation from window to window (they overlap by half).

use serde::Serialize;

use super::polar::Polar;
use super::releases::Entry;
use super::systems::Mechanical;

/// Damping found in decays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Damping {
    /// c, 1/s.
    pub value: f64,
    /// Its standard error, 1/s.
    pub std_error: f64,
    /// Rms scatter of ln I about straight lines: what another law of damping leaves.
    pub scatter: f64,
}

/// Damping from the windows of the decays; none where no decay has three.
pub fn of_decays(
    polar: &Polar,
    entries: &[Entry],
    system: Option<&dyn Mechanical>,
    masses: Option<&[f64]>,
) -> Option<Damping> {
    let mut decays: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut release = None;
    for e in entries.iter().filter(|e| e.decaying) {
        let a: f64 = e.fit.cosine[1].iter().zip(&polar.major).map(|(x, p)| x * p).sum();
        let inertia = polar.averages(system, masses, a)?.inertia;
        if release != Some(e.release) {
            decays.push(Vec::new());
            release = Some(e.release);
        }
        if let Some(decay) = decays.last_mut() {
            decay.push((e.fit.middle, (e.fit.omega * inertia).ln()));
        }
    }
    fit(&decays)
}

/// The common slope of lines with a level each, negative.
fn fit(decays: &[Vec<(f64, f64)>]) -> Option<Damping> {
    let (mut cross, mut spread, mut count, mut lines) = (0.0, 0.0, 0.0, 0.0);
    let centred: Vec<Vec<(f64, f64)>> = decays
        .iter()
        .filter(|d| d.len() >= 3)
        .map(|d| {
            let n = d.len() as f64;
            let (t, y) = d.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0 / n, s.1 + p.1 / n));
            d.iter().map(|p| (p.0 - t, p.1 - y)).collect()
        })
        .collect();
    for d in &centred {
        cross += d.iter().map(|p| p.0 * p.1).sum::<f64>();
        spread += d.iter().map(|p| p.0 * p.0).sum::<f64>();
        count += d.len() as f64;
        lines += 1.0;
    }
    if lines == 0.0 || spread <= 0.0 {
        return None;
    }
    let slope = cross / spread;
    let (mut left, mut next) = (0.0, 0.0);
    for d in &centred {
        let rest: Vec<f64> = d.iter().map(|p| p.1 - slope * p.0).collect();
        left += rest.iter().map(|r| r * r).sum::<f64>();
        next += rest.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
    }
    let free = (count - lines - 1.0).max(1.0);
    let correlation = if left > 0.0 { (next / left).clamp(0.0, 0.9) } else { 0.0 };
    // Neighbours of correlation ρ, as of a first-order process: (1 + ρ)/(1 − ρ).
    let raised = (1.0 + correlation) / (1.0 - correlation);
    let found =
        Damping { value: -slope, std_error: (left / free / spread * raised).sqrt(), scatter: (left / count).sqrt() };
    found.value.is_finite().then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decays_of_different_level_have_one_slope() {
        let line = |level: f64, n: i32| -> Vec<(f64, f64)> {
            (0..n).map(|i| (f64::from(i), level - 0.02 * f64::from(i) + 1e-4 * (f64::from(i) * 2.3).sin())).collect()
        };
        let found = fit(&[line(1.0, 12), line(-2.0, 7), line(0.0, 2)]).unwrap();
        assert!((found.value - 0.02).abs() < 3.0 * found.std_error && found.std_error < 1e-4, "{found:?}");
        assert!(fit(&[line(1.0, 2)]).is_none() && fit(&[]).is_none());
    }
}
