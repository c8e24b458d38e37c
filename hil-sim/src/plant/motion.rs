//! Integration over an interval, ended and restarted at every event.
//!
//! Between events the system is smooth and the eighth-order steps of [`crate::integrator`] apply.
//! Events are zeros of
//! * s v of a slipping joint with dry friction (then it sticks or reverses),
//! * the margin of the torque that holds a sticking joint (then it breaks loose),
//! * the distance of a joint's angle to a corner of its torque (play, or ±π where the torque is not
//!   periodic),
//! * s φ̇ of an arm with quadratic drag (the second derivative jumps),
//! * s v of a joint with a memory, whose curve ends there,
//! * the distance of such a joint's angle to a corner of its curve.
//!
//! States of a memory that depend on more than the angle are integrated beside the four of the arms
//! ([`WITH_MEMORY`] in all).
//!
//! A step is accepted whole if none of these became negative in it. Whether one dips below zero and
//! returns within the step is seen on the cubic through its values and slopes at both ends and then
//! checked on the true solution. A zero is found by bracketed secants whose every trial is a full
//! Runge–Kutta step from the step's start, so that the state at the event has the order of the
//! method.

mod events;

use core::f64::consts::TAU;

use self::events::{EVENTS, Event, NEGATIVE, Stretch};
use super::contact::{self, Dry};
use super::memory::{MOST, Memory};
use super::{Plant, State};
use crate::integrator::{IntegrationError, Integrator, Tolerance};
use crate::shaker::BaseMotion;

/// States of the arms.
const ARMS: usize = 4;
/// States of the arms and of all that the joints can remember.
const WITH_MEMORY: usize = ARMS + 2 * MOST;
/// Most events in one interval. A rattling joint has tens in a second.
const MAX_EVENTS: u32 = 1000;
/// Mean step below which the plant counts as too stiff, s. It bounds the work for a second of the
/// rig.
const SHORTEST_MEAN_STEP: f64 = 4e-6;

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

impl Plant {
    /// Moves the pendulum through `duration` seconds of the base's motion, which starts at the
    /// motion's own time 0.
    ///
    /// The result depends on the state alone, not on how the pendulum came there.
    ///
    /// # Errors
    /// A state that is no longer finite, a system too stiff, friction that chatters. The state is
    /// then as far as it came.
    pub fn advance(&mut self, base: &BaseMotion, duration: f64) -> Result<(), IntegrationError> {
        if self.mechanics.joints.iter().any(|joint| joint.memories.iter().any(Memory::flows)) {
            self.advance_all::<WITH_MEMORY>(base, duration)
        } else {
            self.advance_all::<ARMS>(base, duration)
        }
    }

    /// The first N states, those of the arms and then, where they are integrated, those of the
    /// joints' memories.
    fn states<const N: usize>(&self) -> [f64; N] {
        let memory = self.mode.since.iter().flat_map(|since| since.states);
        let mut all = self.state.into_iter().chain(memory);
        core::array::from_fn(|_| all.next().unwrap_or(0.0))
    }

    fn set_states<const N: usize>(&mut self, y: &[f64; N]) {
        self.state = arms(y);
        self.mode = self.mode.remembering(&y[ARMS..]);
    }

    /// Admissible errors of [`Self::states`]: angles may whirl, and their tolerance must not grow
    /// with the turns.
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

    /// Takes whole turns out of angles beyond ±2π, lest their resolution fall below that of the
    /// events.
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

    /// Events that are due before a step, after the base's motion has changed at once. Returns how
    /// many there were.
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
