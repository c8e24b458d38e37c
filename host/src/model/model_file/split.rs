//! Terms of an equation split into what multiplies each acceleration and the rest, with the signs
//! of dry friction as switches.
//!
//! X = Σ_i ∂X/∂q̈_i q̈_i + X without accelerations, since terms are linear in accelerations (a file
//! with others is refused); an effect's column that is not, as the load of a joint, stays whole.
//! The sign of a linear form w·v of the rates becomes [`Symbol::Held`], which an integrator holds
//! between the zeros of that form. So does, where it is asked for, the number of turns in the
//! wrapped value of a form w·q of the coordinates: wrap(w·q) = w·q − 2π turns.

use super::expression::{Node, Symbol, add, as_number, call, multiply, number, subtract, symbol};
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
    /// Weights w of the forms whose turns are held, n each; none where they are not asked for.
    pub seams: Option<Vec<Vec<f64>>>,
}

/// Number of the first held turns until all signs are known.
const FIRST_SEAM: usize = 1 << 20;

impl Split {
    /// Nothing yet, for n coordinates.
    pub fn of(n: usize) -> Self {
        Self { n, ..Self::default() }
    }

    /// The same; turns of wrapped forms are held as well.
    pub fn with_seams(n: usize) -> Self {
        Self { seams: Some(Vec::new()), ..Self::of(n) }
    }

    /// Gives turns their numbers behind those of the signs.
    pub fn number_seams(&mut self) {
        let signs = self.switches.len();
        let own = |s: Symbol| match s {
            Symbol::Held(k) if k >= FIRST_SEAM => symbol(Symbol::Held(signs + k - FIRST_SEAM)),
            other => symbol(other),
        };
        self.nodes.iter_mut().for_each(|node| *node = node.replace(&own));
    }

    /// Wrapped forms of the coordinates become forms less the turns that are held.
    fn unwrapped(&mut self, e: &Node) -> Node {
        let n = self.n;
        let Some(seams) = self.seams.as_mut() else { return e.clone() };
        e.with_calls(Function::Wrap, &mut |a| {
            let Some(w) = whole_form(a, n) else { return call(Function::Wrap, a.clone()) };
            let terms = w.iter().enumerate().filter(|(_, x)| **x != 0.0);
            let form = terms.fold(number(0.0), |sum, (i, x)| add(sum, multiply(number(*x), symbol(Symbol::Raw(i)))));
            let k = seams.iter().position(|s| *s == w).unwrap_or_else(|| {
                seams.push(w);
                seams.len() - 1
            });
            let turns = multiply(number(core::f64::consts::TAU), symbol(Symbol::Held(FIRST_SEAM + k)));
            subtract(form, turns)
        })
    }

    /// Adds a term of an equation.
    pub fn put(&mut self, equation: usize, coefficient: Option<usize>, e: &Node) {
        let e = self.held(e);
        let e = self.unwrapped(&e);
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

/// Weights of a linear form of the coordinates with whole numbers, which turns of the coordinates
/// themselves do not change; none where an expression is another.
fn whole_form(a: &Node, n: usize) -> Option<Vec<f64>> {
    let w: Vec<f64> =
        (0..n).map(|i| a.derivative(Symbol::Coordinate(i)).and_then(|d| as_number(&d))).collect::<Option<_>>()?;
    // Far from zero, where what is wrapped or bent within would show.
    let place = |i: usize| 11.0 + 3.7 * i as f64;
    let at = a.value(&|s| if let Symbol::Coordinate(i) = s { place(i) } else { f64::NAN });
    let form: f64 = w.iter().enumerate().map(|(i, w)| w * place(i)).sum();
    let whole = w.iter().all(|x| x.fract() == 0.0) && w.iter().any(|x| *x != 0.0);
    (whole && (at - form).abs() < 1e-9).then_some(w)
}
