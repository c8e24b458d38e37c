//! What all settings of a plan have in common: rig, model, noise, limits; what a record at one of
//! them would tell.

mod grid;

use std::collections::{BTreeMap, BTreeSet};

use statrs::distribution::{ContinuousCDF, StudentsT};

use self::grid::amplitude_m;
use super::goals::TO_95;
use super::moved::{self, Own};
use super::trial::{self, Made};
use super::{APART, Proposal, Reached, Setting, Settings, presentation};
use crate::error::{BadInput, Result};
use crate::explain::double_pendulum;
use crate::explain::engine::expected::{Expected, MOST_SAMPLES, Separation, expected, with_effect};
use crate::identify::{Parameter, prepare};
use crate::model::identified::IdentifiedModel;
use crate::record::Record;
use crate::rig::Rig;
use crate::system::library::Pendulum;

/// Length of the records that are looked at, s: driven, and let go.
const LOOKED_AT_S: [f64; 2] = [40.0, 20.0];
/// Probability with which a planned record tells what was asked.
const PROBABLE: f64 = 0.975;
/// Longest record that is proposed where nothing else is said, s.
const LONGEST_S: f64 = 1800.0;
/// Length that is proposed where no goal is given, s.
const WITHOUT_GOAL_S: f64 = 240.0;
/// Effects that were not named of which is told how near they are.
const NEAREST: usize = 3;
/// Records by which an effect's size is put into the model, at most.
const TRIES: usize = 4;
/// What one more of some positive numbers is below (`side` 1) or above (−1) with a probability of
/// 97.5 %, if their logarithms are normal: Student's prediction interval. Their geometric mean for
/// `side` 0. Zero where one is zero; one alone says nothing of others.
fn bound(all: &[f64], side: f64) -> f64 {
    if !all.iter().all(|x| *x > 0.0) {
        return 0.0;
    }
    let n = all.len() as f64;
    let mean = all.iter().map(|x| x.ln()).sum::<f64>() / n;
    let Ok(student) = StudentsT::new(0.0, 1.0, n - 1.0) else { return mean.exp() };
    let square = all.iter().map(|x| (x.ln() - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean + side * student.inverse_cdf(PROBABLE) * (square * (1.0 + 1.0 / n)).sqrt()).exp()
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
        })
    }

    /// The rig and its model at a setting.
    ///
    /// # Errors
    /// A rig that cannot be had at it.
    pub fn at(&self, setting: &Setting) -> Result<Own> {
        moved::at(self.rig, &self.model, setting)
    }

    /// What one draw of a record of some length would tell; none where it cannot be followed.
    pub fn look(&self, setting: &Setting, draw: usize, seconds: f64) -> Option<Expected> {
        let own = self.at(setting).ok()?;
        let record = trial::record(&own, &Made { seconds, ..self.made(setting, draw) }).ok()?;
        let mut found = expected(record, &own.rig, &own.model).ok()??;
        if self.model.system.pendulum() == Some(Pendulum::Double) {
            double_pendulum::to_non_dimensional(&mut found.parameters, own.rig.omega());
        }
        let known = |p: &Parameter| p.std_error.is_finite() && p.value.is_finite();
        found.parameters.retain(known);
        found.parameters.iter_mut().for_each(|p| p.std_error *= self.wider);
        found.separations.iter_mut().for_each(|s| s.deviations /= self.wider);
        (!found.parameters.is_empty()).then_some(found)
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
        let seconds = record.duration_s().clamp(self.looked_at_s(), self.longest_s());
        let Some(found) = self.look(&setting, 0, seconds) else { return Ok(1.0) };
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
        let has = |m: &IdentifiedModel, name: &str| m.effects.iter().any(|e| format!("{}@{}", e.id, e.at) == name);
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
            seconds: self.looked_at_s(),
            pose: setting.pose.as_deref(),
            noise: &self.noise,
            seed: (self.settings.seed, draw),
        }
    }

    /// Length of the records that are looked at first, s.
    pub fn looked_at_s(&self) -> f64 {
        LOOKED_AT_S[usize::from(self.rig.drive.is_none())]
    }

    /// Longest record, s: what is longer than explanations look at tells no more.
    pub fn longest_s(&self) -> f64 {
        let followed = MOST_SAMPLES as f64 / self.rig.sample_rate_hz;
        self.settings.limits.seconds.unwrap_or(LONGEST_S).min(followed.max(self.looked_at_s()))
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
    /// tells stands for the same motion.
    pub fn add_rivals(&mut self, all: &[Option<Expected>]) {
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

    /// How far effects stand from others at least in one more record, by draws of it.
    fn separations(&self, all: &[Expected]) -> Vec<Separation> {
        let mut out: Vec<Separation> = all.first().map(|e| e.separations.clone()).unwrap_or_default();
        for s in &mut out {
            let same = |e: &&Separation| e.effect == s.effect && e.from == s.from;
            let own = all.iter().filter_map(|e| e.separations.iter().find(same));
            s.deviations = bound(&own.map(|q| q.deviations).collect::<Vec<_>>(), -1.0);
        }
        out
    }

    /// Time that each goal takes by what draws of records of `looked` seconds would tell, the worst
    /// of them.
    fn times(&self, all: &[Expected], looked: f64) -> Vec<Reached> {
        // The time after which one more record would have it, with a probability of 97.5 %.
        let worst = |of: &dyn Fn(&Expected) -> Option<f64>| -> Option<f64> {
            let times: Option<Vec<f64>> = all.iter().map(of).collect();
            Some(bound(&times?, 1.0)).filter(|x| x.is_finite())
        };
        let goals = &self.settings.goals;
        let bounded = self.separations(all);
        let nearest = self.nearest(&bounded).map(|s| s.deviations).filter(|d| *d > 0.0);
        let apart = nearest.map(|d| looked * (APART / d).powi(2));
        let mut out = Vec::new();
        if !goals.tell.is_empty() {
            out.push(Reached { goal: presentation::told_apart(&goals.tell), seconds: apart });
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

    /// How good a setting is, less is better: the time of the slowest goal; without goals the mean
    /// logarithm of relative standard errors.
    pub fn score(&self, all: &[Expected]) -> f64 {
        let times = self.times(all, self.looked_at_s());
        if times.is_empty() {
            let one = |e: &Expected| {
                let relative = e.parameters.iter().map(|p| (p.std_error / p.value.abs().max(1e-12)).max(1e-12).ln());
                relative.sum::<f64>() / e.parameters.len() as f64
            };
            return all.iter().map(one).fold(f64::NEG_INFINITY, f64::max);
        }
        times.iter().map(|r| r.seconds.unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
    }

    /// A proposal from what draws of records of `looked` seconds would tell, for a record of
    /// `seconds`, or as long as its goals take.
    pub fn proposal(&self, setting: &Setting, all: &[Expected], looked: f64, seconds: Option<f64>) -> Proposal {
        let goals = self.times(all, looked);
        let wanted = goals.iter().map(|r| r.seconds.unwrap_or(f64::INFINITY)).fold(0.0, f64::max);
        let longest = self.longest_s();
        let own = if goals.is_empty() { WITHOUT_GOAL_S } else { wanted.max(self.looked_at_s()) };
        let seconds = seconds.unwrap_or_else(|| own.min(longest));
        let shorter = (looked / seconds).sqrt();
        let first = &all[0];
        let mut parameters = first.parameters.clone();
        for p in &mut parameters {
            let own = all.iter().filter_map(|e| e.parameters.iter().find(|q| q.name == p.name));
            p.std_error = shorter * bound(&own.map(|q| q.std_error).collect::<Vec<_>>(), 0.0);
        }
        let mut separations = self.separations(all);
        separations.iter_mut().for_each(|s| s.deviations /= shorter);
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

#[cfg(test)]
#[path = "task_tests.rs"]
mod tests;
