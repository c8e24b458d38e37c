//! Shooting linearised about a path: a window's normal equations over all columns, its initial
//! state eliminated.
//!
//! With states x_k of the path, the model's flow over one sample F, its slope A_k and the defects
//! e_k = F(x_k) − x_{k+1}, the deviation δ of a solution of the model from the path obeys δ_{k+1} =
//! A_k δ_k + e_k + U_k δp, U_k what a column's accelerations α do over a sample: Δ²(2α_k +
//! α_{k+1})/6 for coordinates, Δ(α_k + α_{k+1})/2 for rates (over several points to a sample where
//! samples are few). Sensors show S(q + δ_q) + Σ ε s(q): linear in δ_0, parameters, strengths and
//! sensor laws alike. No solution has to be found first, and what is far from one still has its
//! columns.

use core::ops::{AddAssign, Range};
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::gram::{Gram, Layout, Sums};
use super::window_inputs::WindowInputs;
use crate::model::dynamics::Dynamics;
use crate::model::flow::abreast::{self, ABREAST, Steps, VectorField};
use crate::model::vectors::combine;

/// Rows whose products are summed at once.
const CHUNK: usize = 256;

/// The model's flow about a window's path.
pub struct Linear {
    /// The path at every point: the samples' states, the model's own motion between them.
    pub points: Vec<f64>,
    /// Accelerations there, n for each.
    pub accelerations: Vec<f64>,
    /// A_k, 2n × 2n row after row, for each point but the last.
    slopes: Vec<f64>,
    /// e_k, 2n for each sample but the last.
    defects: Vec<f64>,
    /// Points to a sample.
    each: usize,
    /// Time between points, s.
    spacing: f64,
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

/// Normal equations of a window.
pub struct Normal {
    /// Sums of products of the initial state, the columns and the target, all rows in units of the
    /// noise.
    sums: Sums,
    /// Rows.
    pub rows: usize,
}

impl Linear {
    /// None where the model has no solution somewhere.
    pub fn new(states: &[f64], exogenous: &WindowInputs<'_>, field: VectorField<'_>) -> Option<Self> {
        let m = 2 * field.motion.degrees_of_freedom();
        let (each, spacing) = (exogenous.points, exogenous.spacing());
        let count = states.len() / m;
        let points = count.saturating_sub(1) * each + 1;
        let mut out = Self {
            points: Vec::with_capacity(m * points),
            accelerations: vec![0.0; m / 2 * points],
            slopes: Vec::new(),
            defects: Vec::with_capacity(m * count),
            each,
            spacing,
        };
        out.points.resize(m * points.saturating_sub(1), 0.0);
        out.slopes.resize(m * m * points.saturating_sub(1), 0.0);
        let mut steps = Steps::new(field.motion);
        let mut here = states[..m * count.saturating_sub(1)].to_vec();
        for j in 0..each {
            for (block, states) in here.chunks_mut(m * ABREAST).enumerate() {
                let point = |i: usize| (block * ABREAST + i) * each + j;
                out.step(states, &mut steps, exogenous, field, point)?;
            }
        }
        out.defects.extend(here.iter().zip(&states[m..]).map(|(a, b)| a - b));
        let last = &states[m * count.checked_sub(1)?..];
        out.points.extend_from_slice(last);
        let to = &mut out.accelerations[m / 2 * (points - 1)..];
        if !exogenous.acceleration(points - 1, last, field, to) {
            return None;
        }
        out.slopes.iter().chain(&out.defects).all(|x| x.is_finite()).then_some(out)
    }

    /// Carries states from their points to the next ones, and keeps both points and slopes.
    fn step(
        &mut self,
        states: &mut [f64],
        steps: &mut Steps,
        exogenous: &WindowInputs<'_>,
        field: VectorField<'_>,
        point: impl Fn(usize) -> usize,
    ) -> Option<()> {
        let m = 2 * field.motion.degrees_of_freedom();
        let at = |t: f64, out: &mut [f64]| crate::model::integrate::Outside::inputs(exogenous.between, t, out);
        let outside = abreast::Outside { omega: exogenous.omega, inputs: exogenous.between.count(), at: &at };
        steps.set(states.chunks_exact(m));
        let of = |i: usize| (exogenous.time(point(i)), exogenous.tau(point(i)));
        steps.carry(field, of, &outside, self.spacing);
        for (i, state) in states.chunks_exact_mut(m).enumerate() {
            if !steps.exists[i] {
                return None;
            }
            let p = point(i);
            self.points[m * p..m * (p + 1)].copy_from_slice(state);
            let slopes = &mut self.slopes[m * m * p..m * m * (p + 1)];
            let accelerations = &mut self.accelerations[m / 2 * p..m / 2 * (p + 1)];
            accelerations.iter_mut().enumerate().for_each(|(c, x)| *x = steps.acceleration(c, i));
            state.iter_mut().enumerate().for_each(|(c, x)| *x = steps.value(c, i));
            slopes.iter_mut().enumerate().for_each(|(c, x)| *x = steps.value(m + c, i));
        }
        Some(())
    }

    /// Weights of the accelerations at both ends of a step in the state's row `i`.
    fn weights(&self, i: usize, n: usize) -> (f64, f64) {
        let spacing = self.spacing;
        if i < n { (spacing * spacing / 3.0, spacing * spacing / 6.0) } else { (0.5 * spacing, 0.5 * spacing) }
    }

    /// The normal equations of a window over columns whose accelerations from one point to another
    /// `alpha` gives (see [`super::forcing::Driven::between`]), and those of its segments of
    /// `segment` samples, each with an initial state of its own. None where `alpha` has none.
    pub fn normal(
        &self,
        states: &[f64],
        mut alpha: impl FnMut(Range<usize>, &mut Vec<f64>) -> Option<()>,
        layout: &Arc<Layout>,
        measured: &Measured<'_>,
        segment: usize,
    ) -> Option<(Normal, Vec<Normal>)> {
        let m = 2 * measured.shown.first().map_or(0, Vec::len);
        let (count, width) = (states.len() / m, m + layout.columns + 1);
        let mut whole = Normal { sums: Sums::zeros(layout, m), rows: 0 };
        let mut parts = Vec::new();
        let mut accelerations = Vec::new();
        // The segment's first state by the window's, the columns, and what defects add up to.
        let mut map = DMatrix::identity(m, width);
        for first in (0..count).step_by(segment) {
            let end = (first + segment).min(count);
            alpha(first * self.each..end.min(count - 1) * self.each + 1, &mut accelerations)?;
            let (part, z) = self.segment(states, &accelerations, layout, measured, first..end);
            part.sums.carried(&map, &mut whole.sums);
            whole.rows += part.rows;
            if end - first == segment {
                parts.push(part);
            }
            if end < count {
                let z = DMatrix::from_row_slice(m, width, &z);
                let mut next = z.columns(0, m) * &map;
                next.columns_mut(m, layout.columns).add_assign(&z.columns(m, layout.columns));
                next.column_mut(width - 1).axpy(-1.0, &z.column(width - 1), 1.0);
                map = next;
            }
        }
        Some((whole, parts))
    }

    /// Sums over a range of samples, between which the columns' accelerations are `alpha`, and what
    /// deviations there make of the state at its end: m rows by the first state, the columns, and
    /// the defects.
    fn segment(
        &self,
        states: &[f64],
        alpha: &[f64],
        layout: &Arc<Layout>,
        measured: &Measured<'_>,
        samples: Range<usize>,
    ) -> (Normal, Vec<f64>) {
        let columns = layout.columns;
        let sensors = measured.shown.len();
        let n = measured.shown.first().map_or(0, Vec::len);
        let m = 2 * n;
        let width = m + columns + 1;
        let last = states.len() / m - 1;
        let mut z = vec![0.0; m * width];
        (0..m).for_each(|i| z[i * width + i] = 1.0);
        let mut next = z.clone();
        let mut sums = Sums::zeros(layout, m);
        let mut chunk = DMatrix::zeros(width, CHUNK.min(samples.len() * sensors));
        let mut filled = 0;
        for k in samples.clone() {
            let mut terms: Vec<(f64, &[f64])> = Vec::with_capacity(m);
            for s in 0..sensors {
                let mut column = chunk.column_mut(filled);
                let row = column.as_mut_slice();
                let scale = 1.0 / measured.sigma[s];
                terms.clear();
                let weights = measured.shown[s].iter().zip(z.chunks_exact(width)).filter(|w| *w.0 != 0.0);
                terms.extend(weights.map(|(w, z)| (w * scale, z)));
                combine(row, &terms);
                let predicted: f64 = measured.shown[s].iter().zip(&states[m * k..]).map(|(w, q)| w * q).sum();
                // The last column of z is what the defects add up to.
                row[width - 1] = scale * (measured.values[k * sensors + s] - predicted) - row[width - 1];
                for (c, _, law) in measured.laws.iter().filter(|l| l.1 == s) {
                    row[m + c] += scale * law[k];
                }
                filled += 1;
                if filled == chunk.ncols() {
                    sums.push(&chunk);
                    filled = 0;
                }
            }
            if k == last {
                break;
            }
            for point in k * self.each..(k + 1) * self.each {
                let a = &self.slopes[m * m * point..];
                let here = &alpha[(point - samples.start * self.each) * n * columns..][..2 * n * columns];
                let mut terms: Vec<(f64, &[f64])> = Vec::with_capacity(m + 2);
                for (i, to) in next.chunks_exact_mut(width).enumerate() {
                    let by = z.chunks_exact(width).zip(&a[i * m..(i + 1) * m]).filter(|(_, f)| **f != 0.0);
                    let (p, q) = self.weights(i, n);
                    let of = |end: usize| &here[(end * n + i % n) * columns..][..columns];
                    terms.clear();
                    terms.extend(by.clone().map(|(z, f)| (*f, &z[m..m + columns])));
                    terms.extend([(p, of(0)), (q, of(1))]);
                    combine(&mut to[m..m + columns], &terms);
                    for c in (0..m).chain([width - 1]) {
                        to[c] = by.clone().map(|(z, f)| f * z[c]).sum();
                    }
                }
                core::mem::swap(&mut z, &mut next);
            }
            for i in 0..m {
                z[i * width + width - 1] += self.defects[m * k + i];
            }
        }
        if filled > 0 {
            sums.push(&chunk.columns(0, filled).into_owned());
        }
        (Normal { sums, rows: samples.len() * sensors }, z)
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
        let m = 2 * n;
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
                let a = &self.slopes[m * m * point..];
                let mut next: Vec<f64> = (0..m).map(|i| (0..m).map(|j| a[i * m + j] * delta[j]).sum()).collect();
                for (i, x) in next.iter_mut().enumerate() {
                    let (p, q) = self.weights(i, n);
                    *x += p * here[i % n] + q * there[i % n];
                }
                (delta, here) = (next, there);
            }
            delta.iter_mut().zip(&self.defects[m * k..]).for_each(|(d, e)| *d += e);
        }
        let greatest = squares.iter().map(|s| (s / count.max(1) as f64).sqrt()).fold(0.0, f64::max);
        (out, greatest)
    }
}

impl Normal {
    /// The Gram matrix with the initial state eliminated; none where the record does not determine
    /// it.
    pub fn reduced(&self) -> Option<Gram> {
        self.sums.reduced()
    }

    /// The initial step that goes with a step of the first columns.
    pub fn start(&self, step: &DVector<f64>) -> Option<DVector<f64>> {
        let (square, coupling) = self.sums.of_first();
        let right = coupling.column(coupling.ncols() - 1) - coupling.columns(0, step.len()) * step;
        Some(square.cholesky()?.solve(&right))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::forcing::{Additions, Forcing};
    use super::*;
    use crate::explain::ranking::solve;
    use crate::identify::stretches::Stretch;
    use crate::identify::track;
    use crate::model::flow::{Flow, Work};
    use crate::model::model_file::ModelFile;
    use crate::model::model_file::equations_of_motion::EquationsOfMotion;
    use crate::model::model_file::tape::Registers;
    use crate::signal::angles::Phase;

    const TEXT: &str = "name = \"m\"\ncoordinates = [{ name = \"x\", space = \"R\" }]\n\
        [[equation]]\nbalance = \"-x''\"\nterms = { c = \"x'\", d = \"sign(x')\", k = \"x\", k3 = \"x^3\" }\n";
    const STEP_S: f64 = 0.02;
    const COUNT: usize = 400;

    fn solution(motion: &EquationsOfMotion, p: &[f64], start: [f64; 2]) -> Vec<f64> {
        let outside = crate::model::flow::Outside::drive(0.0, 0.0, 0.0);
        let flow = Flow::new(motion, p, outside, STEP_S / 4.0);
        let mut work = Work::plain(motion);
        work.set(&start);
        let mut out = start.to_vec();
        for k in 1..COUNT {
            assert!(flow.carry(&mut work, (k - 1) as f64 * STEP_S, STEP_S));
            out.extend_from_slice(work.state());
        }
        out
    }

    /// A record of slightly other coefficients from a slightly other state: one linearised step
    /// about the model's own motion finds both, to second order in how far they are off; and about
    /// a path that is no solution of the model at all, once it has been moved.
    #[test]
    fn one_step_finds_what_the_record_was_made_with() {
        let model = ModelFile::parse(TEXT, Path::new("m.toml")).unwrap();
        let motion = EquationsOfMotion::new(&model, 1.0).unwrap();
        let (p, off) = ([0.1, 0.05, 4.0, 2.0], [1e-5, 2e-5, -3e-5, 4e-5]);
        let truth: Vec<f64> = p.iter().zip(off).map(|(a, b)| a + b).collect();
        let seen = solution(&motion, &truth, [1.0 + 1e-5, -0.2]);
        let stretch = Stretch {
            start_s: 0.0,
            step_s: STEP_S,
            coordinates: vec![seen.iter().step_by(2).copied().collect()],
            inputs: Vec::new(),
            phase: Phase::Clock(0.0),
            amplitude_nm: None,
            history: None,
            base: None,
        };
        let between = track::ExogenousInputs::new(&stretch, 0.0);
        let terms: Additions = model.equations[0].terms.iter().enumerate().map(|(k, t)| (k, 0, t.of.clone())).collect();
        let forcing = Forcing::new(&model, 1.0, &p, &[], 4, &terms);
        let measured =
            Measured { values: stretch.coordinates[0].clone(), shown: &[vec![1.0]], sigma: &[1e-6], laws: Vec::new() };
        let exogenous = WindowInputs { stretch: &stretch, between: &between, first: 0, omega: 0.0, points: 1 };
        let own = solution(&motion, &p, [1.0, -0.2]);
        // A path with defects everywhere.
        let bent: Vec<f64> = own.iter().enumerate().map(|(i, x)| x + 1e-3 * (0.7 * i as f64).sin()).collect();
        for (path, passes, segment) in [(own, 1, COUNT), (bent, 3, 33)] {
            let (mut states, mut found) = (path, p.to_vec());
            for _ in 0..passes {
                let linear = Linear::new(&states, &exogenous, VectorField { motion: &motion, parameters: &p }).unwrap();
                let driven = forcing.on(&linear.points, &linear.accelerations, &exogenous);
                let alpha = driven.all().unwrap();
                let mut registers = Registers::default();
                let between = |points, to: &mut Vec<f64>| driven.between(points, &mut registers, to);
                let layout = Layout::new(4, &[]);
                let (normal, parts) = linear.normal(&states, between, &layout, &measured, segment).unwrap();
                assert_eq!(parts.len(), COUNT / segment);
                let step = solve(&normal.reduced().unwrap().chosen(&[0, 1, 2, 3])).unwrap();
                found = step.iter().zip(&p).map(|(s, p)| s + p).collect();
                let start = normal.start(&step).unwrap();
                states = linear.moved(&states, &alpha, &start, &step, &measured).0;
            }
            for k in 0..4 {
                // Columns are integrated by the trapezoidal rule, and reversals fall between
                // samples.
                assert!((found[k] - truth[k]).abs() < 0.03 * off[k].abs(), "{passes} {k}: {found:?} {truth:?}");
            }
        }
    }
}
