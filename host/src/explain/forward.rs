//! Predictions: the model with its effects, integrated from a state, as the sensors would show it.
//!
//! Classical Runge–Kutta (1901), steps of at most 1 ms.

use nalgebra::SVector;

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

/// Longest step, s.
const LONGEST_STEP_S: f64 = 1e-3;

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
    pub fn predict(
        &self,
        c: &Context,
        segment: &AngleSegment,
        first: usize,
        count: usize,
        state: &SVector<f64, 4>,
    ) -> Vec<[f64; 2]> {
        let mut x = *state;
        let steps = (segment.step_s / LONGEST_STEP_S - 1e-9).ceil().clamp(1.0, 1e3) as usize;
        let h = segment.step_s / steps as f64;
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
            for j in 0..steps {
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
