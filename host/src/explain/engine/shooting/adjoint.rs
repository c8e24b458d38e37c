//! How what is left of a window pulls on the force at every instant: the transpose of what columns
//! do.
//!
//! With r what is left of the readings and y = S α what accelerations α make of them over a window,
//! S linear, the product of both is rᵀ S α = (Sᵀ r)ᵀ α. Sᵀ r is carried once, backwards, whatever
//! the forces are that it is held against: products of hundreds of columns with r cost one
//! column's way.

use rayon::prelude::*;

use super::super::candidates::Candidate;
use super::Ground;
use super::course::List;
use super::linear::{Linear, Measured};
use super::present;

/// What columns have in common with what is left of a window, instant for instant.
pub struct Pulled {
    /// The stretch.
    pub stretch: usize,
    /// Its sample at which the window begins.
    pub first: usize,
    /// By column, at every point: its sum is the column's product with what is left, in units of the
    /// noise.
    pub products: Vec<Vec<f64>>,
}

impl Linear {
    /// Sᵀ r at every point, n numbers each: the transpose of [`Linear::carried`] for what is left of
    /// each sensor's readings, in units of its noise.
    fn pulled(&self, left: &[Vec<f64>], measured: &Measured<'_>) -> Vec<f64> {
        let n = measured.shown.first().map_or(0, Vec::len);
        let (d, count) = (self.size, left.first().map_or(0, Vec::len));
        let half = 0.5 * self.spacing;
        let mut out = vec![0.0; n * (count.saturating_sub(1) * self.each + 1)];
        let (mut costate, mut before) = (vec![0.0; d], vec![0.0; d]);
        for k in (0..count).rev() {
            for (s, weights) in measured.shown.iter().enumerate() {
                let r = left[s][k] / measured.sigma[s];
                for (i, w) in weights.iter().enumerate() {
                    costate[i] += w * r;
                    out[n * k * self.each + i] += w * r * self.spacing * self.spacing / 12.0;
                }
            }
            if k == 0 {
                break;
            }
            for point in ((k - 1) * self.each..k * self.each).rev() {
                (0..n).for_each(|i| out[n * (point + 1) + i] += half * costate[n + i]);
                let slopes = &self.slopes[d * d * point..d * d * (point + 1)];
                before.fill(0.0);
                for (row, x) in slopes.chunks_exact(d).zip(&costate) {
                    before.iter_mut().zip(row).for_each(|(to, a)| *to += a * x);
                }
                core::mem::swap(&mut costate, &mut before);
                (0..n).for_each(|i| out[n * point + i] += half * costate[n + i]);
            }
        }
        out
    }

    /// What is left of each sensor's readings by a path that has settled, in units of its noise.
    fn left(states: &[f64], measured: &Measured<'_>) -> Vec<Vec<f64>> {
        let m = 2 * measured.shown.first().map_or(0, Vec::len);
        let sensors = measured.shown.len();
        let of = |s: usize, k: usize, state: &[f64]| {
            let predicted: f64 = measured.shown[s].iter().zip(state).map(|(w, q)| w * q).sum();
            (measured.values[k * sensors + s] - predicted) / measured.sigma[s]
        };
        (0..sensors).map(|s| states.chunks_exact(m).enumerate().map(|(k, x)| of(s, k, x)).collect()).collect()
    }

    /// Products of columns from `from` on, whose accelerations are `alpha` (n rows of all columns at
    /// each point), with what is left by a path that has settled.
    pub(super) fn products(
        &self,
        states: &[f64],
        alpha: &[f64],
        from: usize,
        columns: usize,
        measured: &Measured<'_>,
    ) -> Vec<Vec<f64>> {
        let n = measured.shown.first().map_or(0, Vec::len);
        let pulled = self.pulled(&Self::left(states, measured), measured);
        let of = |c: usize| {
            let at = |(k, pull): (usize, &[f64])| -> f64 {
                pull.iter().enumerate().map(|(i, p)| p * alpha[(k * n + i) * columns + c]).sum()
            };
            pulled.chunks_exact(n).enumerate().map(at).collect()
        };
        (from..columns).map(of).collect()
    }
}

impl Ground<'_> {
    /// Of candidates' columns, about the settled paths; none where they have no value.
    pub fn pulled(&self, further: &[&Candidate]) -> Option<Vec<Pulled>> {
        let Self { course, paths, windows, linear } = self;
        let list = List { x: present(course.state), further, behind: &[], together: false };
        let own = list.x.len();
        let columns = own + further.iter().map(|c| c.strengths()).sum::<usize>();
        let forced = course.forced(paths, windows, linear, &list)?;
        let of = |((w, linear), alpha): ((&super::Window, &Option<Linear>), Option<Vec<f64>>)| {
            let (linear, alpha) = (linear.as_ref()?, alpha?);
            let path = &paths[w.stretch];
            let states = path.of(w, course.setting.circle.len());
            let measured = course.measured(path, w, states, &list);
            let products = linear.products(states, &alpha, own, columns, &measured);
            // Together what finer steps have, so that all windows have as many points to a sample.
            let by = path.fineness(w);
            let together = |p: Vec<f64>| -> Vec<f64> { p.chunks(by).map(|some| some.iter().sum()).collect() };
            let products = products.into_iter().map(together).collect();
            Some(Pulled { stretch: w.stretch, first: path.first + w.first, products })
        };
        Some(windows.par_iter().zip(linear).zip(forced).filter_map(of).collect())
    }
}
