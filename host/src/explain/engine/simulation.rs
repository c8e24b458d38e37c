//! Free runs: the model fitted to the beginning of the longest stretch and continued to its end
//! without touching the state.
//!
//! Fitted by the windows of shooting that lie in the beginning, with a state from the last of them;
//! where there are too few, by simulation to all of it.
//!
//! Of systems that are free or follow measured inputs; what a drive keeps moving may be chaotic,
//! and no simulation follows it.

use nalgebra::DVector;
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

/// Simulation errors: fitted to the beginning of the longest stretch, continued to its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Simulation {
    /// Share of the stretch that was fitted.
    pub fitted: f64,
    /// Unit of the values.
    pub unit: String,
    /// Rms error over the rest, of the model as given and with everything that was added; the
    /// greatest over the sensors. NaN where no simulation follows the record.
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
struct Simulated {
    stretch: usize,
    /// Sample of it at which windows begin.
    begin: usize,
    moving: Moving,
    /// Sign of each parameter: 0 either, NaN as it is.
    signs: Vec<f64>,
}

impl Simulated {
    fn new(setting: &Setting<'_>, state: &State, x: &DVector<f64>) -> Option<Self> {
        let stretch = (0..state.stretches.len()).max_by_key(|&k| (state.stretches[k].len(), usize::MAX - k))?;
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
        Some(Self { stretch, begin, moving, signs })
    }
}

/// What one simulation of the whole longest stretch leaves, in units of the noise's power, and its
/// values, where it was followed to its end; none under a drive or measured inputs. Windows have an
/// initial state each: what shows in how a motion goes on from one to the next they do not see.
pub fn left_of_whole(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<(f64, usize)> {
    if setting.rig.drive.is_some() || !setting.bound.inputs.is_empty() {
        return None;
    }
    let Simulated { stretch, begin, moving, signs } = Simulated::new(setting, state, &outcome.fit.all)?;
    let Moving { equations, parameters, hidden } = moving;
    let left = |t: &Track<'_>| free_run::left_of_stretch(&equations, &parameters, &signs, t, (stretch, begin));
    state.on_free_track(setting, hidden, left)
}

/// Measures a step.
pub fn measure(setting: &Setting<'_>, state: &State, outcome: &Outcome, added: Option<String>, all: &mut [Simulation]) {
    if all.is_empty() {
        return;
    }
    let Some(simulated) = Simulated::new(setting, state, &outcome.fit.all) else { return };
    let Simulated { stretch, begin, moving: Moving { equations, parameters, hidden }, signs } = simulated;
    let record = setting.record_of.get(stretch).copied().unwrap_or(0);
    let own = setting.model().coefficients();
    let names = equations.coefficients();
    let unit = Unit::of(setting.rig, setting.whole);
    let told_name = |name: &String| -> String {
        let chosen = name.split_once(' ').and_then(|(a, b)| Some((state.chosen.get(a.parse::<usize>().ok()?)?, b)));
        match chosen {
            Some((k, column)) if !own.contains(name) => format!("{} {column}", k.candidate.name(setting)),
            _ => name.clone(),
        }
    };
    let samples = state.stretches[stretch].len();
    let window = state.followed.as_ref().map_or(samples / 8, |f| f.samples());
    for simulation in all {
        let split = Split { stretch, begin, fitted: (simulation.fitted * samples as f64) as usize, end: samples };
        let by_windows = outcome.until(stretch, split.fitted).and_then(|x| {
            let Moving { equations, parameters, hidden } = state.free_motion_of(setting, &x, record)?;
            let run = |t: &Track<'_>| free_run::run(&equations, &parameters, t, split, window);
            state.on_free_track(setting, hidden, run).map(|error| (parameters, error))
        });
        let simulate = |t: &Track<'_>| free_run::simulate(&equations, &parameters, &signs, t, split);
        let found = by_windows.or_else(|| state.on_free_track(setting, hidden.clone(), simulate));
        let value = found.as_ref().map_or(f64::NAN, |(_, error)| error * unit.factor);
        simulation.steps.push(Step { added: added.clone(), value });
        // What refines a shape is no coefficient: its sign is no number.
        let all = names.iter().zip(&signs);
        simulation.parameters = found.map_or_else(Vec::new, |(p, _)| {
            let told = all.zip(p).filter(|((_, sign), _)| !sign.is_nan());
            told.map(|((name, _), value)| Coefficient { name: told_name(name), value }).collect()
        });
    }
}
