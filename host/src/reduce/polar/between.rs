//! Nodes between the releases from the equations themselves, where these are known.
//!
//! Between two releases far apart the shapes are interpolated, and an error of 1 % in them costs
//! the variational frequency 1e-4. The equations need no release there: from an interpolated shape
//! at amplitude a, Newton's method solves the free motion's harmonic balance ω² x_φφ = a(x, ω x_φ),
//! its first harmonic's major coordinate held at a, for the harmonics that the model has, and ω.
//! Averages over half a turn (the motion retraces itself); derivatives by difference quotients. A
//! solution that is not close to where it started is another motion and is not taken.

use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

use super::super::systems::Mechanical;
use super::fitting::{model, model_of};
use super::{Node, Polar};

/// Ratio of neighbouring amplitudes above which nodes are put between.
const RATIO: f64 = 1.35;
/// Highest degree in s with these nodes.
const MOST_DEGREE: usize = 8;
/// Standard error of a release's shape, relative, from which it weighs less than a node from the
/// equations.
const KNOWN: f64 = 3e-5;
/// Relative error that stands for the weight 1.
const UNIT: f64 = 1e-9;
/// Even harmonics, relative to the odd ones, below which there are none.
const NO_EVEN: f64 = 1e-7;
/// Phases in half a turn.
const PHASES: usize = 48;
/// Greatest change of the shape, relative to it, and of the frequency.
const CLOSE: [f64; 2] = [0.2, 0.02];

/// The model of a system whose equations are known: of the releases' nodes and of those between
/// them. All of them are answered, the releases' first, as [`Polar::corrected_omega`] takes them.
pub fn model_with(
    nodes: &[Node],
    major: &[f64],
    system: &dyn Mechanical,
    linear: Option<(f64, Vec<f64>)>,
) -> Option<(Polar, Vec<Node>)> {
    let first = model(nodes, major, linear.clone())?;
    let between = fill(&first, nodes, system);
    if between.is_empty() {
        return Some((first, nodes.to_vec()));
    }
    // The releases tell whether the motion is symmetric: many nodes between would outvote one that
    // is not.
    let model = model_of(&weighed(nodes, &between), major, linear, MOST_DEGREE, Some(first.symmetric))?;
    Some((model, nodes.iter().chain(&between).cloned().collect()))
}

/// The nodes as they are weighed in such a model: those between by 1, a release's the less the less
/// its shape is known; but the greatest release's by 1, for beyond the last node between nothing
/// else holds the polynomials.
pub fn weighed(nodes: &[Node], between: &[Node]) -> Vec<Node> {
    let greatest = nodes.iter().map(|n| n.amplitude).fold(0.0, f64::max);
    let of = |n: &Node| {
        if n.amplitude == greatest {
            return Node { error: UNIT, ..n.clone() };
        }
        let spread = n.spread.iter().map(|s| s * s).sum::<f64>().sqrt() / n.amplitude.abs().max(1e-300);
        Node { error: UNIT * (spread / KNOWN).max(1.0), ..n.clone() }
    };
    nodes.iter().map(of).chain(between.iter().map(|n| Node { error: UNIT, ..n.clone() })).collect()
}

/// The nodes between.
fn fill(polar: &Polar, nodes: &[Node], system: &dyn Mechanical) -> Vec<Node> {
    let least = nodes.iter().map(|n| n.amplitude).filter(|a| *a > 0.0).fold(f64::INFINITY, f64::min);
    if !least.is_finite() {
        return Vec::new();
    }
    let mut ordered: Vec<&Node> = nodes.iter().filter(|n| n.amplitude > 0.0).collect();
    ordered.sort_by(|a, b| a.amplitude.total_cmp(&b.amplitude));
    let mut out = Vec::new();
    // Toward the linear mode, which the model knows where its range begins at 0.
    if polar.range[0] == 0.0 {
        let a = 0.5 * least;
        let guess = polar.variational_omega(system, a).map(|omega| (polar.harmonics(a), omega));
        out.extend(guess.and_then(|(x, omega)| solve(polar, system, a, &x, omega)));
    }
    for pair in ordered.windows(2) {
        // Upward from the lower release, each guess on the straight line from the last motion found
        // to the upper release.
        let (mut last, upper) = (pair[0].clone(), pair[1]);
        let parts = ((upper.amplitude / last.amplitude).ln() / RATIO.ln()).ceil().clamp(1.0, 16.0);
        let step = (upper.amplitude / last.amplitude).powf(1.0 / parts);
        for _ in 1..parts as i32 {
            let a = last.amplitude * step;
            let share = step.ln() / (upper.amplitude / last.amplitude).ln();
            let of = |node: &Node, k: usize, c: usize| node.shape.get(k).map_or(0.0, |x| x[c]);
            let mix = |p: f64, q: f64| p + share * (q - p);
            let guess: Vec<Vec<f64>> = (0..polar.shape.len())
                .map(|k| (0..polar.major.len()).map(|c| a * mix(of(&last, k, c), of(upper, k, c))).collect())
                .collect();
            let Some(node) = solve(polar, system, a, &guess, mix(last.omega, upper.omega)) else { break };
            last = node.clone();
            out.push(node);
        }
    }
    out
}

/// The free motion at amplitude a, from harmonics and a frequency near it.
fn solve(polar: &Polar, system: &dyn Mechanical, a: f64, start: &[Vec<f64>], omega: f64) -> Option<Node> {
    let n = polar.major.len();
    let orders: Vec<usize> = (0..polar.shape.len()).filter(|k| !polar.symmetric || k % 2 == 1).collect();
    let first = orders.iter().position(|k| *k == 1)?;
    let size = orders.len() * n;
    let mut u = DVector::zeros(size + 1);
    for (at, k) in orders.iter().enumerate() {
        (0..n).for_each(|c| u[at * n + c] = start[*k][c]);
    }
    u[size] = omega;
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
    // What rounding leaves of even harmonics in a symmetric system is none.
    let square = |from: usize| shape.iter().skip(from).step_by(2).flatten().map(|x| x * x).sum::<f64>();
    if square(0) < NO_EVEN * NO_EVEN * square(1) {
        shape.iter_mut().step_by(2).flatten().for_each(|x| *x = 0.0);
    }
    Some(Node { amplitude: a, omega: u[size], error: 0.0, shape, spread: vec![0.0; n] })
}
