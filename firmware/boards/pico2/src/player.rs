//! The shaker's points by pulse width: a PWM slice wraps 40 000 times a second, and DMA brings it
//! the next point's width at each wrap. Two resistors and two capacitors make a voltage of it.
//!
//! A second slice wraps once a tick and makes its interrupt; both were started by one write, run
//! from one clock, and a tick is a whole number of points. So the tick's slice tells which point is
//! out. A width that is written goes out with the next wrap: when point k is out, that of k + 1 is
//! in the register already, and k + 2 is the first that can still be chosen.
//!
//! Each tick's points are a run of their own, not a ring: where the next tick does not come, the
//! last width stands, which is so in a debugger's halt too.

use whirl_firmware::dac::Converter;
use whirl_firmware::pacing::Schedule;
use whirl_firmware::sweep::{BEYOND, POINTS_PER_SECOND};

/// Clock of the slices, Hz.
pub const CLOCK_HZ: u32 = 150_000_000;
/// Clocks of a point, and the greatest width: the output is high all the time.
pub const WIDTH: u16 = (CLOCK_HZ / POINTS_PER_SECOND) as u16;
/// Most points of a tick: 40 kHz at 250 Hz.
pub const MOST: usize = 160;
/// A run of points.
pub type Run = [u16; MOST + BEYOND];
/// Greatest sampling rate, mHz: the thread's work of a sample takes 17 000 instructions at most.
const RATE_MAX_MILLIHERTZ: u32 = 2_000_000;
/// Counts of the tick's slice about a wrap of the points in which it is not to be told on which
/// side of it a point is: the two slices may be some clocks apart, and a count is two clocks or
/// more.
const UNCLEAR: u32 = 8;

/// How the slices run at a rate; none where a tick would not be a whole number of points.
#[must_use]
pub fn schedule(rate_millihertz: u32) -> Option<Schedule> {
    if rate_millihertz > RATE_MAX_MILLIHERTZ {
        return None;
    }
    let schedule = Schedule::new(CLOCK_HZ, rate_millihertz, POINTS_PER_SECOND)?;
    // A slice's divider has 8 bits.
    let fits = schedule.prescaler < 255 && schedule.points <= MOST;
    (fits && schedule.point_reload == WIDTH - 1).then_some(schedule)
}

/// Microseconds of a tick: what a clock of 1 MHz counts.
#[must_use]
pub fn microseconds(schedule: &Schedule) -> u32 {
    schedule.points as u32 * (1_000_000 / POINTS_PER_SECOND)
}

/// Slices and DMA channel.
pub trait Slices {
    /// Counts of the tick's slice since its last wrap.
    fn since_tick(&self) -> u32;
    /// The width that was written last.
    fn written(&self) -> u16;
    /// Writes a width.
    fn write(&mut self, width: u16);
    /// Writes one of these at each wrap of the points from now on. They are left alone until
    /// [`Self::stop`].
    fn start(&mut self, widths: &[u16]);
    /// Writes no more.
    fn stop(&mut self);
}

/// The player.
pub struct Player<S> {
    slices: S,
    runs: &'static mut [Run; 2],
    next: usize,
    schedule: Schedule,
}

impl<S: Slices> Player<S> {
    /// Takes the slices, at rest.
    pub fn new(slices: S, runs: &'static mut [Run; 2], schedule: Schedule) -> Self {
        let mut player = Self { slices, runs, next: 0, schedule };
        player.set(WIDTH / 2);
        player
    }

    fn length(&self) -> usize {
        self.schedule.points.min(MOST) + BEYOND
    }

    /// The point whose width is in the register; none too near to a wrap.
    fn clear(&self) -> Option<usize> {
        let since = self.slices.since_tick();
        let of_point = self.schedule.period() / self.schedule.points.max(1) as u32;
        let within = since % of_point.max(1);
        let clear = (UNCLEAR..of_point.saturating_sub(UNCLEAR)).contains(&within);
        clear.then_some((since / of_point.max(1)) as usize + 1)
    }

    fn committed(&self) -> usize {
        loop {
            // 16 counts, a microsecond, in 375 or more.
            if let Some(point) = self.clear() {
                return point;
            }
        }
    }
}

impl<S: Slices> Converter for Player<S> {
    const MAX: u16 = WIDTH;

    fn set(&mut self, code: u16) {
        self.slices.stop();
        self.slices.write(code);
    }

    fn points(&self) -> usize {
        self.schedule.points
    }

    fn standing(&mut self) -> (usize, u16) {
        loop {
            let (point, width) = (self.committed(), self.slices.written());
            if self.clear() == Some(point) {
                return (point, width);
            }
        }
    }

    fn room(&mut self) -> &mut [u16] {
        let length = self.length();
        self.runs[self.next].get_mut(..length).unwrap_or(&mut [])
    }

    fn play(&mut self) {
        let length = self.length();
        let run = &self.runs[self.next][..length];
        let mut again = false;
        loop {
            let point = self.committed().min(length - 2);
            self.slices.stop();
            if again {
                // The wrap that came meanwhile has brought nothing.
                self.slices.write(run[point]);
            }
            self.slices.start(&run[point + 1..]);
            // A wrap that comes meanwhile delays all that follow.
            if self.committed().min(length - 2) == point {
                break;
            }
            again = true;
        }
        self.next = 1 - self.next;
    }
}

#[cfg(test)]
mod tests;
