//! Breaks of single channels, put together: what happens to all channels at one row is no encoder's
//! slip.
//!
//! At a row where steps S_k are found, with v_k the mean of the increments on either side: S_k = m
//! v_k for one whole m ≥ 1 in every channel that shows it means m rows missing there, S_k = −v_k a
//! row that is there twice. Steps of two channels at one row that are neither are two records
//! joined, and so is a step of one channel whose velocity leaps there: the others may have met by
//! chance. A channel that takes no part must not contradict: abs(S_k − m v_k) within 5 of its own
//! increments' scatter.
//!
//! A joint that one channel alone shows must stand out of the motion: of the greatest third
//! difference |x(i+2) − 3 x(i+1) + 3 x(i) − x(i−1)| that the channel has anywhere else, a step S
//! makes 2 S there and a leap B of the velocity B, it is at least [`STANDS_OUT`] times as great. An
//! arm that is flung round once in a record bends its curve within a sample or two as well.

use super::breaks::{Found, Kind};
use super::trace::Trace;

/// Relative deviation of S/v from a whole number.
const WHOLE: f64 = 0.12;
/// Scatter from which a channel contradicts.
const CONTRADICTS: f64 = 5.0;
/// Third difference of a joint over the greatest of the motion.
const STANDS_OUT: f64 = 2.0;

/// What happened at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// Samples of one channel are off.
    Spike(usize, Found),
    /// A channel is off by a step from here on.
    Slip(usize, Found),
    /// Rows are missing (how many), or there twice (−1), in this stretch before this sample.
    Rows(i64, usize, usize),
    /// Another record goes on, in this stretch from this sample.
    Joined(usize, usize),
}

/// All events, in order of stretch and sample.
pub fn sort(traces: &[Trace<'_>], found: &[Vec<Found>]) -> Vec<Event> {
    let mut all: Vec<(usize, Found)> =
        found.iter().enumerate().flat_map(|(k, f)| f.iter().map(move |f| (k, *f))).collect();
    all.sort_by_key(|(k, f)| (f.stretch, f.from, *k));
    let mut greatest: Vec<Option<f64>> = vec![None; traces.len()];
    let mut events = Vec::new();
    let mut i = 0;
    while i < all.len() {
        let (channel, f) = all[i];
        if f.kind == Kind::Spike {
            events.push(Event::Spike(channel, f));
            i += 1;
            continue;
        }
        let near = |(_, g): &(usize, Found)| g.stretch == f.stretch && g.kind != Kind::Spike && g.from <= f.from + 1;
        let group: Vec<(usize, Found)> = all[i..].iter().take_while(|g| near(g)).copied().collect();
        i += group.len();
        events.push(match rows(traces, &group) {
            Some(m) => Event::Rows(m, f.stretch, f.from),
            None if group.len() > 1 => Event::Joined(f.stretch, f.from),
            // An encoder's slip leaves the velocity as it was.
            None if f.kind == Kind::Break && (traces.len() == 1 || f.bend != 0.0) => {
                let (trace, found) = (&traces[channel], &found[channel]);
                let own = *greatest[channel].get_or_insert_with(|| greatest_elsewhere(trace, found));
                let here = sees(trace, &f).map(|i| third(trace, f.stretch, i)).fold(0.0, f64::max);
                if here < STANDS_OUT * own {
                    continue;
                }
                Event::Joined(f.stretch, f.from)
            }
            None => Event::Slip(channel, f),
        });
    }
    events
}

/// |x(i+2) − 3 x(i+1) + 3 x(i) − x(i−1)| in a stretch.
fn third(trace: &Trace<'_>, stretch: usize, i: usize) -> f64 {
    let s = &trace.stretches[stretch];
    (s.at(i + 2) - 3.0 * s.at(i + 1) + 3.0 * s.at(i) - s.at(i - 1)).abs()
}

/// Third differences, by their i, that have samples on both sides of what was found.
fn sees(trace: &Trace<'_>, f: &Found) -> core::ops::Range<usize> {
    let end = trace.stretches[f.stretch].len().saturating_sub(2);
    f.from.saturating_sub(2).max(1)..(f.from.max(f.to) + 1).min(end)
}

/// The greatest third difference of a channel where nothing was found.
fn greatest_elsewhere(trace: &Trace<'_>, found: &[Found]) -> f64 {
    let mut greatest = 0.0_f64;
    for (k, s) in trace.stretches.iter().enumerate() {
        let mut apart = vec![true; s.len()];
        found.iter().filter(|f| f.stretch == k).flat_map(|f| sees(trace, f)).for_each(|i| apart[i] = false);
        let own = (1..s.len().saturating_sub(2)).filter(|i| apart[*i]).map(|i| third(trace, k, i));
        greatest = own.fold(greatest, f64::max);
    }
    greatest
}

/// Increment before, at and behind a place.
fn increments(trace: &Trace<'_>, stretch: usize, at: usize) -> Option<[f64; 3]> {
    let s = trace.stretches.get(stretch)?;
    (at >= 2 && at + 1 < s.len())
        .then(|| [s.at(at - 1) - s.at(at - 2), s.at(at) - s.at(at - 1), s.at(at + 1) - s.at(at)])
}

/// How many rows are missing, if that explains every channel.
fn rows(traces: &[Trace<'_>], group: &[(usize, Found)]) -> Option<i64> {
    let (first, f) = group.first()?;
    let [a, _, c] = increments(&traces[*first], f.stretch, f.from)?;
    let m = (f.size / (0.5 * (a + c))).round();
    if !(m == -1.0 || (1.0..=1000.0).contains(&m)) {
        return None;
    }
    let agrees = |(k, f): &(usize, Found)| {
        let Some([a, _, c]) = increments(&traces[*k], f.stretch, f.from) else { return false };
        let v = 0.5 * (a + c);
        (f.size - m * v).abs() <= (WHOLE * v.abs()).max(3.0 * f.error) && v.abs() > 5.0 * f.error
    };
    let silent = |k: usize, trace: &Trace<'_>| {
        if group.iter().any(|(g, _)| *g == k) {
            return true;
        }
        let Some([a, b, c]) = increments(trace, f.stretch, f.from) else { return false };
        let (v, scatter) = (0.5 * (a + c), (c - a).abs().max(trace.quantum));
        (b - v - m * v).abs() <= CONTRADICTS * scatter && (m > 0.0 || b == 0.0)
    };
    (group.iter().all(agrees) && traces.iter().enumerate().all(|(k, t)| silent(k, t))).then_some(m as i64)
}

#[cfg(test)]
mod tests {
    use super::super::trace::Samples;
    use super::super::{breaks::Judge, screen::screen};
    use super::*;

    fn events(x: &[Vec<i32>; 2]) -> Vec<Event> {
        let traces: Vec<Trace<'_>> = x.iter().map(|c| Trace::new(vec![Samples::Counts(c)])).collect();
        let found: Vec<Vec<Found>> = traces.iter().map(|t| Judge::new(t).unwrap().judge(t, &screen(t))).collect();
        sort(&traces, &found)
    }

    fn motion() -> [Vec<i32>; 2] {
        let of = |a: f64, w: f64| (0..20_000).map(|i| (a * (w * f64::from(i)).sin()).floor() as i32).collect();
        [of(900.0, 0.04), of(1500.0, 0.031)]
    }

    #[test]
    fn slips_missing_rows_and_joined_records_are_told_apart() {
        let mut x = motion();
        x[1][9000..].iter_mut().for_each(|c| *c += 13);
        assert!(matches!(events(&x)[..], [Event::Slip(1, f)] if f.from == 9000), "{:?}", events(&x));
        let mut x = motion();
        x.iter_mut().for_each(|c| drop(c.drain(9003..9005)));
        assert_eq!(events(&x), [Event::Rows(2, 0, 9003)]);
        let mut x = motion();
        x.iter_mut().for_each(|c| drop(c.drain(9003..9590)));
        assert_eq!(events(&x), [Event::Joined(0, 9003)]);
    }

    #[test]
    fn records_that_meet_by_chance_in_one_channel_are_joined() {
        let mut x = motion();
        x[0] = (0..20_000)
            .map(|i| (900.0 * (core::f64::consts::TAU / 160.0 * f64::from(i)).sin()).floor() as i32)
            .collect();
        x.iter_mut().for_each(|c| drop(c.drain(9003..9163)));
        assert_eq!(events(&x), [Event::Joined(0, 9003)]);
        // A slip of one channel leaves its velocity as it was, however great it is.
        let mut x = motion();
        x[1][9000..].iter_mut().for_each(|c| *c -= 17_644);
        assert!(matches!(events(&x)[..], [Event::Slip(1, f)] if f.from == 9000), "{:?}", events(&x));
    }

    #[test]
    fn one_fast_turn_of_an_arm_is_motion() {
        // Increments of an arm that is flung round: third differences up to 22.
        let turn = [
            -103, -117, -132, -149, -164, -183, -202, -223, -246, -274, -305, -336, -361, -367, -351, -321, -289, -259,
            -233, -211, -191, -173, -157, -141, -126, -112, -98,
        ];
        let of = |speed: f64| turn.map(|d| speed * f64::from(d)).into_iter();
        let record = |leap: f64| -> Vec<i32> {
            let increments = of(0.95).chain(of(1.0)).chain(of(0.95));
            let mut x = 0.0;
            let sum = |(i, d): (usize, f64)| {
                x += d + if i == 40 { leap } else { 0.0 };
                x as i32
            };
            increments.enumerate().map(sum).collect()
        };
        let at = |from: usize| Found {
            stretch: 0,
            from,
            to: from,
            kind: Kind::Break,
            size: -16.0,
            error: 1.0,
            bend: 20.0,
            z: 9.0,
        };
        let joined = |leap: f64| {
            let x = record(leap);
            sort(&[Trace::new(vec![Samples::Counts(&x)])], &[vec![at(40)]])
        };
        assert_eq!(joined(0.0), []);
        assert_eq!(joined(-90.0), [Event::Joined(0, 40)]);
    }
}
