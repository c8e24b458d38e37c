//! Angles and counts that were recorded modulo a turn (or modulo a 16-bit counter), made continuous
//! within a segment.
//!
//! - Unit `rad` and `deg`: where [`Turns`] finds a column to be recorded modulo a turn, whole turns
//!   are added wherever neighbours differ by more than half a turn, so that they do not.
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

/// Turns within which values lie that were recorded modulo one: the rest is for noise, a sensor's
/// scale and what `--resample` overshoots by at a jump (0.13 turns). A swing of that size that is
/// counted on moves by half a turn in a sample only where it has fewer than seven samples a period,
/// 1/(2 sin π/7).
const SPAN: f64 = 1.15;
/// Turns in a sample up to which a step is a motion's, or off a whole turn and yet a jump: nothing
/// that moves on has steps of both sizes and none in between.
const CLEAR: f64 = 0.25;

/// What tells whether values were recorded modulo a turn: some neighbours differ by more than half
/// of one, and
/// - all values lie within [`SPAN`] turns, wherever these begin. An angle that is counted on leaves
///   them, however wide its steps. A value that leaps away and back by itself is an error of the
///   sensor's, and may lie anywhere.
/// - Or jumps by whole turns stand clear of all other steps, which are those of a motion of
///   [`CLEAR`] turns in a sample at most, and are no more frequent than such a motion makes them: a
///   difference of two such columns spans more than a turn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turns {
    turn: f64,
    low: f64,
    high: f64,
    /// Last value, and the step to it.
    last: Option<(f64, f64)>,
    steps: u64,
    /// Steps beyond half a turn.
    wide: u64,
    /// Those near a whole number of turns.
    jumps: u64,
    /// Steps that are neither a jump nor those of a motion.
    between: u64,
}

impl Turns {
    /// Of values that count `turn` a turn.
    pub(crate) fn new(turn: f64) -> Self {
        let (low, high) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { turn, low, high, last: None, steps: 0, wide: 0, jumps: 0, between: 0 }
    }

    /// Adds a part of a stretch; `begins`: the stretch begins with it.
    pub(crate) fn add(&mut self, values: &[f64], begins: bool) {
        if begins {
            self.end();
        }
        for &value in values {
            let step = self.last.map_or(0.0, |(last, _)| (value - last) / self.turn);
            if let Some((last, before)) = self.last {
                let is_alone = step.abs() > 0.5 && before.abs() > 0.5 && step * before < 0.0;
                if !is_alone {
                    self.reach(last);
                }
                self.steps += 1;
                self.wide += u64::from(step.abs() > 0.5);
                let off = (step.abs() - step.abs().round()).abs();
                if off > CLEAR {
                    self.between += 1;
                } else if step.abs() > 0.5 {
                    self.jumps += 1;
                }
            }
            self.last = Some((value, step));
        }
    }

    /// Ends a stretch.
    fn end(&mut self) {
        if let Some((last, _)) = self.last.take() {
            self.reach(last);
        }
    }

    fn reach(&mut self, value: f64) {
        (self.low, self.high) = (self.low.min(value), self.high.max(value));
    }

    /// Whether they were.
    pub(crate) fn wrap(mut self) -> bool {
        self.end();
        let within = self.high - self.low <= SPAN * self.turn;
        // A whole turn takes 1/CLEAR steps at least.
        let clear = self.between == 0 && self.jumps as f64 <= CLEAR * self.steps as f64;
        self.wide > 0 && (within || clear)
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
            let mut turns = Turns::new(turn);
            segments.iter().for_each(|r| turns.add(&v[r.clone()], true));
            turns.wrap().then_some(turn)
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

    fn of(values: &[f64], unit: &str) -> Option<f64> {
        let whole = 0..values.len();
        modulus(&Column::Values(values.to_vec()), &channel(unit, None), std::slice::from_ref(&whole))
    }

    /// A motor that speeds up to a turn in a sample; wide swings, and one of numbers that are no
    /// angles at all.
    #[test]
    fn an_angle_that_is_counted_on_is_left_as_it_stands() {
        let motor = |i: i32| {
            let t = 0.1 * f64::from(i);
            60.0 * (t - 1.5 * (1.0 - (-t / 1.5).exp()))
        };
        let truth: Vec<f64> = (0..200).map(motor).collect();
        assert_eq!(of(&truth, "rad"), None);
        assert_eq!(of(&truth.iter().map(|x| x.to_degrees()).collect::<Vec<_>>(), "deg"), None);
        // At its last speed alone, either way, every step is nearly a turn.
        for sign in [1.0, -1.0] {
            assert_eq!(of(&truth[150..].iter().map(|x| sign * x).collect::<Vec<_>>(), "rad"), None);
        }
        for (size, rate) in [(5.0, 1.0), (4.0, 0.85), (100.0, 0.21)] {
            let swing: Vec<f64> = (0..600).map(|i| size * (rate * f64::from(i)).sin()).collect();
            assert_eq!(of(&swing, "rad"), None, "{size} {rate}");
        }
    }

    /// Whatever the turn begins at, with noise on the seam, ends that both are shown, a value in
    /// error, and the difference of two.
    #[test]
    fn angles_modulo_a_turn_are_known_by_their_span() {
        let truth: Vec<f64> = (0..3000).map(|i| 0.9 * f64::from(i) + 20.0 * (0.01 * f64::from(i)).sin()).collect();
        for low in [-180.0, 0.0, -37.0, 1000.0] {
            let wrapped: Vec<f64> = truth.iter().map(|x| (20.0 * x - low).rem_euclid(360.0) + low).collect();
            assert_eq!(of(&wrapped, "deg"), Some(360.0), "{low}");
            let noisy: Vec<f64> = wrapped.iter().enumerate().map(|(i, x)| x + (7.0 * i as f64).sin()).collect();
            assert_eq!(of(&noisy, "deg"), Some(360.0), "{low}");
            let mut typed = wrapped.clone();
            typed[1234] = 99_999.0;
            assert_eq!(of(&typed, "deg"), Some(360.0), "{low}");
        }
        assert_eq!(of(&[0.0, 120.0, 240.0, 360.0, 120.0, 240.0, 0.0, 120.0], "deg"), Some(360.0));
        let two = |x: f64| (0.31 * x).sin().atan2((0.31 * x).cos()) - (0.17 * x).sin().atan2((0.17 * x).cos());
        let difference: Vec<f64> = truth.iter().map(|x| two(*x)).collect();
        assert_eq!(of(&difference, "rad"), Some(core::f64::consts::TAU));
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
