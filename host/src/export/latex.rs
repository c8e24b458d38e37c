//! LaTeX: the equations as a page sets them, a table of the parameters with their standard errors,
//! the effects.

use core::f64::consts::TAU;

use super::expression::{Level, Printer};
use super::for_people::rounded;
use super::program::{Constant, Program};
use super::remarks::harmless;
use super::written_out::digits;
use super::{Language, Notation, Printed};
use crate::model::model_file::expression::{Function, Symbol};
use crate::motion::Acts;
use crate::wording::format::{shortest, significant};

/// See [`super::LANGUAGES`].
pub struct Latex;

impl Notation for Latex {
    /// A number of an expression, which has no standard error: to five digits, as reports do.
    fn number(&self, x: f64) -> String {
        let text = rounded(x);
        match text.split_once("·10") {
            Some((digits, power)) if digits.contains('.') => {
                typeset(&format!("{}·10{power}", digits.trim_end_matches('0').trim_end_matches('.')))
            }
            _ => typeset(&text),
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
            ("digits", p.remark(DIGITS)),
            ("hertz", p.omega.as_ref().map_or_else(String::new, |(_, w)| typeset(&shortest(w / TAU)))),
            ("omega", p.omega.as_ref().map_or_else(String::new, |(_, w)| self.number(*w))),
        ]
    }
}

/// Where a reader finds what is not on the page.
const DIGITS: &str = "Numbers have the digits that their standard errors support; all digits are in the model file.";

/// What the numbers before strengths of effects are.
const FACTORS: &str = "\n\
    % The number before an effect's strength in an equation puts the strength into the equation's own terms.\n\
    A number before an effect's strength puts it into the terms of its equation, over the inertia where that divides it\n\
    and, where primes are derivatives by \\(\\tau\\), by powers of \\(\\Omega\\).";

/// A number as [`crate::wording::format`] writes it.
fn typeset(text: &str) -> String {
    let text = text.replace('−', "-");
    let Some((digits, power)) = text.split_once("·10") else { return text };
    let power: String = power.chars().map(|c| "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().position(|s| s == c).map_or('-', digit)).collect();
    format!("{digits}\\cdot 10^{{{power}}}")
}

fn digit(n: usize) -> char {
    char::from_digit(n as u32, 10).unwrap_or('0')
}

/// A value to the digits that its standard error supports, with its sign.
fn value(x: f64, std_error: f64) -> String {
    let size = digits(x, std_error, 1.0);
    // What rounds to zero has no sign.
    let minus = x < 0.0 && size.contains(|c: char| matches!(c, '1'..='9'));
    format!("{}{}", if minus { "-" } else { "" }, typeset(&size))
}

/// A standard error as a cell of a table, or what stands for it.
fn error(x: f64) -> String {
    match x {
        x if x.is_nan() => "not known".to_owned(),
        x if x.is_infinite() => "not determined".to_owned(),
        0.0 => "taken as known".to_owned(),
        x => format!("\\({}\\)", typeset(&significant(x, 2))),
    }
}

/// A text as LaTeX sets it.
fn text(plain: &str) -> String {
    let mut out = String::new();
    // A minus and its digits are one exponent.
    let mut is_raised = false;
    for c in harmless(plain).chars() {
        if let Some(raised) = raised(c) {
            out.push_str(if is_raised { "" } else { "\\textsuperscript{" });
            out.push(raised);
            is_raised = true;
            continue;
        }
        out.push_str(if is_raised { "}" } else { "" });
        is_raised = false;
        match c {
            '\\' => out.push_str("\\textbackslash{}"),
            '^' => out.push_str("\\textasciicircum{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => out.extend(['\\', c]),
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
    out.push_str(if is_raised { "}" } else { "" });
    out
}

/// What a raised letter is.
fn raised(c: char) -> Option<char> {
    Some(match c {
        '¹' => '1',
        '²' => '2',
        '³' => '3',
        '⁴' => '4',
        '⁵' => '5',
        '⁻' => '-',
        _ => return None,
    })
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
    // A name of several words, such as that of an effect's strength, is no letter with an index.
    let words = plain.split('_').filter(|word| word.len() > 2).count();
    if words > 1 && !SYMBOLS.contains(&letters.as_str()) {
        return format!("\\mathit{{{}}}", plain.replace('_', "\\_"));
    }
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
    let row = |c: &Constant| {
        let physical = c.stands_for.as_ref().map(|e| {
            format!(": \\({}\\) {}", value(e.value, e.std_error), text(if e.unit == "1" { "" } else { &e.unit }))
        });
        format!(
            "  \\({}\\) & \\({}\\) & {} & {}{} \\\\",
            name(&c.own),
            value(c.value, c.std_error),
            error(c.std_error),
            text(if c.unit == "1" { "" } else { &c.unit }),
            physical.as_deref().unwrap_or_default().trim_end()
        )
    };
    p.constants.iter().map(row).collect::<Vec<_>>().join("\n")
}

fn effects(p: &Program<'_>) -> String {
    let item = |e: &crate::motion::Effect| {
        let beside = match e.acts {
            Acts::Sensor(..) => ", on the sensor only",
            Acts::Input(..) => ", on the record of the input only",
            Acts::Motion(_) | Acts::Drive(_) => "",
        };
        let found = &e.identified;
        format!(
            "  \\item {}: {}; \\({}\\) {}, standard error {}{beside}",
            text(&e.name()),
            text(&e.equation),
            value(found.value, found.std_error),
            text(&found.unit),
            error(found.std_error),
        )
    };
    let items: Vec<String> = p.motion.effects.iter().map(item).collect();
    if items.is_empty() {
        return String::new();
    }
    let factors = if p.motion.strengths().next().is_some() { FACTORS } else { "" };
    format!("\n\\paragraph{{Effects}}\n\\begin{{itemize}}\n{}\n\\end{{itemize}}{factors}", items.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_several_words_are_no_letters_with_an_index() {
        assert_eq!(name("viscous_friction_joint1"), "\\mathit{viscous\\_friction\\_joint1}");
        assert_eq!((name("phi1").as_str(), name("m_arm").as_str()), ("\\phi_{\\mathrm{1}}", "m_{\\mathrm{arm}}"));
    }

    #[test]
    fn a_negative_power_is_one_exponent() {
        assert_eq!(text("m s⁻²"), "m s\\textsuperscript{-2}");
        assert_eq!(text("}²"), "\\}\\textsuperscript{2}");
    }

    #[test]
    fn numbers_have_the_digits_that_their_errors_support() {
        assert_eq!(value(0.113_160_470_123_456_7, 2.1e-5), "0.11316");
        assert_eq!(value(-2.048_312_345e-7, 5.1e-10), "-2.048\\cdot 10^{-7}");
        assert_eq!(value(1.5, f64::NAN), "1.5");
        assert_eq!((error(2.134e-5).as_str(), error(0.0).as_str()), ("\\(2.1\\cdot 10^{-5}\\)", "taken as known"));
        assert_eq!(Latex.number(6.818_211_905_903_273e-5), "6.8182\\cdot 10^{-5}");
        assert_eq!((Latex.number(7.0).as_str(), typeset("1·10⁻¹²").as_str()), ("7", "1\\cdot 10^{-12}"));
        assert_eq!((value(-1e-4, 0.01).as_str(), value(-0.01, 0.001).as_str()), ("-1\\cdot 10^{-4}", "-0.0100"));
    }
}
