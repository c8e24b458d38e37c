//! Stretches in which a joint stands still are left out.
//!
//! Dry friction holds a joint with whatever torque it takes up to its level: −τ sign φ̇ with sign
//! 0 = 0 is then no equation of motion, and what friction holds would be charged to every other
//! term. A count that does not change says nothing of the motion either, and its quantisation error
//! is a constant. A joint stands still where its encoder stays within [`COUNTS`], or where means of a
//! sensor that does not count stay within what its noise gives, for [`STILL`] of a window and for a
//! period of the highest frequency that is looked at. A sensor that bends by clearly more than its
//! noise there turns round.
//!
//! A motion that is slower than its sensor's resolution there stays within it as well, at a turning
//! point or in a flat place of a beat, and stands nowhere. What tells is how it leaves. Velocity,
//! acceleration and the third derivative of two swings vanish at once at most, so that what stays
//! within a range R for a time T about such a place is within R (1 + 2τ/T)⁴ of it at τ behind. A
//! joint that friction held leaves with an acceleration a, by a τ²/2. It stands still where it goes
//! beyond that, and R for the sensor's own error, within τ < T/2 on either side (whichever the
//! stretch has): from T ≈ 12 √(R/a) on, four times as long as it would take to turn round. And a
//! coordinate of whose acceleration no equation speaks is no joint: a circuit that has settled
//! rests where its equation says.
//!
//! Limits: sticking for less than that stays in.

use rayon::prelude::*;

use super::stretches::Stretch;
use super::windows::Windows;
use crate::model::model_file::expression::Symbol;
use crate::record::Record;
use crate::rig::measures::ObservedModel;
use crate::warning::Warning;
use crate::wording::format::in_seconds;

/// Range of a sensor that stands still, counts: one step to and fro, and rounding.
const COUNTS: f64 = 1.5;
/// How long it must, as a share of a window: two and a half periods of a drive.
const STILL: f64 = 0.125;
/// Means of a sensor that does not count over the shortest standstill, and their range, in standard
/// deviations of one, that noise alone exceeds once in 1400 times.
const MEANS: usize = 8;
const RANGE: f64 = 6.0;

/// Standard errors of a bend from which it is one, where it is as large as the noise besides: a
/// sensor at rest may drift by less.
const BENT: f64 = 4.0;

/// Share of the windows in motion that must be left.
const WORTH: f64 = 0.25;

/// A standstill of a sensor.
#[derive(Clone, Debug)]
pub struct Still {
    /// Sensor, in the order of the rig's equations.
    pub sensor: usize,
    /// Record of which it is.
    pub record: usize,
    /// All sensors' samples over it.
    pub stretch: Stretch,
}

impl Still {
    /// How long it lasts, s.
    pub fn length_s(&self) -> f64 {
        self.stretch.len() as f64 * self.stretch.step_s
    }
}

/// The warning's id.
pub const ID: &str = "standstill";

/// What a sensor shows of a joint that stands still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fineness {
    /// Counts of that size.
    Counts(f64),
    /// Noise of that standard deviation.
    Noise(f64),
}

/// Splits stretches at standstills, unless too few windows of `windows.length_s` would be left; the
/// standstills that it left out.
pub fn leave_out(
    stretches: &mut Vec<Stretch>,
    record_of: &mut Vec<usize>,
    bound: &ObservedModel,
    sensors: &[Fineness],
    windows: &Windows,
) -> Vec<Still> {
    let window_s = windows.length_s;
    let still_s = f64::max(STILL * window_s, window_s / windows.frequencies.max(1) as f64);
    let found: Vec<Vec<Span>> = stretches.iter().map(|s| standstills(s, bound, sensors, still_s)).collect();
    if found.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let (mut kept, mut from_record) = (Vec::new(), Vec::new());
    let mut still = Vec::new();
    for ((stretch, record), found) in stretches.iter().zip(&*record_of).zip(&found) {
        let mut from = 0;
        let own = |s: &Span| Still { sensor: s.sensor, record: *record, stretch: stretch.part(s.first, s.last) };
        still.extend(found.iter().map(own));
        for (first, last) in merged(found).into_iter().chain([(stretch.len(), stretch.len())]) {
            if first > from {
                kept.push(stretch.part(from, first));
                from_record.push(*record);
            }
            from = from.max(last);
        }
    }
    // A motion that stops and goes would be left in pieces too short for a window.
    let room = |list: &[Stretch]| list.iter().map(|s| (s.len() as f64 * s.step_s - window_s).max(0.0)).sum::<f64>();
    let moves = |list: &[Stretch]| list.iter().map(|s| s.len() as f64 * s.step_s).sum::<f64>();
    let share = moves(&kept) / moves(stretches);
    if room(&kept) <= WORTH * share * room(stretches) {
        return Vec::new();
    }
    (*stretches, *record_of) = (kept, from_record);
    still
}

/// What is said of standstills that were left out; nothing where there are none.
pub fn told(still: &[Still], records: &[Record], bound: &ObservedModel) -> Option<Warning> {
    let first = still.first()?;
    let (place, name) = place(first, records, bound);
    // Two joints may stand at once.
    let mut spans: Vec<(usize, f64, f64)> =
        still.iter().map(|s| (s.record, s.stretch.start_s, s.stretch.start_s + s.length_s())).collect();
    spans.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let (mut left_out_s, mut behind) = (0.0, (usize::MAX, 0.0));
    for (record, from, to) in spans {
        let from = if record == behind.0 { from.max(behind.1) } else { from };
        left_out_s += (to - from).max(0.0);
        behind = (record, if record == behind.0 { to.max(behind.1) } else { to });
    }
    let others = if still.len() > 1 { format!(" (and {} more standstills)", still.len() - 1) } else { String::new() };
    let warning = Warning::new(
        ID,
        format!(
            "{name} stands still from {place} on for {}{others}: {} in which a joint stands still were left out",
            in_seconds(first.length_s()),
            in_seconds(left_out_s)
        ),
        "Where dry friction holds a joint no equation of motion says with what torque; if the joint moved there, look at the sensor",
    );
    let warning = warning.with("channel", name).with("time_s", first.stretch.start_s).with("value_s", left_out_s);
    Some(match row(first, records) {
        Some(row) => warning.with("row", row),
        None => warning,
    })
}

/// Where a standstill begins, in words, and the name of its channel.
pub fn place<'a>(still: &Still, records: &'a [Record], bound: &ObservedModel) -> (String, &'a str) {
    let record = &records[still.record];
    let time = (still.stretch.start_s * 1e6).round() / 1e6;
    let word = record.numbering.as_ref().map_or("row", |n| n.word);
    let place = row(still, records).map_or_else(|| format!("t = {time} s"), |r| format!("{word} {r} (t = {time} s)"));
    (place, &record.channels[bound.sensors[still.sensor]].name)
}

/// The row at which a standstill begins.
pub fn row(still: &Still, records: &[Record]) -> Option<u64> {
    records[still.record].numbering.as_ref()?.at_time(still.stretch.start_s)
}

/// Samples `first` to before `last` in which a sensor stands still.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Span {
    first: usize,
    last: usize,
    sensor: usize,
}

/// Standstills of any sensor for `still_s`, in order.
fn standstills(stretch: &Stretch, bound: &ObservedModel, sensors: &[Fineness], still_s: f64) -> Vec<Span> {
    let least = (still_s / stretch.step_s).ceil().max(2.0) as usize;
    let joints: Vec<bool> = (0..sensors.len()).map(|sensor| is_joint(bound, sensor)).collect();
    let of_sensor = |(sensor, (values, fineness)): (usize, (Vec<f64>, &Fineness))| {
        if !joints[sensor] {
            return Vec::new();
        }
        let spans = match *fineness {
            Fineness::Counts(count) => {
                let range = COUNTS * count;
                held(&within(&values, range, least), &values, range)
            }
            Fineness::Noise(sigma) => {
                let each = (least / MEANS).max(1);
                let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
                let means: Vec<f64> = values.chunks(each).map(mean).collect();
                let range = RANGE * sigma / (each as f64).sqrt();
                let samples = |(first, last): (usize, usize)| (each * first, (each * last).min(values.len()));
                let mut found = within(&means, range, least.div_ceil(each));
                found.retain(|span| {
                    let (first, last) = samples(*span);
                    !bends(&values[first..last], sigma)
                });
                held(&found, &means, range).into_iter().map(samples).collect()
            }
        };
        spans.into_iter().map(|(first, last)| Span { first, last, sensor }).collect::<Vec<Span>>()
    };
    let shown: Vec<(Vec<f64>, &Fineness)> = stretch.sensors(bound).into_iter().zip(sensors).collect();
    let each: Vec<Vec<Span>> = shown.into_par_iter().enumerate().map(of_sensor).collect();
    let mut found: Vec<Span> = each.into_iter().flatten().collect();
    found.sort_unstable();
    found
}

/// Whether numbers with noise of that standard deviation lie along a bend: their least squares over
/// 1, t and t².
fn bends(values: &[f64], sigma: f64) -> bool {
    let half = 0.5 * (values.len() as f64 - 1.0);
    // t² without its mean, which is that of t from −half to half.
    let square = |i: usize| (i as f64 - half).powi(2) - half * (half + 1.0) / 3.0;
    let norm: f64 = (0..values.len()).map(|i| square(i).powi(2)).sum();
    let bend = values.iter().enumerate().map(|(i, x)| x * square(i)).sum::<f64>() / norm;
    bend.abs() > BENT * sigma / norm.sqrt() && bend.abs() * half * half > sigma
}

/// Whether a sensor shows a coordinate that has an inertia.
fn is_joint(bound: &ObservedModel, sensor: usize) -> bool {
    let equations = &bound.model.equations;
    let accelerates = |k: usize| {
        let is_its = |s: Symbol| s == Symbol::Acceleration(k);
        equations.iter().any(|e| e.balance.any(&is_its) || e.terms.iter().any(|t| t.of.any(&is_its)))
    };
    (0..bound.shown.ncols()).any(|k| bound.shown[(sensor, k)] != 0.0 && accelerates(k))
}

/// Least and greatest of numbers.
fn extent(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)))
}

/// Of spans within a range those that no smooth motion makes; spans that noise alone divides are
/// one.
fn held(spans: &[(usize, usize)], values: &[f64], range: f64) -> Vec<(usize, usize)> {
    let mut joined: Vec<(usize, usize)> = Vec::new();
    for &(first, last) in spans {
        let with = joined.last().filter(|one| one.1 == first).map(|one| extent(&values[one.0..last]));
        match joined.last_mut() {
            Some(one) if with.is_some_and(|(low, high)| high - low <= 2.0 * range) => one.1 = last,
            _ => joined.push((first, last)),
        }
    }
    joined.retain(|span| is_left_at_once(values, *span, range));
    joined
}

/// Whether numbers go away from a span within a range, on either side that there is, by more than a
/// smooth motion would that stays there for so long.
fn is_left_at_once(values: &[f64], (first, last): (usize, usize), range: f64) -> bool {
    let (low, high) = extent(&values[first..last]);
    let (middle, range) = (0.5 * (low + high), range.max(high - low));
    let (length, reach) = ((last - first) as f64, (last - first) / 2);
    let leaves = |(k, x): (usize, &f64)| {
        let grown = (1.0 + 2.0 * (k + 1) as f64 / length).powi(4);
        (x - middle).abs() > range * (1.0 + grown)
    };
    let before = &values[first.saturating_sub(reach)..first];
    let behind = &values[last..(last + reach).min(values.len())];
    (before.is_empty() || before.iter().rev().enumerate().any(leaves))
        && (behind.is_empty() || behind.iter().enumerate().any(leaves))
}

/// First and last + 1 of at least `least` numbers in a row that stay within a range.
fn within(values: &[f64], range: f64, least: usize) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    // One of the whole pieces of half that length would lie within it.
    let moves = |x: &[f64]| x.iter().any(|v| (v - x[0]).abs() > range);
    if least >= 4 && values.chunks_exact(least / 2).all(moves) {
        return found;
    }
    let (mut start, mut low, mut high) = (0, f64::INFINITY, f64::NEG_INFINITY);
    for (i, &x) in values.iter().enumerate() {
        if x.max(high) - x.min(low) > range {
            if i - start >= least {
                found.push((start, i));
            }
            (start, low, high) = (i, x, x);
        } else {
            (low, high) = (low.min(x), high.max(x));
        }
    }
    if values.len() - start >= least {
        found.push((start, values.len()));
    }
    found
}

/// First and last + 1 of all together, without overlaps.
fn merged(spans: &[Span]) -> Vec<(usize, usize)> {
    let mut merged: Vec<(usize, usize)> = Vec::new();
    for &Span { first, last, .. } in spans {
        match merged.last_mut() {
            Some(one) if first <= one.1 => one.1 = one.1.max(last),
            _ => merged.push((first, last)),
        }
    }
    merged
}

#[cfg(test)]
#[path = "standstill_tests.rs"]
mod tests;
