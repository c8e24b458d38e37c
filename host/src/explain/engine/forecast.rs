//! Forecasts: predictions over short horizons on the last 30 % of a record by models fitted to the
//! first 70 %, initial states fitted to each window.

use nalgebra::DVector;

use super::Outcome;
use super::prediction::{Part, Predictions};
use super::setting::Setting;
use super::state::State;
use super::units::Unit;
use crate::explain::Settings;
use crate::explain::explanation::{Forecast, Step};

/// Share of the record that is fitted.
const FITTED: f64 = 0.7;
/// Windows over which a forecast is measured, of the gap's horizon; fewer of longer ones, this many
/// at least.
const MOST_WINDOWS: f64 = 120.0;
const LEAST_WINDOWS: usize = 40;
/// Longer horizon, in units of the shortest, under a drive and without one: chaos leaves nothing to
/// compare beyond a few drive periods.
const DRIVEN: f64 = 4.0;
const FREE: f64 = 40.0 / 3.0;

/// Forecasts to fill.
pub fn open(setting: &Setting<'_>, settings: &Settings, horizon_s: f64) -> Vec<Forecast> {
    let longer = if setting.rig.drive.is_some() { DRIVEN } else { FREE };
    let all = match &settings.forecast_s[..] {
        [] => vec![horizon_s, longer * horizon_s],
        given => given.to_vec(),
    };
    let unit = Unit::of(setting.rig, setting.whole).name;
    all.into_iter().map(|horizon_s| Forecast { horizon_s, unit: unit.clone(), steps: Vec::new() }).collect()
}

/// The sample at which what is fitted ends, and its stretch.
fn split(state: &State) -> (usize, usize) {
    let all: usize = state.stretches.iter().map(crate::identify::stretches::Stretch::len).sum();
    let mut left = (FITTED * all as f64) as usize;
    for (k, s) in state.stretches.iter().enumerate() {
        if left < s.len() {
            return (k, left);
        }
        left -= s.len();
    }
    (state.stretches.len(), 0)
}

/// Coefficients from the first 70 %; none where they do not determine them.
pub fn fitted(state: &State, outcome: &Outcome) -> Option<DVector<f64>> {
    let (stretch, sample) = split(state);
    outcome.before(stretch, sample, FITTED)
}

/// Measures a model with coefficients `x` after something was added.
pub fn measure(
    setting: &Setting<'_>,
    state: &State,
    x: Option<&DVector<f64>>,
    added: Option<&String>,
    how: Predictions<'_>,
    all: &mut [Forecast],
) {
    let (stretch, sample) = split(state);
    let moving = x.and_then(|x| state.motion(setting, x));
    let factor = Unit::of(setting.rig, setting.whole).factor;
    for f in all {
        let most = LEAST_WINDOWS.max((MOST_WINDOWS * how.horizon_s / f.horizon_s) as usize);
        let error = moving.as_ref().and_then(|moving| {
            let model = moving.model(how.step_s);
            state.on_track(setting, |t| model.error(t, f.horizon_s, Part::From(stretch, sample), most))
        });
        // What is no number is left out in the end.
        f.steps.push(Step { added: added.cloned(), value: error.map_or(f64::NAN, |e| factor * e) });
    }
}
