//! The shaker's points by pulse width: a PWM slice wraps 40 000 times a second, and DMA brings it
//! the next point's width at each wrap ([`whirl_firmware::player`]). Two resistors and two
//! capacitors make a voltage of it.
//!
//! A second slice wraps once a tick and makes its interrupt; both were started by one write, run
//! from one clock, and a tick is a whole number of points. So the tick's slice tells which point is
//! out. A width that is written goes out with the next wrap: when point k is out, that of k + 1 is
//! in the register already, and k + 2 is the first that can still be chosen.

use whirl_firmware::pacing::Schedule;
use whirl_firmware::player;
use whirl_firmware::sweep::POINTS_PER_SECOND;

/// Clock of the slices, Hz.
pub const CLOCK_HZ: u32 = 150_000_000;
/// Clocks of a point, and the greatest width: the output is high all the time.
pub const WIDTH: u16 = (CLOCK_HZ / POINTS_PER_SECOND) as u16;

/// How the slices run at a rate; none where a tick would not be a whole number of points.
#[must_use]
pub fn schedule(rate_millihertz: u32) -> Option<Schedule> {
    let schedule = player::schedule(CLOCK_HZ, rate_millihertz)?;
    // A slice's divider has 8 bits.
    (schedule.prescaler < 255 && schedule.point_reload == WIDTH - 1).then_some(schedule)
}

/// Microseconds of a tick: what a clock of 1 MHz counts.
#[must_use]
pub fn microseconds(schedule: &Schedule) -> u32 {
    schedule.points as u32 * (1_000_000 / POINTS_PER_SECOND)
}

#[cfg(test)]
mod tests;
