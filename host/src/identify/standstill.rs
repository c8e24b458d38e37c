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
//! Limits: sticking for less than that stays in; a slow swing of fewer than about five counts is
//! left out at its turning points.

use rayon::prelude::*;

use super::stretches::Stretch;
use super::windows::Windows;
use crate::record::Record;
use crate::rig::measures::ObservedModel;
use crate::warning::Warning;

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
            "{name} stands still from {place} on for {:.3} s{others}: {left_out_s:.3} s in which a joint stands still were left out",
            first.length_s()
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
    let of_sensor = |(sensor, (values, fineness)): (usize, (Vec<f64>, &Fineness))| {
        let spans = match *fineness {
            Fineness::Counts(count) => within(&values, COUNTS * count, least),
            Fineness::Noise(sigma) => {
                let each = (least / MEANS).max(1);
                let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
                let means: Vec<f64> = values.chunks(each).map(mean).collect();
                let found = within(&means, RANGE * sigma / (each as f64).sqrt(), least.div_ceil(each));
                let whole = found.into_iter().map(|(first, last)| (each * first, (each * last).min(values.len())));
                whole.filter(|(first, last)| !bends(&values[*first..*last], sigma)).collect()
            }
        };
        spans.into_iter().map(|(first, last)| Span { first, last, sensor }).collect()
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
mod tests {
    use core::f64::consts::TAU;
    use std::path::Path;

    use nalgebra::DMatrix;

    use super::*;
    use crate::rig::{Rig, as_own};
    use crate::signal::angles::Phase;

    const Q: f64 = TAU / 1024.0;
    const WINDOWS: Windows = Windows { length_s: 3.0, hop_s: 1.5, frequencies: 30 };
    const COUNT: [Fineness; 2] = [Fineness::Counts(Q); 2];

    fn bound() -> ObservedModel {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml")).unwrap();
        let own = as_own::coordinates(&rig).unwrap();
        let bound = (*own.bound.unwrap()).clone();
        assert_eq!(bound.shown, DMatrix::from_row_slice(2, 2, &[1.0, 0.0, -1.0, 1.0]));
        bound
    }

    fn stretch(phi: impl Fn(f64) -> f64) -> Stretch {
        let x: Vec<f64> = (0..5000).map(|i| ((phi(i as f64 * 0.002) / Q).floor() + 0.5) * Q).collect();
        let second = x.iter().enumerate().map(|(i, x)| x + i as f64 * 0.01).collect();
        Stretch {
            start_s: 0.0,
            step_s: 0.002,
            coordinates: vec![x, second],
            inputs: Vec::new(),
            phase: Phase::Clock(0.0),
            amplitude_nm: None,
            history: None,
            base: None,
        }
    }

    /// Noise on a motion that stops. A swing of a tenth of the noise is no motion, one of ten times
    /// the noise is.
    #[test]
    fn a_joint_that_sticks_is_seen_through_noise() {
        let bound = bound();
        let (sigma, mut seed) = (1e-3, 7_u32);
        let mut noise = || {
            let mut uniform = || {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
            };
            sigma * (0..12).map(|_| uniform()).sum::<f64>()
        };
        let mut with = |phi: &dyn Fn(f64) -> f64| {
            let mut out = stretch(|_| 0.0);
            out.coordinates[0] = (0..5000).map(|i| phi(0.002 * f64::from(i)) + noise()).collect();
            out.coordinates[1] = (0..5000).map(|i| (0.05 * f64::from(i)).sin()).collect();
            out
        };
        let sensors = [Fineness::Noise(sigma), Fineness::Noise(1e-6)];
        let sticks = with(&|t| if t < 4.0 { (7.0 * t).sin() } else { 0.1 });
        let found = standstills(&sticks, &bound, &sensors, 0.5);
        assert!(!found.is_empty() && found.iter().all(|s| s.sensor == 0), "{found:?}");
        let all = merged(&found);
        assert!(all.len() == 1 && all[0].0.abs_diff(2000) < 40 && all[0].1 == 5000, "{all:?}");
        assert!(!standstills(&with(&|t| 1e-4 * (14.0 * t).sin()), &bound, &sensors, 0.5).is_empty());
        assert!(standstills(&with(&|t| 1e-2 * (14.0 * t).sin()), &bound, &sensors, 0.5).is_empty());
    }

    /// Few samples, at a turning point: means of two stay within what noise gives.
    #[test]
    fn a_turning_point_that_stands_out_of_the_noise_is_no_standstill() {
        let bound = bound();
        let noise = |i: i32| f64::from((i * 7919) % 1009) / 1009.0 - 0.5;
        let with = |bend: f64| {
            let mut out = stretch(|_| 0.0);
            out.coordinates[0] = (0..200).map(|i| bend * f64::from(i - 100).powi(2) + 3.46 * noise(i)).collect();
            out.coordinates[1] = (0..200).map(|i| 3.0 * f64::from(i)).collect();
            out
        };
        let sensors = [Fineness::Noise(1.0), Fineness::Noise(1e-6)];
        let near = |found: &[Span]| found.iter().any(|s| s.sensor == 0 && s.first <= 100 && s.last >= 100);
        assert!(near(&standstills(&with(0.0), &bound, &sensors, 0.032)));
        assert!(!near(&standstills(&with(0.07), &bound, &sensors, 0.032)));
    }

    #[test]
    fn a_joint_that_sticks_is_left_out_and_one_that_turns_is_not() {
        let bound = bound();
        let sticks = stretch(|t| if t < 4.0 { (7.0 * t).sin() } else { 0.1 });
        let found = standstills(&sticks, &bound, &COUNT, 0.5);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].first.abs_diff(2000) < 30 && (found[0].last, found[0].sensor) == (5000, 0), "{found:?}");
        assert!(standstills(&stretch(|t| 0.3 * (5.0 * t).sin()), &bound, &COUNT, 0.5).is_empty());
        // A slow swing has longer windows, and its turning points are no standstills.
        let slow = stretch(|t| 0.02 * (0.7 * t).sin());
        assert!(!standstills(&slow, &bound, &COUNT, 0.5).is_empty());
        assert!(standstills(&slow, &bound, &COUNT, STILL * 45.0).is_empty());
        let (mut stretches, mut records) = (vec![sticks], vec![3]);
        let still = leave_out(&mut stretches, &mut records, &bound, &COUNT, &WINDOWS);
        assert!(stretches.len() == 1 && stretches[0].len().abs_diff(2000) < 30 && still.len() == 1);
        assert!((still[0].sensor, still[0].record) == (0, 3) && (still[0].stretch.start_s - 4.0).abs() < 0.06);
        assert_eq!(records, [3]);
        // Stop and go: what is left would have no room for windows.
        let mut goes = vec![stretch(|t| if t % 2.0 < 1.3 { (7.0 * t).sin() } else { 0.1 })];
        assert!(leave_out(&mut goes, &mut records, &bound, &COUNT, &WINDOWS).is_empty() && goes.len() == 1);
        // Nothing long enough would be left: what to say of such a record is for others to decide.
        let mut all = vec![stretch(|_| 0.1)];
        assert!(leave_out(&mut all, &mut records, &bound, &COUNT, &WINDOWS).is_empty());
        assert!(all.len() == 1 && all[0].len() == 5000);
    }
}
