//! Terms of an equation split into what multiplies each acceleration and the rest, with the signs
//! of dry friction as switches.
//!
//! X = Σ_i ∂X/∂q̈_i q̈_i + X without accelerations, since terms are linear in accelerations (a file
//! with others is refused); an effect's column that is not, as the load of a joint, stays whole.
//! The sign of a linear form w·v of the rates becomes [`Symbol::Held`], which an integrator holds
//! between the zeros of that form. So do, where it is asked for, the number of turns in the wrapped
//! value of a form w·q of the coordinates, wrap(w·q) = w·q − 2π turns, and the sign of a form of the
//! coordinates, |a| = a sign a.

use core::cell::Cell;

use super::expression::{Node, Symbol, add, as_number, call, multiply, number, subtract, symbol};
use crate::model::dynamics::{Corner, Switch};
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
    /// The relative velocities whose signs are held.
    pub switches: Vec<Switch>,
    /// What is held beside; none where it is not asked for.
    pub positions: Option<Positions>,
}

/// What is held of the coordinates.
#[derive(Clone, Debug, Default)]
pub struct Positions {
    /// Coordinates that are wrapped where they stand alone.
    circle: Vec<bool>,
    /// Weights w of the forms whose turns are held, n each.
    pub seams: Vec<Vec<f64>>,
    /// The positions whose signs are held.
    pub corners: Vec<Corner>,
}

/// Numbers of the first held turns, and of the first sign of a position, until all are known.
const FIRST_SEAM: usize = 1 << 20;
const FIRST_CORNER: usize = 1 << 21;

impl Split {
    /// Nothing yet, for n coordinates.
    pub fn of(n: usize) -> Self {
        Self { n, ..Self::default() }
    }

    /// The same; turns and signs of positions are held as well. `circle`: which coordinates are
    /// wrapped.
    pub fn with_positions(circle: Vec<bool>) -> Self {
        let n = circle.len();
        Self { positions: Some(Positions { circle, ..Positions::default() }), ..Self::of(n) }
    }

    /// Gives turns, and signs of positions, their numbers behind those of the rates' signs.
    pub fn number_positions(&mut self) {
        let signs = self.switches.len();
        let turns = signs + self.positions.as_ref().map_or(0, |p| p.seams.len());
        let own = |s: Symbol| match s {
            Symbol::Held(k) if k >= FIRST_CORNER => symbol(Symbol::Held(turns + k - FIRST_CORNER)),
            Symbol::Held(k) if k >= FIRST_SEAM => symbol(Symbol::Held(signs + k - FIRST_SEAM)),
            other => symbol(other),
        };
        self.nodes.iter_mut().for_each(|node| *node = node.replace(&own));
    }

    /// Signs and sizes of forms of the coordinates become held signs.
    fn cornered(&mut self, e: &Node) -> Node {
        let Some(positions) = self.positions.as_mut() else { return e.clone() };
        let without_sizes = e.with_calls(Function::Abs, &mut |a| match positions.sign_of(a) {
            Some(sign) => multiply(a.clone(), sign),
            None => call(Function::Abs, a.clone()),
        });
        without_sizes.with_calls(Function::Sign, &mut |a| {
            positions.sign_of(a).unwrap_or_else(|| call(Function::Sign, a.clone()))
        })
    }

    /// Wrapped forms of the coordinates become forms less the turns that are held.
    fn unwrapped(&mut self, e: &Node) -> Node {
        let n = self.n;
        let Some(Positions { seams, .. }) = self.positions.as_mut() else { return e.clone() };
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
        let e = self.cornered(&e);
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
        let (n, with_levels, switches) = (self.n, self.positions.is_some(), &mut self.switches);
        e.with_signs(&mut |a| {
            let found = relative_velocity(a, n).filter(|s| with_levels || s.offset == 0.0 && s.inputs.is_empty());
            let Some(mut switch) = found else { return call(Function::Sign, a.clone()) };
            // sign(−x) = −sign x, and the size of x does not matter.
            let first = switch.weights.iter().copied().find(|x| *x != 0.0).unwrap_or(1.0);
            let all = switch.weights.iter_mut().chain(&mut switch.inputs).chain([&mut switch.offset]);
            all.for_each(|x| *x /= first);
            let k = switches.iter().position(|s| *s == switch).unwrap_or_else(|| {
                switches.push(switch);
                switches.len() - 1
            });
            multiply(number(first.signum()), symbol(Symbol::Held(k)))
        })
    }
}

impl Positions {
    /// The held sign of a form of the coordinates with numbers as weights, and a constant; none where
    /// an expression is another.
    fn sign_of(&mut self, a: &Node) -> Option<Node> {
        let slope = |s: Symbol| a.derivative(s).and_then(|d| as_number(&d));
        let wrapped = |s: Symbol| matches!(s, Symbol::Coordinate(i) if self.circle[i]);
        let form = |i: usize| Some(slope(Symbol::Coordinate(i))? + slope(Symbol::Raw(i))?);
        let mut weights: Vec<f64> = (0..self.circle.len()).map(form).collect::<Option<_>>()?;
        let first = weights.iter().copied().find(|x| *x != 0.0)?;
        let seams = (0..self.seams.len()).filter(|k| a.any(&|s| s == Symbol::Held(FIRST_SEAM + k)));
        let turned: Vec<(usize, f64)> =
            seams.map(|k| Some((k, slope(Symbol::Held(FIRST_SEAM + k))? / first))).collect::<Option<_>>()?;
        let offset = a.value(&|s| match s {
            Symbol::Coordinate(_) | Symbol::Raw(_) => 0.0,
            Symbol::Held(k) if (FIRST_SEAM..FIRST_CORNER).contains(&k) => 0.0,
            _ => f64::NAN,
        });
        if a.any(&wrapped) || turned.len() > 1 || !offset.is_finite() {
            return None;
        }
        // sign(−x) = −sign x, and the size of x does not matter.
        weights.iter_mut().for_each(|x| *x /= first);
        let corner = Corner { weights, offset: offset / first, turns: turned.first().copied() };
        let k = self.corners.iter().position(|c| *c == corner).unwrap_or_else(|| {
            self.corners.push(corner);
            self.corners.len() - 1
        });
        Some(multiply(number(first.signum()), symbol(Symbol::Held(FIRST_CORNER + k))))
    }
}

/// A form of the rates of n coordinates and of the measured inputs with numbers as weights, and a
/// constant; none where an expression is another.
fn relative_velocity(a: &Node, n: usize) -> Option<Switch> {
    let slope = |s: Symbol| a.derivative(s).and_then(|d| as_number(&d));
    let weights: Vec<f64> = (0..n).map(|i| slope(Symbol::Rate(i))).collect::<Option<_>>()?;
    let count = Cell::new(0);
    a.any(&|s| {
        if let Symbol::Input(k) = s {
            count.set(count.get().max(k + 1));
        }
        false
    });
    let inputs: Vec<f64> = (0..count.get()).map(|k| slope(Symbol::Input(k))).collect::<Option<_>>()?;
    let offset = a.value(&|s| if matches!(s, Symbol::Rate(_) | Symbol::Input(_)) { 0.0 } else { f64::NAN });
    (weights.iter().any(|x| *x != 0.0) && offset.is_finite()).then_some(Switch { weights, offset, inputs })
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
