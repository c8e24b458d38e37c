//! Counts a turn, as far as a column alone shows them: where it leaps, and in which steps it moves.

use super::columns::Extent;
use crate::identify::suspects::COUNTS;

/// Counts a turn that are tried beside those that encoders are sold with, powers of two up to 2²⁰.
const POWERS: core::ops::RangeInclusive<u32> = 6..=20;
/// Others that are sold: finer ones.
const FINER: [u32; 8] = [12_000, 14_400, 20_000, 36_000, 40_000, 72_000, 80_000, 100_000];
/// Share by which a step may be off 1/N of a turn.
const NEAR: f64 = 2e-3;

/// Where whole numbers leap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wrap {
    /// After a turn of so many counts.
    Turn(u32),
    /// After 2¹⁶, which says nothing of the turn.
    Counter,
}

/// Counts a turn that are likely, in order.
pub(super) fn likely() -> Vec<u32> {
    let mut all: Vec<u32> = COUNTS.into_iter().chain(FINER).chain(POWERS.map(|p| 1 << p)).collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// Whether values stay within a turn and leap from one end of it to the other.
pub(super) fn wraps(parts: &[&[f64]], turn: f64) -> bool {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut leaps, mut steps) = (0_usize, 0_usize);
    for part in parts {
        part.iter().for_each(|x| (low, high) = (low.min(*x), high.max(*x)));
        steps += part.windows(2).filter(|w| (w[1] - w[0]).abs() > 0.25 * turn).count();
        leaps += part.windows(2).filter(|w| (w[1] - w[0]).abs() > 0.75 * turn).count();
    }
    // Every wide step is a leap of nearly a turn.
    high - low <= turn * (1.0 + 1e-6) && leaps > 0 && leaps == steps
}

/// Where a column of whole numbers leaps.
pub(super) fn wrapped(parts: &[&[f64]], e: Extent) -> Option<Wrap> {
    let span = e.high - e.low + 1.0;
    if 2.0 * e.leap < span {
        return None;
    }
    let at = |n: u32| f64::from(n) >= span && wraps(parts, f64::from(n));
    if (span > 32_768.0) && at(65_536) {
        return Some(Wrap::Counter);
    }
    likely().into_iter().find(|n| at(*n) && span > 0.75 * f64::from(*n)).map(Wrap::Turn)
}

/// The likely number of counts a turn of which a step is one.
pub(super) fn of_step(step: f64, turn: f64) -> Option<u32> {
    if step <= 0.0 {
        return None;
    }
    let n = turn / step;
    likely().into_iter().find(|l| (n / f64::from(*l) - 1.0).abs() < NEAR)
}

#[cfg(test)]
mod tests {
    use super::super::columns::extent;
    use super::*;

    #[test]
    fn turns_are_seen_where_counts_leap() {
        let truth: Vec<f64> = (0..9000).map(|i| (9000.0 * (f64::from(i) * 0.002).sin()).round()).collect();
        let of = |m: f64, low: f64| -> Option<Wrap> {
            let x: Vec<f64> = truth.iter().map(|c| (c - low).rem_euclid(m) + low).collect();
            wrapped(&[&x], extent(&[&x]))
        };
        assert_eq!(of(4096.0, 0.0), Some(Wrap::Turn(4096)));
        assert_eq!(of(2000.0, -1000.0), Some(Wrap::Turn(2000)));
        let fast: Vec<f64> = truth.iter().map(|c| (20.0 * c).rem_euclid(65_536.0)).collect();
        assert_eq!(wrapped(&[&fast], extent(&[&fast])), Some(Wrap::Counter));
        assert_eq!(wrapped(&[&truth], extent(&[&truth])), None);
    }

    #[test]
    fn steps_tell_the_encoder() {
        assert_eq!(of_step(360.0 / 4096.0, 360.0), Some(4096));
        assert_eq!(of_step(0.001_533_98, core::f64::consts::TAU), Some(4096));
        assert_eq!((of_step(0.017, 360.0), of_step(0.0, 360.0)), (None, None));
    }
}
