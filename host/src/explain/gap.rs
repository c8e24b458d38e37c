//! The gap: how far the model's prediction departs from the measurement within one drive period, in units of the sensors' noise.
//!
//! Over each held-out window of the horizon (one drive period, 0.2 s when free) the initial state (φ1, φ2, φ̇1, φ̇2) is fitted to the
//! window by Gauss–Newton, so that chaos does not swamp the comparison; the gap is the rms of predicted minus measured sensor angles, each divided by
//! its noise σ, over the degrees of freedom that the fit leaves: 1 where nothing but noise is left.

use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::effects::Context;
use super::forward::Model;
use crate::signal::angles::AngleSegment;

/// Time over which a first guess of the state is good enough for the fit to converge, s.
const SHORT_S: f64 = 0.1;
/// Samples over which the first guess of the velocities is taken, one after the other.
const GUESSES: [usize; 4] = [5, 10, 3, 20];
/// A window whose sum of squares exceeds the median by this factor is fitted again.
const STANDS_OUT: f64 = 4.0;
/// Steps of the differences with respect to the state, rad and rad/s.
pub const STATE_STEPS: [f64; 4] = [1e-6, 1e-6, 1e-5, 1e-5];

/// Most Gauss–Newton steps of a state's fit.
const MOST_STEPS: usize = 20;
/// A step that gains less than this share of the sum of squares is the last.
const CONVERGED: f64 = 1e-5;

/// A stretch on which predictions are compared: segment, first sample, samples.
pub type Stretch = (usize, usize, usize);

/// The gap over stretches, in noise floors. `sigma` is each sensor's noise, rad.
pub fn gap(c: &Context, model: &Model<'_>, segments: &[AngleSegment], stretches: &[Stretch], sigma: [f64; 2]) -> f64 {
    let fits = fit_windows(c, model, segments, stretches, sigma);
    let squares: f64 = fits.iter().map(|f| f.1).sum();
    let freedom: f64 = stretches.iter().map(|s| (2 * s.2) as f64 - 4.0).sum();
    (squares / freedom.max(1.0)).sqrt()
}

/// Rms of predicted minus measured angle over stretches after the same fit, rad.
pub fn rms(c: &Context, model: &Model<'_>, segments: &[AngleSegment], stretches: &[Stretch]) -> f64 {
    let fits = fit_windows(c, model, segments, stretches, [1.0; 2]);
    let squares: f64 = fits.iter().map(|f| f.1).sum();
    let count: usize = stretches.iter().map(|s| 2 * s.2).sum();
    (squares / f64::max(count as f64, 1.0)).sqrt()
}

/// Initial state and sum of squared residuals over σ of each window. A window that stands out from the others may have stopped in a local
/// minimum: it is fitted again from other guesses, and the best counts.
pub fn fit_windows(
    c: &Context,
    model: &Model<'_>,
    segments: &[AngleSegment],
    stretches: &[Stretch],
    sigma: [f64; 2],
) -> Vec<(SVector<f64, 4>, f64)> {
    let fit = |&(s, first, count): &Stretch, near: usize| fit_window(c, model, &segments[s], first, count, sigma, near);
    let mut fits: Vec<(SVector<f64, 4>, f64)> = stretches.par_iter().map(|w| fit(w, GUESSES[0])).collect();
    let mut costs: Vec<f64> = fits.iter().zip(stretches).map(|(f, w)| f.1 / w.2 as f64).collect();
    costs.sort_by(f64::total_cmp);
    let usual = costs.get(costs.len() / 2).copied().unwrap_or(0.0);
    fits.par_iter_mut().zip(stretches).for_each(|(best, window)| {
        for near in &GUESSES[1..] {
            if best.1 / window.2 as f64 <= STANDS_OUT * usual {
                break;
            }
            let again = fit(window, *near);
            if again.1 < best.1 {
                *best = again;
            }
        }
    });
    fits
}

/// Initial state fitted to a window, and the sum of squared residuals over σ: over a short part of the window first, then over twice as much each time, so that
/// the fit stays in its basin where small changes grow along the window.
fn fit_window(
    c: &Context,
    model: &Model<'_>,
    segment: &AngleSegment,
    first: usize,
    count: usize,
    sigma: [f64; 2],
    near: usize,
) -> (SVector<f64, 4>, f64) {
    let mut part = count;
    while part as f64 * segment.step_s > SHORT_S && part >= 32 {
        part /= 2;
    }
    let mut x = guess(segment, first, part, near);
    loop {
        let cost;
        (x, cost) = fit_state(c, model, segment, first, part, sigma, x);
        if part == count {
            return (x, cost);
        }
        part = (2 * part).min(count);
    }
}

/// Initial state from the first few samples.
fn guess(segment: &AngleSegment, first: usize, count: usize, near: usize) -> SVector<f64, 4> {
    let slope = |k: usize| {
        // Slope at the start from a short parabola: differences over `near` and twice as many samples.
        let near = near.min(count.saturating_sub(1));
        let at = |i: usize| segment.phi[k][first + i];
        let far = (2 * near).min(count.saturating_sub(1));
        if near > 0 && far == 2 * near {
            (4.0 * at(near) - 3.0 * at(0) - at(far)) / (2.0 * near as f64 * segment.step_s)
        } else {
            (at(far) - at(0)) / (far.max(1) as f64 * segment.step_s)
        }
    };
    SVector::<f64, 4>::new(segment.phi[0][first], segment.phi[1][first], slope(0), slope(1))
}

/// (Predicted − measured)/σ of both sensors over `count` samples from a state.
pub fn residuals(
    c: &Context,
    model: &Model<'_>,
    segment: &AngleSegment,
    first: usize,
    count: usize,
    sigma: [f64; 2],
    x: &SVector<f64, 4>,
) -> Vec<f64> {
    model
        .predict(c, segment, first, count, x)
        .iter()
        .enumerate()
        .flat_map(|(k, p)| {
            let phi = [segment.phi[0][first + k], segment.phi[1][first + k]];
            let shown = [phi[0], if segment.relative { phi[1] - phi[0] } else { phi[1] }];
            [(p[0] - shown[0]) / sigma[0], (p[1] - shown[1]) / sigma[1]]
        })
        .collect()
}

/// Initial state fitted to `count` samples by Gauss–Newton with damping, and the sum of squares left.
fn fit_state(
    c: &Context,
    model: &Model<'_>,
    segment: &AngleSegment,
    first: usize,
    count: usize,
    sigma: [f64; 2],
    start: SVector<f64, 4>,
) -> (SVector<f64, 4>, f64) {
    let residuals = |x: &SVector<f64, 4>| residuals(c, model, segment, first, count, sigma, x);
    let mut x = start;
    let mut r = residuals(&x);
    let mut cost: f64 = r.iter().map(|v| v * v).sum();
    let mut damping = 1e-6;
    // The Jacobian is kept from step to step (chord method) while steps gain well: it costs four predictions.
    let mut kept: Option<(SMatrix<f64, 4, 4>, Vec<Vec<f64>>)> = None;
    for _ in 0..MOST_STEPS {
        let fresh = kept.is_none();
        let (normal, columns) = kept.take().unwrap_or_else(|| {
            let columns: Vec<Vec<f64>> = (0..4)
                .map(|k| {
                    let mut y = x;
                    y[k] += STATE_STEPS[k];
                    residuals(&y).iter().zip(&r).map(|(a, b)| (a - b) / STATE_STEPS[k]).collect()
                })
                .collect();
            let normal = SMatrix::from_fn(|i, j| columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum());
            (normal, columns)
        });
        let right = SVector::<f64, 4>::from_fn(|i, _| -columns[i].iter().zip(&r).map(|(a, b)| a * b).sum::<f64>());
        let mut gained = 0.0;
        for _ in 0..6 {
            let mut damped = normal;
            (0..4).for_each(|i| damped[(i, i)] *= 1.0 + damping);
            let Some(step) = damped.cholesky().map(|f| f.solve(&right)) else { break };
            let y = x + step;
            let s = residuals(&y);
            let new: f64 = s.iter().map(|v| v * v).sum();
            if new.is_finite() && new < cost {
                gained = (cost - new) / cost;
                (x, r, cost) = (y, s, new);
                damping = (damping * 0.1).max(1e-9);
                break;
            }
            if !fresh {
                break;
            }
            damping = (damping * 10.0).max(1e-6);
        }
        if fresh && gained < CONVERGED {
            break;
        }
        if gained > 0.5 {
            kept = Some((normal, columns));
        }
    }
    (x, cost)
}

/// Which stretches of a record predictions are made on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Part {
    /// Every third block: held out of the fit.
    HeldOut,
    /// The other two thirds.
    Fitted,
    /// Everything up to a fraction of the record.
    Before(f64),
    /// Everything from a fraction of the record on.
    After(f64),
}

/// Windows of a horizon inside a part of the record, at most `most` of them spread evenly.
pub fn stretches(
    segments: &[AngleSegment],
    geometry: &crate::identify::Geometry,
    horizon_s: f64,
    part: Part,
    most: usize,
) -> Vec<Stretch> {
    let mut all = Vec::new();
    let reach = geometry.kernels.reach();
    let total: usize = segments.iter().map(AngleSegment::len).sum();
    let mut before = 0;
    for (s, segment) in segments.iter().enumerate() {
        let count = (horizon_s / segment.step_s).round() as usize + 1;
        let block = geometry.windows.length_s / segment.step_s;
        let mut add = |from: usize, to: usize| {
            all.extend((from..to.saturating_sub(count)).step_by(count.max(1)).map(|i| (s, i, count)));
        };
        match part {
            Part::HeldOut | Part::Fitted => {
                for index in 0.. {
                    let first = reach + (index as f64 * block).round() as usize;
                    let end = first + block as usize;
                    if end + reach > segment.len() {
                        break;
                    }
                    if ((index + s) % super::ranking::FOLDS == 0) == (part == Part::HeldOut) {
                        add(first, end);
                    }
                }
            }
            Part::Before(fraction) | Part::After(fraction) => {
                let cut = ((fraction * total as f64) as usize).saturating_sub(before).min(segment.len());
                if matches!(part, Part::Before(_)) { add(0, cut) } else { add(cut, segment.len()) }
            }
        }
        before += segment.len();
    }
    let stride = all.len().div_ceil(most.max(1)).max(1);
    all.into_iter().step_by(stride).collect()
}
