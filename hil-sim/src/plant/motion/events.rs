//! Events of one smooth stretch: functions that are positive inside it, rad or rad/s (of a joint
//! that sticks: the margin as a share of the level), and their earliest zeros within a step.
//!
//! A dip below zero within a step is sought on the cubic through the function's values and slopes
//! at both ends and checked on the true solution; a zero is found by bracketed secants whose every
//! trial is a full Runge–Kutta step.

use super::{ARMS, angles, arms, velocities};
use crate::integrator::{Integrator, Step};
use crate::plant::contact::{Dry, Mode, stick_margin};
use crate::plant::dynamics::{Forces, Mechanics};
use crate::plant::memory::MOST;
use crate::shaker::BaseMotion;

/// An event function counts as negative below this, rad or rad/s. Rounding at an event leaves less.
pub(super) const NEGATIVE: f64 = -1e-12;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Event {
    Dry(usize),
    Lower(usize),
    Upper(usize),
    Drag(usize),
    Reversal(usize),
    Corner(usize),
}

pub(super) const EVENTS: [Event; 12] = [
    Event::Dry(0),
    Event::Dry(1),
    Event::Lower(0),
    Event::Upper(0),
    Event::Lower(1),
    Event::Upper(1),
    Event::Drag(0),
    Event::Drag(1),
    Event::Reversal(0),
    Event::Reversal(1),
    Event::Corner(0),
    Event::Corner(1),
];

/// One smooth stretch of the motion: what the event functions and the derivative depend on.
pub(super) struct Stretch<'a> {
    pub(super) mechanics: &'a Mechanics,
    pub(super) mode: &'a Mode,
    pub(super) base: &'a BaseMotion,
}

impl Stretch<'_> {
    fn forces<const N: usize>(&self, t: f64, y: &[f64; N]) -> Forces {
        let (moment, state) = (self.mechanics.moment(self.base, t), arms(y));
        if N == ARMS {
            return self.mechanics.forces(moment, &state, self.mode);
        }
        self.mechanics.forces(moment, &state, &self.mode.remembering(&y[ARMS..]))
    }

    pub(super) fn rate<const N: usize>(&self, t: f64, y: &[f64; N]) -> [f64; N] {
        let forces = self.forces(t, y);
        let mut rate = [0.0; N];
        rate[..ARMS].copy_from_slice(&[y[2], y[3], forces.alpha[0], forces.alpha[1]]);
        let memories = y[ARMS..].chunks_exact(MOST).zip(rate[ARMS..].chunks_exact_mut(MOST));
        for (i, (states, rates)) in memories.enumerate() {
            let (v, sign) = (velocities(y)[i], self.mode.since[i].sign);
            for ((memory, z), rate) in self.mechanics.joints[i].memories.iter().zip(states).zip(rates) {
                *rate = memory.rate(*z, v, sign);
            }
        }
        rate
    }

    pub(super) fn active(&self, event: Event) -> bool {
        match event {
            Event::Dry(i) => self.mode.dry[i].is_some(),
            Event::Lower(i) | Event::Upper(i) => self.mechanics.joints[i].wraps(),
            Event::Drag(i) => self.mechanics.drag[i] != 0.0,
            Event::Reversal(i) => !self.mechanics.joints[i].memories.is_empty(),
            Event::Corner(i) => self.mode.since[i].corner.is_finite(),
        }
    }

    fn is_stick(&self, event: Event) -> bool {
        matches!(event, Event::Dry(i) if self.mode.dry[i] == Some(Dry::Stick))
    }

    /// The event function of a state: positive inside the stretch. Sticking: margin as a share of
    /// the level.
    pub(super) fn distance<const N: usize>(&self, event: Event, t: f64, y: &[f64; N]) -> f64 {
        match event {
            Event::Dry(i) => match self.mode.dry[i] {
                Some(Dry::Slip(sign)) => sign * velocities(y)[i],
                Some(Dry::Stick) => {
                    let forces = self.forces(t, y);
                    stick_margin(self.mechanics, i, &forces) / (forces.dry[i].abs() + f64::MIN_POSITIVE)
                }
                None => f64::INFINITY,
            },
            _ => self.linear(event, y),
        }
    }

    /// The event functions that are linear in the state, and, applied to the state's rate, their
    /// slopes.
    fn linear<const N: usize>(&self, event: Event, y: &[f64; N]) -> f64 {
        let x = |i: usize| angles(y)[i] - self.mode.turn[i];
        match event {
            Event::Lower(i) => x(i) - self.mode.stretch[i][0],
            Event::Upper(i) => self.mode.stretch[i][1] - x(i),
            Event::Drag(i) => self.mode.drag_sign[i] * y[2 + i],
            Event::Reversal(i) => self.mode.since[i].sign * velocities(y)[i],
            Event::Corner(i) => self.mode.since[i].left_to_corner(angles(y)[i]),
            Event::Dry(_) => self.distance(event, 0.0, y),
        }
    }

    fn slope<const N: usize>(&self, event: Event, rate: &[f64; N]) -> f64 {
        match event {
            Event::Lower(i) => angles(rate)[i],
            Event::Upper(i) => -angles(rate)[i],
            Event::Corner(i) => -self.mode.since[i].sign * angles(rate)[i],
            _ => self.linear(event, rate),
        }
    }

    /// The earliest zero of an event function within a step, as a time from the step's start.
    pub(super) fn event_in<const N: usize>(
        &self,
        event: Event,
        integrator: &Integrator<N>,
        t: f64,
        y: &[f64; N],
        step: &Step<N>,
    ) -> Option<f64> {
        let at = |h: f64| {
            let state = integrator.inside(|t, y| self.rate(t, y), t, y, &step.start_rate, h);
            self.distance(event, t + h, &state)
        };
        let (start, end) = (self.distance(event, t, y), self.distance(event, t + step.h, &step.end));
        if self.is_stick(event) {
            // The margin is no function of the velocity alone: look at it a few times in the step,
            // and closely where it is small. While both joints stick the state does not change, and
            // while one does it changes slowly.
            let mut low = (0.0, start);
            for share in [0.25, 0.5, 0.75] {
                let h = share * step.h;
                let rough = self.distance(event, t + h, &mix(y, &step.end, share));
                let value = if rough < 0.1 { at(h) } else { rough };
                if value < NEGATIVE {
                    return Some(root(at, low, (h, value)));
                }
                low = (h, value);
            }
            return (end < NEGATIVE).then(|| root(at, low, (step.h, end)));
        }
        let end_rate = self.rate(t + step.h, &step.end);
        let slopes = [self.slope(event, &step.start_rate) * step.h, self.slope(event, &end_rate) * step.h];
        let extremes = cubic_extremes(start, end, slopes);
        if end < NEGATIVE {
            // Just after an event the function starts at zero: bracket from its maximum, if it has
            // one.
            let low = extremes
                .iter()
                .flatten()
                .map(|&(share, _)| (share * step.h, at(share * step.h)))
                .find(|&(_, value)| value > 0.0)
                .filter(|_| start <= -NEGATIVE)
                .unwrap_or((0.0, start));
            return Some(root(at, low, (step.h, end)));
        }
        let doubt = 1e-2 * (slopes[0].abs() + slopes[1].abs());
        for &(share, value) in extremes.iter().flatten() {
            if value < doubt && value < start.min(end) {
                let h = share * step.h;
                let value = at(h);
                if value < NEGATIVE {
                    return Some(root(at, (0.0, start), (h, value)));
                }
            }
        }
        None
    }
}

/// The state a share of the way along a straight line.
fn mix<const N: usize>(from: &[f64; N], to: &[f64; N], share: f64) -> [f64; N] {
    core::array::from_fn(|i| from[i] + share * (to[i] - from[i]))
}

/// Extremes inside (0, 1) of the cubic through the values and slopes at 0 and 1: place and value.
fn cubic_extremes(start: f64, end: f64, slopes: [f64; 2]) -> [Option<(f64, f64)>; 2] {
    let (b, rise) = (slopes[0], end - start);
    let c = 3.0 * rise - 2.0 * slopes[0] - slopes[1];
    let d = slopes[0] + slopes[1] - 2.0 * rise;
    // b + 2 c s + 3 d s² = 0, in the form that survives d → 0.
    let discriminant = c * c - 3.0 * b * d;
    if discriminant < 0.0 {
        return [None, None];
    }
    let q = -(c + discriminant.sqrt().copysign(c));
    [b / q, q / (3.0 * d)].map(|s| (s > 0.0 && s < 1.0).then_some((s, start + s * (b + s * (c + s * d)))))
}

/// A zero between a place where f is not negative and one where it is: the place, on the negative
/// side.
fn root(f: impl Fn(f64) -> f64, low: (f64, f64), high: (f64, f64)) -> f64 {
    let (mut low, mut high) = (low, high);
    // Value at `high` as f gave it; `high.1` is halved by the rule below.
    let mut remaining = high.1;
    let mut last_side = 0;
    for i in 0..80 {
        let width = high.0 - low.0;
        if width <= 1e-17 || remaining > -1e-15 {
            break;
        }
        // Illinois' rule; every third trial halves, so that the bracket shrinks whatever f does.
        let secant = low.0 + width * low.1 / (low.1 - high.1);
        let middle = low.0 + 0.5 * width;
        let trial = if i % 3 == 2 || !(secant > low.0 && secant < high.0) { middle } else { secant };
        if trial <= low.0 || trial >= high.0 {
            break;
        }
        let value = f(trial);
        if value < 0.0 {
            high = (trial, value);
            remaining = value;
            if last_side == -1 {
                low.1 *= 0.5;
            }
            last_side = -1;
        } else {
            low = (trial, value);
            if last_side == 1 {
                high.1 *= 0.5;
            }
            last_side = 1;
        }
    }
    high.0
}
