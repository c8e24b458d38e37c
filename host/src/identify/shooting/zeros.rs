//! Zeros of sensors that nobody knows, as parameters of the fit.
//!
//! An incremental encoder counts from where it stood when it started, and friction holds a hanging
//! arm beside its lowest point: sensor k of record r shows y = m_k·q + z_kr, with z a parameter
//! behind those of the equations. It is sought for every sensor that shows angles alone and whose
//! shift the equations feel as nothing else: with f(q, p) the accelerations at the pieces'
//! beginnings, the columns f(q + S⁻¹ e_k h, p) − f(q, p) must be independent of one another and of
//! ∂f/∂p. (Equations with both sin φ and cos φ hold their zero themselves.)
//!
//! A zero costs nothing where the motion goes everywhere. Locked to its drive it may not tell a
//! zero from another parameter: where the zeros widen a standard error by more than `DEAR`, those
//! that the record does not show to be off (at 95 %) are held where they were set, which is said.

use serde::Serialize;

use super::covariance;
use super::run::{Failure, Outcome};
use crate::identify::prepared::Prepared;
use crate::model::dynamics::{Dynamics, Instant};
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::warning::Warning;
use crate::wording::format::{Z95, plus_minus};
use crate::wording::names::listed;

/// Widening of a standard error that zeros may cost: a record longer by a tenth makes up for it.
const DEAR: f64 = 1.05;
/// Standard errors from which one is told to be off by name: by chance once in sixteen thousand.
const CLEAR: f64 = 4.0;
/// Where a zero is from.
pub const IDENTIFIED: &str = "identified";
const HELD: &str = "held";
const INDEX: &str = "index";
/// Shift by which it is seen whether the equations feel a zero, rad: a size at which sines are bent.
const SHIFT: f64 = 0.3;
/// Part of a column that must not be that of others: difference quotients are good to a hundredth
/// of it.
const INDEPENDENT: f64 = 1e-3;
/// Least column that is one, as a part of the accelerations: rounding is far below.
const FELT: f64 = 1e-9;
/// Step of a parameter, as a part of it, and least one as a part of the greatest.
const STEP: f64 = 1e-4;
const LEAST: f64 = 1e-3;
/// Pieces at which that is seen.
const LOOKED_AT: usize = 64;

/// A sensor's zero in a record: it shows `value` more than the angle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ZeroOffset {
    /// Channel.
    pub channel: String,
    /// Record, counted from 1.
    pub record: usize,
    /// Value.
    pub value: f64,
    /// Its standard error; of one that is held, what this record alone would give.
    pub std_error: f64,
    /// Unit.
    pub unit: String,
    /// `identified`; `held` where the record does not tell it from other parameters; `index` where
    /// the encoder's index mark tells it.
    pub from: String,
    /// Counts from angle 0 to the encoder's index mark, where the record tells at which count it
    /// was seen: `index_at` of the channel in the rig file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub index_at: Option<f64>,
}

impl ZeroOffset {
    /// Whether it is a channel's in a record, counted from 0.
    pub fn is_of(&self, record: usize, channel: &str) -> bool {
        self.record == record + 1 && self.channel == channel
    }

    /// Whether the record shows that it is not where it was set.
    pub fn is_off(&self) -> bool {
        self.value.abs() > Z95 * self.std_error
    }
}

/// What the zeros of a fit make one doubt: those that are far off, and those that had to be held.
pub fn warnings(zeros: &[ZeroOffset]) -> Vec<Warning> {
    let several = zeros.iter().any(|z| z.record > 1);
    let name = |z: &ZeroOffset| {
        if several { format!("{} of record {}", z.channel, z.record) } else { z.channel.clone() }
    };
    let far = zeros.iter().filter(|z| z.from == IDENTIFIED && z.value.abs() > CLEAR * z.std_error).map(|z| {
        let degrees = plus_minus(z.value.to_degrees(), (Z95 * z.std_error).to_degrees());
        Warning::new(
            "zero-off",
            format!("{} shows {degrees}° (95 %) more than its angle: that was taken off", name(z)),
            "Is its zero where the arm hangs, and the frame upright? `whirl device zero` sets it; `whirl explain` weighs what else it may be",
        )
        .with("channel", z.channel.clone())
        .with("record", z.record)
        .with("value", z.value)
        .with("std_error", z.std_error)
    });
    let held: Vec<String> = zeros.iter().filter(|z| z.from == HELD).map(name).collect();
    let unsure = (!held.is_empty()).then(|| {
        Warning::new(
            "zeros-held",
            format!(
                "the zero{} of {} {} taken to be where the rig file says: this record cannot tell {} from other parameters",
                if held.len() == 1 { "" } else { "s" },
                listed(&held),
                if held.len() == 1 { "is" } else { "are" },
                if held.len() == 1 { "it" } else { "them" },
            ),
            "Standard errors hold for that zero alone: let the arms hang from both sides before zero is set, or record a chaotic motion",
        )
    });
    far.chain(unsure).collect()
}

/// Which unknown zero a sensor has in a stretch: y = m·q + z.
#[derive(Clone, Copy, Debug, Default)]
pub struct Zeros<'a> {
    of: &'a [Vec<Option<usize>>],
    /// How many there are.
    pub count: usize,
}

impl Zeros<'_> {
    /// The number of a sensor's unknown zero.
    pub fn at(&self, stretch: usize, sensor: usize) -> Option<usize> {
        self.of.get(stretch)?.get(sensor).copied().flatten()
    }

    /// A sensor's zero, `values` being those of the unknown ones.
    pub fn value(&self, stretch: usize, sensor: usize, values: &[f64]) -> f64 {
        self.at(stretch, sensor).map_or(0.0, |k| values[k])
    }
}

/// The zeros that are sought.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unknown {
    /// Record and sensor of each.
    list: Vec<(usize, usize)>,
    of: Vec<Vec<Option<usize>>>,
}

impl Unknown {
    /// Some sensors' in some records.
    fn of(list: Vec<(usize, usize)>, record_of: &[usize], sensors: usize) -> Self {
        let place = |record: usize, sensor: usize| list.iter().position(|z| *z == (record, sensor));
        let of = record_of.iter().map(|r| (0..sensors).map(|k| place(*r, k)).collect()).collect();
        Self { list, of }
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.list.len()
    }

    /// As a fit takes them.
    pub fn zeros(&self) -> Zeros<'_> {
        Zeros { of: &self.of, count: self.count() }
    }

    /// Those of these that `kept` says.
    fn only(&self, kept: &[bool]) -> Self {
        let list: Vec<_> = self.list.iter().zip(kept).filter(|(_, k)| **k).map(|(z, _)| *z).collect();
        let number = |z: &(usize, usize)| list.iter().position(|l| l == z);
        let of = self.of.iter().map(|s| s.iter().map(|k| k.and_then(|k| number(&self.list[k]))).collect());
        Self { of: of.collect(), list }
    }

    /// Their values before anything is known of them.
    pub fn none(&self) -> impl Iterator<Item = f64> {
        core::iter::repeat_n(0.0, self.count())
    }

    /// Every sensor's zero, by stretch, the unknown ones being the last of these parameters.
    pub fn values(&self, parameters: &[f64]) -> Vec<Vec<f64>> {
        let values = &parameters[parameters.len() - self.count()..];
        self.of.iter().map(|s| s.iter().map(|z| z.map_or(0.0, |z| values[z])).collect()).collect()
    }

    /// Those that are worth what they cost the other parameters; none where all are.
    fn worth(&self, outcome: &Outcome, states: usize) -> Option<Self> {
        let fit = &outcome.fit;
        let others = fit.parameters.len() - self.count();
        let mut held = fit.held.clone();
        held[others..].fill(true);
        let without = covariance::least(&fit.shares, states, &held)?;
        let (with, noise) = (&outcome.covariance.bound, outcome.covariance.mean_square);
        let dear = |i: usize| with[(i, i)] > DEAR * DEAR * noise * without[(i, i)];
        if !(0..others).any(|i| !fit.held[i] && dear(i)) {
            return None;
        }
        let shown: Vec<bool> =
            (others..fit.parameters.len()).map(|i| fit.parameters[i].abs() > Z95 * error(outcome, i)).collect();
        (!shown.iter().all(|s| *s)).then(|| self.only(&shown))
    }
}

/// A fit with the zeros that are worth it.
pub struct Worthwhile {
    /// The fit.
    pub outcome: Outcome,
    /// The zeros that are parameters of it.
    pub unknown: Unknown,
    /// The zeros that were parameters first, with their standard errors, where some were held then.
    before: Option<(Unknown, Vec<f64>)>,
}

impl Worthwhile {
    fn all(unknown: &Unknown, outcome: Outcome) -> Self {
        Self { outcome, unknown: unknown.clone(), before: None }
    }

    /// The zeros, in words for each.
    pub fn told(&self, rig: &Rig, bound: &ObservedModel, prepared: &Prepared) -> Vec<ZeroOffset> {
        let Self { outcome, unknown, before } = self;
        let first = outcome.fit.parameters.len() - unknown.count();
        let of = |(record, sensor): (usize, usize), value: f64, std_error: f64, from: &str| ZeroOffset {
            channel: rig.channel[bound.sensors[sensor]].name.clone(),
            record: record + 1,
            value,
            std_error,
            unit: "rad".to_owned(),
            from: from.to_owned(),
            index_at: prepared.indices.mark(record, sensor, value).filter(|_| from != HELD),
        };
        let found = unknown.list.iter().enumerate().map(|(k, z)| {
            let std_error = error(outcome, first + k);
            (*z, of(*z, outcome.fit.parameters[first + k], std_error, IDENTIFIED))
        });
        let held = before.iter().flat_map(|(all, errors)| all.list.iter().zip(errors));
        let held = held.filter(|(z, _)| !unknown.list.contains(z)).map(|(z, e)| (*z, of(*z, 0.0, *e, HELD)));
        let records = prepared.record_of.iter().max().map_or(0, |r| r + 1);
        let places = (0..records).flat_map(|r| (0..bound.sensors.len()).map(move |k| (r, k)));
        let known = places.filter_map(|z| prepared.indices.zero(z.0, z.1).map(|(v, e)| (z, of(z, v, e, INDEX))));
        let mut all: Vec<_> = found.chain(held).chain(known).collect();
        all.sort_by_key(|(z, _)| *z);
        all.into_iter().map(|(_, told)| told).collect()
    }
}

/// Standard error of a parameter.
fn error(outcome: &Outcome, i: usize) -> f64 {
    outcome.covariance.estimate[(i, i)].max(0.0).sqrt()
}

/// Fits with the unknown zeros, and again without those that are not worth what they cost, or
/// without any where such a fit comes to nothing. `states`: unknowns of a piece.
///
/// # Errors
/// Where even the fit without any gives nothing.
pub fn worthwhile(
    unknown: &Unknown,
    states: usize,
    fit: &mut dyn FnMut(&Unknown) -> Result<Outcome, Failure>,
) -> Result<Worthwhile, Failure> {
    let none = unknown.only(&vec![false; unknown.count()]);
    let outcome = match fit(unknown) {
        Ok(outcome) if outcome.fit.converged || unknown.count() == 0 => outcome,
        Err(why) if unknown.count() == 0 => return Err(why),
        _ => return fit(&none).map(|outcome| Worthwhile::all(&none, outcome)),
    };
    let mut best = Worthwhile::all(unknown, outcome);
    // What seemed to be off beside a zero that is held now need not be any more.
    while let Some(fewer) = best.unknown.worth(&best.outcome, states) {
        let first = best.outcome.fit.parameters.len() - best.unknown.count();
        let errors = || (first..best.outcome.fit.parameters.len()).map(|i| error(&best.outcome, i)).collect();
        let before = best.before.take().unwrap_or_else(|| (unknown.clone(), errors()));
        best = Worthwhile { outcome: fit(&fewer)?, unknown: fewer, before: Some(before) };
    }
    Ok(best)
}

/// A state of the system at a moment.
pub struct Moment {
    /// Coordinates, then rates.
    pub state: Vec<f64>,
    /// Time, s.
    pub time: f64,
    /// Phase of the drive, rad.
    pub tau: f64,
    /// Inputs.
    pub inputs: Vec<f64>,
}

/// The zeros that equations with these parameters feel in the records, seen at some moments.
pub fn unknown(
    motion: &dyn Dynamics,
    parameters: &[f64],
    moments: &[Moment],
    bound: &ObservedModel,
    prepared: &Prepared,
) -> Unknown {
    let circle = bound.model.circle();
    let sensors = bound.sensors.len();
    let angles = |k: &usize| bound.shown.row(*k).iter().zip(&circle).all(|(w, angle)| *w == 0.0 || *angle);
    let seen = Seen { motion, moments, stride: moments.len().div_ceil(LOOKED_AT).max(1) };
    let nowhere = |_: usize| 0.0;
    let Some(plain) = seen.accelerations(parameters, nowhere) else { return Unknown::default() };
    let size = norm(&plain);
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let greatest = parameters.iter().fold(0.0_f64, |m, p| m.max(p.abs()));
    for i in 0..parameters.len() {
        let step = STEP * parameters[i].abs().max(LEAST * greatest);
        let [up, down] = [step, -step].map(|step| {
            let mut moved = parameters.to_vec();
            moved[i] += step;
            seen.accelerations(&moved, nowhere)
        });
        if let (Some(up), Some(down)) = (up, down) {
            let _is_new = add(&mut basis, difference(&up, &down), FELT * step * size);
        }
    }
    let mut felt = Vec::new();
    for k in (0..sensors).filter(angles) {
        let shifted = seen.accelerations(parameters, |j| SHIFT * bound.coordinates[(j, k)]);
        if shifted.is_some_and(|shifted| add(&mut basis, difference(&shifted, &plain), FELT * size)) {
            felt.push(k);
        }
    }
    let records = prepared.record_of.iter().max().map_or(0, |r| r + 1);
    let used = (0..records).filter(|r| prepared.record_of.contains(r));
    let all = used.flat_map(|r| felt.iter().map(move |k| (r, *k)));
    let list = all.filter(|(r, k)| prepared.indices.zero(*r, *k).is_none()).collect();
    Unknown::of(list, &prepared.record_of, sensors)
}

/// Some of the moments of a record, for equations to be looked at there.
struct Seen<'a> {
    motion: &'a dyn Dynamics,
    moments: &'a [Moment],
    stride: usize,
}

impl Seen<'_> {
    /// Accelerations at all of them, each coordinate shifted; none where one has none.
    fn accelerations(&self, parameters: &[f64], shift: impl Fn(usize) -> f64) -> Option<Vec<f64>> {
        let n = self.motion.degrees_of_freedom();
        let mut all = Vec::new();
        for at in self.moments.iter().step_by(self.stride) {
            let (q, v) = at.state.split_at(n);
            let q: Vec<f64> = q.iter().enumerate().map(|(j, q)| q + shift(j)).collect();
            let instant = Instant { time: at.time, tau: at.tau, inputs: &at.inputs };
            let mut out = vec![0.0; n];
            if !self.motion.acceleration(parameters, &q, v, &instant, &mut out) {
                return None;
            }
            all.extend(out);
        }
        Some(all)
    }
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// Adds what a column larger than `least` has beside those of an orthonormal basis; false where
/// that is nothing.
fn add(basis: &mut Vec<Vec<f64>>, mut column: Vec<f64>, least: f64) -> bool {
    let size = norm(&column);
    for b in &*basis {
        let along: f64 = b.iter().zip(&column).map(|(b, c)| b * c).sum();
        column.iter_mut().zip(b).for_each(|(c, b)| *c -= along * b);
    }
    let left = norm(&column);
    let is_new = size > least && left > INDEPENDENT * size && left.is_finite();
    if is_new {
        column.iter_mut().for_each(|c| *c /= left);
        basis.push(column);
    }
    is_new
}

#[cfg(test)]
mod tests;
