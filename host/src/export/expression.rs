//! Expressions of a model as text of a language: the tree is walked once, with brackets where they
//! are needed and signs drawn forward.

use super::{Notation, Printed};
use crate::model::model_file::expression::{Expression as E, Function, Node, Symbol};

/// How tightly a text binds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// A sum.
    Sum,
    /// A product or quotient.
    Product,
    /// A power.
    Power,
    /// A name, a number, a call.
    Atom,
}

/// A text with its sign in front of it.
struct Piece {
    negative: bool,
    text: String,
    level: Level,
}

/// Prints expressions in a language; `symbol` names what they depend on.
pub struct Printer<'a> {
    /// The language.
    pub language: &'a dyn Notation,
    /// Names of the symbols.
    pub symbol: &'a dyn Fn(Symbol) -> String,
}

impl Printer<'_> {
    /// The text of an expression.
    pub fn text(&self, e: &Node) -> String {
        let p = self.piece(e);
        if p.negative { self.language.negated(&self.at_least(p, Level::Product)) } else { p.text }
    }

    /// A factor times an expression, as a term of a sum; without its factor where that is empty.
    pub fn term(&self, factor: &str, e: &Node, negative: bool) -> Printed {
        let p = self.piece(e);
        let negative = p.negative != negative;
        let one = matches!(&**e, E::Number(x) if x.abs() == 1.0);
        let text = match (factor.is_empty(), one) {
            (true, _) => self.at_least(p, Level::Product),
            (false, true) => factor.to_owned(),
            (false, false) => self.language.product(factor, &self.at_least(p, Level::Product)),
        };
        Printed { negative, text }
    }

    /// The text without its sign, in brackets where it binds less tightly than it must.
    fn at_least(&self, p: Piece, level: Level) -> String {
        if p.level < level { self.language.bracketed(&p.text) } else { p.text }
    }

    /// The same with its sign, as an operand that may not begin with one.
    fn operand(&self, p: Piece, level: Level) -> String {
        if !p.negative {
            return self.at_least(p, level);
        }
        self.language.bracketed(&self.language.negated(&self.at_least(p, Level::Product)))
    }

    fn sum(&self, a: &Node, b: &Node, minus: bool) -> Piece {
        let (a, b) = (self.piece(a), self.piece(b));
        let minus = b.negative != minus;
        // What is subtracted, and what has a sign before it, is one term.
        let least = if minus || b.negative { Level::Product } else { Level::Sum };
        let second = self.at_least(b, least);
        let first = if a.negative { self.language.negated(&self.at_least(a, Level::Product)) } else { a.text };
        Piece { negative: false, text: self.language.added(&first, &second, minus), level: Level::Sum }
    }

    fn piece(&self, e: &Node) -> Piece {
        let l = self.language;
        let atom = |text: String| Piece { negative: false, text, level: Level::Atom };
        match &**e {
            E::Number(x) => Piece { negative: x.is_sign_negative(), ..atom(l.number(x.abs())) },
            E::Symbol(s) => atom((self.symbol)(*s)),
            E::Add(a, b) => self.sum(a, b, false),
            E::Subtract(a, b) => self.sum(a, b, true),
            E::Multiply(a, b) => {
                let (first, second) = (self.piece(a), self.piece(b));
                let negative = first.negative != second.negative;
                if matches!(**a, E::Number(x) if x.abs() == 1.0) {
                    return Piece { negative, ..second };
                }
                let (x, y) = (self.at_least(first, Level::Product), self.at_least(second, Level::Product));
                Piece { negative, text: l.product(&x, &y), level: Level::Product }
            }
            E::Divide(a, b) => {
                let (a, b) = (self.piece(a), self.piece(b));
                let negative = a.negative != b.negative;
                let needs = l.quotient_needs();
                let (text, level) = l.quotient(&self.at_least(a, needs[0]), &self.at_least(b, needs[1]));
                Piece { negative, text, level }
            }
            E::PowerWhole(a, n) => {
                let exponent = if *n < 0 && l.power_needs()[1] == Level::Atom {
                    l.bracketed(&n.to_string())
                } else {
                    n.to_string()
                };
                let (text, level) = l.power(&self.operand(self.piece(a), l.power_needs()[0]), &exponent);
                Piece { negative: false, text, level }
            }
            E::Power(a, b) => {
                let needs = l.power_needs();
                let (text, level) =
                    l.power(&self.operand(self.piece(a), needs[0]), &self.operand(self.piece(b), needs[1]));
                Piece { negative: false, text, level }
            }
            E::Call(f, a) => atom(l.call(*f, &self.text(a))),
            // Models with states are refused before they come here.
            E::Memory(..) => atom("nan".to_owned()),
            E::Hat { from_node, width, period } => atom(l.hat(&self.text(from_node), *width, *period)),
        }
    }
}

/// Whether a function stands somewhere in an expression; none for the hats of an interpolation
/// basis.
pub fn uses(e: &Node, wanted: Option<Function>) -> bool {
    match &**e {
        E::Number(_) | E::Symbol(_) | E::Memory(..) => false,
        E::Add(a, b) | E::Subtract(a, b) | E::Multiply(a, b) | E::Divide(a, b) | E::Power(a, b) => {
            uses(a, wanted) || uses(b, wanted)
        }
        E::PowerWhole(a, _) => uses(a, wanted),
        E::Call(f, a) => wanted == Some(*f) || uses(a, wanted),
        E::Hat { from_node, .. } => wanted.is_none() || uses(from_node, wanted),
    }
}
