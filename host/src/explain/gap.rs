//! The gap: how far the model's prediction departs from the measurement within one drive period, in units of the sensors' noise.
//!
//! Over each held-out window of the horizon (one drive period, 0.2 s when free) the initial state (φ1, φ2, φ̇1, φ̇2) is fitted to the
//! window by Gauss–Newton, so that chaos does not swamp the comparison; the gap is the rms of predicted minus measured sensor angles, each divided by
//! its noise σ, over the degrees of freedom that the fit leaves: 1 where nothing but noise is left.
//! Integration: classical Runge–Kutta, four steps a sample.

use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::effects::{Action, Context, Variant};
use crate::model::weak::Sample;
use crate::signal::angles::{AngleSegment, Phase};

/// A model that can be integrated: the B coefficients and effects with their strengths.
pub struct Model<'a> {
    /// B_i1 … of both equations, then nothing.
    pub base: Vec<f64>,
    /// Effects with their strengths.
    pub effects: Vec<(&'a Variant, Vec<f64>)>,
}

/// Steps a sample.
const STEPS: usize = 4;
/// Time over which a first guess of the state is good enough for the fit to converge, s.
const SHORT_S: f64 = 0.1;

impl Model<'_> {
    /// φ̈1, φ̈2 at a sample's state.
    fn acceleration(&self, c: &Context, s: &Sample) -> [f64; 2] {
        let n = self.base.len() / 2;
        let b = |i: usize, k: usize| if k < n { self.base[i * n + k] } else { 0.0 };
        let mut left = [0.0; 2];
        for (i, left) in left.iter_mut().enumerate() {
            *left = s.sin[i] * (b(i, 1) + b(i, 2) * s.cos_tau + b(i, 3) * s.sin_tau);
        }
        for (v, k) in &self.effects {
            if let Action::Force(columns) = &v.action {
                for (pair, k) in columns.iter().zip(k) {
                    for (left, series) in left.iter_mut().zip(pair) {
                        if let Some(f) = series {
                            *left += k * f(s);
                        }
                    }
                }
            }
        }
        let (sin, cos) = (s.sin_delta(), s.cos_delta());
        let square = c.omega * c.omega;
        let right = [
            b(0, 0) * s.rate[1] * s.rate[1] * sin - square * left[0],
            -b(1, 0) * s.rate[0] * s.rate[0] * sin - square * left[1],
        ];
        let (m12, m21) = (b(0, 0) * cos, b(1, 0) * cos);
        let determinant = 1.0 - m12 * m21;
        [(right[0] - m12 * right[1]) / determinant, (right[1] - m21 * right[0]) / determinant]
    }

    /// Sensor angles over `count` samples from a state at sample `first` of a segment.
    fn predict(
        &self,
        c: &Context,
        segment: &AngleSegment,
        first: usize,
        count: usize,
        state: &SVector<f64, 4>,
    ) -> Vec<[f64; 2]> {
        let mut x = *state;
        let h = segment.step_s / STEPS as f64;
        let omega = match segment.phase {
            Phase::Clock(w) => w,
            Phase::Device(_) => c.omega,
        };
        let runaway: f64 = self
            .effects
            .iter()
            .filter(|(v, _)| matches!(v.action, Action::Runaway(_)))
            .map(|(_, k)| core::f64::consts::TAU * k[0])
            .sum();
        let omega = omega + runaway;
        let mut accel = [0.0; 2];
        let mut rate_of = |x: &SVector<f64, 4>, tau: f64, time: f64| {
            let (sin1, cos1) = x[0].sin_cos();
            let (sin2, cos2) = x[1].sin_cos();
            let (sin_tau, cos_tau) = tau.sin_cos();
            let rate = [x[2], x[3]];
            let s = Sample {
                raw: [x[0], x[1]],
                phi: [x[0], x[1]],
                rate,
                clear_rate: rate,
                clear_step: [0.0; 2],
                accel,
                sin: [sin1, sin2],
                cos: [cos1, cos2],
                sin_tau,
                cos_tau,
                time,
            };
            accel = self.acceleration(c, &s);
            SVector::<f64, 4>::new(x[2], x[3], accel[0], accel[1])
        };
        let mut out = Vec::with_capacity(count);
        for i in 0..count {
            let time = segment.time(first + i);
            let tau = segment.tau(first + i) + runaway * (time - c.span_s[0]);
            let shown = [x[0], if segment.relative { x[1] - x[0] } else { x[1] }];
            let rates = [x[2], if segment.relative { x[3] - x[2] } else { x[3] }];
            let mut angles = shown;
            for (v, k) in &self.effects {
                if let Action::Sensor(laws) = &v.action {
                    for (law, k) in laws.iter().zip(k) {
                        let d = law(shown, rates, time);
                        angles[0] += k * d[0];
                        angles[1] += k * d[1];
                    }
                }
            }
            out.push(angles);
            for j in 0..STEPS {
                let at = j as f64 * h;
                let (t0, t1, t2) = (tau + omega * at, tau + omega * (at + 0.5 * h), tau + omega * (at + h));
                let k1 = rate_of(&x, t0, time + at);
                let k2 = rate_of(&(x + k1 * (0.5 * h)), t1, time + at + 0.5 * h);
                let k3 = rate_of(&(x + k2 * (0.5 * h)), t1, time + at + 0.5 * h);
                let k4 = rate_of(&(x + k3 * h), t2, time + at + h);
                x += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
            }
        }
        out
    }
}

/// A stretch on which predictions are compared: segment, first sample, samples.
pub type Stretch = (usize, usize, usize);

/// The gap over stretches, in noise floors. `sigma` is each sensor's noise, rad.
pub fn gap(c: &Context, model: &Model<'_>, segments: &[AngleSegment], stretches: &[Stretch], sigma: [f64; 2]) -> f64 {
    let sums: Vec<(f64, f64)> = stretches
        .par_iter()
        .map(|&(s, first, count)| {
            let squares = fit_window(c, model, &segments[s], first, count, sigma);
            (squares, (2 * count) as f64 - 4.0)
        })
        .collect();
    let (squares, freedom) = sums.iter().fold((0.0, 0.0), |t, x| (t.0 + x.0, t.1 + x.1));
    (squares / f64::max(freedom, 1.0)).sqrt()
}

/// Sum of squared residuals over σ after fitting the initial state: over a short part of the window first, then over twice as much each time, so that
/// the fit stays in its basin where small changes grow along the window.
fn fit_window(
    c: &Context,
    model: &Model<'_>,
    segment: &AngleSegment,
    first: usize,
    count: usize,
    sigma: [f64; 2],
) -> f64 {
    let mut part = count;
    while part as f64 * segment.step_s > SHORT_S && part >= 32 {
        part /= 2;
    }
    let mut x = guess(segment, first, part);
    loop {
        let cost;
        (x, cost) = fit_state(c, model, segment, first, part, sigma, x);
        if part == count {
            return cost;
        }
        part = (2 * part).min(count);
    }
}

/// Initial state from the first few samples.
fn guess(segment: &AngleSegment, first: usize, count: usize) -> SVector<f64, 4> {
    let slope = |k: usize| {
        // Slope at the start from a short parabola: differences over 5 and 10 samples.
        let near = 5.min(count.saturating_sub(1));
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
    let measured: Vec<[f64; 2]> = (first..first + count)
        .map(|i| [segment.phi[0][i], segment.phi[1][i] - if segment.relative { segment.phi[0][i] } else { 0.0 }])
        .collect();
    let residuals = |x: &SVector<f64, 4>| -> Vec<f64> {
        model
            .predict(c, segment, first, count, x)
            .iter()
            .zip(&measured)
            .flat_map(|(p, m)| [(p[0] - m[0]) / sigma[0], (p[1] - m[1]) / sigma[1]])
            .collect()
    };
    let mut x = start;
    let mut r = residuals(&x);
    let mut cost: f64 = r.iter().map(|v| v * v).sum();
    let mut damping = 1e-6;
    for _ in 0..12 {
        let mut normal = SMatrix::<f64, 4, 4>::zeros();
        let mut right = SVector::<f64, 4>::zeros();
        let steps = [1e-6, 1e-6, 1e-5, 1e-5];
        let columns: Vec<Vec<f64>> = (0..4)
            .map(|k| {
                let mut y = x;
                y[k] += steps[k];
                residuals(&y).iter().zip(&r).map(|(a, b)| (a - b) / steps[k]).collect()
            })
            .collect();
        for i in 0..4 {
            for j in 0..4 {
                normal[(i, j)] = columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum();
            }
            right[i] = -columns[i].iter().zip(&r).map(|(a, b)| a * b).sum::<f64>();
        }
        let mut better = false;
        for _ in 0..6 {
            let mut damped = normal;
            (0..4).for_each(|i| damped[(i, i)] *= 1.0 + damping);
            let Some(step) = damped.cholesky().map(|f| f.solve(&right)) else { break };
            let y = x + step;
            let s = residuals(&y);
            let new: f64 = s.iter().map(|v| v * v).sum();
            if new.is_finite() && new < cost {
                better = cost - new > 1e-6 * cost;
                (x, r, cost) = (y, s, new);
                damping = (damping * 0.1).max(1e-9);
                break;
            }
            damping = (damping * 10.0).max(1e-6);
        }
        if !better {
            break;
        }
    }
    (x, cost)
}

impl<'a> Model<'a> {
    /// The model of a state with coefficients of its own columns.
    pub(super) fn of(state: &'a super::state::State, x: &nalgebra::DVector<f64>) -> Model<'a> {
        let n = 2 * super::design::base_terms(state.context.driven);
        let mut at = n;
        let effects = state
            .chosen
            .iter()
            .map(|k| {
                let applied = k.candidate.variant.action.is_applied();
                let strengths = k
                    .strengths
                    .iter()
                    .map(|s| {
                        at += 1;
                        x[at - 1] + if applied { *s } else { 0.0 }
                    })
                    .collect();
                (&k.candidate.variant, strengths)
            })
            .collect();
        Model { base: x.rows(0, n).iter().copied().collect(), effects }
    }
}

/// Windows of the horizon inside the held-out blocks (every third), at most 240 of them spread evenly.
pub fn stretches(segments: &[AngleSegment], geometry: &crate::identify::Geometry, horizon_s: f64) -> Vec<Stretch> {
    let mut all = Vec::new();
    let reach = geometry.kernels.reach();
    for (s, segment) in segments.iter().enumerate() {
        let count = (horizon_s / segment.step_s).round() as usize + 1;
        let block = geometry.windows.length_s / segment.step_s;
        for index in 0.. {
            let first = reach + (index as f64 * block).round() as usize;
            let end = first + block as usize;
            if end + reach > segment.len() {
                break;
            }
            if (index + s) % super::ranking::FOLDS == 0 {
                all.extend((first..end.saturating_sub(count)).step_by(count.max(1)).map(|i| (s, i, count)));
            }
        }
    }
    let stride = all.len().div_ceil(240).max(1);
    all.into_iter().step_by(stride).collect()
}
