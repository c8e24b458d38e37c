//! The last fit: once everything is found, coefficients by simulations of pieces as long as tell the
//! most ([`crate::identify::shooting::longer`]), of motions that nothing drives or that follow
//! measured inputs. The search is made in windows of which many are needed, and these are short.
//! Kept where it tells more and foretells the end of the longest stretch no worse from its beginning.

use nalgebra::{DMatrix, DVector};

use super::free_run;
use super::setting::Setting;
use super::simulation::{OfWindows, Simulated};
use super::state::{Moving, State};
use crate::identify::shooting::longer::{From, GROWTH, longer, mean_error};
use crate::identify::track::Track;

/// Fits until the system's parameters, which effects rest on, stand still.
const PASSES: usize = 3;
/// Share of a standard error that is small.
const SMALL: f64 = 0.3;

/// Coefficients of a model by simulations.
pub struct LastFit {
    /// The model's own, then strengths.
    pub x: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Length of a piece, s.
    pub piece_s: f64,
}

impl LastFit {
    /// Coefficients and their covariance.
    pub fn fitted(self) -> (DVector<f64>, DMatrix<f64>) {
        (self.x, self.covariance)
    }
}

/// The last fit; none where windows tell more, or foretell better (`foretells`:
/// [`simulation::measure`](super::simulation::measure)), or where it leaves anything as it is
/// ([`Simulated::is_whole`]).
pub fn last_fit(setting: &Setting<'_>, state: &State, windows: &OfWindows, foretells: bool) -> Option<LastFit> {
    let is_one = setting.own.names.len() == setting.model().coefficients().len();
    if setting.rig.drive.is_some() || !is_one || !setting.shooting || !foretells {
        return None;
    }
    let (mut x, mut length) = (windows.x.clone(), state.followed.as_ref()?.samples());
    for _ in 0..PASSES {
        let (fit, samples) = simulated(setting, state, (&x, windows), length)?;
        if moves(state, &fit.x, &fit.covariance, &relative_errors(state, &fit.covariance)) {
            return None;
        }
        let before = core::mem::replace(&mut x, fit.x.clone());
        if !moves(state, &x, &fit.covariance, &relative_changes(state, &before, &x)) {
            return Some(fit);
        }
        length = samples / GROWTH;
    }
    None
}

/// One fit with the system's parameters as they follow from coefficients `x`, and the samples of a
/// piece.
fn simulated(
    setting: &Setting<'_>,
    state: &State,
    (x, windows): (&DVector<f64>, &OfWindows),
    length: usize,
) -> Option<(LastFit, usize)> {
    let simulated = Simulated::new(setting, state, x).filter(Simulated::is_whole)?;
    let Simulated { begin, moving, signs, .. } = simulated;
    let columns = columns(setting, state, moving.equations.coefficients());
    let Moving { equations, parameters, hidden } = moving;
    let bounds = free_run::bounds(&signs, &parameters);
    let fit = |track: &Track<'_>| {
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let problem = track.problem(&equations, track.spacing_s, &at);
        let from = From { parameters: &parameters, bounds: &bounds, length, margin: begin };
        Some((longer(&problem, track, &from, &mut || {})?, track.spacing_s))
    };
    let ((found, samples), spacing_s) = state.on_free_track(setting, hidden, fit)?;
    let (mut x, mut covariance) = (windows.x.clone(), windows.covariance.clone());
    // What stands at a bound has no error but that of the windows.
    let own: Vec<(usize, usize)> =
        (0..columns.len()).filter(|&i| !found.fit.held[i]).filter_map(|i| Some((i, columns[i]?))).collect();
    let (here, there): (Vec<usize>, Vec<usize>) = own.iter().copied().unzip();
    if mean_error(&found.covariance.estimate, &here) >= mean_error(&covariance, &there) {
        return None;
    }
    for &(_, c) in &own {
        covariance.row_mut(c).fill(0.0);
        covariance.column_mut(c).fill(0.0);
    }
    for &(i, a) in &own {
        own.iter().for_each(|&(j, b)| covariance[(a, b)] = found.covariance.estimate[(i, j)]);
    }
    for (i, c) in columns.iter().enumerate() {
        c.iter().for_each(|&c| x[c] = found.fit.parameters[i]);
    }
    Some((LastFit { x, covariance, piece_s: samples as f64 * spacing_s }, samples))
}

/// Whether relative changes of the system's parameters, which inertias are among, make more of a
/// strength than [`SMALL`] of its standard error: the fit holds them as they are.
fn moves(state: &State, x: &DVector<f64>, covariance: &DMatrix<f64>, changes: &[f64]) -> bool {
    let most = changes.iter().copied().fold(0.0, f64::max);
    (state.values.len()..x.len()).any(|c| x[c].abs() * most > SMALL * covariance[(c, c)].max(0.0).sqrt())
}

/// Relative standard errors of the system's parameters by those of the coefficients.
fn relative_errors(state: &State, covariance: &DMatrix<f64>) -> Vec<f64> {
    let (physical, n) = (&state.physical, state.values.len());
    if physical.slopes.ncols() != n {
        return Vec::new();
    }
    let of = &physical.slopes * covariance.view((0, 0), (n, n)) * physical.slopes.transpose();
    relative(&physical.values, |k| of[(k, k)].max(0.0).sqrt())
}

/// Relative changes of the system's parameters from coefficients to others.
fn relative_changes(state: &State, from: &DVector<f64>, to: &DVector<f64>) -> Vec<f64> {
    let n = state.values.len();
    let at = |x: &DVector<f64>| state.physical.moved(&DVector::from_fn(n, |i, _| x[i] - state.values[i])).values;
    let (from, to) = (at(from), at(to));
    relative(&to, |k| (to[k] - from[k]).abs())
}

fn relative(values: &[f64], by: impl Fn(usize) -> f64) -> Vec<f64> {
    values.iter().enumerate().filter(|(_, p)| **p != 0.0).map(|(k, p)| by(k) / p.abs()).collect()
}

/// The column of each coefficient of the equations of motion, by its name: that of the model's own,
/// or `K J`, strength J of what was chosen as the K-th.
fn columns(setting: &Setting<'_>, state: &State, names: &[String]) -> Vec<Option<usize>> {
    let own = setting.model().coefficients();
    let of = |name: &String| {
        if let Some(i) = own.iter().position(|n| n == name) {
            return Some(i);
        }
        let (k, j) = name.split_once(' ')?;
        let (k, j) = (k.parse::<usize>().ok()?, j.parse::<usize>().ok()?);
        let before: usize = state.chosen.iter().take(k).map(|c| c.strengths.len()).sum();
        Some(state.values.len() + before + j)
    };
    names.iter().map(of).collect()
}
