//! A record with its rig's equations: what a hypothesis is tried on, and how well the equations
//! fit it then.
//!
//! The misfit is the mean over equations e and test frequencies m of ln(r²/n²): r² the mean square
//! of the weak form's residuals, refitted, n² what the sensors' noise alone adds to them (their
//! parts smoothed, taken as the truth and measured again). It is 0 where the equations leave
//! nothing but noise, does not depend on the scale of a channel or of an equation, and −½N times
//! it is the log-likelihood of N independent rows with unknown variance at each frequency, so that
//! hypotheses compare by differences.

use core::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::hypotheses;
use super::undo::{self, Undo};
use crate::error::Result;
use crate::identify::per_record::Split;
use crate::identify::prepared::{Geometry, prepare_moving};
use crate::identify::regression::{ROW_DEPENDENCE, Solution};
use crate::identify::remeasured::{Sensors, measure, smoothed};
use crate::identify::series::System;
use crate::identify::stretches::Stretch;
use crate::identify::windows::{Plan, Stretches, WindowRows, frequency_of_row, rows_of, rows_planned, samples_needed};
use crate::identify::{Settings, built_in, noise_bias, regression};
use crate::model::model_file::weak_form::WeakForm;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::signal::noise;

/// Least residual that counts, as a share of the equation's right-hand side at that frequency:
/// what smoothing and sums leave of exact equations.
const EXACT: f64 = 1e-4;
/// Rms step of an angle from one sample to the next from which its turns cannot be right, rad.
const SCRAMBLED: f64 = 1.0;

/// Stretches of a record, what is known of their sensors, and the equations.
pub(super) struct Scene {
    /// Unbroken stretches.
    pub stretches: Vec<Stretch>,
    record_of: Vec<usize>,
    /// Noise of the sensors.
    pub sensors: Sensors,
    /// Windows and low-passes.
    pub geometry: Geometry,
    /// The rig, its system written out.
    pub rig: Rig,
    /// What its channels measure.
    pub bound: Arc<ObservedModel>,
    weak: Arc<WeakForm>,
    split: Split,
}

/// How well the equations fit.
#[derive(Clone, Debug)]
pub(super) struct Misfit {
    /// Mean of ln(r²/n²).
    pub log: f64,
    /// Mean of ln r².
    pub residual: f64,
    /// Coefficients, equation by equation.
    pub coefficients: Vec<DVector<f64>>,
    /// Their standard errors, one after the other.
    pub std_errors: Vec<f64>,
    /// What noise alone leaves.
    pub noise: Noise,
}

/// Rows of the weak form, and the equations refitted to them.
pub(super) struct Fitted {
    rows: Vec<WindowRows>,
    solution: Solution,
}

/// Mean square of what the sensors' noise adds to the residuals of each equation, by frequency.
pub(super) type Noise = Vec<Vec<f64>>;

impl Scene {
    /// The records of a rig, none where the rig has no equations of its own (a built-in system
    /// without channels for it).
    ///
    /// # Errors
    /// As an identification.
    pub fn new(records: &[Record], rig: &Rig) -> Result<Self> {
        Self::in_windows(records, rig, &Settings::default())
    }

    /// The same in windows that are asked for.
    ///
    /// # Errors
    /// As an identification.
    pub fn in_windows(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Self> {
        let own = built_in::written(rig)?;
        let bound = own.bound.clone().ok_or_else(|| super::no_equations(rig))?;
        let p = prepare_moving(records, &own, &bound, settings)?;
        let weak = Arc::new(WeakForm::new(&bound.model, rig.omega(), &[])?);
        let split = Split::new(&bound.model, records.len());
        let mut out = Self {
            stretches: p.stretches,
            record_of: p.record_of,
            sensors: p.sensors,
            geometry: p.geometry,
            // Mistakes are told in the rig file's own words.
            rig: Rig { channel: rig.channel.clone(), ..own.into_owned() },
            bound,
            weak,
            split,
        };
        out.noise_of_scrambled();
        Ok(out)
    }

    /// Angles in the wrong unit lose turns that they should not, which looks like noise: theirs is
    /// estimated from what they were before.
    fn noise_of_scrambled(&mut self) {
        let Some(step_s) = self.stretches.first().map(|s| s.step_s) else { return };
        let uncounted: Vec<usize> =
            (0..self.sensors.sigma.len()).filter(|i| self.sensors.count[*i].is_none()).collect();
        for i in uncounted {
            let mut shown: Vec<Vec<f64>> =
                self.stretches.iter().map(|s| s.sensors(&self.bound).swap_remove(i)).collect();
            let steps = shown.iter().flat_map(|x| x.windows(2).map(|w| (w[1] - w[0]).powi(2)));
            let (sum, count) = steps.fold((0.0, 0_usize), |(sum, n), x| (sum + x, n + 1));
            if !hypotheses::is_angle(self, i) || sum < SCRAMBLED * SCRAMBLED * count as f64 {
                continue;
            }
            shown.iter_mut().for_each(|x| undo::unwrap(x, TAU));
            if let Some(noise) = noise::estimate(shown.iter().map(|x| &x[..]), step_s) {
                self.sensors.sigma[i] = noise.sigma;
            }
        }
    }

    /// The first windows alone, and the records that they are of.
    pub fn first(&self, windows: usize) -> Self {
        let step = self.stretches.first().map_or(1.0, |s| s.step_s);
        let Geometry { windows: w, kernels, .. } = &self.geometry;
        let needed = samples_needed(w, kernels, step);
        let hop = w.hop_s / step;
        let (mut left, mut stretches, mut record_of) = (windows, Vec::new(), Vec::new());
        let mut kept: Vec<usize> = Vec::new();
        for (s, record) in self.stretches.iter().zip(&self.record_of) {
            if s.len() < needed || left == 0 {
                continue;
            }
            let here = (1 + ((s.len() - needed) as f64 / hop) as usize).min(left);
            let samples = (needed + ((here - 1) as f64 * hop).ceil() as usize + 1).min(s.len());
            stretches.push(s.part(0, samples));
            if kept.last() != Some(record) {
                kept.push(*record);
            }
            record_of.push(kept.len() - 1);
            left -= here;
        }
        // Of a record without windows nothing could be determined that is its own.
        Self { stretches, record_of, split: Split::new(&self.bound.model, kept.len()), ..self.shallow() }
    }

    /// Everything but the stretches.
    fn shallow(&self) -> Self {
        Self {
            stretches: Vec::new(),
            record_of: self.record_of.clone(),
            sensors: self.sensors.clone(),
            geometry: self.geometry.clone(),
            rig: self.rig.clone(),
            bound: self.bound.clone(),
            weak: self.weak.clone(),
            split: self.split.clone(),
        }
    }

    /// Names of the coefficients, equation by equation.
    pub fn names(&self) -> Vec<String> {
        self.split.names()
    }

    /// Time from the first to the last sample, s.
    pub fn span_s(&self) -> f64 {
        match (self.stretches.first(), self.stretches.last()) {
            (Some(a), Some(b)) => b.time(b.len()) - a.start_s,
            _ => 0.0,
        }
    }

    /// The scene with something undone.
    pub fn with(&self, undo: &Undo) -> Self {
        let start_s = self.stretches.first().map_or(0.0, |s| s.start_s);
        let mut sensors = self.sensors.clone();
        undo.sensors(&mut sensors);
        let stretches = self.stretches.iter().map(|s| undo.stretch(s, &self.bound, start_s)).collect();
        Self { stretches, sensors, ..self.shallow() }
    }

    fn rows(&self) -> Vec<WindowRows> {
        let circle = self.bound.model.circle();
        let system =
            System { stretches: &self.stretches, weak: &self.weak, kernels: &self.geometry.kernels, circle: &circle };
        let mut rows = rows_of(&system, &self.weak.equations, &self.geometry.kernels, &self.geometry.windows);
        self.split.spread(&mut rows, &self.record_of);
        rows
    }

    /// The equations refitted.
    pub fn fitted(&self) -> Option<Fitted> {
        let rows = self.rows();
        let solution = regression::solve(&rows, &self.split.terms(), self.geometry.windows.frequencies).ok()?;
        Some(Fitted { rows, solution })
    }

    /// The equations refitted, and what they leave beside what noise does.
    pub fn misfit(&self) -> Option<Misfit> {
        self.misfit_of(&self.fitted()?, None)
    }

    /// The same beside a noise that was measured before, of something close by.
    pub fn misfit_beside(&self, noise: &Noise) -> Option<Misfit> {
        self.misfit_of(&self.fitted()?, Some(noise))
    }

    /// What equations that were refitted leave beside a noise, or beside that of these sensors.
    pub fn misfit_of(&self, fitted: &Fitted, noise: Option<&Noise>) -> Option<Misfit> {
        let Fitted { rows, solution } = fitted;
        let terms = self.split.terms();
        let frequencies = self.geometry.windows.frequencies;
        let noise = noise.cloned().unwrap_or_else(|| self.noise(&solution.coefficients));
        let (mut sum, mut left) = (0.0, 0.0);
        for (e, x) in solution.coefficients.iter().enumerate() {
            let p = x.len();
            let mut target = vec![0.0; frequencies + 1];
            for window in rows {
                for (r, row) in window.equations[e].chunks_exact(p + 1).enumerate() {
                    target[frequency_of_row(r)] += row[p] * row[p] * if r == 0 { 2.0 } else { 1.0 };
                }
            }
            let mean = target.iter().sum::<f64>() / (2 * rows.len() * (frequencies + 1)) as f64;
            for m in 0..=frequencies {
                let least = EXACT * EXACT * mean;
                let (r2, n2) = (solution.residual_rms[e][m].powi(2), noise[e][m]);
                sum += ((r2 + least) / (n2 + least)).ln();
                left += (r2 + least).ln();
            }
        }
        let count = ((frequencies + 1) * terms.len()) as f64;
        let (log, residual) = (sum / count, left / count);
        let std_errors = solution.covariance.diagonal().iter().map(|v| v.max(0.0).sqrt()).collect();
        let coefficients = solution.coefficients.clone();
        log.is_finite().then_some(Misfit { log, residual, coefficients, std_errors, noise })
    }

    /// Mean square of what the sensors' noise adds to each equation's residuals, by frequency.
    fn noise(&self, coefficients: &[DVector<f64>]) -> Noise {
        let circle = self.bound.model.circle();
        let frequencies = self.geometry.windows.frequencies;
        let system =
            System { stretches: &self.stretches, weak: &self.weak, kernels: &self.geometry.kernels, circle: &circle };
        let mut out = vec![vec![0.0; frequencies + 1]; coefficients.len()];
        if system.count() == 0 {
            return out;
        }
        let (truth, from) = smoothed(&system, &self.geometry.windows);
        let record_of: Vec<usize> = from.iter().map(|&s| self.record_of[s]).collect();
        let plan = Plan::new(&self.geometry.kernels, &self.geometry.windows, system.step_s(0), noise_bias::STRETCH);
        let rows = |stretches: &[Stretch]| {
            let mut rows = rows_planned(&System { stretches, ..system }, &self.weak.equations, &plan);
            self.split.spread(&mut rows, &record_of);
            rows
        };
        let noisy: Vec<Stretch> =
            truth.iter().enumerate().map(|(i, s)| measure(s, i % 4, &self.bound, &self.sensors, i as u64)).collect();
        let (clean, noisy) = (rows(&truth), rows(&noisy));
        for (e, x) in coefficients.iter().enumerate() {
            let p = x.len();
            let residual = |row: &[f64]| row[p] - row.iter().zip(x.iter()).map(|(a, b)| a * b).sum::<f64>();
            let mut sum = vec![0.0; frequencies + 1];
            for (a, b) in clean.iter().zip(&noisy) {
                let pairs = a.equations[e].chunks_exact(p + 1).zip(b.equations[e].chunks_exact(p + 1));
                for (r, (a, b)) in pairs.enumerate() {
                    sum[frequency_of_row(r)] += (residual(b) - residual(a)).powi(2) * if r == 0 { 2.0 } else { 1.0 };
                }
            }
            // Pooled with the neighbours as the residuals' are.
            for m in 0..=frequencies {
                let near = &sum[m.saturating_sub(2)..=(m + 2).min(frequencies)];
                out[e][m] = near.iter().sum::<f64>() / (2 * near.len() * clean.len().max(1)) as f64;
            }
        }
        out
    }

    /// One step of Gauss and Newton for the numbers of an undoing from where it is fitted, the
    /// coefficients refitted beside them: changes and their standard errors.
    pub fn step(&self, undo: &Undo, at: &[f64], small: &[f64], here: &Fitted) -> Option<(Vec<f64>, Vec<f64>)> {
        let Fitted { rows, solution } = here;
        let terms = self.split.terms();
        let moved: Vec<Vec<WindowRows>> = (0..at.len())
            .map(|k| {
                let mut x = at.to_vec();
                x[k] += small[k];
                self.with(&undo.at(&x)).rows()
            })
            .collect();
        let total: usize = terms.iter().sum();
        let n = total + at.len();
        let (mut matrix, mut right) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
        let mut row = vec![0.0; n];
        let mut offset = 0;
        for (e, x) in solution.coefficients.iter().enumerate() {
            let p = x.len();
            let residual = |row: &[f64]| row[p] - row[..p].iter().zip(x.iter()).map(|(a, b)| a * b).sum::<f64>();
            // A lag leaves out samples at the ends, and with them windows, from both alike.
            for (w, window) in rows.iter().enumerate() {
                let Some(others) = moved.iter().map(|m| m.get(w)).collect::<Option<Vec<_>>>() else { continue };
                for (r, own) in window.equations[e].chunks_exact(p + 1).enumerate() {
                    row.iter_mut().for_each(|x| *x = 0.0);
                    row[offset..offset + p].copy_from_slice(&own[..p]);
                    let left = residual(own);
                    for (k, other) in others.iter().enumerate() {
                        let there = residual(&other.equations[e][r * (p + 1)..(r + 1) * (p + 1)]);
                        row[total + k] = (left - there) / small[k];
                    }
                    let weight = solution.weights[e][frequency_of_row(r)];
                    for i in 0..n {
                        if row[i] != 0.0 {
                            for j in 0..n {
                                matrix[(i, j)] += weight * row[i] * row[j];
                            }
                            right[i] += weight * row[i] * left;
                        }
                    }
                }
            }
            offset += p;
        }
        let scale = matrix.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
        let scaled = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
        let inverse = scaled.cholesky()?.inverse();
        let change = (&inverse * right.component_mul(&scale)).component_mul(&scale);
        let error = |k: usize| (inverse[(total + k, total + k)] * ROW_DEPENDENCE).sqrt() * scale[total + k];
        let out: Vec<f64> = (0..at.len()).map(|k| change[total + k]).collect();
        out.iter().all(|x| x.is_finite()).then(|| (out, (0..at.len()).map(error).collect()))
    }
}
