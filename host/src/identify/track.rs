//! Records of a model file as pieces for shooting: sensors, their noise, inputs between the
//! samples.
//!
//! Without inputs the stretches of one record keep their times. Otherwise they are laid behind one
//! another on one axis of time, so that measured inputs, which are looked up by time, are those of
//! the right record.

use core::f64::consts::TAU;

use super::history::between_samples;
use super::remeasured::Sensors;
use super::shooting::problem::{Piece, Problem};
use super::shooting::run::integration_step;
use super::shooting::track::{Geometry, MeasuredStretch, cut};
use super::shooting::zeros::{Moment, Zeros};
use super::stretches::{Stretch, mixed};
use crate::model::dynamics::Dynamics;
use crate::model::flow::Inputs;
use crate::model::integrate::Outside;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::signal::band_limited::BandLimited;

/// Time between two stretches on the common axis, s.
const APART_S: f64 = 10.0;
/// Least noise of a sensor, relative to what it shows.
const LEAST_NOISE: f64 = 1e-9;

/// What acts on the system along a stretch: its inputs between their samples, and the phase.
pub struct ExogenousInputs {
    inputs: Vec<BandLimited>,
    /// States of effects that were followed along the record, behind the inputs.
    remembered: Vec<Vec<f64>>,
    step_s: f64,
    start_s: f64,
    tau: f64,
    omega: f64,
}

impl ExogenousInputs {
    /// For a stretch and a drive of angular frequency `omega` (0 for a free system).
    pub fn new(s: &Stretch, omega: f64) -> Self {
        Self::remembering(s, omega, &[])
    }

    /// The same with followed states of effects, by their numbers, behind the inputs.
    pub fn remembering(s: &Stretch, omega: f64, numbers: &[usize]) -> Self {
        Self {
            inputs: s.inputs.iter().map(|x| BandLimited::new(x, s.start_s, s.step_s)).collect(),
            remembered: numbers.iter().map(|k| s.remembered(*k, 0, s.len())).collect(),
            step_s: s.step_s,
            start_s: s.start_s,
            tau: if s.is_empty() { 0.0 } else { s.tau(0) },
            omega,
        }
    }

    /// Number of inputs, followed states among them.
    pub fn count(&self) -> usize {
        self.inputs.len() + self.remembered.len()
    }
}

impl Outside for ExogenousInputs {
    fn tau(&self, time: f64) -> f64 {
        self.tau + self.omega * (time - self.start_s)
    }

    fn inputs(&self, time: f64, out: &mut [f64]) {
        out.iter_mut().zip(&self.inputs).for_each(|(o, i)| *o = i.value(time));
        let at = ((time - self.start_s) / self.step_s).max(0.0);
        let between = |x: &[f64]| {
            // Not below 0; the cast cuts the fraction, or saturates far beyond the end.
            let i = (at as usize).min(x.len().saturating_sub(2));
            let (a, b) = (x.get(i).copied().unwrap_or(f64::NAN), x.get(i + 1).or(x.last()).copied());
            let b = b.unwrap_or(a);
            let before = i.checked_sub(1).map_or(2.0 * a - b, |i| x[i]);
            let after = x.get(i + 2).copied().unwrap_or(2.0 * b - a);
            between_samples([before, a, b, after], (at - i as f64).min(1.0))
        };
        out.iter_mut().skip(self.inputs.len()).zip(&self.remembered).for_each(|(o, x)| *o = between(x));
    }
}

/// Pieces of a record with their guessed states.
pub struct Pieces {
    /// Pieces.
    pub pieces: Vec<Piece>,
    /// First guess of each one's state.
    pub guesses: Vec<Vec<f64>>,
}

/// All stretches on one axis of time.
pub struct Track<'a> {
    /// What each sensor shows of the coordinates, states of effects behind them.
    pub sensors: Vec<Vec<f64>>,
    /// Numbers of the states that are followed with the motion.
    hidden: Vec<usize>,
    /// Noise of each sensor.
    pub sigma: Vec<f64>,
    /// Spacing of the samples, s.
    pub spacing_s: f64,
    /// Rms of what each sensor shows.
    size: Vec<f64>,
    omega: f64,
    inputs: usize,
    exogenous: &'a [ExogenousInputs],
    stretches: &'a [Stretch],
    bound: &'a ObservedModel,
    /// Where each stretch begins on the axis, s, and how long before that its inputs are asked for
    /// at most: stretches with times of their own may lie close to one another.
    begins: Vec<f64>,
    early_s: f64,
    /// States that are known better than from the sensors' slopes, by stretch and sample.
    known: Option<KnownStates<'a>>,
}

/// Coordinates and rates by stretch and sample, where they are known.
pub type KnownStates<'a> = &'a (dyn Fn(usize, usize) -> Option<Vec<f64>> + Sync);

impl<'a> Track<'a> {
    /// Lays out the stretches; `exogenous` is one for each.
    pub fn new(
        stretches: &'a [Stretch],
        exogenous: &'a [ExogenousInputs],
        rig: &Rig,
        bound: &'a ObservedModel,
        noise: &Sensors,
    ) -> Self {
        let spacing_s = stretches.first().map_or(1.0 / rig.sample_rate_hz, |s| s.step_s);
        // Stretches of one record keep their own times, so that what drifts does so along it.
        let own = bound.inputs.is_empty() && stretches.windows(2).all(|s| s[1].start_s > s[0].start_s);
        let mut at = 0.0;
        let begins = stretches
            .iter()
            .map(|s| {
                let begin = if own { s.start_s } else { at };
                at += s.len() as f64 * s.step_s + APART_S;
                begin
            })
            .collect();
        let sensors: Vec<Vec<f64>> =
            (0..bound.sensors.len()).map(|r| bound.shown.row(r).iter().copied().collect()).collect();
        let mut squares = vec![(0.0, 0.0_f64); sensors.len()];
        for s in stretches {
            for (sum, x) in squares.iter_mut().zip(s.sensors(bound)) {
                sum.0 += x.iter().map(|x| x * x).sum::<f64>();
                sum.1 += x.len() as f64;
            }
        }
        let size: Vec<f64> = squares.iter().map(|(sum, count)| (sum / count.max(1.0)).sqrt()).collect();
        let sigma = (0..sensors.len())
            .map(|k| {
                let sigma = noise.count[k].map_or(noise.sigma[k], |q| q / 12f64.sqrt());
                // A sensor without noise is not possible; without a scale the weights would be
                // infinite.
                sigma.max(LEAST_NOISE * size[k]).max(1e-12)
            })
            .collect();
        let omega = rig.drive.map_or(0.0, |d| TAU * d.frequency_hz);
        let hidden = Vec::new();
        Self {
            hidden,
            sensors,
            sigma,
            spacing_s,
            size,
            omega,
            inputs: exogenous.first().map_or(bound.inputs.len(), ExogenousInputs::count),
            exogenous,
            stretches,
            bound,
            begins,
            early_s: if own { 0.5 * spacing_s } else { 0.5 * APART_S },
            known: None,
        }
    }

    /// With guesses of states from what is known.
    #[must_use]
    pub fn knowing(self, known: KnownStates<'a>) -> Self {
        Self { known: Some(known), ..self }
    }

    /// For equations that follow some states of effects with the motion: no sensor shows them.
    #[must_use]
    pub fn hiding(mut self, numbers: Vec<usize>) -> Self {
        let n = self.bound.model.coordinates.len();
        self.sensors.iter_mut().for_each(|s| s.resize(n + numbers.len(), 0.0));
        self.hidden = numbers;
        self
    }

    /// What the sensors show of the model's own coordinates.
    fn shown(&self) -> Vec<Vec<f64>> {
        let n = self.bound.model.coordinates.len();
        self.sensors.iter().map(|s| s[..n].to_vec()).collect()
    }

    /// Inputs at a time of the axis.
    pub fn inputs(&self, time: f64, out: &mut [f64]) {
        let k = self.begins.partition_point(|b| *b <= time + self.early_s).saturating_sub(1);
        if let (Some(exogenous), Some(begin)) = (self.exogenous.get(k), self.begins.get(k)) {
            exogenous.inputs(time - begin + exogenous.start_s, out);
        }
    }

    /// Pieces of `length` samples; none where the sensors do not give the coordinates.
    pub fn cut(&self, length: usize, guess: usize) -> Option<Pieces> {
        let angles = self.bound.model.circle();
        let shown = self.shown();
        let geometry = Geometry { sensors: &shown, angles: &angles, spacing_s: self.spacing_s, guess };
        let mut out = Pieces { pieces: Vec::new(), guesses: Vec::new() };
        for (k, s) in self.stretches.iter().enumerate() {
            let measured = MeasuredStretch {
                start_s: self.begins[k],
                sensors: s.sensors(self.bound),
                tau: Box::new(move |i| s.tau(i)),
            };
            let (pieces, mut guesses) = cut(&[measured], &geometry, length, (length / 4).max(16))?;
            for (piece, guess) in pieces.iter().zip(&mut guesses) {
                let since_s = piece.start_s - self.begins[k];
                // Not negative; rounded.
                self.improve(k, (since_s / self.spacing_s).round() as usize, guess);
            }
            out.pieces.extend(pieces.into_iter().map(|p| Piece { stretch: k, ..p }));
            out.guesses.extend(guesses);
        }
        Some(out)
    }

    /// The step of integration at which solutions over some pieces are exact to the noise, or to a
    /// share `exact` of what each sensor shows where that is more: noise may be as good as nothing.
    pub fn step_s<D: Dynamics + ?Sized>(
        &self,
        dynamics: &D,
        pieces: &[Piece],
        guesses: &[Vec<f64>],
        parameters: &[f64],
        longest_s: f64,
        exact: f64,
    ) -> f64 {
        let at = |t: f64, out: &mut [f64]| self.inputs(t, out);
        let sigma: Vec<f64> = self.sigma.iter().zip(&self.size).map(|(s, x)| s.max(exact * x)).collect();
        let problem = Problem { sigma: &sigma, ..self.problem(dynamics, longest_s, &at) };
        integration_step(&problem, pieces, guesses, parameters, longest_s)
    }

    /// One piece of a stretch, with the guess of its state.
    pub fn piece(&self, stretch: usize, first: usize, count: usize) -> Option<(Piece, Vec<f64>)> {
        let angles = self.bound.model.circle();
        let guess = (count / 16).clamp(3, 8);
        let shown = self.shown();
        let geometry = Geometry { sensors: &shown, angles: &angles, spacing_s: self.spacing_s, guess };
        let s = self.stretches.get(stretch)?;
        let part: Vec<Vec<f64>> = s.coordinates.iter().map(|x| x[first..first + count].to_vec()).collect();
        let start_s = self.begins[stretch] + first as f64 * self.spacing_s;
        let sensors = mixed(&self.bound.shown, &part);
        let measured = MeasuredStretch { start_s, sensors, tau: Box::new(move |i| s.tau(first + i)) };
        let (mut pieces, mut guesses) = cut(&[measured], &geometry, count, count)?;
        let mut guess = guesses.pop()?;
        self.improve(stretch, first, &mut guess);
        Some((Piece { stretch, ..pieces.pop()? }, guess))
    }

    /// Whether the state at a sample of a stretch is known better than from the sensors' slopes.
    pub fn is_known(&self, stretch: usize, first: usize) -> bool {
        self.known_state(stretch, first).is_some()
    }

    fn known_state(&self, stretch: usize, first: usize) -> Option<Vec<f64>> {
        let known = self.known?;
        known(stretch, first).filter(|k| k.len() == 2 * self.bound.model.coordinates.len())
    }

    /// Puts what is known into a guess at a sample of a stretch, if it is, and the states that are
    /// followed with the motion: each is the rate of a coordinate that nothing shows.
    fn improve(&self, stretch: usize, first: usize, guess: &mut Vec<f64>) {
        let Some(s) = self.stretches.get(stretch) else { return };
        if let Some(known) = self.known_state(stretch, first) {
            let circle = self.bound.model.circle();
            for (k, (to, x)) in guess.iter_mut().zip(known).enumerate() {
                // Pieces begin in the first turn.
                let turns = if circle.get(k).is_some_and(|c| *c) { ((*to - x) / TAU).round() } else { 0.0 };
                *to = x + TAU * turns;
            }
        }
        let n = guess.len() / 2;
        guess.splice(n..n, self.hidden.iter().map(|_| 0.0));
        guess.extend(self.hidden.iter().map(|k| s.remembered(*k, first, 1)[0]));
    }

    /// Stretches.
    pub fn stretches(&self) -> usize {
        self.stretches.len()
    }

    /// Samples of a stretch.
    pub fn samples(&self, stretch: usize) -> usize {
        self.stretches.get(stretch).map_or(0, Stretch::len)
    }

    /// Whether something from outside acts on the system.
    pub fn is_driven(&self) -> bool {
        !self.bound.inputs.is_empty() || self.omega > 0.0
    }

    /// Time from the beginning of its stretch to a piece, s.
    pub fn since_begin(&self, piece: &Piece) -> f64 {
        piece.start_s - self.begins[piece.stretch]
    }

    /// A piece's beginning, its state being a guess.
    pub fn moment(&self, piece: &Piece, state: &[f64]) -> Moment {
        let mut inputs = vec![0.0; self.inputs];
        self.inputs(piece.start_s, &mut inputs);
        Moment { state: state.to_vec(), time: piece.start_s, tau: piece.tau, inputs }
    }

    /// The least-squares problem; `at` is [`Track::inputs`].
    pub fn problem<'b, D: Dynamics + ?Sized>(
        &'b self,
        dynamics: &'b D,
        step_s: f64,
        at: &'b (dyn Fn(f64, &mut [f64]) + Sync),
    ) -> Problem<'b, D> {
        Problem {
            dynamics,
            sensors: &self.sensors,
            sigma: &self.sigma,
            spacing_s: self.spacing_s,
            step_s,
            omega: self.omega,
            inputs: (self.inputs > 0).then_some(Inputs { count: self.inputs, at }),
            zeros: Zeros::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::signal::angles::Phase;

    /// A record with a tenth of a second missing: what is remembered a second before the gap is that
    /// of the stretch before it.
    #[test]
    fn inputs_before_a_short_gap_are_those_of_their_own_stretch() {
        let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs");
        let rig = Rig::read(rigs.join("double-pendulum-from-bodies.toml")).unwrap();
        let bound = rig.bound.as_ref().unwrap();
        let step_s = 1.0 / rig.sample_rate_hz;
        let count = 1001;
        let stretch = |start_s: f64| Stretch {
            start_s,
            step_s,
            coordinates: vec![vec![0.1; count]; 2],
            inputs: Vec::new(),
            phase: Phase::Clock(rig.omega()),
            amplitude_nm: None,
            history: None,
            base: None,
        };
        let end_s = (count - 1) as f64 * step_s;
        let stretches = [stretch(0.0), stretch(end_s + 0.1)];
        let exogenous: Vec<ExogenousInputs> = stretches
            .iter()
            .zip([1.0, 2.0])
            .map(|(s, z)| ExogenousInputs { remembered: vec![vec![z; count]], ..ExogenousInputs::new(s, rig.omega()) })
            .collect();
        let noise =
            Sensors { count: vec![None; 2], sigma: vec![1e-3; 2], square_error: vec![0.0; 2], inputs: Vec::new() };
        let track = Track::new(&stretches, &exogenous, &rig, bound, &noise);
        let at = |time: f64| {
            let mut out = [0.0];
            track.inputs(time, &mut out);
            out[0]
        };
        assert_eq!([0.0, end_s - 1.0, end_s, end_s + 0.1, end_s + 1.0].map(at), [1.0, 1.0, 1.0, 2.0, 2.0]);
    }
}
