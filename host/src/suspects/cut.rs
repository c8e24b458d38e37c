//! A sensor that reaches its limit once.
//!
//! In a motion that is fast beside the samples second differences are somewhere as large as
//! velocities, and what was beyond the limit comes back as slowly as it turned round there: neither
//! end of the run has a velocity that jumps as [`super::frozen`] asks. What is lacking tells it:
//! all that comes to rest by itself slows down before, by as much in a sample as takes its velocity
//! in the last ones. A channel that stands elsewhere too, as an actuator that goes from place to
//! place, is left alone.
//!
//! Limits: a motion that runs against a stop, and is held there, looks the same.

use super::frozen::{JUMP, Run, SLOPE};
use super::trace::{Samples, Trace};

/// Fewest samples at a limit that is met once, and how many times as long as any other standing it
/// is.
const FEWEST: usize = 8;
const LONGER: usize = 4;

/// Whether runs at one extreme are those of a limit: once is a stop that happens to be the
/// furthest, unless nothing stops so.
pub fn is_limit(runs: &[&Run]) -> bool {
    runs.len() >= 2 || runs.iter().any(|r| r.is_cut)
}

/// Least and greatest value of a channel.
pub fn range(trace: &Trace<'_>) -> (f64, f64) {
    let all = trace.stretches.iter().flat_map(|s| (0..s.len()).map(move |i| s.at(i)));
    all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

/// Whether a run at the channel's least or greatest value is reached, or left, without slowing
/// down, in a channel that stands nowhere else as long.
pub fn cut(trace: &Trace<'_>, (stretch, from, to): (usize, usize, usize), [low, high]: [f64; 2]) -> bool {
    let s = &trace.stretches[stretch];
    let value = s.at(from);
    if to - from < FEWEST || from == 0 || to == s.len() || (value != low && value != high) {
        return false;
    }
    let full = full_speed(s, from, true, trace.quantum) || full_speed(s, to - 1, false, trace.quantum);
    full && trace.stretches.iter().all(|s| LONGER * longest_other(s, value) <= to - from)
}

/// The most samples in a row that are equal, at another value.
fn longest_other(s: &Samples<'_>, value: f64) -> usize {
    let (mut longest, mut from) = (0, 0);
    for i in 0..=s.len() {
        if i == s.len() || s.at(i) != s.at(from) {
            if s.at(from) != value {
                longest = longest.max(i - from);
            }
            from = i;
        }
    }
    longest
}

/// Whether the motion goes on to the end `at` of a run as if there were none: its velocity over the
/// last samples is [`JUMP`] times what it lost of it in any of them.
fn full_speed(s: &Samples<'_>, at: usize, before: bool, quantum: f64) -> bool {
    let enough = if before { at >= SLOPE + 2 } else { at + SLOPE + 2 < s.len() };
    if !enough {
        return false;
    }
    let x = |k: usize| if before { s.at(at - k) } else { s.at(at + k) };
    let sign = (x(0) - x(1 + SLOPE)).signum();
    let step = |k: usize| sign * (x(k) - x(k + 1));
    let v = (1..=SLOPE).map(step).sum::<f64>() / SLOPE as f64;
    let slowed = (1..=SLOPE).map(|k| step(k + 1) - step(k)).fold(0.0, f64::max);
    v > JUMP * slowed.max(quantum / 3.0) && v > 3.0 * quantum
}

#[cfg(test)]
mod tests {
    use super::super::frozen::runs;
    use super::*;

    fn of_values(x: &[f64]) -> Vec<Run> {
        runs(&Trace::new(vec![Samples::Values(x)]))
    }

    /// A level that is driven fast beside its samples, with noise on it.
    fn level(i: usize) -> f64 {
        let noise = ((i * 7919) % 1009) as f64 / 1009.0 - 0.5;
        let at = |i: f64| 6.0 + 2.0 * (0.05 * i).sin() + 5.0 * (-((i - 160.0) / 9.0).powi(2)).exp();
        (1e4 * (at(i as f64) + 0.02 * noise)).round() / 1e4
    }

    #[test]
    fn a_limit_that_is_met_once_is_told_and_a_stop_is_not() {
        let free: Vec<f64> = (0..500).map(level).collect();
        assert_eq!(of_values(&free), []);
        let clipped: Vec<f64> = free.iter().map(|x| x.min(9.5)).collect();
        let found = of_values(&clipped);
        assert!(matches!(found[..], [r] if r.is_cut && r.extreme == 1 && r.value == 9.5), "{found:?}");
        // What slows down before it stands.
        let stopped: Vec<f64> = (0..500)
            .map(|i| match i {
                0..150 => 0.01 * (0.2 * i as f64).sin(),
                150..160 => 0.02 * (i as f64 - 150.0) * (170.0 - i as f64),
                160..200 => 2.0,
                _ => 1.0 + (0.02 * (i as f64 - 200.0)).cos(),
            })
            .collect();
        assert!(of_values(&stopped).iter().all(|r| !r.is_cut), "{:?}", of_values(&stopped));
        // An actuator that goes from place to place stands everywhere.
        let places: Vec<f64> = (0..600)
            .map(|i| {
                let (k, within) = (i / 60, i % 60);
                let place = |k: usize| ((k * 37) % 11) as f64;
                place(k) + (place(k + 1) - place(k)) * (within as f64 / 12.0).min(1.0)
            })
            .collect();
        assert!(of_values(&places).iter().all(|r| !r.is_cut), "{:?}", of_values(&places));
    }
}
