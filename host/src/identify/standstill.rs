//! Stretches in which a joint stands still are left out.
//!
//! Dry friction holds a joint with whatever torque it takes up to its level: −τ sign φ̇ with sign 0 = 0 is then no equation of motion, and what friction
//! holds would be charged to every other term. A count that does not change says nothing of the motion either, and its quantisation error is a
//! constant. A joint stands still where its encoder stays within [`COUNTS`] for [`STILL_S`]. Only sensors that count are looked at.
//!
//! Limits: sticking for less than [`STILL_S`] stays in; a slow swing of fewer than about five counts is left out at its turning points.

use super::Settings;
use crate::signal::angles::AngleSegment;
use crate::warning::Warning;

/// Range of a sensor that stands still, counts: one step to and fro, and rounding.
const COUNTS: f64 = 1.5;
/// How long it must, s.
const STILL_S: f64 = 0.5;

/// Splits segments at standstills, unless nothing as long as `needed_s` would be left. Warns of what is left out.
pub fn leave_out(segments: &mut Vec<AngleSegment>, settings: &Settings, needed_s: f64, warnings: &mut Vec<Warning>) {
    let still: Vec<Vec<(usize, usize)>> = segments.iter().map(standstills).collect();
    if still.iter().all(Vec::is_empty) {
        return;
    }
    let mut kept = Vec::new();
    let mut left_out_s = 0.0;
    for (segment, still) in segments.iter().zip(&still) {
        let mut from = 0;
        for (first, last) in still.iter().copied().chain([(segment.len(), segment.len())]) {
            if first > from {
                kept.push(segment.part(from, first));
            }
            from = from.max(last);
        }
        left_out_s += still.iter().map(|(a, b)| b - a).sum::<usize>() as f64 * segment.step_s;
    }
    let needed_s = settings.window_s.unwrap_or(needed_s);
    if !kept.iter().any(|s| s.len() as f64 * s.step_s > needed_s) {
        return;
    }
    warnings.push(Warning::new(
        "standstill",
        format!("{left_out_s:.3} s in which a joint stands still were left out"),
        "Where dry friction holds a joint no equation of motion says with what torque; `whirl inspect` shows where the motion ends",
    ));
    *segments = kept;
}

/// First and last + 1 of each standstill of any sensor, in order, without overlaps.
fn standstills(segment: &AngleSegment) -> Vec<(usize, usize)> {
    let least = (STILL_S / segment.step_s).ceil() as usize;
    let of_sensor = |i: usize| {
        let mut found = Vec::new();
        let Some(count) = segment.count_rad[i] else { return found };
        let values = segment.sensor(i);
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
    let (mut found, second) = rayon::join(|| of_sensor(0), || of_sensor(1));
    found.extend(second);
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
    use super::*;
    use crate::signal::angles::Phase;

    fn segment(phi: impl Fn(f64) -> f64) -> AngleSegment {
        let q = core::f64::consts::TAU / 1024.0;
        let x: Vec<f64> = (0..5000).map(|i| ((phi(i as f64 * 0.002) / q).floor() + 0.5) * q).collect();
        AngleSegment {
            start_s: 0.0,
            step_s: 0.002,
            phi: [x.clone(), x.iter().enumerate().map(|(i, x)| x + i as f64 * 0.01).collect()],
            phase: Phase::Clock(0.0),
            relative: true,
            count_rad: [Some(q), Some(q)],
        }
    }

    #[test]
    fn a_joint_that_sticks_is_left_out_and_one_that_turns_is_not() {
        let sticks = segment(|t| if t < 4.0 { (7.0 * t).sin() } else { 0.1 });
        let found = standstills(&sticks);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((found[0].0 as i64 - 2000).abs() < 30 && found[0].1 == 5000, "{found:?}");
        assert!(standstills(&segment(|t| 0.3 * (5.0 * t).sin())).is_empty());
        let (mut segments, mut warnings) = (vec![sticks], Vec::new());
        leave_out(&mut segments, &Settings::default(), 3.0, &mut warnings);
        assert!(segments.len() == 1 && (segments[0].len() as i64 - 2000).abs() < 30 && warnings.len() == 1);
        // Nothing long enough would be left: what to say of such a record is for others to decide.
        let mut all = vec![segment(|_| 0.1)];
        leave_out(&mut all, &Settings::default(), 3.0, &mut warnings);
        assert!(all.len() == 1 && all[0].len() == 5000 && warnings.len() == 1);
    }
}
