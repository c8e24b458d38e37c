//! Where simulation and measurement disagree, which physical effect is missing, and the model with it.
//!
//! 1. The nominal model (B terms and the rig's nominal dampings, with the ties that a torque in a joint obeys) is fitted by the weak form.
//! 2. Every effect of [`effects::EFFECTS`] at every place is added in turn, everything refitted, and judged on blocks of the record that were not
//!    fitted ([`ranking`]). Among those that are significant over the whole list (family-wise 1 %), the one with the greatest
//!    held-out gain is added; others that held-out data cannot tell from it are named with it. This repeats until nothing more is supported.
//! 3. The gap ([`gap`]) before and after each step, on held-out blocks, in units of the sensors' noise.
//! 4. What is left is compared with what the sensors' noise alone leaves in the same rows, and located ([`residual_map`]).

pub mod design;
pub mod effects;
mod explanation;
pub mod gap;
mod naming;
pub mod presentation;
pub mod ranking;
pub mod residual_map;
mod state;

use nalgebra::DVector;
use serde::Serialize;

use self::design::base_terms;
use self::naming::{choose, compose, refit};
use self::state::{Candidate, Chosen, State, candidates, start};
use crate::error::{BadInput, Result};
use crate::identify::{self, Geometry, Identification, Parameter, Prepared, Settings as IdentifySettings};
use crate::record::Record;
use crate::rig::Rig;
use crate::signal::angles::AngleSegment;

pub use self::explanation::{Explanation, Found, Gap, Ranked, Step, Verdict};

/// Most effects that are added.
const MOST_EFFECTS: usize = 5;
/// Gap (in noise floors) up to which a model counts as explaining the record.
const EXPLAINED_GAP: f64 = 1.3;
/// Ratio of residual to noise power in the rows up to which nothing counts as left.
const EXPLAINED_POWER: f64 = 2.0;
/// Horizons of the gap that count for the verdict, in units of the shortest: chaos makes longer ones show weaker effects.
const VERDICT_HORIZONS: f64 = 4.5;
/// Fewest whole windows for a decision: fewer leave the jackknife and the folds too little.
const FEWEST_BLOCKS: usize = 9;
/// Longest part of a record that is used, windows.
const MOST_WINDOWS: f64 = 300.0;

/// Choices.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Settings {
    /// Horizon of the gap, s; by default one drive period, 0.2 s when free.
    pub horizon_s: Option<f64>,
}

/// Explains one or several records of the same rig.
///
/// # Errors
/// As [`identify::identify`].
pub fn explain(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Explanation> {
    let first = identify::identify(records, rig, &IdentifySettings::default())?;
    let Prepared { segments, sigma, geometry, warnings } =
        identify::prepare(records, rig, &IdentifySettings::default())?;
    let raw = shorten(segments, &geometry);
    let horizon_s = horizon(rig, settings, &geometry)?;
    let mut state = start(rig, &first, &raw)?;
    let stretches = gap::stretches(&raw, &geometry, horizon_s);
    let mut result = Explanation {
        verdict: Verdict::NotDecidable,
        reason: String::new(),
        effects: Vec::new(),
        gap: Gap { unit: "noise floors", floor: 1.0, horizon_s, steps: Vec::new(), horizons: Vec::new() },
        r#where: Vec::new(),
        parameters: Vec::new(),
        residual_power: [f64::NAN; 2],
        ranking: Vec::new(),
        maps: Vec::new(),
        warnings,
    };
    let undecidable = undecidable(&first, &stretches, &raw, &geometry);
    let mut found: Vec<Found> = Vec::new();
    let mut longer_before = None;
    for step in 0..=MOST_EFFECTS {
        let variants: Vec<Candidate> = candidates(&state.context);
        let (design, weights, own) = refit(&mut state, &raw, &geometry, &variants)?;
        let train = ranking::fit(&design, &own, &weights).ok_or_else(singular)?;
        let model = gap::Model::of(&state, &train.train);
        result.gap.steps.push(Step {
            added: (step > 0).then(|| found.last().map(|f| format!("{}@{}", f.id, f.at))).flatten(),
            value: gap::gap(&state.context, &model, &raw, &stretches, sigma),
        });
        if step == 0 {
            longer_before = Some(longer_horizons(&state, &train.train, &raw, &geometry, horizon_s, sigma));
        }
        let power = residual_map::power(&state, &design, &own, &train.all, &geometry, sigma);
        result.residual_power[usize::from(step > 0)] = power;
        if step == 0 {
            result.residual_power[1] = power;
        }
        if undecidable.is_some() || step == MOST_EFFECTS {
            break;
        }
        let Some(next) = choose(&state, &design, &weights, &own, &variants, step, &mut result.ranking) else { break };
        found.push(next.found);
        let candidate = variants.into_iter().nth(next.index).ok_or_else(singular)?;
        let count = candidate.variant.action.len();
        state.chosen.push(Chosen { candidate, strengths: vec![0.0; count] });
    }
    finish(&mut state, &raw, &geometry, &first, &mut found, sigma, &mut result)?;
    if let Some(before) = longer_before {
        let (design, weights, own) = refit(&mut state, &raw, &geometry, &[])?;
        let train = ranking::fit(&design, &own, &weights).ok_or_else(singular)?;
        let after = longer_horizons(&state, &train.train, &raw, &geometry, horizon_s, sigma);
        result.gap.horizons = before.iter().zip(&after).map(|(b, a)| (b.0, b.1, a.1)).collect();
    }
    let gap_after = result.gap.steps.last().map_or(f64::NAN, |s| s.value);
    let power = result.residual_power[1];
    result.effects = found;
    let far =
        result.gap.horizons.iter().filter(|h| h.0 <= VERDICT_HORIZONS * horizon_s).map(|h| h.2).fold(0.0, f64::max);
    let left = gap_after > EXPLAINED_GAP || far > EXPLAINED_GAP || power > EXPLAINED_POWER;
    let noise = format!(
        "what is left has {power:.2} times the power that the sensors' noise gives, and predictions over {horizon_s:.3} s miss by {gap_after:.2} noise floors"
    );
    (result.verdict, result.reason) = match (undecidable, left, result.effects.is_empty()) {
        (Some(reason), ..) => {
            result.effects.clear();
            (Verdict::NotDecidable, reason)
        }
        (None, true, _) => (Verdict::Unexplained, format!("{noise}; no effect of the list accounts for it")),
        (None, false, true) => (Verdict::NothingMissing, noise),
        (None, false, false) => (Verdict::Explained, noise),
    };
    Ok(result)
}

fn singular() -> BadInput {
    BadInput::new("a record that does not determine the nominal model", "motion in which every term takes part")
        .remedy("See `whirl identify` for the terms that are missing")
}

/// The first part of a long record: explanations need no more.
fn shorten(segments: Vec<AngleSegment>, geometry: &Geometry) -> Vec<AngleSegment> {
    let mut left = geometry.windows.hop_s * MOST_WINDOWS;
    let mut out = Vec::new();
    for s in segments {
        let n = ((left / s.step_s) as usize).min(s.len());
        if n == 0 {
            break;
        }
        left -= n as f64 * s.step_s;
        out.push(if n < s.len() { s.part(0, n) } else { s });
    }
    out
}

/// Horizon of the gap.
fn horizon(rig: &Rig, settings: &Settings, geometry: &Geometry) -> Result<f64> {
    let default = rig.drive.map_or(0.2, |d| 1.0 / d.frequency_hz);
    let step = 1.0 / rig.sample_rate_hz;
    match settings.horizon_s {
        Some(h) if !(h >= 8.0 * step && h <= geometry.windows.length_s) => {
            Err(BadInput::new(h.to_string(), format!("seconds from {} to {}", 8.0 * step, geometry.windows.length_s))
                .at("--horizon"))
        }
        h => Ok(h.unwrap_or(default).min(geometry.windows.length_s)),
    }
}

/// Why this record cannot decide, if it cannot.
fn undecidable(
    first: &Identification,
    stretches: &[gap::Stretch],
    raw: &[AngleSegment],
    geometry: &Geometry,
) -> Option<String> {
    let blocks: usize = raw.iter().map(|s| (s.len() as f64 * s.step_s / geometry.windows.length_s) as usize).sum();
    if first.details.repetition > 0.2 {
        return Some("the motion repeats (locked to the drive): one orbit cannot tell effects apart. Change the drive until the motion is chaotic".to_owned());
    }
    if blocks < FEWEST_BLOCKS || stretches.is_empty() {
        return Some(format!(
            "{blocks} windows of {} s are too few to hold some back: record at least {} s",
            geometry.windows.length_s,
            geometry.windows.length_s * (FEWEST_BLOCKS + 1) as f64
        ));
    }
    if first.details.condition.iter().any(|k| *k > 30.0) {
        return Some("the motion does not visit enough of the state space: the nominal coefficients themselves are hardly separable".to_owned());
    }
    None
}

/// The last fit: values of all effects together, parameters, maps of what is left.
fn finish(
    state: &mut State,
    raw: &[AngleSegment],
    geometry: &Geometry,
    first: &Identification,
    found: &mut [Found],
    sigma: [f64; 2],
    result: &mut Explanation,
) -> Result<()> {
    let (design, weights, own) = refit(state, raw, geometry, &[])?;
    let fit = ranking::fit(&design, &own, &weights).ok_or_else(singular)?;
    let n = base_terms(state.context.driven);
    let deviation = |i: usize| fit.covariance[(i, i)].max(0.0).sqrt();
    for i in 0..2 {
        for j in 0..n {
            let name = format!("B{}{}", i + 1, j + 1);
            let unit = first.parameter(&name).map_or_else(|| "1".to_owned(), |p| p.unit.clone());
            result.parameters.push(Parameter {
                name,
                value: fit.all[i * n + j],
                std_error: deviation(i * n + j),
                unit,
            });
        }
    }
    let mut at = 2 * n;
    let mut effect = found.iter_mut();
    for (index, k) in state.chosen.iter().enumerate() {
        let d = k.strengths.len();
        let applied = k.candidate.variant.action.is_applied();
        let strengths: Vec<f64> =
            (0..d).map(|i| fit.all[at + i] + if applied { k.strengths[i] } else { 0.0 }).collect();
        let covariance = fit.covariance.view((at, at), (d, d)).into_owned();
        let (value, std_error, parameters, unit) = compose(&state.context, &k.candidate, &strengths, &covariance);
        if index >= state.nominal
            && let Some(f) = effect.next()
        {
            (f.value, f.std_error, f.parameters, f.unit) = (value, std_error, parameters, unit.clone());
        }
        result.parameters.push(Parameter { name: k.candidate.name(), value, std_error, unit });
        at += d;
    }
    (result.maps, result.r#where) = residual_map::maps(state, &fit.all, geometry, sigma);
    Ok(())
}

/// The gap at longer horizons.
fn longer_horizons(
    state: &State,
    train: &DVector<f64>,
    raw: &[AngleSegment],
    geometry: &Geometry,
    horizon_s: f64,
    sigma: [f64; 2],
) -> Vec<(f64, f64)> {
    [2.0, 4.0, 8.0]
        .iter()
        .map(|f| f * horizon_s)
        .filter(|h| *h <= geometry.windows.length_s)
        .map(|h| {
            let model = gap::Model::of(state, train);
            let all = gap::stretches(raw, geometry, h);
            let stride = all.len().div_ceil(40).max(1);
            let some: Vec<gap::Stretch> = all.into_iter().step_by(stride).collect();
            (h, gap::gap(&state.context, &model, raw, &some, sigma))
        })
        .collect()
}
