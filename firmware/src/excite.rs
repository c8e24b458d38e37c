//! What the shaker does, along its course: the frequency's stairs, the list of amplitudes.

use whirl_shared::excitation::{Course, Excitation, ticks};

/// An excitation, and how far it has come.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Run {
    pub excitation: Excitation,
    course: Course,
    /// The amplitude that is in force, ticks for which each is held, and for which it was.
    step: usize,
    hold: u32,
    held: u32,
}

impl Run {
    /// At its beginning; none where a frequency is not below half the sampling rate.
    pub fn new(excitation: Excitation, sample_rate_millihertz: u32) -> Option<Self> {
        let course = Course::new(&excitation, sample_rate_millihertz)?;
        Some(Self { excitation, course, step: 0, hold: ticks(excitation.hold_ms, sample_rate_millihertz), held: 0 })
    }

    /// Advance of the phase in a tick, turns · 2⁻³².
    pub fn increment(&self) -> u32 {
        self.course.increment()
    }

    /// The amplitude to go to, nm.
    pub fn target(&self) -> u32 {
        let micrometre = self.excitation.amplitudes().get(self.step).copied().unwrap_or(0);
        micrometre.saturating_mul(1_000)
    }

    /// A tick at that amplitude has gone by: the next increment and the next amplitude, where they
    /// change.
    pub fn advance(&mut self) -> [Option<u32>; 2] {
        let increment = self.course.advance().then(|| self.increment());
        let more = self.step + 1 < self.excitation.amplitudes().len();
        self.held = if more { self.held + 1 } else { 0 };
        if self.held < self.hold || !more {
            return [increment, None];
        }
        (self.held, self.step) = (0, self.step + 1);
        [increment, Some(self.target())]
    }
}
