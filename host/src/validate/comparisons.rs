//! How far a model follows a record, and what it does in the long run, beside the record.

use core::f64::consts::TAU;

use indicatif::ProgressBar;

use super::horizon::{Horizon, horizon};
use super::identified_equations::IdentifiedEquations;
use super::result::Labelled;
use super::{ExponentComparison, HorizonComparison, OrbitComparison, Orbits, Pair, Settings};
use crate::identify::stretches::Stretch;
use crate::identify::units::channel_units;
use crate::model::flow::{Flow, Inputs, Outside};
use crate::motion::starts::{FIT_PERIODS, LONGEST_PERIODS, Pace, RecordTrack, Starts};
use crate::phase_space::model_exponent;
use crate::phase_space::orbit_refinement::{RefinedOrbit, refine};
use crate::phase_space::survey::PhaseSpace;
use crate::rig::measures::ObservedModel;
use crate::rig::{Drive, Rig};
use crate::wording::format::{quantity, shortest};
use crate::wording::symbols::symbol_plain;

/// Share of the span by which a coordinate on a line may be off where an angle may be off by a
/// turn: 30° are a twelfth of both.
const TURN_DEG: f64 = 360.0;

/// What is the same for all comparisons.
pub struct Comparisons<'a> {
    /// Where the model is followed from.
    pub starts: Starts<'a>,
    /// The model's equations.
    pub equations: &'a IdentifiedEquations,
    /// Which coordinates are angles.
    pub circle: Vec<bool>,
    /// Choices.
    pub settings: &'a Settings,
    /// The rig's channels, and what they measure.
    of: (&'a Rig, &'a ObservedModel),
    /// Which sensors show angles.
    shows_angle: Vec<bool>,
    /// By how much each sensor's prediction may be off, in its unit.
    tolerance: Vec<f64>,
}

/// Where the model begins to follow a stretch.
pub struct Beginning<'a> {
    /// The stretch.
    pub stretch: &'a Stretch,
    /// Its number.
    pub index: usize,
    /// The state at its first sample, coordinates then rates.
    pub state: Vec<f64>,
}

impl<'a> Comparisons<'a> {
    /// For a model on a record; `of`: its rig and what its channels measure.
    pub fn new(
        equations: &'a IdentifiedEquations,
        record: RecordTrack<'_>,
        of: (&'a Rig, &'a ObservedModel),
        pace: Pace,
        settings: &'a Settings,
    ) -> Self {
        let circle = of.1.model.circle();
        let is_angle = |weights: &Vec<f64>| weights.iter().zip(&circle).all(|(w, c)| *w == 0.0 || *c);
        let shows_angle: Vec<bool> = record.track.sensors.iter().map(is_angle).collect();
        let allowed = |(weights, angle): (&Vec<f64>, &bool)| {
            let span = if *angle { TAU } else { span(record.stretches, weights) };
            settings.tolerance_deg / TURN_DEG * span
        };
        let tolerance = record.track.sensors.iter().zip(&shows_angle).map(allowed).collect();
        let starts = Starts::new(&*equations.dynamics, &equations.parameters, record, pace, settings.starts);
        Self { starts, equations, circle, settings, of, shows_angle, tolerance }
    }

    /// The drive, where there is one.
    pub fn drive(&self) -> Option<Drive> {
        self.of.0.drive
    }

    /// Where the model follows the longest stretch.
    pub fn longest_stretch<'b>(&self, record: RecordTrack<'b>) -> Option<Beginning<'b>> {
        let (index, stretch) = record.stretches.iter().enumerate().max_by_key(|(_, s)| s.len())?;
        Some(Beginning { stretch, index, state: self.starts.first_state(record, index)? })
    }

    /// What acts from outside along a stretch, and its first time on the axis.
    pub fn outside<'b>(
        &self,
        record: RecordTrack<'_>,
        stretch: usize,
        at: &'b (dyn Fn(f64, &mut [f64]) + Sync),
    ) -> Option<Outside<'b>> {
        let first = record.track.piece(stretch, 0, record.track.samples(stretch).min(16))?.0;
        let count = record.stretches[stretch].inputs.len();
        let inputs = (count > 0).then_some(Inputs { count, at });
        Some(Outside { origin: first.start_s, tau: first.tau, omega: self.starts.pace.omega, inputs })
    }

    /// Horizons on the record and on the model's own.
    pub fn compare(
        &self,
        measured: RecordTrack<'_>,
        simulated: RecordTrack<'_>,
        bar: &ProgressBar,
    ) -> HorizonComparison {
        let run = |record: RecordTrack<'_>| -> Horizon {
            let at = |t: f64, out: &mut [f64]| record.track.inputs(t, out);
            let problem = self.starts.problem(record.track, &at);
            let levels = [1.0, FIT_PERIODS].map(|periods| self.starts.samples(periods, record.track));
            let (pieces, guesses) = self.starts.pieces(record);
            bar.inc_length(pieces.len() as u64);
            horizon(&problem, &pieces, &guesses, &self.equations.parameters, &levels, &self.tolerance, bar)
        };
        HorizonComparison {
            tolerance_deg: self.settings.tolerance_deg,
            within: self.within(),
            fit_s: FIT_PERIODS * self.starts.pace.period_s,
            longest_s: LONGEST_PERIODS * self.starts.pace.period_s,
            measured: run(measured),
            simulated: run(simulated),
            median_lyapunov_times: None,
        }
    }

    /// How far a prediction may be off, in words: an angle, and what is none in its own unit.
    fn within(&self) -> String {
        let (rig, bound) = self.of;
        let mut out = Vec::new();
        if self.shows_angle.contains(&true) {
            out.push(format!("{}°", shortest(self.settings.tolerance_deg)));
        }
        for (k, may) in self.tolerance.iter().enumerate().filter(|(k, _)| !self.shows_angle[*k]) {
            let channel = &rig.channel[bound.sensors[k]];
            let size = quantity(*may, channel.si_unit(), 2);
            let several = self.tolerance.len() > 1;
            out.push(if several { format!("{size} of {}", symbol_plain(&channel.measures)) } else { size });
        }
        out.join(" and ")
    }

    /// The model's coordinates, as pages label them.
    pub fn labels(&self) -> Vec<Labelled> {
        let (rig, bound) = self.of;
        let (units, _) = channel_units(&bound.model, rig, bound);
        let all = bound.model.coordinates.iter().zip(units).zip(&self.circle);
        all.map(|((c, unit), is_angle)| Labelled {
            name: c.name.clone(),
            // An angle has no dimension, and is in radians.
            unit: if *is_angle { "rad".to_owned() } else { unit.to_string() },
            is_angle: *is_angle,
            turns: *is_angle,
        })
        .collect()
    }

    /// The largest exponent of the driven model along a stretch, from its variational equations,
    /// with those of the two records. None for a free system, and under measured inputs, which end
    /// with their record.
    pub fn exponent(&self, stretch: &Stretch, state: &[f64], records: Option<Pair>) -> Option<ExponentComparison> {
        let Pace { period_s, omega } = self.starts.pace;
        let (of, start_s) = (&*self.equations.dynamics, stretch.start_s);
        let outside = Outside::drive(start_s, stretch.tau(0), omega);
        let flow = Flow::new(of, &self.equations.parameters, outside, self.starts.step_s);
        let is_driven = omega > 0.0 && stretch.inputs.is_empty();
        let follow = || model_exponent::of_model(&flow, of, &mut state.to_vec(), start_s, period_s, 100, 3000);
        let found = is_driven.then(follow)??;
        Some(ExponentComparison {
            model: found.per_interval / period_s,
            model_std_error: found.std_error / period_s,
            records,
        })
    }

    /// Catalogues side by side, and the record's best closing orbits refined on the model. None for
    /// a free system, and under measured inputs, which no orbit of the model has.
    pub fn orbits(
        &self,
        measured: &PhaseSpace,
        simulated: &PhaseSpace,
        record: RecordTrack<'_>,
        most: usize,
    ) -> Option<Orbits> {
        let driven_alone = record.stretches.iter().all(|s| s.inputs.is_empty());
        let found = measured.orbits.as_ref().filter(|_| driven_alone)?;
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
                refined: self.refine(record, o.start_s, o.period),
            })
            .collect();
        Some(Orbits {
            tolerance: found.settings.tolerance,
            measured: count(measured),
            simulated: count(simulated),
            refined,
            unit: one_unit(&self.labels()),
        })
    }

    fn refine(&self, record: RecordTrack<'_>, start_s: f64, period: usize) -> Option<RefinedOrbit> {
        let parameters = &self.equations.parameters;
        let track = record.track;
        let within = |s: &&Stretch| start_s >= s.start_s - 1e-9 && start_s < s.time(s.len());
        let (k, stretch) = record.stretches.iter().enumerate().find(|(_, s)| within(s))?;
        let first = ((start_s - stretch.start_s) / track.spacing_s).round() as usize;
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let problem = self.starts.problem(track, &at);
        let mut work = problem.room(false);
        let one = self.starts.samples(1.0, track);
        let mut offset = vec![0.0; self.circle.len()];
        let mut guess = Vec::with_capacity(period);
        for j in 0..period {
            let here = first + self.starts.samples(j as f64, track);
            if here + one > stretch.len() {
                return None;
            }
            let (piece, rough) = track.piece(k, here, one)?;
            let (mut state, _) = problem.fit_state(&piece, &rough, parameters, &[one / 2, one], &mut work)?;
            // Pieces lose their whole turns: put them back, so that one period leads to the next.
            for i in (0..offset.len()).filter(|i| self.circle[*i]) {
                let measured = stretch.coordinates[i][here];
                if j == 0 {
                    offset[i] = state[i] - measured;
                }
                state[i] += TAU * ((measured + offset[i] - state[i]) / TAU).round();
            }
            guess.push(state);
        }
        let outside = Outside::drive(stretch.time(first), stretch.tau(first), self.starts.pace.omega);
        let of = &*self.equations.dynamics;
        let flow = Flow::new(of, parameters, outside, self.starts.step_s);
        refine(&flow, of, &self.circle, &guess, stretch.time(first), self.starts.pace.period_s)
    }
}

/// The unit that all coordinates have; 1 where they have several.
fn one_unit(all: &[Labelled]) -> String {
    let first = all.first().map_or("1", |c| &c.unit);
    if all.iter().all(|c| c.unit == first) { first.to_owned() } else { "1".to_owned() }
}

/// Greatest less smallest value of what a sensor shows.
fn span(stretches: &[Stretch], weights: &[f64]) -> f64 {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for s in stretches {
        for i in 0..s.len() {
            let y: f64 = weights.iter().zip(&s.coordinates).map(|(w, x)| w * x[i]).sum();
            (low, high) = (low.min(y), high.max(y));
        }
    }
    (high - low).max(f64::MIN_POSITIVE)
}
