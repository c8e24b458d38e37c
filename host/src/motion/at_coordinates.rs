//! Effects of model files that hold no places of bodies, as earlier versions wrote them: laws of
//! one coordinate, added to its own equation.

use crate::error::{BadInput, Result};
use crate::model::identified::{AddedEffect, IdentifiedModel};
use crate::model::model_file::expression::{Node, Symbol, symbol};
use crate::model::model_file::parser::{Names, parse};
use crate::model::model_file::{ModelFile, Space};

/// Laws of a coordinate q by their ids: name of the shape parameter, one law for each strength, in
/// which `@` stands for the shape; whether q is an angle.
const LAWS: [(&str, &str, &[&str], bool); 13] = [
    ("viscous-friction", "", &["q'"], false),
    ("coulomb-friction", "", &["sign(q')"], false),
    ("constant-force", "", &["1"], false),
    ("torsion-spring", "", &["q"], false),
    ("imbalance", "", &["cos(q)"], true),
    ("cubic-stiffness", "", &["q^3"], false),
    ("quadratic-stiffness", "", &["q^2"], false),
    ("quadratic-drag", "", &["q'*abs(q')"], false),
    ("asymmetric-friction", "", &["abs(q')"], false),
    ("amplitude-dependent-damping", "", &["q^2*q'"], false),
    ("load-dependent-friction", "G", &["abs(@*cos(q) + q'^2)*sign(q')"], true),
    ("stribeck-friction", "v_s", &["exp(-(q'/@)^2)*sign(q')"], false),
    ("cogging", "n", &["sin(@*q)", "cos(@*q)"], true),
];

/// An effect as terms of one equation.
#[derive(Clone, Debug, PartialEq)]
pub struct Terms {
    /// The equation.
    pub equation: usize,
    /// One expression for each strength, in seconds.
    pub columns: Vec<Node>,
}

/// The equation of a coordinate: its own number where there are as many equations as coordinates,
/// otherwise the first that holds its acceleration.
fn equation_of(model: &ModelFile, coordinate: usize) -> Option<usize> {
    let holds = |e: usize| {
        let equation = &model.equations[e];
        let all = std::iter::once(&equation.balance).chain(equation.terms.iter().map(|t| &t.of));
        all.into_iter().any(|n| n.any(&|s| s == Symbol::Acceleration(coordinate)))
    };
    let own = Some(coordinate).filter(|e| model.equations.len() == model.coordinates.len() && holds(*e));
    own.or_else(|| (0..model.equations.len()).find(|e| holds(*e)))
}

fn terms(model: &ModelFile, e: &AddedEffect) -> Option<Terms> {
    let (_, shape, laws, angle) = LAWS.iter().find(|l| l.0 == e.id)?;
    let i = model.coordinates.iter().position(|c| c.name == e.at)?;
    if *angle && model.coordinates[i].space != Space::Circle {
        return None;
    }
    let value = if shape.is_empty() { String::new() } else { format!("{:?}", e.parameters.get(*shape)?) };
    let names = Names { coordinates: vec!["q".to_owned()], inputs: Vec::new() };
    let at = |s: Symbol| match s {
        Symbol::Coordinate(_) => symbol(Symbol::Coordinate(i)),
        Symbol::Rate(_) => symbol(Symbol::Rate(i)),
        other => symbol(other),
    };
    let law = |text: &&str| Some(parse(&text.replace('@', &value), &names).ok()?.replace(&at));
    let columns: Vec<Node> = laws.iter().map(law).collect::<Option<_>>()?;
    (columns.len() == e.strengths.len()).then_some(Terms { equation: equation_of(model, i)?, columns })
}

/// Effects of a given model as terms of the rig's equations.
///
/// # Errors
/// An effect that there is not at this coordinate.
pub fn of(given: &IdentifiedModel, model: &ModelFile) -> Result<Vec<Terms>> {
    let list = given.effects.iter().enumerate();
    list.map(|(k, e)| {
        terms(model, e).ok_or_else(|| {
            BadInput::new(
                format!("{} with {} strengths", e.name(), e.strengths.len()),
                "an effect of `whirl list effects` at a coordinate of the model",
            )
            .at(format!("--model, effect {}", k + 1))
            .remedy("Correct the file, or write it anew with `whirl explain -o`")
        })
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn laws_stand_in_the_equation_of_their_coordinate() {
        let text = "name = \"m\"\ncoordinates = [{ name = \"x\", space = \"R\" }, { name = \"p\", space = \"S1\" }]\n\
            [[equation]]\nbalance = \"-x''\"\nterms = { h = \"x\" }\n\
            [[equation]]\nbalance = \"-p''\"\nterms = { k = \"sin(p)\" }\n";
        let model = ModelFile::parse(text, Path::new("m.toml")).unwrap();
        let effect = |id: &str, at: &str, shape: Option<(&str, f64)>, n: usize| AddedEffect {
            id: id.to_owned(),
            at: at.to_owned(),
            value: 1.0,
            std_error: 0.1,
            unit: String::new(),
            strengths: vec![1.0; n],
            parameters: shape.into_iter().map(|(k, v)| (k.to_owned(), v)).collect(),
        };
        let at = |s: Symbol| match s {
            Symbol::Coordinate(1) => 0.4,
            Symbol::Rate(1) => -2.0,
            _ => f64::NAN,
        };
        for (id, shape, expected) in [
            ("viscous-friction", None, vec![-2.0]),
            ("quadratic-drag", None, vec![-4.0]),
            ("stribeck-friction", Some(("v_s", 3.0)), vec![-(-4.0_f64 / 9.0).exp()]),
            ("cogging", Some(("n", 5.0)), vec![2.0_f64.sin(), 2.0_f64.cos()]),
        ] {
            let found = terms(&model, &effect(id, "p", shape, expected.len())).unwrap();
            assert_eq!(found.equation, 1);
            let values: Vec<f64> = found.columns.iter().map(|c| c.value(&at)).collect();
            assert!(values.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12), "{id} {values:?}");
        }
        assert!(terms(&model, &effect("cogging", "x", Some(("n", 5.0)), 2)).is_none());
        assert!(terms(&model, &effect("stribeck-friction", "p", None, 1)).is_none());
    }
}
