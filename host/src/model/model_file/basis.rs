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

/// An unknown function as it is written in a file.
pub struct UnknownFunction<'a, 'i> {
    /// The file.
    pub source: &'a Source,
    /// The function's value in it.
    pub value: &'a Value<'i>,
    /// The keys of that.
    pub table: &'a DeTable<'i>,
    /// The function's name.
    pub name: &'a str,
}

/// One function of a basis: its coefficient's name, the expression, and how it is shown.
struct Member {
    coefficient: String,
    of: Node,
    text: String,
}

/// What a function depends on.
struct Argument<'a> {
    of: Node,
    /// As it is written.
    text: &'a str,
    /// Whether it is a coordinate on the circle.
    turns: bool,
}

impl UnknownFunction<'_, '_> {
    /// The terms that a basis stands for.
    ///
    /// # Errors
    /// Unknown keys or bases, numbers out of range.
    pub fn terms(&self, names: &Names, circle: &[bool]) -> Result<Vec<Term>> {
        let Self { source, table, .. } = *self;
        source.known_keys(
            table,
            &["basis", "of", "order", "points", "from", "to", "period", "constant", "times"],
            "an unknown function",
        )?;
        let kind = self.required("basis", "\"harmonic\" or \"interpolation\"")?;
        let of_value = self.required("of", "what the function depends on, such as \"q\"")?;
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
        let turns = matches!(*of, Expression::Symbol(Symbol::Coordinate(i)) if circle.get(i) == Some(&true));
        let argument = Argument { of, text: of_value.get_ref().as_str().unwrap_or_default(), turns };
        let period = self.number("period", 1e-9, 1e9)?;
        let members = match kind.get_ref().as_str() {
            Some("harmonic") => self.harmonics(&argument, period)?,
            Some("interpolation") => self.hats(&argument, period)?,
            _ => {
                return Err(source
                    .bad(kind.span().start, described(kind.get_ref()), "\"harmonic\" or \"interpolation\"")
                    .remedy("Choose one of the two bases"));
            }
        };
        let term = |m: Member| Term {
            name: m.coefficient,
            of: multiply(times.clone(), m.of),
            text: m.text,
            each_record: false,
        };
        Ok(members.into_iter().map(term).collect())
    }

    /// A constant where one is asked for, then cosine and sine of every order.
    fn harmonics(&self, argument: &Argument<'_>, period: Option<f64>) -> Result<Vec<Member>> {
        let (name, text) = (self.name, argument.text);
        let order = self.needed("order", (1.0, MOST), "the highest harmonic")?;
        let scale = period.map_or(1.0, |p| core::f64::consts::TAU / p);
        let mut out = Vec::new();
        if self.table.get("constant").is_some_and(|v| v.get_ref().as_bool() == Some(true)) {
            out.push(Member { coefficient: format!("{name}_0"), of: number(1.0), text: "1".to_owned() });
        }
        // In range 1 … 60: the cast is exact but for a fraction, which is cut.
        for k in 1..=order as u32 {
            let angle = multiply(number(f64::from(k) * scale), argument.of.clone());
            let suffix = if k == 1 { String::new() } else { k.to_string() };
            for (short, f) in [("cos", Function::Cos), ("sin", Function::Sin)] {
                out.push(Member {
                    coefficient: format!("{name}_{short}{suffix}"),
                    of: call(f, angle.clone()),
                    text: format!("{short}({k}·{text})"),
                });
            }
        }
        Ok(out)
    }

    /// Hats on a grid over a period or a range.
    fn hats(&self, argument: &Argument<'_>, period: Option<f64>) -> Result<Vec<Member>> {
        let (name, text) = (self.name, argument.text);
        let points = self.needed("points", (2.0, MOST), "the number of grid points")? as u32;
        let period = period.or_else(|| argument.turns.then_some(core::f64::consts::TAU));
        let (from, to) = self.range(period)?;
        let intervals = if period.is_some() { points } else { points - 1 };
        let width = (to - from) / f64::from(intervals.max(1));
        let hat = |k: u32| {
            let node = from + f64::from(k) * width;
            let hat = Expression::Hat { from_node: subtract(argument.of.clone(), number(node)), width, period };
            Member {
                coefficient: format!("{name}_{}", k + 1),
                of: Arc::new(hat),
                text: format!("hat({text} at {node:.6})"),
            }
        };
        Ok((0..points).map(hat).collect())
    }

    /// Where a grid begins and ends.
    fn range(&self, period: Option<f64>) -> Result<(f64, f64)> {
        let (low, high) = (-1e9, 1e9);
        let given = (self.number("from", low, high)?, self.number("to", low, high)?);
        let start = self.value.span().start;
        match (given, period) {
            ((None, None), Some(p)) => Ok((-0.5 * p, 0.5 * p)),
            (_, Some(_)) => Err(self
                .source
                .bad(start, "from or to on a periodic grid", "neither")
                .remedy("The grid covers the whole period")),
            (_, None) => {
                let what = "from and to, the range of the function";
                let from = self.needed("from", (low, high), what)?;
                let to = self.needed("to", (low, high), what)?;
                if to > from {
                    return Ok((from, to));
                }
                Err(self
                    .source
                    .bad(start, "to not above from", "from < to")
                    .remedy("Give the range over which the function is sought"))
            }
        }
    }

    /// A number, where the key is there.
    fn number(&self, key: &str, low: f64, high: f64) -> Result<Option<f64>> {
        self.table.get(key).map(|v| self.within(key, v, low, high)).transpose()
    }

    /// A number whose key must be there.
    fn needed(&self, key: &str, (low, high): (f64, f64), what: &str) -> Result<f64> {
        self.within(key, self.required(key, what)?, low, high)
    }

    fn required(&self, key: &str, what: &str) -> Result<&Value<'_>> {
        self.source.required(self.table, self.value.span(), key, what)
    }

    fn within(&self, key: &str, value: &Value<'_>, low: f64, high: f64) -> Result<f64> {
        let expected = format!("a number from {low} to {high}");
        let x = self.source.number(value, &expected)?;
        if !(low..=high).contains(&x) {
            return Err(self.source.bad(value.span().start, x.to_string(), expected).remedy(format!("Correct {key}")));
        }
        Ok(x)
    }
}
