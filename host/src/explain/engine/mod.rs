//! Explanations for a system derived from bodies, or for written equations under a drive: every effect of the catalogue at every joint, arm, encoder, at its drive and frame.
//!
//! As for the built-in double pendulum, for any number of coordinates: the equations without dampings and the nominal dampings, tied over the
//! equations, are fitted by the weak form; every candidate is added in turn and judged on blocks that were not fitted
//! (`crate::explain::decision`); the best is added until nothing more is supported. Effects of sensors and of the drive's phase are taken
//! off the record, which is then read again.
//!
//! | file | what |
//! |---|---|
//! | `setting` | the record, its sensors, the system |
//! | `candidates` | effects at their places, their columns |
//! | `state` | coefficients and what was added |
//! | `design` | columns over all windows |
//! | `correct` | sensor effects taken off |
//! | `given` | a model to start from or to predict with |
//! | `power` | what noise alone leaves, what sensors alone feign |
//! | `residual` | where what is left sits |
//! | `tell` | values, units, the model |
//! | `unknown` | the shape of what has no name |

mod candidates;
mod correct;
mod design;
pub mod given;
mod power;
mod residual;
mod setting;
mod state;
mod tell;
mod unknown;

use self::candidates::Candidate;
use self::setting::{Begun, Physical, Setting};
use self::state::{Chosen, State};
use super::decidability::{self, EXPLAINED_GAP, FEWEST_BLOCKS, LOCKED, locked};
use super::decision::{self, Choice, Offer};
use super::design::Design;
use super::explanation::{Details, Explanation, Found, Step, Verdict};
use super::model_file::{prediction, told};
use super::ranking::{self, Fit, Weights};
use super::{LEAST_PROGRESS, MOST_EFFECTS, MOST_WINDOWS, Settings, singular};
use crate::error::Result;
use crate::identify::Identification;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::Bound;

/// Step of integration as a share of the shortest horizon: 1e-8 of a smooth motion with a method of fifth order.
const STEP: f64 = 0.01;
/// Longer horizons of the gap, in units of the shortest.
const LONGER: [f64; 3] = [2.0, 4.0, 8.0];

/// Explains records of a rig whose system was derived from bodies; none where that way is not open to it.
///
/// # Errors
/// As [`crate::identify::identify`].
pub fn explain(records: &[Record], rig: &Rig, whole: &Bound, settings: &Settings) -> Result<Option<Explanation>> {
    let Some(Begun { setting, first, physical, warnings }) = Setting::begin(records, rig, whole, MOST_WINDOWS)? else {
        return Ok(None);
    };
    let Some(mut state) = start(&setting, &first, physical) else { return Ok(None) };
    let horizon_s = told::horizon(rig, settings, &setting.raw)?.min(setting.geometry.windows.length_s);
    let mut result = Explanation::new(horizon_s, warnings);
    describe(&setting, &state, &mut result);
    let whole = whole_windows(&setting);
    if whole < ranking::FOLDS {
        return Ok(Some(decidability::too_short(result, whole, setting.geometry.windows.length_s)));
    }
    let undecidable = undecidable(&setting, records);
    if let Some(model) = &settings.model {
        given::take(&setting, &mut state, model)?;
        let value = gap(&setting, &state, &given::coefficients(&state), horizon_s);
        result.gap.steps.push(Step { added: None, value });
    }
    let mut kept: Option<(State, Outcome)> = None;
    let mut before = Vec::new();
    let outcome = loop {
        let step = result.effects.len();
        let candidates = setting.candidates(&state.physical);
        let outcome = refit(&setting, &mut state, candidates)?;
        let gap = gap(&setting, &state, &outcome.fit.train, horizon_s);
        // A wrong model makes many effects look significant: each must also bring predictions nearer, or it goes again.
        let previous = result.gap.steps.last().map_or(f64::INFINITY, |s| s.value);
        if gap > (1.0 - LEAST_PROGRESS) * previous
            && previous > EXPLAINED_GAP
            && !result.effects.is_empty()
            && let Some((better, outcome)) = kept.take()
        {
            let _ = result.effects.pop();
            state = better;
            break outcome;
        }
        let refitted = || settings.model.is_some().then(|| "refit".to_owned());
        let added = result.effects.last().map(|f| format!("{}@{}", f.id, f.at)).or_else(refitted);
        result.gap.steps.push(Step { added, value: gap });
        let ratio = power::ratio(&setting, &state, &outcome.design, &outcome.own, &outcome.fit.all)?;
        if step == 0 {
            result.residual_power[0] = ratio;
            (result.maps, result.r#where) = residual::maps(&setting, &state, &outcome.fit.all);
            before = longer(&setting, &state, &outcome.fit.train, horizon_s);
        }
        result.residual_power[1] = ratio;
        let last = undecidable.is_some() || step == settings.most_effects.unwrap_or(MOST_EFFECTS);
        let next = if last { None } else { choose(&setting, &state, &outcome, step, &mut result) };
        let Some((found, candidate)) = next else { break outcome };
        result.effects.push(found);
        kept = Some((state.clone(), outcome));
        let joined = Chosen::new(&setting, candidate, &state.physical);
        state.chosen.push(joined);
    };
    let after = if result.effects.is_empty() {
        before.clone()
    } else {
        longer(&setting, &state, &outcome.fit.train, horizon_s)
    };
    result.gap.horizons = before.iter().zip(&after).map(|(b, a)| (b.0, b.1, a.1)).collect();
    if !result.effects.is_empty() {
        let after = residual::maps(&setting, &state, &outcome.fit.all);
        result.maps_before = core::mem::replace(&mut result.maps, after.0);
        result.where_before = core::mem::replace(&mut result.r#where, after.1);
    }
    tell::parameters(&setting, &state, (&outcome.fit.all, &outcome.fit.covariance), &first, &mut result);
    decidability::decide(&mut result, undecidable, None);
    if result.verdict == Verdict::Unexplained {
        result.unknown = unknown::shape(&setting, &state, &outcome);
    }
    if result.verdict != Verdict::NotDecidable {
        result.model = Some(tell::model(&setting, &state, &result)?);
    }
    Ok(Some(result))
}

/// The last round: columns of the model and of the candidates, and the fit of the model's own.
struct Outcome {
    candidates: Vec<Candidate>,
    design: Design,
    weights: Weights,
    own: Vec<usize>,
    fit: Fit,
}

/// The state before anything is added; none where a nominal damping is not in the catalogue.
fn start(setting: &Setting<'_>, first: &Identification, physical: Physical) -> Option<State> {
    let file = setting.file()?;
    let of_file: Vec<String> = file.nominal.iter().map(|n| n.value.clone()).collect();
    // Written equations hold their dampings as terms.
    let names = setting.rig.nominal.as_ref().filter(|_| !setting.is_written()).unwrap_or(&of_file);
    let all = setting.candidates(&physical);
    let chosen: Vec<Chosen> = names
        .iter()
        .map(|n| {
            let candidate = all.iter().find(|c| c.name(setting) == *n)?.clone();
            Some(Chosen { strengths: vec![0.0; candidate.strengths()], candidate })
        })
        .collect::<Option<_>>()?;
    let value = |n: &String| first.parameter(n).map_or(0.0, |p| p.value);
    Some(State {
        values: setting.model().coefficients().iter().map(value).collect(),
        physical,
        dampings: chosen.len(),
        nominal: chosen.len(),
        chosen,
        stretches: setting.raw.clone(),
    })
}

/// What is told of the record whatever comes.
fn describe(setting: &Setting<'_>, state: &State, result: &mut Explanation) {
    let window_s = setting.geometry.windows.length_s;
    result.gap.motion = state.on_track(setting, |t| prediction::motion(t, result.gap.horizon_s, window_s));
    result.gap.floor_in = told::Unit::of(setting.rig, setting.whole).noise(&setting.sensors.sigma);
    let sigma = |k: usize| setting.sensors.sigma.get(k).copied().unwrap_or(0.0);
    result.details = Details {
        samples: setting.raw.iter().map(crate::identify::general::stretches::Stretch::len).sum(),
        window_s,
        max_frequency_hz: setting.geometry.windows.frequencies as f64 / window_s,
        pass_hz: setting.geometry.kernels.full.pass_hz,
        noise_rad: [sigma(0), sigma(1)],
        family_wise: decision::FAMILY_WISE,
        folds: ranking::FOLDS,
    };
}

/// Whole windows in the record.
fn whole_windows(setting: &Setting<'_>) -> usize {
    let window_s = setting.geometry.windows.length_s;
    setting.raw.iter().map(|s| (s.len() as f64 * s.step_s / window_s) as usize).sum()
}

/// Why this record cannot decide, if it cannot.
fn undecidable(setting: &Setting<'_>, records: &[Record]) -> Option<String> {
    let window_s = setting.geometry.windows.length_s;
    let blocks = whole_windows(setting);
    if !records.is_empty() && records.iter().all(|r| locked(r, setting.rig)) {
        return Some(LOCKED.to_owned());
    }
    (blocks < FEWEST_BLOCKS).then(|| decidability::too_few(blocks, window_s))
}

/// Fits everything chosen, renews what rests on the coefficients, and builds the candidates' columns behind its own.
fn refit(setting: &Setting<'_>, state: &mut State, candidates: Vec<Candidate>) -> Result<Outcome> {
    let mut weights: Option<Weights> = None;
    // The first rounds settle weights, linearised effects and forms; the last carries the candidates' columns as well.
    let rounds = if state.chosen.iter().any(|k| k.candidate.is_refined()) { 4 } else { 2 };
    for _ in 1..rounds {
        let own: Vec<usize> = (0..state.own_columns()).collect();
        let design = design::build(setting, state, &state.stretches, &[])?;
        let used = weights.clone().unwrap_or_else(|| ranking::equal_weights(&design));
        let fit = ranking::fit(&design, &own, &used).ok_or_else(singular)?;
        // Weights from an unweighted fit are rough: once more.
        let w = ranking::weights(&design, &own, &fit.all);
        let fit = ranking::fit(&design, &own, &w).ok_or_else(singular)?;
        weights = Some(ranking::weights(&design, &own, &fit.all));
        state.take(setting, &fit.all);
        state.renew(setting, &fit.all, &fit.covariance);
    }
    let own: Vec<usize> = (0..state.own_columns()).collect();
    let further: Vec<&Candidate> = candidates.iter().collect();
    let design = design::build(setting, state, &state.stretches, &further)?;
    let used = weights.unwrap_or_else(|| ranking::equal_weights(&design));
    let fit = ranking::fit(&design, &own, &used).ok_or_else(singular)?;
    let weights = ranking::weights(&design, &own, &fit.all);
    let fit = ranking::fit(&design, &own, &weights).ok_or_else(singular)?;
    Ok(Outcome { candidates, design, weights, own, fit })
}

/// The next effect and what is told of it.
fn choose(
    setting: &Setting<'_>,
    state: &State,
    outcome: &Outcome,
    step: usize,
    result: &mut Explanation,
) -> Option<(Found, Candidate)> {
    let Outcome { candidates, design, weights, own, fit } = outcome;
    let taken: Vec<String> = state.chosen.iter().map(|k| k.candidate.name(setting)).collect();
    let offers: Vec<Offer> = candidates
        .iter()
        .map(|c| Offer {
            name: c.name(setting),
            strengths: c.strengths(),
            positive: c.entry.positive[0],
            shapes: c.form.len(),
        })
        .collect();
    let feigned =
        |k: usize, with: &Fit| power::feigned(setting, state, (design, weights, &fit.all), &candidates[k], with);
    let Choice { index, fit, p_value, share, twins, runner_up } =
        decision::choose((design, own, weights), &offers, &taken, step, &mut result.ranking, &feigned)?;
    let candidate = &candidates[index];
    let d = candidate.strengths();
    let from = fit.all.len() - d;
    let strengths: Vec<f64> = fit.all.rows(from, d).iter().copied().collect();
    let covariance = fit.covariance.view((from, from), (d, d)).into_owned();
    let reported = tell::value(setting, &state.physical, candidate, &strengths, &covariance);
    let found = Found {
        p_value,
        held_out_gain: share,
        indistinguishable_from: twins,
        runner_up,
        ..tell::found(setting, candidate, reported)
    };
    Some((found, candidate.clone()))
}

/// The gap of the model with coefficients `x`.
fn gap(setting: &Setting<'_>, state: &State, x: &nalgebra::DVector<f64>, horizon_s: f64) -> f64 {
    let Some((motion, parameters)) = state.motion(setting, x) else { return f64::NAN };
    let block_s = setting.geometry.windows.length_s;
    // A search for the step would follow every jump of a law; an instant off by half of this changes nothing that sensors see.
    let step_s = setting.raw.first().map(|s| s.step_s.min(STEP * shortest_horizon(setting)));
    let horizons = (horizon_s, block_s);
    state.on_track(setting, |track| prediction::gap_with(&motion, &parameters, track, horizons, step_s))
}

/// The shortest horizon, s: a drive's period.
fn shortest_horizon(setting: &Setting<'_>) -> f64 {
    setting.rig.drive.map_or(0.2, |d| 1.0 / d.frequency_hz)
}

/// The same at longer horizons.
fn longer(setting: &Setting<'_>, state: &State, x: &nalgebra::DVector<f64>, horizon_s: f64) -> Vec<(f64, f64)> {
    LONGER
        .iter()
        .map(|f| f * horizon_s)
        .filter(|h| *h <= setting.geometry.windows.length_s)
        .map(|h| (h, gap(setting, state, x, h)))
        .collect()
}
