//! Refit by multiple shooting: all coefficients and one initial state for each window of the horizon, by least squares on the angles themselves.
//!
//! Minimises Σ_w Σ_i ‖(predicted − measured)/σ‖² over windows w with states x_w and common coefficients p (Bock 1983; van Domselaar and Hemker
//! 1975). Each Gauss–Newton step eliminates the states: with J_x, J_p a window's Jacobians and r its residuals,
//! S = Σ (J_pᵀJ_p − J_pᵀJ_x (J_xᵀJ_x)⁻¹ J_xᵀJ_p), S δp = −Σ (J_pᵀr − J_pᵀJ_x (J_xᵀJ_x)⁻¹ J_xᵀr), damped after Levenberg and Marquardt.
//! Where a model leaves more than noise, this is the fit with the least gap; where it leaves nothing, the weak form, which sees the whole record, is
//! at least as good. Covariance: sandwich over windows.

use nalgebra::{DMatrix, DVector, Matrix4, SVector};
use rayon::prelude::*;

use super::forward::Model;
use super::gap::{self, STATE_STEPS, Stretch};
use super::state::State;
use crate::signal::angles::AngleSegment;

/// Most Gauss–Newton steps.
const STEPS: usize = 8;
/// A step that gains less than this share of the sum of squares is the last.
const CONVERGED: f64 = 1e-4;

/// Outcome of a refit.
pub struct Shot {
    /// Coefficients, in the order of the state's own columns.
    pub x: DVector<f64>,
    /// Their covariance (sandwich over windows).
    pub covariance: DMatrix<f64>,
}

/// A window's reduced normal equations.
struct Reduced {
    normal: DMatrix<f64>,
    right: DVector<f64>,
    /// δx = −(own + cross δp).
    own: SVector<f64, 4>,
    cross: DMatrix<f64>,
}

/// Refits coefficients that start at `x`; `scale` gives each one's standard error so far, which sets the steps of the differences. None where
/// the windows do not determine them.
pub(super) fn refit(
    state: &State,
    x: &DVector<f64>,
    scale: &[f64],
    raw: &[AngleSegment],
    windows: &[Stretch],
    sigma: [f64; 2],
) -> Option<Shot> {
    let c = &state.context;
    let mut x = x.clone();
    let model = Model::of(state, &x);
    let fitted = gap::fit_windows(c, &model, raw, windows, sigma);
    drop(model);
    let mut cost: f64 = fitted.iter().map(|f| f.1).sum();
    let mut states: Vec<SVector<f64, 4>> = fitted.into_iter().map(|f| f.0).collect();
    let steps: Vec<f64> = scale.iter().zip(x.iter()).map(|(s, v)| (0.1 * s).max(1e-7 * v.abs()).max(1e-12)).collect();
    let mut damping = 1e-6;
    let mut covariance = DMatrix::zeros(x.len(), x.len());
    for _ in 0..STEPS {
        let reduced = linearise(state, &x, &steps, raw, windows, &states, sigma)?;
        let p = x.len();
        let (mut normal, mut right) = (DMatrix::zeros(p, p), DVector::zeros(p));
        let mut meat = DMatrix::zeros(p, p);
        for r in &reduced {
            normal += &r.normal;
            right += &r.right;
            meat += &r.right * r.right.transpose();
        }
        let inverse = normal.clone().cholesky()?.inverse();
        let n = windows.len() as f64;
        covariance = &inverse * meat * &inverse * (n / (n - 1.0).max(1.0));
        let mut gained = 0.0;
        for _ in 0..6 {
            let mut damped = normal.clone();
            (0..p).for_each(|i| damped[(i, i)] *= 1.0 + damping);
            let step = -damped.cholesky()?.solve(&right);
            let next = &x + &step;
            let moved: Vec<SVector<f64, 4>> = states
                .iter()
                .zip(&reduced)
                .map(|(s, r)| {
                    let change = &r.cross * &step;
                    s - r.own - SVector::<f64, 4>::from_iterator(change.iter().copied())
                })
                .collect();
            let model = Model::of(state, &next);
            let costs: Vec<f64> = windows
                .par_iter()
                .zip(&moved)
                .map(|(&(s, first, count), at)| {
                    gap::residuals(c, &model, &raw[s], first, count, sigma, at).iter().map(|v| v * v).sum()
                })
                .collect();
            let new: f64 = costs.iter().sum();
            if new.is_finite() && new < cost {
                gained = (cost - new) / cost;
                (x, states, cost) = (next, moved, new);
                damping = (damping * 0.1).max(1e-9);
                break;
            }
            damping = (damping * 10.0).max(1e-4);
        }
        if gained < CONVERGED {
            break;
        }
    }
    Some(Shot { x, covariance })
}

/// Reduced normal equations of every window.
fn linearise(
    state: &State,
    x: &DVector<f64>,
    steps: &[f64],
    raw: &[AngleSegment],
    windows: &[Stretch],
    states: &[SVector<f64, 4>],
    sigma: [f64; 2],
) -> Option<Vec<Reduced>> {
    let c = &state.context;
    let p = x.len();
    let base = Model::of(state, x);
    let moved: Vec<Model<'_>> = (0..p)
        .map(|k| {
            let mut y = x.clone();
            y[k] += steps[k];
            Model::of(state, &y)
        })
        .collect();
    windows
        .par_iter()
        .zip(states)
        .map(|(&(s, first, count), at)| {
            let predict = |model: &Model<'_>, at: &SVector<f64, 4>| {
                DVector::from_vec(gap::residuals(c, model, &raw[s], first, count, sigma, at))
            };
            let r = predict(&base, at);
            let mut jx = DMatrix::zeros(r.len(), 4);
            for k in 0..4 {
                let mut y = *at;
                y[k] += STATE_STEPS[k];
                jx.set_column(k, &((predict(&base, &y) - &r) / STATE_STEPS[k]));
            }
            let mut jp = DMatrix::zeros(r.len(), p);
            for (k, model) in moved.iter().enumerate() {
                jp.set_column(k, &((predict(model, at) - &r) / steps[k]));
            }
            let xx: Matrix4<f64> = (jx.transpose() * &jx).fixed_view::<4, 4>(0, 0).into_owned();
            let inverse = xx.cholesky()?.inverse();
            let xp = jx.transpose() * &jp;
            let gx = jx.transpose() * &r;
            let own = inverse * SVector::<f64, 4>::from_iterator(gx.iter().copied());
            let cross: DMatrix<f64> = DMatrix::from_iterator(4, 4, inverse.iter().copied()) * &xp;
            let normal = jp.transpose() * &jp - xp.transpose() * &cross;
            let right = jp.transpose() * &r - xp.transpose() * own;
            Some(Reduced { normal, right, own, cross })
        })
        .collect()
}
