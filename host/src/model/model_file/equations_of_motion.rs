//! Accelerations from a model file: Σ_j λ_j X_j = Y is linear in the accelerations, M(λ, q, …) q̈ =
//! r, and is solved for them.
//!
//! With F_e = Σ_j λ_j X_j − Y, M_ei = ∂F_e/∂q̈_i and r_e = −F_e without accelerations; the partial
//! derivatives of q̈ by anything x are −M⁻¹ ∂F/∂x at the accelerations found. LU with partial
//! pivoting; a pivot below 1e-12 of the row's size counts as singular.
//!
//! A column of an effect may hold accelerations inside a function (a joint's load): it is then
//! evaluated at the accelerations found so far, from zero on, until these stand still to 1e-12, in
//! twenty passes at most; such laws are weak, and three or four do. The same holds of M in the
//! partial derivatives, M + ∂F/∂q̈.
//!
//! The signs of linear forms of the rates (dry friction) are the switches of [`Dynamics`].
//!
//! A state z of an effect that remembers is followed as the rate of a further coordinate, whose
//! acceleration is the law of dz/dt: coordinates are then those of the model and one for each
//! state, on which nothing else depends ([`EquationsOfMotion::hidden`]).

pub mod abreast;
mod linear_systems;
mod memories;

use core::cell::RefCell;
use std::sync::Arc;

pub use self::linear_systems::solve;
use self::memories::{hidden, remembered, state_rate, with_rates};
use super::ModelFile;
use super::expression::{Function, Node, Symbol, as_number, subtract, symbol};
use super::memory::Memory;
use super::split::{Entry, Split};
use super::tape::Tape;
use crate::error::Result;
use crate::model::dynamics::{Dynamics, Instant};

/// Most passes in which accelerations inside functions are found, and the share of their size to
/// which they stand still.
const MOST_PASSES: usize = 20;
const STILL: f64 = 1e-12;

/// A model file that can be integrated.
#[derive(Clone, Debug)]
pub struct EquationsOfMotion {
    coefficients: Vec<String>,
    circle: Vec<bool>,
    switches: Vec<Vec<f64>>,
    tape: Tape,
    entries: Vec<Entry>,
    /// Whether an entry holds accelerations.
    implicit: bool,
    /// Derivatives of entries by coordinates (0 … n), rates (n … 2n) and accelerations (2n … 3n):
    /// tape, and entry and variable of each output. None where some factor has no derivative.
    slopes: Option<(Tape, Vec<(usize, usize)>)>,
    /// Number of measured inputs, and of the states that come behind them, followed along a record.
    inputs: usize,
    remembered: Vec<usize>,
    /// States that are followed with the motion.
    hidden: Vec<(Arc<Memory>, usize)>,
}

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

/// What accelerations are functions of.
#[derive(Clone, Copy)]
struct Here<'a> {
    parameters: &'a [f64],
    q: &'a [f64],
    v: &'a [f64],
    at: &'a Instant<'a>,
    signs: &'a [f64],
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::new(Scratch::default());
}

impl EquationsOfMotion {
    /// Compiles a model file for a drive of angular frequency `omega` (rad/s; 1 without one).
    ///
    /// # Errors
    /// A number of equations that differs from that of the coordinates.
    pub fn new(model: &ModelFile, omega: f64) -> Result<Self> {
        Self::with_columns(model, omega, &[])
    }

    /// As [`EquationsOfMotion::new`], with further terms
    /// `(equation, coefficient, expression in seconds)` on the left-hand sides; their coefficients
    /// follow the file's own. States of effects that remember are followed as well: see the head of
    /// this file.
    ///
    /// # Errors
    /// As [`EquationsOfMotion::new`].
    pub fn with_columns(model: &ModelFile, omega: f64, extra: &[(usize, String, Node)]) -> Result<Self> {
        let n = model.coordinates.len();
        if model.equations.len() != n {
            return Err(model
                .bad(
                    format!("{} equations for {n} coordinates", model.equations.len()),
                    "as many equations as coordinates",
                )
                .at("equation")
                .remedy("A simulation needs one equation for each coordinate"));
        }
        let mut coefficients = model.coefficients();
        let hidden = hidden(extra);
        let all = n + hidden.len();
        let mut built = Split::of(all);
        for (e, equation) in model.equations.iter().enumerate() {
            built.put(e, None, &model.in_seconds(&equation.balance, omega));
            for term in &equation.terms {
                let index = coefficients.iter().position(|c| *c == term.name);
                built.put(e, index, &model.in_seconds(&term.of, omega));
            }
        }
        for (e, name, of) in extra {
            let index = coefficients.iter().position(|c| c == name).unwrap_or_else(|| {
                coefficients.push(name.clone());
                coefficients.len() - 1
            });
            built.put(*e, Some(index), &with_rates(of, &hidden, n));
        }
        for (k, (memory, state)) in hidden.iter().enumerate() {
            let own = |s: Symbol| match s {
                Symbol::State(j) => state_rate(&hidden, memory, j, n),
                other => symbol(other),
            };
            let rate = memory.rates()[*state].replace(&own);
            built.put(n + k, None, &subtract(rate, symbol(Symbol::Acceleration(n + k))));
        }
        let states = (0..all).map(Symbol::Coordinate).chain((0..all).map(Symbol::Rate));
        let variables: Vec<Symbol> = states.chain((0..all).map(Symbol::Acceleration)).collect();
        let mut slopes = Some((Vec::new(), Vec::new()));
        for (k, node) in built.nodes.iter().enumerate() {
            for (j, by) in variables.iter().enumerate() {
                match node.derivative_between_jumps(*by) {
                    Some(d) if as_number(&d) == Some(0.0) => {}
                    Some(d) => {
                        if let Some((nodes, places)) = slopes.as_mut() {
                            nodes.push(d);
                            places.push((k, j));
                        }
                    }
                    None => slopes = None,
                }
            }
        }
        Ok(Self {
            coefficients,
            circle: [model.circle(), vec![false; hidden.len()]].concat(),
            inputs: model.inputs.len(),
            remembered: remembered(extra),
            hidden,
            switches: built.switches,
            tape: Tape::new(&built.nodes),
            implicit: built.nodes.iter().any(|node| node.accelerates()),
            entries: built.entries,
            slopes: slopes.map(|(nodes, places)| (Tape::new(&nodes), places)),
        })
    }

    /// Names of the parameters, in the order of [`Dynamics::acceleration`]'s `parameters`.
    pub fn coefficients(&self) -> &[String] {
        &self.coefficients
    }

    /// Numbers of the states that come behind the measured inputs, followed along a record.
    pub fn remembered(&self) -> &[usize] {
        &self.remembered
    }

    /// States that are followed with the motion: each a coordinate behind the model's, whose rate
    /// it is.
    pub fn hidden(&self) -> &[(Arc<Memory>, usize)] {
        &self.hidden
    }

    /// A state of the model (coordinates, then rates) with those of its effects, `states` or at 0
    /// where none are given.
    pub fn with_states(&self, of_model: &[f64], states: &[f64]) -> Vec<f64> {
        let n = of_model.len() / 2;
        let own = (0..self.hidden.len()).map(|k| states.get(k).copied().unwrap_or(0.0));
        let mut out = of_model[..n].to_vec();
        out.resize(n + self.hidden.len(), 0.0);
        out.extend_from_slice(&of_model[n..]);
        out.extend(own);
        out
    }

    fn signs(&self, v: &[f64]) -> Vec<f64> {
        self.switches.iter().map(|w| Function::Sign.value(w.iter().zip(v).map(|(a, b)| a * b).sum())).collect()
    }

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

    fn acceleration(&self, parameters: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, out: &mut [f64]) -> bool {
        self.acceleration_held(parameters, q, v, at, &self.signs(v), out)
    }

    fn partials(&self, parameters: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, out: &mut [f64]) -> bool {
        self.partials_held(parameters, q, v, at, &self.signs(v), out)
    }

    fn switches(&self) -> &[Vec<f64>] {
        &self.switches
    }

    fn acceleration_held(
        &self,
        parameters: &[f64],
        q: &[f64],
        v: &[f64],
        at: &Instant<'_>,
        signs: &[f64],
        out: &mut [f64],
    ) -> bool {
        SCRATCH.with_borrow_mut(|s| self.evaluate(s, Here { parameters, q, v, at, signs }, out))
    }

    fn partials_held(
        &self,
        parameters: &[f64],
        q: &[f64],
        v: &[f64],
        at: &Instant<'_>,
        signs: &[f64],
        out: &mut [f64],
    ) -> bool {
        let mut accelerations = vec![0.0; self.circle.len()];
        if let Some(done) = self.slopes(Here { parameters, q, v, at, signs }, &mut accelerations, out) {
            return done;
        }
        // Hats have corners: central differences with the signs held.
        let n = self.circle.len();
        let width = 2 * n + self.coefficients.len();
        let mut arguments: Vec<f64> = [q, v, parameters].concat();
        let (mut ahead, mut behind) = (vec![0.0; n], vec![0.0; n]);
        for k in 0..width {
            let kept = arguments[k];
            let step = 1e-6 * kept.abs().max(1.0);
            let mut at_step = |value: f64, to: &mut [f64]| {
                arguments[k] = value;
                let (q, rest) = arguments.split_at(n);
                let (v, p) = rest.split_at(n);
                self.acceleration_held(p, q, v, at, signs, to)
            };
            let exists = at_step(kept + step, &mut ahead) && at_step(kept - step, &mut behind);
            arguments[k] = kept;
            if !exists {
                return false;
            }
            (0..n).for_each(|i| out[i * width + k] = (ahead[i] - behind[i]) / (2.0 * step));
        }
        true
    }

    fn takes_states_alone(&self) -> bool {
        self.slopes.is_some()
    }

    fn linearise_held(
        &self,
        parameters: &[f64],
        q: &[f64],
        v: &[f64],
        at: &Instant<'_>,
        signs: &[f64],
        acceleration: &mut [f64],
        partials: &mut [f64],
    ) -> bool {
        if let Some(done) = self.slopes(Here { parameters, q, v, at, signs }, acceleration, partials) {
            return done;
        }
        self.acceleration_held(parameters, q, v, at, signs, acceleration)
            && self.partials_held(parameters, q, v, at, signs, partials)
    }
}

/// An angle wrapped to [−π, π).
pub fn wrapped(x: f64) -> f64 {
    let tau = core::f64::consts::TAU;
    x - tau * (x / tau + 0.5).floor()
}

#[cfg(test)]
#[path = "equations_of_motion_tests.rs"]
mod tests;
