//! Predictions by a model file with its effects: over short windows with fitted initial states (the gap), and over the end of a record
//! from its beginning, without touching the state (the simulation error).

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::identify::general::stretches::Stretch;
use crate::identify::general::track::Along;
use crate::model::integrate::{Settings, solve};
use crate::model::model_file::equations_of_motion::EquationsOfMotion;

/// Error of one integration step.
const TOLERANCE: f64 = 1e-7;
/// Most windows of the gap.
const MOST_WINDOWS: usize = 40;
/// Steps within one sample at most: what sticks takes them all, and a reversal is placed to this fraction.
const FINEST: f64 = 2.0;
/// Gauss–Newton rounds and trial steps of a fit by simulation.
const ROUNDS: usize = 5;
const TRIALS: usize = 5;
/// Most samples that a simulation is fitted to.
const MOST_SAMPLES: usize = 4000;

/// A piece of a stretch: every `stride`-th sample from `first` on.
#[derive(Clone, Copy, Debug)]
struct Piece {
    first: usize,
    count: usize,
    stride: usize,
}

/// Coordinates over a piece from an initial state.
fn predict(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    state: &[f64],
    s: &Stretch,
    along: &Along,
    piece: Piece,
) -> Option<Vec<Vec<f64>>> {
    let settings = Settings {
        start_s: s.time(piece.first),
        step_s: s.step_s * piece.stride as f64,
        count: piece.count,
        tolerance: TOLERANCE,
        inputs: s.inputs.len(),
        finest: FINEST * piece.stride as f64,
    };
    solve(motion, parameters, state, along, &settings)
}

/// Residuals over noise of a prediction.
fn residuals(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    state: &[f64],
    s: &Stretch,
    along: &Along,
    piece: Piece,
    sigma: &[f64],
) -> Option<Vec<f64>> {
    let y = predict(motion, parameters, state, s, along, piece)?;
    let mut out = Vec::with_capacity(piece.count * s.coordinates.len());
    for (i, y) in y.iter().enumerate() {
        let at = piece.first + i * piece.stride;
        out.extend(s.coordinates.iter().enumerate().map(|(k, x)| (y[k] - x[at]) / sigma[k]));
    }
    Some(out)
}

/// First guess of a state at a sample: value and slope by a parabola through a few samples.
fn guess(s: &Stretch, first: usize, near: usize) -> Vec<f64> {
    let n = s.coordinates.len();
    let mut out = vec![0.0; 2 * n];
    for (k, x) in s.coordinates.iter().enumerate() {
        let near = near.min((x.len() - 1 - first) / 2).max(1);
        let at = |i: usize| x[(first + i).min(x.len() - 1)];
        out[k] = at(0);
        out[n + k] = (4.0 * at(near) - 3.0 * at(0) - at(2 * near)) / (2.0 * near as f64 * s.step_s);
    }
    out
}

/// Gauss–Newton with damping over the initial state and, if `vary` is more than 0, the first `vary` parameters; the arguments hold the state
/// and then the parameters. An argument with a sign does not pass zero. The sum of squares left.
fn minimise(
    arguments: &mut [f64],
    free: usize,
    rounds: usize,
    evaluate: &(dyn Fn(&[f64]) -> Option<Vec<f64>> + Sync),
    scale: &[f64],
    signs: &[f64],
) -> Option<f64> {
    let mut r = evaluate(arguments)?;
    let mut cost: f64 = r.iter().map(|x| x * x).sum();
    let mut damping = 1e-4;
    for _ in 0..rounds {
        let columns: Vec<Option<Vec<f64>>> = (0..free)
            .into_par_iter()
            .map(|k| {
                let mut moved = arguments.to_vec();
                moved[k] += 1e-5 * scale[k];
                let ahead = evaluate(&moved)?;
                Some(ahead.iter().zip(&r).map(|(a, b)| (a - b) / 1e-5).collect())
            })
            .collect();
        let columns: Vec<Vec<f64>> = columns.into_iter().collect::<Option<_>>()?;
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let normal = DMatrix::from_fn(free, free, |i, j| dot(&columns[i], &columns[j]));
        let right = DVector::from_fn(free, |i, _| -dot(&columns[i], &r));
        // At zero and driven beyond it: held.
        let held: Vec<bool> = (0..free).map(|i| arguments[i] == 0.0 && signs[i] * right[i] < 0.0).collect();
        let mut better = None;
        for _ in 0..TRIALS {
            let mut damped = normal.clone();
            let mut wanted = right.clone();
            for i in 0..free {
                damped[(i, i)] *= 1.0 + damping;
                if held[i] {
                    damped.row_mut(i).fill(0.0);
                    damped.column_mut(i).fill(0.0);
                    damped[(i, i)] = 1.0;
                    wanted[i] = 0.0;
                }
            }
            let Some(step) = damped.cholesky().map(|f| f.solve(&wanted)) else { break };
            let moved: Vec<f64> = arguments
                .iter()
                .enumerate()
                .map(|(k, x)| if k < free { signed(x + step[k] * scale[k], signs[k]) } else { *x })
                .collect();
            if let Some(new) = evaluate(&moved) {
                let c: f64 = new.iter().map(|x| x * x).sum();
                if c.is_finite() && c < cost {
                    better = Some((cost - c) / cost);
                    arguments.copy_from_slice(&moved);
                    (r, cost) = (new, c);
                    damping = (damping * 0.1).max(1e-9);
                    break;
                }
            }
            damping *= 10.0;
        }
        if better.is_none_or(|b| b < 1e-5) {
            break;
        }
    }
    Some(cost)
}

/// A value, or zero where its sign is not the given one (0: either).
fn signed(x: f64, sign: f64) -> f64 {
    if x * sign < 0.0 { 0.0 } else { x }
}

/// Steps for differences: sizes of the state and of the parameters.
fn scales(s: &Stretch, parameters: &[f64]) -> Vec<f64> {
    let spread = |x: &[f64]| {
        let mean = x.iter().sum::<f64>() / x.len().max(1) as f64;
        (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / x.len().max(1) as f64).sqrt().max(1e-12)
    };
    let rate = |x: &[f64]| {
        let d: f64 = x.windows(2).map(|w| ((w[1] - w[0]) / s.step_s).powi(2)).sum();
        (d / x.len().max(1) as f64).sqrt().max(1e-12)
    };
    s.coordinates
        .iter()
        .map(|x| spread(x))
        .chain(s.coordinates.iter().map(|x| rate(x)))
        .chain(parameters.iter().map(|p| p.abs().max(1e-12)))
        .collect()
}

/// The gap over windows of the horizon inside the held-out blocks (every third of `block_s`): rms of predicted minus measured over
/// the noise, over the degrees of freedom that the fit of the initial state leaves.
pub fn gap(
    motion: &EquationsOfMotion,
    parameters: &[f64],
    stretches: &[Stretch],
    along: &[Along],
    sigma: &[f64],
    horizon_s: f64,
    block_s: f64,
) -> f64 {
    let mut all = Vec::new();
    for (k, s) in stretches.iter().enumerate() {
        let count = ((horizon_s / s.step_s).round() as usize).max(8) + 1;
        let mut first = 0;
        while first + count <= s.len() {
            let block = (s.time(first) / block_s).floor() as i64;
            if block.rem_euclid(3) == 0 {
                all.push((k, first, count));
            }
            first += count;
        }
    }
    let stride = all.len().div_ceil(MOST_WINDOWS).max(1);
    let sums: Vec<Option<(f64, f64)>> = all
        .into_iter()
        .step_by(stride)
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|(k, first, count)| {
            let s = &stretches[k];
            let n = 2 * s.coordinates.len();
            let scale = scales(s, &[]);
            let mut state = guess(s, first, (count / 12).max(1));
            let piece = Piece { first, count, stride: 1 };
            let evaluate = |x: &[f64]| residuals(motion, parameters, x, s, &along[k], piece, sigma);
            let cost = minimise(&mut state, n, 8, &evaluate, &scale, &vec![0.0; n])?;
            Some((cost, (count * s.coordinates.len()) as f64 - n as f64))
        })
        .collect();
    let (squares, freedom) = sums.iter().flatten().fold((0.0, 0.0), |t, x| (t.0 + x.0, t.1 + x.1));
    if freedom > 0.0 { (squares / freedom).sqrt() } else { f64::NAN }
}

/// Parameters, each with its sign (0: either), and initial state fitted by simulation to the end of the first `share` of a stretch ([`MOST_SAMPLES`] of every `stride`-th sample at
/// most), then simulated to the stretch's end without touching the state: the fitted parameters, and the rms error of each coordinate over
/// the rest.
pub fn simulate(
    motion: &EquationsOfMotion,
    (parameters, signs): (&[f64], &[f64]),
    stretch: &Stretch,
    along: &Along,
    sigma: &[f64],
    share: f64,
    stride: usize,
) -> Option<(Vec<f64>, Vec<f64>)> {
    let n = 2 * stretch.coordinates.len();
    let end = (share * stretch.len() as f64) as usize;
    let first = end.saturating_sub(MOST_SAMPLES.saturating_mul(stride));
    let fitted = end - first;
    if fitted < 64 * stride {
        return None;
    }
    let scale = scales(stretch, parameters);
    let mut arguments = [guess(stretch, first, 5), parameters.to_vec()].concat();
    let signs = [&vec![0.0; n][..], signs].concat();
    let evaluate = |count: usize, stride: usize| {
        let piece = Piece { first, count, stride };
        move |x: &[f64]| residuals(motion, &x[n..], &x[..n], stretch, along, piece, sigma)
    };
    // The state first, over longer and longer beginnings, then everything over the whole part.
    let mut count = 64 * stride;
    while count < fitted {
        minimise(&mut arguments, n, 5, &evaluate(count / stride, stride), &scale, &signs)?;
        count *= 4;
    }
    minimise(&mut arguments, scale.len(), ROUNDS, &evaluate(fitted / stride, stride), &scale, &signs)?;
    let to_end = Piece { first, count: stretch.len() - first, stride: 1 };
    let y = predict(motion, &arguments[n..], &arguments[..n], stretch, along, to_end)?;
    let errors = stretch
        .coordinates
        .iter()
        .enumerate()
        .map(|(k, x)| {
            let rest = y[fitted..].iter().zip(&x[end..]);
            (rest.map(|(y, x)| (y[k] - x).powi(2)).sum::<f64>() / (x.len() - end).max(1) as f64).sqrt()
        })
        .collect();
    Some((arguments[n..].to_vec(), errors))
}
