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
//! The signs of linear forms of the rates (dry friction) are the system's switches, the turns of
//! wrapped forms of the coordinates its seams.
//!
//! A state z of an effect that remembers is followed as the rate of a further coordinate, whose
//! acceleration is the law of dz/dt: coordinates are then those of the model and one for each
//! state, on which nothing else depends ([`EquationsOfMotion::hidden`]).

pub mod abreast;
mod evaluation;
mod linear_systems;
mod memories;

use std::sync::Arc;

pub use self::linear_systems::solve;
use self::memories::{hidden, remembered, state_rate, with_rates};
use super::ModelFile;
use super::expression::{Node, Symbol, add, as_number, subtract, symbol};
use super::memory::Memory;
use super::split::{Entry, Split};
use super::tape::Tape;
use crate::error::Result;
use crate::model::dynamics::{Corner, Switch};

/// A model file that can be integrated.
#[derive(Clone, Debug)]
pub struct EquationsOfMotion {
    coefficients: Vec<String>,
    circle: Vec<bool>,
    switches: Vec<Switch>,
    seams: Vec<Vec<f64>>,
    corners: Vec<Corner>,
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
        let mut coefficients = model.coefficients().to_vec();
        let hidden = hidden(extra);
        let all = n + hidden.len();
        let circle = [model.circle(), vec![false; hidden.len()]].concat();
        let mut built = Split::with_positions(circle.clone());
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
        built.number_positions();
        let states = (0..all).map(Symbol::Coordinate).chain((0..all).map(Symbol::Rate));
        let variables: Vec<Symbol> = states.chain((0..all).map(Symbol::Acceleration)).collect();
        let mut slopes = Some((Vec::new(), Vec::new()));
        for (k, node) in built.nodes.iter().enumerate() {
            for (j, by) in variables.iter().enumerate() {
                match derivative(node, *by) {
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
        let positions = built.positions.unwrap_or_default();
        Ok(Self {
            coefficients,
            circle,
            inputs: model.inputs.len(),
            remembered: remembered(extra),
            hidden,
            switches: built.switches,
            seams: positions.seams,
            corners: positions.corners,
            tape: Tape::new(&built.nodes),
            implicit: built.nodes.iter().any(|node| node.accelerates()),
            entries: built.entries,
            slopes: slopes.map(|(nodes, places)| (Tape::new(&nodes), places)),
        })
    }

    /// Names of the parameters, in the order in which accelerations take them.
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
}

/// Derivative between jumps; a coordinate that is not wrapped moves with the one that is.
fn derivative(node: &Node, by: Symbol) -> Option<Node> {
    let own = node.derivative_between_jumps(by)?;
    match by {
        Symbol::Coordinate(i) => Some(add(own, node.derivative_between_jumps(Symbol::Raw(i))?)),
        _ => Some(own),
    }
}

/// Whole turns of an angle: what is left of it lies in [−π, π).
pub fn turns(x: f64) -> f64 {
    (x / core::f64::consts::TAU + 0.5).floor()
}

/// An angle wrapped to [−π, π).
pub fn wrapped(x: f64) -> f64 {
    x - core::f64::consts::TAU * turns(x)
}

#[cfg(test)]
#[path = "equations_of_motion_tests.rs"]
mod tests;
