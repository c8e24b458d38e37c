//! Motions of chapter 5's releases and of the models of them: one period in modal coordinates, and
//! the relative error ‖x̂ − x‖/‖x‖ of all coordinates over ten periods from the release's rest
//! state.

use std::f64::consts::TAU;

use super::chapter5::Case;
use crate::reduce::added_constraint::ConstraintModel;
use crate::reduce::polar::Polar;

/// One period of a release in modal coordinates from its harmonics: y, ẏ, z.
pub(super) fn orbit(case: &Case, release: usize) -> [Vec<f64>; 3] {
    let mut out = [Vec::new(), Vec::new(), Vec::new()];
    for i in 0..=160 {
        let phi = TAU * f64::from(i) / 160.0;
        let m = [case.fits[release].motion(0, phi), case.fits[release].motion(1, phi)];
        let dot = |k: usize, d: usize| m[0][d] * case.pod.modes[k][0] + m[1][d] * case.pod.modes[k][1];
        out[0].push(dot(0, 0));
        out[1].push(dot(0, 1));
        out[2].push(dot(1, 0));
    }
    out
}

/// One period of a model from rest at y0: y, ẏ (unscaled), z.
pub(super) fn orbit_of(model: &ConstraintModel, y0: f64) -> Option<[Vec<f64>; 3]> {
    let period = TAU / model.behaviour(y0)?.omega;
    let mut out = [Vec::new(), Vec::new(), Vec::new()];
    for s in model.simulate(y0, period / 160.0, 161) {
        let x = model.displacement(s[0], s[1]);
        out[0].push(s[0]);
        out[1].push(s[1] * model.time_unit);
        out[2].push(x.iter().zip(&model.modes[1]).map(|(x, p)| x * p).sum());
    }
    Some(out)
}

/// Relative error of all coordinates over ten periods, started at the release's rest state.
pub(super) fn history_error(case: &Case, model: &ConstraintModel, release: usize) -> Option<f64> {
    let x = &case.records[release];
    let y0 = x[0][0] * case.pod.modes[0][0] + x[1][0] * case.pod.modes[0][1];
    let count = ((10.0 * TAU / case.fits[release].omega / case.step) as usize).min(x[0].len());
    let states = model.simulate(y0, case.step, count);
    if states.len() < count {
        return None;
    }
    let (mut e, mut s) = (0.0, 0.0);
    for (i, state) in states.iter().enumerate() {
        let at = model.displacement(state[0], state[1]);
        for c in 0..2 {
            e += (at[c] - x[c][i]).powi(2);
            s += x[c][i].powi(2);
        }
    }
    Some((e / s).sqrt())
}

/// The same of the polar model with the equations known.
pub(super) fn polar_history_error(case: &Case, release: usize) -> Option<f64> {
    let x = &case.records[release];
    let a = case.known.amplitude_of(&[x[0][0], x[1][0]])?;
    let omega = case.known.corrected_omega(&*case.system, &case.all, a)?;
    history_error_of(case, &case.known, release, a, omega)
}

/// The same of the polar model from displacements only.
pub(super) fn blind_history_error(case: &Case, release: usize) -> Option<f64> {
    let x = &case.records[release];
    let a = case.polar.amplitude_of(&[x[0][0], x[1][0]])?;
    history_error_of(case, &case.polar, release, a, case.polar.omega(a))
}

fn history_error_of(case: &Case, polar: &Polar, release: usize, a: f64, omega: f64) -> Option<f64> {
    let x = &case.records[release];
    let count = ((10.0 * TAU / case.fits[release].omega / case.step) as usize).min(x[0].len());
    let (mut e, mut s) = (0.0, 0.0);
    for i in 0..count {
        let at = polar.displacement(a, omega * i as f64 * case.step);
        for c in 0..2 {
            e += (at[c] - x[c][i]).powi(2);
            s += x[c][i].powi(2);
        }
    }
    Some((e / s).sqrt())
}
