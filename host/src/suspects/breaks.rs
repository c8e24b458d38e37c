//! What a suspect of [`super::screen`] is: a spike, a slip, a break, or real motion.
//!
//! On the suspect's samples and W on either side a polynomial is fitted together with each of
//! - motion: nothing; a bend (an impact: the velocity jumps); a change of curvature (dry friction:
//!   the acceleration jumps); a bend and a change of curvature,
//! - a spike: m samples in a row left free,
//! - a slip: a step in an otherwise unbroken motion,
//! - a break: a step, a bend and a change of curvature at one place (another motion goes on).
//!
//! With σ² the variance that the same polynomial leaves beside the suspect, a hypothesis with k
//! shapes costs rest/σ² + [`PRICE`] k. One that is no motion is believed where (a) z² = its gain
//! over the cheapest motion exceeds the limit that [`super::tail`] derives from places spread over
//! the record, (b) what it leaves is like what is left beside it, and (c) its size exceeds twice
//! every bend that motion itself has in this record (impacts, play). A break's velocity is said to
//! leap where without the bend z² more than that limit's would be left, and it exceeds twice those
//! bends as well. W and the polynomial's degree are those with which the height of a step is least
//! uncertain over the record: the better the smaller the band of the motion.

use super::height;
use super::local_fit::{Fitted, Shape, Window, fit};
use super::screen::Suspect;
use super::tail;
use super::trace::Trace;
use crate::statistics::{median, quantile};

/// Half widths and degrees that are tried, and those that follow a swing of a few samples.
pub(super) const WINDOWS: [(usize, usize); 6] = [(5, 3), (8, 3), (8, 5), (12, 5), (18, 7), (28, 7)];
pub(super) const NARROW: [(usize, usize); 2] = [(5, 5), (6, 7)];
/// Cost of a shape: e⁻⁶ for each choice among some dozens of places.
const PRICE: f64 = 12.0;
/// Least limit of z, what Gaussian noise needs at 10⁻⁹ a look: below it the derived one is not
/// believed, as it knows some hundred places only.
const LEAST: f64 = 6.0;
/// Greatest ratio of what a hypothesis leaves to what is left beside it.
pub(super) const LIKE: f64 = 6.0;
/// Places spread over the record.
const CONTROLS: usize = 400;
/// Suspects are judged so many at a time, the greatest first, and at most so many times.
const BATCH: usize = 32;
const BATCHES: usize = 16;
/// What a break must cost less than a spike or a slip, which are simpler: three shapes, and once
/// more for safety.
const BREAK_DEARER: f64 = 24.0;
/// Widest suspect, samples.
const WIDEST: usize = 48;

/// What it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Samples `from` to before `to` are off.
    Spike,
    /// From `from` on all samples are off by the size.
    Slip,
    /// From `from` on another motion goes on.
    Break,
}

/// A verdict on a suspect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    pub stretch: usize,
    pub from: usize,
    pub to: usize,
    pub kind: Kind,
    /// Height of the spike or step, channel's unit.
    pub size: f64,
    /// Its standard error.
    pub error: f64,
    /// Of a break: by how much the velocity leaps, unit a sample; 0 where real motion leaps as
    /// much, or noise might.
    pub bend: f64,
    /// Standard deviations by which it beats real motion.
    pub z: f64,
}

/// A channel's judge: how wide it looks, and what chance does.
#[derive(Clone, Debug)]
pub struct Judge {
    half: usize,
    degree: usize,
    /// Variance that is left at chance places.
    variance: f64,
    /// Limit of z.
    limit: f64,
    /// Bend of motion at chance places, 99 %.
    bend: f64,
}

impl Judge {
    /// Learns a channel. None where it is too short.
    pub fn new(trace: &Trace<'_>) -> Option<Self> {
        let least = trace.quantum * trace.quantum / 12.0;
        let mut best: Option<(f64, Self)> = None;
        for (half, degree) in WINDOWS {
            let n = 2 * half;
            let window = Window::new(n, degree);
            let (step, bend) =
                (window.shape(Shape::Step(half as f64 - 0.5)), window.shape(Shape::Bend(half as f64 - 0.5)));
            let middle = window.shape(Shape::Sample(half));
            let mut x = vec![0.0; n];
            let (mut heights, mut bends, mut left, mut z) = (vec![], vec![], vec![], vec![]);
            for (stretch, at) in places(trace, n) {
                trace.stretches[stretch].copy(at, &mut x);
                window.reduce(&mut x);
                let (rest, s) = (fit(&x, &[]).rest, fit(&x, &[&step]));
                let m = fit(&x, &[&middle]);
                heights.push(s.values[0].abs());
                bends.push(fit(&x, &[&bend]).values[0].abs());
                left.push(rest / window.freedom() as f64);
                z.push((rest - s.rest).max(rest - m.rest));
            }
            if z.len() < tail::FEWEST {
                continue;
            }
            let local = |k: usize, left: &[f64]| {
                let near = &left[k.saturating_sub(1)..(k + 2).min(left.len())];
                near.iter().copied().fold(0.0, f64::max)
            };
            let variance = median(&mut left.clone()).max(least);
            let mut z: Vec<f64> = z
                .iter()
                .enumerate()
                .map(|(k, g)| (g / local(k, &left).max(variance).max(f64::MIN_POSITIVE)).sqrt())
                .collect();
            let Some(limit) = tail::limit(&mut z, trace.len()).map(|l| l.max(LEAST)) else { continue };
            let scatter = median(&mut heights) * 1.4826;
            let judge = Self { half, degree, variance, limit, bend: quantile(&mut bends, 0.99) };
            if best.as_ref().is_none_or(|b| scatter < b.0) {
                best = Some((scatter, judge));
            }
        }
        best.map(|b| b.1)
    }

    /// Judges all suspects of a channel.
    pub fn judge(&self, trace: &Trace<'_>, suspects: &[Suspect]) -> Vec<Found> {
        let mut order: Vec<usize> = (0..suspects.len()).collect();
        order.sort_by(|&a, &b| suspects[b].size.total_cmp(&suspects[a].size));
        let mut found: Vec<Found> = Vec::new();
        let mut bend = self.bend;
        for batch in order.chunks(BATCH).take(BATCHES) {
            let before = found.len();
            for &k in batch {
                match self.one(trace, &suspects[k]) {
                    Some(Verdict::Fault(f)) => found.push(f),
                    Some(Verdict::Motion(size)) => bend = bend.max(size),
                    None => {}
                }
            }
            found.retain(|f| f.z > self.limit && f.size.abs() > 2.0 * bend && f.size.abs() > 1.5 * trace.quantum);
            found.retain(|f| height::is_its_own(trace, f, (self.half, self.degree)) && height::has_an_edge(trace, f));
            // The greatest come first: where they are motion, so are the others.
            if 4 * found.len().saturating_sub(before) < batch.len() {
                break;
            }
        }
        found.iter_mut().filter(|f| f.bend.abs() <= 2.0 * bend).for_each(|f| f.bend = 0.0);
        found.sort_by_key(|f| (f.stretch, f.from));
        found
    }

    fn one(&self, trace: &Trace<'_>, suspect: &Suspect) -> Option<Verdict> {
        let s = &trace.stretches[suspect.stretch];
        let span = suspect.to - suspect.from;
        if span > WIDEST {
            return None;
        }
        let first = suspect.from.saturating_sub(self.half);
        let last = (suspect.to + self.half).min(s.len());
        let window = Window::new(last - first, self.degree);
        let (before, behind) = (suspect.from - first, last - suspect.to);
        if before < 2 || behind < 2 || window.freedom() < span + 3 {
            return None;
        }
        let variance = self.beside(trace, suspect, window.len());
        let mut x = vec![0.0; last - first];
        s.copy(first, &mut x);
        window.reduce(&mut x);
        let cost = |f: &Fitted, shapes: usize| f.rest / variance + PRICE * shapes as f64;
        let motion = motions(&window, &x, before, span, &cost);
        let mut best: Option<(f64, Found, f64)> = None;
        let mut offer =
            |c: f64, kind: Kind, (from, to): (usize, usize), fitted: &Fitted, shapes: usize, which: usize| {
                if best.as_ref().is_none_or(|b| c < b.0) {
                    let freedom = window.freedom().saturating_sub(shapes).max(1) as f64;
                    let error = variance.sqrt() * fitted.error;
                    let f = Found {
                        stretch: suspect.stretch,
                        from: first + from,
                        to: first + to,
                        kind,
                        size: fitted.values[which],
                        error,
                        bend: 0.0,
                        z: 0.0,
                    };
                    best = Some((c, f, fitted.rest / freedom / variance));
                }
            };
        let samples: Vec<Vec<f64>> = (before..before + span).map(|k| window.shape(Shape::Sample(k))).collect();
        for m in 1..=span {
            for a in 0..=span - m {
                // Long spikes only as the whole of the suspect.
                if m > 6 && m < span {
                    continue;
                }
                let free: Vec<&[f64]> = samples[a..a + m].iter().map(Vec::as_slice).collect();
                let f = fit(&x, &free);
                let which = (0..m).fold(0, |w, i| if f.values[i].abs() > f.values[w].abs() { i } else { w });
                offer(cost(&f, m), Kind::Spike, (before + a, before + a + m), &f, m, which);
            }
        }
        for c in before..=before + span {
            let at = c as f64 - 0.5;
            let step = window.shape(Shape::Step(at));
            let f = fit(&x, &[&step]);
            offer(cost(&f, 1), Kind::Slip, (c, c), &f, 1, 0);
            let (bend, curvature) = (window.shape(Shape::Bend(at)), window.shape(Shape::Curvature(at)));
            let f = fit(&x, &[&bend, &curvature, &step]);
            offer(cost(&f, 3) + BREAK_DEARER, Kind::Break, (c, c), &f, 3, 2);
        }
        let (cheapest, mut found, like) = best?;
        let gain = motion.0 - cheapest;
        if gain <= 0.0 {
            return Some(Verdict::Motion(if motion.1 < LIKE { motion.2 } else { 0.0 }));
        }
        found.z = gain.sqrt();
        if found.kind == Kind::Break {
            let at = (found.from - first) as f64 - 0.5;
            let [step, bend, curvature] =
                [Shape::Step(at), Shape::Bend(at), Shape::Curvature(at)].map(|s| window.shape(s));
            let (with, without) = (fit(&x, &[&step, &curvature, &bend]), fit(&x, &[&step, &curvature]));
            if without.rest - with.rest > self.limit * self.limit * variance {
                found.bend = with.values[2];
            }
        }
        (like < LIKE).then_some(Verdict::Fault(found))
    }

    /// Variance that the polynomial leaves beside a suspect: the second greatest of two windows on
    /// either side.
    fn beside(&self, trace: &Trace<'_>, suspect: &Suspect, n: usize) -> f64 {
        let s = &trace.stretches[suspect.stretch];
        let window = Window::new(n, self.degree);
        let starts = [
            suspect.from.checked_sub(2 * n),
            suspect.from.checked_sub(n),
            Some(suspect.to).filter(|a| a + n <= s.len()),
            Some(suspect.to + n).filter(|a| a + n <= s.len()),
        ];
        let mut x = vec![0.0; n];
        let mut left: Vec<f64> = starts
            .iter()
            .flatten()
            .map(|&at| {
                s.copy(at, &mut x);
                window.reduce(&mut x);
                fit(&x, &[]).rest / window.freedom() as f64
            })
            .collect();
        left.sort_unstable_by(|a, b| b.total_cmp(a));
        left.get(1).or(left.first()).copied().unwrap_or(0.0).max(self.variance).max(f64::MIN_POSITIVE)
    }
}

enum Verdict {
    Fault(Found),
    /// Real motion, with a bend of this size.
    Motion(f64),
}

/// The cheapest motion: its cost, what it leaves over what is left beside it, and its bend.
fn motions(
    window: &Window,
    x: &[f64],
    before: usize,
    span: usize,
    cost: &dyn Fn(&Fitted, usize) -> f64,
) -> (f64, f64, f64) {
    let freedom = window.freedom() as f64;
    let mut best = (f64::INFINITY, 0.0, 0.0);
    let mut offer = |f: &Fitted, shapes: usize, bend: f64| {
        let c = cost(f, shapes);
        if c < best.0 {
            best = (c, (c - PRICE * shapes as f64) / freedom, bend.abs());
        }
    };
    offer(&fit(x, &[]), 0, 0.0);
    for half in 0..=2 * (span + 1) {
        let at = before as f64 - 1.0 + 0.5 * half as f64;
        let (bend, curvature) = (window.shape(Shape::Bend(at)), window.shape(Shape::Curvature(at)));
        offer(&fit(x, &[&curvature]), 1, 0.0);
        let f = fit(x, &[&bend]);
        offer(&f, 1, f.values[0]);
        let f = fit(x, &[&curvature, &bend]);
        offer(&f, 2, f.values[1]);
    }
    best
}

/// First samples of windows of n, spread.
fn places(trace: &Trace<'_>, n: usize) -> Vec<(usize, usize)> {
    let room: usize = trace.stretches.iter().map(|s| (s.len() + 1).saturating_sub(n)).sum();
    let count = CONTROLS.min(room / n.max(1) * 2);
    let (mut found, mut stretch, mut passed) = (Vec::with_capacity(count), 0, 0);
    for k in 0..count {
        let at = (k * room + room / 2) / count;
        while stretch < trace.stretches.len() {
            let here = (trace.stretches[stretch].len() + 1).saturating_sub(n);
            if at < passed + here {
                found.push((stretch, at - passed));
                break;
            }
            passed += here;
            stretch += 1;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::screen::screen;
    use super::super::trace::Samples;
    use super::*;

    fn motion(n: usize) -> Vec<i32> {
        (0..n).map(|i| (400.0 * (0.03 * i as f64).sin() + 150.0 * (0.11 * i as f64).cos()).floor() as i32).collect()
    }

    fn of(x: &[i32]) -> Vec<Found> {
        let trace = Trace::new(vec![Samples::Counts(x)]);
        Judge::new(&trace).unwrap().judge(&trace, &screen(&trace))
    }

    #[test]
    fn a_spike_a_slip_and_a_break_are_told_apart() {
        let mut x = motion(30_000);
        x[5000] += 17;
        x[9000..9003].iter_mut().for_each(|c| *c -= 300);
        x[20_000..].iter_mut().for_each(|c| *c += 12);
        let found = of(&x);
        let kinds: Vec<_> = found.iter().map(|f| (f.kind, f.from, f.to, f.size.round())).collect();
        assert_eq!(
            kinds,
            [(Kind::Spike, 5000, 5001, 17.0), (Kind::Spike, 9000, 9003, -300.0), (Kind::Slip, 20_000, 20_000, 12.0)],
            "{found:?}"
        );
        let mut x = motion(30_000);
        x.drain(15_000..15_123);
        let found = of(&x);
        assert!(found.len() == 1 && found[0].kind != Kind::Spike && found[0].from.abs_diff(15_000) < 2, "{found:?}");
    }

    #[test]
    fn impacts_and_dry_friction_are_motion() {
        // A ball that bounces, and a sledge whose friction changes its sign.
        let bounce: Vec<i32> =
            (0..30_000).map(|i| (800.0 * (0.01 * f64::from(i)).sin().abs()).floor() as i32).collect();
        assert_eq!(of(&bounce), []);
        let (mut v, mut q) = (0.0_f64, 0.0);
        let sledge: Vec<i32> = (0..30_000)
            .map(|i| {
                v += 0.3 * (0.02 * f64::from(i)).sin() - 0.1 * v.signum();
                q += v;
                q.floor() as i32
            })
            .collect();
        assert_eq!(of(&sledge), []);
    }

    #[test]
    fn short_records_are_left_alone() {
        assert!(Judge::new(&Trace::new(vec![Samples::Counts(&motion(50))])).is_none());
    }
}
