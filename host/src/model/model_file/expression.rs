//! Expressions over coordinates, their derivatives, inputs and the drive's phase: constructors that
//! simplify, derivatives, values.
//!
//! Nodes are shared (`Arc`), so that what integration by parts makes of an expression costs little.
//! Constructors fold constants and drop neutral elements; nothing else is rearranged, so that an
//! expression is evaluated as it was written.

mod construct;

use std::sync::Arc;

pub use self::construct::{
    add, as_number, call, divide, multiply, negate, number, power, power_whole, subtract, symbol,
};
use super::memory::Memory;

/// A shared expression.
pub type Node = Arc<Expression>;

/// What an expression depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Symbol {
    /// Coordinate i, smoothed; on S1 wrapped to [−π, π).
    Coordinate(usize),
    /// Its first derivative.
    Rate(usize),
    /// Its second derivative.
    Acceleration(usize),
    /// Input k, smoothed.
    Input(usize),
    /// Its first derivative (only integration by parts makes it).
    InputRate(usize),
    /// Phase of the drive.
    Tau,
    /// Time of the record, s (columns of effects only).
    Time,
    /// Coordinate i as measured, unwrapped (weak form only).
    Raw(usize),
    /// Input k as measured (weak form only).
    RawInput(usize),
    /// First derivative of coordinate i in the band that stands clear of noise, for signs (weak
    /// form only): a noisy sign is wrong whenever the
    /// velocity is small for a while, which weakens the column (C11 by 0.7 % at 1024 counts).
    ClearRate(usize),
    /// Sign of switch k of the equations of motion (dry friction), held by an integrator.
    Held(usize),
    /// State k of an effect with a memory (inside the laws of its rates only).
    State(usize),
    /// State of an effect with a memory, followed along the record under this number (explanations
    /// only): see [`super::memory`].
    Memory(usize),
}

/// Functions of one argument.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Function {
    /// Sine.
    Sin,
    /// Cosine.
    Cos,
    /// Tangent.
    Tan,
    /// Square root.
    Sqrt,
    /// Exponential.
    Exp,
    /// Natural logarithm.
    Log,
    /// Absolute value.
    Abs,
    /// Sign; sign 0 = 0.
    Sign,
    /// Hyperbolic tangent.
    Tanh,
    /// An angle wrapped to [−π, π).
    Wrap,
}

/// Functions by name.
pub const FUNCTIONS: &[(&str, Function)] = &[
    ("sin", Function::Sin),
    ("cos", Function::Cos),
    ("tan", Function::Tan),
    ("sqrt", Function::Sqrt),
    ("exp", Function::Exp),
    ("log", Function::Log),
    ("abs", Function::Abs),
    ("sign", Function::Sign),
    ("tanh", Function::Tanh),
    ("wrap", Function::Wrap),
];

impl Function {
    /// Its value.
    pub fn value(self, x: f64) -> f64 {
        match self {
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tan => x.tan(),
            Self::Sqrt => x.sqrt(),
            Self::Exp => x.exp(),
            Self::Log => x.ln(),
            Self::Abs => x.abs(),
            Self::Sign => {
                if x > 0.0 {
                    1.0
                } else if x < 0.0 {
                    -1.0
                } else {
                    0.0 * x
                }
            }
            Self::Tanh => x.tanh(),
            Self::Wrap => super::equations_of_motion::wrapped(x),
        }
    }
}

/// An expression.
#[derive(Clone, Debug, PartialEq)]
pub enum Expression {
    /// A number.
    Number(f64),
    /// A symbol.
    Symbol(Symbol),
    /// a + b.
    Add(Node, Node),
    /// a − b.
    Subtract(Node, Node),
    /// a b.
    Multiply(Node, Node),
    /// a/b.
    Divide(Node, Node),
    /// aⁿ with a whole n.
    PowerWhole(Node, i32),
    /// aᵇ.
    Power(Node, Node),
    /// f(a).
    Call(Function, Node),
    /// max(0, 1 − |a|/width), a hat of an interpolation basis; a is wrapped to ± period/2 first
    /// where there is a period.
    Hat {
        /// Distance from the hat's node.
        from_node: Node,
        /// Half width.
        width: f64,
        /// Period of the grid.
        period: Option<f64>,
    },
    /// State k of an effect with a memory, by the laws of its rates.
    Memory(Arc<Memory>, usize),
}

use Expression as E;

/// Sizes of motion at which two expressions are compared, in turn, and points: what falls off within
/// a small velocity is nothing at large ones.
const SIZES: [f64; 4] = [1.0, 0.1, 0.01, 1e-3];
const COMPARED: u32 = 12;
/// Share by which a ratio may differ from point to point: rounding where small motions cancel.
const ALIKE: f64 = 1e-7;

/// The number k for which a = k b, by their values at points of several sizes; none where there is
/// none. Where both are zero nothing is said.
pub fn multiple(a: &Node, b: &Node) -> Option<f64> {
    // Neither sums nor differences of two coordinates stand still from point to point.
    let wave = |size: f64, k: f64, i: usize| size * (1.7 * k + 2.3 * i as f64 + 0.4 * k * i as f64 + 0.5).sin();
    let at = |e: &Node, point: u32| {
        let (k, size) = (f64::from(point), SIZES[point as usize % SIZES.len()]);
        e.value(&|s| match s {
            Symbol::Coordinate(i) => size * wave(1.9, k, i),
            Symbol::Rate(i) => size * wave(2.3, k + 0.7, i),
            Symbol::Acceleration(i) => size * wave(3.1, k + 1.3, i),
            Symbol::Input(i) => size * wave(1.3, k + 2.1, i),
            Symbol::Memory(i) => size * wave(1.1, k + 2.9, i),
            // Times unevenly apart, lest a tone be the same at all of them.
            _ => 0.4 + 0.7 * (0.618_034 * k * k).fract(),
        })
    };
    let both = (0..COMPARED).map(|point| (at(a, point), at(b, point)));
    let ratios: Vec<f64> = both.filter(|v| *v != (0.0, 0.0)).map(|(a, b)| a / b).collect();
    let first = *ratios.first()?;
    ratios.iter().all(|r| r.is_finite() && (r - first).abs() <= ALIKE * first.abs()).then_some(first)
}

/// What a hat is at a distance from its node.
pub fn hat(distance: f64, width: f64, period: Option<f64>) -> f64 {
    let d = period.map_or(distance, |p| distance - p * (distance / p).round());
    (1.0 - d.abs() / width).max(0.0)
}

impl Expression {
    /// Direct parts.
    fn children(&self) -> [Option<&Node>; 2] {
        match self {
            E::Number(_) | E::Symbol(_) | E::Memory(..) => [None, None],
            E::Add(a, b) | E::Subtract(a, b) | E::Multiply(a, b) | E::Divide(a, b) | E::Power(a, b) => {
                [Some(a), Some(b)]
            }
            E::PowerWhole(a, _) | E::Call(_, a) | E::Hat { from_node: a, .. } => [Some(a), None],
        }
    }

    /// Whether some symbol in it satisfies a condition.
    pub fn any(&self, wanted: &dyn Fn(Symbol) -> bool) -> bool {
        match self {
            E::Symbol(s) => wanted(*s),
            _ => self.children().into_iter().flatten().any(|c| c.any(wanted)),
        }
    }

    /// Whether it jumps where something with one of some symbols in it turns its sign.
    pub fn jumps_with(&self, wanted: &dyn Fn(Symbol) -> bool) -> bool {
        match self {
            E::Call(Function::Sign, a) if a.any(wanted) => true,
            _ => self.children().into_iter().flatten().any(|c| c.jumps_with(wanted)),
        }
    }

    /// States of effects with a memory in it, each once, in the order in which they stand.
    pub fn memories(&self, into: &mut Vec<(Arc<Memory>, usize)>) {
        match self {
            E::Memory(m, k) if !into.iter().any(|(n, j)| (n, j) == (m, k)) => into.push((m.clone(), *k)),
            _ => self.children().into_iter().flatten().for_each(|c| c.memories(into)),
        }
    }

    /// The same with each state of an effect with a memory replaced.
    pub fn with_memories(&self, with: &dyn Fn(&Arc<Memory>, usize) -> Node) -> Node {
        self.rebuilt(&symbol, with)
    }

    /// Whether it holds an acceleration.
    pub fn accelerates(&self) -> bool {
        self.any(&|s| matches!(s, Symbol::Acceleration(_)))
    }

    /// Whether its derivatives by accelerations hold none.
    pub fn is_linear_in_accelerations(&self) -> bool {
        let bends = |s: Symbol| self.derivative(s).is_none_or(|d| d.accelerates());
        !self.any(&|s| matches!(s, Symbol::Acceleration(_)) && bends(s))
    }

    /// The same with each symbol replaced; the laws of a memory stay.
    pub fn replace(&self, with: &dyn Fn(Symbol) -> Node) -> Node {
        self.rebuilt(with, &|m, k| Arc::new(E::Memory(m.clone(), k)))
    }

    fn rebuilt(&self, with: &dyn Fn(Symbol) -> Node, memory: &dyn Fn(&Arc<Memory>, usize) -> Node) -> Node {
        let r = |a: &Node| a.rebuilt(with, memory);
        match self {
            E::Number(x) => number(*x),
            E::Symbol(s) => with(*s),
            E::Memory(m, k) => memory(m, *k),
            E::Add(a, b) => add(r(a), r(b)),
            E::Subtract(a, b) => subtract(r(a), r(b)),
            E::Multiply(a, b) => multiply(r(a), r(b)),
            E::Divide(a, b) => divide(r(a), r(b)),
            E::Power(a, b) => power(r(a), r(b)),
            E::PowerWhole(a, n) => power_whole(r(a), *n),
            E::Call(f, a) => call(*f, r(a)),
            E::Hat { from_node, width, period } => {
                Arc::new(E::Hat { from_node: r(from_node), width: *width, period: *period })
            }
        }
    }

    /// The same with rates inside the argument of a sign taken from the clear band.
    pub fn with_clear_signs(&self) -> Node {
        self.with_signs(&mut |a| {
            let clear = |s| if let Symbol::Rate(i) = s { symbol(Symbol::ClearRate(i)) } else { symbol(s) };
            call(Function::Sign, a.replace(&clear))
        })
    }

    /// The same with coordinates as they were measured, where nothing but coordinates (and time and
    /// phase) is in it; otherwise as it is.
    pub fn with_measured_coordinates(&self) -> Node {
        let moves = |s: Symbol| !matches!(s, Symbol::Coordinate(_) | Symbol::Raw(_) | Symbol::Tau | Symbol::Time);
        let moved = self.any(&moves);
        self.replace(&|s| match s {
            Symbol::Coordinate(i) if !moved => symbol(Symbol::Raw(i)),
            other => symbol(other),
        })
    }

    /// The same with the sign of each argument replaced.
    pub fn with_signs(&self, with: &mut dyn FnMut(&Node) -> Node) -> Node {
        self.with_calls(Function::Sign, with)
    }

    /// The same with a function of each argument replaced, the outermost where it stands in itself.
    pub fn with_calls(&self, of: Function, with: &mut dyn FnMut(&Node) -> Node) -> Node {
        let mut r = |a: &Node| a.with_calls(of, with);
        match self {
            E::Call(f, a) if *f == of => with(a),
            E::Number(x) => number(*x),
            E::Symbol(s) => symbol(*s),
            E::Memory(m, k) => Arc::new(E::Memory(m.clone(), *k)),
            E::Add(a, b) => add(r(a), r(b)),
            E::Subtract(a, b) => subtract(r(a), r(b)),
            E::Multiply(a, b) => multiply(r(a), r(b)),
            E::Divide(a, b) => divide(r(a), r(b)),
            E::Power(a, b) => power(r(a), r(b)),
            E::PowerWhole(a, n) => power_whole(r(a), *n),
            E::Call(f, a) => call(*f, r(a)),
            E::Hat { from_node, width, period } => {
                Arc::new(E::Hat { from_node: r(from_node), width: *width, period: *period })
            }
        }
    }

    /// Partial derivative by a symbol; `None` where it has a jump (the derivative of a sign or of a
    /// hat).
    pub fn derivative(&self, by: Symbol) -> Option<Node> {
        self.derive(by, false)
    }

    /// The same between the jumps of signs: what a solution feels that does not stand on one.
    pub fn derivative_between_jumps(&self, by: Symbol) -> Option<Node> {
        self.derive(by, true)
    }

    fn derive(&self, by: Symbol, between: bool) -> Option<Node> {
        if !self.any(&|s| s == by) {
            return Some(number(0.0));
        }
        Some(match self {
            E::Number(_) => number(0.0),
            E::Symbol(_) => number(1.0),
            E::Add(a, b) => add(a.derive(by, between)?, b.derive(by, between)?),
            E::Subtract(a, b) => subtract(a.derive(by, between)?, b.derive(by, between)?),
            E::Multiply(a, b) => {
                add(multiply(a.derive(by, between)?, b.clone()), multiply(a.clone(), b.derive(by, between)?))
            }
            E::Divide(a, b) => {
                let first = divide(a.derive(by, between)?, b.clone());
                let second = divide(multiply(a.clone(), b.derive(by, between)?), power_whole(b.clone(), 2));
                subtract(first, second)
            }
            E::PowerWhole(a, n) => {
                multiply(multiply(number(f64::from(*n)), power_whole(a.clone(), n - 1)), a.derive(by, between)?)
            }
            E::Power(a, b) => {
                // (aᵇ)′ = aᵇ (b′ log a + b a′/a).
                let exponent = multiply(b.derive(by, between)?, call(Function::Log, a.clone()));
                let base = divide(multiply(b.clone(), a.derive(by, between)?), a.clone());
                multiply(power(a.clone(), b.clone()), add(exponent, base))
            }
            E::Call(f, a) => {
                let outer = match f {
                    Function::Sin => call(Function::Cos, a.clone()),
                    Function::Cos => negate(call(Function::Sin, a.clone())),
                    Function::Tan => power_whole(call(Function::Cos, a.clone()), -2),
                    Function::Sqrt => divide(number(0.5), call(Function::Sqrt, a.clone())),
                    Function::Exp => call(Function::Exp, a.clone()),
                    Function::Log => divide(number(1.0), a.clone()),
                    Function::Abs => call(Function::Sign, a.clone()),
                    Function::Tanh => subtract(number(1.0), power_whole(call(Function::Tanh, a.clone()), 2)),
                    Function::Wrap => number(1.0),
                    Function::Sign if between => number(0.0),
                    Function::Sign => return None,
                };
                multiply(outer, a.derive(by, between)?)
            }
            E::Hat { .. } => return None,
            // It holds no symbol of its own.
            E::Memory(..) => number(0.0),
        })
    }

    /// Value for given values of the symbols.
    pub fn value(&self, of: &dyn Fn(Symbol) -> f64) -> f64 {
        match self {
            E::Number(x) => *x,
            E::Symbol(s) => of(*s),
            E::Add(a, b) => a.value(of) + b.value(of),
            E::Subtract(a, b) => a.value(of) - b.value(of),
            E::Multiply(a, b) => a.value(of) * b.value(of),
            E::Divide(a, b) => a.value(of) / b.value(of),
            E::Power(a, b) => a.value(of).powf(b.value(of)),
            E::PowerWhole(a, n) => a.value(of).powi(*n),
            E::Call(f, a) => f.value(a.value(of)),
            E::Hat { from_node, width, period } => hat(from_node.value(of), *width, *period),
            // What is to come of it must be put in its place first.
            E::Memory(..) => f64::NAN,
        }
    }
}

#[cfg(test)]
#[path = "expression_tests.rs"]
mod tests;
