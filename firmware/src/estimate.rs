//! Identification in real time: the device's own estimate of the double pendulum's parameters.
//!
//! Samples go into the [`Regressor`] (weak form, windows of [`PERIODS`] drive periods that overlap
//! by half); the rows of each complete window go into one [`LeastSquares`] an equation, which
//! forgets by λ a window; after each window there is an estimate with standard errors, or the
//! statement that an unknown is not identifiable. Fixed memory, `f32`.
//!
//! A rig that is locked to its drive repeats itself: a window whose targets differ from those of
//! one of the [`HISTORY`] windows before by less than [`REPEATING`] of their sum of squares brings
//! nothing new, and counted as new it would make the standard errors too small. It is left out, and
//! there is no estimate as long as that lasts. With three windows remembered, motions of period 1,
//! 2, 3, 4, 5, 6, 10, 15, 20 and 30 times the drive's are seen.
//!
//! Cost a sample: 12·34 complex multiply-adds. What follows the end of a window is done one
//! frequency with each of the next samples, first the comparison, then the fit: no sample costs
//! much more than another, and the outcome comes [`STEPS`] samples later. It belongs into the
//! thread, not into the sampling interrupt.

use whirl_shared::block::samples;
use whirl_shared::encoder::CountScale;
use whirl_shared::frame::SampleBlock;
use whirl_shared::least_squares::{Estimate, LeastSquares, NoEstimate};
use whirl_shared::regressor::{Pushed, Regressor, RegressorSettings, Row, UNKNOWNS1, UNKNOWNS2};

use crate::settings::Settings;

/// Length of a window, drive periods.
pub const PERIODS: u32 = 20;
/// Harmonics of the window: 32 rows' frequencies, up to 1.6 times the drive's, and two beyond.
pub const HARMONICS: usize = 34;
/// Highest m of a window's rows.
pub const FREQUENCIES: usize = HARMONICS - 2;
/// Windows before the newest whose targets are remembered.
pub const HISTORY: usize = 3;
/// Samples between the end of a window and its outcome.
pub const STEPS: usize = 2 * (FREQUENCIES + 1) + 1;
/// Rows of neighbouring frequencies share most of their test functions' spectrum, so that their
/// residuals are correlated: with a the coefficients of sin⁴ the correlations at distance d are
/// r_d = Σ a_k a_{k+d}/Σ a_k², and the variances of the estimates are 1 + 2 Σ r_d² = 2.63 times
/// those of independent rows: this is the root.
const CORRELATED_ROWS: f32 = 1.622;
/// What is left of a column, once those before it are taken out, below which its unknown is not
/// identifiable.
const TOLERANCE: f32 = 3e-3;

/// Share of the targets' sum of squares that is new in a window that repeats an earlier one; 2
/// where they have nothing in common. Of a motion that repeats exactly, what is left is the
/// rounding of windows to whole ticks: 2 % at most with 96 ticks a period.
pub const REPEATING: f32 = 0.04;

/// A window of the regression.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WindowInfo {
    /// Tick of its last sample.
    pub tick: u32,
    /// Its length, ticks.
    pub length: u32,
    /// Its number since the last gap or change of the drive, from 1.
    pub number: u32,
    /// Advance of the drive's phase in a tick, turns · 2⁻³².
    pub phase_increment: u32,
    /// Commanded amplitude, nm.
    pub amplitude_nanometre: u32,
}

/// What a window gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// The newest window.
    pub window: WindowInfo,
    /// B11 B12 B13 B14 C11 C12.
    pub first: Result<Estimate<f32, UNKNOWNS1>, NoEstimate>,
    /// B21 B22 B23 B24 C2.
    pub second: Result<Estimate<f32, UNKNOWNS2>, NoEstimate>,
}

/// What is next of a window that is complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Nothing,
    /// Targets at m against those of earlier windows.
    Compare(usize),
    /// Rows at m into the fit.
    Fit(usize),
    Solve,
}

/// Targets of both equations at each m, real and imaginary.
type Targets = [[[f32; 2]; 2]; FREQUENCIES + 1];

/// The device's identification.
#[derive(Clone, Debug)]
pub struct Estimator {
    regressor: Regressor<f32, HARMONICS>,
    first: LeastSquares<f32, UNKNOWNS1>,
    second: LeastSquares<f32, UNKNOWNS2>,
    forget: f32,
    window: WindowInfo,
    /// Nothing is identified.
    off: bool,
    step: Step,
    /// Targets of the last windows, by their numbers modulo the number of places.
    targets: [Targets; HISTORY],
    /// Σ of the squares of what is new against each of them, and of all.
    new: [f32; HISTORY],
    whole: f32,
}

impl Estimator {
    /// One without settings, to be set up in its place: all of it zero, so that a device needs
    /// neither stack nor flash for it.
    pub const IDLE: Self = Self {
        regressor: Regressor::idle(),
        first: LeastSquares::of_zero(0.0),
        second: LeastSquares::of_zero(0.0),
        forget: 0.0,
        off: false,
        window: WindowInfo { tick: 0, length: 0, number: 0, phase_increment: 0, amplitude_nanometre: 0 },
        step: Step::Nothing,
        targets: [[[[0.0; 2]; 2]; FREQUENCIES + 1]; HISTORY],
        new: [0.0; HISTORY],
        whole: 0.0,
    };

    /// `None` where a setting is not possible.
    #[must_use]
    pub fn new(settings: &Settings) -> Option<Self> {
        let mut estimator = Self::IDLE;
        estimator.set_up(settings).then_some(estimator)
    }

    /// Begins anew with settings; false where one is not possible.
    #[must_use]
    pub fn set_up(&mut self, settings: &Settings) -> bool {
        // A double pendulum's: with other than two encoders nothing is identified.
        let [first, second] = match settings.counts_per_turn[..] {
            [first, second] => [first, second],
            _ => [1; 2],
        };
        self.off = settings.counts_per_turn.len() != 2;
        let (Some(scale1), Some(scale2)) = (CountScale::new(first), CountScale::new(second)) else { return false };
        if settings.forget_per_mille > 1_000 {
            return false;
        }
        self.regressor.set_up(RegressorSettings {
            scales: [scale1, scale2],
            sample_rate_millihertz: settings.sample_rate_millihertz,
            periods: PERIODS,
        });
        self.first = LeastSquares::new();
        self.second = LeastSquares::new();
        self.forget = f32::from(settings.forget_per_mille) * 1e-3;
        self.window = WindowInfo::default();
        self.step = Step::Nothing;
        true
    }

    /// Takes one sample. Another drive is another system: what was known is forgotten.
    pub fn sample(
        &mut self,
        tick: u32,
        counts: [i32; 2],
        phase: u32,
        phase_increment: u32,
        amplitude_nanometre: u32,
    ) -> Option<Outcome> {
        if phase_increment != self.window.phase_increment || amplitude_nanometre != self.window.amplitude_nanometre {
            self.window = WindowInfo { phase_increment, amplitude_nanometre, ..WindowInfo::default() };
            self.first = LeastSquares::new();
            self.second = LeastSquares::new();
            self.regressor.clear();
        }
        let mut outcome = self.go_on();
        // A window of few samples: the next one needs its place.
        while self.step != Step::Nothing && self.regressor.completes_next() {
            outcome = self.go_on().or(outcome);
        }
        match self.regressor.push(tick, counts, phase, phase_increment) {
            Pushed::Taken => {}
            Pushed::Began => {
                // The next windows lie elsewhere on the drive's period: those before cannot be
                // compared with.
                self.window.number = 0;
                self.step = Step::Nothing;
            }
            Pushed::Complete => {
                self.window.tick = tick.wrapping_sub(Regressor::<f32, HARMONICS>::DELAY);
                self.window.length = self.regressor.length();
                self.window.number = self.window.number.saturating_add(1);
                self.step = Step::Compare(0);
                self.new = [0.0; HISTORY];
                self.whole = 0.0;
            }
        }
        outcome
    }

    /// The next step of the window that is complete.
    fn go_on(&mut self) -> Option<Outcome> {
        match self.step {
            Step::Nothing => {}
            Step::Compare(m) => {
                self.compare(m);
                self.step = if m < FREQUENCIES {
                    Step::Compare(m + 1)
                } else if self.repeating() {
                    Step::Solve
                } else {
                    self.first.forget(self.forget);
                    self.second.forget(self.forget);
                    Step::Fit(0)
                };
            }
            Step::Fit(m) => {
                // The imaginary row at m = 0 is zero.
                for row in self.regressor.rows_at(m).iter().flatten().take(if m == 0 { 1 } else { 2 }) {
                    self.first.push(row.first.0, row.first.1);
                    self.second.push(row.second.0, row.second.1);
                }
                self.step = if m < FREQUENCIES { Step::Fit(m + 1) } else { Step::Solve };
            }
            Step::Solve => {
                self.step = Step::Nothing;
                return Some(self.outcome());
            }
        }
        None
    }

    /// Compares the targets at m with those of earlier windows, and puts them in place of the
    /// oldest.
    fn compare(&mut self, m: usize) {
        let Some(targets) = self.regressor.targets_at(m) else { return };
        for (target, k) in targets.iter().flatten().zip(0_usize..) {
            self.whole += target * target;
            for (new, earlier) in self.new.iter_mut().zip(&self.targets) {
                let change = target - earlier[m][k / 2][k % 2];
                *new += change * change;
            }
        }
        let oldest = self.window.number as usize % HISTORY;
        self.targets[oldest][m] = targets;
    }

    /// Windows before the newest that can be compared with it.
    fn remembered(&self) -> usize {
        (self.window.number.saturating_sub(1) as usize).min(HISTORY)
    }

    /// Whether the newest window repeats an earlier one.
    fn repeating(&self) -> bool {
        (1..=self.remembered()).any(|back| {
            let place = (self.window.number as usize).wrapping_sub(back) % HISTORY;
            self.whole > 0.0 && self.new[place] < REPEATING * self.whole
        })
    }

    fn outcome(&self) -> Outcome {
        let none = if self.repeating() {
            Some(NoEstimate::Repeating)
        } else if self.remembered() < HISTORY && self.whole > 0.0 {
            // So few windows cannot show that the motion does not repeat itself.
            Some(NoEstimate::TooFewRows)
        } else {
            None
        };
        Outcome {
            window: self.window,
            first: none.map_or_else(|| self.first.solve(TOLERANCE).map(widened), Err),
            second: none.map_or_else(|| self.second.solve(TOLERANCE).map(widened), Err),
        }
    }

    /// Takes a block; the outcome of the last window that ends in it. A block during a ramp holds
    /// samples of other amplitudes than its first one's; the next block then differs from it.
    pub fn block(&mut self, block: &SampleBlock) -> Option<Outcome> {
        let mut last = None;
        for sample in samples(block) {
            // The base's counts come behind those of the encoders.
            let [first, second, ..] = sample.counts[..] else { return None };
            if self.off {
                return None;
            }
            let outcome = self.sample(
                sample.tick,
                [first, second],
                sample.phase,
                block.phase_increment,
                block.amplitude_nanometre,
            );
            last = outcome.or(last);
        }
        last
    }

    /// The last complete window; its number is 0 where there is none.
    #[must_use]
    pub fn window(&self) -> WindowInfo {
        self.window
    }

    /// Rows of the last complete window at m, until the next is complete.
    #[must_use]
    pub fn rows_at(&self, m: usize) -> Option<[Row<f32>; 2]> {
        self.regressor.rows_at(m)
    }
}

/// Standard errors for rows that are correlated.
fn widened<const P: usize>(estimate: Estimate<f32, P>) -> Estimate<f32, P> {
    Estimate { std_errors: estimate.std_errors.map(|error| error * CORRELATED_ROWS), ..estimate }
}

#[cfg(test)]
mod tests;
