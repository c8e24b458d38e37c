//! Explanations for any system of bodies or written equations: every effect of the catalogue at every joint, arm, encoder, at its drive and frame.
//!
//! The equations without dampings and the nominal dampings, tied over the
//! equations, are fitted, under a drive by the weak form, otherwise by shooting (`shooting`); every candidate is added in turn and judged on blocks that were not fitted
//! (`crate::explain::decision`); the best is added until nothing more is supported. Effects of sensors and of the drive's phase are taken
//! off the record, which is then read again.
//!
//! | file | what |
//! |---|---|
//! | `setting` | the record, its sensors, the system |
//! | `candidates` | effects at their places, their columns |
//! | `state` | coefficients and what was added |
//! | `design` | columns over all windows of the weak form |
//! | `shooting` | columns of trajectories |
//! | `evidence` | one fit and one choice over either |
//! | `simulation` | free runs beyond what was fitted |
//! | `correct` | sensor effects taken off |
//! | `given` | a model to start from or to predict with |
//! | `prediction` | the gap, free runs |
//! | `power` | what noise alone leaves, what sensors alone feign |
//! | `residual` | where what is left sits |
//! | `tell`, `units` | values, units, the model |
//! | `unknown` | the shape of what has no name |

mod candidates;
mod correct;
mod design;
mod evidence;
pub mod given;
mod power;
mod prediction;
mod residual;
mod setting;
mod shooting;
pub mod simulation;
mod state;
mod tell;
mod units;
mod unknown;

use self::candidates::Candidate;
use self::evidence::{Outcome, refit};
use self::setting::{Begun, Physical, Setting};
use self::state::{Chosen, State};
use super::decidability::{self, EXPLAINED_GAP, FEWEST_BLOCKS, LOCKED, locked};
use super::decision::{self, Choice, Offer};
use super::explanation::{Details, Explanation, Found, Step, Verdict};
use super::ranking::{self, Fit};
use super::{LEAST_PROGRESS, MOST_EFFECTS, MOST_WINDOWS, Settings};
use crate::error::Result;
use crate::identify::Identification;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::Bound;

/// Step of integration as a share of the shortest horizon: 1e-8 of a smooth motion with a method of fifth order.
const STEP: f64 = 0.01;
/// Share by which what a law without a shape leaves may exceed what one with a shape does.
const AS_LITTLE: f64 = 0.01;
/// Standard errors from nothing at which a name stands.
const CLEAR: f64 = 2.0;
/// Share of its promise at a strength of nothing that an effect must keep.
const LEAST_KEPT: f64 = 0.5;
/// Longer horizons of the gap, in units of the shortest.
const LONGER: [f64; 3] = [2.0, 4.0, 8.0];

/// Explains records of a rig with a system of its own; none where effects find no place in its equations.
///
/// # Errors
/// As [`crate::identify::identify`].
pub fn explain(records: &[Record], rig: &Rig, whole: &Bound, settings: &Settings) -> Result<Option<Explanation>> {
    let Some(Begun { mut setting, first, physical, warnings }) = Setting::begin(records, rig, whole, MOST_WINDOWS)?
    else {
        return Ok(None);
    };
    let Some(mut state) = start(&setting, &first, physical) else { return Ok(None) };
    let mut result = Explanation::new(units::horizon(rig, settings, &setting.raw)?, warnings);
    let shortest = setting.geometry.windows.length_s;
    if whole_windows(&setting, &state).0 < ranking::FOLDS {
        return Ok(Some(decidability::too_short(result, whole_windows(&setting, &state).0, shortest)));
    }
    if let Some(model) = &settings.model {
        given::take(&setting, &mut state, model)?;
    }
    if setting.shooting && shooting::settle(&setting, &mut state).is_none() {
        // What no window can be followed in is left to the balance of forces.
        setting.shooting = false;
        if setting.own.names.len() > setting.model().coefficients().len() {
            result.reason = decidability::UNFOLLOWED.to_owned();
            return Ok(Some(result));
        }
    }
    let (blocks, window_s) = whole_windows(&setting, &state);
    result.gap.horizon_s = result.gap.horizon_s.min(window_s);
    let horizon_s = result.gap.horizon_s;
    describe(&setting, &state, window_s, &mut result);
    let undecidable = undecidable(&setting, records, (blocks, window_s));
    if settings.model.is_some() {
        let value = gap(&setting, &state, &given::coefficients(&state), (horizon_s, window_s));
        result.gap.steps.push(Step { added: None, value });
    }
    let most = if undecidable.is_some() { 0 } else { settings.most_effects.unwrap_or(MOST_EFFECTS) };
    let refitted = || settings.model.is_some().then(|| "refit".to_owned());
    let mut search = Search { most, refused: Vec::new(), kept: None };
    let mut simulations = simulation::open(&setting);
    let mut before = Vec::new();
    let outcome = loop {
        let step = result.effects.len();
        let candidates = setting.candidates(&state.physical);
        let outcome = refit(&setting, &mut state, candidates);
        let fit = outcome.as_ref().ok().map(|o| &o.fit.train);
        let value = fit.map_or(f64::NAN, |x| gap(&setting, &state, x, (horizon_s, window_s)));
        let kept = step == 0 || search.keeps(outcome.as_ref().ok(), value, &result);
        let outcome = match (kept, search.kept.take()) {
            (false, Some((better, outcome))) => {
                let name = result.effects.pop().map(|f| format!("{}@{}", f.id, f.at));
                search.refused.extend(name);
                state = better;
                if !setting.shooting {
                    break outcome;
                }
                outcome
            }
            _ => {
                let outcome = outcome?;
                let added = result.effects.last().map(|f| format!("{}@{}", f.id, f.at)).or_else(refitted);
                result.gap.steps.push(Step { added: added.clone(), value });
                result.residual_power[1] = outcome.power(&setting, &state)?;
                if step == 0 {
                    result.residual_power[0] = result.residual_power[1];
                    (result.maps, result.r#where) = residual::maps(&setting, &state, &outcome.fit.all);
                    before = longer(&setting, &state, &outcome.fit.train, (horizon_s, window_s));
                    simulation::measure(&setting, &state, &outcome, added, &mut simulations);
                }
                outcome
            }
        };
        let last = result.effects.len() >= search.most;
        let next = if last { None } else { choose(&setting, &state, &outcome, &search.refused, &mut result) };
        let Some((found, candidate)) = next else { break outcome };
        let (found, candidate) = simpler(&setting, &state, &outcome, found, candidate);
        result.effects.push(found);
        search.kept = Some((state.clone(), outcome));
        let joined = Chosen::new(&setting, candidate, &state.physical);
        state.chosen.push(joined);
    };
    let outcome = without_traces(&setting, &mut state, outcome, (horizon_s, window_s), &mut result)?;
    let x = &outcome.fit.train;
    let none = result.effects.is_empty();
    let after = if none { before.clone() } else { longer(&setting, &state, x, (horizon_s, window_s)) };
    result.gap.horizons = before.iter().zip(&after).map(|(b, a)| (b.0, b.1, a.1)).collect();
    if !none {
        let after = residual::maps(&setting, &state, &outcome.fit.all);
        result.maps_before = core::mem::replace(&mut result.maps, after.0);
        result.where_before = core::mem::replace(&mut result.r#where, after.1);
        let added = result.effects.last().map(|f| format!("{}@{}", f.id, f.at));
        simulation::measure(&setting, &state, &outcome, added, &mut simulations);
    }
    result.simulation = simulations;
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

/// Of a law with a shape and one without at the same place, which held-out data do not tell apart to first order, the one without where it leaves as little when
/// everything is refitted: Stribeck's friction at a velocity beyond the motion is Coulomb's.
fn simpler(
    setting: &Setting<'_>,
    state: &State,
    outcome: &Outcome,
    mut found: Found,
    candidate: Candidate,
) -> (Found, Candidate) {
    if !setting.shooting || candidate.refined_shape().is_none() {
        return (found, candidate);
    }
    let plain = |c: &&Candidate| {
        c.form.is_empty() && c.place == candidate.place && found.indistinguishable_from.contains(&c.name(setting))
    };
    let Some(other) = outcome.candidates.iter().find(plain).cloned() else { return (found, candidate) };
    let left = |c: &Candidate| {
        let mut trial = state.clone();
        trial.chosen.push(Chosen::new(setting, c.clone(), &state.physical));
        refit(setting, &mut trial, Vec::new()).ok().and_then(|o| o.left())
    };
    match (left(&candidate), left(&other)) {
        (Some(shaped), Some(plain)) if plain <= (1.0 + AS_LITTLE) * shaped => {
            let name = other.name(setting);
            for twin in found.indistinguishable_from.iter_mut().filter(|t| **t == name) {
                *twin = candidate.name(setting);
            }
            (found.id, found.equation) = (other.entry.id.clone(), other.entry.equation.clone());
            found.confirm.clone_from(&other.entry.confirm);
            (found, other)
        }
        _ => (found, candidate),
    }
}

/// The effect that is furthest from being anything, if one is within [`CLEAR`] standard errors of nothing.
fn without_trace(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<usize> {
    let mut at = state.values.len();
    let mut weakest: Option<(usize, f64)> = None;
    for (k, chosen) in state.chosen.iter().enumerate() {
        // What is found as an increment has its strength in the state.
        let applied = if chosen.candidate.is_applied() { 1.0 } else { 0.0 };
        let clear = (0..chosen.candidate.entry.strengths.len()).map(|i| {
            let error = outcome.fit.covariance[(at + i, at + i)].max(0.0).sqrt();
            (outcome.fit.all[at + i] + applied * chosen.strengths[i]).abs() / error.max(f64::MIN_POSITIVE)
        });
        let clear = clear.fold(0.0, f64::max);
        at += chosen.strengths.len();
        if k >= state.nominal && clear < CLEAR && weakest.is_none_or(|w| clear < w.1) {
            weakest = Some((k, clear));
        }
    }
    weakest.map(|w| w.0).filter(|_| setting.shooting)
}

/// Takes effects away again that beside those found after them are nothing: no name stands whose strengths are within two standard errors of none.
fn without_traces(
    setting: &Setting<'_>,
    state: &mut State,
    mut outcome: Outcome,
    horizons: (f64, f64),
    result: &mut Explanation,
) -> Result<Outcome> {
    while let Some(k) = without_trace(setting, state, &outcome) {
        let _ = state.chosen.remove(k);
        let gone = result.effects.remove(k - state.nominal);
        let name = format!("{}@{}", gone.id, gone.at);
        result.gap.steps.retain(|s| s.added.as_ref() != Some(&name));
        state.stretches = state.taken_off(setting, &setting.raw);
        outcome = refit(setting, state, Vec::new())?;
        let value = gap(setting, state, &outcome.fit.train, horizons);
        if let Some(last) = result.gap.steps.last_mut() {
            last.value = value;
        }
        result.residual_power[1] = outcome.power(setting, state)?;
    }
    Ok(outcome)
}

/// Where the search for effects stands.
struct Search {
    most: usize,
    /// Effects that did not keep what they promised.
    refused: Vec<String>,
    /// The state before the last effect was added, and its fit.
    kept: Option<(State, Outcome)>,
}

impl Search {
    /// Whether the last effect stays: a wrong model makes many look significant, each must also bring predictions nearer.
    fn keeps(&self, after: Option<&Outcome>, gap: f64, result: &Explanation) -> bool {
        let (Some((_, before)), Some(after)) = (&self.kept, after) else { return false };
        match (before.left(), after.left()) {
            (Some(b), Some(a)) => {
                let promised = result.effects.last().map_or(0.0, |f| f.held_out_gain);
                a < (1.0 - LEAST_KEPT * promised.max(0.0)) * b
            }
            _ => {
                let previous = result.gap.steps.last().map_or(f64::INFINITY, |s| s.value);
                gap <= (1.0 - LEAST_PROGRESS) * previous || previous <= EXPLAINED_GAP
            }
        }
    }
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
        values: setting.own.names.iter().map(value).collect(),
        physical,
        dampings: chosen.len(),
        nominal: chosen.len(),
        chosen,
        stretches: setting.raw.clone(),
        followed: None,
    })
}

/// What is told of the record whatever comes.
fn describe(setting: &Setting<'_>, state: &State, window_s: f64, result: &mut Explanation) {
    result.gap.motion = state.on_track(setting, |t| prediction::motion(t, result.gap.horizon_s, window_s));
    result.gap.floor_in = units::Unit::of(setting.rig, setting.whole).noise(&setting.sensors.sigma);
    let sigma = |k: usize| setting.sensors.sigma.get(k).copied().unwrap_or(0.0);
    let weak_s = setting.geometry.windows.length_s;
    result.details = Details {
        samples: setting.raw.iter().map(crate::identify::general::stretches::Stretch::len).sum(),
        window_s,
        max_frequency_hz: setting.geometry.windows.frequencies as f64 / weak_s,
        pass_hz: setting.geometry.kernels.full.pass_hz,
        noise_rad: [sigma(0), sigma(1)],
        family_wise: decision::FAMILY_WISE,
        folds: ranking::FOLDS,
    };
}

/// Whole windows in the record, and their length, s.
fn whole_windows(setting: &Setting<'_>, state: &State) -> (usize, f64) {
    if let (true, Some(followed)) = (setting.shooting, &state.followed) {
        return followed.windows(setting);
    }
    let window_s = setting.geometry.windows.length_s;
    (setting.raw.iter().map(|s| (s.len() as f64 * s.step_s / window_s) as usize).sum(), window_s)
}

/// Why this record cannot decide, if it cannot.
fn undecidable(setting: &Setting<'_>, records: &[Record], (blocks, window_s): (usize, f64)) -> Option<String> {
    if !records.is_empty() && records.iter().all(|r| locked(r, setting.rig)) {
        return Some(LOCKED.to_owned());
    }
    (blocks < FEWEST_BLOCKS).then(|| decidability::too_few(blocks, window_s))
}

/// The next effect and what is told of it.
fn choose(
    setting: &Setting<'_>,
    state: &State,
    outcome: &Outcome,
    refused: &[String],
    result: &mut Explanation,
) -> Option<(Found, Candidate)> {
    let step = result.effects.len();
    // A step that is chosen for again, after its effect was refused, is told once.
    result.ranking.retain(|r| r.step != step);
    let Outcome { candidates, evidence, own, fit } = outcome;
    let taken: Vec<String> =
        state.chosen.iter().map(|k| k.candidate.name(setting)).chain(refused.iter().cloned()).collect();
    let offers: Vec<Offer> = candidates
        .iter()
        .map(|c| Offer {
            name: c.name(setting),
            strengths: c.strengths(),
            positive: c.entry.positive[0],
            shapes: c.form.len(),
            refines: c.entry.refines.as_ref().map(|r| format!("{r}@{}", c.place_name(setting))),
        })
        .collect();
    let feigned = |k: usize, with: &Fit| evidence.feigned(setting, state, &fit.all, &candidates[k], with);
    let judged = evidence.judged();
    let Choice { index, fit, p_value, share, twins, runner_up } =
        decision::choose((&*judged, own), &offers, &taken, step, &mut result.ranking, &feigned)?;
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
fn gap(setting: &Setting<'_>, state: &State, x: &nalgebra::DVector<f64>, (horizon_s, block_s): (f64, f64)) -> f64 {
    let Some((motion, parameters)) = state.motion(setting, x) else { return f64::NAN };
    // A search for the step would follow every jump of a law; an instant off by half of this changes nothing that sensors see.
    let shortest = setting.rig.drive.map_or(horizon_s, |d| 1.0 / d.frequency_hz);
    let step_s = setting.raw.first().map(|s| s.step_s.min(STEP * shortest));
    state.on_track(setting, |track| prediction::gap(&motion, &parameters, track, (horizon_s, block_s), step_s))
}

/// The same at longer horizons.
fn longer(
    setting: &Setting<'_>,
    state: &State,
    x: &nalgebra::DVector<f64>,
    (horizon_s, block_s): (f64, f64),
) -> Vec<(f64, f64)> {
    let all = LONGER.iter().map(|f| f * horizon_s).filter(|h| *h <= block_s);
    all.map(|h| (h, gap(setting, state, x, (h, block_s)))).collect()
}
