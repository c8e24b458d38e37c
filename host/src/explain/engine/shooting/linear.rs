//! Shooting linearised about a path: a window's normal equations over all columns, its initial
//! state eliminated.
//!
//! With states x_k of the path, the model's flow over one sample F, its slope A_k and the defects
//! e_k = F(x_k) − x_{k+1}, the deviation δ of a solution of the model from the path obeys δ_{k+1} =
//! A_k δ_k + e_k + u_k, u_k what the accelerations α by every column do over a sample (over several
//! points to a sample where samples are few). They act as impulses: Δα at every point but the first
//! and the last, and half of it there. That is the trapezoidal rule for ∫ Φ(t, s) α(s) ds, Φ the
//! model's response, whose error is one of its ends alone (Euler and Maclaurin): −Δ²/12 ∂(Φα)/∂s, at
//! s = t that of a coordinate Δ²α/12, which is added to what sensors show; at the beginning another
//! initial state. What is left is (ω Δ)⁴/720. Sensors show S(q + δ_q) + Σ ε s(q): linear in δ_0,
//! parameters, strengths and sensor laws alike. No solution has to be found first, and what is far
//! from one still has its columns.

use core::ops::Range;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::gram::{Layout, Sums};
use super::normal::{Normal, Segment};
use super::strips::{Along, STRIP, Strip};
use super::window_inputs::WindowInputs;
use crate::model::dynamics::Dynamics;
use crate::model::flow::abreast::{self, ABREAST, Steps, VectorField};

/// The model's flow about a window's path.
pub struct Linear {
    /// The path at every point: the samples' states, the model's own motion between them.
    pub points: Vec<f64>,
    /// Accelerations there, n for each.
    pub accelerations: Vec<f64>,
    /// Entries of δ: 2n, and the states of effects.
    pub(super) size: usize,
    /// A_k, row after row, for each point but the last.
    pub(super) slopes: Vec<f64>,
    /// e_k for each sample but the last.
    pub(super) defects: Vec<f64>,
    /// Points to a sample.
    pub(super) each: usize,
    /// Time between points, s.
    pub(super) spacing: f64,
}

/// What the sensors showed over a window, sensor after sensor for each sample, and how.
pub struct Measured<'a> {
    /// Values.
    pub values: Vec<f64>,
    /// Weights of the coordinates.
    pub shown: &'a [Vec<f64>],
    /// Noise.
    pub sigma: &'a [f64],
    /// Additions of columns to what a sensor shows: column, sensor, values.
    pub laws: Vec<(usize, usize, Vec<f64>)>,
}

impl Linear {
    /// None where the model has no solution somewhere. `hidden` are the numbers of the states of
    /// effects that the equations of motion follow themselves.
    pub fn new(states: &[f64], exogenous: &WindowInputs<'_>, field: VectorField<'_>, hidden: &[usize]) -> Option<Self> {
        let all = field.motion.degrees_of_freedom();
        let n = all - hidden.len();
        let (m, size) = (2 * n, 2 * n + hidden.len());
        let (each, spacing) = (exogenous.points, exogenous.spacing());
        let count = states.len() / m;
        let points = count.saturating_sub(1) * each + 1;
        let mut out = Self {
            points: vec![0.0; m * points],
            accelerations: vec![0.0; n * points],
            size,
            slopes: vec![0.0; size * size * points.saturating_sub(1)],
            defects: Vec::with_capacity(size * count),
            each,
            spacing,
        };
        // A state of an effect is the rate of a coordinate on which nothing depends.
        let remembered: Vec<Vec<f64>> = hidden.iter().map(|&k| exogenous.remembered(k, points)).collect();
        let whole: Vec<f64> = states
            .chunks_exact(m)
            .enumerate()
            .flat_map(|(k, s)| {
                let own = remembered.iter().map(move |z| z[k * each]);
                s[..n].iter().copied().chain(hidden.iter().map(|_| 0.0)).chain(s[n..].iter().copied()).chain(own)
            })
            .collect();
        let kept: Vec<usize> = (0..n).chain(all..2 * all).collect();
        let mut steps = Steps::new(field.motion);
        let mut here = whole[..2 * all * count.saturating_sub(1)].to_vec();
        for j in 0..each {
            for (block, states) in here.chunks_mut(2 * all * ABREAST).enumerate() {
                let point = |i: usize| (block * ABREAST + i) * each + j;
                out.step(states, &mut steps, exogenous, field, &kept, point)?;
            }
        }
        for (reached, next) in here.chunks_exact(2 * all).zip(whole[2 * all..].chunks_exact(2 * all)) {
            out.defects.extend(kept.iter().map(|&c| reached[c] - next[c]));
        }
        let last = &whole[2 * all * count.checked_sub(1)?..];
        let mut accelerations = vec![0.0; all];
        if !exogenous.acceleration(points - 1, last, field, &mut accelerations) {
            return None;
        }
        out.keep_point(points - 1, last, &accelerations);
        out.slopes.iter().chain(&out.defects).all(|x| x.is_finite()).then_some(out)
    }

    /// Coordinates, rates and accelerations of a whole state at a point.
    fn keep_point(&mut self, point: usize, state: &[f64], accelerations: &[f64]) {
        let all = state.len() / 2;
        let n = self.size - all;
        let to = &mut self.points[2 * n * point..2 * n * (point + 1)];
        to[..n].copy_from_slice(&state[..n]);
        to[n..].copy_from_slice(&state[all..all + n]);
        self.accelerations[n * point..n * (point + 1)].copy_from_slice(&accelerations[..n]);
    }

    /// Carries states from their points to the next ones, and keeps both points and slopes, of the
    /// latter some rows and columns.
    fn step(
        &mut self,
        states: &mut [f64],
        steps: &mut Steps,
        exogenous: &WindowInputs<'_>,
        field: VectorField<'_>,
        kept: &[usize],
        point: impl Fn(usize) -> usize,
    ) -> Option<()> {
        let m = 2 * field.motion.degrees_of_freedom();
        let at = |t: f64, out: &mut [f64]| crate::model::integrate::Outside::inputs(exogenous.between, t, out);
        let outside = abreast::Outside { omega: exogenous.omega, inputs: exogenous.between.count(), at: &at };
        steps.set(states.chunks_exact(m));
        let of = |i: usize| (exogenous.time(point(i)), exogenous.tau(point(i)));
        steps.carry(field, of, &outside, self.spacing);
        let mut accelerations = vec![0.0; m / 2];
        for (i, state) in states.chunks_exact_mut(m).enumerate() {
            if !steps.exists[i] {
                return None;
            }
            let p = point(i);
            accelerations.iter_mut().enumerate().for_each(|(c, x)| *x = steps.acceleration(c, i));
            self.keep_point(p, state, &accelerations);
            state.iter_mut().enumerate().for_each(|(c, x)| *x = steps.value(c, i));
            let slopes = &mut self.slopes[self.size * self.size * p..self.size * self.size * (p + 1)];
            for (row, &r) in slopes.chunks_exact_mut(self.size).zip(kept) {
                row.iter_mut().zip(kept).for_each(|(x, &c)| *x = steps.value(m + r * m + c, i));
            }
        }
        Some(())
    }

    /// Sums over a range of samples, between which the columns' accelerations are `alpha`, and what
    /// deviations there make of the state at its end. Columns are carried along in strips that stay in
    /// the cache.
    pub(super) fn segment(
        &self,
        states: &[f64],
        alpha: &[f64],
        layout: &Arc<Layout>,
        measured: &Measured<'_>,
        samples: Range<usize>,
    ) -> Segment {
        let (columns, sensors) = (layout.columns, measured.shown.len());
        let (m, d) = (2 * measured.shown.first().map_or(0, Vec::len), self.size);
        let count = states.len() / m;
        let along = Along { alpha, columns, measured, samples: samples.clone(), last: count - 1 };
        let mut sums = Sums::zeros(layout, d);
        let own = Strip { lead: d, columns: 0..layout.own, trail: 1 };
        let rows = samples.len() * sensors;
        let (head, ends) = self.head(states, &own, &along);
        sums.push_head(&head);
        let mut z = vec![0.0; d * (d + columns + 1)];
        own.place(&ends, &mut z, d + columns + 1);
        for columns in layout.strips(STRIP) {
            let strip = Strip { lead: 0, columns, trail: 0 };
            let from = strip.columns.start;
            let ends = self.carried(&strip, &along, |row, some| {
                sums.push(&head.columns(row, some.ncols()), from, some);
            });
            strip.place(&ends, &mut z, d + layout.columns + 1);
        }
        let mut map = DMatrix::from_row_slice(d, d + columns + 1, &z);
        map.column_mut(d + columns).neg_mut();
        Segment { normal: Normal::new(sums, rows, d - m), map }
    }

    /// Rows of a strip that begins with the first state and ends with the target: what the model
    /// shows less than was measured, and what defects add up to. Also what they make of the state at
    /// the end.
    pub(super) fn head(&self, states: &[f64], own: &Strip, along: &Along<'_>) -> (DMatrix<f64>, Vec<f64>) {
        let Along { measured, samples, .. } = along;
        let (m, sensors) = (2 * measured.shown.first().map_or(0, Vec::len), measured.shown.len());
        let mut head = DMatrix::zeros(own.width(), samples.len() * sensors);
        let ends = self.carried(own, along, |row, some| head.columns_mut(row, some.ncols()).copy_from(some));
        for (row, mut of) in head.column_iter_mut().enumerate() {
            let (k, s) = (samples.start + row / sensors, row % sensors);
            let predicted: f64 = measured.shown[s].iter().zip(&states[m * k..]).map(|(w, q)| w * q).sum();
            let target = &mut of[own.width() - 1];
            *target = (measured.values[k * sensors + s] - predicted) / measured.sigma[s] - *target;
        }
        (head, ends)
    }

    /// The path moved by an initial step and a step of the columns; also the greatest rms movement
    /// of a sensor's reading in units of its noise.
    pub fn moved(
        &self,
        states: &[f64],
        alpha: &[f64],
        start: &DVector<f64>,
        step: &DVector<f64>,
        measured: &Measured<'_>,
    ) -> (Vec<f64>, f64) {
        let n = measured.shown.first().map_or(0, Vec::len);
        let (m, d) = (2 * n, self.size);
        let columns = step.len();
        let count = states.len() / m;
        let mut delta: Vec<f64> = start.iter().copied().collect();
        let mut out = states.to_vec();
        let mut squares = vec![0.0; measured.shown.len()];
        let force = |k: usize| -> Vec<f64> {
            (0..n)
                .map(|i| {
                    let row = &alpha[(k * n + i) * columns..(k * n + i + 1) * columns];
                    row.iter().zip(step.iter()).map(|(a, p)| a * p).sum()
                })
                .collect()
        };
        let mut here = force(0);
        for k in 0..count {
            out[m * k..m * (k + 1)].iter_mut().zip(&delta).for_each(|(x, d)| *x += d);
            for (s, weights) in measured.shown.iter().enumerate() {
                let moved: f64 = weights.iter().zip(&delta).map(|(w, d)| w * d).sum();
                squares[s] += (moved / measured.sigma[s]).powi(2);
            }
            if k + 1 == count {
                break;
            }
            for point in k * self.each..(k + 1) * self.each {
                let there = force(point + 1);
                let a = &self.slopes[d * d * point..];
                let half = 0.5 * self.spacing;
                delta[n..m].iter_mut().zip(&here).for_each(|(x, f)| *x += half * f);
                let mut next: Vec<f64> = (0..d).map(|i| (0..d).map(|j| a[i * d + j] * delta[j]).sum()).collect();
                next[n..m].iter_mut().zip(&there).for_each(|(x, f)| *x += half * f);
                (delta, here) = (next, there);
            }
            delta.iter_mut().zip(&self.defects[d * k..]).for_each(|(d, e)| *d += e);
        }
        let greatest = squares.iter().map(|s| (s / count.max(1) as f64).sqrt()).fold(0.0, f64::max);
        (out, greatest)
    }
}

#[cfg(test)]
#[path = "linear_tests.rs"]
mod tests;
