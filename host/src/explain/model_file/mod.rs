//! Explanations for a system that a user wrote down: which effect at which coordinate its equations lack.
//!
//! As for the built-in systems: every candidate is added to the equation of its coordinate in turn, everything refitted, and
//! judged by trajectories over blocks that were not fitted (by the weak form where the model follows none); the best of those that are
//! significant over the whole list is added (of two that held-out data do not tell apart the simpler), until nothing more is supported.
//! Coefficients of laws that take energy away keep that sign. Beside the gap, the simulation error: the model fitted by simulation to the
//! beginning of the record and continued to its end without touching the state.
//!
//! | file | what |
//! |---|---|
//! | `candidates` | the effects |
//! | `round` | a round: what was chosen fitted, every candidate beside it |
//! | `trajectories` | residuals of trajectories |
//! | `fit` | least squares over blocks, signs kept |
//! | `signs` | which sign takes energy away |
//! | `choose` | which effect is added |
//! | `measure`, `prediction` | the gap, simulations |
//! | `given` | a model to start from, and the model that is written |
//! | `put_in` | effects put into a simulation |
//! | `told` | units, parameters, values |

mod candidates;
mod choose;
mod fit;
mod given;
mod measure;
pub(super) mod prediction;
pub mod put_in;
mod round;
mod signs;
pub(super) mod told;
mod trajectories;

use std::collections::BTreeMap;

use serde::Serialize;

use self::candidates::{Candidate, candidates};
pub use self::given::{effects as effects_of, motion as motion_of};
use self::round::{Round, by_trajectories, by_weak_form, own_signs};

use self::trajectories::{Columns, Trajectories};
use super::decidability::{self, DIVERGED, FEWEST_BLOCKS, LOCKED, locked};
use super::explanation::{Explanation, Step, Verdict};
use super::ranking;
use super::{Settings, singular};
use crate::error::Result;
use crate::identify::general::per_record::Split;
use crate::identify::general::stretches::Stretch;
use crate::identify::general::track::{Along, Track};
use crate::identify::general::{self, Prepared};
use crate::identify::{Geometry, Settings as IdentifySettings};
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::Bound;

/// Most effects that are added.
const MOST_EFFECTS: usize = 8;
/// Share of its promise that an effect must keep.
const LEAST_KEPT: f64 = 0.5;
/// Length of a block, s.
const BLOCK_S: f64 = 4.0;
/// Gap and residual up to which nothing counts as left.
const EXPLAINED_GAP: f64 = 1.3;
/// Why a model that cannot be simulated decides nothing.
const UNPREDICTED: &str = "nothing can be predicted: that takes as many equations as coordinates";
/// Shares of the record that simulations are fitted to.
const FITTED: [f64; 2] = [2.0 / 3.0, 0.75];

/// Simulation errors: fitted to the beginning of the longest stretch, continued to its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Simulation {
    /// Share of the stretch that was fitted.
    pub fitted: f64,
    /// Unit of the values.
    pub unit: String,
    /// Rms error over the rest, of the model as given and with everything that was added; the greatest over the sensors. NaN where no
    /// simulation follows the record.
    pub steps: Vec<Step>,
    /// The coefficients of the last step as fitted by this simulation; those of effects by `ID@PLACE` and a number.
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

/// What stays the same over the steps.
pub(super) struct Setting<'a> {
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

/// Explains one or several records of a model-file rig.
///
/// # Errors
/// As [`crate::identify::identify`]; a given model of other equations.
pub fn explain(records: &[Record], rig: &Rig, bound: &Bound, settings: &Settings) -> Result<Explanation> {
    let model = &*bound.model;
    let Prepared { stretches, record_of, sensors, geometry, warnings } =
        general::prepare(records, rig, bound, &IdentifySettings::default())?;
    let seconds: f64 = stretches.iter().map(|s| s.len() as f64 * s.step_s).sum();
    // A free decay is short: as few blocks as decide, each as long as may be.
    let most_blocks = if bound.inputs.is_empty() { FEWEST_BLOCKS as f64 + 0.1 } else { 12.0 };
    let setting = Setting {
        rig,
        bound,
        stretches: &stretches,
        record_of: &record_of,
        sensors: &sensors,
        geometry: &geometry,
        split: Split::new(model, records.len()),
        circle: model.circle(),
        block_s: BLOCK_S.min(seconds / most_blocks).max(geometry.windows.length_s),
    };
    let horizon_s = told::horizon(rig, settings, &stretches)?;
    let along: Vec<Along> = stretches.iter().map(|s| Along::new(s, rig.drive.map_or(0.0, |_| rig.omega()))).collect();
    let track = Track::new(&stretches, &along, rig, bound, &sensors);
    let speeds = told::speeds(&stretches);
    let mut result = Explanation::new(horizon_s, warnings);
    let mut chosen = match &settings.model {
        Some(given) => given::effects(given, model, &speeds)?,
        None => Vec::new(),
    };
    if let Some(model) = &settings.model {
        given::measure(model, &setting, &chosen, &track, &mut result)?;
    }
    let unit = told::Unit::of(rig, bound);
    let whole: usize = stretches.iter().map(|s| (s.len() as f64 * s.step_s / setting.block_s) as usize).sum();
    if whole < 2 * ranking::FOLDS {
        return Ok(decidability::too_short(result, whole, setting.block_s));
    }
    result.gap.motion = measure::motion(&track, horizon_s, setting.block_s);
    result.gap.floor_in = unit.noise(&sensors.sigma);
    // For the same reason no simulation of a driven system is told.
    let fitted: &[f64] = if rig.drive.is_some() { &[] } else { &FITTED };
    let mut simulations: Vec<Simulation> = fitted
        .iter()
        .map(|f| Simulation { fitted: *f, unit: unit.name.clone(), steps: Vec::new(), parameters: Vec::new() })
        .collect();
    let first = by_weak_form(&setting, &BTreeMap::new(), None, &[], &[])?;
    let signs = own_signs(&setting, &first);
    let known = first.coefficients(&[], |f| &f.all);
    let gravity = candidates::gravity(model, rig.omega(), &|n| known.get(n).copied().unwrap_or(0.0));
    let every = candidates(model, rig.omega(), &speeds, &told::moves(rig, bound), &gravity);
    let mut trajectories = follow(&setting, &track, &first, records.len(), horizon_s);
    let open = |chosen: &[Candidate]| -> Vec<Candidate> {
        every.iter().filter(|c| !chosen.iter().any(|k| k.name() == c.name())).cloned().collect()
    };
    let mut rest = open(&chosen);
    let mut start = first.coefficients(&[], |f| &f.all);
    if let Some(model) = &settings.model {
        start.extend(given::by_name(model, &chosen));
    }
    let mut round =
        match trajectories.as_mut().and_then(|t| by_trajectories(&setting, t, &signs, &start, &chosen, &rest)) {
            Some(round) => round,
            None => {
                trajectories = None;
                by_weak_form(&setting, &signs, Some(&first), &chosen, &rest)?
            }
        };
    let blocks = round.groups.iter().map(|g| g.blocks.len()).min().unwrap_or(0);
    let undecidable = if !records.is_empty() && records.iter().all(|r| locked(r, rig)) {
        Some(LOCKED.to_owned())
    } else {
        (blocks < FEWEST_BLOCKS)
            .then(|| decidability::too_few(blocks, setting.block_s))
            .or_else(|| (model.equations.len() != model.coordinates.len()).then(|| UNPREDICTED.to_owned()))
    };
    measure::gap(&setting, &round, &chosen, &track, settings.model.is_some().then(|| "refit".to_owned()), &mut result)?;
    measure::simulate(&setting, (&round, &signs), &chosen, &track, &mut simulations, &unit)?;
    let most = if undecidable.is_some() { 0 } else { settings.most_effects.unwrap_or(MOST_EFFECTS) };
    for step in 0..=most {
        let scores = choose::scores(&round, &chosen, &rest);
        result.ranking.extend(scores.ranked(step));
        let mut skipped = Vec::new();
        let next = loop {
            if step == most {
                break None;
            }
            let Some((candidate, found)) = scores.next(&setting, &skipped) else { break None };
            let promised = found.held_out_gain;
            skipped.push(candidate.name());
            chosen.push(candidate);
            let left = open(&chosen);
            let kept = trajectories.as_ref().map(|t| t.states.clone());
            let tried = match trajectories.as_mut() {
                Some(t) => {
                    // The last one chosen starts from nothing.
                    let start = round.coefficients(&chosen[..chosen.len() - 1], |f| &f.all);
                    by_trajectories(&setting, t, &signs, &start, &chosen, &left)
                }
                None => Some(by_weak_form(&setting, &signs, Some(&round), &chosen, &left)?),
            };
            match tried {
                Some(new) if new.held_out() < round.held_out() * (1.0 - LEAST_KEPT * promised) => {
                    break Some((found, new, left));
                }
                // What it promised at a strength of nothing it does not keep.
                _ => {
                    chosen.pop();
                    if let (Some(t), Some(states)) = (trajectories.as_mut(), kept) {
                        t.states = states;
                    }
                }
            }
        };
        let Some((found, new, left)) = next else { break };
        result.effects.push(found);
        (round, rest) = (new, left);
        measure::gap(&setting, &round, &chosen, &track, chosen.last().map(Candidate::name), &mut result)?;
    }
    told::read_parameters(&setting, &round, &chosen, &mut result);
    measure::simulate(&setting, (&round, &signs), &chosen, &track, &mut simulations, &unit)?;
    result.simulation = simulations;
    decide(&mut result, undecidable);
    if result.verdict != Verdict::NotDecidable {
        result.model = Some(given::model(&setting, &round, &chosen, &result)?);
    }
    Ok(result)
}

/// Pieces that the model of the first round can follow.
fn follow<'a>(
    setting: &Setting<'_>,
    track: &'a Track<'a>,
    first: &Round,
    records: usize,
    horizon_s: f64,
) -> Option<Trajectories<'a>> {
    // What a drive keeps moving may be chaotic: no trajectory follows it over a block, and none is needed where it never comes to rest.
    if setting.rig.drive.is_some() {
        return None;
    }
    let model = &*setting.bound.model;
    let motion = EquationsOfMotion::new(model, setting.rig.omega()).ok()?;
    let columns = Columns::new(model, records);
    let by_name = first.coefficients(&[], |f| &f.all);
    let x: Vec<f64> = columns.names.iter().map(|n| by_name.get(n).copied().unwrap_or(0.0)).collect();
    Trajectories::new(track, columns, setting.record_of, &motion, &x, setting.block_s, horizon_s)
}

/// Verdict and reason.
fn decide(result: &mut Explanation, undecidable: Option<String>) {
    let diverged = result.settle();
    let gap = result.gap.steps.last().map_or(f64::NAN, |s| s.value);
    let said = format!("predictions over {:.3} s miss by {}", result.gap.horizon_s, result.gap.told(gap));
    (result.verdict, result.reason) = match undecidable.or_else(|| diverged.then(|| DIVERGED.to_owned())) {
        Some(reason) => {
            result.effects.clear();
            (Verdict::NotDecidable, reason)
        }
        None if gap > EXPLAINED_GAP => {
            (Verdict::Unexplained, format!("{said}; no further effect of the list accounts for it"))
        }
        None if result.effects.is_empty() => (Verdict::NothingMissing, said),
        None => (Verdict::Explained, said),
    };
}
