//! What languages with statements share: constants, names taken off the state, sums one term a
//! line, the right-hand side's places.

use super::program::{Constant, Program};
use super::{Language, Printed};
use crate::model::model_file::expression::{Function, Symbol};

/// How statements are written.
pub trait Procedural: Language {
    /// What stands before a statement of the right-hand side.
    fn indent(&self) -> &'static str {
        "    "
    }

    /// What stands before a constant.
    fn constant_indent(&self) -> &'static str {
        ""
    }

    /// A constant.
    fn constant(&self, name: &str, value: &str) -> String {
        format!("{name} = {value}")
    }

    /// A local quantity.
    fn define(&self, name: &str, value: &str) -> String {
        format!("{name} = {value}")
    }

    /// A statement that sets something there already.
    fn assign(&self, target: &str, value: &str) -> String {
        format!("{target} = {value}")
    }

    /// Element i (from 0) of a vector.
    fn element(&self, vector: &str, i: usize) -> String {
        format!("{vector}[{i}]")
    }

    /// Element (i, j) (from 0) of a matrix.
    fn entry(&self, matrix: &str, i: usize, j: usize) -> String;

    /// A sum over several lines; `terms` are two at least, `indent` is what stands before the
    /// statement.
    fn sum(&self, target: &str, terms: &[Printed], indent: &str) -> String;

    /// The sign of dry friction k: held by the integrator, or that of a form of the rates.
    fn held(&self, k: usize, form: &str) -> String;

    /// A row of numbers inside of a list of rows.
    fn row(&self, items: &[String]) -> String {
        format!("[{}]", items.join(", "))
    }

    /// Behind every row but the last.
    fn row_end(&self) -> &'static str {
        ", "
    }
}

/// A term with its sign in front; the first has none where it is positive.
pub fn signed(term: &Printed, first: bool) -> String {
    match (term.negative, first) {
        (true, true) => format!("-{}", term.text),
        (false, true) => term.text.clone(),
        (true, false) => format!("- {}", term.text),
        (false, false) => format!("+ {}", term.text),
    }
}

/// A sum on one line.
pub fn inline(terms: &[Printed]) -> String {
    terms.iter().enumerate().map(|(k, t)| signed(t, k == 0)).collect::<Vec<_>>().join(" ")
}

/// Each statement on its line.
fn lines(indent: &str, all: &[String]) -> String {
    all.iter().map(|l| format!("{indent}{l}")).collect::<Vec<_>>().join("\n")
}

/// A statement with a comment behind it.
fn commented(l: &dyn Procedural, statement: &str, about: &str) -> String {
    if about.is_empty() {
        statement.to_owned()
    } else {
        format!("{statement}  {} {}", l.remark(), super::remarks::harmless(about))
    }
}

/// Places that every language with statements fills alike.
pub fn places(l: &dyn Procedural, p: &Program<'_>) -> Vec<(&'static str, String)> {
    let n = p.coordinates.len();
    let switches: Vec<String> = (0..p.signs.len()).map(|k| l.row(&p.switch(k))).collect();
    let zeros = vec![l.number(0.0); p.inputs.len()];
    vec![
        ("about", p.about()),
        ("name", p.name.clone()),
        ("constants", constants(l, p)),
        ("locals", locals(l, p)),
        ("matrix", matrix(l, p)),
        ("right", right(l, p)),
        ("rates", rates(l, p).join(", ")),
        (
            "rates_assigned",
            lines(
                l.indent(),
                &rates(l, p).iter().enumerate().map(|(i, r)| l.assign(&l.element("dx", i), r)).collect::<Vec<_>>(),
            ),
        ),
        ("state", p.state().join(", ")),
        ("n", n.to_string()),
        ("2n", (2 * n).to_string()),
        ("m", p.inputs.len().to_string()),
        ("input_names", p.inputs.iter().map(|i| i.0.as_str()).collect::<Vec<_>>().join(", ")),
        ("zeros", zeros.join(", ")),
        ("switches", switches.join(l.row_end())),
        ("switch_count", p.signs.len().to_string()),
        ("initial", p.initial().join(", ")),
        ("columns", std::iter::once("t").chain(p.state()).collect::<Vec<_>>().join(",")),
    ]
}

fn constants(l: &dyn Procedural, p: &Program<'_>) -> String {
    let omega = p.omega.iter().map(|(name, value)| {
        commented(l, &l.constant(name, &p.signed(*value)), "rad/s; angular frequency of the drive")
    });
    let line = |c: &Constant| commented(l, &l.constant(&c.name, &p.signed(c.value)), &c.about);
    lines(l.constant_indent(), &omega.chain(p.constants.iter().map(line)).collect::<Vec<_>>())
}

/// Names taken off state, inputs and time, as far as the equations use them.
fn locals(l: &dyn Procedural, p: &Program<'_>) -> String {
    let n = p.coordinates.len();
    let mut out = Vec::new();
    for (i, c) in p.coordinates.iter().enumerate() {
        if p.depends(|s| matches!(s, Symbol::Coordinate(k) | Symbol::Raw(k) if k == i)) {
            let x = l.element("x", i);
            let (value, about) = if c.wraps {
                (l.call(Function::Wrap, &x), format!("{}, in [-pi, pi)", c.unit))
            } else {
                (x, c.unit.clone())
            };
            out.push(commented(l, &l.define(&c.name, &value), &about));
        }
    }
    for (i, c) in p.coordinates.iter().enumerate() {
        out.push(commented(l, &l.define(&c.rate, &l.element("x", n + i)), &format!("{}/s", c.unit)));
    }
    for (k, (name, unit)) in p.inputs.iter().enumerate() {
        if p.depends(|s| matches!(s, Symbol::Input(j) | Symbol::RawInput(j) if j == k)) {
            out.push(commented(l, &l.define(name, &l.element("u", k)), unit));
        }
    }
    if let Some((omega, _)) = &p.omega {
        if p.depends(|s| s == Symbol::Tau) {
            out.push(commented(l, &l.define(&p.tau, &l.product(omega, &p.time)), "rad; phase of the drive"));
        }
        for (i, c) in p.coordinates.iter().enumerate().filter(|(i, _)| p.needs_prime(*i)) {
            let value = l.quotient(&c.rate, omega).0;
            out.push(commented(l, &l.define(&c.prime, &value), &format!("d {}/d tau", p.coordinates[i].name)));
        }
    }
    for (k, sign) in p.signs.iter().enumerate() {
        out.push(commented(l, &l.define(sign, &l.held(k, &p.form(k))), "sign in the dry friction"));
    }
    lines(l.indent(), &out)
}

/// The elements of the mass matrix that are not 0.
fn matrix(l: &dyn Procedural, p: &Program<'_>) -> String {
    let n = p.coordinates.len();
    let mut out = Vec::new();
    for e in 0..n {
        for i in (0..n).filter(|i| !p.is_empty(e, Some(*i))) {
            out.push(l.assign(&l.entry("matrix", e, i), &inline(&p.sum(e, Some(i)))));
        }
    }
    lines(l.indent(), &out)
}

/// The right-hand sides, one term a line.
fn right(l: &dyn Procedural, p: &Program<'_>) -> String {
    let mut out = Vec::new();
    for e in (0..p.coordinates.len()).filter(|e| !p.is_empty(*e, None)) {
        let (terms, target) = (p.sum(e, None), l.element("right", e));
        out.push(if terms.len() == 1 {
            l.assign(&target, &inline(&terms))
        } else {
            l.sum(&target, &terms, l.indent())
        });
    }
    lines(l.indent(), &out)
}

/// Rates of the state.
fn rates(l: &dyn Procedural, p: &Program<'_>) -> Vec<String> {
    let accelerations = (0..p.coordinates.len()).map(|i| {
        let a = l.element("acceleration", i);
        match &p.omega {
            Some((omega, _)) if p.scaled => l.product(&l.power(omega, "2").0, &a),
            _ => a,
        }
    });
    p.coordinates.iter().map(|c| c.rate.clone()).chain(accelerations).collect()
}
