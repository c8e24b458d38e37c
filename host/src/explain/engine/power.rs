//! What is left in the rows against what the sensors' noise alone leaves, and whether an effect is
//! one of the sensors' alone.
//!
//! The smoothed record is measured again by the same sensors with their grids shifted.
//!
//! Few counts and the low-pass bend the columns of a law that jumps; the longer the record, the
//! surer is the strength that this feigns. So the model without the effect is integrated over
//! stretches like the record's, from its states at their starts, measured by the same sensors and
//! analysed in the same way, the effect's columns among the others: a parametric bootstrap of the
//! null hypothesis (Davison and Hinkley 1997, section 4.2). With s the strengths found, Σ their
//! covariance and δ the mean over R repeats whose grids are shifted, as in
//! [`crate::identify::noise_bias`], the effect stands where
//!
//! (s − δ)ᵀ Σ⁻¹ (s − δ) / (1 + c/R) > 9   or   δᵀ Σ⁻¹ δ < sᵀ Σ⁻¹ s / 9,
//!
//! c the record's windows over those simulated (at most 64): what is left must be three standard
//! errors, or what is feigned no more than a third.

use nalgebra::DVector;

use super::candidates::Candidate;
use super::design::{self, Design};
use super::residual_map::{CLEARLY, Map, Where, merge};
use super::setting::Setting;
use super::state::{Moving, State};
use crate::error::Result;
use crate::explain::ranking::{self, Fit, Weights};
use crate::identify::chain_bias;
use crate::identify::chain_bias::cells;
use crate::identify::noise_bias::REPEATS;
use crate::identify::remeasured::{repeat, smoothed};
use crate::identify::series::System;
use crate::identify::stretches::Stretch;
use crate::model::model_file::weak_form::WeakForm;
use crate::statistics::Z95;

/// Squares of the standard errors that must be left, and of the share that may be feigned.
const LEFT: f64 = 9.0;
const FEIGNED: f64 = 1.0 / 9.0;
/// Most places of a map against frequency.
const MOST_PLACES: usize = 4;

/// Power of the rows' residuals, by equation and frequency.
pub struct Power {
    /// Ratio to what the sensors' noise alone gives, averaged over equations and frequencies.
    pub ratio: f64,
    /// Mean square residual.
    found: Vec<Vec<f64>>,
    /// What noise alone gives.
    noise: Vec<Vec<f64>>,
}

/// The record smoothed, taken for the truth and measured again.
pub struct Repeats {
    /// As it is.
    pub truth: Vec<Stretch>,
    /// As the sensors show it, [`REPEATS`] times.
    pub measured: Vec<Vec<Stretch>>,
}

impl Repeats {
    /// Of a state's record.
    ///
    /// # Errors
    /// Equations that the weak form cannot hold.
    pub fn of(setting: &Setting<'_>, state: &State) -> Result<Self> {
        let weak = WeakForm::new(setting.model(), setting.rig.omega(), &[])?;
        let kernels = &setting.geometry.kernels;
        let system = System { stretches: &state.stretches, weak: &weak, kernels, circle: &setting.circle };
        let (mut truth, _) = smoothed(&system, &setting.geometry.windows);
        if design::residual(setting, state, &truth)?.is_empty() {
            // Smoothing spends the ends of stretches that held one window: what they showed is
            // measured again as it is.
            truth.clone_from(&state.stretches);
        }
        let sensors = state.sensors(setting);
        let measured = (0..REPEATS).map(|r| repeat(&truth, r, &setting.bound, &sensors)).collect();
        Ok(Self { truth, measured })
    }
}

/// Power of the rows' residuals for coefficients `x` of some columns beside what the sensors' noise
/// alone gives.
///
/// # Errors
/// As [`design::residual`].
pub fn power(
    setting: &Setting<'_>,
    state: &State,
    repeats: &Repeats,
    design: &Design,
    own: &[usize],
    x: &DVector<f64>,
) -> Result<Power> {
    let clean = design::residual(setting, state, &repeats.truth)?;
    let shape = vec![vec![0.0_f64; design.frequencies + 1]; design.equations()];
    let (mut noise, mut count) = (shape.clone(), shape);
    for measured in &repeats.measured {
        for (a, b) in clean.iter().zip(&design::residual(setting, state, measured)?) {
            for (row, (a, b)) in a.iter().zip(b).enumerate() {
                let (e, m) = design.place_of_row(row);
                noise[e][m] += (b - a) * (b - a);
                count[e][m] += 1.0;
            }
        }
    }
    for (noise, count) in noise.iter_mut().flatten().zip(count.iter().flatten()) {
        *noise /= count.max(1.0);
    }
    let found = ranking::mean_squares(design, own, x);
    let both = || found.iter().flatten().zip(noise.iter().flatten()).filter(|(_, n)| **n > 0.0);
    let n = both().count() as f64;
    let ratio = if n > 0.0 { both().map(|(f, n)| f / n).sum::<f64>() / n } else { f64::INFINITY };
    Ok(Power { ratio, found, noise })
}

impl Power {
    /// Maps of each equation's residual against frequency: rms over windows of the rows' residual
    /// at each frequency of the test functions, as an amplitude, and the frequencies at which it
    /// clearly exceeds noise. `scales`: what turns each equation into the unit that it is told in.
    pub fn by_frequency(&self, window_s: f64, scales: &[(f64, String)]) -> (Vec<Map>, Vec<Where>) {
        let step = 1.0 / window_s;
        let (mut maps, mut places) = (Vec::new(), Vec::new());
        for (e, (scale, unit)) in scales.iter().enumerate() {
            // A row is ∫ w Y dt; ∫ sin⁴(πu) over a window is 3/8 of its length, half of an
            // amplitude at its frequency.
            let scale = scale.abs() / (0.375 * window_s) * 2.0;
            let mut bins = Vec::new();
            for (m, (f, n)) in self.found[e].iter().zip(&self.noise[e]).enumerate() {
                let (value, band) = (scale * f.sqrt(), scale * Z95 * n.sqrt());
                let at = m as f64 * step;
                bins.push([at, value, band]);
                if value > CLEARLY * band {
                    let (from, to) = ((at - 0.5 * step).max(0.0), at + 0.5 * step);
                    let (against, units) = ("frequency".to_owned(), ("Hz".to_owned(), unit.clone()));
                    places.push(Where { equation: e + 1, against, from, to, value, band, units });
                }
            }
            let against = "frequency".to_owned();
            maps.push(Map { equation: e + 1, against, against_unit: "Hz".to_owned(), unit: unit.clone(), bins });
        }
        let mut places = merge(places);
        places.truncate(MOST_PLACES);
        (maps, places)
    }
}

/// Whether strengths of a candidate (the last coefficients of `fit`) are those that a record
/// without it shows as well.
pub fn feigned(
    setting: &Setting<'_>,
    state: &State,
    design: &Design,
    weights: &Weights,
    x: &DVector<f64>,
    candidate: &Candidate,
    fit: &Fit,
) -> bool {
    // Under measured inputs a solution over a window would need them without their noise.
    if !setting.bound.inputs.is_empty() {
        return false;
    }
    let d = candidate.strengths();
    let Some((mean, windows)) = on_its_own(setting, state, weights, x, candidate) else { return false };
    is_feigned(fit, d, &mean, design.windows.len() as f64 / windows.max(1) as f64)
}

/// Whether the last `d` strengths of a fit are feigned, `mean` being those of records without the
/// effect; `share`: the record's windows over those simulated.
fn is_feigned(fit: &Fit, d: usize, mean: &DVector<f64>, share: f64) -> bool {
    let from = fit.all.len() - d;
    let found = fit.all.rows(from, d).into_owned();
    let Some(factor) = fit.covariance.view((from, from), (d, d)).into_owned().cholesky() else { return false };
    let wald = |x: &DVector<f64>| x.dot(&factor.solve(x));
    if wald(mean) < FEIGNED * wald(&found) {
        return false;
    }
    wald(&(found - mean)) < LEFT * (1.0 + share / REPEATS as f64)
}

/// The candidate's mean strengths on records of the model itself, and the windows of each.
fn on_its_own(
    setting: &Setting<'_>,
    state: &State,
    weights: &Weights,
    x: &DVector<f64>,
    candidate: &Candidate,
) -> Option<(DVector<f64>, usize)> {
    let Moving { equations, parameters, .. } = state.motion(setting, x)?;
    let weak = WeakForm::new(setting.model(), setting.rig.omega(), &[]).ok()?;
    let kernels = &setting.geometry.kernels;
    let system = System { stretches: &state.stretches, weak: &weak, kernels, circle: &setting.circle };
    let sensors = state.sensors(setting);
    let cells = cells(&sensors.sigma);
    let motions = chain_bias::motions(&equations, &parameters, &system, &setting.geometry.windows, setting.rig, cells)?;
    let d = candidate.strengths();
    let columns: Vec<usize> = (0..state.own_columns() + d).collect();
    let mut sum = DVector::zeros(d);
    let mut windows = 0;
    for r in 0..REPEATS {
        let seen = repeat(&motions, r, &setting.bound, &sensors);
        let design = design::build(setting, state, &seen, &[candidate]).ok()?;
        let x = ranking::fit_some(&design, &columns, weights, |_| true)?;
        sum += x.rows(x.len() - d, d);
        windows = design.windows.len();
    }
    Some((sum / REPEATS as f64, windows))
}
