//! The left-hand sides F_e = Σ λ_j X_j − Y of written equations as expressions, in seconds: whole,
//! at rest (what the drive's phase moves apart from what it does not), and the part that rests on
//! sines and cosines of angles; and their values at states spread over all angles.
//!
//! Units are those of the equation's right-hand side.

use core::f64::consts::TAU;

use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::{
    Expression, Function, Node, Symbol, add, as_number, multiply, negate, number, subtract, symbol,
};

/// States at which matrices are compared.
pub(super) const STATES: u32 = 16;

/// The left-hand sides Σ λ X − Y in seconds, for coefficients in the order of
/// [`ModelFile::coefficients`].
pub(super) fn sides(model: &ModelFile, omega: f64, values: &[f64]) -> Vec<Node> {
    let places = model.term_places();
    model
        .equations
        .iter()
        .zip(&places)
        .map(|(e, at)| {
            e.terms.iter().zip(at).fold(negate(model.in_seconds(&e.balance, omega)), |sum, (t, &k)| {
                let value = values.get(k).copied().unwrap_or(0.0);
                add(sum, multiply(number(value), model.in_seconds(&t.of, omega)))
            })
        })
        .collect()
}

/// The parts of the left-hand sides at rest that the drive's phase does not move, and those that it
/// does.
pub(super) fn at_rest(model: &ModelFile, omega: f64, values: &[f64]) -> Vec<[Node; 2]> {
    let rest = |n: &Node| {
        model.in_seconds(n, omega).replace(&|s| match s {
            Symbol::Rate(_) | Symbol::Acceleration(_) | Symbol::Input(_) => number(0.0),
            other => symbol(other),
        })
    };
    let places = model.term_places();
    model
        .equations
        .iter()
        .zip(&places)
        .map(|(e, at)| {
            let terms = e.terms.iter().zip(at).map(|(t, &k)| (values.get(k).copied().unwrap_or(0.0), &t.of));
            let mut out = [number(0.0), number(0.0)];
            for (factor, of) in terms.chain([(-1.0, &e.balance)]) {
                let part = rest(of);
                let driven = usize::from(part.any(&|s| matches!(s, Symbol::Tau | Symbol::Time)));
                out[driven] = add(out[driven].clone(), multiply(number(factor), part));
            }
            out
        })
        .collect()
}

/// The additive parts of an expression that hold a sine or cosine of a coordinate.
pub(super) fn of_angles(n: &Node) -> Node {
    match &**n {
        Expression::Add(a, b) => add(of_angles(a), of_angles(b)),
        Expression::Subtract(a, b) => subtract(of_angles(a), of_angles(b)),
        Expression::Multiply(a, b) if as_number(a).is_some() => multiply(a.clone(), of_angles(b)),
        _ if turns(n) => n.clone(),
        _ => number(0.0),
    }
}

fn turns(n: &Node) -> bool {
    match &**n {
        Expression::Call(Function::Sin | Function::Cos, a) => a.any(&|s| matches!(s, Symbol::Coordinate(_))),
        Expression::Call(_, a) | Expression::PowerWhole(a, _) => turns(a),
        Expression::Add(a, b)
        | Expression::Subtract(a, b)
        | Expression::Multiply(a, b)
        | Expression::Divide(a, b)
        | Expression::Power(a, b) => turns(a) || turns(b),
        _ => false,
    }
}

/// Value of coordinate `k` in state `s`: spread over the circle by the golden ratio, and as far on
/// a line.
fn spread(s: u32, k: usize) -> f64 {
    let turn =
        (0.618_033_988_749_895 * f64::from(s + 1) + 0.414_213_562_373_095 * (k + 1) as f64 * f64::from(s + 2)).fract();
    TAU * (turn - 0.5)
}

pub(super) fn value(n: &Node, s: u32, tau: f64) -> f64 {
    n.value(&|symbol| match symbol {
        Symbol::Coordinate(k) => spread(s, k),
        Symbol::Tau => tau,
        _ => 0.0,
    })
}
