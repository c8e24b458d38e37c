//! Unknown functions left free: a term `f = { basis = "harmonic", of = "q", order = 3 }` stands for
//! several.
//!
//! - harmonic: f(q) = Σ_k a_k cos k q + b_k sin k q, k = 1 … order (q scaled by 2π/`period` where
//!   one is given), coefficients `f_cos`, `f_sin`, `f_cos2`, `f_sin2` …, and `f_0` with
//!   `constant = true`;
//! - interpolation: hats on a grid of `points`, periodic over a turn for an angle, between `from`
//!   and `to` otherwise (constant beyond is not implied: hats are zero there), coefficients `f_1` …
//!   ;
//! - `times = "cos(tau)"` multiplies all of them.
//!
//! These are the two bases of the seed's (2.6).

use std::sync::Arc;

use toml::de::DeTable;

use super::Term;
use super::expression::{Expression, Function, Node, Symbol, call, multiply, number, subtract};
use super::parser::Names;
use super::toml_place::{Source, Value, described};
use crate::error::Result;

/// Most functions of a basis.
const MOST: f64 = 60.0;

/// The terms that a basis stands for.
///
/// # Errors
/// Unknown keys or bases, numbers out of range.
pub fn terms(
    source: &Source,
    value: &Value<'_>,
    table: &DeTable<'_>,
    name: &str,
    names: &Names,
    circle: &[bool],
) -> Result<Vec<Term>> {
    let span = value.span();
    source.known_keys(
        table,
        &["basis", "of", "order", "points", "from", "to", "period", "constant", "times"],
        "an unknown function",
    )?;
    let kind = source.required(table, span.clone(), "basis", "\"harmonic\" or \"interpolation\"")?;
    let of_value = source.required(table, span.clone(), "of", "what the function depends on, such as \"q\"")?;
    let of = super::reading::expression_of(source, of_value, names, "an expression")?;
    if of.accelerates() {
        return Err(source
            .bad(of_value.span().start, "a function of an acceleration", "of coordinates, velocities or inputs")
            .remedy("Choose what the function depends on"));
    }
    let times = match table.get("times") {
        Some(v) => super::reading::expression_of(source, v, names, "a factor")?,
        None => number(1.0),
    };
    let get = |key: &str, low: f64, high: f64| -> Result<Option<f64>> {
        let expected = format!("a number from {low} to {high}");
        let Some(v) = table.get(key) else { return Ok(None) };
        let x = source.number(v, &expected)?;
        if !(low..=high).contains(&x) {
            return Err(source.bad(v.span().start, x.to_string(), expected).remedy(format!("Correct {key}")));
        }
        Ok(Some(x))
    };
    let missing = |key: &str, expected: &str| source.required(table, span.clone(), key, expected).map(|_| 0.0);
    let text = of_value.get_ref().as_str().unwrap_or_default();
    let period = get("period", 1e-9, 1e9)?;
    let functions: Vec<(String, Node, String)> = match kind.get_ref().as_str() {
        Some("harmonic") => {
            let order = match get("order", 1.0, MOST)? {
                Some(k) => k,
                None => missing("order", "the highest harmonic")?,
            };
            let scale = period.map_or(1.0, |p| core::f64::consts::TAU / p);
            let constant = table.get("constant").is_some_and(|v| v.get_ref().as_bool() == Some(true));
            let mut out = Vec::new();
            if constant {
                out.push((format!("{name}_0"), number(1.0), "1".to_owned()));
            }
            // In range 1 … 60: the cast is exact but for a fraction, which is cut.
            for k in 1..=order as u32 {
                let argument = multiply(number(f64::from(k) * scale), of.clone());
                let suffix = if k == 1 { String::new() } else { k.to_string() };
                for (short, f) in [("cos", Function::Cos), ("sin", Function::Sin)] {
                    out.push((
                        format!("{name}_{short}{suffix}"),
                        call(f, argument.clone()),
                        format!("{short}({k}·{text})"),
                    ));
                }
            }
            out
        }
        Some("interpolation") => {
            let points = match get("points", 2.0, MOST)? {
                Some(n) => n as u32,
                None => missing("points", "the number of grid points")? as u32,
            };
            let turn = matches!(*of, Expression::Symbol(Symbol::Coordinate(i)) if circle.get(i) == Some(&true));
            let period = period.or_else(|| turn.then_some(core::f64::consts::TAU));
            let (from, to) = match (get("from", -1e9, 1e9)?, get("to", -1e9, 1e9)?, period) {
                (None, None, Some(p)) => (-0.5 * p, 0.5 * p),
                (Some(a), Some(b), None) if b > a => (a, b),
                (Some(_), Some(_), None) => {
                    return Err(source
                        .bad(span.start, "to not above from", "from < to")
                        .remedy("Give the range over which the function is sought"));
                }
                (_, _, Some(_)) => {
                    return Err(source
                        .bad(span.start, "from or to on a periodic grid", "neither")
                        .remedy("The grid covers the whole period"));
                }
                _ => missing("from", "from and to, the range of the function")
                    .and_then(|_| missing("to", "from and to, the range of the function"))
                    .map(|x| (x, x))?,
            };
            let intervals = if period.is_some() { points } else { points - 1 };
            let width = (to - from) / f64::from(intervals.max(1));
            (0..points)
                .map(|k| {
                    let node = from + f64::from(k) * width;
                    let hat = Expression::Hat { from_node: subtract(of.clone(), number(node)), width, period };
                    (format!("{name}_{}", k + 1), Arc::new(hat), format!("hat({text} at {node:.6})"))
                })
                .collect()
        }
        _ => {
            return Err(source
                .bad(kind.span().start, described(kind.get_ref()), "\"harmonic\" or \"interpolation\"")
                .remedy("Choose one of the two bases"));
        }
    };
    Ok(functions
        .into_iter()
        .map(|(name, f, text)| Term { name, of: multiply(times.clone(), f), text, each_record: false })
        .collect())
}
