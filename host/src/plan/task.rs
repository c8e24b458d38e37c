//! What all settings of a plan have in common: rig, model, noise, limits; what a record at one of
//! them would tell.

mod grid;

use std::collections::{BTreeMap, BTreeSet};

use self::grid::amplitude_m;
use super::moved::{self, Own};
use super::rate::Rate;
use super::trial::{self, Made};
use super::{APART, Proposal, Reached, Separated, Setting, Settings, presentation};
use crate::error::{BadInput, Result};
use crate::explain::double_pendulum;
use crate::explain::engine::expected::{Expected, MOST_SAMPLES, Separation, expected, with_effect};
use crate::identify::{Parameter, prepare};
use crate::model::identified::IdentifiedModel;
use crate::record::Record;
use crate::rig::Rig;
use crate::statistics::Z95;
use crate::system::library::Pendulum;

/// Length of the records that are looked at: driven, in periods, so that windows can grow to their
/// longest; let go, s (by hand).
const LOOKED_AT_PERIODS: f64 = 200.0;
pub const LOOKED_AT_S: f64 = 20.0;
/// Time that a motion at the setting of the model is given, periods: of 300 initial states of the
/// rig `rigs/seed.toml` nine tenths still moved chaotically after 100, 1 % after 600.
const STAYS_PERIODS: f64 = 600.0;
/// Longest record that is proposed where nothing else is said, s (by hand).
const LONGEST_S: f64 = 1800.0;
/// Length that is proposed where no goal is given, s (by hand).
const WITHOUT_GOAL_S: f64 = 240.0;
/// Effects that were not named of which is told how near they are (by hand).
const NEAREST: usize = 3;
/// Times as far as the nearest from which an effect is not looked at again (by hand).
const BEYOND: f64 = 3.0;
/// Records by which an effect's size is put into the model, at most (by hand).
const TRIES: usize = 4;

/// A separation and its information by draws of records.
struct Rated {
    of: Separation,
    rate: Option<Rate>,
    /// Records in which it was found.
    draws: usize,
}

/// What all settings have in common.
pub struct Task<'a> {
    pub rig: &'a Rig,
    model: IdentifiedModel,
    pub settings: &'a Settings<'a>,
    noise: Vec<f64>,
    /// Amplitude of the base at which the model was identified, m.
    amplitude_m: Option<f64>,
    /// How much wider the model's own intervals are than those of a record of it.
    pub wider: f64,
    /// Effects from which those asked for are to be told: those named, and every other of the list
    /// that some setting tells.
    rivals: BTreeSet<String>,
    /// Those of them that may be the nearest; none before that is known.
    near: Option<BTreeSet<String>>,
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
    let prepared = prepare(std::slice::from_ref(record), &own.rig, bound, &crate::identify::Settings::default())?;
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

impl<'a> Task<'a> {
    /// What all settings of a plan have in common.
    ///
    /// # Errors
    /// A model of another rig, noise that is not known.
    pub fn new(rig: &'a Rig, model: &IdentifiedModel, settings: &'a Settings<'a>) -> Result<Self> {
        let own = moved::own(rig, model)?;
        Ok(Self {
            rig,
            model: model.clone(),
            settings,
            noise: noise(rig, &own, settings.record)?,
            amplitude_m: amplitude_m(rig, model),
            wider: 1.0,
            rivals: settings.goals.tell.iter().cloned().collect(),
            near: None,
        })
    }

    /// The rig and its model at a setting.
    ///
    /// # Errors
    /// A rig that cannot be had at it.
    pub fn at(&self, setting: &Setting) -> Result<Own> {
        moved::at(self.rig, &self.model, setting)
    }

    /// What one draw of a record would tell; none where it cannot be followed.
    ///
    /// # Errors
    /// A record that cannot be made or identified, a model that cannot be taken over.
    pub fn look(&self, setting: &Setting, draw: usize) -> Result<Option<Expected>> {
        self.look_for(setting, draw, self.looked_at_s(setting))
    }

    /// The same of some length, s.
    fn look_for(&self, setting: &Setting, draw: usize, seconds: f64) -> Result<Option<Expected>> {
        let own = self.at(setting)?;
        let record = trial::record(&own, &Made { seconds, ..self.made(setting, draw) })?;
        let asked = !self.settings.goals.tell.is_empty();
        let is_rival = |name: &str| asked && self.near.as_ref().is_none_or(|n| n.contains(name));
        let Some(mut found) = expected(record, &own.rig, &own.model, &is_rival)? else { return Ok(None) };
        if self.model.system.pendulum() == Some(Pendulum::Double) {
            double_pendulum::to_non_dimensional(&mut found.parameters, &own.rig);
        }
        let known = |p: &Parameter| p.std_error.is_finite() && p.value.is_finite();
        found.parameters.retain(known);
        found.parameters.iter_mut().for_each(|p| p.std_error *= self.wider);
        found.separations.iter_mut().for_each(|s| s.deviations /= self.wider);
        Ok((!found.parameters.is_empty()).then_some(found))
    }

    /// How much wider the model's standard errors are than those that a record of the model itself
    /// would have, over the length of the record that it is of: what the model does not explain is
    /// in its own. Median over its coefficients, 1 at least.
    ///
    /// # Errors
    /// A record that does not begin with this rig's motion.
    pub fn widen(&mut self) -> Result<()> {
        if let Some(record) = self.settings.record {
            self.wider = self.widened(record)?;
        }
        Ok(())
    }

    fn widened(&self, record: &Record) -> Result<f64> {
        let now = self.unchanged();
        let own = self.at(&now)?;
        let pose = if self.rig.drive.is_none() { Some(start_of(&own, record)?) } else { None };
        let setting = Setting { pose, ..now };
        // A limit may be shorter than what is looked at.
        let seconds = record.duration_s().max(self.looked_at_s(&setting)).min(self.longest_s());
        // What is set now may be what cannot be looked at, and the reason for a plan.
        let Ok(Some(found)) = self.look_for(&setting, 0, seconds) else { return Ok(1.0) };
        let ratio = |p: &Parameter| {
            let given = self.model.parameter(&p.name).filter(|g| g.std_error > 0.0)?;
            Some(given.std_error / p.std_error).filter(|r| r.is_finite())
        };
        let mut all: Vec<f64> = found.parameters.iter().filter_map(ratio).collect();
        all.sort_by(f64::total_cmp);
        Ok(all.get(all.len() / 2).copied().unwrap_or(1.0).max(1.0))
    }

    /// Puts effects of given sizes into the model, by a record of it that can be followed.
    ///
    /// # Errors
    /// An effect that the rig cannot have.
    pub fn put_in(&mut self, good: &[Setting]) -> Result<()> {
        let has = |m: &IdentifiedModel, name: &str| m.effects.iter().any(|e| e.name() == name);
        for tell in &self.settings.sizes {
            let Some(size) = tell.size.filter(|_| !has(&self.model, &tell.name)) else { continue };
            let mut last = None;
            for setting in std::iter::once(&self.unchanged()).chain(good).take(TRIES) {
                let own = self.at(setting)?;
                let made = self.made(setting, 0);
                match trial::record(&own, &made).and_then(|r| with_effect(r, &own.rig, &own.model, &tell.name, size)) {
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
            seconds: self.looked_at_s(setting),
            pose: setting.pose.as_deref(),
            settle_periods: self.settle_periods(setting),
            noise: &self.noise,
            seed: (self.settings.seed, draw),
        }
    }

    /// Time that a driven motion is given to come to its attractor, periods.
    fn settle_periods(&self, setting: &Setting) -> f64 {
        match setting.frequency_hz {
            Some(f) if *setting == self.unchanged() => {
                (self.followed_s() * f).clamp(trial::SETTLE_PERIODS, STAYS_PERIODS)
            }
            _ => trial::SETTLE_PERIODS,
        }
    }

    /// Length of the records that are looked at, s.
    pub fn looked_at_s(&self, setting: &Setting) -> f64 {
        let frequency_hz = setting.frequency_hz.or(self.rig.drive.map(|d| d.frequency_hz));
        frequency_hz.map_or(LOOKED_AT_S, |f| LOOKED_AT_PERIODS / f).min(self.followed_s())
    }

    /// What explanations look at of a record, s: of a slow drive's 200 periods no more is made.
    fn followed_s(&self) -> f64 {
        MOST_SAMPLES as f64 / self.rig.sample_rate_hz
    }

    /// Longest record, s: what is longer than explanations look at tells no more.
    pub fn longest_s(&self) -> f64 {
        self.settings.limits.seconds.unwrap_or(LONGEST_S).min(self.followed_s())
    }

    /// Whether it belongs to what was asked.
    fn is_asked(&self, s: &Separation) -> bool {
        self.settings.goals.tell.contains(&s.effect) && s.from.as_ref().is_none_or(|n| self.rivals.contains(n))
    }

    /// The hardest of what is to be told.
    fn nearest<'b>(&self, all: &'b [Separation]) -> Option<&'b Separation> {
        all.iter().filter(|s| self.is_asked(s)).min_by(|a, b| a.deviations.total_cmp(&b.deviations))
    }

    /// Adds every effect of the list that some setting tells from what was asked: another that none
    /// tells stands for the same motion. Those that are far beyond the nearest everywhere are not
    /// looked at again.
    pub fn add_rivals(&mut self, all: &mut [Option<Expected>]) {
        let mut most: BTreeMap<&str, f64> = BTreeMap::new();
        let asked = |s: &&Separation| self.settings.goals.tell.contains(&s.effect);
        for s in all.iter().flatten().flat_map(|e| &e.separations).filter(asked) {
            if let Some(from) = &s.from {
                let own = most.entry(from).or_insert(0.0);
                *own = own.max(s.deviations);
            }
        }
        let longest = (self.longest_s() / self.looked_at_s(&self.unchanged())).sqrt();
        let told = most.into_iter().filter(|(_, d)| d * longest >= APART).map(|(n, _)| n.to_owned());
        self.rivals.extend(told.collect::<Vec<_>>());
        let mut near: BTreeSet<String> = self.settings.goals.tell.iter().cloned().collect();
        for e in all.iter().flatten() {
            let Some(nearest) = self.nearest(&e.separations) else { continue };
            let is_near = |s: &&Separation| self.is_asked(s) && s.deviations <= BEYOND * nearest.deviations;
            near.extend(e.separations.iter().filter(is_near).filter_map(|s| s.from.clone()));
        }
        let kept = |s: &Separation| s.from.as_ref().is_none_or(|n| near.contains(n));
        all.iter_mut().flatten().for_each(|e| e.separations.retain(kept));
        self.near = Some(near);
    }

    /// Information of separations by draws of records: squares of standard errors.
    fn separations(all: &[Expected]) -> Vec<Rated> {
        let rated = |s: &Separation| {
            let same = |e: &&Separation| e.effect == s.effect && e.from == s.from;
            let own = all.iter().filter_map(|e| e.separations.iter().find(same));
            let squares: Vec<f64> = own.map(|q| q.deviations.powi(2)).collect();
            Rated { of: s.clone(), rate: Rate::of(&squares, true), draws: squares.len() }
        };
        all.first().map_or(&[][..], |e| &e.separations).iter().map(rated).collect()
    }

    /// Information on a parameter by draws of records: one over its variance.
    fn on_parameter(name: &str, all: &[Expected]) -> Option<Rate> {
        let own = all.iter().map(|e| e.parameters.iter().find(|q| q.name == name));
        Rate::of(&own.map(|q| q.map_or(0.0, |q| q.std_error.powi(-2))).collect::<Vec<_>>(), false)
    }

    /// Time after which one more record reaches each goal with a probability of 97.5 %, by draws of
    /// records of `looked` seconds; of one draw, after which another like it does.
    fn times(&self, all: &[Expected], looked: f64) -> Vec<Reached> {
        let in_time = |x: f64| Some(x * looked).filter(|x| x.is_finite() && *x < 1e6 * looked);
        let goals = &self.settings.goals;
        let mut out = Vec::new();
        if !goals.tell.is_empty() {
            let longer = |rate: &Option<Rate>| rate.map_or(f64::INFINITY, |r| r.longer(APART.powi(2)));
            let asked: Vec<Rated> = Self::separations(all).into_iter().filter(|s| self.is_asked(&s.of)).collect();
            let seconds = asked.iter().map(|s| longer(&s.rate)).max_by(f64::total_cmp).and_then(in_time);
            let draws = asked.iter().map(|s| s.draws).min().unwrap_or(all.len());
            out.push(Reached { goal: presentation::told_apart(&goals.tell), seconds, draws });
        }
        for p in &goals.precise {
            let value = all.first().and_then(|e| e.parameters.iter().find(|q| q.name == p.name)).map(|q| q.value);
            let wanted = value.map(|v| (Z95 / (p.share * v)).powi(2));
            let longer = Self::on_parameter(&p.name, all).zip(wanted).map(|(r, w)| r.longer(w));
            let goal = format!("{} to ± {} % (95 %)", p.name, 100.0 * p.share);
            out.push(Reached { goal, seconds: longer.and_then(in_time), draws: all.len() });
        }
        out
    }

    /// How good a setting is, less is better: whether it rests on one draw, then the time of the
    /// slowest goal; without goals the mean logarithm of relative standard errors in the same time.
    pub fn score(&self, setting: &Setting, all: &[Expected]) -> (bool, f64) {
        let looked = self.looked_at_s(setting);
        let times = self.times(all, looked);
        if times.is_empty() {
            let one = |e: &Expected| {
                let relative = e.parameters.iter().map(|p| (p.std_error / p.value.abs().max(1e-12)).max(1e-12).ln());
                relative.sum::<f64>() / e.parameters.len() as f64
            };
            let worst = all.iter().map(one).fold(f64::NEG_INFINITY, f64::max);
            return (all.len() < 2, worst + 0.5 * looked.ln());
        }
        let slowest = times.iter().map(|r| r.seconds.unwrap_or(f64::INFINITY)).fold(0.0, f64::max);
        (times.iter().any(|r| r.draws < 2), slowest)
    }

    /// Separations that one more record so many times as long has, nearest first: from what was
    /// named, and from the nearest others.
    fn told(&self, all: Vec<Rated>, longer: f64) -> Vec<Separated> {
        let least = |s: Rated| Separated {
            deviations: s.rate.map_or(0.0, |r| r.at(longer, -1.0).sqrt()),
            effect: s.of.effect,
            from: s.of.from,
            draws: s.draws,
        };
        let named = |s: &Rated| s.of.from.as_ref().is_none_or(|n| self.settings.goals.tell.contains(n));
        let told = all.into_iter().filter(|s| named(s) || self.is_asked(&s.of));
        let mut out: Vec<(bool, Separated)> = told.map(|s| (named(&s), least(s))).collect();
        out.sort_by(|(_, a), (_, b)| a.deviations.total_cmp(&b.deviations));
        let mut others = 0;
        out.retain(|(named, _)| {
            others += usize::from(!named);
            *named || others <= NEAREST
        });
        out.into_iter().map(|(_, s)| s).collect()
    }

    /// A proposal from what draws of records would tell, for a record of `seconds`, or as long as
    /// its goals take.
    pub fn proposal(&self, setting: &Setting, all: &[Expected], seconds: Option<f64>) -> Proposal {
        let looked = self.looked_at_s(setting);
        let goals = self.times(all, looked);
        let wanted = goals.iter().map(|r| r.seconds.unwrap_or(f64::INFINITY)).fold(0.0, f64::max);
        let own = if goals.is_empty() { WITHOUT_GOAL_S } else { wanted.max(looked) };
        let seconds = seconds.unwrap_or_else(|| own.min(self.longest_s()));
        let longer = seconds / looked;
        let mut parameters = all[0].parameters.clone();
        let mut std_errors = Vec::new();
        for p in &mut parameters {
            let rate = Self::on_parameter(&p.name, all);
            let of = |side: f64| rate.map_or(f64::INFINITY, |r| r.at(longer, side).powf(-0.5));
            p.std_error = of(0.0);
            std_errors.push([of(1.0), of(-1.0)]);
        }
        let separations = self.told(Self::separations(all), longer);
        Proposal {
            setting: setting.clone(),
            seconds,
            decides: wanted <= seconds && goals.iter().all(|g| g.draws > 1),
            chaos: None,
            parameters,
            std_errors,
            separations,
            goals,
            draws: all.len(),
        }
    }
}
