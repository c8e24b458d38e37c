//! Stretches in which a joint stands still are left out.
//!
//! Dry friction holds a joint with whatever torque it takes up to its level: −τ sign φ̇ with sign
//! 0 = 0 is then no equation of motion, and what friction holds would be charged to every other
//! term. A count that does not change says nothing of the motion either, and its quantisation error
//! is a constant. A joint stands still where its encoder stays within [`COUNTS`] for [`STILL`] of a
//! window, which holds several periods of the motion. Only sensors that count are looked at.
//!
//! Limits: sticking for less than that stays in; a slow swing of fewer than about five counts is
//! left out at its turning points.

use rayon::prelude::*;

use super::stretches::Stretch;
use crate::rig::measures::ObservedModel;
use crate::warning::Warning;

/// Range of a sensor that stands still, counts: one step to and fro, and rounding.
const COUNTS: f64 = 1.5;
/// How long it must, as a share of a window: two and a half periods of a drive.
const STILL: f64 = 0.125;

/// Share of the windows in motion that must be left.
const WORTH: f64 = 0.25;

/// Splits stretches at standstills, unless too few windows of `window_s` would be left; whether it
/// did. `count`: size of one count of each sensor. Warns of what is left out.
pub fn leave_out(
    stretches: &mut Vec<Stretch>,
    record_of: &mut Vec<usize>,
    bound: &ObservedModel,
    count: &[Option<f64>],
    window_s: f64,
    warnings: &mut Vec<Warning>,
) -> bool {
    let still: Vec<Vec<(usize, usize)>> =
        stretches.iter().map(|s| standstills(s, bound, count, STILL * window_s)).collect();
    if still.iter().all(Vec::is_empty) {
        return false;
    }
    let (mut kept, mut from_record) = (Vec::new(), Vec::new());
    let mut left_out_s = 0.0;
    for ((stretch, record), still) in stretches.iter().zip(&*record_of).zip(&still) {
        let mut from = 0;
        for (first, last) in still.iter().copied().chain([(stretch.len(), stretch.len())]) {
            if first > from {
                kept.push(stretch.part(from, first));
                from_record.push(*record);
            }
            from = from.max(last);
        }
        left_out_s += still.iter().map(|(a, b)| b - a).sum::<usize>() as f64 * stretch.step_s;
    }
    // A motion that stops and goes would be left in pieces too short for a window.
    let room = |list: &[Stretch]| list.iter().map(|s| (s.len() as f64 * s.step_s - window_s).max(0.0)).sum::<f64>();
    let moves = |list: &[Stretch]| list.iter().map(|s| s.len() as f64 * s.step_s).sum::<f64>();
    let share = moves(&kept) / moves(stretches);
    if room(&kept) <= WORTH * share * room(stretches) {
        return false;
    }
    warnings.push(Warning::new(
        "standstill",
        format!("{left_out_s:.3} s in which a joint stands still were left out"),
        "Where dry friction holds a joint no equation of motion says with what torque; `whirl inspect` shows where the motion ends",
    ));
    (*stretches, *record_of) = (kept, from_record);
    true
}

/// First and last + 1 of each standstill of any sensor for `still_s`, in order, without overlaps.
fn standstills(stretch: &Stretch, bound: &ObservedModel, count: &[Option<f64>], still_s: f64) -> Vec<(usize, usize)> {
    let least = (still_s / stretch.step_s).ceil().max(2.0) as usize;
    let of_sensor = |(values, count): (Vec<f64>, &Option<f64>)| {
        let mut found = Vec::new();
        let Some(count) = *count else { return found };
        // One of the whole pieces of half that length would lie within it.
        let moves = |x: &[f64]| x.iter().any(|v| (v - x[0]).abs() > COUNTS * count);
        if least >= 4 && values.chunks_exact(least / 2).all(moves) {
            return found;
        }
        let (mut start, mut low, mut high) = (0, f64::INFINITY, f64::NEG_INFINITY);
        for (i, &x) in values.iter().enumerate() {
            if x.max(high) - x.min(low) > COUNTS * count {
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
    };
    let each: Vec<Vec<(usize, usize)>> =
        stretch.sensors(bound).into_par_iter().zip(count.par_iter()).map(of_sensor).collect();
    let mut found: Vec<(usize, usize)> = each.into_iter().flatten().collect();
    found.sort_unstable();
    let mut merged: Vec<(usize, usize)> = Vec::new();
    for (a, b) in found {
        match merged.last_mut() {
            Some(last) if a <= last.1 => last.1 = last.1.max(b),
            _ => merged.push((a, b)),
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
    const COUNT: [Option<f64>; 2] = [Some(Q), Some(Q)];

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

    #[test]
    fn a_joint_that_sticks_is_left_out_and_one_that_turns_is_not() {
        let bound = bound();
        let sticks = stretch(|t| if t < 4.0 { (7.0 * t).sin() } else { 0.1 });
        let found = standstills(&sticks, &bound, &COUNT, 0.5);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((found[0].0 as i64 - 2000).abs() < 30 && found[0].1 == 5000, "{found:?}");
        assert!(standstills(&stretch(|t| 0.3 * (5.0 * t).sin()), &bound, &COUNT, 0.5).is_empty());
        // A slow swing has longer windows, and its turning points are no standstills.
        let slow = stretch(|t| 0.02 * (0.7 * t).sin());
        assert!(!standstills(&slow, &bound, &COUNT, 0.5).is_empty());
        assert!(standstills(&slow, &bound, &COUNT, STILL * 45.0).is_empty());
        let (mut stretches, mut records, mut warnings) = (vec![sticks], vec![3], Vec::new());
        assert!(leave_out(&mut stretches, &mut records, &bound, &COUNT, 3.0, &mut warnings));
        assert!(stretches.len() == 1 && (stretches[0].len() as i64 - 2000).abs() < 30 && warnings.len() == 1);
        assert_eq!(records, [3]);
        // Stop and go: what is left would have no room for windows.
        let mut goes = vec![stretch(|t| if t % 2.0 < 1.3 { (7.0 * t).sin() } else { 0.1 })];
        assert!(!leave_out(&mut goes, &mut records, &bound, &COUNT, 3.0, &mut warnings) && goes.len() == 1);
        // Nothing long enough would be left: what to say of such a record is for others to decide.
        let mut all = vec![stretch(|_| 0.1)];
        assert!(!leave_out(&mut all, &mut records, &bound, &COUNT, 3.0, &mut warnings));
        assert!(all.len() == 1 && all[0].len() == 5000 && warnings.len() == 1);
    }
}
