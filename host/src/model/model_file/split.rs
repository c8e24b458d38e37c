//! Terms of an equation split into what multiplies each acceleration and the rest, with the signs
//! of dry friction as switches.
//!
//! X = Σ_i ∂X/∂q̈_i q̈_i + X without accelerations, since terms are linear in accelerations (a file
//! with others is refused); an effect's column that is not, as the load of a joint, stays whole.
//! The sign of a linear form w·v of the rates becomes [`Symbol::Held`], which an integrator holds
//! between the zeros of that form.

use super::expression::{Node, Symbol, as_number, call, multiply, number, symbol};
use crate::model::model_file::expression::Function;

/// Where a split term belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Equation.
    pub equation: usize,
    /// Index of the coefficient; none for the balance.
    pub coefficient: Option<usize>,
    /// Acceleration that it multiplies; none for the rest.
    pub acceleration: Option<usize>,
}

/// Terms of a system of n coordinates, split.
#[derive(Clone, Debug, Default)]
pub struct Split {
    n: usize,
    /// Where each of `nodes` belongs.
    pub entries: Vec<Entry>,
    /// The expressions.
    pub nodes: Vec<Node>,
    /// Weights w of the forms whose signs are held, n each.
    pub switches: Vec<Vec<f64>>,
}

impl Split {
    /// Nothing yet, for n coordinates.
    pub fn of(n: usize) -> Self {
        Self { n, ..Self::default() }
    }

    /// Adds a term of an equation.
    pub fn put(&mut self, equation: usize, coefficient: Option<usize>, e: &Node) {
        let e = self.held(e);
        if !e.is_linear_in_accelerations() {
            self.entries.push(Entry { equation, coefficient, acceleration: None });
            self.nodes.push(e);
            return;
        }
        for i in 0..self.n {
            if let Some(d) = e.derivative(Symbol::Acceleration(i)).filter(|d| as_number(d) != Some(0.0)) {
                self.entries.push(Entry { equation, coefficient, acceleration: Some(i) });
                self.nodes.push(d);
            }
        }
        let rest = e.replace(&|s| if matches!(s, Symbol::Acceleration(_)) { number(0.0) } else { symbol(s) });
        if as_number(&rest) != Some(0.0) {
            self.entries.push(Entry { equation, coefficient, acceleration: None });
            self.nodes.push(rest);
        }
    }

    /// Signs of linear forms of the rates become switches.
    pub fn held(&mut self, e: &Node) -> Node {
        let (n, switches) = (self.n, &mut self.switches);
        e.with_signs(&mut |a| {
            let form: Option<Vec<f64>> =
                (0..n).map(|i| a.derivative(Symbol::Rate(i)).and_then(|d| as_number(&d))).collect();
            let linear = form.filter(|w| {
                let at_zero = a.value(&|s| if let Symbol::Rate(_) = s { 0.0 } else { f64::NAN });
                w.iter().any(|x| *x != 0.0) && at_zero == 0.0
            });
            let Some(mut w) = linear else { return call(Function::Sign, a.clone()) };
            // sign(−x) = −sign x, and the size of x does not matter.
            let first = w.iter().copied().find(|x| *x != 0.0).unwrap_or(1.0);
            w.iter_mut().for_each(|x| *x /= first);
            let k = switches.iter().position(|s| *s == w).unwrap_or_else(|| {
                switches.push(w);
                switches.len() - 1
            });
            multiply(number(first.signum()), symbol(Symbol::Held(k)))
        })
    }
}
