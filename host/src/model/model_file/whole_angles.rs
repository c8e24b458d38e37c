//! Sums of angles in written equations, as one angle each.
//!
//! A coordinate on the circle is wrapped where it stands alone. The twist of a shaft, q₂ − q₁, is an
//! angle as well: wrapped apart, its two ends would pass half a turn at times of their own, and the
//! twist leap by a turn and back. So Σ w_i q_i with whole w_i (but for a common factor) becomes
//! wrap(Σ w_i q_i), as the position of a joint between two bodies is.

use super::expression::{
    Expression as E, Function, Node, Symbol, add, as_number, call, divide, multiply, number, power, power_whole,
    subtract,
};

/// An expression, and the weights of the angles that it is a sum of, if it is nothing else.
struct Part {
    node: Node,
    weights: Option<Vec<f64>>,
}

impl Part {
    /// The expression, by itself: a sum of two angles and more as one.
    fn closed(self) -> Node {
        let Some(weights) = self.weights else { return self.node };
        let sizes = || weights.iter().map(|w| w.abs()).filter(|w| *w > 0.0);
        let least = sizes().fold(f64::INFINITY, f64::min);
        if sizes().count() < 2 || sizes().any(|w| (w / least).fract() != 0.0) {
            return self.node;
        }
        if least == 1.0 {
            return call(Function::Wrap, self.node);
        }
        multiply(number(least), call(Function::Wrap, divide(self.node, number(least))))
    }
}

/// An expression with its sums of angles wrapped as a whole; `circle` tells the coordinates that are
/// angles.
pub fn whole_angles(e: &Node, circle: &[bool]) -> Node {
    part(e, circle).closed()
}

fn part(e: &Node, circle: &[bool]) -> Part {
    let rec = |a: &Node| part(a, circle);
    let closed = |a: &Node| whole_angles(a, circle);
    let other = |node: Node| Part { node, weights: None };
    match &**e {
        E::Symbol(Symbol::Coordinate(i)) if circle[*i] => {
            let weights = (0..circle.len()).map(|k| f64::from(u8::from(k == *i))).collect();
            Part { node: e.clone(), weights: Some(weights) }
        }
        E::Add(a, b) => sum(rec(a), rec(b), 1.0, add),
        E::Subtract(a, b) => sum(rec(a), rec(b), -1.0, subtract),
        E::Multiply(a, b) => match (as_number(a), as_number(b)) {
            (Some(x), _) => scaled(rec(b), x, |p| multiply(a.clone(), p)),
            (_, Some(x)) => scaled(rec(a), x, |p| multiply(p, b.clone())),
            _ => other(multiply(closed(a), closed(b))),
        },
        E::Divide(a, b) => match as_number(b) {
            Some(x) => scaled(rec(a), 1.0 / x, |p| divide(p, b.clone())),
            None => other(divide(closed(a), closed(b))),
        },
        E::PowerWhole(a, n) => other(power_whole(closed(a), *n)),
        E::Power(a, b) => other(power(closed(a), closed(b))),
        // Turns make no difference there.
        E::Call(Function::Sin | Function::Cos | Function::Tan | Function::Wrap, _) => other(e.clone()),
        E::Call(f, a) => other(call(*f, closed(a))),
        E::Number(_) | E::Symbol(_) | E::Hat { .. } | E::Memory(..) => other(e.clone()),
    }
}

fn sum(a: Part, b: Part, sign: f64, of: impl Fn(Node, Node) -> Node) -> Part {
    match (&a.weights, &b.weights) {
        (Some(x), Some(y)) => {
            let weights = x.iter().zip(y).map(|(x, y)| x + sign * y).collect();
            Part { node: of(a.node, b.node), weights: Some(weights) }
        }
        _ => Part { node: of(a.closed(), b.closed()), weights: None },
    }
}

fn scaled(a: Part, by: f64, of: impl Fn(Node) -> Node) -> Part {
    match a.weights {
        Some(w) => Part { node: of(a.node), weights: Some(w.iter().map(|w| by * w).collect()) },
        None => Part { node: of(a.node), weights: None },
    }
}

#[cfg(test)]
mod tests {
    use super::super::parser::parse;
    use super::*;
    use crate::model::model_file::names::Names;

    #[test]
    fn sums_of_angles_are_wrapped_as_a_whole() {
        let names = Names { coordinates: vec!["p".into(), "q".into(), "x".into()], inputs: vec![] };
        let read = |t: &str| parse(t, &names).unwrap();
        for (text, wanted) in [
            ("p - q", "wrap(p - q)"),
            ("(p - q)^3 + p'", "wrap(p - q)^3 + p'"),
            ("x*(q - 10*p)", "x*wrap(q - 10*p)"),
            ("(p - q)/4", "0.25*wrap(((p - q)/4)/0.25)"),
            ("abs(p + q) - p", "abs(wrap(p + q)) - p"),
            ("x + (p - q)", "x + wrap(p - q)"),
            // Nothing to do.
            ("sin(p - q)*p", "sin(p - q)*p"),
            ("2*p - 3*q", "2*p - 3*q"),
            ("p - x", "p - x"),
            ("wrap(p - q)", "wrap(p - q)"),
            ("p - q + q", "p - q + q"),
        ] {
            assert_eq!(whole_angles(&read(text), &[true, true, false]), read(wanted), "{text}");
        }
        assert_eq!(whole_angles(&read("p - q"), &[false, false, false]), read("p - q"));
    }
}
