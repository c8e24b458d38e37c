//! A model file's equations as series and parts, for one drive frequency: what
//! [`crate::identify::windows`] turns into rows.

use super::ModelFile;
use super::by_parts::{pieces, pieces_of_effect};
use super::expression::{Node, Symbol};
use super::tape::Tape;
use crate::error::Result;
use crate::model::weak::{Equation, Part, Term};

/// A column for an equation: the coefficient's name and the expression in seconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The coefficient.
    pub name: String,
    /// What it multiplies, primes as derivatives by seconds.
    pub of: Node,
}

/// Series, evaluated by a tape, and the equations over them.
#[derive(Clone, Debug)]
pub struct WeakForm {
    /// Every series at every sample.
    pub tape: Tape,
    /// Equations over the series; units are empty, see [`super::units`].
    pub equations: Vec<Equation>,
}

/// Collects series, each once.
#[derive(Default)]
struct Series(Vec<Node>);

impl Series {
    fn index(&mut self, e: Node) -> usize {
        self.0.iter().position(|x| *x == e).unwrap_or_else(|| {
            self.0.push(e);
            self.0.len() - 1
        })
    }
}

impl WeakForm {
    /// The weak form of a model file at angular frequency `omega` (rad/s; 1 without a drive), with
    /// further columns, `extra[e]` for equation e.
    ///
    /// # Errors
    /// A term that cannot be integrated by parts (only further columns can bring one in: a file is
    /// checked when it is read).
    pub fn new(model: &ModelFile, omega: f64, extra: &[Vec<Column>]) -> Result<Self> {
        Self::with(model, omega, extra, |e| e)
    }

    /// The same with functions of coordinates alone as measured: what a record without noise needs,
    /// whose low-pass would leave its ripple in them.
    ///
    /// # Errors
    /// As [`WeakForm::new`].
    pub fn unsmoothed(model: &ModelFile, omega: f64) -> Result<Self> {
        Self::with(model, omega, &[], |e| e.with_measured_coordinates())
    }

    fn with(model: &ModelFile, omega: f64, extra: &[Vec<Column>], series_of: fn(Node) -> Node) -> Result<Self> {
        let circle = model.circle();
        let mut series = Series::default();
        let mut parts = |e: &Node, effect: bool| -> Result<Vec<Part>> {
            let list = if effect { pieces_of_effect(e, omega, &circle) } else { pieces(e, omega, &circle) };
            let list = list.map_err(|m| model.bad(m, "a term that can be integrated by parts"))?;
            Ok(list
                .into_iter()
                .map(|p| Part {
                    series: series.index(series_of(p.of.with_clear_signs())),
                    order: p.order,
                    factor: p.factor,
                })
                .collect())
        };
        let mut equations = Vec::with_capacity(model.equations.len());
        for (e, equation) in model.equations.iter().enumerate() {
            let own = equation.terms.iter().map(|t| (t.name.clone(), model.in_seconds(&t.of, omega), false));
            let more = extra.get(e).into_iter().flatten().map(|c| (c.name.clone(), c.of.clone(), true));
            let mut terms = Vec::new();
            for (name, of, effect) in own.chain(more) {
                terms.push(Term { name, unit: "", parts: parts(&of, effect)? });
            }
            let target = parts(&model.in_seconds(&equation.balance, omega), false)?;
            equations.push(Equation { terms, target });
        }
        Ok(Self { tape: Tape::new(&series.0), equations })
    }

    /// Whether some series needs a symbol.
    pub fn needs(&self, wanted: impl Fn(Symbol) -> bool) -> bool {
        self.tape.symbols().iter().any(|s| wanted(*s))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::model::weak::Order;

    /// The free double pendulum has the series of the built-in one.
    #[test]
    fn double_pendulum_has_the_built_in_series() {
        let text = r#"
name = "double pendulum"
coordinates = [{ name = "p", space = "S1" }, { name = "q", space = "S1" }]
[[equation]]
balance = "-p''"
terms = { B11 = "q''*cos(q - p) - q'^2*sin(q - p)", B12 = "sin(p)", C11 = "sign(p')", C12 = "p' - q'" }
[[equation]]
balance = "-q''"
terms = { B21 = "p''*cos(q - p) + p'^2*sin(q - p)", B22 = "sin(q)", C2 = "q' - p'" }
"#;
        let model = ModelFile::parse(text, Path::new("m.toml")).unwrap();
        let weak = WeakForm::new(&model, 1.0, &[]).unwrap();
        let parts = &weak.equations[0].terms[3].parts;
        assert_eq!(
            parts.iter().map(|p| (p.order, p.factor)).collect::<Vec<_>>(),
            [(Order::First, 1.0), (Order::First, -1.0)]
        );
        assert_eq!(weak.equations[1].target[0].order, Order::Second);
        assert_eq!(weak.equations[1].target[0].factor, -1.0);
        // Two angles, two momenta, two products, two sines, one sign.
        assert_eq!(weak.tape.len(), 9);
        assert!(weak.needs(|s| s == Symbol::ClearRate(0)) && !weak.needs(|s| s == Symbol::ClearRate(1)));
    }
}
