//! Identification in real time: the device's own estimate of the double pendulum's parameters.
//!
//! Samples go into the [`Regressor`] (weak form, windows of [`PERIODS`] drive periods that overlap by half); the rows of each
//! complete window go into one [`LeastSquares`] an equation, which forgets by λ a window; after each window there is an
//! estimate with standard errors, or the statement that an unknown is not identifiable. Fixed memory, `f32`.
//!
//! A rig that is locked to its drive repeats itself: a window whose targets differ from those of the window before by less than
//! [`REPEATING`] of their sum of squares brings nothing new, and counted as new it would make the standard errors too small. It
//! is left out, and there is no estimate as long as that lasts.
//!
//! Cost: about 12·34 complex multiply-adds a sample; at the end of a window 65 rows are rotated into each fit, which
//! belongs into the thread, not into the sampling interrupt.

use whirl_shared::block::samples;
use whirl_shared::encoder::CountScale;
use whirl_shared::frame::SampleBlock;
use whirl_shared::least_squares::{Estimate, LeastSquares, NoEstimate};
use whirl_shared::regressor::{Regressor, RegressorSettings, UNKNOWNS1, UNKNOWNS2};

use crate::settings::Settings;

/// Length of a window, drive periods.
pub const PERIODS: u32 = 20;
/// Harmonics of the window: 32 rows' frequencies, up to 1.6 times the drive's, and two beyond.
pub const HARMONICS: usize = 34;
/// Rows of neighbouring frequencies share most of their test functions' spectrum, so that their residuals are correlated: with
/// a the coefficients of sin⁴ the correlations at distance d are r_d = Σ a_k a_{k+d}/Σ a_k², and the variances of the
/// estimates are 1 + 2 Σ r_d² = 2.63 times those of independent rows: this is the root.
const CORRELATED_ROWS: f32 = 1.622;
/// What is left of a column, once those before it are taken out, below which its unknown is not identifiable.
const TOLERANCE: f32 = 3e-3;

/// Share of the targets' sum of squares that is new in a window that repeats the one before; 2 where they have nothing in common.
pub const REPEATING: f32 = 0.02;
/// Rows of a window.
const ROWS: usize = 2 * (HARMONICS - 2) + 1;

/// What a window gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Tick of the window's last sample.
    pub tick: u32,
    /// Windows so far, since the last gap or change of the drive.
    pub windows: u32,
    /// B11 B12 B13 B14 C11 C12.
    pub first: Result<Estimate<f32, UNKNOWNS1>, NoEstimate>,
    /// B21 B22 B23 B24 C2.
    pub second: Result<Estimate<f32, UNKNOWNS2>, NoEstimate>,
}

/// The device's identification.
#[derive(Clone, Debug)]
pub struct Estimator {
    regressor: Regressor<f32, HARMONICS>,
    first: LeastSquares<f32, UNKNOWNS1>,
    second: LeastSquares<f32, UNKNOWNS2>,
    forget: f32,
    increment: u32,
    windows: u32,
    /// Targets of the last window.
    targets: [[f32; 2]; ROWS],
}

impl Estimator {
    /// `forget` is λ, what a window counts after the next one: 1 averages for ever, 0.9 over some 10 windows.
    /// `None` where a setting is not possible.
    #[must_use]
    pub fn new(settings: &Settings, forget: f32) -> Option<Self> {
        let [scale1, scale2] = settings.counts_per_turn.map(CountScale::new);
        let regressor = Regressor::new(RegressorSettings {
            scales: [scale1?, scale2?],
            sample_rate_millihertz: settings.sample_rate_millihertz,
            periods: PERIODS,
        });
        let (first, second) = (LeastSquares::new(), LeastSquares::new());
        (0.0..=1.0).contains(&forget).then_some(Self {
            regressor,
            first,
            second,
            forget,
            increment: 0,
            windows: 0,
            targets: [[0.0; 2]; ROWS],
        })
    }

    /// Takes one sample. Another drive is another system: what was known is forgotten.
    pub fn sample(&mut self, tick: u32, counts: [i32; 2], phase: u32, increment: u32) -> Option<Outcome> {
        if increment != self.increment {
            self.increment = increment;
            self.first = LeastSquares::new();
            self.second = LeastSquares::new();
            self.windows = 0;
        }
        if !self.regressor.push(tick, counts, phase, increment) {
            return None;
        }
        let mut index = 0;
        let (mut new, mut whole) = (0.0_f32, 0.0_f32);
        self.regressor.rows(|row| {
            let Some(last) = self.targets.get_mut(index) else { return };
            index += 1;
            for (target, last) in [row.first.1, row.second.1].into_iter().zip(last) {
                new += (target - *last) * (target - *last);
                whole += target * target;
                *last = target;
            }
        });
        let repeating = self.windows > 0 && whole > 0.0 && new < REPEATING * whole;
        self.windows = self.windows.saturating_add(1);
        if repeating {
            let because = NoEstimate::Repeating;
            return Some(Outcome { tick, windows: self.windows, first: Err(because), second: Err(because) });
        }
        self.first.forget(self.forget);
        self.second.forget(self.forget);
        let (first, second) = (&mut self.first, &mut self.second);
        self.regressor.rows(|row| {
            first.push(row.first.0, row.first.1);
            second.push(row.second.0, row.second.1);
        });
        if self.windows < 2 && whole > 0.0 {
            // One window cannot show that the motion does not repeat itself.
            let because = NoEstimate::TooFewRows;
            return Some(Outcome { tick, windows: self.windows, first: Err(because), second: Err(because) });
        }
        let first = self.first.solve(TOLERANCE).map(widened);
        let second = self.second.solve(TOLERANCE).map(widened);
        Some(Outcome { tick, windows: self.windows, first, second })
    }

    /// Takes a block; the outcome of the last window that ends in it.
    pub fn block(&mut self, block: &SampleBlock) -> Option<Outcome> {
        let mut last = None;
        for sample in samples(block) {
            last = self.sample(sample.tick, sample.counts, sample.phase, block.phase_increment).or(last);
        }
        last
    }
}

/// Standard errors for rows that are correlated.
fn widened<const P: usize>(estimate: Estimate<f32, P>) -> Estimate<f32, P> {
    Estimate { std_errors: estimate.std_errors.map(|error| error * CORRELATED_ROWS), ..estimate }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_checked_and_rest_gives_nothing() {
        assert!(Estimator::new(&Settings::default(), 1.5).is_none());
        assert!(Estimator::new(&Settings { counts_per_turn: [4096, 0], ..Settings::default() }, 0.9).is_none());
        let mut estimator = Estimator::new(&Settings::default(), 0.9).unwrap();
        assert!((0..5_000).all(|tick| estimator.sample(tick, [0, 0], 0, 0).is_none()));
    }

    #[test]
    fn arms_that_hang_still_are_not_identifiable() {
        let mut estimator = Estimator::new(&Settings::default(), 0.9).unwrap();
        let increment = 42_949_673;
        let outcomes = (0..5_000_u32).filter_map(|t| estimator.sample(t, [0, 0], t.wrapping_mul(increment), increment));
        let mut count = 0;
        for outcome in outcomes {
            count += 1;
            assert!(matches!(outcome.first, Err(NoEstimate::NotIdentifiable(_))), "{outcome:?}");
            assert!(matches!(outcome.second, Err(NoEstimate::NotIdentifiable(_))), "{outcome:?}");
        }
        assert_eq!(count, 3);
    }
}
