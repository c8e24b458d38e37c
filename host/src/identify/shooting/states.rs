//! Initial states of pieces with the parameters held: least squares by Levenberg and Marquardt, one
//! piece alone or many side by side.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::problem::{Piece, Problem, Share};
use super::solve::damped;
use crate::model::flow::abreast::{ABREAST, Outside, Steps, VectorField};
use crate::model::model_file::equations_of_motion::EquationsOfMotion;

/// What a step of a state still promises, in squared standard errors, at which its fit stops: a
/// tenth of one.
const STILL: f64 = 1e-2;
/// Most steps over one length.
const ROUNDS: usize = 20;
/// The search for one piece's state over longer and longer beginnings.
pub struct Search {
    /// Samples, the next last.
    lengths: Vec<usize>,
    /// The best so far, with its share of the normal equations.
    state: Vec<f64>,
    share: Option<Share>,
    /// What is tried next.
    trial: Vec<f64>,
    damping: f64,
    rounds: usize,
    /// Σ r² and samples where the last length ended.
    left: Option<(f64, usize)>,
}

impl Search {
    /// From a guess, over beginnings of some lengths of `all` samples.
    pub fn new(start: &[f64], lengths: &[usize], all: usize) -> Self {
        let mut lengths: Vec<usize> = lengths.iter().map(|l| (*l).min(all)).collect();
        lengths.dedup();
        lengths.reverse();
        let (state, trial) = (start.to_vec(), start.to_vec());
        Self { lengths, state, share: None, trial, damping: 0.0, rounds: 0, left: None }
    }

    /// The length and the state at which a share is wanted next; none at the end.
    pub fn wanted(&self) -> Option<(usize, &[f64])> {
        self.lengths.last().map(|l| (*l, &self.trial[..]))
    }

    /// Takes the share that was wanted, none where the equations have no solution.
    pub fn take(&mut self, share: Option<Share>) {
        match (&self.share, share) {
            (None, None) => {
                (self.lengths, self.left) = (Vec::new(), None);
                return;
            }
            (None, Some(first)) => {
                self.share = Some(first);
                (self.damping, self.rounds) = (1e-6, 0);
            }
            (Some(old), Some(new)) if new.cost() < old.cost() => {
                self.state.clone_from(&self.trial);
                self.share = Some(new);
                self.damping = (self.damping * 0.1_f64).max(1e-9);
            }
            _ if self.damping < 1e6 => self.damping = (self.damping * 10.0).max(1e-4),
            _ => return self.end(),
        }
        match self.step() {
            Some(trial) => self.trial = trial,
            None => self.end(),
        }
    }

    /// The next trial; none where nothing more is to be gained over this length.
    fn step(&mut self) -> Option<Vec<f64>> {
        if self.rounds == ROUNDS {
            return None;
        }
        self.rounds += 1;
        let share = self.share.as_ref()?;
        let mut normal = share.normal.clone();
        (0..normal.nrows()).for_each(|i| normal[(i, i)] = damped(normal[(i, i)], self.damping));
        let step = normal.cholesky()?.solve(&share.gradient);
        // In units of the residuals' scatter, which is the noise's at least: what this step still
        // promises.
        let unit = (share.cost() / (share.samples * share.squares.len()).max(1) as f64).max(1.0);
        let trial = || self.state.iter().zip(step.iter()).map(|(x, d)| x - d).collect();
        (step.dot(&share.gradient) >= STILL * unit).then(trial)
    }

    /// Ends one length and goes on with the next.
    fn end(&mut self) {
        self.left = self.share.take().map(|s| (s.cost(), s.samples));
        self.trial.clone_from(&self.state);
        let _ = self.lengths.pop();
    }

    /// The state and the mean square residual that is left, over `sensors`.
    pub fn found(self, sensors: usize) -> Option<(Vec<f64>, f64)> {
        let (cost, samples) = self.left?;
        Some((self.state, cost / (samples * sensors) as f64))
    }
}

/// A piece that is followed beside others.
struct Lane<'a> {
    piece: &'a Piece,
    samples: usize,
    state: Vec<f64>,
    /// Derivatives by the first state, 2n × 2n row after row.
    slopes: Vec<f64>,
    /// Products of the derivatives of what the sensors show and of the residual, row after row.
    sums: Vec<f64>,
    squares: Vec<f64>,
    exists: bool,
}

impl Lane<'_> {
    /// Goes on by one step, whose state and derivatives by its beginning are in a column of
    /// `steps`.
    fn carry(&mut self, steps: &Steps, i: usize) {
        let m = self.state.len();
        self.exists = steps.exists[i];
        self.state.iter_mut().enumerate().for_each(|(c, x)| *x = steps.value(c, i));
        let before = core::mem::take(&mut self.slopes);
        let of =
            |row: usize, c: usize| -> f64 { (0..m).map(|j| steps.value(m + row * m + j, i) * before[j * m + c]).sum() };
        self.slopes = (0..m * m).map(|k| of(k / m, k % m)).collect();
    }
}

impl Problem<'_, EquationsOfMotion> {
    /// States of many pieces with the parameters held, each over the lengths that go with it
    /// ([`Problem::fit_state`]): side by side where the step of integration is not longer than the
    /// samples' spacing and all zeros are known.
    pub fn fit_states(
        &self,
        pieces: &[Piece],
        starts: &[Vec<f64>],
        parameters: &[f64],
        lengths: &(dyn Fn(usize) -> Vec<usize> + Sync),
    ) -> Vec<Option<(Vec<f64>, f64)>> {
        let abreast = self.dynamics.goes_abreast() && self.zeros.count == 0;
        if self.step_s > self.spacing_s * (1.0 + 1e-9) || !abreast {
            let one = |work: &mut _, k: usize| self.fit_state(&pieces[k], &starts[k], parameters, &lengths(k), work);
            return (0..pieces.len()).into_par_iter().map_init(|| self.room(false), one).collect();
        }
        let sensors = self.sensors.len().max(1);
        // Batches of one size: they go at once.
        let size = pieces.len().div_ceil(pieces.len().div_ceil(ABREAST).max(1)).max(1);
        let batches: Vec<Vec<_>> = (0..pieces.len().div_ceil(size))
            .into_par_iter()
            .map(|b| {
                let numbers = b * size..((b + 1) * size).min(pieces.len());
                let search = |k: usize| Search::new(&starts[k], &lengths(k), pieces[k].measured.len() / sensors);
                let mut all: Vec<(usize, Search)> = numbers.map(|k| (k, search(k))).collect();
                let mut steps = Steps::new(self.dynamics);
                loop {
                    let (mut open, mut lanes) = (Vec::new(), Vec::new());
                    for (k, search) in &mut all {
                        let Some(lane) = search.wanted().map(|(samples, state)| self.lane(&pieces[*k], samples, state))
                        else {
                            continue;
                        };
                        lanes.push(lane);
                        open.push(search);
                    }
                    if open.is_empty() {
                        break;
                    }
                    let shares = self.followed(lanes, parameters, &mut steps);
                    open.into_iter().zip(shares).for_each(|(search, share)| search.take(share));
                }
                all.into_iter().map(|s| s.1.found(sensors)).collect()
            })
            .collect();
        batches.into_iter().flatten().collect()
    }

    /// A piece from a state on.
    fn lane<'p>(&self, piece: &'p Piece, samples: usize, state: &[f64]) -> Lane<'p> {
        let m = self.states();
        Lane {
            piece,
            samples,
            state: state.to_vec(),
            slopes: DMatrix::<f64>::identity(m, m).as_slice().to_vec(),
            sums: vec![0.0; (m + 1) * (m + 1)],
            squares: vec![0.0; self.sensors.len()],
            exists: true,
        }
    }

    /// Shares of the normal equations of pieces that are followed side by side.
    fn followed(&self, mut lanes: Vec<Lane<'_>>, parameters: &[f64], steps: &mut Steps) -> Vec<Option<Share>> {
        let nothing = |_: f64, _: &mut [f64]| {};
        let (inputs, at) = self.inputs.map_or((0, &nothing as &(dyn Fn(f64, &mut [f64]) + Sync)), |i| (i.count, i.at));
        let outside = Outside { omega: self.omega, inputs, at };
        let each = (self.spacing_s / self.step_s - 1e-9).ceil().max(1.0) as usize;
        let h = self.spacing_s / each as f64;
        let longest = lanes.iter().map(|l| l.samples).max().unwrap_or(0);
        for k in 0..longest {
            let mut on: Vec<&mut Lane<'_>> = lanes.iter_mut().filter(|l| l.exists && k < l.samples).collect();
            on.iter_mut().for_each(|l| self.add(l, k));
            on.retain(|l| k + 1 < l.samples);
            for j in 0..each {
                on.retain(|l| l.exists);
                let after = (k * each + j) as f64 * h;
                let begins: Vec<(f64, f64)> =
                    on.iter().map(|l| (l.piece.start_s + after, l.piece.tau + self.omega * after)).collect();
                steps.set(on.iter().map(|l| &l.state[..]));
                let field = VectorField { motion: self.dynamics, parameters };
                steps.carry(field, |i| begins[i], &outside, h);
                on.iter_mut().enumerate().for_each(|(i, l)| l.carry(steps, i));
            }
        }
        lanes.into_iter().map(share).collect()
    }

    /// Adds a sample's residuals and their derivatives to a piece's sums.
    fn add(&self, lane: &mut Lane<'_>, k: usize) {
        let m = lane.state.len();
        let mut row = vec![0.0; m + 1];
        for (s, (weights, sigma)) in self.sensors.iter().zip(self.sigma).enumerate() {
            row.fill(0.0);
            row[m] = -lane.piece.measured[k * self.sensors.len() + s] / sigma;
            for (j, w) in weights.iter().enumerate().filter(|w| *w.1 != 0.0) {
                row[m] += w * lane.state[j] / sigma;
                let by = &lane.slopes[j * m..(j + 1) * m];
                row.iter_mut().zip(by).for_each(|(o, d)| *o += w / sigma * d);
            }
            lane.squares[s] += row[m] * row[m];
            for (a, line) in lane.sums.chunks_exact_mut(m + 1).enumerate() {
                let x = row[a];
                line[a..].iter_mut().zip(&row[a..]).for_each(|(sum, y)| *sum += x * y);
            }
        }
    }
}

/// What a piece that was followed to its end gives.
fn share(lane: Lane<'_>) -> Option<Share> {
    let (m, width) = (lane.state.len(), lane.state.len() + 1);
    let at = |a: usize, b: usize| lane.sums[a.min(b) * width + a.max(b)];
    (lane.exists && lane.squares.iter().all(|s| s.is_finite())).then(|| Share {
        normal: DMatrix::from_fn(m, m, at),
        gradient: DVector::from_fn(m, |a, _| at(a, m)),
        squares: lane.squares.clone(),
        samples: lane.samples,
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::identify::shooting::zeros::Zeros;
    use crate::model::flow::{self, Flow, Work};
    use crate::model::model_file::ModelFile;

    const TEXT: &str = "name = \"m\"\ncoordinates = [{ name = \"p\", space = \"S1\" }]\n\
        [[equation]]\nbalance = \"-p''\"\nterms = { g = \"sin(p)\", c = \"p'\", f = \"sign(p')\", a = \"cos(tau)\" }\n";
    const SPACING_S: f64 = 0.02;
    const OMEGA: f64 = 3.0;

    /// States side by side are those that are found one by one, dry friction's reversals, pieces of
    /// other lengths and one that the model does not follow among them.
    #[test]
    fn states_side_by_side_are_those_found_one_by_one() {
        let model = ModelFile::parse(TEXT, Path::new("m.toml")).unwrap();
        let motion = EquationsOfMotion::new(&model, OMEGA).unwrap();
        let parameters = [9.0, 0.1, 0.5, 2.0];
        let mut pieces: Vec<Piece> = Vec::new();
        for k in 0..40_usize {
            let (start_s, tau, count) = (0.3 * k as f64, 0.7 * k as f64, if k.is_multiple_of(7) { 30 } else { 60 });
            let flow = Flow::new(&motion, &parameters, flow::Outside::drive(start_s, tau, OMEGA), SPACING_S);
            let mut work = Work::plain(&motion);
            work.set(&[0.1 * k as f64 - 2.0, (k as f64).sin()]);
            let mut measured = Vec::new();
            assert!(flow.samples(&mut work, start_s, SPACING_S, count, |i, x| {
                measured.push(x[0] + 1e-4 * (7.0 * (i + k) as f64).sin());
            }));
            pieces.push(Piece { start_s, tau, stretch: 0, measured });
        }
        pieces[5].measured[3] = f64::NAN;
        let starts: Vec<Vec<f64>> = (0..pieces.len()).map(|k| vec![pieces[k].measured[0] + 1e-3, 0.0]).collect();
        let sensors = [vec![1.0]];
        let problem = |step_s: f64| Problem {
            dynamics: &motion,
            sensors: &sensors,
            sigma: &[1e-4],
            spacing_s: SPACING_S,
            step_s,
            omega: OMEGA,
            inputs: None,
            zeros: Zeros::default(),
        };
        let lengths = |k: usize| if k.is_multiple_of(2) { vec![15, 60] } else { vec![60] };
        for step_s in [SPACING_S, 0.4 * SPACING_S] {
            let problem = problem(step_s);
            let found = problem.fit_states(&pieces, &starts, &parameters, &lengths);
            let mut room = problem.room(false);
            for (k, found) in found.iter().enumerate() {
                let alone = problem.fit_state(&pieces[k], &starts[k], &parameters, &lengths(k), &mut room);
                assert_eq!(found.is_some(), k != 5, "{k}");
                assert_eq!(alone.is_some(), k != 5, "{k}");
                let (Some((state, left)), Some((expected, power))) = (found, alone) else { continue };
                let noise = |x: &[f64]| (x[0] - expected[0]).abs().max((x[1] - expected[1]).abs());
                // A thousandth of the noise, and of its power: each may end a small step apart.
                assert!(noise(state) < 1e-7, "{k}: {state:?} {expected:?}");
                assert!((left / power - 1.0).abs() < 1e-3 && power < 2.0, "{k}: {left} {power}");
            }
        }
    }
}
