//! The discrete state of the plant: which joints stick, which way others slip, and on which smooth
//! stretch of its torque each joint is.
//!
//! Coulomb's law is set-valued at v = 0: the friction torque is whatever holds the joint, up to the
//! level. It is kept as such, without a smoothed sign: a joint whose v is exactly zero sticks if
//! the torque that holds it is within the level (for its direction), otherwise it slips in the
//! direction in which it then accelerates. With constant levels the choice exists and is unique,
//! also for both joints together (the accelerations minimise a strictly convex function).

use core::f64::consts::{PI, TAU};

use super::State;
use super::dynamics::{Forces, Mechanics};
use super::memory::{MOST, Since};
use crate::shaker::Moment;

/// State of the dry friction in a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Dry {
    /// The joint does not move.
    Stick,
    /// It moves in this direction (+1 or −1).
    Slip(f64),
}

/// What is constant between events.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mode {
    /// Dry friction of each joint, `None` where the joint has none.
    pub(super) dry: [Option<Dry>; 2],
    /// Direction of motion of each arm, for its drag.
    pub(super) drag_sign: [f64; 2],
    /// Whole turns in each joint's angle, rad: x = angle − turn.
    pub(super) turn: [f64; 2],
    /// Ends of the smooth stretch that x is in, rad.
    pub(super) stretch: [[f64; 2]; 2],
    /// Its middle.
    pub(super) middle: [f64; 2],
    /// What each joint remembers.
    pub(super) since: [Since; 2],
    turns: [i64; 2],
    index: [usize; 2],
}

/// Relative velocities of the joints.
pub(super) fn velocities(y: &State) -> [f64; 2] {
    [y[2], y[3] - y[2]]
}

/// Angles of the joints.
pub(super) fn angles(y: &State) -> [f64; 2] {
    [y[0], y[1] - y[0]]
}

fn sign(v: f64) -> f64 {
    if v < 0.0 { -1.0 } else { 1.0 }
}

impl Mode {
    /// The mode that a state has. Joints at rest are left slipping; [`settle`] decides about them.
    pub(super) fn at(mechanics: &Mechanics, y: &State) -> Self {
        let v = velocities(y);
        let mut mode = Self {
            dry: [0, 1].map(|i| mechanics.joints[i].is_dry().then(|| Dry::Slip(sign(v[i])))),
            drag_sign: [sign(y[2]), sign(y[3])],
            turn: [0.0; 2],
            stretch: [[-PI, PI]; 2],
            middle: [0.0; 2],
            since: [0, 1].map(|i| Since::start(&mechanics.joints[i].memories, angles(y)[i], sign(v[i]))),
            turns: [0; 2],
            index: [0; 2],
        };
        let angles = angles(y);
        for i in 0..2 {
            let turns = libm::floor((angles[i] + PI) / TAU);
            let x = angles[i] - turns * TAU;
            let index = mechanics.corners[i].iter().filter(|&&c| c <= x).count();
            // Angles beyond 2⁶³ turns saturate; their sine is noise long before.
            mode.place(mechanics, i, turns as i64, index);
        }
        mode
    }

    /// The mode with other states of what the joints remember, one joint's after the other's.
    pub(super) fn remembering(&self, states: &[f64]) -> Self {
        let mut mode = *self;
        for (since, states) in mode.since.iter_mut().zip(states.chunks_exact(MOST)) {
            since.states.copy_from_slice(states);
        }
        mode
    }

    fn place(&mut self, mechanics: &Mechanics, joint: usize, turns: i64, index: usize) {
        let corners = &mechanics.corners[joint];
        let low = if index == 0 { -PI } else { corners.get(index - 1).copied().unwrap_or(PI) };
        let high = corners.get(index).copied().unwrap_or(PI);
        self.turns[joint] = turns;
        self.index[joint] = index;
        self.turn[joint] = turns as f64 * TAU;
        self.stretch[joint] = [low, high];
        self.middle[joint] = 0.5 * (low + high);
    }

    /// Takes whole turns out of a joint's angle.
    pub(super) fn take_turns(&mut self, mechanics: &Mechanics, joint: usize, turns: i64) {
        if turns != 0 {
            self.since[joint].angle -= turns as f64 * TAU;
            self.place(mechanics, joint, self.turns[joint].saturating_sub(turns), self.index[joint]);
        }
    }

    /// Moves a joint to the next smooth stretch.
    pub(super) fn next_stretch(&mut self, mechanics: &Mechanics, joint: usize, up: bool) {
        let last = mechanics.corners[joint].len();
        let (turns, index) = (self.turns[joint], self.index[joint]);
        let (turns, index) = match (up, index) {
            (true, i) if i >= last => (turns.saturating_add(1), 0),
            (true, i) => (turns, i + 1),
            (false, 0) => (turns.saturating_sub(1), last),
            (false, i) => (turns, i - 1),
        };
        self.place(mechanics, joint, turns, index);
    }
}

/// Decides which of the joints at rest stick. `released` is a joint that has just broken loose and
/// must not stick again at this instant.
pub(super) fn settle(mechanics: &Mechanics, base: Moment, y: &State, mode: &mut Mode, released: Option<usize>) {
    const OPTIONS: [Dry; 3] = [Dry::Stick, Dry::Slip(1.0), Dry::Slip(-1.0)];
    let v = velocities(y);
    let open = [0, 1].map(|i| mode.dry[i].is_some() && v[i] == 0.0);
    if !(open[0] || open[1]) {
        return;
    }
    let mut best: Option<(f64, [Option<Dry>; 2])> = None;
    for first in OPTIONS {
        for second in OPTIONS {
            let mut candidate = *mode;
            for (i, option) in [(0, first), (1, second)] {
                if open[i] {
                    candidate.dry[i] = Some(option);
                }
            }
            let sticks = |i: usize| open[i] && candidate.dry[i] == Some(Dry::Stick);
            if released.is_some_and(sticks) {
                continue;
            }
            let forces = mechanics.forces(base, y, &candidate);
            let violation: f64 =
                (0..2).filter(|&i| open[i]).map(|i| violation(mechanics, i, &candidate, &forces)).sum();
            if best.is_none_or(|(least, _)| violation < least) {
                best = Some((violation, candidate.dry));
            }
        }
    }
    if let Some((_, dry)) = best {
        mode.dry = dry;
    }
}

/// By how much a joint at rest contradicts its assumed state, as a share of the friction level, or
/// of it and the joint's own acceleration.
fn violation(mechanics: &Mechanics, joint: usize, mode: &Mode, forces: &Forces) -> f64 {
    match mode.dry[joint] {
        Some(Dry::Stick) => {
            let margin = stick_margin(mechanics, joint, forces);
            let would_move = -sign(forces.dry[joint]);
            let level = mechanics.joints[joint].dry_level(
                would_move,
                0.0,
                forces.load[joint],
                forces.share,
                forces.ripple[joint],
            );
            if margin >= 0.0 { 0.0 } else { -margin / (level + f64::MIN_POSITIVE) }
        }
        Some(Dry::Slip(direction)) => {
            let relative = if joint == 0 { forces.alpha[0] } else { forces.alpha[1] - forces.alpha[0] };
            (-direction * relative).max(0.0)
        }
        None => 0.0,
    }
}

/// How much more torque a sticking joint could hold, N m (negative: it cannot hold).
pub(super) fn stick_margin(mechanics: &Mechanics, joint: usize, forces: &Forces) -> f64 {
    let torque = forces.dry[joint];
    // Friction against motion in the positive direction is negative.
    let would_move = -sign(torque);
    mechanics.joints[joint].dry_level(would_move, 0.0, forces.load[joint], forces.share, forces.ripple[joint])
        - torque.abs()
}
