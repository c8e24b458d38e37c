//! C99 with its standard library.

use super::expression::Level;
use super::procedural::{self, Procedural, signed};
use super::program::Program;
use super::{Language, Notation, Printed};
use crate::model::model_file::expression::{FUNCTIONS, Function};

/// See [`super::LANGUAGES`].
pub struct C;

impl Notation for C {
    fn power(&self, a: &str, n: &str) -> (String, Level) {
        (format!("pow({a}, {n})"), Level::Atom)
    }

    fn power_needs(&self) -> [Level; 2] {
        [Level::Sum, Level::Sum]
    }

    fn call(&self, f: Function, a: &str) -> String {
        if f == Function::Abs {
            return format!("fabs({a})");
        }
        let known = FUNCTIONS.iter().find(|x| x.1 == f);
        format!("{}({a})", known.map_or("", |x| x.0))
    }
}

impl Language for C {
    fn id(&self) -> &'static str {
        "c"
    }

    fn about(&self) -> &'static str {
        "C99"
    }

    fn template(&self) -> &'static str {
        include_str!("templates/c.c")
    }

    fn remark(&self) -> &'static str {
        "//"
    }

    fn reserved(&self) -> &'static str {
        "auto break case char const continue default do double else enum extern float for goto if inline \
         int long register restrict return short signed sizeof static struct switch typedef union \
         unsigned void volatile while bool true false nullptr asm sin cos tan sqrt exp log fabs abs tanh \
         pow floor fmax rint nearbyint gamma lgamma tgamma erf j0 j1 jn y0 y1 yn printf puts main sign \
         wrap hat solve f f_held inputs t x u dx held matrix right acceleration N M K STEP_S SECONDS \
         EVERY X0 SWITCHES along hold turned released runge_kutta rate step OMEGA tau NULL HUGE PI index \
         time signal exit div remove rename stdin stdout stderr EOF NAN INFINITY linux unix RATE gains \
         any_turned pipe read write k i"
    }

    fn places(&self, p: &Program<'_>) -> Vec<(&'static str, String)> {
        let mut out = procedural::places(self, p);
        out.push(("format", ["%.17g"].repeat(2 * p.coordinates.len()).join(",")));
        out.push(("inputs_at_least", p.inputs.len().max(1).to_string()));
        let zeros = (0..p.inputs.len()).map(|k| format!("    u[{k}] = 0.0;"));
        out.push(("zeros_assigned", zeros.collect::<Vec<_>>().join("\n")));
        out
    }
}

impl Procedural for C {
    fn constant(&self, name: &str, value: &str) -> String {
        format!("static const double {name} = {value};")
    }

    fn define(&self, name: &str, value: &str) -> String {
        format!("const double {name} = {value};")
    }

    fn assign(&self, target: &str, value: &str) -> String {
        format!("{target} = {value};")
    }

    fn entry(&self, matrix: &str, i: usize, j: usize) -> String {
        format!("{matrix}[{i}][{j}]")
    }

    fn sum(&self, target: &str, terms: &[Printed], indent: &str) -> String {
        let all: Vec<String> = terms.iter().enumerate().map(|(k, t)| signed(t, k == 0)).collect();
        format!("{target} = {};", all.join(&format!("\n{indent}    ")))
    }

    fn held(&self, k: usize, form: &str) -> String {
        format!("held ? held[{k}] : sign({form})")
    }

    fn row(&self, items: &[String]) -> String {
        format!("{{{}}}", items.join(", "))
    }
}
