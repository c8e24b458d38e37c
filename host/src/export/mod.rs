//! An identified model as readable code: units, parameters with their standard errors, effects by
//! name, a right-hand side f(t, x, u), an example that integrates it.
//!
//! There is one way for all systems and languages: a [`crate::motion::Motion`] becomes a
//! [`program::Program`] (names, constants, terms split into mass matrix and right-hand side), whose
//! expressions are printed by walking the tree once ([`expression`]), through a [`Language`] that
//! knows how its products, powers, functions and statements are written. What does not depend on
//! the model (the Runge–Kutta step, reversals under dry friction) stands in a language's template.
//!
//! x is q, then q̇; with M q″ = r each equation of the model solved for its accelerations, q̈ = Ω²
//! q″ where a prime is d/dτ. Agreement with `whirl simulate --model` is tested: 1e-9 over a second
//! for Python and C.
//!
//! To add a language: a file with its [`Language`], its template, and a line in [`LANGUAGES`].

mod c;
pub mod expression;
mod for_people;
mod julia;
mod latex;
mod matlab;
mod modelica;
pub mod names;
mod procedural;
pub mod program;
mod python;
mod remarks;
mod template;
pub mod written_out;

use std::path::Path;

use self::expression::Level;
use self::program::Program;
use crate::error::{BadInput, Result};
use crate::model::model_file::expression::Function;
use crate::motion::Motion;

/// A term of a sum as a language prints it.
pub struct Printed {
    /// Whether it is subtracted.
    pub negative: bool,
    /// The text behind the sign.
    pub text: String,
}

/// How expressions are written.
pub trait Notation: Sync {
    /// A number, 0 or more, with the digits that give back the same bits.
    fn number(&self, x: f64) -> String {
        format!("{x:?}")
    }

    /// A product.
    fn product(&self, a: &str, b: &str) -> String {
        format!("{a}*{b}")
    }

    /// A quotient, and how tightly it binds; `b` binds more tightly than a product.
    fn quotient(&self, a: &str, b: &str) -> (String, Level) {
        (format!("{a}/{b}"), Level::Product)
    }

    /// How tightly both sides of a quotient must bind.
    fn quotient_needs(&self) -> [Level; 2] {
        [Level::Product, Level::Power]
    }

    /// A power, and how tightly it binds.
    fn power(&self, a: &str, n: &str) -> (String, Level) {
        (format!("{a}^{n}"), Level::Power)
    }

    /// How tightly base and exponent of a power must bind.
    fn power_needs(&self) -> [Level; 2] {
        [Level::Atom, Level::Atom]
    }

    /// A function of one argument.
    fn call(&self, f: Function, a: &str) -> String {
        let known = crate::model::model_file::expression::FUNCTIONS.iter().find(|x| x.1 == f);
        format!("{}({a})", known.map_or("", |x| x.0))
    }

    /// max(0, 1 − |d|/width), d wrapped to ± period/2 first where there is a period.
    fn hat(&self, d: &str, width: f64, period: Option<f64>) -> String {
        format!("hat({d}, {}, {})", self.number(width), self.number(period.unwrap_or(0.0)))
    }

    /// What is in brackets.
    fn bracketed(&self, a: &str) -> String {
        format!("({a})")
    }

    /// What has a minus sign before it.
    fn negated(&self, a: &str) -> String {
        format!("-{a}")
    }

    /// A sum or difference.
    fn added(&self, a: &str, b: &str, minus: bool) -> String {
        format!("{a} {} {b}", if minus { '-' } else { '+' })
    }
}

/// How a language writes what a model is made of.
pub trait Language: Notation {
    /// Name behind `--to`.
    fn id(&self) -> &'static str;

    /// What it is, for lists.
    fn about(&self) -> &'static str;

    /// The text around a model, with its places.
    fn template(&self) -> &'static str;

    /// What begins a line of comment.
    fn remark(&self) -> &'static str;

    /// Words that a name may not be, blanks between them: keywords, functions, the template's own
    /// names.
    fn reserved(&self) -> &'static str;

    /// Fills the places of the template: pairs of place and text.
    fn places(&self, program: &Program<'_>) -> Vec<(&'static str, String)>;
}

/// Every language, in the order in which they are listed.
pub static LANGUAGES: &[&dyn Language] =
    &[&python::Python, &matlab::Matlab, &julia::Julia, &c::C, &modelica::Modelica, &latex::Latex];

/// A language by its name.
///
/// # Errors
/// A name that there is not.
pub fn language(id: &str) -> Result<&'static dyn Language> {
    LANGUAGES.iter().copied().find(|l| l.id() == id).ok_or_else(|| {
        let ids: Vec<&str> = LANGUAGES.iter().map(|l| l.id()).collect();
        BadInput::new(format!("\"{id}\""), format!("one of {}", ids.join(", "))).at("--to").remedy("Choose a language")
    })
}

/// The code of a model; `file` is what it will be called: where a language names what a file holds
/// after it, its stem gives the name.
///
/// # Errors
/// A number of equations that differs from that of the coordinates, a coefficient that is no finite
/// number.
pub fn code(motion: &Motion, language: &'static dyn Language, file: &Path) -> Result<String> {
    let stem = file.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let program = Program::new(motion, language, &stem)?;
    let sections = program.sections();
    Ok(template::filled(language.template(), &language.places(&program), &sections))
}

#[cfg(test)]
mod tests;
