//! What is measured after each step: the gap on held-out blocks, longer horizons, forecasts of the record's last part.
//!
//! Coefficients come from the weak form over the windows that are not held out. Where they leave more than [`SHOOT_FROM`] noise floors the model is
//! wrong and the fit with the least error is another one: it is then refitted by multiple shooting over the same windows
//! ([`super::shooting`]), so that each step shows the best that its model can do.

use nalgebra::{DMatrix, DVector};

use super::design::Design;
use super::forward::Model;
use super::gap::{self, Part, Stretch};
use super::ranking::{self, Fit, Weights};
use super::state::State;
use super::{Settings, shooting, singular};
use crate::error::Result;
use crate::identify::Geometry;
use crate::signal::angles::AngleSegment;

/// Gap from which the model is refitted by shooting.
const SHOOT_FROM: f64 = 1.1;
/// Most windows of a horizon that are compared, and that are fitted.
const MOST_COMPARED: usize = 160;
const MOST_FITTED: usize = 120;
/// Most windows at longer horizons.
const MOST_LONGER: usize = 40;
/// Share of the record that is fitted for a forecast.
const FORECAST_FROM: f64 = 0.7;

/// Everything that steps are measured against.
pub(super) struct Comparison<'a> {
    pub(super) raw: &'a [AngleSegment],
    pub(super) geometry: &'a Geometry,
    pub(super) sigma: [f64; 2],
    pub(super) horizon_s: f64,
    /// Windows of the horizon in blocks that are not fitted.
    pub(super) held_out: Vec<Stretch>,
    fitted: Vec<Stretch>,
    early: Vec<Stretch>,
    /// Horizon and windows of each forecast.
    late: Vec<(f64, Vec<Stretch>)>,
}

/// What was measured after a step.
#[derive(Clone)]
pub(super) struct Measured {
    /// The gap, noise floors.
    pub(super) gap: f64,
    /// Coefficients that were fitted outside of the held-out blocks.
    pub(super) x: DVector<f64>,
    /// Horizons, s, and rms errors, degrees.
    pub(super) forecasts: Vec<(f64, f64)>,
    /// Coefficients and covariance of a refit by shooting, where there was one.
    pub(super) shot: Option<(DVector<f64>, DMatrix<f64>)>,
}

impl<'a> Comparison<'a> {
    pub(super) fn new(
        raw: &'a [AngleSegment],
        geometry: &'a Geometry,
        sigma: [f64; 2],
        horizon_s: f64,
        driven: bool,
        settings: &Settings,
    ) -> Self {
        let horizons = if settings.forecast_s.is_empty() {
            // Chaos leaves nothing to compare beyond a few drive periods.
            vec![horizon_s, if driven { 4.0 } else { 40.0 / 3.0 } * horizon_s]
        } else {
            settings.forecast_s.clone()
        };
        let take = |h: f64, part: Part, most: usize| gap::stretches(raw, geometry, h, part, most);
        Self {
            raw,
            geometry,
            sigma,
            horizon_s,
            held_out: take(horizon_s, Part::HeldOut, MOST_COMPARED),
            fitted: take(horizon_s, Part::Fitted, MOST_FITTED),
            early: take(horizon_s, Part::Before(FORECAST_FROM), MOST_FITTED),
            late: horizons
                .into_iter()
                .map(|h| {
                    (
                        h,
                        take(
                            h,
                            Part::After(FORECAST_FROM),
                            MOST_LONGER.max((MOST_FITTED as f64 * horizon_s / h) as usize),
                        ),
                    )
                })
                .filter(|(_, w)| !w.is_empty())
                .collect(),
        }
    }

    /// Rms motion of the sensors about their mean over the windows of the gap, in units of their noise; none where that is unknown.
    pub(super) fn motion(&self) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0);
        for &(s, first, n) in &self.held_out {
            let phi = &self.raw[s].phi;
            let relative = self.raw[s].relative;
            for k in 0..2 {
                let shown = |i: usize| phi[k][i] - if k == 1 && relative { phi[0][i] } else { 0.0 };
                let mean = (first..first + n).map(shown).sum::<f64>() / n.max(1) as f64;
                sum += (first..first + n).map(|i| ((shown(i) - mean) / self.sigma[k]).powi(2)).sum::<f64>();
                count += n;
            }
        }
        let rms = (sum / count as f64).sqrt();
        (rms.is_finite() && rms > 0.0).then_some(rms)
    }

    /// The gap of the model with coefficients `x`, fitted to the windows outside of the held-out blocks.
    fn gap(&self, state: &State, x: &DVector<f64>) -> f64 {
        gap::gap(&state.context, &Model::of(state, x), self.raw, &self.held_out, self.sigma)
    }

    /// The same at longer horizons: horizon, s, and gap.
    pub(super) fn longer(&self, state: &State, x: &DVector<f64>) -> Vec<(f64, f64)> {
        let model = Model::of(state, x);
        [2.0, 4.0, 8.0]
            .iter()
            .map(|f| f * self.horizon_s)
            .filter(|h| *h <= self.geometry.windows.length_s)
            .map(|h| {
                let some = gap::stretches(self.raw, self.geometry, h, Part::HeldOut, MOST_LONGER);
                (h, gap::gap(&state.context, &model, self.raw, &some, self.sigma))
            })
            .collect()
    }

    /// Forecasts by a model.
    fn forecast(&self, state: &State, x: &DVector<f64>) -> Vec<(f64, f64)> {
        let model = Model::of(state, x);
        self.late
            .iter()
            .map(|(h, windows)| (*h, gap::rms(&state.context, &model, self.raw, windows).to_degrees()))
            .collect()
    }

    /// Measures a model whose coefficients are given.
    pub(super) fn measure_given(&self, state: &State, x: &DVector<f64>) -> Measured {
        Measured { gap: self.gap(state, x), x: x.clone(), forecasts: self.forecast(state, x), shot: None }
    }

    /// Measures a step: the model is refitted to the parts that each comparison leaves it.
    pub(super) fn measure(
        &self,
        state: &State,
        design: &Design,
        weights: &Weights,
        own: &[usize],
        fit: &Fit,
    ) -> Result<Measured> {
        let mut gap = self.gap(state, &fit.train);
        let mut at = fit.train.clone();
        let deviations: Vec<f64> = fit.covariance.diagonal().iter().map(|v| v.max(0.0).sqrt()).collect();
        let shoot = |x: &DVector<f64>, windows: &[Stretch]| {
            shooting::refit(state, x, &deviations, self.raw, windows, self.sigma)
        };
        let wrong = gap > SHOOT_FROM;
        let mut shot = None;
        if wrong && let Some(better) = shoot(&fit.train, &self.fitted) {
            gap = self.gap(state, &better.x);
            at = better.x.clone();
            shot = Some((better.x, better.covariance));
        }
        let windows = design.windows.len();
        let end = (FORECAST_FROM * windows as f64) as usize;
        let mut x = ranking::fit_some(design, own, weights, |k| k + 2 <= end).ok_or_else(singular)?;
        if wrong && let Some(better) = shoot(&x, &self.early) {
            x = better.x;
        }
        Ok(Measured { gap, x: at, forecasts: self.forecast(state, &x), shot })
    }
}
