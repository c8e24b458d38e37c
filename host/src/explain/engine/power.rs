//! What is left in the rows against what the sensors' noise alone leaves, and whether an effect is one of the sensors' alone.
//!
//! The smoothed record is measured again by the same sensors with their grids shifted. For an effect the model without it is integrated over
//! stretches like the record's and analysed in the same way: see [`crate::explain::artefact`] for the test.

use nalgebra::DVector;

use super::candidates::Candidate;
use super::design;
use super::setting::Setting;
use super::state::State;
use crate::error::Result;
use crate::explain::artefact;
use crate::explain::design::Design;
use crate::explain::ranking::{self, Fit, Weights};
use crate::identify::chain_bias::cells;
use crate::identify::general::chain;
use crate::identify::general::noise::{measure, smoothed};
use crate::identify::general::series::System;
use crate::identify::general::stretches::Stretch;
use crate::identify::noise_bias::REPEATS;
use crate::model::model_file::weak_form::WeakForm;

/// Ratio of residual to noise power in the rows, averaged over equations and frequencies.
///
/// # Errors
/// As [`design::residual`].
pub fn ratio(setting: &Setting<'_>, state: &State, design: &Design, own: &[usize], x: &DVector<f64>) -> Result<f64> {
    let weak = WeakForm::new(setting.model(), setting.rig.omega(), &[])?;
    let kernels = &setting.geometry.kernels;
    let system = System { stretches: &state.stretches, weak: &weak, kernels, circle: &setting.circle };
    let (truth, _) = smoothed(&system, &setting.geometry.windows);
    let clean = design::residual(setting, state, &truth)?;
    let shape = vec![vec![0.0_f64; design.frequencies + 1]; design.equations()];
    let (mut noise, mut count) = (shape.clone(), shape);
    for r in 0..REPEATS {
        let measured: Vec<Stretch> =
            truth.iter().enumerate().map(|(i, s)| measure(s, r, &setting.bound, &setting.sensors, i as u64)).collect();
        for (a, b) in clean.iter().zip(&design::residual(setting, state, &measured)?) {
            for (row, (a, b)) in a.iter().zip(b).enumerate() {
                let (e, m) = design.place_of_row(row);
                noise[e][m] += (b - a) * (b - a);
                count[e][m] += 1.0;
            }
        }
    }
    let found = ranking::mean_squares(design, own, x);
    let (mut sum, mut n) = (0.0, 0.0);
    for e in 0..design.equations() {
        for m in 0..=design.frequencies {
            if noise[e][m] > 0.0 {
                sum += found[e][m] * count[e][m] / noise[e][m];
                n += 1.0;
            }
        }
    }
    Ok(if n > 0.0 { sum / n } else { f64::INFINITY })
}

/// Whether strengths of a candidate (the last coefficients of `fit`) are those that a record without it shows as well.
pub fn feigned(
    setting: &Setting<'_>,
    state: &State,
    (design, weights, x): (&Design, &Weights, &DVector<f64>),
    candidate: &Candidate,
    fit: &Fit,
) -> bool {
    // Under measured inputs a solution over a window would need them without their noise.
    if !setting.bound.inputs.is_empty() {
        return false;
    }
    let d = candidate.strengths();
    let Some((mean, windows)) = on_its_own(setting, state, weights, x, candidate) else { return false };
    artefact::is_feigned(fit, d, &mean, design.windows.len() as f64 / windows.max(1) as f64)
}

/// The candidate's mean strengths on records of the model itself, and the windows of each.
fn on_its_own(
    setting: &Setting<'_>,
    state: &State,
    weights: &Weights,
    x: &DVector<f64>,
    candidate: &Candidate,
) -> Option<(DVector<f64>, usize)> {
    let (motion, parameters) = state.motion(setting, x)?;
    let weak = WeakForm::new(setting.model(), setting.rig.omega(), &[]).ok()?;
    let kernels = &setting.geometry.kernels;
    let system = System { stretches: &state.stretches, weak: &weak, kernels, circle: &setting.circle };
    let cells = cells(&setting.sensors.sigma);
    let motions = chain::motions(&motion, &parameters, &system, &setting.geometry.windows, setting.rig, cells)?;
    let d = candidate.strengths();
    let columns: Vec<usize> = (0..state.own_columns() + d).collect();
    let mut sum = DVector::zeros(d);
    let mut windows = 0;
    for r in 0..REPEATS {
        let seen: Vec<Stretch> = motions
            .iter()
            .enumerate()
            .map(|(i, s)| measure(s, r, &setting.bound, &setting.sensors, i as u64))
            .collect();
        let design = design::build(setting, state, &seen, &[candidate]).ok()?;
        let x = ranking::fit_some(&design, &columns, weights, |_| true)?;
        sum += x.rows(x.len() - d, d);
        windows = design.windows.len();
    }
    Some((sum / REPEATS as f64, windows))
}
