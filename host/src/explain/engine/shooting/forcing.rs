//! What a coefficient or strength of one does to the accelerations along a window: α_c = −M⁻¹ X_c,
//! M_ei = ∂F_e/∂q̈_i.

use std::ops::Range;

use super::window_inputs::WindowInputs;
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::{solve, wrapped};
use crate::model::model_file::expression::{Node, Symbol, add, multiply, number};
use crate::model::model_file::tape::{Registers, Tape};
use crate::signal::differences::rates;

/// What stands on the left-hand sides: column, equation, expression in seconds.
pub type Additions = Vec<(usize, usize, Node)>;

/// Columns compiled for one set of coefficients.
pub struct Forcing {
    coordinates: usize,
    columns: usize,
    /// Inertias, row after row, then the columns' expressions.
    tape: Tape,
    /// Column and equation of each expression behind the inertias.
    places: Vec<(usize, usize)>,
    circle: Vec<bool>,
}

impl Forcing {
    /// `coefficients` of the model's terms in the order of [`ModelFile::coefficients`]; `moved` are
    /// terms beside them with their strengths, which may hold accelerations.
    pub fn new(
        model: &ModelFile,
        omega: f64,
        coefficients: &[f64],
        moved: &[(usize, f64, Node)],
        columns: usize,
        additions: &Additions,
    ) -> Self {
        let n = model.coordinates.len();
        let places = model.term_places();
        let mut nodes = Vec::new();
        for (e, equation) in model.equations.iter().enumerate() {
            let all: Vec<(f64, Node)> = equation
                .terms
                .iter()
                .zip(&places[e])
                .map(|(t, &k)| (coefficients[k], model.in_seconds(&t.of, omega)))
                .chain([(-1.0, model.in_seconds(&equation.balance, omega))])
                .chain(moved.iter().filter(|m| m.0 == e).map(|m| (m.1, m.2.clone())))
                .collect();
            for i in 0..n {
                let slopes = all.iter().filter_map(|(k, of)| {
                    Some(multiply(number(*k), of.derivative_between_jumps(Symbol::Acceleration(i))?))
                });
                nodes.push(slopes.fold(number(0.0), add));
            }
        }
        nodes.extend(additions.iter().map(|a| a.2.clone()));
        Self {
            coordinates: n,
            columns,
            tape: Tape::new(&nodes),
            places: additions.iter().map(|a| (a.0, a.1)).collect(),
            circle: model.circle(),
        }
    }

    /// These columns along a window's points.
    pub fn on<'a>(&'a self, states: &[f64], accelerations: &[f64], exogenous: &WindowInputs<'_>) -> Driven<'a> {
        let n = self.coordinates;
        let count = states.len() / (2 * n);
        let inputs = exogenous.inputs(count);
        let series = self
            .tape
            .symbols()
            .iter()
            .map(|s| {
                let state = |k: usize| (0..count).map(move |i| states[2 * n * i + k]);
                match *s {
                    Symbol::Coordinate(k) if self.circle[k] => state(k).map(wrapped).collect(),
                    Symbol::Coordinate(k) | Symbol::Raw(k) => state(k).collect(),
                    Symbol::Rate(k) | Symbol::ClearRate(k) => state(n + k).collect(),
                    Symbol::Acceleration(k) => (0..count).map(|i| accelerations[n * i + k]).collect(),
                    Symbol::Input(k) | Symbol::RawInput(k) => inputs[k].clone(),
                    Symbol::Tau => (0..count).map(|i| exogenous.tau(i)).collect(),
                    Symbol::Time => (0..count).map(|i| exogenous.time(i)).collect(),
                    Symbol::Memory(k) => exogenous.remembered(k, count),
                    Symbol::InputRate(k) => rates(&inputs[k], exogenous.spacing()),
                    Symbol::Held(_) | Symbol::State(_) => vec![0.0; count],
                }
            })
            .collect();
        Driven { forcing: self, series, count }
    }
}

/// Points that are computed side by side.
const TILE: usize = 8;
/// Points whose columns are computed at once: with hundreds of columns these stay in the cache.
const BLOCK: usize = 64;

/// Columns along a window.
pub struct Driven<'a> {
    forcing: &'a Forcing,
    /// What the tape's symbols are at every point.
    series: Vec<Vec<f64>>,
    /// Points.
    count: usize,
}

impl Driven<'_> {
    /// Accelerations by every column at every point; see [`Driven::between`].
    pub fn all(&self) -> Option<Vec<f64>> {
        let mut out = Vec::new();
        self.between(0..self.count, &mut Registers::default(), &mut out)?;
        Some(out)
    }

    /// Accelerations by every column at a range of points: for each n rows of the columns.
    /// None where M is singular or a column has no value.
    pub fn between(&self, points: Range<usize>, registers: &mut Registers, out: &mut Vec<f64>) -> Option<()> {
        let Forcing { coordinates: n, columns, tape, places, .. } = self.forcing;
        let size = n * columns;
        out.clear();
        out.resize(points.len() * size, 0.0);
        let series: Vec<&[f64]> = self.series.iter().map(Vec::as_slice).collect();
        let mut inverses = vec![[0.0; TILE]; n * n];
        for (block, rows) in out.chunks_mut(BLOCK * size).enumerate() {
            let start = points.start + block * BLOCK;
            let place = tape.among(&series, start..(start + BLOCK).min(points.end), self.count, registers);
            for (tile, rows) in rows.chunks_mut(TILE * size).enumerate() {
                let (at, count) = (place + tile * TILE, rows.len() / size);
                let values = |k: usize| &tape.output(k, registers)[at..at + count];
                invert(*n, count, values, &mut inverses)?;
                for (k, &(column, equation)) in places.iter().enumerate() {
                    let of = values(n * n + k);
                    for i in 0..*n {
                        let inverse = &inverses[i * n + equation];
                        for (lane, x) in of.iter().enumerate() {
                            rows[(lane * n + i) * columns + column] -= inverse[lane] * x;
                        }
                    }
                }
            }
        }
        out.iter().all(|x| x.is_finite()).then_some(())
    }
}

/// Inverses, row after row, of the inertias that the first n² expressions of a tape give at some
/// points.
fn invert<'a>(n: usize, count: usize, values: impl Fn(usize) -> &'a [f64], inverses: &mut [[f64; TILE]]) -> Option<()> {
    let (mut matrix, mut inverse) = (vec![0.0; 2 * n * n], vec![0.0; n * n]);
    for i in 0..count {
        for e in 0..n {
            let row = &mut matrix[e * 2 * n..(e + 1) * 2 * n];
            row.iter_mut().enumerate().for_each(|(k, x)| {
                *x = if k < n { values(e * n + k)[i] } else { f64::from(u8::from(k - n == e)) };
            });
        }
        if !solve(&mut matrix, n, n, &mut inverse) {
            return None;
        }
        inverses.iter_mut().zip(&inverse).for_each(|(to, x)| to[i] = *x);
    }
    Some(())
}
