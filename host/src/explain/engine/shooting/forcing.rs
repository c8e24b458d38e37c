//! What a coefficient or strength of one does to the accelerations along a window: α_c = −M⁻¹ X_c,
//! M_ei = ∂F_e/∂q̈_i.

use std::ops::Range;

use pulp::{Arch, NullaryFnOnce};

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
    /// Column and equation of each expression behind the inertias, by columns.
    places: Vec<(usize, usize)>,
    /// Columns that are summed together, and their expressions.
    strips: Vec<(Range<usize>, Range<usize>)>,
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
        let mut sorted: Vec<&(usize, usize, Node)> = additions.iter().collect();
        sorted.sort_by_key(|a| a.0);
        nodes.extend(sorted.iter().map(|a| a.2.clone()));
        let places: Vec<(usize, usize)> = sorted.iter().map(|a| (a.0, a.1)).collect();
        let strips = (0..columns).step_by(STRIP).map(|from| {
            let strip = from..(from + STRIP).min(columns);
            let first = |column: usize| places.partition_point(|p| p.0 < column);
            (strip.clone(), first(strip.start)..first(strip.end))
        });
        Self {
            coordinates: n,
            columns,
            tape: Tape::new(&nodes),
            strips: strips.collect(),
            places,
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

/// Columns that are summed together.
const STRIP: usize = 64;
/// Points that are computed side by side.
const TILE: usize = 8;
/// Points whose columns are computed at once: with hundreds of columns these stay in the cache.
const BLOCK: usize = 32;

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
        let Forcing { coordinates: n, columns, tape, places, strips, .. } = self.forcing;
        let size = n * columns;
        // Every number is written.
        out.resize(points.len() * size, 0.0);
        let series: Vec<&[f64]> = self.series.iter().map(Vec::as_slice).collect();
        let mut inverses = vec![[0.0; TILE]; n * n];
        let mut sums = vec![[0.0; TILE]; n * STRIP];
        for (block, rows) in out.chunks_mut(BLOCK * size).enumerate() {
            let start = points.start + block * BLOCK;
            let place = tape.among(&series, start..(start + BLOCK).min(points.end), self.count, registers);
            for (tile, rows) in rows.chunks_mut(TILE * size).enumerate() {
                let at = place + tile * TILE;
                // Behind the last point of a range registers hold what nothing is made of.
                let values = |k: usize| tape.output(k, registers)[at..].first_chunk::<TILE>();
                invert(*n, rows.len() / size, values, &mut inverses)?;
                for (strip, expressions) in strips {
                    let width = strip.len();
                    sums.fill([0.0; TILE]);
                    let places = &places[expressions.clone()];
                    let of = |k: usize| values(n * n + expressions.start + k);
                    let pushed = Pushed { sums: &mut sums, inverses: &inverses, places, first: strip.start, width, of };
                    Arch::new().dispatch(pushed)?;
                    for (i, sums) in sums.chunks(width).take(*n).enumerate() {
                        turned(sums, rows, i * columns + strip.start, size);
                    }
                }
            }
        }
        out.iter().all(|x| x.is_finite()).then_some(())
    }
}

/// Sums over expressions of −M⁻¹ X, by columns from `first` on, at the points of a tile; compiled for
/// each kind of vectors that processors have (pulp).
struct Pushed<'a, F> {
    sums: &'a mut [[f64; TILE]],
    inverses: &'a [[f64; TILE]],
    /// Column and equation of each expression.
    places: &'a [(usize, usize)],
    first: usize,
    width: usize,
    /// An expression's values.
    of: F,
}

impl<'a, F: Fn(usize) -> Option<&'a [f64; TILE]>> NullaryFnOnce for Pushed<'a, F> {
    type Output = Option<()>;

    #[inline(always)]
    fn call(self) -> Option<()> {
        let Self { sums, inverses, places, first, width, of } = self;
        let n = inverses.len().isqrt();
        for (k, &(column, equation)) in places.iter().enumerate() {
            let values = of(k)?;
            for i in 0..n {
                let (to, inverse) = (&mut sums[i * width + column - first], &inverses[i * n + equation]);
                (0..TILE).for_each(|lane| to[lane] -= inverse[lane] * values[lane]);
            }
        }
        Some(())
    }
}

/// Lanes of some numbers as parts of as many rows as there are, each of `size`, from the place `at`
/// on.
fn turned(sums: &[[f64; TILE]], rows: &mut [f64], at: usize, size: usize) {
    for (from, some) in sums.chunks(TILE).enumerate() {
        for (lane, row) in rows.chunks_exact_mut(size).enumerate() {
            row[at + from * TILE..].iter_mut().zip(some).for_each(|(to, of)| *to = of[lane]);
        }
    }
}

/// Inverses, row after row, of the inertias that the first n² expressions of a tape give at some
/// points.
fn invert<'a>(
    n: usize,
    count: usize,
    values: impl Fn(usize) -> Option<&'a [f64; TILE]>,
    inverses: &mut [[f64; TILE]],
) -> Option<()> {
    let entries: Vec<&[f64; TILE]> = (0..n * n).map(values).collect::<Option<_>>()?;
    let (mut matrix, mut inverse) = (vec![0.0; 2 * n * n], vec![0.0; n * n]);
    for i in 0..count {
        for e in 0..n {
            let row = &mut matrix[e * 2 * n..(e + 1) * 2 * n];
            row.iter_mut().enumerate().for_each(|(k, x)| {
                *x = if k < n { entries[e * n + k][i] } else { f64::from(u8::from(k - n == e)) };
            });
        }
        if !solve(&mut matrix, n, n, &mut inverse) {
            return None;
        }
        inverses.iter_mut().zip(&inverse).for_each(|(to, x)| to[i] = *x);
    }
    Some(())
}
