//! The polar (action–angle) model: a nonlinear mode as a family of periodic motions x(a, φ) = Σ_k
//! X_k(a) cos kφ, φ̇ = ω(a).
//!
//! a is the first harmonic of the major coordinate. X_k/a and ω are polynomials in s = ln(1 +
//! (a/a0)²), which passes from powers of a² (weak motion) to powers of ln a (strong motion), where
//! polynomials in displacement and velocity stall; a0 and the degree are chosen by leaving out one
//! release at a time, the degree for ω and for the shapes apart. The linear mode, where it is
//! known, is the node s = 0.
//!
//! Where mass and potential are known the frequency is variational (Whitham's averaged Lagrangian
//! ½ω²T2(a) − V̄(a) is stationary): ω² = 2 V̄′(a)/T2′(a), V̄ = ⟨V⟩_φ, T2 = ⟨x_φᵀ M x_φ⟩_φ; an error
//! of the shapes enters squared; between releases far apart the equations give further nodes.
//! Otherwise ω is interpolated, the action is I = ω T2 with the masses taken as 1 (or as given),
//! and E = ∫ ω dI.

mod between;
mod fitting;

use serde::Serialize;
use std::f64::consts::TAU;

pub use self::between::{model_with, weighed};
pub use self::fitting::{again, model};
use super::release_fit::ReleaseFit;
use super::systems::Mechanical;

/// Phases over which averages are taken.
const PHASES: usize = 128;

/// A measured member of the family.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Amplitude.
    pub amplitude: f64,
    /// Angular frequency.
    pub omega: f64,
    /// Relative standard error of the node, for its weight.
    pub error: f64,
    /// X_k/a, `[k][channel]`.
    pub shape: Vec<Vec<f64>>,
    /// Standard error of X_k, one a channel (0 where not known).
    pub spread: Vec<f64>,
}

impl Node {
    /// From a fitted release.
    pub fn of(fit: &ReleaseFit, major: &[f64]) -> Self {
        let a: f64 = fit.cosine[1].iter().zip(major).map(|(x, p)| x * p).sum();
        Self {
            amplitude: a,
            omega: fit.omega,
            error: fit.omega_error / fit.omega,
            shape: fit.cosine.iter().map(|x| x.iter().map(|v| v / a).collect()).collect(),
            spread: fit.spread.clone(),
        }
    }
}

/// The model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Polar {
    /// Weights of the channels in the major coordinate.
    pub major: Vec<f64>,
    /// Scale of the amplitude in the s of ω².
    pub a0: f64,
    /// Coefficients of ω² in powers of s.
    pub omega_squared: Vec<f64>,
    /// Their standard errors ([`super::standard_error`]); empty where they have not been computed.
    pub omega_squared_std_error: Vec<f64>,
    /// Scale of the amplitude in the s of the shapes.
    pub shape_a0: f64,
    /// Coefficients of X_k/a in powers of s, `[k][channel][power]`.
    pub shape: Vec<Vec<Vec<f64>>>,
    /// Amplitudes between which the model was made: it may be used there.
    pub range: [f64; 2],
    /// Greatest relative error of ω at a release that was left out.
    pub left_out: Option<f64>,
    /// Whether there are no even harmonics.
    pub symmetric: bool,
    /// Whether the even harmonics are the releases' own, beside a mode that the equations say is
    /// symmetric: they belong to the displacements, not to the mode's frequency and energy.
    #[serde(skip)]
    pub beside: bool,
}

/// Averages over the phase at one amplitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Averages {
    /// Square of the free angular frequency.
    pub omega_squared: f64,
    /// T2 = ⟨x_φᵀ M x_φ⟩.
    pub inertia: f64,
    /// dT2/da.
    pub inertia_slope: f64,
}

/// Polynomial and its derivative.
fn horner(c: &[f64], s: f64) -> (f64, f64) {
    c.iter().rev().fold((0.0, 0.0), |(p, d), a| (p * s + a, d * s + p))
}

fn s_of(a: f64, a0: f64) -> f64 {
    (a / a0).powi(2).ln_1p()
}

impl Polar {
    /// Interpolated ω(a).
    pub fn omega(&self, a: f64) -> f64 {
        horner(&self.omega_squared, s_of(a, self.a0)).0.max(0.0).sqrt()
    }

    /// X_k(a), `[k][channel]`.
    pub fn harmonics(&self, a: f64) -> Vec<Vec<f64>> {
        let s = s_of(a, self.shape_a0);
        self.shape.iter().map(|x| x.iter().map(|c| a * horner(c, s).0).collect()).collect()
    }

    /// dX_k/da.
    pub fn slopes(&self, a: f64) -> Vec<Vec<f64>> {
        let s = s_of(a, self.shape_a0);
        // ds/da = 2a/(a0² + a²).
        let ds = 2.0 * a / (self.shape_a0 * self.shape_a0 + a * a);
        self.shape
            .iter()
            .map(|x| {
                x.iter()
                    .map(|c| {
                        let (p, d) = horner(c, s);
                        p + a * d * ds
                    })
                    .collect()
            })
            .collect()
    }

    /// The harmonics of the mode itself, from all of them.
    fn of_mode(&self, mut x: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        if self.beside {
            x.iter_mut().step_by(2).flatten().for_each(|v| *v = 0.0);
        }
        x
    }

    /// The displacements of all channels at amplitude a and phase φ.
    pub fn displacement(&self, a: f64, phi: f64) -> Vec<f64> {
        sum(&self.harmonics(a), |k| (k as f64 * phi).cos())
    }

    /// T2(a) = ⟨x_φᵀ x_φ⟩ weighted by masses of the channels (1 where none are given).
    pub fn inertia(&self, a: f64, masses: Option<&[f64]>) -> f64 {
        let x = self.harmonics(a);
        let mass = |c: usize| masses.and_then(|m| m.get(c)).copied().unwrap_or(1.0);
        x.iter()
            .enumerate()
            .map(|(k, x)| 0.5 * (k * k) as f64 * x.iter().enumerate().map(|(c, v)| mass(c) * v * v).sum::<f64>())
            .sum()
    }

    /// ω², T2 and T2′ at an amplitude: the system's own where its equations are known (see
    /// [`Self::variational_omega`]), otherwise the interpolated frequency and constant masses of
    /// the channels (1 where none are given). None where the averages do not give a frequency.
    pub fn averages(&self, system: Option<&dyn Mechanical>, masses: Option<&[f64]>, a: f64) -> Option<Averages> {
        let Some(system) = system else {
            let (x, dx) = (self.harmonics(a), self.slopes(a));
            let mass = |c: usize| masses.and_then(|m| m.get(c)).copied().unwrap_or(1.0);
            let product = |k: usize| -> f64 { (0..x[k].len()).map(|c| mass(c) * x[k][c] * dx[k][c]).sum() };
            let inertia_slope = (0..x.len()).map(|k| (k * k) as f64 * product(k)).sum();
            let omega_squared = self.omega(a).powi(2);
            return (omega_squared > 0.0).then(|| Averages {
                omega_squared,
                inertia: self.inertia(a, masses),
                inertia_slope,
            });
        };
        // Averages over half a turn: the motion retraces itself.
        let (x, dx) = (self.of_mode(self.harmonics(a)), self.of_mode(self.slopes(a)));
        let n = self.major.len();
        let (mut v, mut t, mut inertia) = (0.0, 0.0, 0.0);
        for i in 0..PHASES {
            let phi = 0.5 * TAU * (i as f64 + 0.5) / PHASES as f64;
            let at = sum(&x, |k| (k as f64 * phi).cos());
            let da = sum(&dx, |k| (k as f64 * phi).cos());
            let turn = sum(&x, |k| -(k as f64) * (k as f64 * phi).sin());
            let turn_da = sum(&dx, |k| -(k as f64) * (k as f64 * phi).sin());
            v += system.gradient(&at).iter().zip(&da).map(|(g, d)| g * d).sum::<f64>();
            let m = system.mass(&at);
            for p in 0..n {
                for q in 0..n {
                    t += 2.0 * turn[p] * m[p * n + q] * turn_da[q];
                    inertia += turn[p] * m[p * n + q] * turn[q];
                }
            }
            if system.constant_mass() {
                continue;
            }
            // The mass matrix changes along x_a: by a difference quotient in that direction.
            let h = 1e-5;
            let moved =
                |sign: f64| system.mass(&at.iter().zip(&da).map(|(x, d)| x + sign * h * a * d).collect::<Vec<f64>>());
            let (up, down) = (moved(1.0), moved(-1.0));
            for p in 0..n {
                for q in 0..n {
                    t += turn[p] * (up[p * n + q] - down[p * n + q]) / (2.0 * h * a) * turn[q];
                }
            }
        }
        let square = 2.0 * v / t;
        let phases = PHASES as f64;
        (square > 0.0 && square.is_finite()).then(|| Averages {
            omega_squared: square,
            inertia: inertia / phases,
            inertia_slope: t / phases,
        })
    }

    /// The variational frequency, ω² = 2 V̄′/T2′; None where the averages do not give one.
    pub fn variational_omega(&self, system: &dyn Mechanical, a: f64) -> Option<f64> {
        self.averages(Some(system), None, a).map(|v| v.omega_squared.sqrt())
    }

    /// The variational frequency, corrected by what it misses at the nodes (interpolated linearly
    /// in s): at a node the measured frequency.
    ///
    /// The variational one errs where the shapes' slopes are poorest, at the ends of the range; the
    /// nodes know better.
    pub fn corrected_omega(&self, system: &dyn Mechanical, nodes: &[Node], a: f64) -> Option<f64> {
        self.corrected_by(system, &self.correction(system, nodes), a)
    }

    /// What the variational frequency misses at the nodes, as [`Self::corrected_by`] takes it.
    pub fn correction(&self, system: &dyn Mechanical, nodes: &[Node]) -> Vec<(f64, f64)> {
        let mut ratio: Vec<(f64, f64)> = nodes
            .iter()
            .filter_map(|n| {
                Some((s_of(n.amplitude, self.shape_a0), n.omega / self.variational_omega(system, n.amplitude)?))
            })
            .collect();
        if self.range[0] == 0.0 {
            ratio.push((0.0, 1.0));
        }
        ratio.sort_by(|a, b| a.0.total_cmp(&b.0));
        ratio
    }

    /// The variational frequency times the correction.
    pub fn corrected_by(&self, system: &dyn Mechanical, ratio: &[(f64, f64)], a: f64) -> Option<f64> {
        let omega = self.variational_omega(system, a)?;
        let s = s_of(a, self.shape_a0);
        let (first, last) = (ratio.first()?, ratio.last()?);
        let factor = if s <= first.0 {
            first.1
        } else if s >= last.0 {
            last.1
        } else {
            let w = ratio.windows(2).find(|w| s <= w[1].0)?;
            w[0].1 + (w[1].1 - w[0].1) * (s - w[0].0) / (w[1].0 - w[0].0).max(1e-300)
        };
        Some(omega * factor)
    }

    /// Energy by E = ∫ ω dI from rest, at rising amplitudes.
    pub fn energies(&self, amplitudes: &[f64], masses: Option<&[f64]>) -> Vec<f64> {
        let steps = 400;
        let (mut energy, mut at, mut action) = (0.0, 0.0, 0.0);
        amplitudes
            .iter()
            .map(|&to| {
                for i in 1..=steps {
                    let a = at + (to - at) * f64::from(i) / f64::from(steps);
                    let before = at + (to - at) * f64::from(i - 1) / f64::from(steps);
                    let next = self.omega(a) * self.inertia(a, masses);
                    energy += self.omega(0.5 * (a + before)) * (next - action);
                    action = next;
                }
                at = to;
                energy
            })
            .collect()
    }

    /// The amplitude whose rest state has this major coordinate; None outside of three times the
    /// range.
    pub fn amplitude_of(&self, rest: &[f64]) -> Option<f64> {
        let want: f64 = rest.iter().zip(&self.major).map(|(x, p)| x * p).sum::<f64>().abs();
        let height = |a: f64| self.displacement(a, 0.0).iter().zip(&self.major).map(|(x, p)| x * p).sum::<f64>();
        self.first_above(height, want)
    }

    /// The amplitude whose rest state has this potential energy.
    pub fn amplitude_at(&self, system: &dyn Mechanical, energy: f64) -> Option<f64> {
        self.first_above(|a| system.potential(&sum(&self.of_mode(self.harmonics(a)), |_| 1.0)), energy)
    }

    /// Where a function of the amplitude reaches a value: within the range or as little beyond it
    /// as need be, for polynomials far beyond it mean nothing.
    fn first_above(&self, f: impl Fn(f64) -> f64, value: f64) -> Option<f64> {
        [1.0, 1.02, 1.1, 1.3, 2.0, 3.0].iter().find_map(|most| bisect(&f, value, most * self.range[1]))
    }
}

/// Σ_k w_k X_k.
fn sum(x: &[Vec<f64>], w: impl Fn(usize) -> f64) -> Vec<f64> {
    let mut out = vec![0.0; x.first().map_or(0, Vec::len)];
    for (k, x) in x.iter().enumerate() {
        let w = w(k);
        for (o, v) in out.iter_mut().zip(x) {
            *o += w * v;
        }
    }
    out
}

/// The point in (0, most) at which a rising function reaches a value.
pub fn bisect(f: impl Fn(f64) -> f64, value: f64, most: f64) -> Option<f64> {
    let (mut low, mut high) = (0.0, most);
    if !(value.is_finite() && value >= 0.0) || f(high) < value {
        return None;
    }
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if f(middle) < value { low = middle } else { high = middle }
    }
    Some(0.5 * (low + high))
}

#[cfg(test)]
mod tests;
