//! Effects of the drive and of the arm on a single pendulum, beside those of a coordinate: its base moves in a known direction.
//!
//! With φ the angle and a base that moves horizontally, a force f(τ) at the base enters as cos φ f(τ), with a vertical one as sin φ f(τ). Strengths
//! are in the equation's own units.

use std::sync::Arc;

use super::candidates::{Candidate, Effect, multiple};
use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::{Expression, Function, Node, Symbol, call, multiply, number, symbol};
use crate::rig::Direction;

/// Place of the effects of the drive.
pub const DRIVE: &str = "drive";
/// Place of an imbalance.
pub const ARM: &str = "arm1";

/// Force at the base, along it or across, at `order` times its frequency: cosine and sine.
fn at_base(function: Function, x: &Node, order: f64) -> Vec<Node> {
    let phase = multiply(number(order), symbol(Symbol::Tau));
    let shape = call(function, x.clone());
    vec![multiply(shape.clone(), call(Function::Cos, phase.clone())), multiply(shape, call(Function::Sin, phase))]
}

const BEND: &str = "measure the base with an accelerometer and look at the multiples of the drive's frequency";
const SIDEWAYS: &str = "measure the base across the drive with an accelerometer";

static HORIZONTAL: [Effect; 3] = [
    Effect::of_drive("vertical-motion", "A cos τ + B sin τ, vertically", SIDEWAYS, |_, x, _| {
        vec![(None, at_base(Function::Sin, &x, 1.0))]
    }),
    Effect::of_drive("drive-harmonic-2", "r a cos(2τ − β) in the base's displacement", BEND, |_, x, _| {
        vec![(None, at_base(Function::Cos, &x, 2.0))]
    }),
    Effect::of_drive("drive-harmonic-3", "r a cos(3τ − β) in the base's displacement", BEND, |_, x, _| {
        vec![(None, at_base(Function::Cos, &x, 3.0))]
    }),
];

static VERTICAL: [Effect; 3] = [
    Effect::of_drive("horizontal-motion", "A cos τ + B sin τ, horizontally", SIDEWAYS, |_, x, _| {
        vec![(None, at_base(Function::Cos, &x, 1.0))]
    }),
    Effect::of_drive("drive-harmonic-2", "r a cos(2τ − β) in the base's displacement", BEND, |_, x, _| {
        vec![(None, at_base(Function::Sin, &x, 2.0))]
    }),
    Effect::of_drive("drive-harmonic-3", "r a cos(3τ − β) in the base's displacement", BEND, |_, x, _| {
        vec![(None, at_base(Function::Sin, &x, 3.0))]
    }),
];

static IMBALANCE: Effect = Effect::of_drive(
    "imbalance",
    "the centroid off the arm's line by an angle",
    "find the position of rest: it is not where 0 was set",
    |_, x, _| vec![(None, vec![call(Function::Cos, x)])],
);

/// Every candidate at the drive and at the arm of a single pendulum driven in a direction (none for a free one) that the model does not hold already; `coefficient`: of its
/// terms by name.
pub fn candidates(
    model: &ModelFile,
    omega: f64,
    direction: Option<Direction>,
    coefficient: &dyn Fn(&str) -> f64,
) -> Vec<Candidate> {
    let Some(equation) = model.equations.first() else { return Vec::new() };
    let x = symbol(Symbol::Coordinate(0));
    let terms: Vec<(f64, Node)> =
        equation.terms.iter().map(|t| (coefficient(&t.name), model.in_seconds(&t.of, omega))).collect();
    let list: &[Effect] = match direction {
        Some(Direction::Horizontal) => &HORIZONTAL,
        Some(Direction::Vertical) => &VERTICAL,
        None => &[],
    };
    let mut out = Vec::new();
    for (rank, effect) in list.iter().enumerate() {
        let Some((shape, columns)) = effect.first_form(x.clone()) else { continue };
        if !columns.iter().any(|c| terms.iter().any(|(_, t)| multiple(t, c).is_some())) {
            let at = DRIVE.to_owned();
            out.push(Candidate { effect, rank: 100 + rank, at, equation: 0, shape, columns });
        }
    }
    if direction.is_none() {
        return out;
    }
    // An angle between arm and centroid turns every force that acts at the centroid: gravity and the base's.
    let turned = terms
        .iter()
        .filter(|(k, t)| *k != 0.0 && !t.any(&|s| matches!(s, Symbol::Rate(_) | Symbol::Acceleration(_))))
        .filter_map(|(k, t)| Some(multiply(number(*k), t.derivative(Symbol::Coordinate(0))?)))
        .reduce(|a, b| Arc::new(Expression::Add(a, b)));
    let rest = call(Function::Cos, x);
    if let Some(column) = turned
        && !terms.iter().any(|(_, t)| multiple(t, &rest).is_some())
    {
        let (effect, at) = (&IMBALANCE, ARM.to_owned());
        out.push(Candidate { effect, rank: 99, at, equation: 0, shape: None, columns: vec![column] });
    }
    out
}
