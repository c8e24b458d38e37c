//! Energy balance: a second step for small terms, after the harmonic balance.
//!
//! *Dampings* (3.35) to (3.38). Multiplied by φ_e′ and integrated over an orbit, an equation
//! becomes Σ_j λ_j W_j = −ΔK, W_j = ∫ X_j φ_e′ dτ. Over an orbit that closes ΔK and the
//! conservative terms vanish; what dissipates then equals what the drive feeds in, with the other
//! coefficients taken from the harmonic balance. Each equation by itself is the seed's way; its
//! coupling moved to the right is as large as the drive's share, and C12/C2 need not obey the tie.
//! In the sum J_o1·(first)·φ1′ + J_o2·(second)·φ2′ the coupling is the change of H φ1′ φ2′ cos Δ
//! and cancels over an orbit. Divided by J_o1, with ρ = J_o2/J_o1 = B11/B21:
//!
//! C11 ∫|φ1′| + C12 ∫(φ2′ − φ1′)² = −Δ[½φ1′² + ½ρφ2′² + B11 φ1′ φ2′ cos Δ − B12 cos φ1 − ρB22 cos
//! φ2] − (drive's work), C2 = C12/ρ.
//!
//! The energies at both ends are measured, so that pieces need not close.
//!
//! *Small stiffness* (6.2), (6.3). Multiplied by x instead, ẍ + kx + cẋ + a xᵐ = f(t) gives over a
//! closed orbit a ∫ x^{m+1} = ∫ ẋ² − k ∫ x² + ∫ f x, in which no acceleration and no damping is
//! left.

use nalgebra::{DMatrix, DVector};

use super::harmonic_balance::equations::{Equations, Role};
use super::harmonic_balance::orbit::State;
use super::harmonic_balance::rows::Expanded;
use super::harmonic_balance::settings::EnergyBalance;
use crate::model::double_pendulum::DAMPINGS;

/// Solves rows (columns and target) by least squares; `None` where they do not determine the
/// unknowns.
fn least_squares(rows: &[Vec<f64>], columns: usize) -> Option<Vec<f64>> {
    if columns == 0 {
        return Some(Vec::new());
    }
    if rows.len() < columns {
        return None;
    }
    let a = DMatrix::from_fn(rows.len(), columns, |r, c| rows[r][c]);
    let b = DVector::from_fn(rows.len(), |r, _| rows[r][columns]);
    let scale: Vec<f64> = (0..columns).map(|c| a.column(c).norm()).collect();
    if scale.iter().any(|s| *s == 0.0 || !s.is_finite()) {
        return None;
    }
    let scaled = DMatrix::from_fn(rows.len(), columns, |r, c| a[(r, c)] / scale[c]);
    let svd = scaled.svd(true, true);
    if svd.singular_values.min() < 1e-9 * svd.singular_values.max() {
        return None;
    }
    let x = svd.solve(&b, 0.0).ok()?;
    Some((0..columns).map(|c| x[c] / scale[c]).collect())
}

/// Dampings by the energy balance over `orbits`; the other coefficients, and dampings that are
/// `known`, stay as they are. `None` where the orbits do not determine them.
pub fn dampings(
    equations: &Equations,
    orbits: &[&Expanded],
    coefficients: &[Vec<f64>],
    known: &dyn Fn(&str) -> bool,
    kind: EnergyBalance,
) -> Option<Vec<Vec<f64>>> {
    match kind {
        EnergyBalance::None => Some(coefficients.to_vec()),
        EnergyBalance::Equations => by_equation(equations, orbits, coefficients, known),
        EnergyBalance::Coupled => coupled(equations, orbits, coefficients, known),
    }
}

/// Change of a quantity from the start to the end of an orbit.
fn change(ends: &[State; 2], of: impl Fn(&State) -> f64) -> f64 {
    of(&ends[1]) - of(&ends[0])
}

fn by_equation(
    equations: &Equations,
    orbits: &[&Expanded],
    coefficients: &[Vec<f64>],
    known: &dyn Fn(&str) -> bool,
) -> Option<Vec<Vec<f64>>> {
    let mut out = coefficients.to_vec();
    for (e, terms) in equations.terms.iter().enumerate() {
        let unknown: Vec<usize> =
            (0..terms.len()).filter(|&j| terms[j].role == Role::Damping && !known(&terms[j].name)).collect();
        let rows: Vec<Vec<f64>> = orbits
            .iter()
            .map(|o| {
                let w = &o.work[e];
                let moved: f64 = (0..terms.len())
                    .filter(|j| terms[*j].role != Role::Conservative && !unknown.contains(j))
                    .map(|j| coefficients[e][j] * w[j])
                    .sum();
                unknown.iter().map(|&j| w[j]).chain([-moved]).collect()
            })
            .collect();
        for (j, value) in unknown.iter().zip(least_squares(&rows, unknown.len())?) {
            out[e][*j] = value;
        }
    }
    Some(out)
}

fn coupled(
    equations: &Equations,
    orbits: &[&Expanded],
    coefficients: &[Vec<f64>],
    known: &dyn Fn(&str) -> bool,
) -> Option<Vec<Vec<f64>>> {
    let find = |e: usize, name: &str| equations.terms.get(e)?.iter().position(|t| t.name == name);
    let coupling = [find(0, "B11"), find(1, "B21")];
    let rho = match (coupling[0], coupling[1]) {
        (Some(a), Some(b)) => coefficients[0][a] / coefficients[1][b],
        _ => 1.0,
    };
    if !(rho.is_finite() && rho > 0.0) {
        return None;
    }
    let weight = |e: usize| if e == 0 { 1.0 } else { rho };
    // Each torque: its terms in the equations.
    let mut torques: Vec<Vec<(usize, usize)>> = Vec::new();
    for (e, terms) in equations.terms.iter().enumerate() {
        for (j, t) in terms.iter().enumerate().filter(|(_, t)| t.role == Role::Damping && !known(&t.name)) {
            let partner = DAMPINGS
                .iter()
                .find(|d| e == 1 && d.names[1] == Some(t.name.as_str()))
                .and_then(|d| d.names[0])
                .and_then(|first| find(0, first));
            match partner.and_then(|p| torques.iter_mut().find(|t| t.contains(&(0, p)))) {
                Some(torque) => torque.push((e, j)),
                None => torques.push(vec![(e, j)]),
            }
        }
    }
    let unknown = |e: usize, j: usize| torques.iter().flatten().any(|t| *t == (e, j));
    let rows: Vec<Vec<f64>> = orbits
        .iter()
        .map(|o| {
            let kinetic = change(&o.ends, |s| {
                let own: f64 = (0..equations.terms.len()).map(|e| 0.5 * weight(e) * s.rate[e] * s.rate[e]).sum();
                let together = coupling[0]
                    .map_or(0.0, |j| coefficients[0][j] * s.rate[0] * s.rate[1] * (s.angle[1] - s.angle[0]).cos());
                own + together
            });
            let mut right = -kinetic;
            for (e, terms) in equations.terms.iter().enumerate() {
                for (j, t) in terms.iter().enumerate() {
                    if unknown(e, j) || (coupling[0].is_some() && coupling[e] == Some(j)) {
                        continue;
                    }
                    let work = t.potential.map_or(o.work[e][j], |u| change(&o.ends, u));
                    right -= weight(e) * coefficients[e][j] * work;
                }
            }
            // In equation 2 the coefficient is c/ρ, and its weight ρ.
            let columns = torques.iter().map(|t| t.iter().map(|(e, j)| o.work[*e][*j]).sum());
            columns.chain([right]).collect()
        })
        .collect();
    let mut out = coefficients.to_vec();
    for (torque, value) in torques.iter().zip(least_squares(&rows, torques.len())?) {
        for (e, j) in torque {
            out[*e][*j] = value / weight(*e);
        }
    }
    Some(out)
}

/// One closed orbit of an oscillator under a known force, evenly sampled over exactly one period,
/// in one unit of time.
#[derive(Clone, Debug)]
pub struct ForcedOrbit {
    /// x.
    pub x: Vec<f64>,
    /// f(t).
    pub force: Vec<f64>,
    /// Its period, in the unit of time of k.
    pub period: f64,
}

/// a of ẍ + kx + cẋ + a xᵐ = f(t) by (6.3), over several orbits, with its standard error (jackknife
/// over orbits; infinite for a single one). Velocities come from the Fourier series. `None` without
/// orbits, or where x rests.
pub fn small_stiffness(orbits: &[ForcedOrbit], k: f64, power: i32) -> Option<(f64, f64)> {
    let rows: Vec<(f64, f64)> = orbits
        .iter()
        .filter(|o| o.x.len() >= 4 && o.force.len() == o.x.len())
        .map(|o| {
            let fourier = super::harmonic_balance::fourier::Fourier::new(&mut rustfft::FftPlanner::new(), o.x.len());
            // d/dt = (2π/period) d/dτ of an orbit of one period.
            let scale = std::f64::consts::TAU / o.period;
            let rate = fourier.series(fourier.derivative(&fourier.of_real(&o.x), 1.0));
            let mean = |f: &dyn Fn(usize) -> f64| (0..o.x.len()).map(f).sum::<f64>() / o.x.len() as f64;
            let left = mean(&|i| o.x[i].powi(power + 1));
            let right = mean(&|i| (scale * rate[i].re).powi(2) - k * o.x[i] * o.x[i] + o.force[i] * o.x[i]);
            (left * o.period, right * o.period)
        })
        .collect();
    let solve = |skip: Option<usize>| {
        let (num, den) = rows
            .iter()
            .enumerate()
            .filter(|(i, _)| Some(*i) != skip)
            .fold((0.0, 0.0), |(n, d), (_, (l, r))| (n + l * r, d + l * l));
        (den > 0.0).then(|| num / den)
    };
    let all = solve(None)?;
    let g = rows.len() as f64;
    let spread: Option<Vec<f64>> = (0..rows.len()).map(|i| solve(Some(i)).map(|x| (x - all).powi(2))).collect();
    let error = spread.map_or(f64::INFINITY, |s| ((g - 1.0) / g * s.iter().sum::<f64>()).sqrt());
    Some((all, error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// A motion x is chosen, and the force that makes it a solution: (6.3) must give back a.
    #[test]
    fn a_small_cubic_term_is_found_exactly_from_closed_orbits() {
        let (k, c, a) = (1.3, 0.05, 2e-3);
        let orbits: Vec<ForcedOrbit> = [0.8, 1.1, 1.7]
            .iter()
            .map(|omega| {
                let n = 240;
                let t = |i: usize| TAU / omega * i as f64 / n as f64;
                let x = |t: f64| 0.9 * (omega * t).sin() + 0.2 * (3.0 * omega * t).cos();
                let v = |t: f64| 0.9 * omega * (omega * t).cos() - 0.6 * omega * (3.0 * omega * t).sin();
                let w =
                    |t: f64| -0.9 * omega * omega * (omega * t).sin() - 1.8 * omega * omega * (3.0 * omega * t).cos();
                let force = |t: f64| w(t) + k * x(t) + c * v(t) + a * x(t).powi(3);
                ForcedOrbit {
                    x: (0..n).map(|i| x(t(i))).collect(),
                    force: (0..n).map(|i| force(t(i))).collect(),
                    period: TAU / omega,
                }
            })
            .collect();
        let (found, error) = small_stiffness(&orbits, k, 3).unwrap();
        assert!((found / a - 1.0).abs() < 1e-9 && error < 1e-10, "{found} {error}");
        assert!(small_stiffness(&[], k, 3).is_none());
    }
}
