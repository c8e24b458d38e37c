//! What a coefficient or strength of one does to the accelerations along a window: α_c = −M⁻¹ X_c,
//! M_ei = ∂F_e/∂q̈_i.

use super::along::Along;
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::{solve, wrapped};
use crate::model::model_file::expression::{Node, Symbol, add, multiply, number};
use crate::model::model_file::tape::Tape;
use crate::motion::from_record::differences;

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
        (columns, additions): (usize, &Additions),
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

    /// Accelerations by every column at every point: for each n rows of the columns. None where M
    /// is singular.
    pub fn along(&self, (states, accelerations): (&[f64], &[f64]), along: &Along<'_>) -> Option<Vec<f64>> {
        let n = self.coordinates;
        let count = states.len() / (2 * n);
        let inputs = along.inputs(count);
        let series: Vec<Vec<f64>> = self
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
                    Symbol::Tau => (0..count).map(|i| along.tau(i)).collect(),
                    Symbol::Time => (0..count).map(|i| along.time(i)).collect(),
                    Symbol::Memory(k) => along.remembered(k, count),
                    Symbol::InputRate(k) => differences(&inputs[k], along.spacing()),
                    Symbol::Held(_) | Symbol::State(_) => vec![0.0; count],
                }
            })
            .collect();
        let columns: Vec<&[f64]> = series.iter().map(Vec::as_slice).collect();
        let values = self.tape.run(&columns, count);
        let mut out = vec![0.0; count * n * self.columns];
        let (mut matrix, mut inverse) = (vec![0.0; 2 * n * n], vec![0.0; n * n]);
        for i in 0..count {
            for e in 0..n {
                let row = &mut matrix[e * 2 * n..(e + 1) * 2 * n];
                row.iter_mut().enumerate().for_each(|(k, x)| {
                    *x = if k < n { values[e * n + k][i] } else { f64::from(u8::from(k - n == e)) };
                });
            }
            if !solve(&mut matrix, n, n, &mut inverse) {
                return None;
            }
            let rows = &mut out[i * n * self.columns..(i + 1) * n * self.columns];
            for (&(column, equation), value) in self.places.iter().zip(&values[n * n..]) {
                for k in 0..n {
                    rows[k * self.columns + column] -= inverse[k * n + equation] * value[i];
                }
            }
        }
        out.iter().all(|x| x.is_finite()).then_some(out)
    }
}
