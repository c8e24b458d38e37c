//! The next experiment: what to set, how long, and what it will tell.
//!
//! The identified model is moved to other settings of the drive ([`moved`]), or let go from other poses where there is none. Where its motion is chaotic for every draw of its
//! parameters' standard errors ([`trial`]), it makes a record as the rig's channels would show it, and that record is looked at as every record is
//! ([`crate::explain::engine::expected`]): standard errors of parameters, and standard errors between an effect and its rivals. Standard errors fall with the root of the
//! record's length, which gives the time that each goal takes. The setting that reaches all goals first is proposed; further draws of its initial state and
//! parameters tell how much that depends on them, and the worst of them counts.
//!
//! Sources: Atkinson and Fedorov (1975), *Biometrika* 62, 57 (discrimination by the best-fitting rival); Atkinson, Donev and Tobias (2007), *Optimum Experimental Designs, with
//! SAS*, ch. 10 (D_s-optimality). Without goals the mean logarithm of the parameters' relative standard errors is minimised (D-optimality on a diagonal).
//!
//! Limits: parameters are drawn by their standard errors without their correlations; waveform, direction and exchanged masses are not searched; of a force that drives
//! written equations the frequency is not changed rightly ([`moved`]).

pub mod goals;
mod moved;
pub mod presentation;
mod trial;
pub mod written;

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;
use serde::Serialize;

use self::goals::{Goals, Limits, TO_95, Tell};
use self::moved::Own;
pub use self::moved::rig_at;
use self::trial::Made;
pub use self::trial::Share;
use crate::error::{BadInput, Result};
use crate::explain::double_pendulum;
use crate::explain::engine::expected::{Expected, Separation, expected, with_effect};
use crate::identify::Parameter;
use crate::identify::general;
use crate::model::identified::{IdentifiedModel, System};
use crate::record::Record;
use crate::rig::Rig;

/// Standard errors at which effects are told apart.
pub const APART: f64 = 5.0;
/// Length of the records that are looked at, s: driven, and let go.
const LOOKED_AT_S: [f64; 2] = [40.0, 20.0];
/// Longest record that is proposed where nothing else is said, s.
const LONGEST_S: f64 = 1800.0;
/// Length that is proposed where no goal is given, s.
const WITHOUT_GOAL_S: f64 = 240.0;
/// Frequencies and amplitudes of the map, and draws at each.
const GRID: [usize; 2] = [8, 6];
const MAP_DRAWS: usize = 3;
/// Where nothing else is said: frequencies and amplitudes beside those of the model, and acceleration.
const AROUND: [[f64; 2]; 2] = [[0.6, 1.6], [0.5, 1.6]];
const HARDER: f64 = 1.6;
/// Steps of frequencies, Hz, and amplitudes, m.
const FREQUENCY_STEP_HZ: f64 = 0.01;
const AMPLITUDE_STEP_M: f64 = 1e-5;
/// Further draws of the settings that are best.
const FURTHER: usize = 2;
/// Settings that are looked at again with further draws.
const FINALISTS: usize = 3;
/// Draws of the chaotic share of what is proposed.
const SHARE_DRAWS: usize = 12;
/// Effects that were not named of which is told how near they are.
const NEAREST: usize = 3;
/// Records by which an effect's size is put into the model, at most.
const TRIES: usize = 4;
/// Poses from which a free system is let go, as angles.
const POSE_GRID: [f64; 6] = [0.6, 1.2, 1.8, 2.4, 2.8, -2.0];

/// What is set.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Setting {
    /// Frequency of the drive, Hz.
    pub frequency_hz: Option<f64>,
    /// Amplitude of the base in units of that at which the model was identified.
    pub amplitude_factor: Option<f64>,
    /// The same in m, where it is known.
    pub amplitude_m: Option<f64>,
    /// Coordinates from which a free system is let go at rest, rad or m (with rates behind them where it is not at rest).
    pub pose: Option<Vec<f64>>,
}

/// A goal and the time that it takes at a setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reached {
    /// The goal, for people.
    pub goal: String,
    /// Record that reaches it, s; none where no length does.
    pub seconds: Option<f64>,
}

/// A setting and what a record there would tell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Proposal {
    /// What is set.
    pub setting: Setting,
    /// Length of the record, s.
    pub seconds: f64,
    /// Whether that reaches every goal.
    pub decides: bool,
    /// Share of draws that move chaotically; none for a free system.
    pub chaos: Option<Share>,
    /// Parameters with the standard errors that a record of that length would have.
    pub parameters: Vec<Parameter>,
    /// How far effects of the model would stand from others, in standard errors.
    pub separations: Vec<Separation>,
    /// The time of each goal.
    pub goals: Vec<Reached>,
    /// Records that were simulated for it.
    pub draws: usize,
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
    /// How much wider than by the sensors' noise alone all intervals are taken, for what the model does not explain; 1 where no record was given.
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

/// What all settings have in common.
struct Task<'a> {
    rig: &'a Rig,
    model: IdentifiedModel,
    settings: &'a Settings<'a>,
    noise: Vec<f64>,
    /// Amplitude of the base at which the model was identified, m.
    amplitude_m: Option<f64>,
    /// How much wider the model's own intervals are than those of a record of it.
    wider: f64,
    /// Effects from which those asked for are to be told: those named, and every other of the list that some setting tells.
    rivals: BTreeSet<String>,
}

/// The base's amplitude, m: the rig file's, or as identified.
fn amplitude_m(rig: &Rig, model: &IdentifiedModel) -> Option<f64> {
    let drive = rig.drive?;
    let value = |n: &str| model.parameter(n).map(|p| p.value);
    let found = || Some(model.found_with.get("a_c")?.hypot(*model.found_with.get("a_s")?));
    let identified = || {
        // a = B_23 l, with l = B_22 Ω²/g the second arm's lever over its inertia.
        let built_in = matches!(&model.system, System::BuiltIn(id) if id == "double-pendulum");
        let lever = value("B22")? * rig.omega().powi(2) / rig.known.get("g").copied().unwrap_or(crate::rig::GRAVITY);
        built_in.then_some(value("B23")?.hypot(value("B24")?) / lever.abs())
    };
    drive.amplitude_m.or_else(found).or_else(identified).filter(|a| a.is_finite() && *a > 0.0)
}

/// Rms noise of each channel that does not count, in its own unit.
fn noise(rig: &Rig, own: &Own, record: Option<&Record>) -> Result<Vec<f64>> {
    let counts = |k: usize| rig.channel[k].unit == "count";
    let Some(bound) = own.rig.bound.as_deref() else { return Ok(Vec::new()) };
    let mut out = vec![0.0; rig.channel.len()];
    if (0..rig.channel.len()).all(counts) {
        return Ok(out);
    }
    let Some(record) = record else {
        return Err(BadInput::new("channels that do not count, whose noise is not known", "a record of them")
            .at("--record")
            .remedy("Name a record of this rig: --record REC; its noise is that of the next"));
    };
    let prepared =
        general::prepare(std::slice::from_ref(record), &own.rig, bound, &crate::identify::Settings::default())?;
    for (sensor, channel) in bound.sensors.iter().enumerate() {
        let sigma = prepared.sensors.sigma.get(sensor).copied().unwrap_or(0.0);
        out[*channel] = sigma / rig.channel[*channel].scale().abs();
    }
    Ok(out)
}

/// Coordinates, then rates, with which a record begins.
fn start_of(own: &Own, record: &Record) -> Result<Vec<f64>> {
    let motion = trial::without_memory(own, &own.model)?;
    Ok(crate::motion::from_record::begin(&motion, record, None)?.state)
}

/// Evenly spaced numbers.
fn spaced([low, high]: [f64; 2], count: usize) -> Vec<f64> {
    let step = if count > 1 { (high - low) / (count - 1) as f64 } else { 0.0 };
    (0..count).map(|k| low + k as f64 * step).collect()
}

impl Task<'_> {
    fn at(&self, setting: &Setting) -> Result<Own> {
        moved::at(self.rig, &self.model, setting)
    }

    fn setting(&self, frequency_hz: f64, amplitude_factor: f64) -> Setting {
        Setting {
            frequency_hz: Some(frequency_hz),
            amplitude_factor: Some(amplitude_factor),
            amplitude_m: self.amplitude_m.map(|a| a * amplitude_factor),
            pose: None,
        }
    }

    /// The same in steps that a device takes and a person reads, inside the limits.
    fn rounded(&self, frequency_hz: f64, amplitude_factor: f64) -> Setting {
        let down = |x: f64, step: f64| (x / step + 1e-6).floor() * step;
        let frequency_hz = (1e3 * down(frequency_hz, FREQUENCY_STEP_HZ)).round() / 1e3;
        match self.amplitude_m {
            Some(a) => {
                let step = AMPLITUDE_STEP_M.min(0.01 * a * amplitude_factor);
                let in_m = down(a * amplitude_factor, step);
                Setting { amplitude_m: Some(in_m), ..self.setting(frequency_hz, in_m / a) }
            }
            None => self.setting(frequency_hz, amplitude_factor),
        }
    }

    /// The setting of the model.
    fn unchanged(&self) -> Setting {
        self.rig.drive.map_or_else(Setting::default, |d| self.setting(d.frequency_hz, 1.0))
    }

    /// Settings of the drive within the limits.
    fn grid(&self) -> Result<Vec<Setting>> {
        let Some(drive) = self.rig.drive else { return Ok(Vec::new()) };
        let limits = &self.settings.limits;
        let around = |x: f64, [low, high]: [f64; 2]| [low * x, high * x];
        let frequencies = limits.frequency_hz.unwrap_or_else(|| around(drive.frequency_hz, AROUND[0]));
        let amplitudes = match (limits.amplitude_m, self.amplitude_m, limits.amplitude_factor) {
            (Some([low, high]), Some(a), _) => [low / a, high / a],
            (Some(_), None, _) => {
                return Err(BadInput::new(
                    "amplitude_m, where the amplitude of the model is not known",
                    "amplitude_factor",
                )
                .at("--limits")
                .remedy("Give amplitude_factor in the limits file, or amplitude_m in the rig file's [drive]"));
            }
            (None, _, factor) => factor.unwrap_or(AROUND[1]),
        };
        // What the shaker does now and a little more, unless something is said.
        let now = drive.frequency_hz.powi(2);
        let most = match (limits.acceleration_m_s2, self.amplitude_m) {
            (Some(most), Some(a)) => most / (a * core::f64::consts::TAU.powi(2) * now),
            (Some(_), None) => {
                return Err(BadInput::new(
                    "acceleration_m_s2, where the amplitude of the model is not known",
                    "amplitude_factor",
                )
                .at("--limits")
                .remedy("Give amplitude_m in the rig file's [drive]"));
            }
            _ => HARDER,
        };
        let hard = |f: f64, a: f64| a * f * f / now;
        let mut out = Vec::new();
        for f in spaced(frequencies, GRID[0]) {
            let within = spaced(amplitudes, GRID[1]).into_iter().filter(|a| hard(f, *a) <= most * (1.0 + 1e-9));
            out.extend(within.map(|a| self.rounded(f, a)));
        }
        Ok(out)
    }

    /// Poses of a free system, spread over all of its coordinates.
    fn poses(&self, own: &Own) -> Vec<Setting> {
        let Some(bound) = own.rig.bound.as_deref() else { return Vec::new() };
        let circle = bound.model.circle();
        let of = |k: usize, i: usize| {
            let x = POSE_GRID[(k / POSE_GRID.len().pow(i as u32)) % POSE_GRID.len()];
            if circle[i] { x } else { 0.1 * x }
        };
        let count = POSE_GRID.len().pow(circle.len().min(3) as u32);
        let all = (0..count).map(|k| (0..circle.len()).map(|i| of(k, i)).collect());
        all.map(|pose| Setting { pose: Some(pose), ..Setting::default() }).collect()
    }

    /// What one draw of a record would tell, scaled to no length yet; none where it cannot be followed.
    fn look(&self, setting: &Setting, draw: usize) -> Option<Expected> {
        let own = self.at(setting).ok()?;
        let record = trial::record(&own, &self.made(setting, draw)).ok()?;
        let mut found = expected(record, &own.rig, &own.model).ok()??;
        if matches!(&self.model.system, System::BuiltIn(id) if id == "double-pendulum") {
            double_pendulum::told(&mut found.parameters, own.rig.omega());
        }
        let known = |p: &Parameter| p.std_error.is_finite() && p.value.is_finite();
        found.parameters.retain(known);
        found.parameters.iter_mut().for_each(|p| p.std_error *= self.wider);
        found.separations.iter_mut().for_each(|s| s.deviations /= self.wider);
        (!found.parameters.is_empty()).then_some(found)
    }

    /// How much wider the model's standard errors are than those that a record of the model itself would have, over the length of the record that it is of: what the model
    /// does not explain is in its own. Median over its coefficients, 1 at least.
    fn widened(&self, record: &Record) -> Result<f64> {
        let now = self.unchanged();
        let own = self.at(&now)?;
        let pose = if self.rig.drive.is_none() { Some(start_of(&own, record)?) } else { None };
        let setting = Setting { pose, ..now };
        let Some(found) = self.look(&setting, 0) else { return Ok(1.0) };
        let shorter = (self.looked_at_s() / record.duration_s().max(self.looked_at_s())).sqrt();
        let ratio = |p: &Parameter| {
            let given = self.model.parameter(&p.name).filter(|g| g.std_error > 0.0)?;
            Some(given.std_error / (p.std_error * shorter)).filter(|r| r.is_finite())
        };
        let mut all: Vec<f64> = found.parameters.iter().filter_map(ratio).collect();
        all.sort_by(f64::total_cmp);
        Ok(all.get(all.len() / 2).copied().unwrap_or(1.0).max(1.0))
    }

    /// Puts effects of given sizes into the model, by a record of it that can be followed.
    fn put_in(&mut self, good: &[Setting]) -> Result<()> {
        let has = |m: &IdentifiedModel, name: &str| m.effects.iter().any(|e| format!("{}@{}", e.id, e.at) == name);
        for tell in &self.settings.sizes {
            let Some(size) = tell.size.filter(|_| !has(&self.model, &tell.name)) else { continue };
            let mut last = None;
            for setting in std::iter::once(&self.unchanged()).chain(good).take(TRIES) {
                let own = self.at(setting)?;
                let made = self.made(setting, 0);
                match trial::record(&own, &made).and_then(|r| with_effect(r, &own.rig, &own.model, (&tell.name, size)))
                {
                    Ok(Some(found)) => {
                        self.model.effects = found.effects;
                        self.model.found_with = found.found_with;
                        let back = setting.amplitude_factor.unwrap_or(1.0);
                        moved::scale_amplitude(&mut self.model, 1.0 / back);
                        last = None;
                        break;
                    }
                    Ok(None) => {}
                    Err(e) => last = Some(e),
                }
            }
            if let Some(e) = last {
                return Err(e);
            }
            if !has(&self.model, &tell.name) {
                return Err(
                    BadInput::new(format!("\"{}\"", tell.name), "an effect that this rig can have").at("--tell")
                );
            }
        }
        Ok(())
    }

    fn made<'b>(&'b self, setting: &'b Setting, draw: usize) -> Made<'b> {
        Made {
            seconds: self.looked_at_s(),
            pose: setting.pose.as_deref(),
            noise: &self.noise,
            seed: (self.settings.seed, draw),
        }
    }

    fn looked_at_s(&self) -> f64 {
        LOOKED_AT_S[usize::from(self.rig.drive.is_none())]
    }

    fn longest_s(&self) -> f64 {
        self.settings.limits.seconds.unwrap_or(LONGEST_S)
    }

    /// Whether it belongs to what was asked.
    fn is_asked(&self, s: &Separation) -> bool {
        self.settings.goals.tell.contains(&s.effect) && s.from.as_ref().is_none_or(|n| self.rivals.contains(n))
    }

    /// The hardest of what is to be told.
    fn nearest<'b>(&self, all: &'b [Separation]) -> Option<&'b Separation> {
        all.iter().filter(|s| self.is_asked(s)).min_by(|a, b| a.deviations.total_cmp(&b.deviations))
    }

    /// Adds every effect of the list that some setting tells from what was asked: another that none tells stands for the same motion.
    fn add_rivals(&mut self, all: &[Option<Expected>]) {
        let mut most: BTreeMap<&str, f64> = BTreeMap::new();
        let asked = |s: &&Separation| self.settings.goals.tell.contains(&s.effect);
        for s in all.iter().flatten().flat_map(|e| &e.separations).filter(asked) {
            if let Some(from) = &s.from {
                let own = most.entry(from).or_insert(0.0);
                *own = own.max(s.deviations);
            }
        }
        let longest = (self.longest_s() / self.looked_at_s()).sqrt();
        let told = most.into_iter().filter(|(_, d)| d * longest >= APART).map(|(n, _)| n.to_owned());
        self.rivals.extend(told);
    }

    /// Time that each goal takes by what draws would tell, the worst of them.
    fn times(&self, all: &[Expected]) -> Vec<Reached> {
        let looked = self.looked_at_s();
        let worst = |of: &dyn Fn(&Expected) -> Option<f64>| -> Option<f64> {
            all.iter().map(of).try_fold(0.0_f64, |most, x| Some(most.max(x?))).filter(|x| x.is_finite())
        };
        let goals = &self.settings.goals;
        let apart = |e: &Expected| {
            let nearest = self.nearest(&e.separations)?.deviations;
            (nearest > 0.0).then(|| looked * (APART / nearest).powi(2))
        };
        let mut out = Vec::new();
        if !goals.tell.is_empty() {
            out.push(Reached { goal: presentation::told_apart(&goals.tell), seconds: worst(&apart) });
        }
        for p in &goals.precise {
            let narrow = |e: &Expected| {
                let found = e.parameters.iter().find(|q| q.name == p.name)?;
                Some(looked * (TO_95 * found.std_error / (p.share * found.value.abs())).powi(2))
            };
            let goal = format!("{} to ± {} % (95 %)", p.name, 100.0 * p.share);
            out.push(Reached { goal, seconds: worst(&narrow) });
        }
        out
    }

    /// How good a setting is, less is better: the time of the slowest goal; without goals the mean logarithm of relative standard errors.
    fn score(&self, all: &[Expected]) -> f64 {
        let times = self.times(all);
        if times.is_empty() {
            let one = |e: &Expected| {
                let relative = e.parameters.iter().map(|p| (p.std_error / p.value.abs().max(1e-12)).max(1e-12).ln());
                relative.sum::<f64>() / e.parameters.len() as f64
            };
            return all.iter().map(one).fold(f64::NEG_INFINITY, f64::max);
        }
        times.iter().map(|r| r.seconds.unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
    }

    /// A proposal from what draws would tell, for a record of `seconds`, or as long as its goals take.
    fn proposal(&self, setting: &Setting, all: &[Expected], seconds: Option<f64>) -> Proposal {
        let goals = self.times(all);
        let wanted = goals.iter().map(|r| r.seconds.unwrap_or(f64::INFINITY)).fold(0.0, f64::max);
        let longest = self.longest_s();
        let own = if goals.is_empty() { WITHOUT_GOAL_S } else { wanted.max(self.looked_at_s()) };
        let seconds = seconds.unwrap_or_else(|| own.min(longest));
        let shorter = (self.looked_at_s() / seconds).sqrt();
        let first = &all[0];
        let mut parameters = first.parameters.clone();
        for p in &mut parameters {
            let worst = all.iter().filter_map(|e| e.parameters.iter().find(|q| q.name == p.name));
            p.std_error = shorter * worst.map(|q| q.std_error).fold(0.0, f64::max);
        }
        let mut separations = first.separations.clone();
        for s in &mut separations {
            let same = |e: &&Separation| e.effect == s.effect && e.from == s.from;
            let worst = all.iter().filter_map(|e| e.separations.iter().find(same));
            s.deviations = worst.map(|q| q.deviations).fold(f64::INFINITY, f64::min) / shorter;
        }
        separations.sort_by(|a, b| a.deviations.total_cmp(&b.deviations));
        let named = |s: &Separation| s.from.as_ref().is_none_or(|n| self.settings.goals.tell.contains(n));
        let mut others = 0;
        separations.retain(|s| {
            let other = self.is_asked(s) && !named(s);
            others += usize::from(other);
            named(s) || (other && others <= NEAREST)
        });
        Proposal {
            setting: setting.clone(),
            seconds,
            decides: wanted <= seconds,
            chaos: None,
            parameters,
            separations,
            goals,
            draws: all.len(),
        }
    }
}

/// Every n-th of a list, so that about `most` are left, from all over it.
fn thinned<T: Clone>(all: &[T], most: usize) -> Vec<T> {
    let count = all.len().min(most.max(1));
    (0..count).map(|k| all[k * all.len() / count].clone()).collect()
}

/// Makes a plan. `step` is told how many of how many steps are done.
///
/// # Errors
/// A model of another rig, goals that it does not have, limits that cannot be kept, noise that is not known.
pub fn plan(
    rig: &Rig,
    model: &IdentifiedModel,
    settings: &Settings<'_>,
    step: &(dyn Fn(u64, u64) + Sync),
) -> Result<Plan> {
    let own = moved::own(rig, model)?;
    check_goals(settings, model)?;
    let mut task = Task {
        rig,
        model: model.clone(),
        settings,
        noise: noise(rig, &own, settings.record)?,
        amplitude_m: amplitude_m(rig, model),
        wider: 1.0,
        rivals: settings.goals.tell.iter().cloned().collect(),
    };
    let done = std::sync::atomic::AtomicU64::new(0);
    let grid = task.grid()?;
    let budget = settings.budget.max(1);
    let all = (grid.len() + budget + 1 + FINALISTS * FURTHER) as u64;
    let tick = || step(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, all);
    let shares: Vec<Option<Share>> = grid
        .par_iter()
        .map(|s| {
            let found = task.at(s).and_then(|own| trial::share(&own, settings.seed, MAP_DRAWS)).ok().flatten();
            tick();
            found
        })
        .collect();
    let point =
        |(setting, share): (&Setting, &Option<Share>)| Some(MapPoint { setting: setting.clone(), chaos: (*share)? });
    let map: Vec<MapPoint> = grid.iter().zip(&shares).filter_map(point).collect();
    let good: Vec<Setting> = if rig.drive.is_some() {
        map.iter().filter(|p| p.chaos.chaotic == p.chaos.draws).map(|p| p.setting.clone()).collect()
    } else {
        task.poses(&own)
    };
    task.put_in(&good)?;
    if let Some(record) = settings.record {
        task.wider = task.widened(record)?;
    }
    let now = task.unchanged();
    let begin = usize::from(rig.drive.is_some());
    let looked: Vec<Setting> = std::iter::once(now.clone()).take(begin).chain(thinned(&good, budget)).collect();
    let first: Vec<Option<Expected>> = looked
        .par_iter()
        .map(|s| {
            let found = task.look(s, 0);
            tick();
            found
        })
        .collect();
    let unchanged = first.first().and_then(Option::as_ref).filter(|_| rig.drive.is_some()).cloned();
    task.add_rivals(&first);
    // Where it moves chaotically, what is set now is as good as any other.
    let stays = task.at(&now).and_then(|own| trial::share(&own, settings.seed, MAP_DRAWS))?;
    let first_good = if stays.is_some_and(|s| s.chaotic == s.draws) { 0 } else { begin };
    let mut ranked: Vec<(Setting, Vec<Expected>)> =
        looked.iter().zip(first).skip(first_good).filter_map(|(s, e)| Some((s.clone(), vec![e?]))).collect();
    ranked.sort_by(|a, b| task.score(&a.1).total_cmp(&task.score(&b.1)));
    let further: Vec<Vec<Option<Expected>>> = ranked
        .par_iter()
        .take(FINALISTS)
        .map(|(s, _)| {
            // Where a free system is let go nothing is drawn but its parameters.
            (1..=FURTHER)
                .map(|draw| {
                    let found = task.look(s, draw);
                    tick();
                    found
                })
                .collect()
        })
        .collect();
    for ((_, own), more) in ranked.iter_mut().zip(further) {
        own.extend(more.into_iter().flatten());
    }
    let finalists = ranked.len().min(FINALISTS);
    ranked[..finalists].sort_by(|a, b| task.score(&a.1).total_cmp(&task.score(&b.1)));
    let mut proposals: Vec<Proposal> = ranked.iter().map(|(s, all)| task.proposal(s, all, None)).collect();
    let mut best = (!proposals.is_empty()).then(|| proposals.remove(0));
    if let Some(best) = &mut best {
        best.chaos = task.at(&best.setting).and_then(|own| trial::share(&own, settings.seed, SHARE_DRAWS))?;
    }
    for p in &mut proposals {
        p.chaos = map.iter().find(|m| m.setting == p.setting).map(|m| m.chaos);
    }
    let unchanged = unchanged.map(|e| task.proposal(&task.unchanged(), &[e], best.as_ref().map(|b| b.seconds)));
    Ok(Plan {
        rig: rig.name.clone(),
        goals: settings.goals.clone(),
        best,
        unchanged,
        others: proposals,
        wider: task.wider,
        map,
        seed: settings.seed,
    })
}

/// Refuses goals that the model does not have.
fn check_goals(settings: &Settings<'_>, model: &IdentifiedModel) -> Result<()> {
    let goals = &settings.goals;
    let names: Vec<String> = model.effects.iter().map(|e| format!("{}@{}", e.id, e.at)).collect();
    let sized = settings.sizes.iter().any(|t| t.size.is_some());
    if !goals.tell.is_empty() && !sized && !goals.tell.iter().any(|t| names.contains(t)) {
        let has = if names.is_empty() { "no effect".to_owned() } else { names.join(", ") };
        let found = format!("{} for a model with {has}", goals.tell.join(","));
        return Err(BadInput::new(found, "an effect that the model has, or one with its size")
            .at("--tell")
            .remedy("Give the model that `whirl explain -o` wrote, or the size that it would have: ID@PLACE=VALUE"));
    }
    if let Some(p) = goals.precise.iter().find(|p| model.parameter(&p.name).is_none()) {
        let all: Vec<&str> = model.parameters.iter().map(|p| p.name.as_str()).collect();
        return Err(BadInput::new(format!("\"{}\"", p.name), format!("a parameter of the model: {}", all.join(", ")))
            .at("--precise"));
    }
    Ok(())
}
