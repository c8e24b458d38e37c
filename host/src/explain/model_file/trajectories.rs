//! Residuals of trajectories: the model integrated over pieces of the record, each with an initial state of its own.
//!
//! With H, g a piece's normal matrix and gradient over the parameters after its state is eliminated (multiple shooting,
//! [`crate::identify::shooting::solve`]) and s what is left of its sum of squares, the residuals near parameters p are those of a
//! least-squares problem J λ = y with JᵀJ = H, Jᵀy = H p − g, yᵀy = pᵀHp − 2pᵀg + s. So what is lacking is weighed as predictions miss
//! it: a force that acts against the motion adds up over a piece, where in the balance of forces it is a small share beside those that do
//! not. Candidates enter with strength zero, from the solution without them.
//!
//! Pieces are as long as the model can follow: a block's length, halved until most pieces are followed to a fifth of their motion.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::fit::solve_signed;
use crate::identify::general::track::{Pieces, Track};
use crate::identify::shooting::problem::{Piece, Share};
use crate::identify::shooting::solve::{Reduced, reduce};
use crate::model::dynamics::Dynamics;
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;

/// Most samples that are followed.
const MOST_SAMPLES: usize = 60_000;
/// Fewest samples of a piece.
const FEWEST_SAMPLES: usize = 32;
/// Pieces by which a length is judged.
const SOME: usize = 12;
/// Residual over motion up to which a piece counts as followed: candidates are judged to first order about the trajectory, which takes a residual that is small
/// beside the motion.
const FOLLOWED: f64 = 0.1;
/// Rounds of Gauss and Newton, and shares of a step that are tried.
const ROUNDS: usize = 8;
const TRIALS: [f64; 5] = [1.0, 0.5, 0.25, 0.125, 0.031_25];
/// Share of the sum of squares below which a round is the last.
const CONVERGED: f64 = 1e-5;
/// Share of what a sensor shows to which solutions are exact.
const EXACT: f64 = 1e-4;
/// What stands for a drive's period in the search for the step of integration, s.
const PERIOD_S: f64 = 0.2;

/// The model's own coefficients over several records: each once, or once for each record.
#[derive(Clone, Debug)]
pub struct Columns {
    /// Their names.
    pub names: Vec<String>,
    /// For each record, the column of each of the model's coefficients.
    of_record: Vec<Vec<usize>>,
}

impl Columns {
    /// For a model and a number of records.
    pub fn new(model: &ModelFile, records: usize) -> Self {
        let mut names = Vec::new();
        let mut of_record = vec![Vec::new(); records.max(1)];
        for c in model.coefficients() {
            let own =
                records > 1 && model.equations.iter().flat_map(|e| &e.terms).any(|t| t.name == c && t.each_record);
            for (r, columns) in of_record.iter_mut().enumerate() {
                if own || r == 0 {
                    names.push(if own { format!("{c}_{}", r + 1) } else { c.clone() });
                }
                columns.push(names.len() - 1);
            }
        }
        Self { names, of_record }
    }

    /// Columns of all coefficients of equations of motion with `further` ones behind the model's own.
    fn map(&self, record: usize, further: usize) -> Vec<usize> {
        let own = self.of_record.get(record).or_else(|| self.of_record.first()).cloned().unwrap_or_default();
        own.into_iter().chain((0..further).map(|k| self.names.len() + k)).collect()
    }
}

/// Pieces with their states.
pub struct Trajectories<'a> {
    track: &'a Track<'a>,
    /// The model's own coefficients.
    pub columns: Columns,
    pieces: Vec<Piece>,
    record: Vec<usize>,
    /// Number of the block of each piece.
    block: Vec<usize>,
    /// Their initial states.
    pub states: Vec<Vec<f64>>,
    step_s: f64,
}

impl<'a> Trajectories<'a> {
    /// Pieces of `block_s` or shorter that the model with coefficients `x` (in the order of `columns`) can follow; none where there are none.
    pub fn new(
        track: &'a Track<'a>,
        columns: Columns,
        record_of: &[usize],
        motion: &EquationsOfMotion,
        x: &[f64],
        block_s: f64,
        least_s: f64,
    ) -> Option<Self> {
        let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
        let mut length = ((block_s / track.spacing_s).round() as usize).max(FEWEST_SAMPLES);
        let least = ((least_s / track.spacing_s).round() as usize).clamp(FEWEST_SAMPLES, length);
        loop {
            let guess = (length / 100).clamp(4, 16);
            let Pieces { pieces, guesses, stretch } = track.cut(length, guess)?;
            let record: Vec<usize> = stretch.iter().map(|s| record_of.get(*s).copied().unwrap_or(0)).collect();
            // Parameters of the first record stand for all in the search for a step.
            let first: Vec<f64> = columns.map(0, 0).iter().map(|c| x[*c]).collect();
            let longest_s = PERIOD_S.min(length as f64 * track.spacing_s);
            let step_s = track.step_s(motion, &pieces, &guesses, &first, (longest_s, EXACT));
            let problem = track.problem(motion, step_s, &at);
            let lengths = [length / 16, length / 4, length].map(|l| l.max(FEWEST_SAMPLES));
            let follow = |k: usize| {
                let p: Vec<f64> = columns.map(record[k], 0).iter().map(|c| x[*c]).collect();
                problem.fit_state(&pieces[k], &guesses[k], &p, &lengths, &mut problem.room(false))
            };
            let stride = pieces.len().div_ceil(SOME).max(1);
            let some: Vec<bool> = (0..pieces.len())
                .step_by(stride)
                .collect::<Vec<_>>()
                .into_par_iter()
                .map(|k| {
                    follow(k).is_some_and(|(_, mean)| mean < FOLLOWED * FOLLOWED * motion_power(&pieces[k], track))
                })
                .collect();
            let good = some.iter().filter(|f| **f).count();
            if good * 5 >= some.len() * 4 && good > 0 {
                // Long records: pieces spread evenly over them.
                let stride = (pieces.len() * length).div_ceil(MOST_SAMPLES).max(1);
                let kept: Vec<usize> = (0..pieces.len()).step_by(stride).collect();
                let found: Vec<Option<(Vec<f64>, f64)>> = kept.par_iter().map(|k| follow(*k)).collect();
                let mut out = Self {
                    track,
                    columns,
                    pieces: Vec::new(),
                    record: Vec::new(),
                    block: Vec::new(),
                    states: Vec::new(),
                    step_s,
                };
                let mut blocks: Vec<(usize, i64)> = Vec::new();
                for (k, found) in kept.into_iter().zip(found) {
                    let Some((state, _)) = found else { continue };
                    // Blocks are at least as long as pieces; pieces left out between two that are kept make none shorter.
                    let block = (
                        stretch[k],
                        (track.since_begin(stretch[k], &pieces[k]) / (block_s * stride as f64)).floor() as i64,
                    );
                    if blocks.last() != Some(&block) {
                        blocks.push(block);
                    }
                    out.block.push(blocks.len() - 1);
                    out.record.push(record[k]);
                    out.states.push(state);
                    out.pieces.push(pieces[k].clone());
                }
                return Some(out);
            }
            if length <= least {
                return None;
            }
            length = (length / 2).max(least);
        }
    }

    /// Shares of the normal equations of all pieces at parameters `x` and states.
    fn shares(&self, motion: &EquationsOfMotion, further: usize, x: &[f64], states: &[Vec<f64>]) -> Vec<Option<Share>> {
        let at = |t: f64, out: &mut [f64]| self.track.inputs(t, out);
        let problem = self.track.problem(motion, self.step_s, &at);
        (0..self.pieces.len())
            .into_par_iter()
            .map_init(
                || problem.room(true),
                |work, k| {
                    let p: Vec<f64> = self.columns.map(self.record[k], further).iter().map(|c| x[*c]).collect();
                    problem.share(&self.pieces[k], &states[k], &p, work)
                },
            )
            .collect()
    }

    /// Sum of squares of all pieces; infinite where one has no solution.
    fn cost(&self, motion: &EquationsOfMotion, further: usize, x: &[f64], states: &[Vec<f64>]) -> f64 {
        let at = |t: f64, out: &mut [f64]| self.track.inputs(t, out);
        let problem = self.track.problem(motion, self.step_s, &at);
        let costs: Vec<f64> = (0..self.pieces.len())
            .into_par_iter()
            .map_init(
                || problem.room(false),
                |work, k| {
                    let p: Vec<f64> = self.columns.map(self.record[k], further).iter().map(|c| x[*c]).collect();
                    problem.share(&self.pieces[k], &states[k], &p, work).map_or(f64::INFINITY, |s| s.cost())
                },
            )
            .collect();
        costs.iter().sum()
    }

    /// Gram matrices of all columns and the target, block by block, near parameters `x`; `further` columns stand behind the model's own.
    pub fn grams(&self, motion: &EquationsOfMotion, further: usize, x: &[f64]) -> Option<Vec<DMatrix<f64>>> {
        let states = 2 * motion.degrees_of_freedom();
        let shares = self.shares(motion, further, x, &self.states);
        let size = x.len() + 1;
        let mut out = vec![DMatrix::zeros(size, size); self.block.last()? + 1];
        for (k, share) in shares.iter().enumerate() {
            let share = share.as_ref()?;
            let reduced = reduce(share, states, 0.0)?;
            self.put(&reduced, share, k, further, x, &mut out[self.block[k]]);
        }
        Some(out)
    }

    fn put(&self, reduced: &Reduced, share: &Share, piece: usize, further: usize, x: &[f64], into: &mut DMatrix<f64>) {
        let map = self.columns.map(self.record[piece], further);
        let p = DVector::from_iterator(map.len(), map.iter().map(|c| x[*c]));
        let hp = &reduced.normal * &p;
        let last = into.nrows() - 1;
        for (i, &a) in map.iter().enumerate() {
            for (j, &b) in map.iter().enumerate() {
                into[(a, b)] += reduced.normal[(i, j)];
            }
            let target = hp[i] - reduced.gradient[i];
            into[(a, last)] += target;
            into[(last, a)] += target;
        }
        into[(last, last)] += p.dot(&hp) - 2.0 * p.dot(&reduced.gradient) + share.cost() - reduced.own_gain();
    }

    /// Fits parameters and states from `x` on, each parameter with its sign (0: any).
    pub fn settle(
        &mut self,
        motion: &EquationsOfMotion,
        further: usize,
        mut x: Vec<f64>,
        signs: &[f64],
    ) -> Option<Vec<f64>> {
        let n = 2 * motion.degrees_of_freedom();
        x.iter_mut().zip(signs).for_each(|(x, s)| {
            if *x * s < 0.0 {
                *x = 0.0;
            }
        });
        for _ in 0..ROUNDS {
            let shares: Vec<Share> =
                self.shares(motion, further, &x, &self.states).into_iter().collect::<Option<_>>()?;
            let cost: f64 = shares.iter().map(Share::cost).sum();
            let reduced: Vec<Reduced> = shares.iter().map(|s| reduce(s, n, 0.0)).collect::<Option<_>>()?;
            let mut total = DMatrix::zeros(x.len() + 1, x.len() + 1);
            for (k, (r, s)) in reduced.iter().zip(&shares).enumerate() {
                self.put(r, s, k, further, &x, &mut total);
            }
            let (target, _) = solve_signed(&total, signs)?;
            let moved = TRIALS.iter().find_map(|share| {
                let trial: Vec<f64> = x.iter().zip(target.iter()).map(|(a, b)| a + share * (b - a)).collect();
                let states: Vec<Vec<f64>> = reduced
                    .iter()
                    .enumerate()
                    .map(|(k, r)| {
                        let map = self.columns.map(self.record[k], further);
                        let step = DVector::from_iterator(map.len(), map.iter().map(|c| trial[*c] - x[*c]));
                        let own = r.own_step(&step);
                        self.states[k].iter().zip(own.iter()).map(|(a, b)| a + b).collect()
                    })
                    .collect();
                let new = self.cost(motion, further, &trial, &states);
                (new.is_finite() && new < cost).then_some((trial, states, new))
            });
            let Some((trial, states, new)) = moved else { break };
            (x, self.states) = (trial, states);
            if cost - new < CONVERGED * cost {
                break;
            }
        }
        Some(x)
    }
}

/// Mean square of a piece's motion about its mean, in units of the noise.
pub(super) fn motion_power(piece: &Piece, track: &Track<'_>) -> f64 {
    let m = track.sensors.len();
    let count = (piece.measured.len() / m.max(1)).max(1) as f64;
    let sum: f64 = (0..m)
        .map(|k| {
            let of = || piece.measured.iter().skip(k).step_by(m);
            let mean = of().sum::<f64>() / count;
            of().map(|x| ((x - mean) / track.sigma[k]).powi(2)).sum::<f64>()
        })
        .sum();
    sum / (count * m.max(1) as f64)
}
