//! Angles and counts that were recorded modulo a turn (or modulo a 16-bit counter), made continuous
//! within a segment.
//!
//! - Unit `rad` and `deg`: where neighbours differ by more than half a turn, whole turns are added
//!   so that they do not.
//! - Unit `count`: the modulus M is the smallest of counts_per_turn and 2¹⁶ for which the whole
//!   column lies within M counts and some neighbours differ by more than M/2. Without such an M the
//!   counts are taken as multi-turn, as they stand.
//!
//! Both rules are right as long as no arm turns half a modulus in one sample. Segments are
//! unwrapped on their own: how many turns were made within a gap is not known.

use std::ops::Range;

use super::Column;
use crate::rig::Channel;

/// A whole turn in a channel's own unit, for angles that are values.
pub(super) fn turn(channel: &Channel) -> Option<f64> {
    match channel.unit.as_str() {
        "rad" => Some(core::f64::consts::TAU),
        "deg" => Some(360.0),
        _ => None,
    }
}

/// What tells whether counts wrap.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    low: i64,
    high: i64,
    jump: i64,
    last: Option<i64>,
}

impl Default for Span {
    fn default() -> Self {
        Self { low: i64::MAX, high: i64::MIN, jump: 0, last: None }
    }
}

impl Span {
    /// Adds a part of a stretch; `begins`: the stretch begins with it.
    pub(super) fn add(&mut self, counts: &[i32], begins: bool) {
        if begins {
            self.last = None;
        }
        for &v in counts {
            let v = i64::from(v);
            self.low = self.low.min(v);
            self.high = self.high.max(v);
            self.jump = self.jump.max(self.last.map_or(0, |last| (v - last).abs()));
            self.last = Some(v);
        }
    }

    /// The modulus, or none where nothing wraps.
    pub(super) fn modulus(&self, channel: &Channel) -> Option<f64> {
        let mut moduli = [i64::from(channel.counts_per_turn.unwrap_or(0)), 1 << 16];
        moduli.sort_unstable();
        let span = self.high.checked_sub(self.low)?;
        moduli.into_iter().find(|&m| m > 1 && span < m && 2 * self.jump > m).map(|m| m as f64)
    }
}

/// Modulus of a wrapped channel in its own unit, or none where nothing wraps.
pub(super) fn modulus(column: &Column, channel: &Channel, segments: &[Range<usize>]) -> Option<f64> {
    match column {
        Column::Values(v) => {
            let turn = turn(channel)?;
            let jumps = |r: &Range<usize>| v[r.clone()].windows(2).any(|w| (w[1] - w[0]).abs() > turn / 2.0);
            segments.iter().any(jumps).then_some(turn)
        }
        Column::Counts(c) => {
            let mut span = Span::default();
            segments.iter().for_each(|r| span.add(&c[r.clone()], true));
            span.modulus(channel)
        }
    }
}

/// Where a stretch that comes in parts stands.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Carry {
    /// Last value, made continuous, and the turns that it has.
    value: Option<(f64, f64)>,
    /// Last raw count, and what was added to it.
    count: Option<(i64, i64)>,
}

/// Makes a part of a stretch continuous in place, going on from the part before; returns the number
/// of wraps undone, or the index at which a count leaves 32 bits.
pub(super) fn column(column: &mut Column, modulus: f64, carry: &mut Carry) -> Result<u64, usize> {
    match column {
        Column::Values(v) => Ok(unwrap_values(v, modulus, &mut carry.value)),
        // A modulus of counts is a whole number below 2³².
        Column::Counts(c) => unwrap_counts(c, modulus as i64, &mut carry.count),
    }
}

fn unwrap_values(values: &mut [f64], turn: f64, carry: &mut Option<(f64, f64)>) -> u64 {
    let mut wraps = 0;
    for value in values {
        let mut turns = 0.0;
        if let Some((last, before)) = *carry {
            // The one before already carries its turns.
            turns = before;
            let difference = *value + turns * turn - last;
            if difference.abs() > turn / 2.0 {
                turns -= (difference / turn).round();
                wraps += 1;
            }
            *value += turns * turn;
        }
        *carry = Some((*value, turns));
    }
    wraps
}

fn unwrap_counts(counts: &mut [i32], modulus: i64, carry: &mut Option<(i64, i64)>) -> Result<u64, usize> {
    let mut wraps = 0;
    for (i, count) in counts.iter_mut().enumerate() {
        let raw = i64::from(*count);
        let (before, mut offset) = carry.unwrap_or((raw, 0));
        let step = raw - before;
        if 2 * step.abs() > modulus {
            offset -= if step > 0 { modulus } else { -modulus };
            wraps += 1;
        }
        *carry = Some((raw, offset));
        *count = i32::try_from(raw + offset).map_err(|_| i)?;
    }
    Ok(wraps)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(unit: &str, n: Option<u32>) -> Channel {
        Channel { counts_per_turn: n, ..Channel::new("c", unit) }
    }

    #[test]
    fn wrapped_radians_come_back() {
        let truth: Vec<f64> = (0..4000).map(|i| 30.0 * (i as f64 * 0.003).sin() + i as f64 * 0.01).collect();
        let mut wrapped: Vec<f64> = truth.iter().map(|a| a.sin().atan2(a.cos())).collect();
        let turn =
            modulus(&Column::Values(wrapped.clone()), &channel("rad", None), std::slice::from_ref(&(0..4000))).unwrap();
        assert!(unwrap_values(&mut wrapped, turn, &mut None) > 5);
        let worst = wrapped.iter().zip(&truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-9, "{worst}");
    }

    #[test]
    fn counts_wrap_at_a_turn_or_at_sixteen_bits() {
        let truth: Vec<i32> = (0..9000).map(|i| (70_000.0 * (f64::from(i) * 0.002).sin()) as i32).collect();
        for (m, low) in [(4096, 0), (65_536, -32_768)] {
            let mut wrapped: Vec<i32> = truth.iter().map(|c| (c - low).rem_euclid(m) + low).collect();
            let found = modulus(
                &Column::Counts(wrapped.clone()),
                &channel("count", Some(4096)),
                std::slice::from_ref(&(0..9000)),
            );
            assert_eq!(found, Some(f64::from(m)));
            assert!(unwrap_counts(&mut wrapped, m.into(), &mut None).unwrap() > 3);
            assert_eq!(wrapped, truth);
        }
        assert_eq!(
            modulus(&Column::Counts(truth), &channel("count", Some(4096)), std::slice::from_ref(&(0..9000))),
            None
        );
    }

    #[test]
    fn unwrapping_beyond_the_type_is_told() {
        let mut counts: Vec<i32> = (0..200_000).map(|i| [0, 22_000, 44_000][i % 3]).collect();
        assert!(unwrap_counts(&mut counts, 65_536, &mut None).is_err());
    }
}
