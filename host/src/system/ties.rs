//! Parameters of a system from identified coefficients and from what is known: the ties between
//! coefficients.
//!
//! The coefficients b are functions b(p) = N(p)/D(p) of the parameters, more of them than
//! parameters where the mechanism ties them. The p nearest to the identified b in a metric W, min
//! (b − b(p))ᵀ W⁻¹ (b − b(p)), is found by Levenberg and Marquardt from seeded starts; W is the
//! covariance for independent residuals, which does not scatter. The parameters' covariance is G Σ
//! Gᵀ, G = (Jᵀ W⁻¹ J)⁺ Jᵀ W⁻¹, with the jackknife's Σ. The least distance is a test of the
//! mechanism: χ² with rows − rank degrees of freedom. Known parameters are fixed, a known quantity
//! is one more row.
//!
//! Directions of p that nothing fixes are the null space of the Jacobian with exact derivatives; a
//! parameter or quantity whose gradient has a part in it is not reported but listed, with what
//! would have to be known.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::mechanism::Mechanism;
use super::open_directions::{NULL, null_space, unit_columns, wanted};
use super::openness::Openness;
use super::polynomial::{Atom, Polynomial};
use super::row::Row;
use crate::model::parameter::Parameter;

/// Standard error of a known quantity as a share of it: that of the built-in systems' known
/// amplitude.
const KNOWN_SHARE: f64 = 1e-6;
/// Share by which variances grow where rounding made a covariance singular.
const RIDGE: f64 = 1e-10;
/// Starts at most, and how many must agree on the least distance.
const STARTS: u64 = 40;
const AGREEING: usize = 4;

/// Identified coefficients.
pub struct Identified<'a> {
    /// Names.
    pub names: &'a [String],
    /// Values.
    pub values: &'a DVector<f64>,
    /// Covariance.
    pub covariance: &'a DMatrix<f64>,
    /// Covariance for independent residuals, the metric of the fit.
    pub metric: &'a DMatrix<f64>,
}

/// What the ties give.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TiesFit {
    /// Parameters, then quantities, that coefficients and what is known fix.
    pub found: Vec<Parameter>,
    /// Those that they leave open.
    pub undetermined: Vec<String>,
    /// What would fix most of them if it were known, and which follow then.
    pub wanted: Option<(String, Vec<String>)>,
    /// All parameters at the least distance, those that stay open among them.
    pub parameters: Vec<f64>,
    /// ∂p/∂b of the parameters by the identified coefficients.
    pub slopes: DMatrix<f64>,
    /// Whether the inertia by which each equation was divided stays open.
    pub open_scales: Vec<bool>,
    /// What else of the parameters is fixed.
    pub openness: Openness,
    /// Least distance of the ties.
    pub misfit: f64,
    /// Its degrees of freedom.
    pub freedom: usize,
}

struct Problem<'a> {
    mechanism: &'a Mechanism,
    free: Vec<usize>,
    rows: Vec<Row>,
    target: DVector<f64>,
    /// The identified coefficients that the first rows are, and how many there are of these.
    of_rows: (Vec<usize>, usize),
    /// Inverse of the Cholesky factor of the metric.
    white: DMatrix<f64>,
    /// The same of a metric in which rows have equal shares of themselves for errors.
    even: DMatrix<f64>,
}

fn is_finite(p: &[f64]) -> bool {
    p.iter().all(|x| x.is_finite())
}

impl Problem<'_> {
    fn residual(&self, white: &DMatrix<f64>, p: &[f64]) -> DVector<f64> {
        let predicted = DVector::from_iterator(self.rows.len(), self.rows.iter().map(|r| r.value(p)));
        white * (&self.target - predicted)
    }

    /// ∂(rows)/∂x of the unknowns x, the logarithms of positive parameters.
    fn jacobian(&self, p: &[f64]) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(self.rows.len(), self.free.len());
        for (i, row) in self.rows.iter().enumerate() {
            for (j, x) in row.gradient(p).into_iter().enumerate() {
                out[(i, j)] = x * self.stretch(p, j);
            }
        }
        out
    }

    fn positive(&self, j: usize) -> bool {
        self.mechanism.parameters[self.free[j]].positive
    }

    /// dp/dx of unknown j.
    fn stretch(&self, p: &[f64], j: usize) -> f64 {
        if self.positive(j) { p[self.free[j]] } else { 1.0 }
    }

    fn moved(&self, p: &[f64], step: &DVector<f64>) -> Vec<f64> {
        let mut q = p.to_vec();
        for (j, &k) in self.free.iter().enumerate() {
            if self.positive(j) {
                q[k] *= step[j].clamp(-1.0, 1.0).exp();
            } else {
                q[k] += step[j];
            }
        }
        q
    }

    /// Levenberg–Marquardt from a start: parameters and least distance in a metric.
    fn fit(&self, white: &DMatrix<f64>, start: Vec<f64>) -> (Vec<f64>, f64) {
        let mut p = start;
        let mut cost = self.residual(white, &p).norm_squared();
        let (mut damping, mut small) = (1e-3, 0);
        for _ in 0..300 {
            let (mut j, r) = (white * self.jacobian(&p), self.residual(white, &p));
            let scale = unit_columns(&mut j);
            if !j.iter().chain(r.iter()).all(|x| x.is_finite()) {
                return (p, f64::INFINITY);
            }
            let svd = j.svd(true, true);
            let (Some(u), Some(v_t)) = (&svd.u, &svd.v_t) else { return (p, cost) };
            let (along, s) = (u.transpose() * r, &svd.singular_values);
            let better = (0..30).find_map(|_| {
                let share = DVector::from_fn(s.len(), |i, _| {
                    if s[i] > NULL * s[0] { along[i] * s[i] / (s[i] * s[i] + damping * s[0] * s[0]) } else { 0.0 }
                });
                let step = (v_t.transpose() * share).component_div(&DVector::from_vec(scale.clone()));
                let q = self.moved(&p, &step);
                let new = self.residual(white, &q).norm_squared();
                if new.is_finite() && new < cost {
                    return Some((q, new));
                }
                damping = f64::max(4.0 * damping, 1e-12);
                None
            });
            let Some((q, new)) = better else { break };
            // A step that gains a millionth part ends it, the second time.
            small = if cost - new < 1e-9 * cost { small + 1 } else { 0 };
            (p, cost) = (q, new);
            damping /= 10.0;
            if small > 1 || cost < 1e-18 {
                break;
            }
        }
        (p, cost)
    }

    /// A start: what is known, then sizes over five decades, and over fifteen in the later ones, for
    /// rigs of micrograms and of tons; signs differ in some.
    fn start(&self, known: &[f64], k: u64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(k);
        let mut p = known.to_vec();
        for &i in &self.free {
            let decades = if k < STARTS / 2 { -4.0..1.0 } else { -9.0..6.0 };
            let size = 10.0_f64.powf(random.random_range(decades));
            let turned = k >= STARTS / 4 && random.random_range(0.0..1.0) < 0.5;
            let named = &self.mechanism.parameters[i];
            p[i] = match named.name.as_str() {
                "g" => crate::rig::GRAVITY,
                n if n.contains('@') => 0.0,
                _ if turned && !named.positive => -size,
                _ => size,
            };
        }
        p
    }

    /// The best of several starts, the first of which is `near` where it is given.
    fn solve(&self, known: &[f64], near: Option<Vec<f64>>, starts: u64) -> Option<(Vec<f64>, f64)> {
        let freedom = self.rows.len().saturating_sub(1) as f64;
        // What chance alone gives with probability above 1e-6, nearly.
        let usual = freedom + 5.0 * (2.0 * freedom).sqrt() + 10.0;
        let mut best = self.best_of(near.into_iter().chain((0..starts).map(|k| self.start(known, k))), usual);
        if best.as_ref().is_none_or(|b| b.1 > usual) {
            // Far away the errors' correlations bend the way to the least distance: starts agree on a
            // place that is none.
            let roughly = |k| self.fit(&self.even, self.start(known, k)).0;
            let other = self.best_of((0..starts).map(roughly), usual);
            best = best.into_iter().chain(other).min_by(|a, b| a.1.total_cmp(&b.1));
        }
        best
    }

    /// The best of some starts: the first whose distance is a usual one, or the least on which
    /// several agree.
    fn best_of(&self, starts: impl Iterator<Item = Vec<f64>>, usual: f64) -> Option<(Vec<f64>, f64)> {
        let mut best: Option<(Vec<f64>, f64)> = None;
        let mut agree = 0;
        for start in starts {
            let (p, cost) = self.fit(&self.white, start);
            if !cost.is_finite() || !is_finite(&p) {
                continue;
            }
            match &best {
                Some((_, least)) if (cost - least).abs() <= 1e-6 * least.max(1e-9) => agree += 1,
                Some((_, least)) if cost > *least => {}
                _ => (best, agree) = (Some((p, cost)), 1),
            }
            if agree >= AGREEING || best.as_ref().is_some_and(|b| b.1 <= usual) {
                break;
            }
        }
        best
    }
}

/// Fits the parameters; none where there is nothing to fit or the metric is not positive.
pub fn fit(mechanism: &Mechanism, b: &Identified<'_>, known: &BTreeMap<&str, f64>) -> Option<TiesFit> {
    fit_near(mechanism, b, known, &[])
}

/// The same from parameters that are near alone.
pub(super) fn fit_from(
    mechanism: &Mechanism,
    b: &Identified<'_>,
    known: &BTreeMap<&str, f64>,
    near: &[f64],
) -> Option<TiesFit> {
    fit_of(mechanism, b, known, near, 0)
}

/// The same from parameters that are near: the first ones of the mechanism.
pub fn fit_near(
    mechanism: &Mechanism,
    b: &Identified<'_>,
    known: &BTreeMap<&str, f64>,
    near: &[f64],
) -> Option<TiesFit> {
    fit_of(mechanism, b, known, near, STARTS)
}

fn fit_of(
    mechanism: &Mechanism,
    b: &Identified<'_>,
    known: &BTreeMap<&str, f64>,
    near: &[f64],
    starts: u64,
) -> Option<TiesFit> {
    let fixed = |i: usize| known.get(mechanism.parameters[i].name.as_str()).copied();
    let observed: Vec<_> =
        mechanism.quantities.iter().filter_map(|q| Some((q, *known.get(q.name.as_str())?))).collect();
    let free: Vec<usize> = (0..mechanism.parameters.len())
        .filter(|&i| {
            let in_known = observed.iter().any(|(q, _)| q.value.any(&|a| *a == Atom::Parameter(i)));
            fixed(i).is_none() && (mechanism.takes_part(i) || in_known)
        })
        .collect();
    let used: Vec<(usize, usize)> = mechanism
        .coefficients
        .iter()
        .enumerate()
        .filter_map(|(k, c)| Some((k, b.names.iter().position(|n| *n == c.name)?)))
        .collect();
    if free.is_empty() || used.is_empty() {
        return None;
    }
    let one = Polynomial::number(1.0);
    let coefficient = |(k, _): &(usize, usize)| {
        let c = &mechanism.coefficients[*k];
        Row::new(&c.numerator, &c.denominator, &free)
    };
    let mut rows: Vec<Row> = used.iter().map(coefficient).collect::<Option<_>>()?;
    for (q, _) in &observed {
        rows.push(Row::new(&q.value, &one, &free)?);
    }
    let target: Vec<f64> = used.iter().map(|u| b.values[u.1]).chain(observed.iter().map(|o| o.1)).collect();
    let select = |m: &DMatrix<f64>| {
        DMatrix::from_fn(rows.len(), rows.len(), |r, c| match (used.get(r), used.get(c)) {
            (Some(i), Some(j)) => m[(i.1, j.1)],
            (None, None) if r == c => (KNOWN_SHARE * target[r].abs().max(1e-12)).powi(2),
            _ => 0.0,
        })
    };
    let white = factor(select(b.metric))?.try_inverse()?;
    let own_size = |t: &f64| if *t == 0.0 { 1.0 } else { 1.0 / t.abs() };
    let even = DMatrix::from_diagonal(&DVector::from_iterator(target.len(), target.iter().map(own_size)));
    let sigma = select(b.covariance);
    let parameters = 0..mechanism.parameters.len();
    let start: Vec<f64> = parameters.clone().map(|i| fixed(i).unwrap_or(0.0)).collect();
    let near = (!near.is_empty())
        .then(|| parameters.map(|i| fixed(i).or(near.get(i).copied()).unwrap_or(0.0)).collect::<Vec<f64>>());
    let of_rows = (used.iter().map(|u| u.1).collect(), b.names.len());
    let problem = Problem { mechanism, free, rows, target: DVector::from_vec(target), of_rows, white, even };
    let (p, misfit) = problem.solve(&start, near, starts)?;
    report(&problem, &p, misfit, &sigma, known)
}

/// Cholesky's factor of a metric. Coefficients that were tied before have fewer directions than
/// there are of them: in the others they agree, whatever they weigh there.
fn factor(metric: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let plain = metric.clone().cholesky();
    let ridge = || {
        let mut stiff = metric;
        (0..stiff.nrows()).for_each(|i| stiff[(i, i)] *= 1.0 + RIDGE);
        stiff.cholesky()
    };
    Some(plain.or_else(ridge)?.l())
}

/// Values, standard errors and what is open at the fitted parameters.
fn report(
    problem: &Problem<'_>,
    p: &[f64],
    misfit: f64,
    sigma: &DMatrix<f64>,
    known: &BTreeMap<&str, f64>,
) -> Option<TiesFit> {
    let Problem { mechanism, free, rows, white, .. } = problem;
    let (open, scale) = null_space(problem.jacobian(p))?;
    let rank = free.len() - open.ncols();
    let mut j = white * problem.jacobian(p);
    let norms = unit_columns(&mut j);
    let svd = j.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut gain = DMatrix::zeros(free.len(), rows.len());
    let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
    order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
    for &k in order.iter().take(rank).filter(|k| svd.singular_values[**k] > 0.0) {
        gain += v_t.row(k).transpose() * u.column(k).transpose() / svd.singular_values[k];
    }
    let gain = DMatrix::from_fn(free.len(), rows.len(), |r, c| gain[(r, c)] / norms[r]) * white;
    let covariance = &gain * sigma * gain.transpose();
    let mut slopes = DMatrix::zeros(p.len(), problem.of_rows.1);
    for (r, &name) in problem.of_rows.0.iter().enumerate() {
        free.iter().enumerate().for_each(|(j, &k)| slopes[(k, name)] = problem.stretch(p, j) * gain[(j, r)]);
    }
    let never = |k: &usize| !free.contains(k) && !known.contains_key(mechanism.parameters[*k].name.as_str());
    let openness = Openness {
        free: free.clone(),
        never: (0..mechanism.parameters.len()).filter(never).collect(),
        directions: open.clone(),
        stretches: (0..free.len()).map(|j| problem.stretch(p, j) / scale[j]).collect(),
        parameters: p.to_vec(),
    };
    let freedom = rows.len().saturating_sub(rank);
    let mut out = TiesFit { misfit, freedom, slopes, openness: openness.clone(), ..TiesFit::default() };
    let one = Polynomial::number(1.0);
    let own =
        mechanism.parameters.iter().enumerate().map(|(k, n)| (&n.name, &n.unit, Polynomial::atom(Atom::Parameter(k))));
    let more = mechanism.quantities.iter().map(|q| (&q.name, &q.unit, q.value.clone()));
    let mut gradients: Vec<(String, DVector<f64>)> = Vec::new();
    let is_left_open = |value: &Polynomial| -> Option<(bool, Row, DVector<f64>, DVector<f64>)> {
        let row = Row::new(value, &one, free)?;
        let slopes: Vec<f64> = row.gradient(p).iter().enumerate().map(|(j, x)| x * problem.stretch(p, j)).collect();
        let slopes = DVector::from_vec(slopes);
        let scaled = DVector::from_fn(free.len(), |j, _| slopes[j] / scale[j]);
        Some((openness.is_open(value, &one), row, slopes, scaled))
    };
    out.parameters = p.to_vec();
    out.open_scales = mechanism.scales.iter().map(|(_, d)| Some(is_left_open(d)?.0)).collect::<Option<_>>()?;
    for (name, unit, value) in own.chain(more) {
        if known.contains_key(name.as_str()) {
            continue;
        }
        let (left_open, row, slopes, scaled) = is_left_open(&value)?;
        if left_open {
            out.undetermined.push(name.clone());
            gradients.push((name.clone(), scaled));
            continue;
        }
        let variance = (slopes.transpose() * &covariance * &slopes)[(0, 0)];
        out.found.push(Parameter {
            name: name.clone(),
            value: row.value(p),
            std_error: variance.max(0.0).sqrt(),
            unit: unit.to_string(),
        });
    }
    out.wanted = wanted(&open, &gradients);
    Some(out)
}

#[cfg(test)]
#[path = "ties_tests.rs"]
pub(crate) mod tests;
