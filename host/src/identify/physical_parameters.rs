//! Physical parameters from identified coefficients and from quantities that are known.
//!
//! The coefficients b of (3.4) are functions b(p) of the physical parameters p (section 1.2):
//! B_i1 = H/J_oi, B_i2 = g S_i/(J_oi Ω²), B_i3 = −(a S_i/J_oi) cos ψ, B_i4 = −(a S_i/J_oi) sin ψ,
//! B_i6 = S_i/(κ J_oi Ω²) in
//! the place of B_i3 and B_i4 where the base is measured with a gain κ, C11 = τ_c1/(J_o1 Ω²), C12 =
//! c_r2/(J_o1 Ω), C2 = c_r2/(J_o2 Ω), with H = m2 e2 l1, S1 = m1e1 + m2 l1, S2 = m2 e2. There are
//! more coefficients than parameters: the ties (3.23) are used by taking the p nearest to the
//! identified b in a metric W, min (b − b(p))ᵀ W⁻¹ (b − b(p)), by Gauss–Newton. W is the covariance
//! for independent residuals, which does not scatter; the parameters' covariance is the sandwich G
//! Σ Gᵀ, G = (Jᵀ W⁻¹ J)⁻¹ Jᵀ W⁻¹, with the jackknife's Σ. (With the jackknife's Σ as metric,
//! estimated from some thirty blocks, intervals were found a third too short.)
//!
//! Directions of p that no coefficient and no known quantity fixes are found by the Jacobian's
//! singular values; parameters that have a part in one are not reported.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::system::ties::Identified;

/// A physical parameter with its standard error.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Physical {
    /// Name.
    pub name: &'static str,
    /// Value, SI.
    pub value: f64,
    /// Standard error, SI.
    pub std_error: f64,
    /// Unit.
    pub unit: &'static str,
}

/// What the fit of physical parameters gives.
#[derive(Clone, Debug, Default)]
pub struct PhysicalFit {
    /// Parameters that coefficients and known quantities fix.
    pub parameters: Vec<Physical>,
    /// Parameters that they leave open.
    pub undetermined: Vec<&'static str>,
    /// Misfit (b − b(p))ᵀ Σ⁻¹ (b − b(p)) of the ties.
    pub misfit: f64,
    /// Its degrees of freedom.
    pub freedom: usize,
}

/// Unknowns in the order of the vector p: name, unit, and whether it is positive (then its
/// logarithm is fitted).
const UNKNOWNS: &[(&str, &str, bool)] = &[
    ("J_o1", "kg m²", true),
    ("J_o2", "kg m²", true),
    ("m1e1", "kg m", true),
    ("l1", "m", true),
    ("m2", "kg", true),
    ("e2", "m", true),
    ("g", "m/s²", true),
    ("a cos psi", "m", false),
    ("a sin psi", "m", false),
    ("tau_c1", "N m", false),
    ("c_r2", "N m s", false),
    ("c_r1", "N m s", false),
    ("tau_c2", "N m", false),
    ("base_gain", "1", true),
];
const A_COS: usize = 7;
const A_SIN: usize = 8;

/// Coefficient `name` as a function of all physical parameters.
fn coefficient(name: &str, p: &[f64], omega: f64) -> Option<f64> {
    let [j1, j2, m1e1, l1, m2, e2, g, ac, a_s, tau1, cr2, cr1, tau2, gain] = *p else { return None };
    let (h, s1, s2) = (m2 * e2 * l1, m1e1 + m2 * l1, m2 * e2);
    let second = omega * omega;
    Some(match name {
        "B11" => h / j1,
        "B21" => h / j2,
        "B12" => g * s1 / (j1 * second),
        "B22" => g * s2 / (j2 * second),
        "B13" => -ac * s1 / j1,
        "B14" => -a_s * s1 / j1,
        "B23" => -ac * s2 / j2,
        "B24" => -a_s * s2 / j2,
        "B16" => s1 / (gain * j1 * second),
        "B26" => s2 / (gain * j2 * second),
        "C11" => tau1 / (j1 * second),
        "C12" => cr2 / (j1 * omega),
        "C2" => cr2 / (j2 * omega),
        "C13" => cr1 / (j1 * omega),
        "C14" => tau2 / (j1 * second),
        "C4" => tau2 / (j2 * second),
        _ => return None,
    })
}

/// Fits the physical parameters to identified coefficients. Nothing is returned where no quantity
/// that carries a mass is known, since equations of motion have no scale of their own.
pub fn fit(identified: &Identified<'_>, known: &BTreeMap<String, f64>, omega: f64) -> Option<PhysicalFit> {
    let carries_mass = ["m1e1", "m2", "J_o1", "J_o2"];
    let has_scale =
        carries_mass.iter().any(|k| known.contains_key(*k)) || (known.contains_key("m1") && known.contains_key("e1"));
    if !has_scale {
        return None;
    }
    let (mut p, fixed) = everyday_rig(known);
    let amplitude = known.get("a").copied();
    let ties = Ties::new(identified, &fixed, amplitude, omega)?;
    start(&mut p, &fixed, identified, amplitude, omega);
    let (p, misfit) = ties.nearest(p)?;
    if p.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let spread = ties.spread(&p)?;
    let mut out =
        PhysicalFit { misfit, freedom: ties.target.len().saturating_sub(spread.rank), ..PhysicalFit::default() };
    ties.report(&p, &spread, &mut out);
    Some(out)
}

/// A rig of everyday size, what is known in its place; which parameters are.
fn everyday_rig(known: &BTreeMap<String, f64>) -> (Vec<f64>, Vec<bool>) {
    let mut p: Vec<f64> = vec![5e-4, 5e-5, 1.5e-3, 0.1, 0.1, 0.05, 9.81, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut fixed = vec![false; p.len()];
    for (i, (name, ..)) in UNKNOWNS.iter().enumerate() {
        if let Some(v) = known.get(*name) {
            p[i] = *v;
            fixed[i] = true;
        }
    }
    if let (false, Some(m1), Some(e1)) = (fixed[2], known.get("m1"), known.get("e1")) {
        p[2] = m1 * e1;
        fixed[2] = true;
    }
    (p, fixed)
}

/// The least-squares problem of the ties: identified coefficients against those of parameters.
struct Ties<'a> {
    /// Names of the coefficients that are observed.
    names: Vec<&'a str>,
    /// A known amplitude of the drive: one more observation.
    amplitude: Option<f64>,
    /// Drive's angular frequency, rad/s.
    omega: f64,
    /// Parameters that are fitted.
    free: Vec<usize>,
    /// What was observed.
    target: DVector<f64>,
    /// Its covariance.
    sigma: DMatrix<f64>,
    /// Cholesky factor of its metric: rows are divided by it.
    factor: DMatrix<f64>,
}

/// How precise the parameters at the least distance are.
struct Spread {
    /// Covariance of the free parameters (of logarithms, where those are fitted).
    covariance: DMatrix<f64>,
    /// Which of them have a part in a direction that nothing fixes.
    open: Vec<bool>,
    /// Directions that are fixed.
    rank: usize,
}

impl<'a> Ties<'a> {
    /// None where the metric is not positive definite.
    fn new(identified: &Identified<'a>, fixed: &[bool], amplitude: Option<f64>, omega: f64) -> Option<Self> {
        let Identified { names, values, covariance, metric } = *identified;
        let anything = [1.0; UNKNOWNS.len()];
        let used: Vec<usize> =
            (0..names.len()).filter(|&i| coefficient(&names[i], &anything, omega).is_some()).collect();
        let has = |n: &str| names.iter().any(|x| x == n);
        let appears = |i: usize| match UNKNOWNS[i].0 {
            "a cos psi" | "a sin psi" => has("B13"),
            "tau_c1" => has("C11"),
            "c_r2" => has("C2"),
            "c_r1" => has("C13"),
            "tau_c2" => has("C14"),
            "base_gain" => has("B16"),
            _ => true,
        };
        let free: Vec<usize> = (0..fixed.len()).filter(|&i| !fixed[i] && appears(i)).collect();
        // A known amplitude is as precise as the best-known ratio needs.
        let amplitude = amplitude.filter(|_| has("B13"));
        let rows = used.len() + usize::from(amplitude.is_some());
        let select = |m: &DMatrix<f64>| {
            DMatrix::from_fn(rows, rows, |r, c| match (used.get(r), used.get(c), amplitude) {
                (Some(&i), Some(&j), _) => m[(i, j)],
                (None, None, Some(a)) => (1e-6 * a).powi(2),
                _ => 0.0,
            })
        };
        let sigma = select(covariance);
        let factor = select(metric).cholesky()?.l();
        let target: Vec<f64> = used.iter().map(|&i| values[i]).chain(amplitude).collect();
        let names = used.iter().map(|&i| names[i].as_str()).collect();
        Some(Self { names, amplitude, omega, free, target: DVector::from_vec(target), sigma, factor })
    }

    /// b(p), and the amplitude where it is known.
    fn observe(&self, p: &[f64]) -> DVector<f64> {
        let of = |n: &&str| coefficient(n, p, self.omega).unwrap_or(0.0);
        let amplitude = self.amplitude.map(|_| p[A_COS].hypot(p[A_SIN]));
        DVector::from_vec(self.names.iter().map(of).chain(amplitude).collect())
    }

    /// ∂b/∂p by the free parameters. Central differences; every b is a product of powers of p or
    /// linear in it.
    fn jacobian(&self, p: &[f64]) -> DMatrix<f64> {
        let mut j = DMatrix::zeros(self.target.len(), self.free.len());
        for (c, &i) in self.free.iter().enumerate() {
            let d = if UNKNOWNS[i].2 { 1e-5 } else { 1e-5 * p[i].abs().max(scale_of(i, p, self.omega)) };
            let difference = (self.observe(&changed(p, i, d)) - self.observe(&changed(p, i, -d))) / (2.0 * d);
            j.set_column(c, &difference);
        }
        j
    }

    /// What is observed less b(p), whitened.
    fn residual(&self, p: &[f64]) -> Option<DVector<f64>> {
        self.factor.solve_lower_triangular(&(&self.target - self.observe(p)))
    }

    /// The parameters of least distance from a start, by damped Gauss–Newton, and the distance.
    fn nearest(&self, mut p: Vec<f64>) -> Option<(Vec<f64>, f64)> {
        let cost = |p: &[f64]| self.residual(p).map_or(f64::INFINITY, |r| r.norm_squared());
        let mut best = cost(&p);
        for _ in 0..200 {
            let j = self.factor.solve_lower_triangular(&self.jacobian(&p))?;
            let r = self.residual(&p)?;
            let (j, column_scale) = scale_columns(j);
            let svd = j.svd(true, true);
            let cut = 1e-7 * svd.singular_values.max();
            let change = svd.solve(&r, cut).ok()?;
            let mut damping = 1.0;
            let mut moved = false;
            while damping > 1e-6 {
                let mut q = p.clone();
                for (c, &i) in self.free.iter().enumerate() {
                    let d = damping * change[c] * column_scale[c];
                    q = changed(&q, i, if UNKNOWNS[i].2 { d.clamp(-1.0, 1.0) } else { d });
                }
                let new = cost(&q);
                if new.is_finite() && new < best {
                    moved = best - new > 1e-10 * best;
                    (p, best) = (q, new);
                    break;
                }
                damping *= 0.5;
            }
            if !moved {
                break;
            }
        }
        Some((p, best))
    }

    /// The sandwich G Σ Gᵀ at the least distance, and the directions that stay open.
    fn spread(&self, p: &[f64]) -> Option<Spread> {
        let (rows, free) = (self.target.len(), self.free.len());
        let (white, column_scale) = scale_columns(self.factor.solve_lower_triangular(&self.jacobian(p))?);
        let svd = white.svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let cut = 1e-6 * svd.singular_values.max();
        let mut open = vec![false; free];
        let mut gain = DMatrix::zeros(free, rows);
        let mut rank = 0;
        for (k, s) in svd.singular_values.iter().enumerate() {
            if *s > cut {
                gain += v_t.row(k).transpose() * u.column(k).transpose() / *s;
                rank += 1;
            } else {
                (0..free).filter(|&c| v_t[(k, c)].abs() > 1e-4).for_each(|c| open[c] = true);
            }
        }
        // A null direction may also come from there being fewer rows than unknowns.
        if svd.singular_values.len() < free {
            let projector = DMatrix::identity(free, free) - v_t.transpose() * &v_t;
            (0..free).filter(|&c| projector[(c, c)] > 1e-8).for_each(|c| open[c] = true);
        }
        let inverse_factor = self.factor.solve_lower_triangular(&DMatrix::identity(rows, rows))?;
        let gain = gain * inverse_factor;
        let scaled = &gain * &self.sigma * gain.transpose();
        let covariance = DMatrix::from_fn(free, free, |r, c| scaled[(r, c)] * column_scale[r] * column_scale[c]);
        Some(Spread { covariance, open, rank })
    }

    /// Writes down what is fixed and what is open, amplitude and phase of the drive last.
    fn report(&self, p: &[f64], spread: &Spread, out: &mut PhysicalFit) {
        let Spread { covariance, open, .. } = spread;
        for (c, &i) in self.free.iter().enumerate() {
            let (name, unit, logarithmic) = UNKNOWNS[i];
            if i == A_COS || i == A_SIN {
                continue;
            }
            if open[c] {
                out.undetermined.push(name);
                continue;
            }
            let error = covariance[(c, c)].max(0.0).sqrt() * if logarithmic { p[i] } else { 1.0 };
            out.parameters.push(Physical { name, value: p[i], std_error: error, unit });
        }
        let place = |unknown: usize| self.free.iter().position(|&i| i == unknown);
        let (Some(c), Some(s)) = (place(A_COS), place(A_SIN)) else { return };
        if open[c] || open[s] {
            out.undetermined.push("a");
            return;
        }
        let (x, y) = (p[A_COS], p[A_SIN]);
        let a = x.hypot(y);
        let error = |gx: f64, gy: f64| {
            let variance =
                gx * gx * covariance[(c, c)] + 2.0 * gx * gy * covariance[(c, s)] + gy * gy * covariance[(s, s)];
            variance.max(0.0).sqrt()
        };
        if self.amplitude.is_none() && a > 0.0 {
            let (of_a, of_psi) = (error(x / a, y / a), error(-y / (a * a), x / (a * a)));
            out.parameters.push(Physical { name: "a", value: a, std_error: of_a, unit: "m" });
            out.parameters.push(Physical { name: "psi", value: y.atan2(x), std_error: of_psi, unit: "rad" });
        }
    }
}

/// The parameters with one of them changed by d, by eᵈ where its logarithm is fitted.
fn changed(p: &[f64], i: usize, d: f64) -> Vec<f64> {
    let mut q = p.to_vec();
    if UNKNOWNS[i].2 {
        q[i] *= d.exp()
    } else {
        q[i] += d
    }
    q
}

/// A typical size of a parameter that may be zero, for the step of its derivative.
fn scale_of(i: usize, p: &[f64], omega: f64) -> f64 {
    match UNKNOWNS[i].0 {
        "a cos psi" | "a sin psi" => 1e-3,
        "c_r1" | "c_r2" => 1e-3 * p[1] * omega,
        _ => 1e-3 * p[1] * omega * omega,
    }
}

/// Columns scaled to unit norm, and the factors by which they were multiplied.
fn scale_columns(mut j: DMatrix<f64>) -> (DMatrix<f64>, Vec<f64>) {
    let scale = j
        .column_iter_mut()
        .map(|mut c| {
            let norm = c.norm();
            let s = if norm > 0.0 { 1.0 / norm } else { 1.0 };
            c *= s;
            s
        })
        .collect();
    (j, scale)
}

/// A start that satisfies most coefficients, from one of them at a time.
fn start(p: &mut [f64], fixed: &[bool], of: &Identified<'_>, amplitude: Option<f64>, omega: f64) {
    let get = |n: &str| of.names.iter().position(|x| x == n).map(|i| of.values[i]);
    let mut set = |i: usize, v: f64| {
        if !fixed[i] && v.is_finite() && (!UNKNOWNS[i].2 || v > 0.0) {
            p[i] = v;
        }
        p[i]
    };
    let second = omega * omega;
    let (m2, g) = (set(4, f64::NAN), set(6, f64::NAN));
    let (b11, b21) = (get("B11").unwrap_or(0.1), get("B21").unwrap_or(1.0));
    let (b12, b22) = (get("B12").unwrap_or(0.1), get("B22").unwrap_or(0.3));
    let e2 = set(5, f64::NAN);
    // B21/B22 = l1 Ω²/g, whatever the masses.
    let l1 = set(3, g * b21 / (b22 * second));
    let s2 = m2 * e2;
    let j2 = set(1, s2 * g / (b22 * second));
    let j1 = set(0, s2 * l1 / b11);
    set(2, b12 * j1 * second / g - m2 * l1);
    if let (Some(b23), Some(b24)) = (get("B23"), get("B24")) {
        let (x, y) = (-b23 * j2 / s2, -b24 * j2 / s2);
        let stretch = amplitude.map_or(1.0, |a| a / x.hypot(y).max(f64::MIN_POSITIVE));
        set(A_COS, x * stretch);
        set(A_SIN, y * stretch);
    }
    let pairs: [(usize, Option<f64>); 4] = [
        (9, get("C11").map(|c| c * j1 * second)),
        (10, get("C2").map(|c| c * j2 * omega)),
        (11, get("C13").map(|c| c * j1 * omega)),
        (12, get("C4").map(|c| c * j2 * second)),
    ];
    for (i, value) in pairs {
        set(i, value.unwrap_or(0.0));
    }
}

#[cfg(test)]
#[path = "physical_parameters_tests.rs"]
mod tests;
