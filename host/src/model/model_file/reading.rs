//! Coordinates, inputs and equations of a model file, read and checked: every mistake is told with
//! its line and column and how to mend it.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::basis::UnknownFunction;
use super::expression::{self, Node, Symbol, as_number};
use super::parser::{self, Mistake, Names};
use super::toml_place::{Source, Value, described};
use super::whole_angles::whole_angles;
use super::{Coordinate, Equation, Space, Term, by_parts, tautology};
use crate::error::{BadInput, Result};
use crate::model::weak::Order;

/// Most coordinates, inputs and equations.
pub(super) const MOST_NAMES: usize = 64;
/// Most terms of one equation.
const MOST_TERMS: usize = 200;

/// Whether a text can be a name in expressions.
fn is_name(text: &str) -> bool {
    text.chars().next().is_some_and(|c| c.is_alphabetic() || c == '_')
        && text.chars().all(|c| c.is_alphanumeric() || c == '_')
        && text.len() <= 64
}

pub(crate) fn check_name(source: &Source, at: usize, name: &str, taken: &[String]) -> Result<()> {
    if !is_name(name) {
        return Err(source
            .bad(at, format!("the name \"{name}\""), "letters, digits and _, a letter first, at most 64")
            .remedy("Rename it"));
    }
    if ["tau", "pi"].contains(&name) || expression::FUNCTIONS.iter().any(|f| f.0 == name) {
        return Err(source
            .bad(at, format!("the name \"{name}\""), "a name that expressions do not use otherwise")
            .remedy("Rename it"));
    }
    if taken.iter().any(|t| t == name) {
        return Err(source
            .bad(at, format!("the name \"{name}\" a second time"), "each name once")
            .remedy("Rename one"));
    }
    Ok(())
}

pub(super) fn coordinates(
    source: &Source,
    top: &DeTable<'_>,
    span: &std::ops::Range<usize>,
) -> Result<Vec<Coordinate>> {
    let example = "coordinates such as [{ name = \"q\", space = \"R\" }]";
    let list = source.required(top, span.clone(), "coordinates", example)?;
    let DeValue::Array(array) = list.get_ref() else {
        return Err(source.bad(list.span().start, described(list.get_ref()), example).remedy("Write a list"));
    };
    if array.is_empty() || array.len() > MOST_NAMES {
        return Err(source
            .bad(list.span().start, format!("{} coordinates", array.len()), format!("1 to {MOST_NAMES}"))
            .remedy("Name the quantities that move"));
    }
    let mut out: Vec<Coordinate> = Vec::new();
    for item in array {
        let DeValue::Table(t) = item.get_ref() else {
            return Err(source
                .bad(item.span().start, described(item.get_ref()), "{ name = \"q\", space = \"R\" }")
                .remedy("Give each coordinate its name and space"));
        };
        source.known_keys(t, &["name", "space"], "a coordinate")?;
        let name = source.required(t, item.span(), "name", "the coordinate's name")?;
        let text = source.text(name, "the coordinate's name")?;
        let taken: Vec<String> = out.iter().map(|c| c.name.clone()).collect();
        check_name(source, name.span().start, text, &taken)?;
        let space = source.required(t, item.span(), "space", "space = \"R\" or \"S1\"")?;
        let space = match space.get_ref().as_str() {
            Some("R") => Space::Line,
            Some("S1") => Space::Circle,
            _ => {
                return Err(source
                    .bad(space.span().start, described(space.get_ref()), "\"R\", or \"S1\" for an angle that may whirl")
                    .remedy("Correct the space"));
            }
        };
        out.push(Coordinate { name: text.to_owned(), space });
    }
    Ok(out)
}

pub(super) fn inputs(source: &Source, top: &DeTable<'_>, coordinates: &[Coordinate]) -> Result<Vec<String>> {
    let Some(list) = top.get("inputs") else { return Ok(Vec::new()) };
    let expected = "a list of names such as [\"force\"]";
    let DeValue::Array(array) = list.get_ref() else {
        return Err(source.bad(list.span().start, described(list.get_ref()), expected).remedy("Write a list"));
    };
    if array.len() > MOST_NAMES {
        return Err(source.bad(list.span().start, format!("{} inputs", array.len()), format!("at most {MOST_NAMES}")));
    }
    let mut taken: Vec<String> = coordinates.iter().map(|c| c.name.clone()).collect();
    for item in array {
        let text = source.text(item, expected)?;
        check_name(source, item.span().start, text, &taken)?;
        taken.push(text.to_owned());
    }
    Ok(taken.split_off(coordinates.len()))
}

/// Parses the expression in a text value.
pub(super) fn expression_of(source: &Source, value: &Value<'_>, names: &Names, what: &str) -> Result<Node> {
    let text = source.text(value, &format!("{what} in quotes"))?;
    parser::parse(text, names).map_err(|m| mistake(source, value, text, m))
}

pub(crate) fn mistake(source: &Source, value: &Value<'_>, text: &str, m: Mistake) -> BadInput {
    let shown: String = text.chars().take(80).collect();
    let more = if shown.len() < text.len() { "…" } else { "" };
    let found = if text.is_empty() { m.found } else { format!("{} in \"{shown}{more}\"", m.found) };
    source.bad(source.inside(value, m.at.start), found, m.expected).remedy(m.remedy)
}

/// A term written as a table: `{ of = "1", each = "record" }`.
fn detailed(source: &Source, value: &Value<'_>, table: &DeTable<'_>, name: &str, names: &Names) -> Result<Term> {
    source.known_keys(table, &["of", "each", "basis"], "a term")?;
    let of_value = source.required(table, value.span(), "of", "of, the expression")?;
    let of = expression_of(source, of_value, names, "an expression")?;
    let each_record = match table.get("each") {
        None => false,
        Some(v) if v.get_ref().as_str() == Some("record") => true,
        Some(v) => {
            return Err(source
                .bad(v.span().start, described(v.get_ref()), "\"record\"")
                .remedy("each = \"record\" gives each record its own coefficient"));
        }
    };
    let text = source.text(of_value, "an expression")?.to_owned();
    Ok(Term { name: name.to_owned(), of, text, each_record })
}

pub(super) fn equation(source: &Source, value: &Value<'_>, names: &Names, circle: &[bool]) -> Result<Equation> {
    let span = value.span();
    let DeValue::Table(t) = value.get_ref() else {
        return Err(source
            .bad(span.start, described(value.get_ref()), "[[equation]] with balance and terms")
            .remedy("Write [[equation]] in double brackets"));
    };
    source.known_keys(t, &["balance", "terms"], "an equation")?;
    let balance_value =
        source.required(t, span.clone(), "balance", "the right-hand side, such as \"force\" or \"-q''\"")?;
    let balance = expression_of(source, balance_value, names, "the right-hand side")?;
    if as_number(&balance).is_some_and(|x| x == 0.0) {
        return Err(source
            .bad(balance_value.span().start, "a right-hand side that is 0", "something measured, such as \"-q''\"")
            .remedy(
                "Without it all coefficients are known up to a factor only: move a term with a known coefficient there",
            ));
    }
    check_integrable(source, balance_value, &balance, circle)?;
    let balance = whole_angles(&balance, circle);
    let terms_value = source.required(t, span, "terms", "terms such as { M = \"q''\" }")?;
    let DeValue::Table(list) = terms_value.get_ref() else {
        return Err(source
            .bad(terms_value.span().start, described(terms_value.get_ref()), "a table such as { M = \"q''\" }")
            .remedy("Give each unknown coefficient its expression"));
    };
    if list.is_empty() {
        return Err(source
            .bad(terms_value.span().start, "no term", "one unknown coefficient at least")
            .remedy("Add a term such as M = \"q''\""));
    }
    let mut keys: Vec<(&Spanned<_>, &Value<'_>)> = list.iter().collect();
    keys.sort_by_key(|(k, _)| k.span().start);
    let mut terms: Vec<Term> = Vec::new();
    for (key, value) in keys {
        let name: &str = key.get_ref();
        if !is_name(name) {
            check_name(source, key.span().start, name, &[])?;
        }
        let new = match value.get_ref() {
            DeValue::Table(table) if table.get("basis").is_none() => vec![detailed(source, value, table, name, names)?],
            DeValue::Table(table) => UnknownFunction { source, value, table, name }.terms(names, circle)?,
            _ => {
                let of = expression_of(source, value, names, "an expression")?;
                let text = source.text(value, "an expression")?.to_owned();
                vec![Term { name: name.to_owned(), of, text, each_record: false }]
            }
        };
        for term in new {
            if as_number(&term.of).is_some_and(|x| x == 0.0) {
                return Err(source
                    .bad(
                        value.span().start,
                        format!("{} = \"{}\", which is 0", term.name, term.text),
                        "an expression that varies",
                    )
                    .remedy("Remove the term or correct it"));
            }
            let of = whole_angles(&term.of, circle);
            if let Some(same) = terms.iter().find(|o| o.of == of || o.name == term.name) {
                let found = format!("{} = \"{}\", the same as {}", term.name, term.text, same.name);
                return Err(source
                    .bad(value.span().start, found, "terms that differ")
                    .remedy("Two coefficients of one expression cannot be told apart: keep one"));
            }
            check_integrable(source, value, &term.of, circle)?;
            terms.push(Term { of, ..term });
        }
        if terms.len() > MOST_TERMS {
            return Err(source.bad(
                value.span().start,
                format!("{} terms", terms.len()),
                format!("at most {MOST_TERMS}"),
            ));
        }
    }
    let balance_text = source.text(balance_value, "an expression")?.to_owned();
    if tautology::is_sum_of(&balance, terms.iter().map(|t| &t.of)) {
        let found = format!("\"{balance_text}\", a sum of its own terms: it holds whatever the record says");
        return Err(source
            .bad(
                balance_value.span().start,
                found,
                "something measured that no sum of the terms gives, such as \"-q''\"",
            )
            .remedy("Take the term that is meant out of terms, or put another one on this side"));
    }
    Ok(Equation { balance, balance_text, terms })
}

/// Refuses what has no weak form: accelerations that cannot be integrated by parts, and factors of
/// accelerations that jump where an angle passes from π to −π.
fn check_integrable(source: &Source, value: &Value<'_>, e: &Node, circle: &[bool]) -> Result<()> {
    let at = source.inside(value, 0);
    let shown = value.get_ref().as_str().unwrap_or("the basis");
    let pieces = by_parts::pieces(e, 1.0, circle).map_err(|m| {
        source
            .bad(at, format!("{m} in \"{shown}\""), "accelerations that integration by parts removes: q'' f(q, inputs, tau), q'' q'^n")
            .remedy("The record gives angles, not accelerations: write the term so that each acceleration stands as a factor")
    })?;
    for piece in pieces.iter().filter(|p| p.order == Order::First) {
        for (i, _) in circle.iter().enumerate().filter(|(_, c)| **c) {
            let at_turn = |turns: f64, k: f64| {
                piece.of.value(&|s| match s {
                    Symbol::Coordinate(j) if j == i => 0.37 * k + turns * core::f64::consts::TAU,
                    Symbol::Raw(_) => 1.0,
                    _ => 0.5 + 0.11 * k,
                })
            };
            if (1..6).any(|k| {
                let (a, b) = (at_turn(0.0, f64::from(k)), at_turn(1.0, f64::from(k)));
                (a - b).abs() > 1e-6 * (1.0 + a.abs())
            }) {
                return Err(source
                    .bad(
                        at,
                        format!(
                            "an acceleration times a function that is not periodic in an S1 coordinate in \"{shown}\""
                        ),
                        "sin, cos of the angle",
                    )
                    .remedy("Use space = \"R\" if the angle never whirls"));
            }
        }
    }
    Ok(())
}
