//! Integration over an interval, ended and restarted at every event.
//!
//! Between events the system is smooth and the eighth-order steps of [`crate::integrator`] apply. Events are zeros of
//! * s v of a slipping joint with dry friction (then it sticks or reverses),
//! * the margin of the torque that holds a sticking joint (then it breaks loose),
//! * the distance of a joint's angle to a corner of its torque (play, or ±π where the torque is not periodic),
//! * s φ̇ of an arm with quadratic drag (the second derivative jumps),
//! * s v of a joint with a memory, whose curve ends there,
//! * the distance of such a joint's angle to a corner of its curve.
//!
//! States of a memory that depend on more than the angle are integrated beside the four of the arms ([`WITH_MEMORY`] in all).
//!
//! A step is accepted whole if none of these became negative in it. Whether one dips below zero and returns within the step
//! is seen on the cubic through its values and slopes at both ends and then checked on the true solution. A zero is
//! found by bracketed secants whose every trial is a full Runge–Kutta step from the step's start, so that the state at
//! the event has the order of the method.

use core::f64::consts::TAU;

use super::contact::{self, Dry, Mode, stick_margin};
use super::dynamics::{Forces, Mechanics};
use super::memory::{MOST, Memory};
use super::{Plant, State};
use crate::integrator::{IntegrationError, Integrator, Step, Tolerance};
use crate::shaker::BaseMotion;

/// States of the arms.
const ARMS: usize = 4;
/// States of the arms and of all that the joints can remember.
const WITH_MEMORY: usize = ARMS + 2 * MOST;
/// Most events in one interval. A rattling joint has tens in a second.
const MAX_EVENTS: u32 = 1000;
/// Mean step below which the plant counts as too stiff, s. It bounds the work for a second of the rig.
const SHORTEST_MEAN_STEP: f64 = 4e-6;
/// An event function counts as negative below this, rad or rad/s. Rounding at an event leaves less.
const NEGATIVE: f64 = -1e-12;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Event {
    Dry(usize),
    Lower(usize),
    Upper(usize),
    Drag(usize),
    Reversal(usize),
    Corner(usize),
}

const EVENTS: [Event; 12] = [
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
struct Stretch<'a> {
    mechanics: &'a Mechanics,
    mode: &'a Mode,
    base: &'a BaseMotion,
}

impl Stretch<'_> {
    fn forces<const N: usize>(&self, t: f64, y: &[f64; N]) -> Forces {
        let (moment, state) = (self.mechanics.moment(self.base, t), arms(y));
        if N == ARMS {
            return self.mechanics.forces(moment, &state, self.mode);
        }
        self.mechanics.forces(moment, &state, &self.mode.remembering(&y[ARMS..]))
    }

    fn rate<const N: usize>(&self, t: f64, y: &[f64; N]) -> [f64; N] {
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

    fn active(&self, event: Event) -> bool {
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

    /// The event function of a state: positive inside the stretch. Sticking: margin as a share of the level.
    fn distance<const N: usize>(&self, event: Event, t: f64, y: &[f64; N]) -> f64 {
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

    /// The event functions that are linear in the state, and, applied to the state's rate, their slopes.
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
    fn event_in<const N: usize>(
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
            // The margin is no function of the velocity alone: look at it a few times in the step, and closely where it is
            // small. While both joints stick the state does not change, and while one does it changes slowly.
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
            // Just after an event the function starts at zero: bracket from its maximum, if it has one.
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

/// The arms' part of a state.
fn arms<const N: usize>(y: &[f64; N]) -> State {
    [y[0], y[1], y[2], y[3]]
}

fn angles<const N: usize>(y: &[f64; N]) -> [f64; 2] {
    contact::angles(&arms(y))
}

fn velocities<const N: usize>(y: &[f64; N]) -> [f64; 2] {
    contact::velocities(&arms(y))
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

/// A zero between a place where f is not negative and one where it is: the place, on the negative side.
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

impl Plant {
    /// Moves the pendulum through `duration` seconds of the base's motion, which starts at the motion's own time 0.
    ///
    /// The result depends on the state alone, not on how the pendulum came there.
    ///
    /// # Errors
    /// A state that is no longer finite, a system too stiff, friction that chatters. The state is then as far as it came.
    pub fn advance(&mut self, base: &BaseMotion, duration: f64) -> Result<(), IntegrationError> {
        if self.mechanics.joints.iter().any(|joint| joint.memories.iter().any(Memory::flows)) {
            self.advance_all::<WITH_MEMORY>(base, duration)
        } else {
            self.advance_all::<ARMS>(base, duration)
        }
    }

    /// The first N states, those of the arms and then, where they are integrated, those of the joints' memories.
    fn states<const N: usize>(&self) -> [f64; N] {
        let memory = self.mode.since.iter().flat_map(|since| since.states);
        let mut all = self.state.into_iter().chain(memory);
        core::array::from_fn(|_| all.next().unwrap_or(0.0))
    }

    fn set_states<const N: usize>(&mut self, y: &[f64; N]) {
        self.state = arms(y);
        self.mode = self.mode.remembering(&y[ARMS..]);
    }

    /// Admissible errors of [`Self::states`]: angles may whirl, and their tolerance must not grow with the turns.
    fn tolerances<const N: usize>(&self) -> Tolerance<N> {
        let mut tolerance = Tolerance { absolute: [self.tolerance; N], relative: [self.tolerance; N] };
        tolerance.relative[..2].fill(0.0);
        for (joint, absolute) in self.mechanics.joints.iter().zip(tolerance.absolute[ARMS..].chunks_exact_mut(MOST)) {
            for (memory, absolute) in joint.memories.iter().zip(absolute) {
                *absolute *= memory.scale();
            }
        }
        tolerance
    }

    fn advance_all<const N: usize>(&mut self, base: &BaseMotion, duration: f64) -> Result<(), IntegrationError> {
        // A new one, so that what follows depends on the state alone.
        let mut integrator = Integrator::new(self.tolerances::<N>());
        // A free pendulum decays without end; below this arithmetic gets slow, and nothing is lost.
        let states = self.states::<N>();
        self.set_states(&states.map(|value| if value.abs() < 1e-200 { 0.0 } else { value }));
        let mut t = 0.0;
        let mut events = 0;
        // `as` saturates, so that an absurd duration ends all the same.
        let most_steps = 200 + (duration / SHORTEST_MEAN_STEP) as u64;
        for _ in 0..most_steps {
            let left = duration - t;
            if left <= 0.0 {
                return Ok(());
            }
            self.take_turns();
            events += self.overdue(base, t)?;
            let stretch = Stretch { mechanics: &self.mechanics, mode: &self.mode, base };
            let y = self.states::<N>();
            let step = integrator.step(|t, y| stretch.rate(t, y), t, &y, left)?;
            let first = EVENTS
                .into_iter()
                .filter(|&event| stretch.active(event))
                .filter_map(|event| Some((stretch.event_in(event, &integrator, t, &y, &step)?, event)))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            match first {
                None => {
                    self.set_states(&step.end);
                    t = if step.h >= left { duration } else { t + step.h };
                }
                Some((h, event)) => {
                    let end = integrator.inside(|t, y| stretch.rate(t, y), t, &y, &step.start_rate, h);
                    self.set_states(&end);
                    t += h;
                    self.pass(event, base, t);
                    events += 1;
                }
            }
            if events > MAX_EVENTS {
                return Err(IntegrationError::Chatter { events });
            }
        }
        Err(IntegrationError::TooStiff { seconds: t })
    }

    /// Takes whole turns out of angles beyond ±2π, lest their resolution fall below that of the events.
    fn take_turns(&mut self) {
        let mut taken = [0_i64; 2];
        for i in 0..2 {
            if self.state[i].abs() > TAU {
                // Beyond 2⁶³ turns the cast saturates; an angle of that size has no digits left.
                taken[i] = libm::round(self.state[i] / TAU) as i64;
                self.state[i] -= taken[i] as f64 * TAU;
                self.turns[i] = self.turns[i].saturating_add(taken[i]);
            }
        }
        self.mode.take_turns(&self.mechanics, 0, taken[0]);
        self.mode.take_turns(&self.mechanics, 1, taken[1].saturating_sub(taken[0]));
    }

    /// Events that are due before a step, after the base's motion has changed at once. Returns how many there were.
    fn overdue(&mut self, base: &BaseMotion, t: f64) -> Result<u32, IntegrationError> {
        for count in 0..MAX_EVENTS {
            let stretch = Stretch { mechanics: &self.mechanics, mode: &self.mode, base };
            let due = EVENTS
                .into_iter()
                .find(|&event| stretch.active(event) && stretch.distance(event, t, &self.state) < NEGATIVE);
            match due {
                None => return Ok(count),
                Some(event) => self.pass(event, base, t),
            }
        }
        Err(IntegrationError::Chatter { events: MAX_EVENTS })
    }

    /// Changes the mode at an event.
    fn pass(&mut self, event: Event, base: &BaseMotion, t: f64) {
        match event {
            Event::Dry(i) => {
                let mut released = None;
                if self.mode.dry[i] == Some(Dry::Stick) {
                    released = Some(i);
                } else if i == 0 {
                    self.state[2] = 0.0;
                } else {
                    self.state[3] = self.state[2];
                }
                if self.mode.dry[1] == Some(Dry::Stick) {
                    // Both arms were moving as one; keep their velocities equal to the last digit.
                    self.state[3] = self.state[2];
                }
                let moment = self.mechanics.moment(base, t);
                contact::settle(&self.mechanics, moment, &self.state, &mut self.mode, released);
            }
            Event::Lower(i) => self.mode.next_stretch(&self.mechanics, i, false),
            Event::Upper(i) => self.mode.next_stretch(&self.mechanics, i, true),
            Event::Drag(i) => self.mode.drag_sign[i] = -self.mode.drag_sign[i],
            Event::Reversal(i) => self.start_curves(i, -self.mode.since[i].sign),
            Event::Corner(i) => self.start_curves(i, self.mode.since[i].sign),
        }
    }

    /// Lets what a joint remembers follow new curves from here on.
    fn start_curves(&mut self, joint: usize, sign: f64) {
        let angle = angles(&self.state)[joint];
        let since = &mut self.mode.since[joint];
        *since = since.restarted(&self.mechanics.joints[joint].memories, angle, sign);
    }

    /// Lets joints that rest decide whether they stick.
    pub(super) fn settle_contacts(&mut self, base: &BaseMotion) {
        contact::settle(&self.mechanics, self.mechanics.moment(base, 0.0), &self.state, &mut self.mode, None);
    }
}
