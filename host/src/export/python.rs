//! Python 3, with nothing but its standard library.

use super::expression::Level;
use super::procedural::{self, Procedural, signed};
use super::program::Program;
use super::{Language, Notation, Printed};
use crate::model::model_file::expression::{FUNCTIONS, Function};

/// See [`super::LANGUAGES`].
pub struct Python;

impl Notation for Python {
    fn power(&self, a: &str, n: &str) -> (String, Level) {
        (format!("{a}**{n}"), Level::Power)
    }
}

impl Language for Python {
    fn id(&self) -> &'static str {
        "python"
    }

    fn about(&self) -> &'static str {
        "Python 3 without packages"
    }

    fn template(&self) -> &'static str {
        include_str!("templates/python.py")
    }

    fn remark(&self) -> &'static str {
        "#"
    }

    fn reserved(&self) -> &'static str {
        "False None True and as assert async await break class continue def del elif else except finally \
         for from global if import in is lambda nonlocal not or pass raise return try while with yield \
         print range len sum zip abs max min list any map float sin cos tan sqrt exp log tanh pi floor \
         round sign wrap hat solve f inputs t x u dx held h matrix right acceleration N STEP_S SECONDS \
         EVERY X0 SWITCHES along hold turned released runge_kutta step main OMEGA tau"
    }

    fn places(&self, p: &Program<'_>) -> Vec<(&'static str, String)> {
        let own = [Function::Abs, Function::Sign, Function::Wrap];
        let mut imports: Vec<&str> =
            FUNCTIONS.iter().filter(|f| !own.contains(&f.1) && p.calls(f.1)).map(|f| f.0).collect();
        if p.sections().contains(&("wrap", true)) {
            imports.extend(["floor", "pi"]);
        }
        imports.sort_unstable();
        let import =
            if imports.is_empty() { String::new() } else { format!("from math import {}", imports.join(", ")) };
        let mut out = procedural::places(self, p);
        out.push(("import", import));
        out
    }
}

impl Procedural for Python {
    fn entry(&self, matrix: &str, i: usize, j: usize) -> String {
        format!("{matrix}[{i}][{j}]")
    }

    fn sum(&self, target: &str, terms: &[Printed], indent: &str) -> String {
        let all: Vec<String> =
            terms.iter().enumerate().map(|(k, t)| format!("{indent}    {}", signed(t, k == 0))).collect();
        format!("{target} = (\n{}\n{indent})", all.join("\n"))
    }

    fn held(&self, k: usize, form: &str) -> String {
        format!("sign({form}) if held is None else held[{k}]")
    }
}
