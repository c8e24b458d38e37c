//! Where simulation and measurement disagree, which physical effect is missing, and the model with it.
//!
//! 1. The nominal model (B terms and the rig's nominal dampings, with the ties that a torque in a joint obeys) is fitted by the weak form.
//! 2. Every effect of [`effects::EFFECTS`] at every place is added in turn, everything refitted, and judged on blocks of the record that were not
//!    fitted ([`ranking`]). Among those that are significant over the whole list (family-wise 1 %), the simplest within a standard error of the greatest
//!    held-out gain is added; others that held-out data cannot tell from it are named with it. This repeats until nothing more is supported.
//! 3. The gap ([`gap`]) before and after each step, on held-out blocks, in units of the sensors' noise.
//!    A model that leaves more than noise is refitted by multiple shooting ([`shooting`]) before it is measured.
//! 4. What is left is compared with what the sensors' noise alone leaves in the same rows, located ([`residual_map`]), and, where it
//!    has no name, drawn as a function of one coordinate ([`unknown`]).

pub mod artefact;
mod attractor;
mod comparison;
mod decidability;
mod decision;
pub mod design;
pub mod effects;
pub mod engine;
mod explanation;
pub mod forward;
pub mod gap;
mod given;
pub mod ledger;
mod naming;
mod parameters;
mod patched;
pub mod presentation;
pub mod ranking;
pub mod residual_map;
pub mod shooting;
pub mod single_pendulum;
mod state;
mod suspected;
pub mod unknown;

use serde::Serialize;

use self::comparison::{Comparison, Measured};
use self::decidability::EXPLAINED_GAP;
use self::explanation::InUnit;
use self::naming::{choose, refit};
use self::state::{Candidate, Chosen, State, candidates, start};
use crate::error::{BadInput, Result};
use crate::identify::known_quantities::CONTRADICTED;
use crate::identify::{self, Geometry, Prepared, Settings as IdentifySettings};
use crate::model::identified::IdentifiedModel;
use crate::record::Record;
use crate::rig::Rig;
use crate::signal::angles::AngleSegment;
use crate::warning::Warning;

pub use self::explanation::{Details, Explanation, Forecast, Found, Gap, Ranked, Step, Verdict};

/// Most effects that are added.
const MOST_EFFECTS: usize = 8;
/// Least share of the gap that an effect must take away while the gap is above [`EXPLAINED_GAP`].
const LEAST_PROGRESS: f64 = 0.03;
/// Longest part of a record that is used, windows.
const MOST_WINDOWS: f64 = 300.0;

/// Choices.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Settings {
    /// Horizon of the gap, s; by default one drive period, 0.2 s when free.
    pub horizon_s: Option<f64>,
    /// Horizons of the forecasts, s: the first 70 % of the record is fitted, the last 30 % predicted. By default 1 and 4 of the gap's, 1 and 40/3 (2.667 s) when free.
    pub forecast_s: Vec<f64>,
    /// Most effects that are added; 8 by default.
    pub most_effects: Option<usize>,
    /// A model to start from, instead of the rig file's nominal one.
    pub model: Option<IdentifiedModel>,
}

/// Explains one or several records of the same rig; a mistake in the record or the rig file that the equations show is told first.
///
/// # Errors
/// As [`identify::identify`]; a `model` that is not of this rig.
pub fn explain(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Explanation> {
    let of_record: Vec<Warning> = records.iter().flat_map(|r| &r.warnings).filter(|w| w.invalidates).cloned().collect();
    let suspects = identify::suspects::examine(records, rig);
    let mut result = if !of_record.is_empty() || suspects.iter().any(suspected::grave) {
        // No effect is looked for where one would be dressed up.
        let settings = Settings { most_effects: Some(0), ..settings.clone() };
        any_system(records, rig, &settings).unwrap_or_else(|_| {
            let period_s = rig.drive.map_or(0.2, |d| 1.0 / d.frequency_hz);
            Explanation::new(settings.horizon_s.unwrap_or(period_s), Vec::new())
        })
    } else {
        any_system(records, rig, settings)?
    };
    if !of_record.is_empty() {
        // Nothing that was computed from it says anything.
        result.warnings.retain(|w| w.id != CONTRADICTED && !of_record.contains(w));
        result.gap.attractor.clear();
        result.gap.forecasts.clear();
    }
    suspected::tell_in(&mut result, of_record.into_iter().chain(suspects).collect());
    Ok(result)
}

/// Explains records of a system in its way.
fn any_system(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Explanation> {
    if let Some(bound) = &rig.bound {
        return engine::explain(records, rig, bound, settings).map(|r| r.unwrap_or_else(decidability::unplaced));
    }
    if rig.model == "single-pendulum" {
        return single_pendulum::explain(records, rig, settings);
    }
    let first = identify::weak_form(records, rig, &IdentifySettings::default())?;
    let Prepared { segments, sigma, geometry, warnings } =
        identify::prepare(records, rig, &IdentifySettings::default())?;
    let raw = shorten(segments, &geometry);
    let horizon_s = horizon(rig, settings, &geometry)?;
    let mut state = start(rig, &first, &raw)?;
    let comparison = Comparison::new(&raw, &geometry, sigma, horizon_s, rig.drive.is_some(), settings);
    let undecidable = decidability::undecidable(records, rig, &first, &comparison);
    let mut result = Explanation::new(horizon_s, warnings);
    result.warnings.extend(first.warnings.iter().filter(|w| w.id == CONTRADICTED).cloned());
    result.gap.motion = comparison.motion();
    let noise = (0.5 * (sigma[0] * sigma[0] + sigma[1] * sigma[1])).sqrt().to_degrees();
    result.gap.floor_in = Some(InUnit { value: noise, unit: "°".to_owned() });
    result.details = Details {
        samples: raw.iter().map(AngleSegment::len).sum(),
        window_s: geometry.windows.length_s,
        max_frequency_hz: geometry.windows.frequencies as f64 / geometry.windows.length_s,
        pass_hz: geometry.kernels.full.pass_hz,
        noise_rad: sigma,
        family_wise: decision::FAMILY_WISE,
        folds: ranking::FOLDS,
    };
    let window_s = geometry.windows.length_s;
    let whole: usize = raw.iter().map(|s| (s.len() as f64 * s.step_s / window_s) as usize).sum();
    if whole < ranking::FOLDS {
        return Ok(decidability::too_short(result, whole, window_s));
    }
    if let Some(model) = &settings.model {
        given::take(&mut state, model, rig)?;
        let as_given = given::measure(&state, model, &comparison);
        result.gap.push(None, &as_given);
    }
    let mut before = None;
    let mut found: Vec<Found> = Vec::new();
    let mut kept: Option<(State, Outcome)> = None;
    let outcome = loop {
        let step = found.len();
        let variants: Vec<Candidate> = candidates(&state.context);
        let (design, weights, own) = refit(&mut state, &raw, &geometry, &variants)?;
        let fit = ranking::fit(&design, &own, &weights).ok_or_else(singular)?;
        let measured = comparison.measure(&state, &design, &weights, &own, &fit)?;
        // A wrong model makes many effects look significant: each must also bring predictions nearer, or it goes again.
        let previous = result.gap.steps.last().map_or(f64::INFINITY, |s| s.value);
        if measured.gap > (1.0 - LEAST_PROGRESS) * previous
            && previous > EXPLAINED_GAP
            && let Some((better, outcome)) = kept.take()
        {
            let _ = found.pop();
            state = better;
            break outcome;
        }
        let added = match found.last() {
            Some(f) => Some(format!("{}@{}", f.id, f.at)),
            None => settings.model.is_some().then(|| "refit".to_owned()),
        };
        result.gap.push(added, &measured);
        let power = residual_map::power(&state, &design, &own, &fit.all, &geometry, sigma);
        if step == 0 {
            result.residual_power[0] = power.ratio;
            (result.maps, result.r#where) = places(&state, &fit.all, &power, &geometry, sigma);
            before = Some(comparison.longer(&state, &measured.x));
            result.gap.attractor.push(attractor::measure(&state, &measured.x, &comparison));
        }
        result.residual_power[1] = power.ratio;
        let outcome = Outcome { design, weights, own, fit, measured, power };
        let last = undecidable.is_some() || step == settings.most_effects.unwrap_or(MOST_EFFECTS);
        let next = if last {
            None
        } else {
            choose(&state, &outcome, (&geometry, sigma), &variants, step, &mut result.ranking)
        };
        let Some(next) = next else { break outcome };
        found.push(next.found);
        kept = Some((state.clone(), outcome));
        let candidate = variants.into_iter().nth(next.index).ok_or_else(singular)?;
        let joined = Chosen::new(&state.context, candidate);
        state.chosen.push(joined);
    };
    let before = before.unwrap_or_default();
    let after = if found.is_empty() { before.clone() } else { comparison.longer(&state, &outcome.measured.x) };
    if !found.is_empty() {
        result.gap.attractor.push(attractor::measure(&state, &outcome.measured.x, &comparison));
    }
    result.gap.horizons = before.iter().zip(&after).map(|(before, after)| (before.0, before.1, after.1)).collect();
    parameters::read(&state, &outcome, &first, &mut found, &mut result);
    if !found.is_empty() {
        let after = places(&state, &outcome.fit.all, &outcome.power, &geometry, sigma);
        result.maps_before = core::mem::replace(&mut result.maps, after.0);
        result.where_before = core::mem::replace(&mut result.r#where, after.1);
    }
    result.effects = found;
    decidability::decide(&mut result, undecidable, patched::patched(&state, &outcome));
    if result.verdict == Verdict::Unexplained {
        result.unknown = unknown::shape(&state, &geometry, &outcome);
    }
    if result.verdict != Verdict::NotDecidable {
        result.model = Some(parameters::model(&state, rig, &result));
    }
    Ok(result)
}

/// Where the model with coefficients `x` and the record disagree: maps, and the clearest places.
fn places(
    state: &State,
    x: &nalgebra::DVector<f64>,
    power: &residual_map::Power,
    geometry: &Geometry,
    sigma: [f64; 2],
) -> (Vec<residual_map::Map>, Vec<residual_map::Where>) {
    let (mut maps, mut places) = residual_map::maps(state, x, geometry, sigma);
    residual_map::add_frequencies(&mut maps, &mut places, power, geometry, &state.context);
    (maps, places)
}

/// The last round: columns of the model, its fit, and what was measured with it.
struct Outcome {
    design: design::Design,
    weights: ranking::Weights,
    own: Vec<usize>,
    fit: ranking::Fit,
    measured: Measured,
    power: residual_map::Power,
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
