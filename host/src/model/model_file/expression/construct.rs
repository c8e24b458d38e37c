//! Constructors of expressions that fold constants and drop neutral elements: 0 + a = a, 1 a = a, x
//! (y a) = (x y) a, a¹ = a.

use std::sync::Arc;

use super::{Expression as E, Function, Node, Symbol};

/// A number.
pub fn number(x: f64) -> Node {
    Arc::new(E::Number(x))
}

/// A symbol.
pub fn symbol(s: Symbol) -> Node {
    Arc::new(E::Symbol(s))
}

/// The number that a node is, if it is one.
pub fn as_number(a: &Node) -> Option<f64> {
    match **a {
        E::Number(x) => Some(x),
        _ => None,
    }
}

/// a + b.
pub fn add(a: Node, b: Node) -> Node {
    match (as_number(&a), as_number(&b)) {
        (Some(x), Some(y)) => number(x + y),
        (Some(0.0), _) => b,
        (_, Some(0.0)) => a,
        _ => Arc::new(E::Add(a, b)),
    }
}

/// a − b.
pub fn subtract(a: Node, b: Node) -> Node {
    match (as_number(&a), as_number(&b)) {
        (Some(x), Some(y)) => number(x - y),
        (_, Some(0.0)) => a,
        (Some(0.0), _) => multiply(number(-1.0), b),
        _ => Arc::new(E::Subtract(a, b)),
    }
}

/// a b.
pub fn multiply(a: Node, b: Node) -> Node {
    match (as_number(&a), as_number(&b)) {
        (Some(x), Some(y)) => number(x * y),
        (Some(x), _) | (_, Some(x)) if x == 0.0 => number(0.0),
        (Some(1.0), _) => b,
        (_, Some(1.0)) => a,
        // A number comes first, and numbers join.
        (None, Some(_)) => multiply(b, a),
        (Some(x), None) => {
            if let E::Multiply(c, d) = &*b
                && let Some(y) = as_number(c)
            {
                return multiply(number(x * y), d.clone());
            }
            Arc::new(E::Multiply(a, b))
        }
        _ => Arc::new(E::Multiply(a, b)),
    }
}

/// a/b.
pub fn divide(a: Node, b: Node) -> Node {
    match (as_number(&a), as_number(&b)) {
        (Some(x), Some(y)) => number(x / y),
        (_, Some(1.0)) => a,
        (Some(0.0), _) => number(0.0),
        _ => Arc::new(E::Divide(a, b)),
    }
}

/// aᵇ.
pub fn power(a: Node, b: Node) -> Node {
    match (as_number(&a), as_number(&b)) {
        (Some(x), Some(y)) => number(x.powf(y)),
        (_, Some(y)) if y.fract() == 0.0 && y.abs() <= 1000.0 => power_whole(a, y as i32),
        (_, Some(0.5)) => call(Function::Sqrt, a),
        _ => Arc::new(E::Power(a, b)),
    }
}

/// aⁿ.
pub fn power_whole(a: Node, n: i32) -> Node {
    match (as_number(&a), n) {
        (Some(x), _) => number(x.powi(n)),
        (_, 0) => number(1.0),
        (_, 1) => a,
        _ => Arc::new(E::PowerWhole(a, n)),
    }
}

/// f(a).
pub fn call(f: Function, a: Node) -> Node {
    match as_number(&a) {
        Some(x) => number(f.value(x)),
        None => Arc::new(E::Call(f, a)),
    }
}

/// −a.
pub fn negate(a: Node) -> Node {
    multiply(number(-1.0), a)
}
