//! Largest Lyapunov exponent from a record, by local linear maps (Sano and Sawada 1985; Eckmann,
//! Kamphorst, Ruelle and Ciliberto 1986).
//!
//! Along the record, one step of δ samples is a map of the state z = (s_i(n), s_i(n + δ), …,
//! s_i(n + (m − 1) δ)): all components move up by one and the newest, s_i(n + mδ), is a function
//! g_i of the state (and of the drive's phase). Its gradient at each reference point is the
//! weighted least-squares plane through the k nearest vectors outside the Theiler window. The
//! gradients make the tangent map of each step; a tangent vector carried along and normalised after
//! each step grows by the exponent on average: λ = ⟨ln ‖v′‖/‖v‖⟩/δ.
//!
//! Unlike the divergence of neighbours it needs no neighbours much closer than the size of the
//! attractor: that is what a record of some minutes of a system of four or five dimensions has not.
//! The planes' curvature is its error; the fit is repeated with half as many neighbours, and the
//! difference joins the jackknife's standard error (blocks of time) in squares.
//!
//! A state of more dimensions than the attractor needs has directions in which neighbours lie only
//! as far as the flow is curved; gradients along them are that curvature's, and grow tangent
//! vectors that belong to no motion. [`Settings::in_sheet`] confines the planes to the directions in
//! which the neighbours really spread ([`super::local_sheet`]). Of Lorenz's x and z at two delays
//! each the exponent is 5.4/s without (0.906/s), of two sines of 0.73 and 0.17 to 0.53 Hz at three
//! delays without 0.5 to 0.7/s, and at five with it 0.05 ± 0.04/s or less.
//!
//! Limits: noise in the gradients adds to the exponent; a locked orbit has no neighbours off itself
//! and gives nonsense (`inspect` reports none for it).

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;

use super::embedding::{Component, Embedding};
use super::local_sheet;
use super::neighbours::Tree;
use super::observable::Observable;

/// Blocks of the jackknife.
const BLOCKS: usize = 16;
/// Steps at the start of a block, in which the vector turns into its growing direction, that are
/// not counted.
const SETTLE: usize = 10;
/// Most unknowns of a plane.
const MOST: usize = 24;

/// Choices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// δ, samples.
    pub step: usize,
    /// m, delays of each observable in the state.
    pub delays: usize,
    /// Neighbours a plane is fitted to.
    pub neighbours: usize,
    /// Neighbours in time within so many samples do not count.
    pub theiler: u32,
    /// Whether the planes have slopes in the directions of each neighbourhood's sheet alone.
    pub in_sheet: bool,
    /// Most steps taken.
    pub steps: usize,
    /// Most vectors among which neighbours are looked for.
    pub vectors: usize,
}

/// Exponent by local linear maps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tangent {
    /// Exponent, 1/sample.
    pub exponent: f64,
    /// Its standard error: jackknife and difference of the two fits together.
    pub std_error: f64,
    /// The same with half as many neighbours.
    pub halved: f64,
    /// Steps averaged.
    pub steps: usize,
}

/// The exponent of `observables` (equal stretches), `phase` the drive's phase as an observable.
/// None where the record gives fewer than 100 steps or too few vectors.
pub fn tangent_exponent(
    observables: &[&Observable],
    phase: Option<&Observable>,
    settings: &Settings,
) -> Option<Tangent> {
    let (m, step) = (settings.delays, settings.step);
    let mut components: Vec<Component<'_>> =
        (0..m).flat_map(|j| observables.iter().map(move |of| Component { of, delay: j * step })).collect();
    components.extend(phase.map(|of| Component { of, delay: 0 }));
    let unknowns = components.len() + 1;
    if unknowns > MOST || settings.neighbours < 2 * unknowns || step == 0 {
        return None;
    }
    let e = Embedding::new(components, step, settings.vectors);
    let tree = Tree::new(&e, e.components.len());
    // Reference points: runs of consecutive steps, one to a block, evenly over the record.
    let state = m * observables.len();
    let reach = m * step;
    let runs = runs(observables.first()?, reach, step, settings.steps);
    let map = TangentMap { e: &e, observables, reach, in_sheet: settings.in_sheet, state };
    let blocks: Vec<[(f64, usize); 2]> = runs
        .par_iter()
        .map(|(from, count)| {
            let mut vectors = [start_vector(state); 2];
            let mut sums = [(0.0, 0usize); 2];
            let (mut best, mut stack) = (Vec::new(), Vec::new());
            for i in 0..*count {
                let start = (from + i * step) as u32;
                tree.near(start, settings.theiler, settings.neighbours, &mut best, &mut stack);
                for (half, (v, sum)) in vectors.iter_mut().zip(&mut sums).enumerate() {
                    let near = &best[..(best.len() >> half).max(unknowns.min(best.len()))];
                    let Some(growth) = map.advance(start, near, v) else {
                        continue;
                    };
                    if i >= SETTLE {
                        sum.0 += growth.ln();
                        sum.1 += 1;
                    }
                }
            }
            sums
        })
        .collect();
    let means = |half: usize| {
        let (sum, n) = blocks.iter().fold((0.0, 0), |a, b| (a.0 + b[half].0, a.1 + b[half].1));
        (n >= 100).then(|| (sum / n as f64 / step as f64, n))
    };
    let ((exponent, steps), (halved, _)) = (means(0)?, means(1)?);
    let each: Vec<f64> = blocks.iter().filter(|b| b[0].1 > 0).map(|b| b[0].0 / b[0].1 as f64 / step as f64).collect();
    let n = each.len() as f64;
    let mean = each.iter().sum::<f64>() / n;
    let statistical = if n > 1.0 {
        (each.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt()
    } else {
        mean.abs()
    };
    Some(Tangent { exponent, std_error: statistical.hypot(exponent - halved), halved, steps })
}

/// Runs of reference points: first sample and number of steps; about [`BLOCKS`] of them over all
/// stretches.
fn runs(of: &Observable, reach: usize, step: usize, most: usize) -> Vec<(usize, usize)> {
    let room = |len: usize| (len.saturating_sub(reach + 1)) / step;
    let all: usize = of.stretches.iter().map(|r| room(r.len())).sum();
    let size = (all / BLOCKS).max(3 * SETTLE);
    let used = (most / BLOCKS).max(3 * SETTLE).min(size);
    let mut out = Vec::new();
    for r in &of.stretches {
        let mut at = 0;
        while at + used <= room(r.len()) {
            out.push((r.start + at * step, used));
            at += size;
        }
    }
    out
}

/// A direction without symmetry.
fn start_vector(n: usize) -> [f64; MOST] {
    let mut v = [0.0; MOST];
    v.iter_mut().take(n).enumerate().for_each(|(i, v)| *v = 1.0 / (1.0 + i as f64));
    v
}

/// Signed difference on the circle or on the line.
fn signed(a: f32, b: f32, period: f32) -> f64 {
    let d = a - b;
    f64::from(if period.is_finite() { d - d.round() } else { d })
}

/// The local linear maps of one step.
struct TangentMap<'a> {
    e: &'a Embedding<'a>,
    observables: &'a [&'a Observable],
    /// Samples from the oldest value of a vector to the one that is predicted.
    reach: usize,
    /// Whether gradients lie in the neighbours' sheet.
    in_sheet: bool,
    /// Length of a tangent vector.
    state: usize,
}

impl TangentMap<'_> {
    /// Fits the planes at `start` and carries `v` one step on; returns its growth.
    fn advance(&self, start: u32, near: &[(f32, u32)], v: &mut [f64; MOST]) -> Option<f64> {
        let Self { observables, in_sheet, state, .. } = *self;
        let right = if in_sheet { self.in_sheet(start, near)? } else { self.in_all_directions(start, near)? };
        let n = observables.len();
        let mut next = [0.0; MOST];
        next[..state - n].copy_from_slice(&v[n..state]);
        for o in 0..n {
            next[state - n + o] = (0..state).map(|j| right[o][j + 1] * v[j]).sum();
        }
        let norm = |v: &[f64; MOST]| v[..state].iter().map(|x| x * x).sum::<f64>().sqrt();
        let growth = norm(&next) / norm(v);
        if !(growth.is_finite() && growth > 1e-12) {
            *v = start_vector(state);
            return None;
        }
        let size = norm(&next);
        *v = next.map(|x| x / size);
        Some(growth)
    }

    /// A one and the differences of a neighbour's components; returns its weight, tricube-like: the
    /// nearest count most, the farthest nothing.
    fn row(&self, start: u32, near: &[(f32, u32)], k: usize, row: &mut [f64; MOST]) -> f64 {
        let (d2, other) = near[k];
        row[0] = 1.0;
        for (j, c) in self.e.components.iter().enumerate() {
            row[j + 1] = signed(self.e.at(other, j), self.e.at(start, j), c.of.period);
        }
        let widest = near.last().map_or(0.0, |n| f64::from(n.0)).max(1e-18) * 1.0001;
        (1.0 - f64::from(d2) / widest).powi(2)
    }

    /// How an observable differs between two points one step on.
    fn change(&self, of: &Observable, start: u32, other: u32) -> f64 {
        signed(of.values[other as usize + self.reach], of.values[start as usize + self.reach], of.period)
    }

    /// Constants and slopes of every observable's plane, in the directions of the sheet.
    fn in_sheet(&self, start: u32, near: &[(f32, u32)]) -> Option<Vec<[f64; MOST]>> {
        let (components, n) = (self.e.components.len(), self.observables.len());
        let (mut rows, mut weights) = (DMatrix::zeros(near.len(), components), DVector::zeros(near.len()));
        let mut row = [0.0; MOST];
        for k in 0..near.len() {
            weights[k] = self.row(start, near, k, &mut row);
            (0..components).for_each(|j| rows[(k, j)] = row[j + 1]);
        }
        let targets = DMatrix::from_fn(near.len(), n, |k, o| self.change(self.observables[o], start, near[k].1));
        let slopes = local_sheet::slopes(&rows, &weights, &targets)?;
        let of =
            |o: usize| core::array::from_fn(|j| if (1..=components).contains(&j) { slopes[(j - 1, o)] } else { 0.0 });
        Some((0..n).map(of).collect())
    }

    /// The same in all directions.
    fn in_all_directions(&self, start: u32, near: &[(f32, u32)]) -> Option<Vec<[f64; MOST]>> {
        let unknowns = self.e.components.len() + 1;
        let mut normal = [[0.0f64; MOST]; MOST];
        let mut right = vec![[0.0f64; MOST]; self.observables.len()];
        let mut row = [0.0f64; MOST];
        for k in 0..near.len() {
            let weight = self.row(start, near, k, &mut row);
            for a in 0..unknowns {
                for b in 0..=a {
                    normal[a][b] += weight * row[a] * row[b];
                }
            }
            for (r, of) in right.iter_mut().zip(self.observables) {
                let change = self.change(of, start, near[k].1);
                (0..unknowns).for_each(|a| r[a] += weight * row[a] * change);
            }
        }
        // A little of the diagonal: directions that no neighbour shows have gradient zero.
        for a in 0..unknowns {
            normal[a][a] *= 1.0 + 1e-6;
            normal[a][a] += 1e-14;
        }
        cholesky(&mut normal, unknowns)?;
        right.iter_mut().for_each(|r| solve(&normal, r, unknowns));
        Some(right)
    }
}

/// Lower triangular factor in place; none where the matrix is not positive.
fn cholesky(a: &mut [[f64; MOST]; MOST], n: usize) -> Option<()> {
    for j in 0..n {
        for k in 0..j {
            let f = a[j][k];
            for i in j..n {
                a[i][j] -= a[i][k] * f;
            }
        }
        if a[j][j].is_nan() || a[j][j] <= 0.0 {
            return None;
        }
        let root = a[j][j].sqrt();
        for i in j..n {
            a[i][j] /= root;
        }
    }
    Some(())
}

fn solve(l: &[[f64; MOST]; MOST], b: &mut [f64; MOST], n: usize) {
    for i in 0..n {
        b[i] = (b[i] - (0..i).map(|k| l[i][k] * b[k]).sum::<f64>()) / l[i][i];
    }
    for i in (0..n).rev() {
        b[i] = (b[i] - (i + 1..n).map(|k| l[k][i] * b[k]).sum::<f64>()) / l[i][i];
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_series::{henon, lorenz};
    use super::*;

    #[test]
    fn henon_0_419_a_step() {
        let x = henon(4000);
        let o = Observable::number(&[&x[100..]], 0.0, 0);
        let s =
            Settings { step: 1, delays: 2, neighbours: 16, theiler: 5, in_sheet: false, steps: 4000, vectors: 10_000 };
        let found = tangent_exponent(&[&o], None, &s).unwrap();
        assert!((found.exponent - 0.419).abs() < 0.012 && found.std_error < 0.02, "{found:?}");
    }

    #[test]
    fn lorenz_0_906_a_second() {
        let [x, ..] = lorenz(30_000, 1);
        let o = Observable::number(&[&x[1..]], 0.0, 0);
        let s = Settings {
            step: 10,
            delays: 3,
            neighbours: 24,
            theiler: 100,
            in_sheet: false,
            steps: 3000,
            vectors: 30_000,
        };
        let found = tangent_exponent(&[&o], None, &s).unwrap();
        let rate = found.exponent / 0.01;
        assert!((rate - 0.906).abs() < 0.07 && found.std_error / 0.01 < 0.1, "{rate} {found:?}");
    }

    #[test]
    fn more_coordinates_than_the_attractor_has_dimensions_do_not_raise_the_exponent() {
        let [x, y, z] = lorenz(30_000, 1);
        let [x, y, z] = [&x[1..], &y[1..], &z[1..]].map(|s| Observable::number(&[s], 0.0, 0));
        for (o, delays) in [(vec![&x, &z], 2), (vec![&x, &y, &z], 2), (vec![&x, &y, &z], 1)] {
            let of = |in_sheet: bool| {
                let unknowns = delays * o.len() + 1;
                let s = Settings {
                    step: 8,
                    delays,
                    neighbours: 8 * unknowns,
                    theiler: 100,
                    in_sheet,
                    steps: 3000,
                    vectors: 30_000,
                };
                let found = tangent_exponent(&o, None, &s).unwrap();
                (found.exponent / 0.01, found.std_error / 0.01)
            };
            let (rate, error) = of(true);
            assert!((rate - 0.906).abs() < 0.12 && error < 0.12, "{} at {delays}: {rate} ± {error}", o.len());
            // Without it the spurious directions win where there are some.
            assert!(delays == 1 || of(false).0 > 1.3, "{} at {delays}: {:?}", o.len(), of(false));
        }
    }

    #[test]
    fn a_rotation_has_none_and_a_short_record_no_answer() {
        // Two sines fill a torus in four dimensions, and their map is linear there.
        let x: Vec<f64> = (0..9000).map(|i| (f64::from(i) * 0.1).sin() + 0.6 * (f64::from(i) * 0.0618).cos()).collect();
        let o = Observable::number(&[&x], 0.0, 0);
        let s = Settings {
            step: 10,
            delays: 4,
            neighbours: 30,
            theiler: 130,
            in_sheet: false,
            steps: 3000,
            vectors: 30_000,
        };
        let found = tangent_exponent(&[&o], None, &s).unwrap();
        assert!(found.exponent.abs() < 3e-3, "{found:?}");
        // Five delays, in which the torus is a sheet bent into three directions.
        let five = Settings { delays: 5, neighbours: 48, in_sheet: true, ..s };
        let found = tangent_exponent(&[&o], None, &five).unwrap();
        assert!(found.exponent.abs() < 3e-3, "{found:?}");
        assert!(tangent_exponent(&[&Observable::number(&[&x[..300]], 0.0, 0)], None, &s).is_none());
        assert!(tangent_exponent(&[], None, &s).is_none());
    }
}
