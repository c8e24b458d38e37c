//! A converter's points: a timer asks for one at each of its wraps, and DMA brings it from memory.
//!
//! Each tick's points are a run of their own, not a ring: where the next tick does not come (a
//! debugger, an erasure of the flash), the last code stands, and the last tick is not played over
//! and over. A run goes on a little beyond its tick ([`BEYOND`]), until the next one is there.
//!
//! Which point is out tells the tick's timer, which runs in step with that of the points; what
//! stands there tells the channel, by what it has not brought yet. The next [`LEAD`] points are
//! those of the run that is played, or its last code: they pass while the new run is computed,
//! which begins behind them. Where that took longer it is played from the place that is nearest to
//! what stands then, and where a wrap was missed nothing is left out: late until the next tick, but
//! no step is greater than those of the run ([`crate::sweep::CATCH_UP`]).

use crate::dac::Converter;
use crate::pacing::Schedule;
use crate::sweep::{BEYOND, POINTS_PER_SECOND};

/// Most points of a tick: 40 kHz at 250 Hz.
pub const MOST: usize = 160;
/// Greatest sampling rate, mHz: the thread's work of a sample takes 17 000 instructions at most.
const RATE_MAX_MILLIHERTZ: u32 = 2_000_000;
/// Points that pass while a run is computed: 0.1 ms at 40 kHz, twice what it takes.
pub const LEAD: usize = 4;
/// A run of points.
pub type Run = [u16; MOST + BEYOND];

/// The points' timer and their DMA channel, beside the tick's timer.
pub trait Channel {
    /// Greatest code.
    const MAX: u16;
    /// How many wraps a code that is written goes out later: 0 where it does at once.
    const AHEAD: usize;
    /// Counts of the tick's timer about a wrap in which it is not to be told on which side of it a
    /// point is: both timers may be some clocks apart.
    const UNCLEAR: u32;

    /// Counts of the tick's timer since its last tick.
    fn since_tick(&self) -> u32;

    /// Writes a code, while the channel is stopped.
    fn write(&mut self, code: u16);

    /// Writes one of these at each wrap from now on; one that came before is none of them. They are
    /// left alone until [`Self::stop`].
    fn start(&mut self, codes: &[u16]);

    /// How many of them are still to be written.
    fn left(&self) -> usize;

    /// Writes no more.
    fn stop(&mut self);
}

/// How timers run at a rate; none where they cannot make it exactly, where it is too great, or where
/// a tick would have more points than there is room for (below 250 Hz).
#[must_use]
pub fn schedule(timer_hertz: u32, rate_millihertz: u32) -> Option<Schedule> {
    if rate_millihertz > RATE_MAX_MILLIHERTZ {
        return None;
    }
    Schedule::new(timer_hertz, rate_millihertz, POINTS_PER_SECOND).filter(|schedule| schedule.points <= MOST)
}

/// The player.
pub struct Player<C> {
    channel: C,
    runs: &'static mut [Run; 2],
    /// The run that is written next; the other one is played.
    next: usize,
    schedule: Schedule,
    /// The last point before the new ones.
    settled: usize,
}

impl<C: Channel> Player<C> {
    /// Takes the channel, at rest; timed as [`schedule`] says.
    pub fn new(channel: C, runs: &'static mut [Run; 2], schedule: Schedule) -> Self {
        let mut player = Self { channel, runs, next: 0, schedule, settled: 0 };
        player.set(C::MAX / 2 + C::MAX % 2);
        player
    }

    /// How it is timed.
    pub fn schedule(&self) -> Schedule {
        self.schedule
    }

    fn length(&self) -> usize {
        self.schedule.points + BEYOND
    }

    /// The point whose code was written last; none too near to a wrap.
    fn clear(&self) -> Option<usize> {
        let (points, period) = (self.schedule.points as u32, self.schedule.period());
        // A tick's counts are 2¹⁶ at most, its points fewer than 2⁸.
        let turned = self.channel.since_tick() * points;
        let (within, of_point) = (turned % period / points, period / points);
        let clear = (C::UNCLEAR..of_point.saturating_sub(C::UNCLEAR)).contains(&within);
        clear.then_some((turned / period) as usize + C::AHEAD)
    }

    fn point(&self) -> usize {
        loop {
            // Some microseconds of a point's 25.
            if let Some(point) = self.clear() {
                return point;
            }
        }
    }

    /// The place in the run that is played whose code was written last.
    fn place(&self) -> usize {
        self.length().saturating_sub(1 + self.channel.left())
    }
}

impl<C: Channel> Converter for Player<C> {
    const MAX: u16 = C::MAX;

    // Whatever ends in rest calls it: once in flash is enough.
    #[inline(never)]
    fn set(&mut self, code: u16) {
        self.channel.stop();
        self.channel.write(code);
        // Whatever the channel says of it, it is what stands.
        self.runs[1 - self.next] = [code; MOST + BEYOND];
    }

    fn points(&self) -> usize {
        self.schedule.points
    }

    fn standing(&mut self) -> (usize, u16) {
        let last = self.length() - 1;
        let (point, place) = loop {
            let (point, place) = (self.point(), self.place());
            if self.clear() == Some(point) {
                break (point.min(last), place);
            }
        };
        self.settled = (point + LEAD).min(last);
        let [first, second] = &mut *self.runs;
        let (played, run) = if self.next == 0 { (second, first) } else { (first, second) };
        for (k, to) in run[point..=self.settled].iter_mut().enumerate() {
            *to = played[(place + k).min(last)];
        }
        (self.settled, run[self.settled])
    }

    fn room(&mut self) -> &mut [u16] {
        let length = self.length();
        &mut self.runs[self.next][..length]
    }

    fn play(&mut self) {
        let length = self.length();
        let mut point = self.point();
        let next = self.next;
        let standing = self.runs[1 - next][self.place()];
        let mut at = point.min(length - 2);
        if at > self.settled {
            // It took longer than the lead: what stands comes nearest to this one, the latest of
            // such.
            let away = |place: &usize| self.runs[next][place + 1].abs_diff(standing);
            at = (self.settled..=at).rev().min_by_key(away).unwrap_or(at);
        }
        self.runs[next][at] = standing;
        loop {
            self.channel.stop();
            self.channel.start(&self.runs[next][at + 1..length]);
            let now = self.point();
            if now == point || self.channel.left() < length - 1 - at {
                break;
            }
            // A wrap fell between: what it should have brought comes now.
            (point, at) = (now, (at + 1).min(length - 2));
            self.channel.stop();
            self.channel.write(self.runs[next][at]);
        }
        self.next = 1 - self.next;
    }
}

#[cfg(test)]
mod tests;
