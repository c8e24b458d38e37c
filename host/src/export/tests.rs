//! Expressions as each language writes them.

use super::expression::Printer;
use super::*;
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::parser::{Names, parse};

fn printed(language: &dyn Language, text: &str) -> String {
    let names = Names { coordinates: vec!["q".into(), "p".into()], inputs: vec!["u".into()] };
    let symbol = |s: Symbol| match s {
        Symbol::Coordinate(i) => ["q", "p"][i].to_owned(),
        Symbol::Rate(i) => format!("v{i}"),
        _ => "u".to_owned(),
    };
    Printer { language, symbol: &symbol }.text(&parse(text, &names).unwrap())
}

#[test]
fn brackets_stand_where_they_are_needed() {
    for (text, wanted) in [
        ("-q^2*(p - q) - (q + p)", "-q**2*(p - q) - (q + p)"),
        ("q - (-2*p)", "q + 2.0*p"),
        ("(q*p)/(u*q)", "q*p/(u*q)"),
        ("q/(p/u)", "q/(p/u)"),
        ("(-q)^3 + (q^2)^p", "(-q)**3 + (q**2)**p"),
        ("exp(-(q'/2)^2)*sign(q' - p')", "exp(-(v0/2.0)**2)*sign(v0 - v1)"),
        ("q^-2", "q**(-2)"),
    ] {
        assert_eq!(printed(&python::Python, text), wanted);
    }
    assert_eq!(printed(&c::C, "-q^2*abs(p)"), "-pow(q, 2)*fabs(p)");
    assert_eq!(printed(&latex::Latex, "q/(p + 1)*2e-7"), "2\\cdot 10^{-7} \\, \\frac{q}{p + 1}");
    assert_eq!(printed(&matlab::Matlab, "sqrt(q)^p"), "sqrt(q)^p");
}

#[test]
fn a_language_that_there_is_not_is_refused() {
    assert!(language("basic").is_err_and(|e| e.to_string().contains("python, matlab, julia, c, modelica, latex")));
}
