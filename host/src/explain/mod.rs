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
pub mod gap;
pub mod presentation;
pub mod ranking;
pub mod residual_map;

use std::collections::BTreeMap;

use nalgebra::DVector;
use rayon::prelude::*;
use serde::Serialize;

use self::design::{Design, base_terms};
use self::effects::{Action, Compose, Context, EFFECTS, Effect, Place, Scale, Variant};
use self::ranking::Weights;
use crate::error::{BadInput, Result};
use crate::identify::{self, Geometry, Identification, Parameter, Prepared, Settings as IdentifySettings};
use crate::record::Record;
use crate::rig::Rig;
use crate::signal::angles::AngleSegment;
use crate::warning::Warning;

/// Probability of naming anything on a record in which nothing is missing, over the whole list.
const FAMILY_WISE: f64 = 0.01;
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

/// The verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The nominal model leaves nothing but the sensors' noise, and no effect improves it.
    NothingMissing,
    /// With the named effects nothing but noise is left.
    Explained,
    /// A disagreement above the noise is left that no named effect accounts for.
    Unexplained,
    /// This record could not show most effects.
    NotDecidable,
}

/// An effect that was added.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// Effect.
    pub id: String,
    /// Place.
    pub at: String,
    /// Value.
    pub value: f64,
    /// Standard error.
    pub std_error: f64,
    /// Unit of both.
    pub unit: String,
    /// What it adds.
    pub equation: String,
    /// Parameters beyond the value.
    pub parameters: BTreeMap<String, f64>,
    /// Effects that held-out data do not tell from it, `ID@PLACE`.
    pub indistinguishable_from: Vec<String>,
    /// Probability of so large a strength by chance.
    pub p_value: f64,
    /// Share of the held-out weighted residual power that it took away.
    pub held_out_gain: f64,
    /// The next best candidate and its share, for the audit.
    pub runner_up: Option<(String, f64)>,
    /// The laboratory test that would confirm it.
    pub confirm: String,
}

/// One step of the gap.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Step {
    /// What was added; none for the nominal model.
    pub added: Option<String>,
    /// The gap.
    pub value: f64,
}

/// The gap before and after each step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// `noise floors`.
    pub unit: &'static str,
    /// 1.
    pub floor: f64,
    /// Horizon, s.
    pub horizon_s: f64,
    /// The steps.
    pub steps: Vec<Step>,
    /// The same at longer horizons: horizon in s, gap before, gap after.
    pub horizons: Vec<(f64, f64, f64)>,
}

/// A candidate's score in the first step, for the ranking's figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ranked {
    /// `ID@PLACE`.
    pub name: String,
    /// Share of the held-out weighted residual power that it takes away.
    pub gain: f64,
    /// Probability by chance.
    pub p_value: f64,
    /// Step in which it was judged.
    pub step: usize,
}

/// Result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Explanation {
    /// Verdict.
    pub verdict: Verdict,
    /// Why.
    pub reason: String,
    /// Effects in the order in which they were added.
    pub effects: Vec<Found>,
    /// The gap.
    pub gap: Gap,
    /// Where the disagreement sits.
    pub r#where: Vec<residual_map::Where>,
    /// Parameters of the model with its effects.
    pub parameters: Vec<Parameter>,
    /// Ratio of residual to noise power in the rows, before and after.
    pub residual_power: [f64; 2],
    /// Best candidates of each step.
    pub ranking: Vec<Ranked>,
    /// Residual maps, for the figures.
    pub maps: Vec<residual_map::Map>,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

/// A candidate: an effect at a place in one form.
struct Candidate {
    effect: &'static Effect,
    place: Place,
    variant: Variant,
}

impl Candidate {
    fn name(&self) -> String {
        format!("{}@{}", self.effect.id, self.place.name())
    }
}

/// An effect in the model: its form and strengths.
struct Chosen {
    candidate: Candidate,
    strengths: Vec<f64>,
}

/// Every candidate for this rig.
fn candidates(c: &Context) -> Vec<Candidate> {
    EFFECTS
        .iter()
        .flat_map(|effect| {
            effect.places.iter().flat_map(move |&place| {
                (effect.variants)(c, place).into_iter().map(move |variant| Candidate { effect, place, variant })
            })
        })
        .collect()
}

/// The nominal dampings as chosen effects.
fn nominal(rig: &Rig, c: &Context) -> Result<Vec<Chosen>> {
    let ids: Vec<&str> = identify::dampings(rig)?.iter().map(|d| d.id).collect();
    Ok(candidates(c)
        .into_iter()
        .filter(|k| ids.contains(&k.name().as_str()))
        .map(|candidate| Chosen { candidate, strengths: vec![0.0] })
        .collect())
}

/// The model's coefficients and what was computed with them.
struct State {
    context: Context,
    /// Nominal dampings, then effects added.
    chosen: Vec<Chosen>,
    /// How many of `chosen` are nominal.
    nominal: usize,
    base: Vec<f64>,
    /// Angles with the sensor effects found so far taken off.
    segments: Vec<AngleSegment>,
}

impl State {
    fn model(&self) -> Vec<(&Variant, Vec<f64>)> {
        self.chosen.iter().map(|k| (&k.candidate.variant, k.strengths.clone())).collect()
    }

    /// Columns of the B terms and of everything chosen, which come first.
    fn own_columns(&self) -> usize {
        2 * base_terms(self.context.driven) + self.chosen.iter().map(|k| k.strengths.len()).sum::<usize>()
    }

    /// Effects depend on the coefficients (ratios of inertias, the drive's share): renews their columns.
    fn renew(&mut self) {
        let all = candidates(&self.context);
        for k in &mut self.chosen {
            let name = k.candidate.name();
            if let Some(new) = all.iter().find(|n| n.name() == name && n.variant.shape == k.candidate.variant.shape) {
                k.candidate.variant = new.variant.clone();
            }
        }
    }

    /// Takes coefficients over: B terms, then strengths; those of effects that are applied to the data are increments.
    fn take(&mut self, x: &DVector<f64>, raw: &[AngleSegment]) {
        let n = 2 * base_terms(self.context.driven);
        self.base = x.rows(0, n).iter().copied().collect();
        let mut at = n;
        let mut sensors = false;
        for k in &mut self.chosen {
            let applied = k.candidate.variant.action.is_applied();
            sensors |= applied;
            for s in &mut k.strengths {
                *s = x[at] + if applied { *s } else { 0.0 };
                at += 1;
            }
        }
        let per = n / 2;
        for i in 0..2 {
            (0..per).for_each(|j| self.context.b[i][j] = self.base[i * per + j]);
        }
        if sensors {
            self.segments = raw.to_vec();
            for k in &self.chosen {
                match &k.candidate.variant.action {
                    Action::Force(_) => {}
                    Action::Sensor(laws) => {
                        for (law, s) in laws.iter().zip(&k.strengths) {
                            self.segments = self.segments.iter().map(|g| design::correct(g, law, *s)).collect();
                        }
                    }
                    Action::Runaway(_) => {
                        let rate = core::f64::consts::TAU * k.strengths[0];
                        let from = self.context.span_s[0];
                        self.segments.iter_mut().for_each(|g| g.runaway = (from, rate));
                    }
                }
            }
        }
    }
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

/// The state before anything is added.
fn start(rig: &Rig, first: &Identification, raw: &[AngleSegment]) -> Result<State> {
    let value = |name: String| first.parameter(&name).map_or(0.0, |p| p.value);
    let b = [1, 2].map(|i| [1, 2, 3, 4].map(|j| value(format!("B{i}{j}"))));
    let start = raw.first().map_or(0.0, |s| s.start_s);
    let end = raw.last().map_or(0.0, |s| s.time(s.len()));
    let mut known = rig.known.clone();
    for p in &first.parameters {
        if !p.name.starts_with('B') && !p.name.starts_with('C') {
            known.entry(p.name.clone()).or_insert(p.value);
        }
    }
    let context = Context {
        omega: rig.omega(),
        driven: rig.drive.is_some(),
        b,
        g: known.get("g").copied().unwrap_or(crate::rig::GRAVITY),
        known,
        relative: raw.first().is_none_or(|s| s.relative),
        span_s: [start, (end - start).max(f64::MIN_POSITIVE)],
    };
    let chosen = nominal(rig, &context)?;
    let n = base_terms(context.driven);
    let base = (0..2).flat_map(|i| context.b[i][..n].to_vec()).collect();
    Ok(State { nominal: chosen.len(), chosen, context, base, segments: raw.to_vec() })
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

/// Fits everything chosen, updates ties, and builds the columns of the candidates behind its own.
fn refit(
    state: &mut State,
    raw: &[AngleSegment],
    geometry: &Geometry,
    variants: &[Candidate],
) -> Result<(Design, Weights, Vec<usize>)> {
    let own: Vec<usize> = (0..state.own_columns()).collect();
    let mut weights: Option<Weights> = None;
    // The first round settles weights and linearised effects; the last carries the candidates' columns as well.
    for round in 0..2 {
        let last = round == 1;
        let list: Vec<&Variant> = state
            .chosen
            .iter()
            .map(|k| &k.candidate.variant)
            .chain(variants.iter().filter(|_| last).map(|k| &k.variant))
            .collect();
        let model = state.model();
        let design = design::build(&state.context, &state.segments, geometry, &list, &model, &state.base);
        let equal = [vec![1.0; design.frequencies + 1], vec![1.0; design.frequencies + 1]];
        let used = weights.clone().unwrap_or(equal);
        let fit = ranking::fit(&design, &own, &used).ok_or_else(singular)?;
        let mut w = ranking::weights(&design, &own, &fit.all);
        if !last {
            // Weights from an unweighted fit are rough: once more.
            let fit = ranking::fit(&design, &own, &w).ok_or_else(singular)?;
            w = ranking::weights(&design, &own, &fit.all);
            state.take(&fit.all, raw);
            state.renew();
            weights = Some(w);
        } else {
            return Ok((design, w, own));
        }
    }
    Err(singular())
}

/// The next effect to add.
struct Next {
    index: usize,
    found: Found,
}

fn choose(
    state: &State,
    design: &Design,
    weights: &Weights,
    own: &[usize],
    variants: &[Candidate],
    step: usize,
    ranking_out: &mut Vec<Ranked>,
) -> Option<Next> {
    let plain = ranking::fit(design, own, weights)?;
    let total: f64 = plain.held_out.iter().sum();
    let taken: Vec<String> = state.chosen.iter().map(|k| k.candidate.name()).collect();
    let mut at = own.len();
    let places: Vec<(usize, usize)> = variants
        .iter()
        .map(|v| {
            let d = v.variant.action.len();
            at += d;
            (at - d, d)
        })
        .collect();
    struct Score {
        index: usize,
        gain: f64,
        p: f64,
        held_out: Vec<f64>,
        fit: ranking::Fit,
    }
    let scores: Vec<Score> = (0..variants.len())
        .into_par_iter()
        .filter(|&i| !taken.contains(&variants[i].name()))
        .filter_map(|index| {
            let (from, d) = places[index];
            let columns: Vec<usize> = own.iter().copied().chain(from..from + d).collect();
            let fit = ranking::fit(design, &columns, weights)?;
            let (mean, _) = ranking::gain(&plain.held_out, &fit.held_out);
            let p = ranking::p_value(&fit, d);
            Some(Score { index, gain: mean, p, held_out: fit.held_out.clone(), fit })
        })
        .collect();
    let tests = scores.len().max(1) as f64;
    // The best form of each effect at each place.
    let mut best: BTreeMap<String, &Score> = BTreeMap::new();
    for s in &scores {
        let entry = best.entry(variants[s.index].name()).or_insert(s);
        if s.gain > entry.gain {
            *entry = s;
        }
    }
    let blocks = plain.held_out.len() as f64;
    let mut order: Vec<(&String, &&Score)> = best.iter().collect();
    order.sort_by(|a, b| b.1.gain.total_cmp(&a.1.gain));
    ranking_out.extend(order.iter().take(12).map(|(name, s)| Ranked {
        name: (*name).clone(),
        gain: s.gain * blocks / total,
        p_value: s.p,
        step,
    }));
    let significant = |s: &Score| s.p * tests < FAMILY_WISE && s.gain > 0.0;
    let (name, winner) = order.iter().find(|(_, s)| significant(s))?;
    let runner_up = order.iter().find(|(n, _)| n != name).map(|(n, s)| ((*n).clone(), s.gain * blocks / total));
    let mut twins: Vec<String> = order
        .iter()
        .filter(|(n, s)| n != name && significant(s))
        .filter(|(_, s)| {
            let (mean, error) = ranking::gain(&s.held_out, &winner.held_out);
            mean < 2.0 * error
        })
        .map(|(n, _)| (*n).clone())
        .collect();
    for (a, b) in [("zero-offset@encoder2", "imbalance@arm2"), ("imbalance@arm2", "zero-offset@encoder2")] {
        if *name == a && !twins.iter().any(|t| t == b) {
            twins.push(b.to_owned());
        }
    }
    let candidate = &variants[winner.index];
    let (value, error, parameters, unit) = read(&state.context, candidate, &winner.fit.all, &winner.fit.covariance);
    Some(Next {
        index: winner.index,
        found: Found {
            id: candidate.effect.id.to_owned(),
            at: candidate.place.name().to_owned(),
            value,
            std_error: error,
            unit,
            equation: candidate.effect.equation.to_owned(),
            parameters,
            indistinguishable_from: twins,
            p_value: winner.p,
            held_out_gain: winner.gain * blocks / total,
            runner_up,
            confirm: candidate.effect.confirm.to_owned(),
        },
    })
}

/// Value, standard error, parameters and unit of a candidate whose strengths are the last coefficients.
fn read(
    c: &Context,
    candidate: &Candidate,
    x: &DVector<f64>,
    covariance: &nalgebra::DMatrix<f64>,
) -> (f64, f64, BTreeMap<String, f64>, String) {
    let d = candidate.variant.action.len();
    let from = x.len() - d;
    let strengths: Vec<f64> = x.rows(from, d).iter().copied().collect();
    let covariance = covariance.view((from, from), (d, d)).into_owned();
    compose(c, candidate, &strengths, &covariance)
}

fn compose(
    c: &Context,
    candidate: &Candidate,
    k: &[f64],
    covariance: &nalgebra::DMatrix<f64>,
) -> (f64, f64, BTreeMap<String, f64>, String) {
    let first = matches!(candidate.place, Place::Joint1 | Place::Arm1);
    let (scale, unit) = match (candidate.variant.scale, c.known.get("J_o2")) {
        (Scale::Plain(f), _) => (f, candidate.effect.unit.to_owned()),
        (Scale::Torque, Some(j)) => (*j, candidate.effect.unit.to_owned()),
        (Scale::Torque, None) => {
            let (j, name) = if first { (c.inertia(0), "J_o1") } else { (1.0, "J_o2") };
            (1.0 / j, format!("{}/({name} kg m²)", candidate.effect.unit))
        }
    };
    let mut parameters: BTreeMap<String, f64> =
        candidate.variant.shape.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect();
    let (value, error) = match candidate.variant.compose {
        Compose::Single => (k[0], covariance[(0, 0)].sqrt()),
        Compose::Components(name) => {
            parameters.insert(name.to_owned(), k[1] * scale);
            (k[0], covariance[(0, 0)].sqrt())
        }
        Compose::AmplitudePhase(name) => {
            let size = k[0].hypot(k[1]);
            parameters.insert(name.to_owned(), k[1].atan2(k[0]));
            let (a, b) = (k[0] / size, k[1] / size);
            let variance = a * a * covariance[(0, 0)] + 2.0 * a * b * covariance[(0, 1)] + b * b * covariance[(1, 1)];
            (size, variance.max(0.0).sqrt())
        }
    };
    (value * scale, error * scale.abs(), parameters, unit)
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
