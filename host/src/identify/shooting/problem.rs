//! The least-squares problem of multiple shooting: pieces of a record, each with an initial state
//! of its own, and shared parameters.
//!
//! Minimise ½ Σ_s Σ_i Σ_k ((m_k·q(t_i; x_s, p) + z_k − y_ki)/σ_k)² over the initial states x_s (2n
//! each) and the parameters, p of the equations and behind them z of the sensors' unknown zeros,
//! where m_k·q + z_k is what sensor k shows. Each piece gives its share of the normal equations,
//! [J_x J_p J_z r]ᵀ[J_x J_p J_z r], from the state and its variational equations.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::states::Search;
use super::zeros::Zeros;

use crate::model::dynamics::Dynamics;
use crate::model::flow::{Flow, Inputs, Outside, Work};

/// A stretch of the record that is followed from one initial state.
#[derive(Clone, Debug)]
pub struct Piece {
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Phase of the drive there, rad.
    pub tau: f64,
    /// Stretch of the record from which it is.
    pub stretch: usize,
    /// Measured values, sensor after sensor for each sample.
    pub measured: Vec<f64>,
}

/// What is the same for all pieces.
pub struct Problem<'a, D: Dynamics + ?Sized> {
    /// Equations.
    pub dynamics: &'a D,
    /// What each sensor measures: weights of the coordinates.
    pub sensors: &'a [Vec<f64>],
    /// Standard deviation of each sensor's noise.
    pub sigma: &'a [f64],
    /// Spacing of the samples, s.
    pub spacing_s: f64,
    /// Longest step of integration, s.
    pub step_s: f64,
    /// Angular frequency of the drive, rad/s; 0 for a free system.
    pub omega: f64,
    /// Measured inputs.
    pub inputs: Option<Inputs<'a>>,
    /// Sensors' zeros that are unknown.
    pub zeros: Zeros<'a>,
}

/// A piece's share of the normal equations.
#[derive(Clone, Debug)]
pub struct Share {
    /// JᵀJ over states and parameters together (2n + P), or over the states alone.
    pub normal: DMatrix<f64>,
    /// Jᵀr.
    pub gradient: DVector<f64>,
    /// Σ r² of each sensor, in units of its σ².
    pub squares: Vec<f64>,
    /// Samples.
    pub samples: usize,
}

impl Share {
    /// Σ r² over all sensors.
    pub fn cost(&self) -> f64 {
        self.squares.iter().sum()
    }
}

impl<D: Dynamics + ?Sized> Problem<'_, D> {
    /// Coordinates and rates: 2n.
    pub fn states(&self) -> usize {
        2 * self.dynamics.degrees_of_freedom()
    }

    fn flow<'b>(&'b self, piece: &Piece, parameters: &'b [f64]) -> Flow<'b, D> {
        let outside = Outside { origin: piece.start_s, tau: piece.tau, omega: self.omega, inputs: self.inputs };
        Flow::new(self.dynamics, self.split(parameters).0, outside, self.step_s)
    }

    /// Parameters of the equations, and zeros of sensors.
    fn split<'b>(&self, parameters: &'b [f64]) -> (&'b [f64], &'b [f64]) {
        parameters.split_at(parameters.len() - self.zeros.count)
    }

    /// Each sensor's zero in a piece.
    fn zeros_in(&self, piece: &Piece, parameters: &[f64]) -> Vec<f64> {
        let zeros = self.split(parameters).1;
        (0..self.sensors.len()).map(|k| self.zeros.value(piece.stretch, k, zeros)).collect()
    }

    fn samples(&self, piece: &Piece) -> usize {
        piece.measured.len() / self.sensors.len().max(1)
    }

    /// Room for [`Problem::share`]: for states and parameters, or for states alone.
    pub fn room(&self, with_parameters: bool) -> Work {
        if with_parameters { Work::by_all(self.dynamics) } else { Work::by_state(self.dynamics) }
    }

    /// Coordinates and rates at every sample of a piece, from a state on; none where the equations have
    /// no solution.
    pub fn course(&self, piece: &Piece, state: &[f64], parameters: &[f64]) -> Option<Vec<f64>> {
        let mut work = Work::plain(self.dynamics);
        work.set(state);
        let flow = self.flow(piece, parameters);
        let mut out = state.to_vec();
        for i in 1..self.samples(piece) {
            let start_s = piece.start_s + (i - 1) as f64 * self.spacing_s;
            if !flow.carry(&mut work, start_s, self.spacing_s) {
                return None;
            }
            out.extend_from_slice(work.state());
        }
        Some(out)
    }

    /// A piece's share at an initial state; None where the equations have no solution there.
    pub fn share(&self, piece: &Piece, state: &[f64], parameters: &[f64], work: &mut Work) -> Option<Share> {
        let n = self.dynamics.degrees_of_freedom();
        let count = self.samples(piece);
        work.set(state);
        let flown = work.derivatives().len() / (2 * n);
        // Zeros are parameters: they have columns where those have.
        let columns = flown + if flown > 2 * n { self.zeros.count } else { 0 };
        let width = columns + 1;
        let zeros = self.zeros_in(piece, parameters);
        let zero_columns: Vec<Option<usize>> = (0..self.sensors.len())
            .map(|k| self.zeros.at(piece.stretch, k).map(|z| flown + z).filter(|c| *c < columns))
            .collect();
        let mut sums = vec![0.0; width * width];
        let mut squares = vec![0.0; self.sensors.len()];
        let mut row = vec![0.0; width];
        let good = self.flow(piece, parameters).samples(work, piece.start_s, self.spacing_s, count, |i, sample| {
            let (q, derivatives) = sample.split_at(n);
            for (k, (sensor, sigma)) in self.sensors.iter().zip(self.sigma).enumerate() {
                row.fill(0.0);
                let scale = 1.0 / sigma;
                let mut r = zeros[k] - piece.measured[i * self.sensors.len() + k];
                for (j, m) in sensor.iter().enumerate().filter(|m| *m.1 != 0.0) {
                    r += m * q[j];
                    let by = &derivatives[j * flown..(j + 1) * flown];
                    row.iter_mut().zip(by).for_each(|(o, d)| *o += m * scale * d);
                }
                if let Some(column) = zero_columns[k] {
                    row[column] = scale;
                }
                r *= scale;
                row[columns] = r;
                squares[k] += r * r;
                for (a, line) in sums.chunks_exact_mut(width).enumerate() {
                    let x = row[a];
                    line[a..].iter_mut().zip(&row[a..]).for_each(|(s, y)| *s += x * y);
                }
            }
        });
        if !good || !squares.iter().all(|s| s.is_finite()) {
            return None;
        }
        let at = |a: usize, b: usize| sums[a.min(b) * width + a.max(b)];
        Some(Share {
            normal: DMatrix::from_fn(columns, columns, at),
            gradient: DVector::from_fn(columns, |a, _| at(a, columns)),
            squares,
            samples: count,
        })
    }

    /// Residuals (predicted minus measured, in σ) of a piece, sensor after sensor for each sample.
    /// None where the solution does not reach its end.
    pub fn residuals(&self, piece: &Piece, state: &[f64], parameters: &[f64]) -> Option<Vec<f64>> {
        let out = self.residuals_until(piece, state, parameters);
        (out.len() == piece.measured.len()).then_some(out)
    }

    /// Residuals of a piece with their derivatives by its state (2n columns), both in σ. None where
    /// the solution does not reach its end.
    pub fn linear(&self, piece: &Piece, state: &[f64], parameters: &[f64]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        self.linear_in(piece, state, parameters, self.room(false))
    }

    /// The same with derivatives by the parameters behind those by the state.
    pub fn linear_by_all(
        &self,
        piece: &Piece,
        state: &[f64],
        parameters: &[f64],
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        self.linear_in(piece, state, parameters, self.room(true))
    }

    fn linear_in(
        &self,
        piece: &Piece,
        state: &[f64],
        parameters: &[f64],
        mut work: Work,
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let (n, sensors) = (self.dynamics.degrees_of_freedom(), self.sensors.len());
        let count = self.samples(piece);
        work.set(state);
        let flown = work.derivatives().len() / (2 * n);
        let columns = flown + if flown > 2 * n { self.zeros.count } else { 0 };
        let (mut residuals, mut by) = (DVector::zeros(count * sensors), DMatrix::zeros(count * sensors, columns));
        let flow = self.flow(piece, parameters);
        let zeros = self.zeros_in(piece, parameters);
        let whole = flow.samples(&mut work, piece.start_s, self.spacing_s, count, |i, sample| {
            let (q, derivatives) = sample.split_at(n);
            for (k, (sensor, sigma)) in self.sensors.iter().zip(self.sigma).enumerate() {
                let row = i * sensors + k;
                residuals[row] = (zeros[k] - piece.measured[row]) / sigma;
                for (j, m) in sensor.iter().enumerate().filter(|m| *m.1 != 0.0) {
                    residuals[row] += m * q[j] / sigma;
                    let derivatives = &derivatives[j * flown..(j + 1) * flown];
                    derivatives.iter().enumerate().for_each(|(c, d)| by[(row, c)] += m * d / sigma);
                }
                if let Some(zero) = self.zeros.at(piece.stretch, k).filter(|_| columns > flown) {
                    by[(row, flown + zero)] = 1.0 / sigma;
                }
            }
        });
        whole.then_some((residuals, by))
    }

    /// The piece from sample `half` of one to sample `half` of the next, and the first one's
    /// solution from `state` at its beginning. None where the solution does not reach it.
    pub fn joined(
        &self,
        a: &Piece,
        b: &Piece,
        state: &[f64],
        parameters: &[f64],
        half: usize,
    ) -> Option<(Piece, Vec<f64>)> {
        let sensors = self.sensors.len();
        let mut work = Work::plain(self.dynamics);
        work.set(state);
        let ahead_s = half as f64 * self.spacing_s;
        if !self.flow(a, parameters).carry(&mut work, a.start_s, ahead_s) {
            return None;
        }
        let state = work.state().to_vec();
        // Each piece begins in the first turn: the second is told in the turns of the first.
        let end = self.samples(a);
        let turned: Vec<f64> = (0..sensors)
            .map(|k| {
                let last = a.measured[(end - 1) * sensors + k];
                let step = b.measured.get(k).map_or(0.0, |x| x - last);
                core::f64::consts::TAU * (step / core::f64::consts::TAU).round()
            })
            .collect();
        let second = b.measured.iter().take(half * sensors).enumerate().map(|(i, x)| x - turned[i % sensors]);
        let measured = a.measured[half * sensors..].iter().copied().chain(second).collect();
        let piece =
            Piece { start_s: a.start_s + ahead_s, tau: a.tau + self.omega * ahead_s, stretch: a.stretch, measured };
        Some((piece, state))
    }

    /// Residuals up to where the solution ends.
    pub fn residuals_until(&self, piece: &Piece, state: &[f64], parameters: &[f64]) -> Vec<f64> {
        let count = self.samples(piece);
        let mut work = Work::plain(self.dynamics);
        work.set(state);
        let mut out = Vec::with_capacity(piece.measured.len());
        let zeros = self.zeros_in(piece, parameters);
        let _reached =
            self.flow(piece, parameters).samples(&mut work, piece.start_s, self.spacing_s, count, |i, sample| {
                for (k, (sensor, sigma)) in self.sensors.iter().zip(self.sigma).enumerate() {
                    let predicted: f64 = sensor.iter().zip(sample).map(|(m, q)| m * q).sum();
                    out.push((predicted + zeros[k] - piece.measured[i * self.sensors.len() + k]) / sigma);
                }
            });
        out
    }

    /// Shares of all pieces, in order.
    pub fn shares(&self, pieces: &[Piece], states: &[Vec<f64>], parameters: &[f64]) -> Vec<Option<Share>> {
        pieces
            .par_iter()
            .zip(states)
            .map_init(|| self.room(true), |work, (piece, state)| self.share(piece, state, parameters, work))
            .collect()
    }

    /// The piece's first `samples` samples.
    pub fn head(&self, piece: &Piece, samples: usize) -> Piece {
        let values = (samples * self.sensors.len()).min(piece.measured.len());
        Piece { measured: piece.measured[..values].to_vec(), ..*piece }
    }

    /// Initial state of a piece fitted with the parameters held, over its first `lengths` samples
    /// one after the other (Levenberg and Marquardt), and the mean square residual that is left.
    pub fn fit_state(
        &self,
        piece: &Piece,
        start: &[f64],
        parameters: &[f64],
        lengths: &[usize],
        work: &mut Work,
    ) -> Option<(Vec<f64>, f64)> {
        let mut search = Search::new(start, lengths, self.samples(piece));
        while let Some((length, trial)) = search.wanted() {
            let part = self.head(piece, length);
            search.take(self.share(&part, trial, parameters, work));
        }
        search.found(self.sensors.len())
    }
}
