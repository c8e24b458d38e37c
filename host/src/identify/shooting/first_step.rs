//! The step of integration with which a run begins, where solutions from guessed states leave the
//! motion.
//!
//! Of an unstable motion (a pendulum held upright, a ball in a coil's field) they run away, and no step
//! is short enough for two of them to agree: steps were sought down to an eighth of a sample, and all
//! that follows took as many times as long. Over beginnings solutions stay with the motion, and over
//! whole pieces once their states are fitted.

use super::problem::{Piece, Problem};
use super::run::{FINEST, FIRST_STEPS, integration_step};
use crate::model::dynamics::Dynamics;

/// A step of integration, s.
#[derive(Clone, Copy)]
pub struct FirstStep {
    /// The step.
    pub step_s: f64,
    by_beginnings: bool,
}

impl FirstStep {
    /// Over whole pieces from guesses, or over their first `samples` where no step is short enough. The
    /// problem's own step stands for a period.
    pub fn new<D: Dynamics + ?Sized>(
        problem: &Problem<'_, D>,
        pieces: &[Piece],
        guesses: &[Vec<f64>],
        parameters: &[f64],
        samples: usize,
    ) -> Self {
        let period_s = problem.step_s;
        let step_s = integration_step(problem, pieces, guesses, parameters, period_s);
        if step_s >= FINEST * problem.spacing_s {
            return Self { step_s, by_beginnings: false };
        }
        let heads: Vec<Piece> = pieces.iter().map(|p| problem.head(p, samples)).collect();
        Self { step_s: integration_step(problem, &heads, guesses, parameters, period_s), by_beginnings: true }
    }

    /// The step once whole pieces have fitted states.
    pub fn with_states<D: Dynamics + ?Sized>(
        self,
        problem: &Problem<'_, D>,
        pieces: &[Piece],
        states: &[Vec<f64>],
        parameters: &[f64],
    ) -> f64 {
        if !self.by_beginnings {
            return self.step_s;
        }
        integration_step(problem, pieces, states, parameters, FIRST_STEPS * self.step_s)
    }
}
