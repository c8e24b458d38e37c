//! Nodes between the releases from the equations themselves, where these are known.
//!
//! Between two releases far apart the shapes are interpolated, and an error of 1 % in them costs the variational frequency 1e-4. The
//! equations need no release there: from the interpolated shape at amplitude a, Newton's method solves the free motion's harmonic balance
//! ω² x_φφ = a(x, ω x_φ), its first harmonic's major coordinate held at a, for the harmonics that the model has, and ω. Averages over half a
//! turn (the motion retraces itself); derivatives by difference quotients. A solution that is not close to where it started is another
//! motion and is not taken.

use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

use super::super::systems::Mechanical;
use super::fitting::{model, model_of};
use super::{Node, Polar};

/// Ratio of neighbouring amplitudes above which nodes are put between.
const RATIO: f64 = 1.35;
/// Highest degree in s with these nodes.
const MOST_DEGREE: usize = 8;
/// Phases in half a turn.
const PHASES: usize = 48;
/// Greatest change of the shape, relative to it, and of the frequency.
const CLOSE: [f64; 2] = [0.2, 0.02];

/// The model of a system whose equations are known: of the releases' nodes and of those between them, which are answered too.
pub fn model_with(
    nodes: &[Node],
    major: &[f64],
    system: &dyn Mechanical,
    linear: Option<(f64, Vec<f64>)>,
) -> Option<(Polar, Vec<Node>)> {
    let first = model(nodes, major, linear.clone())?;
    let between = fill(&first, nodes, system);
    if between.is_empty() {
        return Some((first, between));
    }
    let all: Vec<Node> = nodes.iter().chain(&between).cloned().collect();
    Some((model_of(&all, major, linear, MOST_DEGREE)?, between))
}

/// The nodes between.
fn fill(polar: &Polar, nodes: &[Node], system: &dyn Mechanical) -> Vec<Node> {
    let mut amplitudes: Vec<f64> = nodes.iter().map(|n| n.amplitude).filter(|a| *a > 0.0).collect();
    amplitudes.sort_by(f64::total_cmp);
    let Some(&least) = amplitudes.first() else { return Vec::new() };
    // Toward the linear mode, which the model knows where its range begins at 0.
    let mut wanted: Vec<f64> = if polar.range[0] == 0.0 { vec![0.5 * least] } else { Vec::new() };
    for pair in amplitudes.windows(2) {
        let parts = ((pair[1] / pair[0]).ln() / RATIO.ln()).ceil().clamp(1.0, 16.0);
        let step = (pair[1] / pair[0]).powf(1.0 / parts);
        wanted.extend((1..parts as i32).map(|i| pair[0] * step.powi(i)));
    }
    // They weigh as the releases do.
    let mut errors: Vec<f64> = nodes.iter().map(|n| n.error).collect();
    errors.sort_by(f64::total_cmp);
    let error = errors[errors.len() / 2];
    wanted.into_iter().filter_map(|a| Some(Node { error, ..solve(polar, system, a)? })).collect()
}

/// The free motion at amplitude a.
fn solve(polar: &Polar, system: &dyn Mechanical, a: f64) -> Option<Node> {
    let n = polar.major.len();
    let orders: Vec<usize> = (0..polar.shape.len()).filter(|k| !polar.symmetric || k % 2 == 1).collect();
    let first = orders.iter().position(|k| *k == 1)?;
    let start = polar.harmonics(a);
    let size = orders.len() * n;
    let mut u = DVector::zeros(size + 1);
    for (at, k) in orders.iter().enumerate() {
        (0..n).for_each(|c| u[at * n + c] = start[*k][c]);
    }
    u[size] = polar.variational_omega(system, a)?;
    let began = u.clone();
    let residual = |u: &DVector<f64>| -> DVector<f64> {
        let omega = u[size];
        let mut out = DVector::zeros(size + 1);
        let mut free = vec![0.0; n];
        for i in 0..PHASES {
            let phi = PI * (i as f64 + 0.5) / PHASES as f64;
            let of = |w: &dyn Fn(f64, f64, f64) -> f64| -> Vec<f64> {
                (0..n)
                    .map(|c| {
                        let term = |(at, k): (usize, &usize)| {
                            let (s, co) = (*k as f64 * phi).sin_cos();
                            w(*k as f64, co, s) * u[at * n + c]
                        };
                        orders.iter().enumerate().map(term).sum()
                    })
                    .collect()
            };
            let (x, v) = (of(&|_, c, _| c), of(&|k, _, s| -omega * k * s));
            let acceleration = of(&|k, c, _| -omega * omega * k * k * c);
            system.acceleration(&x, &v, &mut free);
            for (at, k) in orders.iter().enumerate() {
                let w = (*k as f64 * phi).cos() * 2.0 / PHASES as f64;
                (0..n).for_each(|c| out[at * n + c] += w * (acceleration[c] - free[c]));
            }
        }
        out[size] = (0..n).map(|c| polar.major[c] * u[first * n + c]).sum::<f64>() - a;
        out
    };
    let mut converged = false;
    for _ in 0..12 {
        let at = residual(&u);
        let mut jacobian = DMatrix::zeros(size + 1, size + 1);
        for j in 0..=size {
            let h = if j == size { 1e-6 * u[size] } else { 1e-6 * a };
            let mut near = u.clone();
            near[j] += h;
            jacobian.set_column(j, &((residual(&near) - &at) / h));
        }
        let step = jacobian.lu().solve(&at)?;
        u -= &step;
        if !u.iter().all(|v| v.is_finite()) {
            return None;
        }
        if step.rows(0, size).norm() < 1e-10 * a && step[size].abs() < 1e-10 * u[size].abs() {
            converged = true;
            break;
        }
    }
    let moved = (u.rows(0, size) - began.rows(0, size)).norm() / began.rows(0, size).norm();
    if !converged || moved > CLOSE[0] || (u[size] / began[size] - 1.0).abs() > CLOSE[1] {
        return None;
    }
    let mut shape = vec![vec![0.0; n]; polar.shape.len()];
    for (at, k) in orders.iter().enumerate() {
        (0..n).for_each(|c| shape[*k][c] = u[at * n + c] / a);
    }
    Some(Node { amplitude: a, omega: u[size], error: 0.0, shape, spread: vec![0.0; n] })
}
