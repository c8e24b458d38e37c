//! The seed's single-degree-of-freedom models: the major coordinate's equation alone (5.14), with
//! an added constraint (5.15, 5.21) for the minor coordinates, nonlinearity in the major coordinate
//! only (type I, 5.19, 5.24) or in both (type II, 5.20, 5.25).
//!
//! Major coordinate y = p·x and minor coordinates z_j = p_j·x, p the proper orthogonal modes.
//! Constraint z_j = Σ a_ik y^i ẏ^k, by least squares over all releases, weighted (5.23) by 1/rms of
//! a release where asked. Equation ÿ = Σ c_i f_i(y, z, ẏ). Time is scaled, τ = ω0 t with ω0 the
//! lowest frequency of the releases, so that coefficients of different powers compare: all
//! coefficients are in that time. Terms odd in ẏ make orbits drift in amplitude, because free
//! motion without damping is reversible; [`select`] weighs that.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::f64::consts::TAU;

use super::release_fit::{ReleaseFit, least_squares};

/// Samples of an orbit used in the fits.
const PHASES: usize = 120;
/// Integration steps a period.
const STEPS: usize = 200;

/// One release in proper orthogonal coordinates and scaled time, over one period.
#[derive(Clone, Debug)]
pub struct Orbit {
    /// Major coordinate, velocity, acceleration.
    pub y: Vec<[f64; 3]>,
    /// Minor coordinates, `[mode][sample]`.
    pub z: Vec<Vec<f64>>,
    /// Frequency in scaled time.
    pub omega: f64,
    /// Weight in the fits.
    pub weight: f64,
}

/// The releases as orbits: `modes[0]` is the major one. Answers ω0 too.
pub fn orbits(fits: &[&ReleaseFit], modes: &[Vec<f64>], weighted: bool) -> (Vec<Orbit>, f64) {
    let unit = fits.iter().map(|f| f.omega).fold(f64::INFINITY, f64::min);
    let orbits = fits
        .iter()
        .map(|fit| {
            let mut y = Vec::with_capacity(PHASES);
            let mut z = vec![Vec::with_capacity(PHASES); modes.len().saturating_sub(1)];
            for i in 0..PHASES {
                let phi = TAU * i as f64 / PHASES as f64;
                let motion: Vec<[f64; 3]> = (0..modes[0].len()).map(|c| fit.motion(c, phi)).collect();
                let dot = |mode: &[f64], d: usize| motion.iter().zip(mode).map(|(x, p)| x[d] * p).sum::<f64>();
                y.push([dot(&modes[0], 0), dot(&modes[0], 1) / unit, dot(&modes[0], 2) / (unit * unit)]);
                for (z, mode) in z.iter_mut().zip(&modes[1..]) {
                    z.push(dot(mode, 0));
                }
            }
            let rms = (y.iter().map(|y| y[0] * y[0]).sum::<f64>() / PHASES as f64).sqrt();
            let weight = if weighted && rms > 0.0 { 1.0 / rms } else { 1.0 };
            Orbit { y, z, omega: fit.omega / unit, weight }
        })
        .collect();
    (orbits, unit)
}

/// A function of y, ẏ, and the first minor coordinate z.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Function {
    /// y^i ẏ^k z^j.
    Monomial {
        /// i.
        y: i32,
        /// k.
        velocity: i32,
        /// j.
        z: i32,
    },
    /// (α y + β z)³: a cubic spring at a measured coordinate.
    Cubed {
        /// α.
        y: f64,
        /// β.
        z: f64,
    },
}

impl Function {
    /// y^i.
    pub const fn power(y: i32) -> Self {
        Self::Monomial { y, velocity: 0, z: 0 }
    }

    /// Its value.
    pub fn at(&self, y: f64, v: f64, z: f64) -> f64 {
        match *self {
            Self::Monomial { y: i, velocity: k, z: j } => y.powi(i) * v.powi(k) * z.powi(j),
            Self::Cubed { y: a, z: b } => (a * y + b * z).powi(3),
        }
    }
}

/// A function with its coefficient.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Term {
    /// The function.
    pub of: Function,
    /// Coefficient, in scaled time.
    pub value: f64,
    /// Standard error.
    pub std_error: f64,
}

/// A reduced model of the seed's kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConstraintModel {
    /// z_j = Σ terms, one list a minor coordinate; empty lists: z = 0.
    pub constraint: Vec<Vec<Term>>,
    /// ÿ = Σ terms.
    pub equation: Vec<Term>,
    /// ω0 of the scaled time.
    pub time_unit: f64,
    /// Modes, major first.
    pub modes: Vec<Vec<f64>>,
}

/// How a simulated release of a model behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Behaviour {
    /// Frequency in unscaled time.
    pub omega: f64,
    /// Relative change of the amplitude over ten periods.
    pub drift: f64,
}

fn fit_terms(orbits: &[Orbit], functions: &[Function], target: impl Fn(&Orbit, usize) -> f64) -> Option<Vec<Term>> {
    let rows = orbits.len() * PHASES;
    let mut a = DMatrix::zeros(rows, functions.len());
    let mut b = DVector::zeros(rows);
    for (o, orbit) in orbits.iter().enumerate() {
        for i in 0..PHASES {
            let z = orbit.z.first().map_or(0.0, |z| z[i]);
            let [y, v, _] = orbit.y[i];
            for (j, f) in functions.iter().enumerate() {
                a[(o * PHASES + i, j)] = orbit.weight * f.at(y, v, z);
            }
            b[o * PHASES + i] = orbit.weight * target(orbit, i);
        }
    }
    // A function that stays zero on these orbits (z of a mode that does not move) takes no part.
    let used: Vec<usize> = (0..functions.len()).filter(|j| a.column(*j).amax() > 0.0).collect();
    let (value, error) = least_squares(&a.select_columns(&used), &b)?;
    Some(
        used.iter()
            .enumerate()
            .map(|(i, j)| Term { of: functions[*j].clone(), value: value[i], std_error: error[i] })
            .collect(),
    )
}

/// Fits a model: `constraint` functions (none: z = 0) of y and ẏ, `equation` functions of y, ẏ and
/// z.
pub fn fit(
    orbits: &[Orbit],
    modes: &[Vec<f64>],
    time_unit: f64,
    constraint: &[Function],
    equation: &[Function],
) -> Option<ConstraintModel> {
    let minor = modes.len().saturating_sub(1);
    let mut constraints = Vec::with_capacity(minor);
    for j in 0..minor {
        constraints.push(if constraint.is_empty() {
            Vec::new()
        } else {
            fit_terms(orbits, constraint, |o, i| o.z[j][i])?
        });
    }
    let equation = fit_terms(orbits, equation, |o, i| o.y[i][2])?;
    Some(ConstraintModel { constraint: constraints, equation, time_unit, modes: modes.to_vec() })
}

impl ConstraintModel {
    fn minor(&self, j: usize, y: f64, v: f64) -> f64 {
        self.constraint.get(j).map_or(0.0, |c| c.iter().map(|t| t.value * t.of.at(y, v, 0.0)).sum())
    }

    /// ÿ in scaled time.
    pub fn acceleration(&self, y: f64, v: f64) -> f64 {
        let z = self.minor(0, y, v);
        self.equation.iter().map(|t| t.value * t.of.at(y, v, z)).sum()
    }

    /// All channels' displacements at (y, ẏ), ẏ in scaled time.
    pub fn displacement(&self, y: f64, v: f64) -> Vec<f64> {
        let mut x: Vec<f64> = self.modes[0].iter().map(|p| p * y).collect();
        for (j, mode) in self.modes.iter().skip(1).enumerate() {
            let z = self.minor(j, y, v);
            for (x, p) in x.iter_mut().zip(mode) {
                *x += p * z;
            }
        }
        x
    }

    fn step(&self, y: &mut [f64; 2], h: f64) {
        let f = |s: [f64; 2]| [s[1], self.acceleration(s[0], s[1])];
        let add = |s: [f64; 2], k: [f64; 2], h: f64| [s[0] + h * k[0], s[1] + h * k[1]];
        let k1 = f(*y);
        let k2 = f(add(*y, k1, 0.5 * h));
        let k3 = f(add(*y, k2, 0.5 * h));
        let k4 = f(add(*y, k3, h));
        for i in 0..2 {
            y[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }

    /// (y, ẏ) at times `step` apart (unscaled), from rest at y0. Ends early where the model runs
    /// away.
    pub fn simulate(&self, y0: f64, step: f64, count: usize) -> Vec<[f64; 2]> {
        let mut state = [y0, 0.0];
        let scaled = step * self.time_unit;
        let sub = (scaled / (TAU / STEPS as f64)).ceil().clamp(1.0, 1e4) as usize;
        let mut out = Vec::with_capacity(count);
        for _ in 0..count {
            if !state[0].is_finite() || state[0].abs() >= 100.0 * y0.abs() {
                break;
            }
            out.push(state);
            for _ in 0..sub {
                self.step(&mut state, scaled / sub as f64);
            }
        }
        out
    }

    /// Frequency and drift of a release from rest at y0; None where the motion does not come back.
    pub fn behaviour(&self, y0: f64) -> Option<Behaviour> {
        let h = TAU / STEPS as f64;
        let mut state = [y0, 0.0];
        let mut tops: Vec<(f64, f64)> = vec![(0.0, y0)];
        let side = y0.signum();
        for i in 0..STEPS * 40 {
            let before = state;
            self.step(&mut state, h);
            if !state[0].is_finite() || state[0].abs() >= 10.0 * y0.abs() {
                return None;
            }
            // Velocity changes from outward to inward on the side of the release.
            if i > 2 && before[1] * side > 0.0 && state[1] * side <= 0.0 && state[0] * side > 0.0 {
                let share = before[1] / (before[1] - state[1]);
                let top = before[0] + 0.5 * share * h * before[1];
                tops.push(((i as f64 + share) * h, top));
                if tops.len() > 10 {
                    break;
                }
            }
        }
        let (first, last) = (tops.first()?, tops.last()?);
        if tops.len() < 3 {
            return None;
        }
        let period = tops[1].0;
        let drift = (last.1 / first.1).abs().ln().abs() * 10.0 / (tops.len() - 1) as f64;
        Some(Behaviour { omega: TAU / period * self.time_unit, drift })
    }
}

/// The constraint of the seed's (5.21): y, ẏ, y³, ẏ³, y²ẏ, yẏ².
pub fn seed_constraint() -> Vec<Function> {
    [(1, 0), (0, 1), (3, 0), (0, 3), (2, 1), (1, 2)]
        .map(|(y, velocity)| Function::Monomial { y, velocity, z: 0 })
        .to_vec()
}

/// All monomials y^i ẏ^k up to the third degree: (5.15) with M = 3.
pub fn cubic_constraint() -> Vec<Function> {
    let mut all = Vec::new();
    for y in 0..=3 {
        for velocity in 0..=3 - y {
            all.push(Function::Monomial { y, velocity, z: 0 });
        }
    }
    all
}

/// Type I's equation (5.24): y, y³.
pub fn type1_equation() -> Vec<Function> {
    vec![Function::power(1), Function::power(3)]
}

/// Type II's equation (5.25): y, z, y³, y²z, yz², and z³ where asked.
pub fn type2_equation(cube: bool) -> Vec<Function> {
    let mut of = vec![(1, 0), (0, 1), (3, 0), (2, 1), (1, 2)];
    if cube {
        of.push((0, 3));
    }
    of.into_iter().map(|(y, z)| Function::Monomial { y, velocity: 0, z }).collect()
}

/// How badly a model does on its own releases: the greatest error of frequency plus drift over ten
/// periods, infinite where a release does not come back; plus a hundredth of the constraint's
/// relative residual.
pub fn score(model: &ConstraintModel, orbits: &[Orbit]) -> f64 {
    let mut worst = 0.0_f64;
    let (mut left, mut size) = (0.0, 0.0);
    for orbit in orbits {
        let Some(b) = model.behaviour(orbit.y[0][0]) else { return f64::INFINITY };
        worst = worst.max((b.omega / (orbit.omega * model.time_unit) - 1.0).abs() + b.drift);
        for (j, z) in orbit.z.iter().enumerate() {
            for (i, z) in z.iter().enumerate() {
                left += (orbit.weight * (z - model.minor(j, orbit.y[i][0], orbit.y[i][1]))).powi(2);
                size += (orbit.weight * orbit.y[i][0]).powi(2);
            }
        }
    }
    worst + if size > 0.0 { 0.01 * (left / size).sqrt() } else { 0.0 }
}

/// Terms chosen for what the model does, not for residuals alone: starting with all candidates, the
/// term without which [`score`] is least is dropped as long as that does not raise it.
pub fn select(
    orbits: &[Orbit],
    modes: &[Vec<f64>],
    time_unit: f64,
    constraint: &[Function],
    equation: &[Function],
) -> Option<(ConstraintModel, f64)> {
    let (mut c, mut e) = (constraint.to_vec(), equation.to_vec());
    let try_out = |c: &[Function], e: &[Function]| {
        fit(orbits, modes, time_unit, c, e).map(|m| {
            let s = score(&m, orbits);
            (m, s)
        })
    };
    let mut best = try_out(&c, &e);
    loop {
        let now = best.as_ref().map_or(f64::INFINITY, |b| b.1);
        let mut next: Option<(bool, usize, (ConstraintModel, f64))> = None;
        for (of_equation, length) in [(false, c.len()), (true, e.len())] {
            if length <= 1 {
                continue;
            }
            for i in 0..length {
                let (mut c1, mut e1) = (c.clone(), e.clone());
                if of_equation {
                    e1.remove(i);
                } else {
                    c1.remove(i);
                }
                if let Some(m) = try_out(&c1, &e1)
                    && next.as_ref().is_none_or(|n| m.1 < n.2.1)
                {
                    next = Some((of_equation, i, m));
                }
            }
        }
        match next {
            Some((of_equation, i, m))
                if m.1 <= now && m.1.is_finite() || now.is_infinite() && c.len() + e.len() > 2 =>
            {
                if of_equation {
                    e.remove(i);
                } else {
                    c.remove(i);
                }
                best = Some(m);
            }
            _ => break,
        }
    }
    best
}

#[cfg(test)]
mod tests;
