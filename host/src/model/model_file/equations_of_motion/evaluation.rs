//! Accelerations and their partial derivatives at a state. See the head of [`super`].

use core::cell::RefCell;

use super::super::expression::Symbol;
use super::super::split::Entry;
use super::super::tape::Tape;
use super::{EquationsOfMotion, solve, wrapped};
use crate::model::dynamics::{Corner, Dynamics, Here, Linearisation, Switch, differences};

/// Most passes in which accelerations inside functions are found, and the share of their size to
/// which they stand still.
pub(super) const MOST_PASSES: usize = 20;
pub(super) const STILL: f64 = 1e-12;

/// Room for one evaluation.
#[derive(Default)]
struct Scratch {
    registers: Vec<f64>,
    values: Vec<f64>,
    outputs: Vec<f64>,
    slopes: Vec<f64>,
    matrix: Vec<f64>,
    next: Vec<f64>,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::new(Scratch::default());
}

impl EquationsOfMotion {
    /// Puts the symbols' values into `into`.
    fn values(&self, tape: &Tape, here: Here<'_>, accelerations: &[f64], into: &mut Vec<f64>) {
        let Here { q, v, at, signs, .. } = here;
        into.clear();
        into.extend(tape.symbols().iter().map(|s| match *s {
            Symbol::Coordinate(i) if self.circle[i] => wrapped(q[i]),
            Symbol::Coordinate(i) | Symbol::Raw(i) => q[i],
            Symbol::Rate(i) | Symbol::ClearRate(i) => v[i],
            Symbol::Acceleration(i) => accelerations[i],
            Symbol::Input(k) | Symbol::RawInput(k) => at.inputs.get(k).copied().unwrap_or(0.0),
            Symbol::Tau => at.tau,
            Symbol::Time => at.time,
            Symbol::Held(k) => signs.get(k).copied().unwrap_or(0.0),
            Symbol::Memory(k) => {
                let place = self.remembered.iter().position(|r| *r == k);
                place.and_then(|j| at.inputs.get(self.inputs + j)).copied().unwrap_or(f64::NAN)
            }
            Symbol::InputRate(_) => 0.0,
            // Only laws of states hold them, where they became rates.
            Symbol::State(_) => f64::NAN,
        }));
    }

    /// Entries at the accelerations `guess`, and the accelerations that follow; false where they do
    /// not exist.
    fn pass(&self, s: &mut Scratch, here: Here<'_>, guess: &[f64], out: &mut [f64]) -> bool {
        let n = self.circle.len();
        self.values(&self.tape, here, guess, &mut s.values);
        s.outputs.clear();
        s.outputs.resize(self.entries.len(), 0.0);
        self.tape.at(&s.values, &mut s.registers, &mut s.outputs);
        s.matrix.clear();
        s.matrix.resize(n * (n + 1), 0.0);
        for (entry, x) in self.entries.iter().zip(&s.outputs) {
            let x = entry.coefficient.map_or(-*x, |c| here.parameters[c] * x);
            match entry.acceleration {
                Some(i) => s.matrix[entry.equation * (n + 1) + i] += x,
                None => s.matrix[entry.equation * (n + 1) + n] -= x,
            }
        }
        solve(&mut s.matrix, n, 1, out)
    }

    /// Entries, then accelerations; false where they do not exist.
    fn evaluate(&self, s: &mut Scratch, here: Here<'_>, out: &mut [f64]) -> bool {
        if !self.implicit {
            return self.pass(s, here, &[], out);
        }
        out.fill(0.0);
        let mut next = core::mem::take(&mut s.next);
        next.resize(out.len(), 0.0);
        let mut found = false;
        for _ in 0..MOST_PASSES {
            if !self.pass(s, here, out, &mut next) {
                break;
            }
            let moved = next.iter().zip(&*out).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
            let size = next.iter().fold(0.0_f64, |m, a| m.max(a.abs()));
            out.copy_from_slice(&next);
            found = moved <= STILL * size;
            if found {
                break;
            }
        }
        s.next = next;
        found
    }

    /// As [`Dynamics::linearise_held`]; none where slopes do not exist.
    fn slopes(&self, here: Here<'_>, accelerations: &mut [f64], out: &mut [f64]) -> Option<bool> {
        let (tape, places) = self.slopes.as_ref()?;
        let n = self.circle.len();
        // By coordinates and rates, and by coefficients where there is room for them.
        let width = out.len() / n.max(1);
        let by_coefficients = width > 2 * n;
        SCRATCH.with_borrow_mut(|s| {
            if !self.evaluate(s, here, accelerations) {
                return Some(false);
            }
            self.values(tape, here, accelerations, &mut s.values);
            s.slopes.clear();
            s.slopes.resize(places.len(), 0.0);
            tape.at(&s.values, &mut s.registers, &mut s.slopes);
            // M, then −∂F/∂x, row after row: one elimination gives all of −M⁻¹ ∂F/∂x.
            let row = n + width;
            s.matrix.clear();
            s.matrix.resize(n * row, 0.0);
            let moved = |entry: &Entry| entry.acceleration.map_or(1.0, |i| accelerations[i]);
            let factor = |entry: &Entry| entry.coefficient.map_or(-1.0, |c| here.parameters[c]);
            for (entry, x) in self.entries.iter().zip(&s.outputs) {
                if let (true, Some(c)) = (by_coefficients, entry.coefficient) {
                    s.matrix[entry.equation * row + n + 2 * n + c] -= x * moved(entry);
                }
                if let Some(i) = entry.acceleration {
                    s.matrix[entry.equation * row + i] += factor(entry) * x;
                }
            }
            for (&(k, j), slope) in places.iter().zip(&s.slopes) {
                let entry = &self.entries[k];
                let slope = factor(entry) * slope * moved(entry);
                match j.checked_sub(2 * n) {
                    Some(i) => s.matrix[entry.equation * row + i] += slope,
                    None => s.matrix[entry.equation * row + n + j] -= slope,
                }
            }
            Some(solve(&mut s.matrix, n, width, out))
        })
    }
}

impl Dynamics for EquationsOfMotion {
    fn degrees_of_freedom(&self) -> usize {
        self.circle.len()
    }

    fn parameter_count(&self) -> usize {
        self.coefficients.len()
    }

    fn switches(&self) -> &[Switch] {
        &self.switches
    }

    fn seams(&self) -> &[Vec<f64>] {
        &self.seams
    }

    fn corners(&self) -> &[Corner] {
        &self.corners
    }

    fn acceleration_held(&self, here: Here<'_>, out: &mut [f64]) -> bool {
        SCRATCH.with_borrow_mut(|s| self.evaluate(s, here, out))
    }

    fn takes_states_alone(&self) -> bool {
        self.slopes.is_some()
    }

    fn linearise_held(&self, here: Here<'_>, out: Linearisation<'_>) -> bool {
        let Linearisation { acceleration, partials } = out;
        if let Some(done) = self.slopes(here, acceleration, partials) {
            return done;
        }
        // Hats have corners: central differences with the signs held.
        self.acceleration_held(here, acceleration) && differences(self, here, partials)
    }
}
