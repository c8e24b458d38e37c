//! Places in a record from which the model is followed: pieces for prediction horizons, states along extracted orbits.

use core::f64::consts::TAU;

use super::horizon::{FIT_PERIODS, LONGEST_PERIODS, horizon};
use super::motion_model::MotionModel;
use super::{HorizonComparison, OrbitComparison, Orbits, Settings};
use crate::identify::Prepared;
use crate::identify::shooting::problem::{Piece, Problem};
use crate::identify::shooting::track::{Geometry, Stretch, cut};
use crate::model::flow::{Flow, Outside};
use crate::phase_space::orbit_refinement::refine;
use crate::phase_space::survey::PhaseSpace;
use crate::rig::Rig;
use crate::signal::angles::AngleSegment;

/// What stands for the drive's period in a free system, s.
const FREE_PERIOD_S: f64 = 0.2;
/// Steps of integration a drive period; four times as many where effects jump with a velocity's sign.
const STEPS: [f64; 2] = [50.0, 200.0];

/// What is the same for all starts.
pub struct Starts<'a> {
    equations: &'a MotionModel,
    sensors: Vec<Vec<f64>>,
    sigma: [f64; 2],
    spacing_s: f64,
    period_s: f64,
    omega: f64,
    settings: &'a Settings,
    /// Step of integration, s.
    pub step_s: f64,
}

impl<'a> Starts<'a> {
    /// For a model on prepared records.
    pub fn new(equations: &'a MotionModel, prepared: &Prepared, rig: &Rig, settings: &'a Settings) -> Self {
        let relative = prepared.segments.iter().any(|s| s.relative);
        let period_s = rig.drive.map_or(FREE_PERIOD_S, |d| 1.0 / d.frequency_hz);
        let count = |k: usize| prepared.segments.first().and_then(|s| s.count_rad[k]);
        Self {
            equations,
            sensors: vec![vec![1.0, 0.0], if relative { vec![-1.0, 1.0] } else { vec![0.0, 1.0] }],
            sigma: core::array::from_fn(|k| {
                count(k).map_or(prepared.sigma[k], |q| q / 12f64.sqrt()).max(f64::MIN_POSITIVE.sqrt())
            }),
            spacing_s: prepared.segments.first().map_or(1.0 / rig.sample_rate_hz, |s| s.step_s),
            period_s,
            omega: rig.drive.map_or(0.0, |d| TAU * d.frequency_hz),
            settings,
            step_s: period_s / STEPS[usize::from(equations.has_forces())],
        }
    }

    fn problem(&self) -> Problem<'_, MotionModel> {
        Problem {
            dynamics: self.equations,
            sensors: &self.sensors,
            sigma: &self.sigma,
            spacing_s: self.spacing_s,
            step_s: self.step_s,
            omega: self.omega,
            inputs: None,
        }
    }

    fn samples(&self, periods: f64) -> usize {
        (periods * self.period_s / self.spacing_s).round() as usize
    }

    /// The samples first … first + count of a segment as a piece with a guess of its state.
    fn piece(&self, segment: &AngleSegment, first: usize, count: usize) -> Option<(Piece, Vec<f64>)> {
        let part = segment.part(first, (first + count).min(segment.len()));
        let stretch =
            Stretch { start_s: part.start_s, sensors: part.sensors().to_vec(), tau: Box::new(|i| part.tau(i)) };
        let guess = self.samples(0.05).clamp(4, 16);
        let geometry = Geometry { sensors: &self.sensors, angles: &[true; 2], spacing_s: self.spacing_s, guess };
        let (mut pieces, mut states) = cut(&[stretch], &geometry, count, guess)?;
        Some((pieces.pop()?, states.pop()?))
    }

    /// The state at the first sample of a segment, fitted to its first periods.
    pub fn first_state(&self, segment: &AngleSegment, parameters: &[f64]) -> Option<Vec<f64>> {
        let problem = self.problem();
        let (piece, guess) = self.piece(segment, 0, self.samples(FIT_PERIODS))?;
        let levels = [self.samples(1.0), self.samples(FIT_PERIODS)];
        problem.fit_state(&piece, &guess, parameters, &levels, &mut problem.room(false)).map(|f| f.0)
    }

    /// Pieces for horizons, evenly over the segments.
    fn pieces(&self, segments: &[AngleSegment]) -> (Vec<Piece>, Vec<Vec<f64>>) {
        let (fit, longest) = (self.samples(FIT_PERIODS), self.samples(FIT_PERIODS + LONGEST_PERIODS));
        // A start needs room for more than its fit.
        let least = fit + (longest - fit) / 4;
        let room: Vec<usize> = segments.iter().map(|s| s.len().saturating_sub(least)).collect();
        let all: usize = room.iter().sum();
        let every = (all / self.settings.starts).max(self.samples(1.0)).max(1);
        let mut out = (Vec::new(), Vec::new());
        for (segment, room) in segments.iter().zip(room) {
            for first in (0..room).step_by(every) {
                if let Some((piece, guess)) = self.piece(segment, first, longest) {
                    out.0.push(piece);
                    out.1.push(guess);
                }
            }
        }
        out
    }

    /// Horizons on the record and on the model's own.
    pub fn compare(
        &self,
        measured: &[AngleSegment],
        simulated: &[AngleSegment],
        parameters: &[f64],
    ) -> HorizonComparison {
        let problem = self.problem();
        let levels = [self.samples(1.0), self.samples(FIT_PERIODS)];
        let run = |segments: &[AngleSegment]| {
            let (pieces, guesses) = self.pieces(segments);
            horizon(&problem, &pieces, &guesses, parameters, &levels, self.settings.tolerance_deg.to_radians())
        };
        HorizonComparison {
            tolerance_deg: self.settings.tolerance_deg,
            fit_s: FIT_PERIODS * self.period_s,
            longest_s: LONGEST_PERIODS * self.period_s,
            measured: run(measured),
            simulated: run(simulated),
            median_lyapunov_times: None,
        }
    }

    /// Catalogues side by side, and the record's best closing orbits refined on the model. None for a free system.
    pub fn orbits(
        &self,
        (measured, simulated): (&PhaseSpace, &PhaseSpace),
        segments: &[AngleSegment],
        parameters: &[f64],
        most: usize,
    ) -> Option<Orbits> {
        let found = measured.orbits.as_ref()?;
        let longest = found.settings.longest;
        let count = |space: &PhaseSpace| -> Vec<usize> {
            let orbits = space.orbits.as_ref().map_or(&[][..], |o| &o.orbits);
            (1..=longest).map(|k| orbits.iter().filter(|o| o.period == k).count()).collect()
        };
        let mut best: Vec<_> = found.orbits.iter().collect();
        best.sort_by(|a, b| a.error.total_cmp(&b.error));
        let refined = best
            .into_iter()
            .take(most)
            .map(|o| OrbitComparison {
                period: o.period,
                start_s: o.start_s,
                closing: o.error,
                refined: self.refine(segments, o.start_s, o.period, parameters),
            })
            .collect();
        Some(Orbits {
            tolerance: found.settings.tolerance,
            measured: count(measured),
            simulated: count(simulated),
            refined,
        })
    }

    fn refine(
        &self,
        segments: &[AngleSegment],
        start_s: f64,
        period: usize,
        parameters: &[f64],
    ) -> Option<crate::phase_space::orbit_refinement::RefinedOrbit> {
        let segment = segments.iter().find(|s| start_s >= s.start_s - 1e-9 && start_s < s.time(s.len()))?;
        let first = ((start_s - segment.start_s) / self.spacing_s).round() as usize;
        let problem = self.problem();
        let mut work = problem.room(false);
        let one = self.samples(1.0);
        let mut offset = [0.0; 2];
        let mut guess = Vec::with_capacity(period);
        for j in 0..period {
            let at = first + self.samples(j as f64);
            if at + one > segment.len() {
                return None;
            }
            let (piece, rough) = self.piece(segment, at, one)?;
            let (mut state, _) = problem.fit_state(&piece, &rough, parameters, &[one / 2, one], &mut work)?;
            // Pieces lose their whole turns: put them back, so that one period leads to the next.
            for k in 0..2 {
                let here = segment.phi[k][at];
                if j == 0 {
                    offset[k] = state[k] - here;
                }
                state[k] += TAU * ((here + offset[k] - state[k]) / TAU).round();
            }
            guess.push(state);
        }
        let outside = Outside::drive(segment.time(first), segment.tau(first), self.omega);
        let flow = Flow::new(self.equations, parameters, outside, self.step_s);
        refine(&flow, self.equations, &[true; 2], &guess, segment.time(first), self.period_s)
    }
}
