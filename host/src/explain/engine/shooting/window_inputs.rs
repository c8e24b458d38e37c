//! What acts from outside along a window of a stretch: time, the drive's phase, measured inputs.

use crate::identify::history::between_samples;
use crate::identify::stretches::Stretch;
use crate::identify::track;
use crate::model::dynamics::{Dynamics, Instant};
use crate::model::flow::abreast::VectorField;
use crate::model::integrate::Outside;

/// A window's surroundings at the points of a path: every sample of it, or several to a sample.
pub struct WindowInputs<'a> {
    /// The stretch.
    pub stretch: &'a Stretch,
    /// Its inputs between samples.
    pub between: &'a track::ExogenousInputs,
    /// Sample of the stretch at which the window begins.
    pub first: usize,
    /// Angular frequency of the drive, rad/s; 0 without one.
    pub omega: f64,
    /// Points to a sample.
    pub points: usize,
}

impl WindowInputs<'_> {
    /// Time between two points, s.
    pub fn spacing(&self) -> f64 {
        self.stretch.step_s / self.points as f64
    }

    /// Time of a point, s.
    pub fn time(&self, i: usize) -> f64 {
        self.stretch.time(self.first) + i as f64 * self.spacing()
    }

    /// Phase of the drive there, rad.
    pub fn tau(&self, i: usize) -> f64 {
        let after = (i % self.points) as f64 * self.spacing();
        if self.omega > 0.0 { self.stretch.tau(self.first + i / self.points) + self.omega * after } else { 0.0 }
    }

    /// Inputs at `count` points.
    pub fn inputs(&self, count: usize) -> Vec<Vec<f64>> {
        let mut out = vec![vec![0.0; count]; self.between.count()];
        let mut at = vec![0.0; out.len()];
        for i in 0..count {
            // At a sample only what has no samples of its own lies between.
            if i % self.points > 0 || at.len() > self.stretch.inputs.len() {
                Outside::inputs(self.between, self.time(i), &mut at);
            }
            if i % self.points == 0 {
                at.iter_mut().zip(&self.stretch.inputs).for_each(|(u, x)| *u = x[self.first + i / self.points]);
            }
            out.iter_mut().zip(&at).for_each(|(column, u)| column[i] = *u);
        }
        out
    }

    /// A followed state of an effect at `count` points.
    pub fn remembered(&self, number: usize, count: usize) -> Vec<f64> {
        // With a sample before the window, where the stretch has one, and one behind it.
        let before = usize::from(self.first > 0);
        let all = self.stretch.remembered(number, self.first - before, before + count.div_ceil(self.points) + 2);
        let at = |point: usize| {
            let i = point / self.points + before;
            let first = if i > 0 { all[i - 1] } else { 2.0 * all[i] - all[i + 1] };
            let share = (point % self.points) as f64 / self.points as f64;
            between_samples([first, all[i], all[i + 1], all[i + 2]], share)
        };
        (0..count).map(at).collect()
    }

    /// Acceleration of the model at the state of a point; false where there is none.
    pub fn acceleration(&self, i: usize, state: &[f64], field: VectorField<'_>, to: &mut [f64]) -> bool {
        let VectorField { motion, parameters } = field;
        let n = motion.degrees_of_freedom();
        let mut inputs = vec![0.0; self.between.count()];
        Outside::inputs(self.between, self.time(i), &mut inputs);
        let at = Instant { time: self.time(i), tau: self.tau(i), inputs: &inputs };
        motion.acceleration(parameters, &state[..n], &state[n..], &at, to)
    }
}
