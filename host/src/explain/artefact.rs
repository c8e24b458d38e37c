//! Whether an effect is one of the measurement alone: what its strength comes out as on motions that do not have it.
//!
//! Few counts and the low-pass bend the columns of a law that jumps; the longer the record, the surer is the strength that this feigns. So the model without the
//! effect is integrated over stretches like the record's, from its states at their starts, measured by the same sensors and analysed in the same way, the effect's columns
//! among the others: a parametric bootstrap of the null hypothesis (Davison and Hinkley 1997, section 4.2). With s the strengths found, Σ their covariance and δ the
//! mean over R repeats whose grids are shifted, as in [`crate::identify::noise_bias`], the effect stands where
//!
//! (s − δ)ᵀ Σ⁻¹ (s − δ) / (1 + c/R) > 9   or   δᵀ Σ⁻¹ δ < sᵀ Σ⁻¹ s / 9,
//!
//! c the record's windows over those simulated (at most 64): what is left must be three standard errors, or what is feigned no more than a third.

use nalgebra::{DVector, SVector};

use super::Outcome;
use super::design;
use super::effects::{Action, Variant};
use super::forward::Model;
use super::ranking::{self, Fit};
use super::state::{Candidate, State};
use crate::identify::Geometry;
use crate::identify::chain_bias::state_at;
use crate::identify::noise_bias::{REPEATS, STRETCH, measure, places};
use crate::signal::angles::AngleSegment;

/// Squares of the standard errors that must be left, and of the share that may be feigned.
const LEFT: f64 = 9.0;
const FEIGNED: f64 = 1.0 / 9.0;

/// Whether strengths of a candidate (the last coefficients of `fit`) are those that a record without it shows as well.
pub(super) fn feigned(
    state: &State,
    outcome: &Outcome,
    (geometry, sigma): (&Geometry, [f64; 2]),
    candidate: &Candidate,
    fit: &Fit,
) -> bool {
    let d = candidate.variant.action.len();
    let Some((mean, windows)) = on_its_own(state, outcome, geometry, sigma, candidate) else { return false };
    is_feigned(fit, d, &mean, outcome.design.windows.len() as f64 / windows.max(1) as f64)
}

/// Whether the last `d` strengths of a fit are feigned, `mean` being those of records without the effect; `share`: the record's windows over
/// those simulated.
pub(super) fn is_feigned(fit: &Fit, d: usize, mean: &DVector<f64>, share: f64) -> bool {
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
    state: &State,
    outcome: &Outcome,
    geometry: &Geometry,
    sigma: [f64; 2],
    candidate: &Candidate,
) -> Option<(DVector<f64>, usize)> {
    let motions = motions(state, outcome, geometry)?;
    let d = candidate.variant.action.len();
    let variants: Vec<&Variant> =
        state.chosen.iter().map(|k| &k.candidate.variant).chain([&candidate.variant]).collect();
    let columns: Vec<usize> = (0..state.own_columns() + d).collect();
    let mut sum = DVector::zeros(d);
    let mut windows = 0;
    for r in 0..REPEATS {
        let seen: Vec<AngleSegment> =
            motions.iter().enumerate().map(|(i, s)| corrected(state, measure(s, r, sigma, i as u64))).collect();
        let design = design::build(&state.context, &seen, geometry, &variants, &state.model(), &state.base);
        let x = ranking::fit_some(&design, &columns, &outcome.weights, |_| true)?;
        sum += x.rows(x.len() - d, d);
        windows = design.windows.len();
    }
    Some((sum / REPEATS as f64, windows))
}

/// Sensor effects of the model taken off what its sensors would show.
fn corrected(state: &State, mut segment: AngleSegment) -> AngleSegment {
    for k in &state.chosen {
        match &k.candidate.variant.action {
            Action::Force(_) => {}
            Action::Sensor(laws) => {
                for (law, s) in laws.iter().zip(&k.strengths) {
                    segment = design::correct(&segment, law, *s);
                }
            }
            Action::Runaway(_) => {
                segment.runaway = (state.context.span_s[0], core::f64::consts::TAU * k.strengths[0]);
            }
        }
    }
    segment
}

/// What the sensors would show of solutions of the model over stretches of the record.
fn motions(state: &State, outcome: &Outcome, geometry: &Geometry) -> Option<Vec<AngleSegment>> {
    let model = Model::of(state, &outcome.fit.all);
    let kernels = &geometry.kernels;
    let reach = kernels.clear.reach();
    let lengths: Vec<usize> = state.segments.iter().map(AngleSegment::len).collect();
    let step_s = state.segments.first()?.step_s;
    places(&lengths, kernels, &geometry.windows, step_s, STRETCH)
        .into_iter()
        .map(|(i, first, last)| {
            let segment = &state.segments[i];
            let mut out = segment.part(first + reach, last - reach);
            // The model turns the drive's phase itself.
            out.runaway = (0.0, 0.0);
            let at = state_at((0..2).map(|c| &segment.phi[c][first..first + 2 * reach + 1]), kernels)?;
            let shown = model.predict(&state.context, &out, 0, out.len(), &SVector::from_column_slice(&at));
            if shown.len() != out.len() || !shown.iter().flatten().all(|x| x.abs() < 1e7) {
                return None;
            }
            out.phi[0] = shown.iter().map(|y| y[0]).collect();
            out.phi[1] = shown.iter().map(|y| y[1] + if out.relative { y[0] } else { 0.0 }).collect();
            Some(out)
        })
        .collect()
}
