//! The equations of a model file as sums of products of factors, for one or two coordinates and a
//! drive whose phase is τ.
//!
//! Sums and products of an expression are taken apart, so that every factor that holds an angle can
//! be low-passed before products are formed (3.26); what holds rates or accelerations has been
//! through the low-pass, and the drive is exact.

use std::sync::Arc;

use super::equations::{Drive, Equations, Factor, Product, Role, Term};
use super::orbit::State;
use crate::error::Result;
use crate::model::model_file::equations_of_motion::wrapped;
use crate::model::model_file::expression::{Expression, Node, Symbol, as_number};
use crate::model::model_file::{ModelFile, Time};

/// Most coordinates.
const MOST: usize = 2;

/// The equations of a model file under a drive of angular frequency `omega`.
///
/// # Errors
/// Measured inputs, more than two coordinates or equations.
pub fn equations(model: &ModelFile, omega: f64) -> Result<Equations> {
    let remedy = "Use --method weak, which takes any system";
    if !model.inputs.is_empty() {
        return Err(model
            .bad(format!("the input {}", model.inputs[0]), "a system that its drive alone moves")
            .at("inputs")
            .remedy(remedy));
    }
    if model.coordinates.len() > MOST || model.equations.len() > MOST {
        return Err(model
            .bad(
                format!("{} coordinates, {} equations", model.coordinates.len(), model.equations.len()),
                format!("at most {MOST} of each"),
            )
            .at("coordinates")
            .remedy(remedy));
    }
    // Rates and accelerations are by τ here; primes may be by seconds.
    let scale = if model.time == Time::Seconds { omega } else { 1.0 };
    let mut out = Equations::default();
    for (c, circle) in model.circle().into_iter().enumerate() {
        out.circle[c] = circle;
    }
    for e in &model.equations {
        out.targets.push(products(&mut out.factors, &e.balance, scale, out.circle));
        let terms = e
            .terms
            .iter()
            .map(|t| Term {
                name: t.name.clone(),
                unit: "",
                products: products(&mut out.factors, &t.of, scale, out.circle),
                role: Role::Other,
                potential: None,
            })
            .collect();
        out.terms.push(terms);
    }
    Ok(out)
}

/// The products of an expression's sum.
fn products(factors: &mut Vec<Factor>, of: &Node, scale: f64, circle: [bool; MOST]) -> Vec<Product> {
    summands(of)
        .into_iter()
        .map(|list| {
            let mut product = Product { scale: 1.0, factors: Vec::new(), drive: Drive::None };
            for node in list {
                match as_number(&node) {
                    Some(x) => product.scale *= x,
                    None => {
                        factors.push(factor(node, scale, circle));
                        product.factors.push(factors.len() - 1);
                    }
                }
            }
            product
        })
        .collect()
}

/// An expression as a sum of products of factors.
fn summands(e: &Node) -> Vec<Vec<Node>> {
    match &**e {
        Expression::Add(a, b) => [summands(a), summands(b)].concat(),
        Expression::Subtract(a, b) => {
            let mut behind = summands(b);
            behind.iter_mut().for_each(|p| p.push(Arc::new(Expression::Number(-1.0))));
            [summands(a), behind].concat()
        }
        Expression::Multiply(a, b) => {
            let (a, b) = (summands(a), summands(b));
            a.iter().flat_map(|x| b.iter().map(move |y| [x.as_slice(), y.as_slice()].concat())).collect()
        }
        _ => vec![vec![e.clone()]],
    }
}

fn factor(node: Node, scale: f64, circle: [bool; MOST]) -> Factor {
    let moves = |s: Symbol| matches!(s, Symbol::Rate(_) | Symbol::ClearRate(_) | Symbol::Acceleration(_));
    let rests = |s: Symbol| matches!(s, Symbol::Coordinate(_) | Symbol::Raw(_));
    let filtered = node.any(&rests) && !node.any(&moves);
    let of = move |s: &State| {
        node.value(&|x| match x {
            Symbol::Coordinate(i) if circle[i] => wrapped(s.angle[i]),
            Symbol::Coordinate(i) | Symbol::Raw(i) => s.angle[i],
            Symbol::Rate(i) | Symbol::ClearRate(i) => scale * s.rate[i],
            Symbol::Acceleration(i) => scale * scale * s.accel[i],
            Symbol::Tau => s.tau,
            _ => f64::NAN,
        })
    };
    Factor { of: Arc::new(of), filtered }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const TEXT: &str = r#"name = "m"
coordinates = [{ name = "p", space = "S1" }, { name = "x", space = "R" }]
[[equation]]
balance = "-p''"
terms = { a = "2*x''*(cos(p) - x'^2)", b = "sin(p)*cos(tau)", c = "sign(p')" }
[[equation]]
balance = "-3*x'' + x"
terms = { d = "x'" }
"#;

    #[test]
    fn sums_and_products_are_taken_apart() {
        let model = ModelFile::parse(TEXT, Path::new("m.toml")).unwrap();
        let m = equations(&model, 5.0).unwrap();
        assert_eq!((m.circle, m.terms[0][0].products.len(), m.targets[1].len()), ([true, false], 2, 2));
        let s = State { angle: [7.0, 0.4], rate: [-0.2, 1.1], accel: [0.6, -0.9], tau: 0.8 };
        let value = |products: &[Product]| -> f64 {
            products.iter().map(|p| p.scale * p.factors.iter().map(|f| (m.factors[*f].of)(&s)).product::<f64>()).sum()
        };
        let term = |e: usize, j: usize| value(&m.terms[e][j].products);
        assert!((term(0, 0) - 2.0 * -0.9 * (7.0_f64.cos() - 1.21)).abs() < 1e-12);
        assert!((term(0, 1) - 7.0_f64.sin() * 0.8_f64.cos()).abs() < 1e-12);
        assert_eq!((term(0, 2), value(&m.targets[0])), (-1.0, -0.6));
        assert!((value(&m.targets[1]) - (2.7 + 0.4)).abs() < 1e-12);
        // Only what holds a position and nothing that moves is low-passed.
        let filtered: Vec<bool> = m.terms[0][1].products[0].factors.iter().map(|f| m.factors[*f].filtered).collect();
        assert_eq!(filtered, [true, false]);
    }

    #[test]
    fn what_it_cannot_take_is_told() {
        let inputs = TEXT.replace("[[equation]]\nbalance = \"-p", "inputs = [\"u\"]\n[[equation]]\nbalance = \"u-p");
        let model = ModelFile::parse(&inputs, Path::new("m.toml")).unwrap();
        assert!(equations(&model, 5.0).is_err_and(|e| e.to_string().contains("the input u")));
    }
}
