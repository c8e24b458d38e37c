//! Accelerations and their partials at many states at once: every operation of the tapes is one
//! loop over the states, a fraction of the work of going through them one by one.

use super::evaluation::{MOST_PASSES, STILL};
use super::{EquationsOfMotion, solve, wrapped};
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::tape::{ABREAST, Registers};
use crate::model::vectors::{add_matrix_products, add_scaled};

/// Many states side by side, at most [`ABREAST`]; each quantity is a column of all of them.
pub struct Abreast<'a> {
    /// How many.
    pub count: usize,
    /// Coordinates, then rates: 2n columns of [`ABREAST`] each.
    pub states: &'a [f64],
    /// Times, s.
    pub times: &'a [f64],
    /// Phases of the drive, rad.
    pub taus: &'a [f64],
    /// Measured inputs.
    pub inputs: &'a [Vec<f64>],
    /// Signs of [`crate::model::dynamics::Dynamics::switches`].
    pub signs: &'a [Vec<f64>],
}

/// Room for such an evaluation.
#[derive(Default)]
pub struct Room {
    entries: Registers,
    slopes: Registers,
    wrapped: Vec<Vec<f64>>,
    matrix: Vec<f64>,
    inverse: Vec<f64>,
    right: Vec<f64>,
    next: Vec<f64>,
}

/// Nothing, where a symbol has no value.
const ZEROS: [f64; ABREAST] = [0.0; ABREAST];

/// What has no value.
const UNKNOWN: [f64; ABREAST] = [f64::NAN; ABREAST];

/// The column that a symbol stands for; `remembered` are the numbers of followed states, whose
/// values come behind `inputs`.
fn column<'a>(
    s: Symbol,
    at: &'a Abreast<'_>,
    inputs: usize,
    remembered: &[usize],
    wrapped: &'a [Vec<f64>],
    accelerations: &'a [f64],
) -> &'a [f64] {
    let count = at.count;
    let n = wrapped.len();
    let state = |k: usize| &at.states[k * ABREAST..k * ABREAST + count];
    match s {
        Symbol::Coordinate(i) if !wrapped[i].is_empty() => &wrapped[i],
        Symbol::Coordinate(i) | Symbol::Raw(i) => state(i),
        Symbol::Rate(i) | Symbol::ClearRate(i) => state(n + i),
        Symbol::Acceleration(i) => &accelerations[i * ABREAST..i * ABREAST + count],
        Symbol::Input(k) | Symbol::RawInput(k) => at.inputs.get(k).map_or(&ZEROS[..count], |x| &x[..count]),
        Symbol::Tau => &at.taus[..count],
        Symbol::Time => &at.times[..count],
        Symbol::Held(k) => at.signs.get(k).map_or(&ZEROS[..count], |x| &x[..count]),
        Symbol::Memory(k) => {
            let place = remembered.iter().position(|r| *r == k);
            place.and_then(|j| at.inputs.get(inputs + j)).map_or(&UNKNOWN[..count], |x| &x[..count])
        }
        Symbol::InputRate(_) => &ZEROS[..count],
        // Only laws of states hold them, where they became rates.
        Symbol::State(_) => &UNKNOWN[..count],
    }
}

impl EquationsOfMotion {
    /// Whether many states can be linearised at once: all slopes exist.
    pub fn goes_abreast(&self) -> bool {
        self.slopes.is_some()
    }

    /// Accelerations (n columns of [`ABREAST`]) at every state; `exists` turns false where there are
    /// none. Only for systems that go abreast ([`EquationsOfMotion::goes_abreast`]).
    pub fn accelerate_abreast(
        &self,
        parameters: &[f64],
        at: &Abreast<'_>,
        room: &mut Room,
        accelerations: &mut [f64],
        exists: &mut [bool],
    ) {
        let (n, count) = (self.circle.len(), at.count);
        room.wrapped.resize(n, Vec::new());
        for (i, to) in room.wrapped.iter_mut().enumerate().filter(|(i, _)| self.circle[*i]) {
            to.clear();
            to.extend(at.states[i * ABREAST..i * ABREAST + count].iter().map(|x| wrapped(*x)));
        }
        if !self.implicit {
            self.pass_abreast(parameters, at, room, &[], accelerations, exists);
            return;
        }
        // Each state as long as it moves, as one alone.
        accelerations.fill(0.0);
        let mut next = core::mem::take(&mut room.next);
        next.resize(accelerations.len(), 0.0);
        let mut found = [false; ABREAST];
        for _ in 0..MOST_PASSES {
            self.pass_abreast(parameters, at, room, accelerations, &mut next, exists);
            for i in (0..count).filter(|i| !found[*i]).collect::<Vec<_>>() {
                let places = (0..n).map(|k| k * ABREAST + i);
                let moved = places.clone().fold(0.0_f64, |m, k| m.max((next[k] - accelerations[k]).abs()));
                let size = places.clone().fold(0.0_f64, |m, k| m.max(next[k].abs()));
                places.for_each(|k| accelerations[k] = next[k]);
                found[i] = moved <= STILL * size;
            }
            if (0..count).all(|i| found[i] || !exists[i]) {
                break;
            }
        }
        room.next = next;
        exists.iter_mut().zip(found).for_each(|(e, f)| *e &= f);
    }

    /// One pass of [`EquationsOfMotion::accelerate_abreast`]: accelerations with those of `guess`
    /// inside functions.
    fn pass_abreast(
        &self,
        parameters: &[f64],
        at: &Abreast<'_>,
        room: &mut Room,
        guess: &[f64],
        accelerations: &mut [f64],
        exists: &mut [bool],
    ) {
        let (n, count) = (self.circle.len(), at.count);
        let Room { entries, wrapped: angles, matrix, inverse, right, .. } = room;
        // M (n × n columns), inverted state by state, and what stands beside the accelerations.
        let columns: Vec<&[f64]> =
            self.tape.symbols().iter().map(|s| column(*s, at, self.inputs, &self.remembered, angles, guess)).collect();
        self.tape.over(&columns, count, entries);
        matrix.clear();
        matrix.resize(n * n * ABREAST, 0.0);
        right.clear();
        right.resize(n * ABREAST, 0.0);
        for (k, entry) in self.entries.iter().enumerate() {
            let factor = self.factor(k, parameters);
            let (to, f) = match entry.acceleration {
                Some(i) => (&mut matrix[(entry.equation * n + i) * ABREAST..], factor),
                None => (&mut right[entry.equation * ABREAST..], -factor),
            };
            add_scaled(&mut to[..count], f, self.tape.output(k, entries));
        }
        invert(matrix, n, count, inverse, exists);
        accelerations.fill(0.0);
        add_matrix_products::<ABREAST>(accelerations, inverse, right, n, 1);
    }

    /// What an entry is multiplied with.
    fn factor(&self, k: usize, parameters: &[f64]) -> f64 {
        self.entries[k].coefficient.map_or(-1.0, |c| parameters[c])
    }

    /// Accelerations as [`EquationsOfMotion::accelerate_abreast`], and their partials by coordinates
    /// and rates (n × 2n columns of [`ABREAST`], row after row).
    pub fn linearise_abreast(
        &self,
        parameters: &[f64],
        at: &Abreast<'_>,
        room: &mut Room,
        accelerations: &mut [f64],
        partials: &mut [f64],
        exists: &mut [bool],
    ) {
        let Some((tape, places)) = self.slopes.as_ref() else {
            exists.fill(false);
            return;
        };
        self.accelerate_abreast(parameters, at, room, accelerations, exists);
        let (n, count) = (self.circle.len(), at.count);
        let Room { slopes, wrapped: angles, matrix, inverse, right, .. } = room;
        // Slopes of the residual, with what multiplies an acceleration times that.
        let columns: Vec<&[f64]> = tape
            .symbols()
            .iter()
            .map(|s| column(*s, at, self.inputs, &self.remembered, angles, accelerations))
            .collect();
        tape.over(&columns, count, slopes);
        right.clear();
        right.resize(n * 2 * n * ABREAST, 0.0);
        for (o, &(k, j)) in places.iter().enumerate() {
            let (entry, factor) = (&self.entries[k], self.factor(k, parameters));
            // What depends on an acceleration acts like an inertia.
            let (to, f) = match j.checked_sub(2 * n) {
                Some(i) => (&mut matrix[(entry.equation * n + i) * ABREAST..], factor),
                None => (&mut right[(entry.equation * 2 * n + j) * ABREAST..], -factor),
            };
            let (to, slope) = (&mut to[..count], tape.output(o, slopes));
            match entry.acceleration {
                None => add_scaled(to, f, slope),
                Some(i) => {
                    let moved = &accelerations[i * ABREAST..i * ABREAST + count];
                    to.iter_mut().zip(slope.iter().zip(moved)).for_each(|(t, (s, a))| *t += f * s * a);
                }
            }
        }
        if self.implicit {
            invert(matrix, n, count, inverse, exists);
        }
        partials.fill(0.0);
        add_matrix_products::<ABREAST>(partials, inverse, right, n, 2 * n);
    }
}

/// Inverses of n × n matrices, state by state, with pivots.
fn invert(matrix: &[f64], n: usize, count: usize, inverse: &mut Vec<f64>, exists: &mut [bool]) {
    inverse.resize(n * n * ABREAST, 0.0);
    if n == 2 {
        return invert_two(matrix, count, inverse, exists);
    }
    let (mut rows, mut found) = (vec![0.0; 2 * n * n], vec![0.0; n * n]);
    for i in 0..count {
        rows.fill(0.0);
        for e in 0..n {
            (0..n).for_each(|k| rows[e * 2 * n + k] = matrix[(e * n + k) * ABREAST + i]);
            rows[e * 2 * n + n + e] = 1.0;
        }
        exists[i] &= solve(&mut rows, n, n, &mut found);
        (0..n * n).for_each(|k| inverse[k * ABREAST + i] = found[k]);
    }
}

/// Least determinant of a matrix of two rows beside the product of its rows' sizes.
const SINGULAR: f64 = 1e-12;

/// The same of 2 × 2 matrices by their determinants.
fn invert_two(matrix: &[f64], count: usize, inverse: &mut [f64], exists: &mut [bool]) {
    let [a, b, c, d] = core::array::from_fn(|k| &matrix[k * ABREAST..k * ABREAST + count]);
    for i in 0..count {
        let (a, b, c, d) = (a[i], b[i], c[i], d[i]);
        let determinant = a * d - b * c;
        exists[i] &= determinant.abs() > SINGULAR * a.abs().max(b.abs()) * c.abs().max(d.abs());
        for (k, x) in [d, -b, -c, a].into_iter().enumerate() {
            inverse[k * ABREAST + i] = x / determinant;
        }
    }
}
