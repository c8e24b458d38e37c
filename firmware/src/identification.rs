//! What the thread half does with the [`Estimator`]: feeds it, and makes its messages.
//!
//! An [`Estimate`] after every second window, which is every twenty drive periods. The rows of a
//! window, if they are asked for, are made two frequencies at a time as the link takes them; those
//! that it has not taken when the next window is complete are counted as dropped frames, and so is
//! an estimate that the next one overtakes.

use core::borrow::BorrowMut;

use whirl_shared::frame::regression::{EquationEstimate, Estimate, Rows, Unknown, row_to_wire};
use whirl_shared::frame::{SampleBlock, Streamed};
use whirl_shared::least_squares::{self, NoEstimate};

use crate::estimate::{Estimator, FREQUENCIES, Outcome};
use crate::settings::{Settings, SettingsError};

/// Frequencies in a message of rows.
const TOGETHER: usize = 2;
/// Messages of a window's rows.
pub const ROWS_MESSAGES: usize = (FREQUENCIES + 1).div_ceil(TOGETHER);

/// The estimator and what waits for the link. `E` is an [`Estimator`] of its own, or a reference to
/// one: on a board it is a static, since it is large.
#[derive(Debug)]
pub struct Identification<E = Estimator> {
    estimator: E,
    streamed: Streamed,
    /// The drive is the sine that the estimator takes it for.
    sine: bool,
    forget_per_mille: u16,
    estimate: Option<Estimate>,
    /// m of the rows that are sent next; beyond the last one where nothing waits.
    next_rows: usize,
    dropped: u32,
}

impl<E: BorrowMut<Estimator>> Identification<E> {
    /// With an estimator, which begins anew.
    ///
    /// # Errors
    /// A setting that is not possible.
    pub fn new(settings: &Settings, mut estimator: E) -> Result<Self, SettingsError> {
        if !estimator.borrow_mut().set_up(settings) {
            let found = u32::from(settings.forget_per_mille);
            return Err(SettingsError { field: "forget_per_mille", found, min: 0, max: 1_000 });
        }
        Ok(Self {
            estimator,
            streamed: Streamed::Samples,
            sine: true,
            forget_per_mille: settings.forget_per_mille,
            estimate: None,
            next_rows: FREQUENCIES + 1,
            dropped: 0,
        })
    }

    /// What is to be streamed from now on. Of the window that is there already nothing is sent.
    pub fn stream(&mut self, streamed: Streamed) {
        self.streamed = streamed;
        self.next_rows = FREQUENCIES + 1;
    }

    /// Whether the drive is a sine of constant frequency from now on; nothing is identified where
    /// it is not, and afterwards all begins anew.
    pub fn assume_sine(&mut self, sine: bool) {
        self.sine = sine;
    }

    /// What is streamed.
    #[must_use]
    pub fn streamed(&self) -> Streamed {
        self.streamed
    }

    /// Takes a block.
    pub fn block(&mut self, block: &SampleBlock) {
        if !self.sine {
            // The ticks that are left out are a gap to the estimator.
            self.next_rows = FREQUENCIES + 1;
            return;
        }
        let estimator = self.estimator.borrow_mut();
        let before = estimator.window();
        let outcome = estimator.block(block);
        let window = estimator.window();
        if window.number != before.number || window.tick != before.tick {
            let left = (FREQUENCIES + 1).saturating_sub(self.next_rows).div_ceil(TOGETHER);
            // As many as there are messages in a window.
            self.dropped = self.dropped.wrapping_add(left as u32);
            let asked = self.streamed == Streamed::Rows && window.number > 0;
            self.next_rows = if asked { 0 } else { FREQUENCIES + 1 };
        }
        if let Some(outcome) = outcome.filter(|outcome| outcome.window.number.is_multiple_of(2))
            && self.estimate.replace(to_wire(&outcome, self.forget_per_mille)).is_some()
        {
            self.dropped = self.dropped.wrapping_add(1);
        }
    }

    /// The estimate that waits.
    pub fn take_estimate(&mut self) -> Option<Estimate> {
        self.estimate.take()
    }

    /// The next rows that wait.
    pub fn take_rows(&mut self) -> Option<Rows> {
        if self.next_rows > FREQUENCIES {
            return None;
        }
        let estimator = self.estimator.borrow();
        let window = estimator.window();
        let mut rows = heapless::Vec::new();
        for m in (self.next_rows..=FREQUENCIES).take(TOGETHER) {
            for row in estimator.rows_at(m).iter().flatten() {
                // There is room for all.
                let _ = rows.push(row_to_wire(row));
            }
        }
        let message = Rows {
            tick: window.tick,
            window_ticks: window.length,
            window: window.number,
            phase_increment: window.phase_increment,
            amplitude_nanometre: window.amplitude_nanometre,
            // Both are below 256.
            frequency: self.next_rows as u8,
            last_frequency: FREQUENCIES as u8,
            rows,
        };
        self.next_rows += TOGETHER;
        Some(message)
    }

    /// Messages that were not taken in time, wrapping.
    #[must_use]
    pub fn dropped_frames(&self) -> u32 {
        self.dropped
    }
}

fn to_wire(outcome: &Outcome, forget_per_mille: u16) -> Estimate {
    let window = outcome.window;
    Estimate {
        tick: window.tick,
        window_ticks: window.length,
        windows: window.number,
        forget_per_mille,
        phase_increment: window.phase_increment,
        amplitude_nanometre: window.amplitude_nanometre,
        first: equation(&outcome.first),
        second: equation(&outcome.second),
    }
}

fn equation<const P: usize>(
    result: &Result<least_squares::Estimate<f32, P>, NoEstimate>,
) -> EquationEstimate<[Unknown; P]> {
    match result {
        Ok(estimate) => EquationEstimate::Known {
            unknowns: core::array::from_fn(|i| Unknown {
                value: estimate.values[i].into(),
                std_error: estimate.std_errors[i].into(),
            }),
            condition: estimate.condition.into(),
            residual_rms: estimate.residual_rms.into(),
        },
        Err(NoEstimate::TooFewRows) => EquationEstimate::TooFewWindows,
        // At most five.
        Err(NoEstimate::NotIdentifiable(unknown)) => EquationEstimate::Undetermined(*unknown as u8),
        Err(NoEstimate::Repeating) => EquationEstimate::Repeating,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;
    use whirl_shared::frame::BLOCK_LEN;
    use whirl_shared::waveform::displacement;

    const INCREMENT: u32 = 42_949_673;

    fn motion(n: u32) -> [i32; 2] {
        [
            displacement(900, n.wrapping_mul(31_415_926)),
            (n as i32 * 37).wrapping_add(displacement(700, n.wrapping_mul(27_182_818))),
        ]
    }

    fn block(first_tick: u32) -> SampleBlock {
        let mut deltas = heapless::Vec::new();
        for n in first_tick..first_tick + BLOCK_LEN as u32 - 1 {
            let (a, b) = (motion(n), motion(n + 1));
            deltas.extend([(b[0] - a[0]) as i16, (b[1] - a[1]) as i16]);
        }
        SampleBlock {
            first_tick,
            phase: first_tick.wrapping_mul(INCREMENT),
            phase_increment: INCREMENT,
            amplitude_nanometre: 15_525_000,
            first: heapless::Vec::from_slice(&motion(first_tick)).unwrap(),
            deltas,
        }
    }

    #[test]
    fn an_estimate_comes_every_twenty_periods() {
        let mut identification = Identification::new(&Settings::default(), Estimator::IDLE).unwrap();
        let mut told = Vec::new();
        for tick in (0..9_000).step_by(BLOCK_LEN) {
            identification.block(&block(tick));
            told.extend(identification.take_estimate());
            assert!(identification.take_rows().is_none());
        }
        let seen: Vec<_> = told.iter().map(|e| (e.windows, e.tick)).collect();
        assert_eq!(seen, [(2, 3_009), (4, 5_009), (6, 7_009)]);
        assert_eq!(told[0].first, EquationEstimate::TooFewWindows);
        let EquationEstimate::Known { unknowns, condition, .. } = told[1].second else { panic!("{:?}", told[1]) };
        assert!(f32::from(condition) >= 1.0 && unknowns.iter().all(|u| f32::from(u.std_error) > 0.0));
        assert_eq!((told[1].amplitude_nanometre, told[1].forget_per_mille), (15_525_000, 900));
        assert_eq!(identification.dropped_frames(), 0);
    }

    #[test]
    fn rows_come_whole_and_what_nobody_takes_is_counted() {
        let mut identification = Identification::new(&Settings::default(), Estimator::IDLE).unwrap();
        identification.stream(Streamed::Rows);
        let mut windows = Vec::new();
        for tick in (0..6_100).step_by(BLOCK_LEN) {
            identification.block(&block(tick));
            // The third window finds the link blocked after two messages; estimates are never
            // taken.
            let most = if (4_009..5_009).contains(&(tick + 9)) { 2 } else { usize::MAX };
            let open = !(4_020..=5_000).contains(&tick);
            for rows in core::iter::from_fn(|| if open { identification.take_rows() } else { None }).take(most) {
                windows.push((rows.window, rows.frequency, rows.rows.len(), rows.last_frequency));
            }
        }
        for window in [1, 2, 4, 5] {
            let of: Vec<_> = windows.iter().filter(|w| w.0 == window).collect();
            assert_eq!(of.len(), ROWS_MESSAGES);
            for (i, (_, frequency, rows, last)) in of.into_iter().enumerate() {
                assert_eq!((usize::from(*frequency), *rows, *last), (2 * i, if i < 16 { 4 } else { 2 }, 32));
            }
        }
        assert_eq!(windows.iter().filter(|w| w.0 == 3).count(), 2);
        // Its other fifteen, and the estimate that the next one overtook.
        assert_eq!(identification.dropped_frames(), 15 + 1);
        // Samples again: the rest of a window is void.
        identification.stream(Streamed::Samples);
        assert!(identification.take_rows().is_none());
    }

    #[test]
    fn rows_of_windows_that_a_gap_has_ended_are_dropped_and_counted() {
        let mut identification = Identification::new(&Settings::default(), Estimator::IDLE).unwrap();
        identification.stream(Streamed::Rows);
        for tick in (0..2_020).step_by(BLOCK_LEN) {
            identification.block(&block(tick));
        }
        assert_eq!(identification.take_rows().map(|rows| rows.window), Some(1));
        identification.block(&block(5_000));
        assert!(identification.take_rows().is_none());
        assert_eq!(identification.dropped_frames() as usize, ROWS_MESSAGES - 1);
    }
}
