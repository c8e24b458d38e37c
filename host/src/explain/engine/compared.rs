//! The gap as one picture: what a sensor measured over some seconds, and what the models before and
//! after predict of them.
//!
//! Both models run on freely from a window that was not fitted; the initial state of each is fitted
//! to the window's beginning, of the gap's horizon. Of up to `MOST` windows the one is shown whose
//! prediction before is off by the median.

use nalgebra::DVector;
use serde::Serialize;

use super::prediction::Predictions;
use super::setting::Setting;
use super::state::State;
use super::units::Unit;

/// Most windows of which one is shown.
const MOST: usize = 15;
/// Most points of a curve.
const POINTS: usize = 600;
/// Shortest and longest part shown, in horizons of the gap.
const SPAN: [f64; 2] = [4.0, 20.0];
/// Share of the median time for which predictions of the last model hold: beyond it chaos parts any
/// two motions.
const HELD: f64 = 0.6;

/// What was measured, and what was predicted of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Compared {
    /// What the sensor measures.
    pub measures: String,
    /// Unit of all values.
    pub unit: String,
    /// When it begins in the record, s.
    pub from_s: f64,
    /// Initial states are fitted up to here, s after the beginning.
    pub fitted_s: f64,
    /// Time since the beginning, s.
    pub t: Vec<f64>,
    /// Measured.
    pub measured: Vec<f64>,
    /// Predicted by the model before anything was added, minus measured; shorter where it has no
    /// solution.
    pub before: Vec<f64>,
    /// The same by the model with everything that was added; empty where nothing was.
    pub after: Vec<f64>,
}

/// A model at one stage: what is in it and its coefficients.
pub type Stage<'a> = (&'a State, &'a DVector<f64>);

/// The picture; `holds_s`: how long predictions hold, where that is known. None where no window can
/// be predicted.
pub fn compare(
    setting: &Setting<'_>,
    before: Stage<'_>,
    after: Option<Stage<'_>>,
    how: Predictions<'_>,
    holds_s: Option<f64>,
) -> Option<Compared> {
    let [least, most] = SPAN.map(|f| f * how.horizon_s);
    let span_s = holds_s.map_or(2.0 * least, |h| HELD * h).clamp(least, most).min(how.longest_s);
    let run = |(state, x): Stage<'_>| -> Vec<((usize, usize), Vec<f64>)> {
        let Some(moving) = state.free_motion_of(setting, x, 0) else { return Vec::new() };
        let model = moving.model(how.step_s);
        state.on_free_track(setting, moving.hidden.clone(), |t| model.free(t, how, span_s, MOST))
    };
    // Parameters are those of the first record.
    let of_first = |at: &(usize, usize)| setting.record_of.get(at.0).is_none_or(|r| *r == 0);
    let mut old: Vec<_> = run(before).into_iter().filter(|(at, r)| of_first(at) && !r.is_empty()).collect();
    let size = |r: &[f64]| (r.iter().map(|x| x * x).sum::<f64>() / r.len() as f64).sqrt();
    old.sort_by(|a, b| size(&a.1).total_cmp(&size(&b.1)).then(a.0.cmp(&b.0)));
    let (at, old) = old.get(old.len() / 2)?;
    let new = after.and_then(|stage| run(stage).into_iter().find(|(place, _)| place == at)).map(|(_, r)| r);
    let sensors = setting.bound.sensors.len().max(1);
    let of = |all: &[f64], k: usize| all.iter().skip(k).step_by(sensors).copied().collect::<Vec<f64>>();
    let shown = (0..sensors).max_by(|&a, &b| size(&of(old, a)).total_cmp(&size(&of(old, b))).then(b.cmp(&a)))?;
    let stretch = setting.raw.get(at.0)?;
    let count = (span_s / stretch.step_s).round() as usize + 1;
    let measured = stretch.sensors(&setting.bound).get(shown)?.get(at.1..at.1 + count)?.to_vec();
    let unit = Unit::of_sensor(setting.rig, &setting.bound, shown);
    // An angle that has turned several times is shown near 0.
    let turn = core::f64::consts::TAU;
    let turned = if unit.name == "deg" { (measured.first()? / turn).round() * turn } else { 0.0 };
    let every = count.div_ceil(POINTS).max(1);
    let thin = |x: Vec<f64>, off: f64| x.into_iter().step_by(every).map(|x| (x - off) * unit.factor).collect();
    Some(Compared {
        measures: setting.rig.channel[setting.bound.sensors[shown]].measures.clone(),
        unit: if unit.name == "deg" { "°".to_owned() } else { unit.name.clone() },
        from_s: stretch.time(at.1),
        fitted_s: how.horizon_s,
        t: (0..count).step_by(every).map(|i| i as f64 * stretch.step_s).collect(),
        measured: thin(measured, turned),
        before: thin(of(old, shown), 0.0),
        after: new.map_or_else(Vec::new, |r| thin(of(&r, shown), 0.0)),
    })
}
