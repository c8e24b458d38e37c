//! LaTeX: the equations as a page sets them, a table of the parameters with their standard errors,
//! the effects.

use super::expression::{Level, Printer};
use super::program::Program;
use super::remarks::harmless;
use super::{Language, Notation, Printed};
use crate::model::model_file::expression::{Function, Symbol};
use crate::motion::Acts;

/// See [`super::LANGUAGES`].
pub struct Latex;

impl Notation for Latex {
    fn number(&self, x: f64) -> String {
        let text = format!("{x:?}");
        match text.split_once('e') {
            Some((digits, power)) => format!("{digits}\\cdot 10^{{{power}}}"),
            None => text.strip_suffix(".0").map_or(text.clone(), str::to_owned),
        }
    }

    fn product(&self, a: &str, b: &str) -> String {
        let digit = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit());
        let between = if digit(b.chars().next()) { " \\cdot " } else { " \\, " };
        format!("{a}{between}{b}")
    }

    fn quotient(&self, a: &str, b: &str) -> (String, Level) {
        (format!("\\frac{{{a}}}{{{b}}}"), Level::Power)
    }

    fn quotient_needs(&self) -> [Level; 2] {
        [Level::Sum, Level::Sum]
    }

    fn power(&self, a: &str, n: &str) -> (String, Level) {
        // A derivative's prime and a power would stand at one place.
        let base = if a.ends_with('\'') { format!("{{{a}}}") } else { a.to_owned() };
        (format!("{base}^{{{n}}}"), Level::Power)
    }

    fn power_needs(&self) -> [Level; 2] {
        [Level::Atom, Level::Sum]
    }

    fn call(&self, f: Function, a: &str) -> String {
        match f {
            Function::Sqrt => format!("\\sqrt{{{a}}}"),
            Function::Abs => format!("\\left|{a}\\right|"),
            Function::Exp => format!("\\exp\\left({a}\\right)"),
            Function::Log => format!("\\ln\\left({a}\\right)"),
            Function::Sign => format!("\\operatorname{{sign}}\\left({a}\\right)"),
            Function::Wrap => format!("\\operatorname{{wrap}}\\left({a}\\right)"),
            Function::Sin => format!("\\sin\\left({a}\\right)"),
            Function::Cos => format!("\\cos\\left({a}\\right)"),
            Function::Tan => format!("\\tan\\left({a}\\right)"),
            Function::Tanh => format!("\\tanh\\left({a}\\right)"),
        }
    }

    fn hat(&self, d: &str, width: f64, period: Option<f64>) -> String {
        let of = match period {
            Some(p) => format!("\\operatorname{{wrap}}_{{{}}}\\left({d}\\right)", self.number(p)),
            None => d.to_owned(),
        };
        format!("\\max\\left(0, 1 - \\frac{{\\left|{of}\\right|}}{{{}}}\\right)", self.number(width))
    }

    fn bracketed(&self, a: &str) -> String {
        format!("\\left({a}\\right)")
    }
}

impl Language for Latex {
    fn id(&self) -> &'static str {
        "latex"
    }

    fn about(&self) -> &'static str {
        "LaTeX (amsmath)"
    }

    fn template(&self) -> &'static str {
        include_str!("templates/latex.tex")
    }

    fn remark(&self) -> &'static str {
        "%"
    }

    fn reserved(&self) -> &'static str {
        ""
    }

    fn places(&self, p: &Program<'_>) -> Vec<(&'static str, String)> {
        vec![
            ("about", p.about()),
            ("title", text(&p.motion.name)),
            ("equations", equations(p)),
            ("parameters", parameters(p)),
            ("effects", effects(p)),
            ("omega", p.omega.as_ref().map_or_else(String::new, |(_, w)| self.number(*w))),
        ]
    }
}

/// A text as LaTeX sets it.
fn text(plain: &str) -> String {
    let mut out = String::new();
    for c in harmless(plain).chars() {
        match c {
            '\\' => out.push_str("\\textbackslash{}"),
            '^' => out.push_str("\\textasciicircum{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => out.extend(['\\', c]),
            '²' => out.push_str("\\textsuperscript{2}"),
            '³' => out.push_str("\\textsuperscript{3}"),
            '⁴' => out.push_str("\\textsuperscript{4}"),
            '⁵' => out.push_str("\\textsuperscript{5}"),
            '⁻' => out.push_str("\\textsuperscript{-}"),
            '¹' => out.push_str("\\textsuperscript{1}"),
            '−' => out.push('-'),
            '·' => out.push_str("\\(\\cdot\\)"),
            '…' => out.push_str("\\ldots{}"),
            c if c.is_ascii() => out.push(c),
            c => match symbol_of(c) {
                Some(name) => out.push_str(&format!("\\(\\{name}\\)")),
                None => out.push(c),
            },
        }
    }
    out
}

/// The command of a Greek letter.
fn symbol_of(c: char) -> Option<String> {
    let name = super::names::plain(&c.to_string());
    (c.is_alphabetic() && SYMBOLS.contains(&name.as_str())).then_some(name)
}

/// Greek letters that have a command of their own.
const SYMBOLS: [&str; 33] = [
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu", "xi",
    "pi", "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi", "omega", "Gamma", "Delta", "Theta", "Lambda", "Xi",
    "Pi", "Sigma", "Phi", "Psi", "Omega",
];

/// A name as a symbol: a Greek letter's command, what follows a letter or an underscore as an
/// index.
fn name(own: &str) -> String {
    let plain = super::names::plain(own);
    let letters: String = plain.chars().take_while(char::is_ascii_alphabetic).collect();
    let rest = plain[letters.len()..].trim_start_matches('_').replace('_', "\\_");
    let head = match (SYMBOLS.contains(&letters.as_str()), letters.len()) {
        (true, _) => format!("\\{letters}"),
        (false, 1) => letters,
        (false, _) => format!("\\mathrm{{{letters}}}"),
    };
    if rest.is_empty() { head } else { format!("{head}_{{\\mathrm{{{rest}}}}}") }
}

/// A coordinate's symbol with a mark of its derivative: primes by τ, dots by seconds.
fn derivative(own: &str, order: usize, primed: bool) -> String {
    let symbol = name(own);
    match (primed, order) {
        (true, 1) => format!("{symbol}'"),
        (true, _) => format!("{symbol}''"),
        (false, n) => {
            // Dots stand above the letter, not above its index.
            let (head, index) =
                symbol.split_once("_{").map_or((symbol.as_str(), String::new()), |(h, i)| (h, format!("_{{{i}")));
            format!("\\{}ot{{{head}}}{index}", "d".repeat(n))
        }
    }
}

fn equations(p: &Program<'_>) -> String {
    let coordinates = &p.motion.file.coordinates;
    let mut rows = Vec::new();
    for e in 0..p.motion.file.equations.len() {
        let (mut left, mut right) = (Vec::new(), Vec::new());
        for t in p.terms.iter().filter(|t| t.equation == e) {
            let by_phase = t.primed && p.scaled;
            let symbol = |s: Symbol| match s {
                Symbol::Coordinate(i) | Symbol::Raw(i) if p.coordinates[i].wraps => {
                    format!("\\operatorname{{wrap}}\\left({}\\right)", name(&coordinates[i].name))
                }
                Symbol::Coordinate(i) | Symbol::Raw(i) => name(&coordinates[i].name),
                Symbol::Rate(i) | Symbol::ClearRate(i) => derivative(&coordinates[i].name, 1, by_phase),
                Symbol::Acceleration(i) => derivative(&coordinates[i].name, 2, by_phase),
                Symbol::Input(k) | Symbol::RawInput(k) | Symbol::InputRate(k) => name(&p.motion.file.inputs[k]),
                Symbol::Tau => "\\tau".to_owned(),
                Symbol::Time => "t".to_owned(),
                // Models with states are refused before they come here.
                Symbol::Held(_) | Symbol::State(_) | Symbol::Memory(_) => String::new(),
            };
            let printer = Printer { language: &Latex, symbol: &symbol };
            let factor = t.constant.map_or_else(String::new, |c| name(&p.constants[c].own));
            let printed: Printed = printer.term(&factor, &t.of, false);
            if t.constant.is_some() { left.push(printed) } else { right.push(printed) }
        }
        let left: Vec<String> = left.iter().enumerate().map(|(k, t)| super::procedural::signed(t, k == 0)).collect();
        let right = if right.is_empty() { "0".to_owned() } else { super::procedural::inline(&right) };
        rows.push(format!("  & {} \\\\\n  &\\qquad = {right}", left.join(" \\\\\n  & \\quad ")));
    }
    rows.join(" \\\\[1ex]\n")
}

fn parameters(p: &Program<'_>) -> String {
    let mut rows = Vec::new();
    for c in &p.constants {
        let minus = if c.value < 0.0 { "-" } else { "" };
        let error = match c.std_error {
            x if x.is_finite() => format!("\\({}\\)", Latex.number(format!("{x:.1e}").parse().unwrap_or(x))),
            _ => "--".to_owned(),
        };
        let unit = if c.unit == "1" { "" } else { &c.unit };
        rows.push(format!(
            "  \\({}\\) & \\({minus}{}\\) & {error} & {} \\\\",
            name(&c.own),
            Latex.number(c.value.abs()),
            text(unit)
        ));
    }
    rows.join("\n")
}

fn effects(p: &Program<'_>) -> String {
    let item = |e: &crate::motion::Effect| {
        let beside = match e.acts {
            Acts::Sensor(..) => ", on the sensor only",
            Acts::Input(..) => ", on the record of the input only",
            Acts::Motion(_) | Acts::Drive(_) => "",
        };
        format!(
            "  \\item {}: {}; \\({}{}\\) {}, standard error {}{beside}",
            text(&e.name()),
            text(&e.equation),
            if e.identified.value < 0.0 { "-" } else { "" },
            Latex.number(e.identified.value.abs()),
            text(&e.identified.unit),
            if e.identified.std_error.is_finite() {
                format!(
                    "\\({}\\)",
                    Latex.number(format!("{:.1e}", e.identified.std_error).parse().unwrap_or(e.identified.std_error))
                )
            } else {
                "not known".to_owned()
            },
        )
    };
    let items: Vec<String> = p.motion.effects.iter().map(item).collect();
    if items.is_empty() {
        return String::new();
    }
    format!("\n\\paragraph{{Effects}}\n\\begin{{itemize}}\n{}\n\\end{{itemize}}", items.join("\n"))
}
