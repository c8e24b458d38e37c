//! The next experiment: what to set, how long, and what it will tell.
//!
//! The identified model is moved to other settings of the drive (`moved`), or let go from other
//! poses where there is none. Where its motion is chaotic for every draw of its parameters'
//! standard errors (`trial`), it makes a record as the rig's channels would show it, and that
//! record is looked at as every record is ([`crate::explain::engine::expected`]): standard errors
//! of parameters, and standard errors between an effect and its rivals. Standard errors fall with
//! the root of the record's length, which gives the time that each goal takes. The setting that
//! reaches all goals first is proposed; further draws of its initial state and parameters tell how
//! much that depends on them, at last draws that had no part in the choice: lengths and separations
//! are those that one more record has with a probability of 97.5 % (`rate`).
//!
//! Sources: Atkinson and Fedorov (1975), *Biometrika* 62, 57 (discrimination by the best-fitting
//! rival); Atkinson, Donev and Tobias (2007), *Optimum Experimental Designs, with SAS*, ch. 10
//! (D_s-optimality). Without goals the mean logarithm of the parameters' relative standard errors
//! is minimised (D-optimality on a diagonal).
//!
//! Numbers that decide, are no probability and follow from nothing are marked "by hand": they were
//! chosen.
//!
//! Limits: parameters are drawn by their standard errors without their correlations; waveform,
//! direction and exchanged masses are not searched; of a force that drives written equations the
//! frequency is not changed rightly (`moved`).

pub mod goals;
mod moved;
pub mod presentation;
mod rate;
mod task;
#[cfg(test)]
mod tests;
mod trial;
pub mod written;

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use self::goals::{Goals, Limits, Tell};
pub use self::moved::rig_at;
use self::task::Task;
pub use self::trial::Share;
use crate::error::{BadInput, Result};
use crate::explain::engine::expected::Expected;
use crate::identify::Parameter;
use crate::model::identified::IdentifiedModel;
use crate::record::Record;
use crate::rig::Rig;

/// Standard errors at which effects are told apart (by hand).
pub const APART: f64 = 5.0;
/// Draws at each setting of the map (by hand).
const MAP_DRAWS: usize = 4;
/// Settings that are looked at again, and their further draws: no more of these than settings that
/// are looked at (by hand).
const FINALISTS: usize = 3;
const FURTHER: usize = 3;
/// Draws of what is proposed that had no part in the choice of it: the best of many is partly the
/// luckiest (their number, and how many to a setting that is looked at, by hand).
const CONFIRMED_DRAWS: usize = 6;
const CONFIRMED_TO_ONE: usize = 3;
/// Draws of the chaotic share of what is proposed (by hand): of 12 that are all chaotic the share
/// is 0.76 at least, by Wilson's interval.
const SHARE_DRAWS: usize = 12;

/// What is set.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Setting {
    /// Frequency of the drive, Hz.
    pub frequency_hz: Option<f64>,
    /// Amplitude of the base in units of that at which the model was identified.
    pub amplitude_factor: Option<f64>,
    /// The same in m, where it is known.
    pub amplitude_m: Option<f64>,
    /// Coordinates from which a free system is let go at rest, rad or m (with rates behind them
    /// where it is not at rest).
    pub pose: Option<Vec<f64>>,
}

impl Setting {
    /// The same with what it leaves open: an amplitude alone is one at the rig's frequency.
    pub fn on(mut self, rig: &Rig) -> Self {
        let has_amplitude = self.amplitude_m.is_some() || self.amplitude_factor.is_some();
        self.frequency_hz = self.frequency_hz.or(rig.drive.filter(|_| has_amplitude).map(|d| d.frequency_hz));
        self
    }
}

/// A goal and the time that it takes at a setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reached {
    /// The goal, for people.
    pub goal: String,
    /// Record that reaches it, s; none where no length does.
    pub seconds: Option<f64>,
    /// Fewest simulated records that a part of it rests on: one alone bounds no other, and
    /// `seconds` is that one's own.
    pub draws: usize,
}

/// How far an effect of the model would stand from another.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Separated {
    /// The effect, `ID@PLACE`.
    pub effect: String,
    /// What it is told from; none: from nothing missing.
    pub from: Option<String>,
    /// Standard errors between them: at least so many, with 97.5 %; of one draw its own.
    pub deviations: f64,
    /// Simulated records that it rests on.
    pub draws: usize,
}

/// A setting and what a record there would tell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Proposal {
    /// What is set.
    pub setting: Setting,
    /// Length of the record, s.
    pub seconds: f64,
    /// Whether that reaches every goal; what rests on one draw is not said to.
    pub decides: bool,
    /// Share of draws that move chaotically; none for a free system.
    pub chaos: Option<Share>,
    /// Parameters with the standard errors that a record of that length is expected to have.
    pub parameters: Vec<Parameter>,
    /// 95 % interval of each parameter's standard error in one more record.
    pub std_errors: Vec<[f64; 2]>,
    /// How far effects of the model would stand from others, in standard errors.
    pub separations: Vec<Separated>,
    /// The time of each goal.
    pub goals: Vec<Reached>,
    /// Records that were simulated for it.
    pub draws: usize,
}

impl Proposal {
    /// Whether all that keeps it from deciding is that a goal rests on one draw.
    pub fn is_one_draw(&self) -> bool {
        !self.decides && self.goals.iter().all(|g| g.seconds.is_some_and(|s| s <= self.seconds))
    }
}

/// A point of the map.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MapPoint {
    /// What is set.
    pub setting: Setting,
    /// Share of draws that move chaotically.
    pub chaos: Share,
}

/// The next experiment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// The rig.
    pub rig: String,
    /// What was asked.
    pub goals: Goals,
    /// What is proposed; none where no setting can be followed.
    pub best: Option<Proposal>,
    /// What a record as the model's own would tell in the same time.
    pub unchanged: Option<Proposal>,
    /// Other settings that were looked at, best first.
    pub others: Vec<Proposal>,
    /// How much wider than by the sensors' noise alone all intervals are taken, for what the model
    /// does not explain; 1 where no record was given.
    pub wider: f64,
    /// Locked, chaotic and whirling motion over frequency and amplitude.
    pub map: Vec<MapPoint>,
    /// Seed.
    pub seed: u64,
}

/// How a plan is made.
#[derive(Clone, Debug)]
pub struct Settings<'a> {
    /// What it shall tell.
    pub goals: Goals,
    /// Effects with the sizes that they would have.
    pub sizes: Vec<Tell>,
    /// What the rig may be set to.
    pub limits: Limits,
    /// A record of the rig, whose channels' noise is taken; needed where a channel does not count.
    pub record: Option<&'a Record>,
    /// Settings that are looked at.
    pub budget: usize,
    /// Seed.
    pub seed: u64,
}

impl Settings<'_> {
    /// Further draws of those that are looked at again.
    fn further(&self) -> usize {
        FURTHER.min(self.budget.max(1))
    }

    /// Draws of what is proposed.
    fn confirmed(&self) -> usize {
        CONFIRMED_DRAWS.min(CONFIRMED_TO_ONE * self.budget.max(1))
    }
}

/// Every n-th of a list, so that about `most` are left, from all over it.
fn thinned<T: Clone>(all: &[T], most: usize) -> Vec<T> {
    let count = all.len().min(most.max(1));
    (0..count).map(|k| all[k * all.len() / count].clone()).collect()
}

/// A setting and what draws of its records would tell.
type Looked = (Setting, Vec<Expected>);

/// Sorts by the time of the slowest goal, what rests on one draw last: it pays for no bound.
fn sort(task: &Task<'_>, all: &mut [Looked]) {
    all.sort_by(|a, b| {
        let [(one, time), (other_one, other)] = [a, b].map(|(setting, draws)| task.score(setting, draws));
        one.cmp(&other_one).then(time.total_cmp(&other))
    });
}

/// What was found, and the errors beside it.
type Tried<T> = (Vec<Option<T>>, Vec<Option<BadInput>>);

/// Takes results apart, in their order.
fn apart<T>(all: Vec<Result<Option<T>>>) -> Tried<T> {
    let one = |r: Result<Option<T>>| match r {
        Ok(found) => (found, None),
        Err(e) => (None, Some(e)),
    };
    all.into_iter().map(one).unzip()
}

/// The first error, where everything that was tried ended with one: then it is the reason why
/// nothing is proposed. Beside settings that can be looked at, one that cannot is no mistake.
fn all_failed(errors: &[Option<BadInput>]) -> Result<()> {
    let Some(Some(first)) = errors.first().filter(|_| errors.iter().all(Option::is_some)) else { return Ok(()) };
    let remedy = "It is so at every setting that was looked at: change the limits (--limits), or the model (--model)";
    Err(if first.remedy.is_empty() { first.clone().remedy(remedy) } else { first.clone() })
}

/// The share of chaotic motion over the grid.
///
/// # Errors
/// The first of a grid on which the model moves nowhere.
fn map(task: &Task<'_>, grid: &[Setting], tick: &(dyn Fn() + Sync)) -> Result<Vec<MapPoint>> {
    let of = |setting: &Setting| {
        let found = task.at(setting).and_then(|own| trial::share(&own, task.settings.seed, MAP_DRAWS));
        tick();
        found.map(|chaos| chaos.map(|chaos| MapPoint { setting: setting.clone(), chaos }))
    };
    let (points, errors) = apart(grid.par_iter().map(of).collect());
    all_failed(&errors)?;
    Ok(points.into_iter().flatten().collect())
}

/// Settings that were looked at, best first, the best with further draws; and what the setting as
/// it is would tell.
///
/// # Errors
/// The first, where every setting that could be proposed has one.
fn looked(task: &mut Task<'_>, good: &[Setting], tick: &(dyn Fn() + Sync)) -> Result<(Vec<Looked>, Option<Expected>)> {
    let now = task.unchanged();
    let driven = task.rig.drive.is_some();
    let settings: Vec<Setting> =
        std::iter::once(now.clone()).filter(|_| driven).chain(thinned(good, task.settings.budget)).collect();
    let look = |task: &Task<'_>, setting: &Setting, draw: usize| {
        let found = task.look(setting, draw);
        tick();
        found
    };
    let (mut first, errors) = apart(settings.par_iter().map(|s| look(task, s, 0)).collect());
    task.add_rivals(&mut first);
    let task = &*task;
    let unchanged = first.first().and_then(Option::as_ref).filter(|_| driven).cloned();
    // Where it moves chaotically, what is set now is as good as any other.
    let stays = task.at(&now).and_then(|own| trial::share(&own, task.settings.seed, MAP_DRAWS))?;
    let left_out = usize::from(driven && stays.is_none_or(|s| s.chaotic < s.draws));
    all_failed(&errors[left_out..])?;
    let both = settings.into_iter().zip(first).skip(left_out);
    let mut ranked: Vec<Looked> = both.filter_map(|(s, e)| Some((s, vec![e?]))).collect();
    sort(task, &mut ranked);
    let finalists = ranked.len().min(FINALISTS);
    ranked[..finalists].par_iter_mut().for_each(|(setting, all)| {
        // Its first draw was followed: of a further one that is not, nothing is known.
        all.extend((1..=task.settings.further()).filter_map(|draw| look(task, setting, draw).ok().flatten()));
    });
    sort(task, &mut ranked[..finalists]);
    Ok((ranked, unchanged))
}

/// A proposal by further draws alone; as it was where they cannot be followed.
fn confirmed(task: &Task<'_>, best: &Proposal, tick: &(dyn Fn() + Sync)) -> Proposal {
    let draws = FURTHER + 1..FURTHER + 1 + task.settings.confirmed();
    let look = |draw: usize| {
        let found = task.look(&best.setting, draw).ok().flatten();
        tick();
        found
    };
    let all: Vec<Expected> = draws.into_par_iter().filter_map(look).collect();
    if all.is_empty() { best.clone() } else { task.proposal(&best.setting, &all, None) }
}

/// The share of motions that are chaotic at a setting: of `draws` of a model's parameters, by their
/// standard errors, and of initial states. None for a free system.
///
/// # Errors
/// A model of another rig, a setting that the rig cannot have.
pub fn chaotic_share(
    rig: &Rig,
    model: &IdentifiedModel,
    setting: &Setting,
    seed: u64,
    draws: usize,
) -> Result<Option<Share>> {
    trial::share(&moved::at(rig, model, &setting.clone().on(rig))?, seed, draws)
}

/// Refuses a rig with a measured input: a plan proposes drives and poses, and what an input will do
/// in the next record it does not know.
///
/// # Errors
/// Names the input and its channel.
pub fn check_rig(rig: &Rig) -> Result<()> {
    let Some(channel) = rig.inputs().first().map(|i| &rig.channel[*i]) else { return Ok(()) };
    Err(BadInput::new(format!("the measured input {}", channel.measures), "a system without measured inputs")
        .in_file(&rig.path)
        .at(format!("channel \"{}\"", channel.name))
        .remedy(
            "A plan proposes drives and poses; what moves a measured input is not planned yet. Record longer, or with \
             another excitation, and let `whirl explain` say what that record can tell",
        ))
}

/// Makes a plan. `step` is told how many of how many steps are done.
///
/// # Errors
/// A rig with a measured input, a model of another rig, goals that it does not have, limits that
/// cannot be kept, noise that is not known; the first error of what was looked at, where every
/// setting has one.
pub fn plan(
    rig: &Rig,
    model: &IdentifiedModel,
    settings: &Settings<'_>,
    step: &(dyn Fn(u64, u64) + Sync),
) -> Result<Plan> {
    check_rig(rig)?;
    goals::check(settings, model, rig)?;
    let mut task = Task::new(rig, model, settings)?;
    let grid = task.grid()?;
    let done = AtomicU64::new(0);
    let all = (grid.len() + settings.budget + 1 + FINALISTS * settings.further() + settings.confirmed()) as u64;
    let tick = || step((done.fetch_add(1, Ordering::Relaxed) + 1).min(all), all);
    let map = map(&task, &grid, &tick)?;
    let good: Vec<Setting> = if rig.drive.is_some() {
        map.iter().filter(|p| p.chaos.chaotic == p.chaos.draws).map(|p| p.setting.clone()).collect()
    } else {
        task.poses()?
    };
    task.put_in(&good)?;
    task.widen()?;
    let (ranked, unchanged) = looked(&mut task, &good, &tick)?;
    let mut proposals: Vec<Proposal> = ranked.iter().map(|(s, all)| task.proposal(s, all, None)).collect();
    for p in &mut proposals {
        p.chaos = map.iter().find(|m| m.setting == p.setting).map(|m| m.chaos);
    }
    let mut best = (!proposals.is_empty()).then(|| proposals.remove(0));
    if let Some(best) = &mut best {
        *best = confirmed(&task, best, &tick);
        best.chaos = task.at(&best.setting).and_then(|own| trial::share(&own, settings.seed, SHARE_DRAWS))?;
    }
    let unchanged = unchanged.map(|e| task.proposal(&task.unchanged(), &[e], best.as_ref().map(|b| b.seconds)));
    let goals = settings.goals.clone();
    Ok(Plan {
        rig: rig.name.clone(),
        goals,
        best,
        unchanged,
        others: proposals,
        wider: task.wider,
        map,
        seed: settings.seed,
    })
}
