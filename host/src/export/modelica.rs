//! Modelica 3: the equations as they are, solved by the tool.

use super::expression::Printer;
use super::procedural::inline;
use super::program::Program;
use super::remarks::harmless;
use super::{Language, Notation, Printed};
use crate::model::model_file::expression::Symbol;

/// See [`super::LANGUAGES`].
pub struct Modelica;

impl Notation for Modelica {}

impl Language for Modelica {
    fn id(&self) -> &'static str {
        "modelica"
    }

    fn about(&self) -> &'static str {
        "Modelica"
    }

    fn template(&self) -> &'static str {
        include_str!("templates/modelica.mo")
    }

    fn remark(&self) -> &'static str {
        "//"
    }

    fn reserved(&self) -> &'static str {
        "algorithm and annotation block break class connect connector constant constrainedby der discrete \
         each else elseif elsewhen encapsulated end enumeration equation expandable extends external \
         false final flow for function if import impure in initial inner input loop model not operator or \
         outer output package parameter partial protected public pure record redeclare replaceable return \
         stream then true type when while within time Real Integer Boolean String sin cos tan sqrt exp \
         log abs sign tanh floor max wrap hat OMEGA tau pi"
    }

    fn places(&self, p: &Program<'_>) -> Vec<(&'static str, String)> {
        vec![
            ("about", p.about()),
            ("name", p.name.clone()),
            ("title", quoted(&p.motion.name)),
            ("parameters", parameters(p)),
            ("variables", variables(p)),
            ("equations", equations(p)),
        ]
    }
}

/// A text in double quotes.
fn quoted(text: &str) -> String {
    format!("\"{}\"", harmless(text).replace('\\', "\\\\").replace('"', "\\\""))
}

fn parameters(p: &Program<'_>) -> String {
    let omega = p
        .omega
        .iter()
        .map(|(n, w)| format!("  parameter Real {n} = {} \"rad/s; angular frequency of the drive\";", p.signed(*w)));
    let own = p
        .constants
        .iter()
        .map(|c| format!("  parameter Real {} = {} {};", c.name, p.signed(c.value), quoted(&c.about)));
    omega.chain(own).collect::<Vec<_>>().join("\n")
}

/// Name of the second derivative by the drive's phase.
fn second(p: &Program<'_>, i: usize) -> String {
    format!("{}_{}", p.coordinates[i].prime, "tau")
}

fn variables(p: &Program<'_>) -> String {
    let initial = p.initial();
    let n = p.coordinates.len();
    let mut out = Vec::new();
    for (i, c) in p.coordinates.iter().enumerate() {
        out.push(format!("  Real {}(start = {}, fixed = true) {};", c.name, initial[i], quoted(&c.unit)));
        out.push(format!(
            "  Real {}(start = {}, fixed = true) {};",
            c.rate,
            initial[n + i],
            quoted(&format!("{}/s", c.unit))
        ));
        if p.scaled {
            out.push(format!("  Real {} \"d {}/d tau\";", c.prime, c.name));
            out.push(format!("  Real {} \"d2 {}/d tau2\";", second(p, i), c.name));
        }
    }
    if p.depends(|s| s == Symbol::Tau) {
        out.push(format!("  Real {} \"rad; phase of the drive\";", p.tau));
    }
    out.extend(
        p.inputs.iter().map(|(n, unit)| {
            format!("  Real {n} = 0.0 {};", quoted(&format!("{unit}; input, change it to your needs")))
        }),
    );
    out.join("\n")
}

fn equations(p: &Program<'_>) -> String {
    let mut out: Vec<String> = p.coordinates.iter().map(|c| format!("  der({}) = {};", c.name, c.rate)).collect();
    if let Some((omega, _)) = &p.omega {
        if p.depends(|s| s == Symbol::Tau) {
            out.push(format!("  {} = {omega}*time;", p.tau));
        }
        if p.scaled {
            for (i, c) in p.coordinates.iter().enumerate() {
                out.push(format!("  {} = {}/{omega};", c.prime, c.rate));
                out.push(format!("  {} = der({})/{omega}^2;", second(p, i), c.rate));
            }
        }
    }
    for e in 0..p.motion.file.equations.len() {
        let (mut left, mut right) = (Vec::new(), Vec::new());
        for t in p.terms.iter().filter(|t| t.equation == e) {
            let symbol = |s: Symbol| match s {
                Symbol::Acceleration(i) if t.primed && p.scaled => second(p, i),
                Symbol::Acceleration(i) => format!("der({})", p.coordinates[i].rate),
                Symbol::Coordinate(i) if p.coordinates[i].wraps => format!("wrap({})", p.coordinates[i].name),
                Symbol::Time => "time".to_owned(),
                other => p.symbol(other, t.primed),
            };
            let printer = Printer { language: &Modelica, symbol: &symbol };
            let factor = t.constant.map_or("", |c| p.constants[c].name.as_str());
            let printed: Printed = printer.term(factor, &t.of, false);
            if t.constant.is_some() { left.push(printed) } else { right.push(printed) }
        }
        let lines: Vec<String> = left.iter().enumerate().map(|(k, t)| super::procedural::signed(t, k == 0)).collect();
        let right = if right.is_empty() { "0.0".to_owned() } else { inline(&right) };
        out.push(format!("  {} = {right};", lines.join("\n    ")));
    }
    out.join("\n")
}
