//! Free runs: the model fitted to the beginning of the longest stretch and continued to its end
//! without touching the state.
//!
//! Fitted by the windows of shooting that lie in the beginning, with a state from the last of them,
//! and by simulation to all of it; what foretells the rest better is told.
//!
//! Of systems that are free or follow measured inputs; what a drive keeps moving may be chaotic,
//! and no simulation follows it.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::evidence::Outcome;
use super::free_run::{self, Split};
use super::setting::Setting;
use super::shooting::signs;
use super::state::{Moving, State};
use super::units::Unit;
use crate::explain::explanation::Step;
use crate::identify::track::Track;

/// Shares of the record that simulations are fitted to.
const FITTED: [f64; 2] = [2.0 / 3.0, 0.75];
/// Ratio of errors up to which one foretells no worse than another (by hand): of a model that lacks
/// nothing both are the sensors' noise, and differ by chance.
const NO_WORSE: f64 = 1.1;

/// Simulation errors: fitted to the beginning of the longest stretch, continued to its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Simulation {
    /// Share of the stretch that was fitted.
    pub fitted: f64,
    /// Unit of the values.
    pub unit: String,
    /// Rms error over the rest, of the model as given and with everything that was added; the
    /// greatest over the sensors. Where no simulation follows the record there is no step in the
    /// end, NaN until then.
    pub steps: Vec<Step>,
    /// The coefficients of the last step as fitted by this simulation; those of effects by
    /// `ID@PLACE` and a number.
    pub parameters: Vec<Coefficient>,
}

/// A coefficient.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coefficient {
    /// Name.
    pub name: String,
    /// Value, in the equation's own units.
    pub value: f64,
}

/// Simulations to fill; none under a drive.
pub fn open(setting: &Setting<'_>) -> Vec<Simulation> {
    let unit = Unit::of(setting.rig, setting.whole).name;
    let fitted: &[f64] = if setting.rig.drive.is_some() { &[] } else { &FITTED };
    fitted
        .iter()
        .map(|f| Simulation { fitted: *f, unit: unit.clone(), steps: Vec::new(), parameters: Vec::new() })
        .collect()
}

/// A model as it is simulated: of the record of the longest stretch.
pub(super) struct Simulated {
    stretch: usize,
    /// Sample of it at which windows begin.
    pub begin: usize,
    /// Its equations.
    pub moving: Moving,
    /// Sign of each parameter: 0 either, NaN as it is.
    pub signs: Vec<f64>,
    /// The model's coefficients and strengths.
    columns: usize,
}

impl Simulated {
    /// Whether a simulation fits everything: no effect on the sensors, which is taken off the record
    /// as it is, no shape, and no states of effects, which take long to follow.
    pub fn is_whole(&self) -> bool {
        let all = self.signs.len() == self.columns && self.signs.iter().all(|s| !s.is_nan());
        all && self.moving.hidden.is_empty()
    }

    /// Of a model with coefficients `x`.
    pub fn new(setting: &Setting<'_>, state: &State, x: &DVector<f64>) -> Option<Self> {
        let stretch = longest(state)?;
        let record = setting.record_of.get(stretch).copied().unwrap_or(0);
        let moving = state.free_motion_of(setting, x, record)?;
        let own = setting.model().coefficients();
        let kept = setting.own.coefficients(&setting.signs, record);
        let sign_of = |name: &String| -> f64 {
            if let Some(i) = own.iter().position(|n| n == name) {
                return kept[i];
            }
            let place = |t: &str| t.parse::<usize>().ok();
            let Some((k, j)) = name.split_once(' ').and_then(|(a, b)| Some((place(a)?, place(b)?))) else { return 0.0 };
            let Some(chosen) = state.chosen.get(k) else { return 0.0 };
            // What refines a shape is no strength of its own: it stays.
            if j >= chosen.candidate.entry.strengths.len() {
                return f64::NAN;
            }
            signs::of(&chosen.candidate).get(j).copied().unwrap_or(0.0)
        };
        let signs: Vec<f64> = moving.equations.coefficients().iter().map(sign_of).collect();
        let begin = state.followed.as_ref().map_or(0, |f| f.first(stretch));
        Some(Self { stretch, begin, moving, signs, columns: x.len() })
    }
}

/// What windows tell of a model: its coefficients with their covariance.
#[derive(Clone)]
pub struct OfWindows {
    /// Coefficients.
    pub x: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
}

impl OfWindows {
    /// Of a fit.
    pub fn new(outcome: &Outcome) -> Self {
        Self { x: outcome.fit.all.clone(), covariance: outcome.covariance() }
    }
}

/// The longest stretch.
fn longest(state: &State) -> Option<usize> {
    (0..state.stretches.len()).max_by_key(|&k| (state.stretches[k].len(), usize::MAX - k))
}

impl Simulated {
    /// Parameters from the windows in what is fitted, and the rms error of what follows.
    fn by_windows(
        &self,
        setting: &Setting<'_>,
        state: &State,
        until: Option<DVector<f64>>,
        split: Split,
    ) -> Option<(Vec<f64>, f64)> {
        let record = setting.record_of.get(self.stretch).copied().unwrap_or(0);
        let window = state.followed.as_ref().map_or(split.end / 8, |f| f.samples());
        let x = until?;
        let Moving { equations, parameters, hidden } = state.free_motion_of(setting, &x, record)?;
        let run = |t: &Track<'_>| free_run::run(&equations, &parameters, t, split, window);
        state.on_free_track(setting, hidden, run).map(|error| (parameters, error))
    }

    /// The same by one simulation of it.
    fn by_simulation(&self, setting: &Setting<'_>, state: &State, split: Split) -> Option<(Vec<f64>, f64)> {
        let Moving { equations, parameters, hidden } = &self.moving;
        let simulate = |t: &Track<'_>| free_run::simulate(equations, parameters, &self.signs, t, split);
        state.on_free_track(setting, hidden.clone(), simulate)
    }

    /// Where a share of its stretch is fitted.
    fn split(&self, state: &State, fitted: f64) -> Split {
        let samples = state.stretches[self.stretch].len();
        let fitted = (fitted * samples as f64) as usize;
        Split { stretch: self.stretch, begin: self.begin, fitted, end: samples }
    }
}

/// What one simulation of the whole longest stretch leaves, in units of the noise's power, and its
/// values, where it was followed to its end; none under a drive or measured inputs. Windows have an
/// initial state each: what shows in how a motion goes on from one to the next they do not see.
pub fn left_of_whole(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<(f64, usize)> {
    if setting.rig.drive.is_some() || !setting.bound.inputs.is_empty() {
        return None;
    }
    let Simulated { stretch, begin, moving, signs, .. } = Simulated::new(setting, state, &outcome.fit.all)?;
    let Moving { equations, parameters, hidden } = moving;
    let left = |t: &Track<'_>| free_run::left_of_stretch(&equations, &parameters, &signs, t, (stretch, begin));
    state.on_free_track(setting, hidden, left)
}

/// Measures a step; whether simulations of the beginning foretell the rest no worse than its windows
/// do, wherever both do.
pub fn measure(
    setting: &Setting<'_>,
    state: &State,
    outcome: &Outcome,
    added: Option<String>,
    all: &mut [Simulation],
) -> bool {
    if all.is_empty() {
        return false;
    }
    let Some(simulated) = Simulated::new(setting, state, &outcome.fit.all) else { return false };
    let mut foretells = true;
    let own = setting.model().coefficients();
    let names = simulated.moving.equations.coefficients();
    let unit = Unit::of(setting.rig, setting.whole);
    let told_name = |name: &String| -> String {
        let chosen = name.split_once(' ').and_then(|(a, b)| Some((state.chosen.get(a.parse::<usize>().ok()?)?, b)));
        match chosen {
            Some((k, column)) if !own.contains(name) => format!("{} {column}", k.candidate.name(setting)),
            _ => name.clone(),
        }
    };
    for simulation in all {
        let split = simulated.split(state, simulation.fitted);
        let until = outcome.until(split.stretch, split.fitted);
        let by_windows = simulated.by_windows(setting, state, until, split);
        let worthwhile = by_windows.is_none() || simulated.is_whole();
        let by_simulation = if worthwhile { simulated.by_simulation(setting, state, split) } else { None };
        let error = |of: &Option<(Vec<f64>, f64)>| of.as_ref().map_or(f64::INFINITY, |f| f.1);
        foretells &= by_simulation.is_some() && error(&by_simulation) <= NO_WORSE * error(&by_windows);
        let found = by_windows.into_iter().chain(by_simulation).min_by(|a, b| a.1.total_cmp(&b.1));
        let value = found.as_ref().map_or(f64::NAN, |(_, error)| error * unit.factor);
        simulation.steps.push(Step { added: added.clone(), value });
        // What refines a shape is no coefficient: its sign is no number.
        let all = names.iter().zip(&simulated.signs);
        simulation.parameters = found.map_or_else(Vec::new, |(p, _)| {
            let told = all.zip(p).filter(|((_, sign), _)| !sign.is_nan());
            told.map(|((name, _), value)| Coefficient { name: told_name(name), value }).collect()
        });
    }
    foretells
}
