//! The bias of the whole chain from motion to coefficients, measured on motions of the identified model and taken off.
//!
//! What [`super::noise_bias`] measures on the smoothed record is the sensors' share. The smoothing itself has one more: dry friction bends a velocity where a joint turns back, and
//! a low-pass rounds that off, so that the friction comes out different by some tenths of a per cent at few counts. The smoothed record has lost
//! those bends; a solution of the model has them. So the identified model is integrated over stretches like the record's, from its states at their starts, measured by the sensors
//! and identified again (a parametric bootstrap estimate of bias, Efron and Tibshirani 1993, ch. 10):
//!
//! δ = [λ(solution) − λ] + [(1/R) Σ_r λ(sensor_r(solution)) − λ(solution)],   corrected λ − δ
//!
//! Each part is shrunk where it is not larger than its scatter over the stretches, which goes into the covariance. The first needs no noise at all, so that few stretches suffice.
//!
//! Limits: the model must be one that can be integrated, and stay finite; a solution leaves the record after some Lyapunov times but keeps to the same kind of motion.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::noise_bias::{Bias, REPEATS, from_rows, measure, places};
use super::regression::solve_weighted;
use super::windows::{Kernels, WindowRows, Windows, rows};
use crate::model::double_pendulum_dynamics::DoublePendulum;
use crate::model::dynamics::Dynamics;
use crate::model::flow::{Flow, Outside, Work};
use crate::model::weak::WeakModel;
use crate::signal::angles::{AngleSegment, Phase};

/// Longest step of integration, s, and shortest part of a drive period.
const STEP_S: f64 = 5e-3;
/// Steps of integration a drive period.
const STEPS: f64 = 40.0;
/// A share of a coefficient beyond which the simulated motion is another one than the record's, and nothing is concluded from it.
const ANOTHER_MOTION: f64 = 0.1;

/// Measures the bias. `coefficients`: of all equations, one after the other, in the order of `dynamics`' parameters. `sigma`: each sensor's noise, rad. None where the
/// model's motion is not like the record's.
pub fn estimate(
    dynamics: &DoublePendulum,
    coefficients: &DVector<f64>,
    segments: &[AngleSegment],
    model: &WeakModel,
    kernels: &Kernels,
    windows: &Windows,
    weights: &[Vec<f64>],
    sigma: [f64; 2],
) -> Option<Bias> {
    let motions = motions(dynamics, coefficients.as_slice(), segments, kernels, windows)?;
    let terms: Vec<usize> = model.equations.iter().map(|e| e.terms.len()).collect();
    let plain = rows(&motions, model, kernels, windows);
    let measured: Vec<Vec<WindowRows>> = (0..REPEATS)
        .map(|r| {
            let seen: Vec<AngleSegment> =
                motions.iter().enumerate().map(|(i, s)| measure(s, r, sigma, i as u64)).collect();
            rows(&seen, model, kernels, windows)
        })
        .collect();
    let mut bias = from_rows(motions.len(), &plain, &measured, &terms, weights)?;
    let solve = |without: Option<usize>| {
        let kept = plain.iter().filter(|w| Some(w.run) != without);
        let solved = solve_weighted(kept, &terms, weights).ok()?;
        Some(DVector::from_iterator(coefficients.len(), solved.iter().flat_map(|c| c.iter().copied())) - coefficients)
    };
    let all = solve(None)?;
    let n = motions.len();
    let mut covariance = DMatrix::zeros(all.len(), all.len());
    for change in (0..n).filter_map(|g| solve(Some(g))).map(|d| d - &all) {
        covariance += &change * change.transpose() * ((n - 1) as f64 / n as f64);
    }
    let largest = |i: usize| coefficients[i].abs() + 3.0 * covariance[(i, i)].max(0.0).sqrt();
    let scale = coefficients.amax();
    if (0..all.len()).any(|i| all[i].abs() > ANOTHER_MOTION * largest(i) + 1e-3 * scale) {
        return None;
    }
    for i in 0..all.len() {
        let square = all[i] * all[i];
        if square > 0.0 {
            bias.value[i] += all[i] * (1.0 - covariance[(i, i)] / square).max(0.0);
        }
    }
    bias.covariance += covariance;
    Some(bias)
}

/// Solutions of the model over stretches like those of [`super::noise_bias`], from the smoothed record's state at the start of each.
fn motions(
    dynamics: &DoublePendulum,
    parameters: &[f64],
    segments: &[AngleSegment],
    kernels: &Kernels,
    windows: &Windows,
) -> Option<Vec<AngleSegment>> {
    if parameters.len() != dynamics.parameter_count() {
        return None;
    }
    let reach = kernels.clear.reach();
    let lengths: Vec<usize> = segments.iter().map(AngleSegment::len).collect();
    let spacing = segments.first()?.step_s;
    let found: Vec<AngleSegment> = places(&lengths, kernels, windows, spacing)
        .into_par_iter()
        .map(|(i, first, last)| {
            let mut out = segments[i].part(first + reach, last - reach);
            let mut state = [0.0; 4];
            let (mut smooth, mut slope) = (Vec::new(), Vec::new());
            for c in 0..2 {
                kernels.clear.apply(&segments[i].phi[c][first..first + 2 * reach + 1], &mut smooth, &mut slope);
                state[c] = *smooth.first()?;
                state[2 + c] = *slope.first()?;
            }
            let omega = if matches!(out.phase, Phase::Clock(0.0)) { 0.0 } else { dynamics.omega() };
            let step = if omega > 0.0 { (core::f64::consts::TAU / omega / STEPS).min(STEP_S) } else { STEP_S };
            let flow =
                Flow::new(dynamics, parameters, Outside::drive(out.start_s, out.tau(0), omega + out.runaway.1), step);
            let mut work = Work::plain(dynamics);
            work.set(&state);
            let count = out.len();
            let phi = &mut out.phi;
            let good = flow.samples(&mut work, segments[i].time(first + reach), out.step_s, count, |k, q| {
                phi[0][k] = q[0];
                phi[1][k] = q[1];
            });
            (good && out.phi.iter().flatten().all(|x| x.is_finite() && x.abs() < 1e7)).then_some(out)
        })
        .collect::<Option<_>>()?;
    (!found.is_empty()).then_some(found)
}
