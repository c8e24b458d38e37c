//! The last fit: once everything is found, coefficients by simulations of pieces as long as tell the
//! most ([`crate::identify::shooting::longer`]), of motions that nothing drives or that follow
//! measured inputs. The search is made in windows of which many are needed, and these are short.
//! Kept where it tells more and foretells the end of the longest stretch no worse from its beginning.

use nalgebra::{DMatrix, DVector};

use super::free_run;
use super::setting::Setting;
use super::simulation::{OfWindows, Simulated};
use super::state::{Moving, State};
use crate::identify::shooting::longer::{From, longer, mean_error};
use crate::identify::track::Track;

/// Coefficients of a model by simulations.
pub struct LastFit {
    /// The model's own, then strengths; what is taken off the record, and what refines a shape, as
    /// it was.
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
/// [`simulation::measure`](super::simulation::measure)).
pub fn last_fit(setting: &Setting<'_>, state: &State, windows: &OfWindows, foretells: bool) -> Option<LastFit> {
    let is_one = setting.own.names.len() == setting.model().coefficients().len();
    if setting.rig.drive.is_some() || !is_one || !setting.shooting || !foretells {
        return None;
    }
    let before = state.followed.as_ref()?.samples();
    let Simulated { begin, moving, signs, .. } = Simulated::new(setting, state, &windows.x)?;
    let columns = columns(setting, state, moving.equations.coefficients());
    let Moving { equations, parameters, hidden } = moving;
    let bounds = free_run::bounds(&signs, &parameters);
    let fit = |track: &Track<'_>| {
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let problem = track.problem(&equations, track.spacing_s, &at);
        let from = From { parameters: &parameters, bounds: &bounds, length: before, margin: begin };
        Some((longer(&problem, track, &from, &mut || {})?, track.spacing_s))
    };
    let ((found, length), spacing_s) = state.on_free_track(setting, hidden, fit)?;
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
    Some(LastFit { x, covariance, piece_s: length as f64 * spacing_s })
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
