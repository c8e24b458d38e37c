//! What names and operations mean in a model file's expressions: nodes over coordinates, inputs and
//! the drive's phase.

use super::expression::{FUNCTIONS, Node, Symbol, add, call, divide, multiply, number, power, subtract, symbol};
use super::parser::{Fault, Grammar};

/// What names mean.
#[derive(Clone, Debug, Default)]
pub struct Names {
    /// Coordinates.
    pub coordinates: Vec<String>,
    /// Inputs.
    pub inputs: Vec<String>,
}

impl Grammar for Names {
    type Value = Node;
    const LISTS: bool = false;

    fn number(&self, x: f64) -> Node {
        number(x)
    }

    fn operation(&self, operator: char, left: Node, right: Node) -> Result<Node, Fault> {
        Ok(match operator {
            '+' => add(left, right),
            '-' => subtract(left, right),
            '*' => multiply(left, right),
            '/' => divide(left, right),
            _ => power(left, right),
        })
    }

    fn name(&self, name: &str, primes: usize, called: bool) -> Result<Option<Node>, Fault> {
        if let Some(i) = self.coordinates.iter().position(|n| n == name) {
            return match primes {
                0 => Ok(Some(symbol(Symbol::Coordinate(i)))),
                1 => Ok(Some(symbol(Symbol::Rate(i)))),
                2 => Ok(Some(symbol(Symbol::Acceleration(i)))),
                n => Err(Fault::new(
                    format!("the derivative of order {n} of {name}"),
                    "at most the second",
                    "Equations of motion are of second order",
                )),
            };
        }
        let input = self.inputs.iter().position(|n| n == name);
        if primes > 0 && (input.is_some() || name == "tau") {
            return Err(Fault::new(
                format!("a derivative of {name}"),
                "derivatives of coordinates only",
                "Remove the prime",
            ));
        }
        if let Some(k) = input {
            return Ok(Some(symbol(Symbol::Input(k))));
        }
        let function = FUNCTIONS.iter().any(|f| f.0 == name);
        match name {
            _ if function && called && primes == 0 => Ok(None),
            "tau" if !function => Ok(Some(symbol(Symbol::Tau))),
            "pi" | "π" if !function && primes == 0 => Ok(Some(number(core::f64::consts::PI))),
            _ => Err(unknown(name, self, !function && called)),
        }
    }

    fn call(&self, name: &str, mut arguments: Vec<Node>) -> Result<Node, Fault> {
        match (FUNCTIONS.iter().find(|f| f.0 == name), arguments.pop()) {
            (Some((_, f)), Some(a)) => Ok(call(*f, a)),
            _ => Err(unknown(name, self, true)),
        }
    }

    fn list(&self, _: Vec<Node>) -> Result<Node, Fault> {
        Err(Fault::new("a list", "an expression", "Write one expression"))
    }
}

/// A name that was used and is not there: for messages.
fn unknown(name: &str, names: &Names, called: bool) -> Fault {
    let functions: Vec<&str> = FUNCTIONS.iter().map(|f| f.0).collect();
    if called {
        let expected = format!("one of the functions {}", functions.join(", "));
        return Fault::new(format!("the function \"{name}\""), expected, "Correct the function's name");
    }
    let mut known: Vec<&str> = names.coordinates.iter().chain(&names.inputs).map(String::as_str).collect();
    known.extend(["tau", "pi"]);
    let remedy = if functions.contains(&name) {
        format!("Give the function its argument, {name}(…)")
    } else {
        "Correct the name, or declare it under coordinates or inputs; unknown coefficients are the keys of terms, not in expressions"
            .to_owned()
    };
    Fault::new(format!("the name \"{name}\""), format!("one of {}", known.join(", ")), remedy)
}
