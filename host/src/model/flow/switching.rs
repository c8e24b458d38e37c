//! Dry friction along a solution: when a sign turns, when a joint sticks and comes free, and what
//! that does to the derivatives.
//!
//! See the head of [`super`]. In sticking, with a linear in the sign, s* = −w·a(0)/(w·∂a/∂s) keeps
//! w·v zero, and partials lose what would move it: ∂a − ∂a/∂s (w·∂a)/(w·∂a/∂s).

use core::f64::consts::TAU;

use super::crossing::{crossing, turned_over};
use super::{Flow, Mode, Work};
use crate::model::dynamics::{Dynamics, Here, Switch};
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
        for (s, switch) in self.dynamics.switches().iter().enumerate() {
            let share = match work.modes[s] {
                Mode::Slides(sign) => {
                    let ends = [(time, &work.y), (time + h, &work.next)];
                    let slopes = [(time, &work.k[0]), (time + h, &work.k[6])];
                    let rate = |(t, y): (f64, &Vec<f64>)| sign * self.rate_of(switch, t, &y[n..2 * n]);
                    let slope = |(t, k): (f64, &Vec<f64>)| sign * h * self.acceleration_of(switch, t, &k[n..2 * n]);
                    crossing(ends.map(rate), slopes.map(slope))
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
        let seams = self.dynamics.seams().len();
        let turned: Vec<f64> = work.modes[signs..signs + seams].iter().map(|m| m.value()).collect();
        for (c, corner) in self.dynamics.corners().iter().enumerate() {
            let sign = work.modes[signs + seams + c].value();
            let rate = |y: &[f64]| -> f64 { corner.weights.iter().zip(y).map(|(w, v)| w * v).sum() };
            let ends = [sign * corner.value(&work.y[..n], &turned), sign * corner.value(&work.next[..n], &turned)];
            let slopes = [sign * h * rate(&work.y[n..2 * n]), sign * h * rate(&work.next[n..2 * n])];
            if let Some(share) = crossing(ends, slopes)
                && first.is_none_or(|f| share < f.0)
            {
                first = Some((share, signs + seams + c));
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
        let good = HeldSigns { flow: self, here }.solve(signs, s, accel);
        let found = signs[s];
        work.inputs = inputs;
        good.then_some(found)
    }

    /// Turns a switch at the state: to the other sign, into sticking, or out of it, with the jump
    /// of the derivatives.
    pub(super) fn turn(&self, work: &mut Work, time: f64, s: usize) -> bool {
        let (n, w) = (work.n, work.columns);
        if let Some(place) = s.checked_sub(self.dynamics.switches().len()) {
            return match place.checked_sub(self.dynamics.seams().len()) {
                Some(corner) => self.pass(work, time, s, corner),
                None => self.turn_over(work, time, s, place),
            };
        }
        let switch = &self.dynamics.switches()[s];
        let weights = &switch.weights;
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
        let before = self.acceleration_of(switch, time, &work.accel[0]);
        signs[s] = -sign;
        if !self.accelerate(work, time, &signs, 1) {
            return false;
        }
        let other = self.acceleration_of(switch, time, &work.accel[1]);
        // Beyond zero the rate must go on in the new direction; otherwise the joint sticks.
        if -sign * other > 0.0 || before == other {
            work.modes[s] = Mode::Slides(-sign);
        } else {
            work.modes[s] = Mode::Sticks;
            // a is linear in the sign: where the relative acceleration vanishes.
            let share = before / (before - other);
            for i in 0..n {
                work.accel[1][i] = work.accel[0][i] + share * (work.accel[1][i] - work.accel[0][i]);
            }
            self.stop(work, time, switch);
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
        let weights = &self.dynamics.seams()[seam];
        let before: Vec<f64> = work.modes.iter().map(|m| m.value()).collect();
        let form: f64 = weights.iter().zip(&work.y[..work.n]).map(|(w, x)| w * x).sum();
        let ahead = form - TAU * before[s];
        work.modes[s] = Mode::Turned(before[s] + if ahead > 0.0 { 1.0 } else { -1.0 });
        // What is measured from there begins anew.
        self.set_corners(work, Some(seam));
        self.jump(work, time, weights, before)
    }

    /// Passes a corner at the state, with the jump of the derivatives.
    fn pass(&self, work: &mut Work, time: f64, s: usize, corner: usize) -> bool {
        let before: Vec<f64> = work.modes.iter().map(|m| m.value()).collect();
        work.modes[s] = Mode::Slides(-before[s]);
        self.jump(work, time, &self.dynamics.corners()[corner].weights, before)
    }

    /// Signs of the corners (of those that count from one seam), as the state has them.
    fn set_corners(&self, work: &mut Work, seam: Option<usize>) {
        let n = work.n;
        let (signs, seams) = (self.dynamics.switches().len(), self.dynamics.seams().len());
        let turned: Vec<f64> = work.modes[signs..signs + seams].iter().map(|m| m.value()).collect();
        for (c, corner) in self.dynamics.corners().iter().enumerate() {
            if seam.is_none() || corner.turns.map(|t| t.0) == seam {
                let rate: f64 = corner.weights.iter().zip(&work.y[n..2 * n]).map(|(w, v)| w * v).sum();
                let at = corner.value(&work.y[..n], &turned);
                let ahead = if at == 0.0 { rate } else { at };
                work.modes[signs + seams + c] = Mode::Slides(if ahead < 0.0 { -1.0 } else { 1.0 });
            }
        }
    }

    /// The jump of the derivatives where a form of the coordinates passes a value, from what was held
    /// to what is held now.
    fn jump(&self, work: &mut Work, time: f64, weights: &[f64], before: Vec<f64>) -> bool {
        let (n, w) = (work.n, work.columns);
        let rate: f64 = weights.iter().zip(&work.y[n..2 * n]).map(|(w, x)| w * x).sum();
        if w == 0 || rate == 0.0 {
            return true;
        }
        let after: Vec<f64> = work.modes.iter().map(|m| m.value()).collect();
        for (slot, held) in [before, after].into_iter().enumerate() {
            if !self.accelerate(work, time, &held, slot) {
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
    pub(super) fn keep_stuck(&self, work: &mut Work, time: f64) {
        for (s, switch) in self.dynamics.switches().iter().enumerate() {
            if work.modes[s] == Mode::Sticks {
                self.stop(work, time, switch);
            }
        }
    }

    /// Takes the relative velocity out of the rates.
    fn stop(&self, work: &mut Work, time: f64, switch: &Switch) {
        let rates = work.n..2 * work.n;
        let rate = self.rate_of(switch, time, &work.y[rates.clone()]);
        let square: f64 = switch.weights.iter().map(|x| x * x).sum();
        for (v, w) in work.y[rates].iter_mut().zip(&switch.weights) {
            *v -= rate * w / square;
        }
    }

    /// A relative velocity at a time.
    fn rate_of(&self, switch: &Switch, time: f64, v: &[f64]) -> f64 {
        let mut inputs = Vec::new();
        self.inputs_of(switch, time, &mut inputs);
        switch.rate(v, &inputs)
    }

    /// The acceleration that belongs to it.
    fn acceleration_of(&self, switch: &Switch, time: f64, a: &[f64]) -> f64 {
        switch.acceleration(a, &self.input_rates(switch, time))
    }

    /// Measured inputs at a time, where a switch has any.
    fn inputs_of(&self, switch: &Switch, time: f64, inputs: &mut Vec<f64>) {
        if let Some(outside) = self.outside.inputs.filter(|_| !switch.inputs.is_empty()) {
            inputs.resize(outside.count, 0.0);
            (outside.at)(time, inputs);
        }
    }

    /// Their derivatives (1/s): differences over a step, of which a sample's noise is no more than
    /// what the rate itself shows of it.
    pub(super) fn input_rates(&self, switch: &Switch, time: f64) -> Vec<f64> {
        let (mut before, mut after) = (Vec::new(), Vec::new());
        self.inputs_of(switch, time - 0.5 * self.step, &mut before);
        self.inputs_of(switch, time + 0.5 * self.step, &mut after);
        after.iter().zip(&before).map(|(a, b)| (a - b) / self.step).collect()
    }

    /// Signs at the start of a trajectory.
    pub(super) fn initial_modes(&self, work: &mut Work, time: f64) {
        let n = work.n;
        let count = self.dynamics.switches().len();
        for (mode, weights) in work.modes[count..].iter_mut().zip(self.dynamics.seams()) {
            *mode = Mode::Turned(turns(weights.iter().zip(&work.y[..n]).map(|(w, x)| w * x).sum()));
        }
        self.set_corners(work, None);
        for s in 0..count {
            let switch = &self.dynamics.switches()[s];
            let rate = self.rate_of(switch, time, &work.y[n..2 * n]);
            if rate != 0.0 {
                work.modes[s] = Mode::Slides(rate.signum());
                continue;
            }
            let held = work.modes.iter().enumerate();
            let mut signs: Vec<f64> = held.map(|(k, m)| if k < count { 0.0 } else { m.value() }).collect();
            let mut pushed = [0.0; 2];
            for (sign, pushed) in [1.0, -1.0].into_iter().zip(&mut pushed) {
                signs[s] = sign;
                if self.accelerate(work, time, &signs, 0) {
                    *pushed = self.acceleration_of(switch, time, &work.accel[0]);
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
pub(super) struct HeldSigns<'a, D: Dynamics + ?Sized> {
    pub flow: &'a Flow<'a, D>,
    /// Where; its own signs are not looked at.
    pub here: Here<'a>,
}

impl<D: Dynamics + ?Sized> HeldSigns<'_, D> {
    fn acceleration(&self, signs: &[f64], out: &mut [f64]) -> bool {
        self.flow.dynamics.acceleration_held(Here { signs, ..self.here }, out)
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
        let gain = self.flow.dynamics.switches()[s].acceleration(zero, &[]);
        (good && gain != 0.0 && gain.is_finite()).then_some(gain)
    }

    /// Sets the sign of a sticking joint so that its relative acceleration is 0.
    pub fn solve(&self, signs: &mut [f64], s: usize, accel: &mut [Vec<f64>; 3]) -> bool {
        let Some(gain) = self.by_sign(signs, s, accel) else { return false };
        signs[s] = 0.0;
        if !self.acceleration(signs, &mut accel[2]) {
            return false;
        }
        let switch = &self.flow.dynamics.switches()[s];
        let free = self.flow.acceleration_of(switch, self.here.at.time, &accel[2]);
        signs[s] = -free / gain;
        true
    }

    /// Partials of a sticking joint's accelerations: the sign follows so that w·a stays zero.
    pub fn constrain(&self, partials: &mut [f64], signs: &mut [f64], s: usize, accel: &mut [Vec<f64>; 3]) -> bool {
        let weights = &self.flow.dynamics.switches()[s].weights;
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
