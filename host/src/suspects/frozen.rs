//! Runs in which a channel stands although it was moving just before, or just behind: an encoder
//! that stops, a sensor that clips.
//!
//! A joint that comes to rest, or is held by friction, or turns round does so with a velocity that
//! goes to zero: over the last few samples it is of the size of its own change from sample to
//! sample. A sensor that stops, or reaches its limit, has a velocity that jumps. With v the mean
//! velocity of the [`SLOPE`] samples at an end of a run and a the greatest second difference of the
//! [`NEAR`] samples behind them, the run is broken at that end where abs(v) > [`JUMP`] a and
//! abs(v) > 3 steps a sample. (A turning point has abs(v) ≤ (SLOPE/2 + 1) a, dry friction
//! likewise.)
//!
//! Where a channel moves by few counts a sample, velocities drown in the counts' own steps: what
//! stops for good is then held against the whole stretch, see [`super::leap`].
//!
//! A limit that is met once in a motion that is fast beside the samples is seen otherwise, see
//! [`super::cut`].
//!
//! A line that was filled in is the same with a slope, see [`super::filled`].
//!
//! Limits: a sensor that stops within some milliseconds of a turning point looks like a joint that
//! is held, and is not told from it; nor is one that is away for a while in a slow motion.

use super::cut::{cut, range};
use super::filled;
use super::leap::leaps;
use super::trace::{Samples, Trace};

/// Samples over which the velocity is taken.
pub(super) const SLOPE: usize = 3;
/// Samples behind these whose second differences are compared.
const NEAR: usize = 12;
/// Ratio of velocity to second difference: thrice what a turning point has.
pub(super) const JUMP: f64 = 7.5;
/// Fewest samples of a run inside a stretch.
const FEWEST: usize = 4;
/// Fewest at a limit that was met in full motion elsewhere.
const MET: usize = 2;
/// Fewest of a run that lasts to an end of the stretch.
const FEWEST_AT_END: usize = 32;

/// A run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run {
    pub stretch: usize,
    pub from: usize,
    pub to: usize,
    /// Where it stands.
    pub value: f64,
    /// Whether that is the channel's greatest (1) or least value (−1).
    pub extreme: i8,
    /// Whether it lasts to the end, or from the beginning, of the stretch.
    pub open: bool,
    /// Whether it is a limit of the sensor though it is met once.
    pub is_cut: bool,
    /// Of a straight line that was filled in: where it ends.
    pub filled_to: Option<f64>,
}

/// All runs of a channel that no motion makes.
pub fn runs(trace: &Trace<'_>) -> Vec<Run> {
    let mut equal = Vec::new();
    for (stretch, s) in trace.stretches.iter().enumerate() {
        match s {
            Samples::Counts(x) => equal_runs(x, stretch, &mut equal),
            Samples::Values(x) => equal_runs(x, stretch, &mut equal),
        }
    }
    let (low, high) = if equal.is_empty() { (0.0, 0.0) } else { range(trace) };
    let cut: Vec<(usize, usize, usize)> = equal.iter().filter(|run| cut(trace, **run, [low, high])).copied().collect();
    equal.retain(|run| {
        let (stretch, from, to) = *run;
        let s = &trace.stretches[stretch];
        let open = from == 0 || to == s.len();
        let leaps = |before: bool| open && leaps(s, (from, to), before, trace.quantum);
        let entry = from == 0 || breaks(s, from, true, trace.quantum) || leaps(true);
        let exit = || to == s.len() || breaks(s, to - 1, false, trace.quantum) || returns(s, to, trace) || leaps(false);
        entry && exit() || cut.contains(run)
    });
    let mut lines = filled::lines(trace);
    lines.retain(|l| !equal.iter().any(|e| e.0 == l.0 && e.1 < l.2 && l.1 < e.2));
    let mut runs: Vec<Run> = lines.iter().map(|l| line(trace, *l)).collect();
    if equal.is_empty() {
        return runs;
    }
    let run = |(stretch, from, to): (usize, usize, usize)| {
        let s = &trace.stretches[stretch];
        let value = s.at(from);
        let extreme = if value == high { 1 } else { -i8::from(value == low) };
        let is_cut = cut.contains(&(stretch, from, to));
        Run { stretch, from, to, value, extreme, open: from == 0 || to == s.len(), is_cut, filled_to: None }
    };
    runs.extend(equal.into_iter().map(run));
    let again = |of: &Run| met_again(trace, of, &runs);
    let met: Vec<Run> =
        [1, -1].iter().filter_map(|sign| runs.iter().find(|r| r.extreme == *sign && !r.open)).flat_map(again).collect();
    runs.extend(met);
    runs
}

/// Where else a channel stands at a limit that it reached in full motion once: a slower motion
/// reaches it as a turning point would, but for equal samples. Steps of a sensor make such at every
/// turning point: there the motion before must lead beyond.
fn met_again(trace: &Trace<'_>, of: &Run, known: &[Run]) -> Vec<Run> {
    let mut found = Vec::new();
    for (stretch, s) in trace.stretches.iter().enumerate() {
        let mut from = 0;
        while from < s.len() {
            let to = from + (from..s.len()).take_while(|&i| s.at(i) == of.value).count();
            let overlaps = |r: &&Run| r.stretch == stretch && r.from < to && from < r.to;
            let beyond = trace.quantum == 0.0 || overshoot(s, from, to) > 3.0 * trace.quantum;
            if to >= from + MET && beyond && !known.iter().any(|r| overlaps(&r)) {
                found.push(Run { stretch, from, to, open: from == 0 || to == s.len(), ..*of });
            }
            from = to.max(from + 1);
        }
    }
    found
}

/// How far the last three samples before a run lead beyond it by its middle, by their velocity v and
/// change of velocity a: abs(v n/2 + a n²/8).
fn overshoot(s: &Samples<'_>, from: usize, to: usize) -> f64 {
    if from < 3 {
        return 0.0;
    }
    let [x, y, z] = [3, 2, 1].map(|k| s.at(from - k));
    let half = 0.5 * (to - from) as f64;
    ((z - y) * half + 0.5 * (z - 2.0 * y + x) * half * half).abs()
}

/// A straight line.
fn line(trace: &Trace<'_>, (stretch, from, to): (usize, usize, usize)) -> Run {
    let s = &trace.stretches[stretch];
    let open = from == 0 || to == s.len();
    Run { stretch, from, to, value: s.at(from), extreme: 0, open, is_cut: false, filled_to: Some(s.at(to - 1)) }
}

/// Runs of equal samples that are long enough, but for a whole stretch.
fn equal_runs<T: PartialEq>(x: &[T], stretch: usize, found: &mut Vec<(usize, usize, usize)>) {
    let mut from = 0;
    while from + FEWEST <= x.len() {
        // Compared from behind: where the last two of a run differ, those before them need not be
        // looked at.
        let mut k = from + FEWEST - 1;
        while k > from && x[k] == x[k - 1] {
            k -= 1;
        }
        if k > from {
            from = k;
            continue;
        }
        let mut to = from + FEWEST;
        while to < x.len() && x[to] == x[to - 1] {
            to += 1;
        }
        let open = from == 0 || to == x.len();
        if (!open || to - from >= FEWEST_AT_END) && to - from < x.len() {
            found.push((stretch, from, to));
        }
        from = to;
    }
}

/// Whether the velocity jumps where a run has its end `at`: `before` it or behind.
fn breaks(s: &Samples<'_>, at: usize, before: bool, quantum: f64) -> bool {
    let enough = if before { at >= SLOPE + 4 } else { at + SLOPE + 4 < s.len() };
    if !enough {
        return false;
    }
    let x = |k: usize| if before { s.at(at - k) } else { s.at(at + k) };
    let room = if before { at } else { s.len() - 1 - at };
    let v = ((x(1) - x(1 + SLOPE)) / SLOPE as f64).abs();
    let last = (SLOPE + NEAR).min(room - 1);
    let a = (2..=last).map(|k| (x(k - 1) - 2.0 * x(k) + x(k + 1)).abs()).fold(0.0, f64::max);
    v > JUMP * a.max(quantum / 3.0) && v > 3.0 * quantum
}

/// Whether the value leaps at the end of a run by more than the motion behind it does in ten
/// samples: a sensor that comes back.
fn returns(s: &Samples<'_>, end: usize, trace: &Trace<'_>) -> bool {
    if end + NEAR >= s.len() {
        return false;
    }
    let leap = (s.at(end) - s.at(end - 1)).abs();
    let fastest = (end + 1..end + NEAR).map(|i| (s.at(i) - s.at(i - 1)).abs()).fold(0.0, f64::max);
    leap > 10.0 * fastest.max(trace.quantum)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(x: &[i32]) -> Vec<Run> {
        runs(&Trace::new(vec![Samples::Counts(x)]))
    }

    fn swing(n: usize) -> Vec<i32> {
        (0..n).map(|i| (700.0 * (0.02 * i as f64).sin()).floor() as i32).collect()
    }

    #[test]
    fn an_encoder_that_stops_and_one_that_clips_are_told_from_rest() {
        let mut x = swing(3000);
        let last = x[1900];
        x[1900..].iter_mut().for_each(|c| *c = last);
        let found = of(&x);
        assert!(found.len() == 1 && found[0].from == 1900 && found[0].open && found[0].extreme == 0, "{found:?}");
        x.reverse();
        assert!(of(&x).len() == 1 && of(&x)[0].to == 1100);
        let clipped: Vec<i32> = swing(3000).iter().map(|c| (*c).clamp(-400, 400)).collect();
        let found = of(&clipped);
        assert!(found.len() > 10 && found.iter().all(|r| r.extreme != 0), "{found:?}");
        // A limit that is met once in full motion, and once by a turning point a little beyond it.
        let rail = |i: i32| match i {
            0..1200 => 380.0 * (0.05 * f64::from(i)).sin(),
            1200..2400 => 415.0 * (0.04 * f64::from(i)).sin(),
            _ => 900.0 * (0.04 * f64::from(i - 2400) - 1.57).sin(),
        };
        let turned: Vec<i32> = (0..2550).map(|i| (rail(i).floor() as i32).clamp(-2000, 400)).collect();
        let found = of(&turned);
        assert!(found.iter().any(|r| r.from > 2400) && found.iter().any(|r| r.from < 2400), "{found:?}");
        assert!(found.iter().all(|r| r.extreme == 1 && r.value == 400.0), "{found:?}");
        // Turning points, a decay into rest, dry friction that holds for half a second and lets go.
        assert_eq!(of(&swing(3000)), []);
        let rest: Vec<i32> = (0..6000)
            .map(|i| (700.0 * (-0.003 * f64::from(i)).exp() * (0.02 * f64::from(i)).sin()).floor() as i32)
            .collect();
        assert_eq!(of(&rest), []);
        let held: Vec<i32> = (0..3000)
            .map(|i| match i % 1000 {
                k @ 0..=300 => (300.0 * (1.0 - (0.01 * f64::from(k)).cos())) as i32,
                _ => (300.0 * (1.0 - 3f64.cos())) as i32,
            })
            .collect();
        assert!(of(&held).iter().all(|r| r.from % 1000 != 301), "{:?}", of(&held));
    }

    /// Some seconds of a slow motion of two frequencies, in counts.
    fn slow(n: usize, size: f64, seed: usize) -> Vec<i32> {
        let phase = seed as f64;
        let at = |i: f64| size * ((0.008 * i + phase).sin() + 0.3 * (0.0213 * i + 2.0 * phase).cos());
        (0..n).map(|i| at(i as f64).floor() as i32).collect()
    }

    #[test]
    fn an_encoder_that_stops_for_good_in_a_slow_motion_is_told() {
        let (mut told, mut all) = (0, 0);
        for seed in 0..60 {
            // Its fastest samples are 1 to 4 counts apart.
            let size = 90.0 * (1.0 + (seed % 4) as f64);
            let clean = slow(6000, size, seed);
            assert_eq!(of(&clean), [], "{seed}");
            let at = 2000 + 37 * seed;
            let mut x = clean.clone();
            let last = x[at - 1];
            x[at..].iter_mut().for_each(|c| *c = last);
            // Close to a turning point it is not told from a joint that is held.
            let speed = f64::from((clean[at + 10] - clean[at - 10]).abs()) / 20.0;
            if speed < 0.4 * size / 90.0 {
                continue;
            }
            all += 1;
            let found = of(&x);
            told += usize::from(matches!(found[..], [r] if r.open && r.from.abs_diff(at) < 4));
            // One that begins late, likewise.
            x.reverse();
            assert_eq!(of(&x).len(), found.len(), "{seed}");
        }
        assert!(told * 10 >= all * 9 && all > 30, "{told} of {all}");
    }

    #[test]
    fn a_pendulum_that_comes_to_rest_has_not_lost_its_encoder() {
        // Viscous and dry friction, slow and fast ones, each from many starts; Stribeck's too.
        for (counts, rate) in [(4096.0, 500.0), (1024.0, 500.0), (4096.0, 5000.0), (65_536.0, 1000.0), (512.0, 200.0)] {
            for (viscous, dry, more) in
                [(0.3, 0.0, 0.0), (0.1, 1.0, 0.0), (0.02, 8.0, 0.0), (0.0, 3.0, 6.0), (4.0, 0.5, 0.5)]
            {
                for start in 0..4 {
                    let (mut x, mut v) = (0.1 + 0.2 * f64::from(start), 0.0_f64);
                    let mut row = Vec::new();
                    let fine = 1.0 / (rate * 4.0);
                    for i in 0..(40.0 * rate) as usize {
                        if i % 4 == 0 {
                            row.push((x * counts / core::f64::consts::TAU).floor() as i32);
                        }
                        let force = -60.0 * x.sin() - viscous * v;
                        let hold = dry + more * (-(v / 0.3).powi(2)).exp();
                        if v == 0.0 && force.abs() <= dry + more {
                            continue;
                        }
                        let sign = if v == 0.0 { force.signum() } else { v.signum() };
                        let next = v + fine * (force - hold * sign);
                        v = if next * v < 0.0 { 0.0 } else { next };
                        x += fine * v;
                    }
                    let found = of(&row);
                    assert_eq!(found, [], "{counts} {rate}: {viscous} {dry} {more} from {start}");
                }
            }
        }
    }

    #[test]
    fn a_drop_out_in_between_is_found() {
        let mut x = swing(3000);
        let held = x[1250];
        x[1250..1400].iter_mut().for_each(|c| *c = held);
        let found = of(&x);
        assert!(found.len() == 1 && (found[0].from, found[0].to) == (1250, 1400), "{found:?}");
    }
}
