//! Equations that hold whatever a record says: a right-hand side that is a sum of its own terms,
//! b = Σ c_k f_k as functions (`balance = "x"` beside a term `x`). The coefficients are then known
//! beforehand, describe nothing, and leave no acceleration to integrate.
//!
//! b and the f_k are evaluated at points spread over [−2, 2] in every symbol (Weyl's sequences),
//! four times as many as there are terms; b is such a sum where least squares leaves nothing but
//! rounding.

use nalgebra::{DMatrix, DVector};

use super::expression::{Node, Symbol};

/// Share of the right-hand side that may be left: rounding, over condition numbers up to a million.
const LEFT: f64 = 1e-9;
/// Fewest points.
const POINTS: usize = 32;

/// A value of a symbol at a point, in [−2, 2].
fn value(symbol: Symbol, point: usize) -> f64 {
    let (kind, i) = match symbol {
        Symbol::Coordinate(i) | Symbol::Raw(i) => (0, i),
        Symbol::Rate(i) | Symbol::ClearRate(i) => (1, i),
        Symbol::Acceleration(i) => (2, i),
        Symbol::Input(i) | Symbol::RawInput(i) => (3, i),
        Symbol::InputRate(i) | Symbol::Held(i) => (4, i),
        Symbol::Tau => (5, 0),
        Symbol::Time => (5, 1),
        Symbol::State(i) | Symbol::Memory(i) => (6, i),
    };
    // Steps that no small whole numbers relate, another for each symbol.
    let root = ((6 * i + kind) as f64 + 0.5).sqrt() * core::f64::consts::E.sqrt();
    4.0 * ((point + 1) as f64 * root).fract() - 2.0
}

/// Whether the right-hand side is a sum of these terms, whatever they are multiplied with.
pub(super) fn is_sum_of<'a>(balance: &Node, terms: impl Iterator<Item = &'a Node>) -> bool {
    let terms: Vec<&Node> = terms.collect();
    let at = |node: &Node, point: usize| node.value(&|s| value(s, point));
    let rows: Vec<(f64, Vec<f64>)> = (0..POINTS.max(4 * terms.len()))
        .map(|p| (at(balance, p), terms.iter().map(|t| at(t, p)).collect::<Vec<f64>>()))
        .filter(|(b, f)| b.is_finite() && f.iter().all(|x| x.is_finite()))
        .collect();
    if rows.len() < 2 * terms.len() + 2 {
        return false;
    }
    let right = DVector::from_iterator(rows.len(), rows.iter().map(|r| r.0));
    let mut left = DMatrix::from_fn(rows.len(), terms.len(), |r, c| rows[r].1[c]);
    for mut column in left.column_iter_mut() {
        let size = column.norm();
        if size > 0.0 {
            column /= size;
        }
    }
    let size = right.norm();
    let Ok(found) = left.clone().svd(true, true).solve(&right, 1e-12) else { return false };
    size > 0.0 && (left * found - &right).norm() <= LEFT * size
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::model::model_file::ModelFile;

    fn parsed(balance: &str, terms: &str) -> Option<String> {
        let text = format!(
            "name = \"m\"\ncoordinates = [{{ name = \"x\", space = \"R\" }}]\ninputs = [\"u\"]\n[[equation]]\nbalance = \"{balance}\"\nterms = {{ {terms} }}\n"
        );
        ModelFile::parse(&text, Path::new("m.toml")).err().map(|e| e.to_string())
    }

    #[test]
    fn an_equation_that_always_holds_is_refused() {
        let terms = "m = \"x''\", c = \"x'\", k = \"x\", k3 = \"x^3\"";
        for balance in ["--x", "-2*x", "x' + x^3/7", "x*(1 + x^2)", "x''"] {
            let e = parsed(balance, terms).unwrap();
            assert!(e.contains("line 5, column 11") && e.contains("its own terms"), "{balance}: {e}");
        }
        for balance in ["u", "-u*x'", "sin(x)", "x^5", "u + x"] {
            assert_eq!(parsed(balance, terms), None, "{balance}");
        }
        assert_eq!(parsed("-x''", "c = \"x'\", f = \"sign(x')\", s = \"sqrt(x - 1.99)\""), None);
    }
}
