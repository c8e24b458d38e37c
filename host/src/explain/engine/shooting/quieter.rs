//! The sensors' noise from what is left of the windows. Where the motion's own harmonics reach to
//! half the sampling rate, no part of a spectrum is noise alone, and a level that was read there is
//! too high; what the model leaves is noise and more, so that less than the level shows that.

use super::super::setting::Setting;
use super::super::state::State;
use crate::identify::remeasured::Sensors;

/// Standard errors by which what is left must fall short of the level.
const CLEAR: f64 = 4.0;

/// The sensors with the noise of those that leave less than was estimated (σ² = Σ r²/ν, ν the
/// samples less the windows' states); none where none does. What counts has the noise of its grid.
pub fn quieter(setting: &Setting<'_>, state: &State) -> Option<Sensors> {
    let followed = state.followed.as_ref()?;
    let kept = followed.kept(setting)?;
    let n = setting.circle.len();
    let shown: Vec<Vec<Vec<f64>>> = state.stretches.iter().map(|s| s.sensors(&setting.bound)).collect();
    let mut out = setting.sensors.clone();
    let mut found = false;
    for k in (0..out.sigma.len()).filter(|&k| setting.sensors.count[k].is_none()) {
        let weights = setting.bound.shown.row(k);
        let (mut sum, mut rows) = (0.0, 0.0);
        for w in &kept {
            let (shown, path) = (&shown[w.stretch][k], &followed.paths[w.stretch]);
            for i in w.first..w.first + w.count {
                let state = &path.states[2 * n * i..2 * n * i + n];
                let predicted: f64 = weights.iter().zip(state).map(|(w, q)| w * q).sum();
                sum += (shown[path.first + i] - predicted).powi(2);
                rows += 1.0;
            }
        }
        let freedom = rows - (2 * n * kept.len()) as f64 / out.sigma.len() as f64;
        if freedom < 1.0 {
            continue;
        }
        let left = (sum / freedom).sqrt() / state.gains[k];
        let error = (0.5 * out.square_error[k]).hypot((0.5 / freedom).sqrt());
        if left < out.sigma[k] * (1.0 - CLEAR * error) {
            (out.sigma[k], out.square_error[k]) = (left, (2.0 / freedom).sqrt());
            found = true;
        }
    }
    found.then_some(out)
}
