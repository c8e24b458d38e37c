//! Expressions as people read them: MathML for a page, plain text for a terminal.

use super::Notation;
use super::expression::Level;
use crate::model::model_file::expression::{FUNCTIONS, Function};
use crate::wording::format::{mathml_number, shortest, significant};

/// MathML.
pub(super) struct MathMl;

/// Text in plain Unicode.
pub(super) struct Text;

impl Notation for MathMl {
    fn number(&self, x: f64) -> String {
        mathml_number(&rounded(x))
    }

    fn product(&self, a: &str, b: &str) -> String {
        // Numbers side by side would read as one.
        let between = if b.starts_with("<mn>") { "<mo>·</mo>" } else { "<mspace width=.17em></mspace>" };
        format!("{a}{between}{b}")
    }

    fn quotient(&self, a: &str, b: &str) -> (String, Level) {
        (format!("<mfrac><mrow>{a}</mrow><mrow>{b}</mrow></mfrac>"), Level::Power)
    }

    fn quotient_needs(&self) -> [Level; 2] {
        [Level::Sum, Level::Sum]
    }

    fn power(&self, a: &str, n: &str) -> (String, Level) {
        let exponent = if n.starts_with('<') { n.to_owned() } else { mathml_number(n) };
        (format!("<msup><mrow>{a}</mrow><mrow>{exponent}</mrow></msup>"), Level::Power)
    }

    fn power_needs(&self) -> [Level; 2] {
        [Level::Atom, Level::Sum]
    }

    fn call(&self, f: Function, a: &str) -> String {
        match f {
            Function::Sqrt => format!("<msqrt>{a}</msqrt>"),
            Function::Abs => format!("<mrow><mo stretchy=false>|</mo>{a}<mo stretchy=false>|</mo></mrow>"),
            f => format!("<mi>{}</mi><mo>&#x2061;</mo>{}", name_of(f), self.bracketed(a)),
        }
    }

    fn hat(&self, d: &str, width: f64, _period: Option<f64>) -> String {
        format!("<mi>hat</mi><mo>&#x2061;</mo>{}", self.bracketed(&self.quotient(d, &self.number(width)).0))
    }

    fn bracketed(&self, a: &str) -> String {
        format!("<mrow><mo stretchy=false>(</mo>{a}<mo stretchy=false>)</mo></mrow>")
    }

    fn negated(&self, a: &str) -> String {
        format!("<mo>−</mo>{a}")
    }

    fn added(&self, a: &str, b: &str, minus: bool) -> String {
        format!("{a}<mo>{}</mo>{b}", if minus { '−' } else { '+' })
    }
}

impl Notation for Text {
    fn number(&self, x: f64) -> String {
        rounded(x)
    }

    fn product(&self, a: &str, b: &str) -> String {
        let digit = b.chars().next().is_some_and(|c| c.is_ascii_digit());
        format!("{a}{}{b}", if digit { "·" } else { " " })
    }

    fn power(&self, a: &str, n: &str) -> (String, Level) {
        let text = match n.trim_matches(['(', ')']).parse() {
            Ok(whole) => format!("{a}{}", crate::wording::format::superscript(whole)),
            Err(_) => format!("{a}^{n}"),
        };
        (text, Level::Power)
    }

    fn call(&self, f: Function, a: &str) -> String {
        match f {
            Function::Abs => format!("|{a}|"),
            f => format!("{}({a})", name_of(f)),
        }
    }

    fn hat(&self, d: &str, width: f64, _period: Option<f64>) -> String {
        format!("hat(({d})/{})", self.number(width))
    }

    fn negated(&self, a: &str) -> String {
        format!("−{a}")
    }

    fn added(&self, a: &str, b: &str, minus: bool) -> String {
        format!("{a} {} {b}", if minus { '−' } else { '+' })
    }
}

/// A number inside an expression: five digits tell all that a person reads there.
pub(super) fn rounded(x: f64) -> String {
    let rounded: f64 = format!("{x:.4e}").parse().unwrap_or(x);
    if rounded == 0.0 || (1e-3..1e6).contains(&rounded) { shortest(rounded) } else { significant(x, 5) }
}

/// Name of a function.
fn name_of(f: Function) -> &'static str {
    FUNCTIONS.iter().find(|x| x.1 == f).map_or("", |x| x.0)
}
