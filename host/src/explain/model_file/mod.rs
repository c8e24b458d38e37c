//! Explanations for a system that a user wrote down: which effect at which coordinate its equations lack.
//!
//! As for the built-in systems: every candidate is added to the equation of its coordinate in turn, everything refitted by the weak form, and
//! judged on blocks that were not fitted; the best of those that are significant over the whole list is added (of two that
//! held-out data do not tell apart the simpler), until nothing more is supported. Beside the gap, the simulation error: the model fitted by
//! simulation to the beginning of the record and continued to its end without touching the state.

mod candidates;
mod fit;
mod prediction;

use std::collections::BTreeMap;

use nalgebra::DVector;
use serde::Serialize;

use self::candidates::{Candidate, candidates};
use self::fit::Blocks;
use self::prediction::Along;
use super::explanation::{Explanation, Found, Ranked, Step, Verdict};
use super::naming::FAMILY_WISE;
use super::ranking::{self, Fit};
use super::{Settings, singular};
use crate::error::{BadInput, Result};
use crate::identify::general::noise::Remeasured;
use crate::identify::general::per_record::Split;
use crate::identify::general::series::System;
use crate::identify::general::stretches::Stretch;
use crate::identify::general::{self, Prepared};
use crate::identify::windows::{WindowRows, rows_of};
use crate::identify::{Geometry, Parameter, Settings as IdentifySettings};
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::model::model_file::expression::Node;
use crate::model::model_file::units;
use crate::model::model_file::weak_form::{Column, WeakForm};
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::Bound;

/// Most effects that are added.
const MOST_EFFECTS: usize = 5;
/// Fewest blocks for a decision.
const FEWEST_BLOCKS: usize = 9;
/// Least share of the held-out residual that an effect must take away to be named.
const LEAST_GAIN: f64 = 0.01;
/// Length of a block, s.
const BLOCK_S: f64 = 4.0;
/// Gap and residual up to which nothing counts as left.
const EXPLAINED_GAP: f64 = 1.3;
/// Shares of the record that simulations are fitted to.
const FITTED: [f64; 2] = [2.0 / 3.0, 0.75];

/// Simulation errors: fitted to the beginning of the longest stretch, continued to its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Simulation {
    /// Share of the stretch that was fitted.
    pub fitted: f64,
    /// Unit of the values.
    pub unit: String,
    /// Rms error over the rest, of the model as given and with everything that was added; the greatest over the coordinates. NaN where no
    /// simulation follows the record.
    pub steps: Vec<Step>,
}

/// What stays the same over the steps.
struct Setting<'a> {
    rig: &'a Rig,
    bound: &'a Bound,
    stretches: &'a [Stretch],
    record_of: &'a [usize],
    sensors: &'a general::noise::Sensors,
    geometry: &'a Geometry,
    split: Split,
    circle: Vec<bool>,
    block_s: f64,
}

/// The fit of one step.
struct Round {
    /// Coefficients and their fit, equation by equation.
    fits: Vec<Fit>,
    /// Names of the columns of each equation.
    names: Vec<Vec<String>>,
    blocks: Vec<Blocks>,
}

/// Explains one or several records of a model-file rig.
///
/// # Errors
/// As [`crate::identify::identify`].
pub fn explain(records: &[Record], rig: &Rig, bound: &Bound, settings: &Settings) -> Result<Explanation> {
    let model = &*bound.model;
    if settings.model.is_some() {
        return Err(BadInput::new("--model", "no model beside the rig's model file")
            .remedy("Write the terms into the model file that the rig file names"));
    }
    let Prepared { stretches, record_of, sensors, geometry, warnings } =
        general::prepare(records, rig, bound, &IdentifySettings::default())?;
    let seconds: f64 = stretches.iter().map(|s| s.len() as f64 * s.step_s).sum();
    let setting = Setting {
        rig,
        bound,
        stretches: &stretches,
        record_of: &record_of,
        sensors: &sensors,
        geometry: &geometry,
        split: Split::new(model, records.len()),
        circle: model.circle(),
        block_s: BLOCK_S.min(seconds / 12.0).max(geometry.windows.length_s),
    };
    let horizon_s = horizon(rig, settings, &stretches)?;
    let along: Vec<Along> = stretches.iter().map(|s| Along::new(s, rig.drive.map_or(0.0, |_| rig.omega()))).collect();
    let all = candidates(model, rig.omega(), &speeds(&stretches));
    let mut result = Explanation::new(horizon_s, warnings);
    let mut chosen: Vec<Candidate> = Vec::new();
    let mut undecidable = None;
    let units: Vec<String> = model.coordinates.iter().enumerate().map(|(k, _)| si_unit(rig, bound, k)).collect();
    let mut simulations: Vec<Simulation> =
        FITTED.iter().map(|f| Simulation { fitted: *f, unit: shown_unit(&units).0, steps: Vec::new() }).collect();
    let most = MOST_EFFECTS;
    loop {
        let step = chosen.len();
        let round = fit_round(&setting, &chosen, &all)?;
        if step == 0 {
            let blocks = round.blocks.iter().map(Blocks::len).min().unwrap_or(0);
            if blocks < FEWEST_BLOCKS {
                undecidable = Some(format!("{blocks} blocks of {:.3} s are too few to hold any out", setting.block_s));
            }
        }
        let last = measure(&setting, &round, &chosen, &along, &mut result)?;
        read_parameters(&setting, &round, &chosen, &mut result);
        let next = if undecidable.is_some() || step == most {
            None
        } else {
            choose(&setting, &round, &chosen, &all, step, &mut result.ranking)
        };
        // Before anything is added, and with everything.
        if let (true, Some(model)) = (step == 0 || next.is_none(), &last) {
            let added = chosen.last().map(Candidate::name);
            simulate(&setting, model, &along, added, &mut simulations, shown_unit(&units).1);
        }
        let Some((candidate, found)) = next else { break };
        result.effects.push(found);
        chosen.push(candidate);
    }
    result.simulation = simulations;
    let gap = result.gap.steps.last().map_or(f64::NAN, |s| s.value);
    let said = format!("predictions over {horizon_s:.3} s miss by {gap:.2} noise floors");
    (result.verdict, result.reason) = match undecidable {
        Some(reason) => {
            result.effects.clear();
            (Verdict::NotDecidable, reason)
        }
        None if gap.is_nan() || gap > EXPLAINED_GAP => {
            (Verdict::Unexplained, format!("{said}; no further effect of the list accounts for it"))
        }
        None if result.effects.is_empty() => (Verdict::NothingMissing, said),
        None => (Verdict::Explained, said),
    };
    Ok(result)
}

/// Horizon of the gap.
fn horizon(rig: &Rig, settings: &Settings, stretches: &[Stretch]) -> Result<f64> {
    let default = rig.drive.map_or(0.2, |d| 1.0 / d.frequency_hz);
    let step = 1.0 / rig.sample_rate_hz;
    let longest = stretches.iter().map(|s| s.len() as f64 * s.step_s).fold(0.0, f64::max);
    match settings.horizon_s {
        Some(h) if !(h >= 8.0 * step && h <= longest) => {
            Err(BadInput::new(h.to_string(), format!("seconds from {} to {longest}", 8.0 * step)).at("--horizon"))
        }
        h => Ok(h.unwrap_or(default).max(8.0 * step)),
    }
}

/// Rms velocity of each coordinate, by differences over five samples.
fn speeds(stretches: &[Stretch]) -> Vec<f64> {
    let n = stretches.first().map_or(0, |s| s.coordinates.len());
    (0..n)
        .map(|k| {
            let (mut sum, mut count) = (0.0, 0.0);
            for s in stretches {
                for w in s.coordinates[k].windows(6).step_by(5) {
                    sum += ((w[5] - w[0]) / (5.0 * s.step_s)).powi(2);
                    count += 1.0;
                }
            }
            (sum / f64::max(count, 1.0)).sqrt().max(f64::MIN_POSITIVE)
        })
        .collect()
}

/// SI unit of a coordinate.
fn si_unit(rig: &Rig, bound: &Bound, coordinate: usize) -> String {
    let row = (0..bound.sensors.len()).find(|&r| bound.shown[(r, coordinate)] != 0.0).unwrap_or(0);
    match rig.channel[bound.sensors[row]].unit.as_str() {
        "count" | "deg" => "rad",
        "mm" | "um" => "m",
        "mV" => "V",
        other => other,
    }
    .to_owned()
}

/// The unit in which simulation errors are told, and its factor: degrees where everything is an angle.
fn shown_unit(units: &[String]) -> (String, f64) {
    match units.first() {
        Some(first) if units.iter().all(|u| u == first) => {
            if first == "rad" {
                ("deg".to_owned(), 180.0 / core::f64::consts::PI)
            } else {
                (first.clone(), 1.0)
            }
        }
        _ => ("SI".to_owned(), 1.0),
    }
}

/// Fits the model with what was chosen; columns of the candidates stand behind its own.
fn fit_round(setting: &Setting<'_>, chosen: &[Candidate], all: &[Candidate]) -> Result<Round> {
    let model = &*setting.bound.model;
    let omega = setting.rig.omega();
    let mut extra: Vec<Vec<Column>> = vec![Vec::new(); model.equations.len()];
    for c in chosen.iter().chain(all) {
        for (k, of) in c.columns.iter().enumerate() {
            extra[c.equation].push(Column { name: format!("{} {k}", c.name()), of: of.clone() });
        }
    }
    let own_weak = WeakForm::new(model, omega, &[])?;
    let weak = WeakForm::new(model, omega, &extra)?;
    let kernels = &setting.geometry.kernels;
    let windows = &setting.geometry.windows;
    let rows = |weak: &WeakForm| -> Vec<WindowRows> {
        let system = System { stretches: setting.stretches, weak, kernels, circle: &setting.circle };
        rows_of(&system, &weak.equations, kernels, windows)
    };
    let (mut own_rows, mut rows) = (rows(&own_weak), rows(&weak));
    setting.split.spread(&mut own_rows, setting.record_of);
    let split = setting.split.with_shared(&extra.iter().map(Vec::len).collect::<Vec<_>>());
    split.spread(&mut rows, setting.record_of);
    let own = setting.split.terms();
    let total = split.terms();
    let names = split_names(&setting.split);
    // What is lacking is weighed evenly over the frequencies, beside the sensors' noise.
    let system = System { stretches: setting.stretches, weak: &own_weak, kernels, circle: &setting.circle };
    let again = Remeasured::new(&system, windows, setting.bound, setting.sensors, &setting.split, setting.record_of);
    let given = general::noise_weights(&own_rows, &own, windows.frequencies, &again).map_err(|_| singular())?;
    let (mut fits, mut blocks) = (Vec::new(), Vec::new());
    for e in 0..model.equations.len() {
        let mine: usize = chosen.iter().filter(|c| c.equation == e).map(|c| c.columns.len()).sum();
        let columns: Vec<usize> = (0..own[e] + mine).collect();
        let b = Blocks::new(&rows, e, total[e], &given[e], setting.block_s);
        fits.push(b.fit(&columns).ok_or_else(singular)?);
        blocks.push(b);
    }
    Ok(Round { fits, names, blocks })
}

fn split_names(split: &Split) -> Vec<Vec<String>> {
    let names = split.names();
    let mut at = 0;
    split
        .terms()
        .iter()
        .map(|p| {
            at += p;
            names[at - p..at].to_vec()
        })
        .collect()
}

/// The model of a step as equations of motion: coefficients from the whole record, noise of the coordinates.
struct Moving {
    motion: EquationsOfMotion,
    whole: Vec<f64>,
    sigma: Vec<f64>,
}

/// Simulation errors of a step.
fn simulate(
    setting: &Setting<'_>,
    model: &Moving,
    along: &[Along],
    added: Option<String>,
    simulations: &mut [Simulation],
    factor: f64,
) {
    let longest = (0..setting.stretches.len()).max_by_key(|&k| (setting.stretches[k].len(), usize::MAX - k));
    for simulation in simulations {
        let errors = longest.and_then(|k| {
            let stretch = &setting.stretches[k];
            // Eight samples a cycle of the highest frequency that stands clear of the noise.
            let stride = (1.0 / (8.0 * setting.geometry.kernels.clear.pass_hz * stretch.step_s)).floor().max(1.0);
            let Moving { motion, whole, sigma } = model;
            prediction::simulate(motion, whole, stretch, &along[k], sigma, simulation.fitted, stride as usize)
        });
        let value = errors.map_or(f64::NAN, |(_, e)| e.iter().fold(0.0_f64, |m, x| m.max(*x)) * factor);
        simulation.steps.push(Step { added: added.clone(), value });
    }
}

/// The gap of a step, its coefficients from the blocks that it is not measured on; the model, where it can be integrated.
fn measure(
    setting: &Setting<'_>,
    round: &Round,
    chosen: &[Candidate],
    along: &[Along],
    result: &mut Explanation,
) -> Result<Option<Moving>> {
    let model = &*setting.bound.model;
    let added = chosen.last().map(Candidate::name);
    let extra: Vec<(usize, String, Node)> = chosen
        .iter()
        .flat_map(|c| c.columns.iter().enumerate().map(|(k, of)| (c.equation, format!("{} {k}", c.name()), of.clone())))
        .collect();
    if model.equations.len() != model.coordinates.len() {
        result.gap.steps.push(Step { added, value: f64::NAN });
        return Ok(None);
    }
    let motion = EquationsOfMotion::with_columns(model, setting.rig.omega(), &extra)?;
    // The first record's own coefficients stand for all.
    let parameters = |pick: fn(&Fit) -> &DVector<f64>| -> Vec<f64> {
        let mut seen = vec![0; model.equations.len()];
        let mut by_name: BTreeMap<String, f64> = BTreeMap::new();
        for (e, (fit, names)) in round.fits.iter().zip(&round.names).enumerate() {
            let x = pick(fit);
            for (n, x) in names.iter().zip(x.iter()) {
                by_name.entry(n.clone()).or_insert(*x);
                if let Some(short) = n.strip_suffix("_1") {
                    by_name.entry(short.to_owned()).or_insert(*x);
                }
            }
            seen[e] = names.len();
        }
        for c in chosen {
            for k in 0..c.columns.len() {
                let x = pick(&round.fits[c.equation])[seen[c.equation]];
                by_name.insert(format!("{} {k}", c.name()), x);
                seen[c.equation] += 1;
            }
        }
        motion.coefficients().iter().map(|n| by_name.get(n).copied().unwrap_or(0.0)).collect()
    };
    // Noise of the coordinates from that of the sensors.
    let sigma: Vec<f64> = (0..model.coordinates.len())
        .map(|k| {
            let sum: f64 = setting
                .sensors
                .sigma
                .iter()
                .enumerate()
                .map(|(r, s)| (setting.bound.coordinates[(k, r)] * s).powi(2))
                .sum();
            sum.sqrt().max(1e-12)
        })
        .collect();
    let train = parameters(|f| &f.train);
    let value =
        prediction::gap(&motion, &train, setting.stretches, along, &sigma, result.gap.horizon_s, setting.block_s);
    result.gap.steps.push(Step { added, value });
    let whole = parameters(|f| &f.all);
    Ok(Some(Moving { motion, whole, sigma }))
}

/// The model's own coefficients with what was chosen.
fn read_parameters(setting: &Setting<'_>, round: &Round, chosen: &[Candidate], result: &mut Explanation) {
    let model = &*setting.bound.model;
    let units = setting.split.units(&general::units_of(model, setting.rig, setting.bound));
    let mut at = 0;
    result.parameters.clear();
    for (fit, names) in round.fits.iter().zip(&round.names) {
        for (i, name) in names.iter().enumerate() {
            if !result.parameters.iter().any(|p| p.name == *name) {
                result.parameters.push(Parameter {
                    name: name.clone(),
                    value: fit.all[i],
                    std_error: fit.covariance[(i, i)].max(0.0).sqrt(),
                    unit: units[at + i].clone(),
                });
            }
        }
        at += names.len();
    }
    let mut behind: Vec<usize> = round.names.iter().map(Vec::len).collect();
    for (c, found) in chosen.iter().zip(&mut result.effects) {
        let from = behind[c.equation];
        behind[c.equation] += c.columns.len();
        put_value(c, &round.fits[c.equation], from, found);
    }
}

/// Value, standard error and parameters of an effect whose strengths stand at `from`.
fn put_value(c: &Candidate, fit: &Fit, from: usize, found: &mut Found) {
    let k: Vec<f64> = (0..c.columns.len()).map(|i| fit.all[from + i]).collect();
    let error = |i: usize| fit.covariance[(from + i, from + i)].max(0.0).sqrt();
    found.parameters = c.shape.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect();
    (found.value, found.std_error) = match k[..] {
        [s, o] => {
            found.parameters.insert("psi".to_owned(), o.atan2(s));
            let size = s.hypot(o);
            let spread = if size > 0.0 { ((s * error(0)).hypot(o * error(1))) / size } else { error(0) };
            (size, spread)
        }
        _ => (k[0], error(0)),
    };
    found.strengths = k;
}

/// The next effect.
fn choose(
    setting: &Setting<'_>,
    round: &Round,
    chosen: &[Candidate],
    all: &[Candidate],
    step: usize,
    ranked: &mut Vec<Ranked>,
) -> Option<(Candidate, Found)> {
    struct Score<'a> {
        candidate: &'a Candidate,
        gain: f64,
        deviations: f64,
        p: f64,
        share: f64,
        held_out: Vec<f64>,
        fit: Fit,
    }
    let own: Vec<usize> = (0..round.fits.len())
        .map(|e| {
            round.names[e].len() + chosen.iter().filter(|c| c.equation == e).map(|c| c.columns.len()).sum::<usize>()
        })
        .collect();
    let mut next = own.clone();
    let mut scores: Vec<Score<'_>> = Vec::new();
    for candidate in all {
        let e = candidate.equation;
        let from = next[e];
        next[e] += candidate.columns.len();
        if chosen.iter().any(|c| c.name() == candidate.name()) {
            continue;
        }
        let columns: Vec<usize> = (0..own[e]).chain(from..next[e]).collect();
        let Some(fit) = round.blocks[e].fit(&columns) else { continue };
        let plain = &round.fits[e];
        let (mean, error) = ranking::gain(&plain.held_out, &fit.held_out);
        let whole: f64 = plain.held_out.iter().sum();
        scores.push(Score {
            candidate,
            gain: mean,
            deviations: if error > 0.0 { mean / error } else { 0.0 },
            p: ranking::p_value(&fit, candidate.columns.len()),
            share: mean * plain.held_out.len() as f64 / whole,
            held_out: fit.held_out.clone(),
            fit,
        });
    }
    let tests = scores.len().max(1) as f64;
    // The best form of each effect at each place.
    let mut best: Vec<&Score<'_>> = Vec::new();
    for s in &scores {
        match best.iter_mut().find(|b| b.candidate.name() == s.candidate.name()) {
            Some(b) if s.share > b.share => *b = s,
            Some(_) => {}
            None => best.push(s),
        }
    }
    best.sort_by(|a, b| b.share.total_cmp(&a.share));
    ranked.extend(best.iter().map(|s| Ranked {
        name: s.candidate.name(),
        gain: s.share,
        deviations: s.deviations,
        p_value: s.p,
        step,
    }));
    let alone = |s: &Score<'_>| s.p * tests < FAMILY_WISE && s.share > LEAST_GAIN && s.gain > 0.0;
    // A refinement is not named while the simpler effect that it refines is supported itself.
    let supported = |s: &Score<'_>| {
        let simpler = |o: &&&Score<'_>| {
            Some(o.candidate.effect.id) == s.candidate.effect.refines && o.candidate.at == s.candidate.at
        };
        alone(s) && !best.iter().find(simpler).is_some_and(|o| alone(o))
    };
    let top = best.iter().find(|s| supported(s))?;
    // Others in the same equation that held-out data do not tell from it.
    let close: Vec<&&Score<'_>> = best
        .iter()
        .filter(|s| s.candidate.equation == top.candidate.equation && supported(s))
        .filter(|s| {
            let (mean, error) = ranking::gain(&s.held_out, &top.held_out);
            mean <= error || s.candidate.name() == top.candidate.name()
        })
        .collect();
    let winner = close.iter().min_by_key(|s| s.candidate.rank)?;
    let name = winner.candidate.name();
    let runner_up = best.iter().find(|s| s.candidate.name() != name).map(|s| (s.candidate.name(), s.share));
    let c = winner.candidate;
    let model = &*setting.bound.model;
    let (coordinates, inputs) = general::channel_units(model, setting.rig, setting.bound);
    let seconds = true;
    let balance = model.in_seconds(&model.equations[c.equation].balance, setting.rig.omega());
    let mut found = Found {
        id: c.effect.id.to_owned(),
        at: c.at.clone(),
        value: 0.0,
        std_error: 0.0,
        unit: units::coefficient(&balance, &c.columns[0], &coordinates, &inputs, seconds),
        equation: c.effect.equation.to_owned(),
        parameters: BTreeMap::new(),
        indistinguishable_from: close.iter().map(|s| s.candidate.name()).filter(|n| *n != name).collect(),
        p_value: winner.p,
        held_out_gain: winner.share,
        runner_up,
        confirm: c.effect.confirm.to_owned(),
        strengths: Vec::new(),
    };
    put_value(c, &winner.fit, own[c.equation], &mut found);
    Some((c.clone(), found))
}
