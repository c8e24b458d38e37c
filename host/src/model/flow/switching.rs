//! Dry friction along a solution: when a sign turns, when a joint sticks and comes free, and what
//! that does to the derivatives.
//!
//! See the head of [`super`]. In sticking, with a linear in the sign, s* = −w·a(0)/(w·∂a/∂s) keeps
//! w·v zero, and partials lose what would move it: ∂a − ∂a/∂s (w·∂a)/(w·∂a/∂s).

use core::f64::consts::{PI, TAU};

use super::{Flow, Mode, Work};
use crate::model::dynamics::{Dynamics, Here};
use crate::model::model_file::equations_of_motion::turns;

impl<D: Dynamics + ?Sized> Flow<'_, D> {
    /// Accelerations at the state with given signs, into `accel[slot]`.
    fn accelerate(&self, work: &mut Work, time: f64, signs: &[f64], slot: usize) -> bool {
        let n = work.n;
        let mut inputs = core::mem::take(&mut work.inputs);
        let instant = self.instant(time, &mut inputs);
        let (q, v) = work.y[..2 * n].split_at(n);
        let good = self
            .dynamics
            .acceleration_held(Here { parameters: self.parameters, q, v, at: &instant, signs }, &mut work.accel[slot]);
        work.inputs = inputs;
        good
    }

    /// The first instant within the step just attempted at which a sign turns: share of the step,
    /// switch.
    pub(super) fn event(&self, work: &mut Work, time: f64, h: f64) -> Option<(f64, usize)> {
        let n = work.n;
        let mut first: Option<(f64, usize)> = None;
        for (s, weights) in self.dynamics.switches().iter().enumerate() {
            let form = |x: &[f64]| -> f64 { weights.iter().zip(x).map(|(w, x)| w * x).sum() };
            let share = match work.modes[s] {
                Mode::Slides(sign) => {
                    let ends = [sign * form(&work.y[n..2 * n]), sign * form(&work.next[n..2 * n])];
                    let slopes = [sign * h * form(&work.k[0][n..2 * n]), sign * h * form(&work.k[6][n..2 * n])];
                    crossing(ends, slopes)
                }
                Mode::Turned(_) => None,
                Mode::Sticks => {
                    let before = self.sign_at(work, time, s, false);
                    let after = self.sign_at(work, time + h, s, true);
                    match (before, after) {
                        (Some(a), Some(b)) if b.abs() > 1.0 => {
                            let edge = b.signum();
                            Some(((edge - a) / (b - a)).clamp(0.0, 1.0))
                        }
                        (_, None) => Some(1.0),
                        _ => None,
                    }
                }
            };
            if let Some(share) = share
                && first.is_none_or(|f| share < f.0)
            {
                first = Some((share, s));
            }
        }
        let signs = self.dynamics.switches().len();
        for (s, weights) in self.dynamics.seams().iter().enumerate() {
            let form = |x: &[f64]| -> f64 { weights.iter().zip(x).map(|(w, x)| w * x).sum() };
            let ends = [form(&work.y[..n]), form(&work.next[..n])];
            let rates = [form(&work.y[n..2 * n]), form(&work.next[n..2 * n])];
            let share = turned_over(work.modes[signs + s].value(), ends, rates.map(|v| h * v));
            if let Some(share) = share
                && first.is_none_or(|f| share < f.0)
            {
                first = Some((share, signs + s));
            }
        }
        first
    }

    /// The sign that keeps a sticking joint at rest, at the state or at the attempted one.
    fn sign_at(&self, work: &mut Work, time: f64, s: usize, attempted: bool) -> Option<f64> {
        let n = work.n;
        let mut inputs = core::mem::take(&mut work.inputs);
        let instant = self.instant(time, &mut inputs);
        let Work { y, next, signs, accel, .. } = work;
        let (q, v) = (if attempted { &next[..2 * n] } else { &y[..2 * n] }).split_at(n);
        let here = Here { parameters: self.parameters, q, v, at: &instant, signs: &[] };
        let held = HeldSigns { dynamics: self.dynamics, here };
        let good = held.solve(signs, s, accel);
        let found = signs[s];
        work.inputs = inputs;
        good.then_some(found)
    }

    /// Turns a switch at the state: to the other sign, into sticking, or out of it, with the jump
    /// of the derivatives.
    pub(super) fn turn(&self, work: &mut Work, time: f64, s: usize) -> bool {
        let (n, w) = (work.n, work.columns);
        if let Some(seam) = s.checked_sub(self.dynamics.switches().len()) {
            return self.turn_over(work, time, s, seam);
        }
        let weights = &self.dynamics.switches()[s];
        let form = |x: &[f64]| -> f64 { weights.iter().zip(x).map(|(w, x)| w * x).sum() };
        let mut signs: Vec<f64> = work.modes.iter().map(|m| m.value()).collect();
        let Mode::Slides(sign) = work.modes[s] else {
            // Out of sticking: the sign is ±1 there, so that nothing jumps.
            work.modes[s] = match self.sign_at(work, time, s, false) {
                Some(x) => Mode::Slides(if x < 0.0 { -1.0 } else { 1.0 }),
                None => Mode::Slides(1.0),
            };
            return true;
        };
        if !self.accelerate(work, time, &signs, 0) {
            return false;
        }
        let before = form(&work.accel[0]);
        signs[s] = -sign;
        if !self.accelerate(work, time, &signs, 1) {
            return false;
        }
        let other = form(&work.accel[1]);
        // Beyond zero the rate must go on in the new direction; otherwise the joint sticks.
        if -sign * other > 0.0 || before == other {
            work.modes[s] = Mode::Slides(-sign);
        } else {
            work.modes[s] = Mode::Sticks;
            // a is linear in the sign: where w·a vanishes.
            let share = before / (before - other);
            for i in 0..n {
                work.accel[1][i] = work.accel[0][i] + share * (work.accel[1][i] - work.accel[0][i]);
            }
            let rate = form(&work.y[n..2 * n]);
            let square: f64 = weights.iter().map(|x| x * x).sum();
            for (v, x) in work.y[n..2 * n].iter_mut().zip(weights) {
                *v -= rate * x / square;
            }
        }
        if w > 0 && before != 0.0 {
            let rows = &mut work.y[2 * n + n * w..];
            for c in 0..w {
                let change = weights.iter().enumerate().map(|(i, x)| x * rows[i * w + c]).sum::<f64>() / before;
                for i in 0..n {
                    rows[i * w + c] += (work.accel[1][i] - work.accel[0][i]) * change;
                }
            }
        }
        true
    }

    /// Counts a turn of a seam at the state, with the jump of the derivatives.
    fn turn_over(&self, work: &mut Work, time: f64, s: usize, seam: usize) -> bool {
        let (n, w) = (work.n, work.columns);
        let weights = &self.dynamics.seams()[seam];
        let form = |x: &[f64]| -> f64 { weights.iter().zip(x).map(|(w, x)| w * x).sum() };
        let before = work.modes[s].value();
        let ahead = form(&work.y[..n]) - TAU * before;
        let after = before + if ahead > 0.0 { 1.0 } else { -1.0 };
        work.modes[s] = Mode::Turned(after);
        let rate = form(&work.y[n..2 * n]);
        if w == 0 || rate == 0.0 {
            return true;
        }
        let mut signs: Vec<f64> = work.modes.iter().map(|m| m.value()).collect();
        for (slot, turns) in [before, after].into_iter().enumerate() {
            signs[s] = turns;
            if !self.accelerate(work, time, &signs, slot) {
                return false;
            }
        }
        let (by_q, by_v) = work.y[2 * n..].split_at_mut(n * w);
        for c in 0..w {
            let change = weights.iter().enumerate().map(|(i, x)| x * by_q[i * w + c]).sum::<f64>() / rate;
            for i in 0..n {
                by_v[i * w + c] += (work.accel[1][i] - work.accel[0][i]) * change;
            }
        }
        true
    }

    /// Takes what rounding has left of a sticking joint's rate.
    pub(super) fn keep_stuck(&self, work: &mut Work) {
        let n = work.n;
        for (mode, weights) in work.modes.iter().zip(self.dynamics.switches()) {
            if *mode == Mode::Sticks {
                let rate: f64 = weights.iter().zip(&work.y[n..2 * n]).map(|(w, x)| w * x).sum();
                let square: f64 = weights.iter().map(|x| x * x).sum();
                for (v, w) in work.y[n..2 * n].iter_mut().zip(weights) {
                    *v -= rate * w / square;
                }
            }
        }
    }

    /// Signs at the start of a trajectory.
    pub(super) fn initial_modes(&self, work: &mut Work, time: f64) {
        let n = work.n;
        let count = self.dynamics.switches().len();
        for (mode, weights) in work.modes[count..].iter_mut().zip(self.dynamics.seams()) {
            *mode = Mode::Turned(turns(weights.iter().zip(&work.y[..n]).map(|(w, x)| w * x).sum()));
        }
        for s in 0..count {
            let form = |x: &[f64]| -> f64 { self.dynamics.switches()[s].iter().zip(x).map(|(w, x)| w * x).sum() };
            let rate = form(&work.y[n..2 * n]);
            if rate != 0.0 {
                work.modes[s] = Mode::Slides(rate.signum());
                continue;
            }
            let mut signs: Vec<f64> =
                work.modes.iter().map(|m| if let Mode::Turned(x) = m { *x } else { 0.0 }).collect();
            let mut pushed = [0.0; 2];
            for (sign, pushed) in [1.0, -1.0].into_iter().zip(&mut pushed) {
                signs[s] = sign;
                if self.accelerate(work, time, &signs, 0) {
                    *pushed = form(&work.accel[0]);
                }
            }
            work.modes[s] = if pushed[0] > 0.0 {
                Mode::Slides(1.0)
            } else if pushed[1] < 0.0 {
                Mode::Slides(-1.0)
            } else if pushed == [0.0; 2] {
                Mode::Slides(1.0)
            } else {
                Mode::Sticks
            };
        }
    }
}

/// A system at a state whose signs are tried.
pub(super) struct HeldSigns<'a, D: ?Sized> {
    pub dynamics: &'a D,
    /// Where; its own signs are not looked at.
    pub here: Here<'a>,
}

impl<D: Dynamics + ?Sized> HeldSigns<'_, D> {
    fn acceleration(&self, signs: &[f64], out: &mut [f64]) -> bool {
        self.dynamics.acceleration_held(Here { signs, ..self.here }, out)
    }

    /// ∂a/∂sign of a switch into `accel[0]`; w·∂a/∂sign, or None where the sign does not move it.
    fn by_sign(&self, signs: &mut [f64], s: usize, accel: &mut [Vec<f64>; 3]) -> Option<f64> {
        let kept = signs[s];
        let [zero, one, _] = accel;
        signs[s] = 0.0;
        let mut good = self.acceleration(signs, zero);
        signs[s] = 1.0;
        good &= self.acceleration(signs, one);
        signs[s] = kept;
        zero.iter_mut().zip(one.iter()).for_each(|(z, o)| *z = o - *z);
        let gain: f64 = self.dynamics.switches()[s].iter().zip(zero.iter()).map(|(w, a)| w * a).sum();
        (good && gain != 0.0 && gain.is_finite()).then_some(gain)
    }

    /// Sets the sign of a sticking joint so that w·a = 0.
    pub fn solve(&self, signs: &mut [f64], s: usize, accel: &mut [Vec<f64>; 3]) -> bool {
        let Some(gain) = self.by_sign(signs, s, accel) else { return false };
        signs[s] = 0.0;
        if !self.acceleration(signs, &mut accel[2]) {
            return false;
        }
        let free: f64 = self.dynamics.switches()[s].iter().zip(&accel[2]).map(|(w, a)| w * a).sum();
        signs[s] = -free / gain;
        true
    }

    /// Partials of a sticking joint's accelerations: the sign follows so that w·a stays zero.
    pub fn constrain(&self, partials: &mut [f64], signs: &mut [f64], s: usize, accel: &mut [Vec<f64>; 3]) -> bool {
        let weights = &self.dynamics.switches()[s];
        let Some(gain) = self.by_sign(signs, s, accel) else { return false };
        let width = partials.len() / self.here.q.len().max(1);
        let [by, ..] = accel;
        for c in 0..width {
            let change: f64 = weights.iter().enumerate().map(|(i, w)| w * partials[i * width + c]).sum::<f64>() / gain;
            for (i, b) in by.iter().enumerate() {
                partials[i * width + c] -= b * change;
            }
        }
        true
    }
}

/// Where a form leaves the turn that it is in, from its values and slopes (times the step) at both
/// ends of [0, 1].
pub(super) fn turned_over(turns: f64, ends: [f64; 2], slopes: [f64; 2]) -> Option<f64> {
    let up = crossing(ends.map(|x| TAU * turns + PI - x), slopes.map(|v| -v));
    let down = crossing(ends.map(|x| x - (TAU * turns - PI)), slopes);
    match (up, down) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}

/// Where the cubic through values and slopes (times the step) at both ends of [0, 1] first passes
/// from above to below zero.
pub(super) fn crossing(ends: [f64; 2], slopes: [f64; 2]) -> Option<f64> {
    let value = |u: f64| {
        let (u2, u3) = (u * u, u * u * u);
        ends[0] * (1.0 - 3.0 * u2 + 2.0 * u3)
            + slopes[0] * (u - 2.0 * u2 + u3)
            + ends[1] * (3.0 * u2 - 2.0 * u3)
            + slopes[1] * (u3 - u2)
    };
    let (mut low, mut high) = (0.0, 1.0);
    if ends[1] >= 0.0 {
        // Down and up again within the step: look at the lowest point.
        if !(ends[0] > 0.0 && slopes[0] < 0.0 && slopes[1] > 0.0) {
            return None;
        }
        // A cubic stays within its control points.
        if ends[0] + slopes[0] / 3.0 > 0.0 && ends[1] - slopes[1] / 3.0 > 0.0 {
            return None;
        }
        let (mut a, mut b) = (0.0, 1.0);
        for _ in 0..40 {
            let (c, d) = (a + (b - a) / 3.0, b - (b - a) / 3.0);
            if value(c) < value(d) { b = d } else { a = c }
        }
        high = 0.5 * (a + b);
        // A dip of the size of rounding is none: a joint that comes free starts at such a rate.
        let size = ends[1].abs().max(slopes[0].abs()).max(slopes[1].abs());
        if value(high) >= -1e-12 * size {
            return None;
        }
    }
    // A rate that starts at zero (a turn just before) and falls below it turns at once.
    if ends[0] <= 0.0 && slopes[0] <= 0.0 {
        return Some(0.0);
    }
    if ends[0] <= 0.0 {
        // It rises first: the crossing lies after the highest point.
        let (mut a, mut b) = (0.0, high);
        for _ in 0..40 {
            let (c, d) = (a + (b - a) / 3.0, b - (b - a) / 3.0);
            if value(c) > value(d) { b = d } else { a = c }
        }
        low = 0.5 * (a + b);
        if value(low) <= 0.0 {
            return Some(low);
        }
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if value(middle) > 0.0 { low = middle } else { high = middle }
    }
    Some(high)
}
