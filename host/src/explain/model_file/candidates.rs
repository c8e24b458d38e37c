//! Effects that apply to a coordinate of a model file: what each adds to the left-hand side of its equation for a strength of one.
//!
//! Places are the coordinates' names. v is the coordinate's velocity, x the coordinate, wrapped on S1. Strengths are in the equation's own
//! units; positive ones oppose the motion where the equation's inertia is positive. One line each in [`EFFECTS`].

use std::sync::Arc;

use crate::model::model_file::expression::{
    Expression, Function, Node, Symbol, call, divide, multiple, multiply, number, power_whole, symbol,
};
use crate::model::model_file::{ModelFile, Space};

/// One effect.
pub struct Effect {
    /// Name before the `@`.
    pub id: &'static str,
    /// What it adds.
    pub equation: &'static str,
    /// The laboratory test that would confirm it.
    pub confirm: &'static str,
    /// Whether it needs an angle on S1.
    circle: bool,
    /// Whether it takes a body that moves: dry friction, drag. A coordinate in volts or amperes has none.
    mechanical: bool,
    /// Whether it takes energy away: then its strength has the sign of the equation's inertia.
    pub dissipates: bool,
    /// The simpler effect that it refines: while that one is supported itself, this one is not named.
    pub refines: Option<&'static str>,
    /// Its forms: shape parameter, and one expression for each strength.
    forms: fn(&Sizes, Node, Node) -> Vec<Form>,
}

/// A form of an effect: its shape parameter, if it has one, and one expression for each strength.
pub(super) type Form = (Option<(&'static str, f64)>, Vec<Node>);

/// Sizes of the motion that shapes are chosen by.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    /// Root mean square velocity.
    pub speed: f64,
    /// Coefficient of sin x over the coordinate's inertia, s⁻², where the model has one.
    pub gravity: Option<f64>,
    /// The shape parameter, where it is known.
    pub shape: Option<f64>,
}

impl Sizes {
    /// The shape parameter that is known, or several to try.
    fn shapes(&self, several: impl IntoIterator<Item = f64>) -> Vec<f64> {
        self.shape.map_or_else(|| several.into_iter().collect(), |s| vec![s])
    }
}

impl Effect {
    /// Its first form at a coordinate, for unit sizes.
    fn first_form(&self, x: Node) -> Option<Form> {
        let sizes = Sizes { speed: 1.0, gravity: Some(1.0), shape: None };
        (self.forms)(&sizes, x, symbol(Symbol::Rate(0))).into_iter().next()
    }

    /// The first form for unit sizes.
    fn example(&self) -> Option<Form> {
        self.first_form(symbol(Symbol::Coordinate(0)))
    }

    /// Name of its shape parameter, if it has one.
    pub fn shape(&self) -> Option<&'static str> {
        self.example().and_then(|f| f.0).map(|s| s.0)
    }

    /// Whether it has a phase ψ: two strengths.
    pub fn phase(&self) -> bool {
        self.example().is_some_and(|f| f.1.len() == 2)
    }

    /// Whether it needs an angle on S1.
    pub fn is_circular(&self) -> bool {
        self.circle
    }
}

fn sign(v: Node) -> Node {
    call(Function::Sign, v)
}

fn abs(v: Node) -> Node {
    call(Function::Abs, v)
}

fn one(e: Node) -> Vec<Form> {
    vec![(None, vec![e])]
}

/// Every effect, the simplest first: of two that held-out data do not tell apart the first is named.
pub static EFFECTS: &[Effect] = &[
    Effect {
        id: "viscous-friction",
        equation: "c v",
        confirm: "free decays from different amplitudes have one logarithmic decrement",
        circle: false,
        mechanical: false,
        dissipates: true,
        refines: None,
        forms: |_, _, v| one(v),
    },
    Effect {
        id: "coulomb-friction",
        equation: "τ sign v",
        confirm: "pull slowly both ways with a spring balance: the force has a level that does not vanish with speed",
        circle: false,
        mechanical: true,
        dissipates: true,
        refines: None,
        forms: |_, _, v| one(sign(v)),
    },
    Effect {
        id: "constant-force",
        equation: "F",
        confirm: "tilt or turn the rig round: the force keeps its side",
        circle: false,
        mechanical: false,
        dissipates: false,
        refines: None,
        forms: |_, _, _| one(number(1.0)),
    },
    Effect {
        id: "torsion-spring",
        equation: "k x",
        confirm: "hold it at several positions with a spring balance",
        circle: false,
        mechanical: false,
        dissipates: false,
        refines: None,
        forms: |_, x, _| one(x),
    },
    Effect {
        id: "imbalance",
        equation: "S cos x",
        confirm: "find the position of rest: it is not where 0 was set",
        circle: true,
        mechanical: false,
        dissipates: false,
        refines: None,
        forms: |_, x, _| one(call(Function::Cos, x)),
    },
    Effect {
        id: "cubic-stiffness",
        equation: "k x³",
        confirm: "the frequency of free decays changes with the square of the amplitude",
        circle: false,
        mechanical: false,
        dissipates: false,
        refines: None,
        forms: |_, x, _| one(power_whole(x, 3)),
    },
    Effect {
        id: "quadratic-stiffness",
        equation: "k x²",
        confirm: "the middle of an oscillation moves with its amplitude",
        circle: false,
        mechanical: false,
        dissipates: false,
        refines: None,
        forms: |_, x, _| one(power_whole(x, 2)),
    },
    Effect {
        id: "quadratic-drag",
        equation: "k v |v|",
        confirm: "add a sail: it grows",
        circle: false,
        mechanical: true,
        dissipates: true,
        refines: Some("viscous-friction"),
        forms: |_, _, v| one(multiply(v.clone(), abs(v))),
    },
    Effect {
        id: "asymmetric-friction",
        equation: "c |v|: friction that differs with direction",
        confirm: "move at one speed both ways and compare the forces",
        circle: false,
        mechanical: true,
        dissipates: false,
        refines: Some("constant-force"),
        forms: |_, _, v| one(abs(v)),
    },
    Effect {
        id: "amplitude-dependent-damping",
        equation: "c x² v",
        confirm: "the decrement of free decays changes with the square of the amplitude",
        circle: false,
        mechanical: false,
        dissipates: true,
        refines: Some("viscous-friction"),
        forms: |_, x, v| one(multiply(power_whole(x, 2), v)),
    },
    Effect {
        id: "load-dependent-friction",
        equation: "μ |G cos x + v²| sign v, G in s⁻²",
        confirm: "add weight: the friction grows with it",
        circle: true,
        mechanical: true,
        dissipates: true,
        refines: Some("coulomb-friction"),
        forms: |s, x, v| {
            // G = g over the distance of the centroid; the coefficient of sin x is that or, with inertia about the centroid, less.
            s.shapes(s.gravity.into_iter().flat_map(|k| [1.0, 1.2, 1.5].map(|f| f * k)))
                .into_iter()
                .map(|g| {
                    let load =
                        Expression::Add(multiply(number(g), call(Function::Cos, x.clone())), power_whole(v.clone(), 2));
                    (Some(("G", g)), vec![multiply(abs(Arc::new(load)), sign(v.clone()))])
                })
                .collect()
        },
    },
    Effect {
        id: "stribeck-friction",
        equation: "τ exp(−(v/v_s)²) sign v",
        confirm: "drive it at several low speeds: the force falls with speed",
        circle: false,
        mechanical: true,
        dissipates: true,
        refines: Some("coulomb-friction"),
        forms: |s, _, v| {
            s.shapes([0.03, 0.1, 0.3, 1.0].map(|f| f * s.speed))
                .into_iter()
                .map(|at| {
                    let square = power_whole(divide(v.clone(), number(at)), 2);
                    let falling = call(Function::Exp, multiply(number(-1.0), square));
                    (Some(("v_s", at)), vec![multiply(falling, sign(v.clone()))])
                })
                .collect()
        },
    },
    Effect {
        id: "cogging",
        equation: "A sin(n x + ψ)",
        confirm: "turn it slowly by hand and feel the detents",
        circle: true,
        mechanical: false,
        dissipates: false,
        refines: Some("imbalance"),
        forms: |s, x, _| {
            s.shapes((2..=24).map(f64::from))
                .into_iter()
                .map(|n| {
                    let argument = multiply(number(n), x.clone());
                    let parts = vec![call(Function::Sin, argument.clone()), call(Function::Cos, argument)];
                    (Some(("n", n)), parts)
                })
                .collect()
        },
    },
];

/// An effect at a coordinate in one form.
#[derive(Clone)]
pub struct Candidate {
    /// Effect.
    pub effect: &'static Effect,
    /// Rank of the effect in the list.
    pub rank: usize,
    /// The coordinate's name.
    pub at: String,
    /// Equation that it is added to.
    pub equation: usize,
    /// Shape parameter.
    pub shape: Option<(&'static str, f64)>,
    /// One expression for each strength, in seconds.
    pub columns: Vec<Node>,
}

impl Candidate {
    /// `ID@PLACE`.
    pub fn name(&self) -> String {
        format!("{}@{}", self.effect.id, self.at)
    }
}

/// The equation of a coordinate: its own number where there are as many equations as coordinates, otherwise the first that holds its
/// acceleration.
fn equation_of(model: &ModelFile, coordinate: usize) -> Option<usize> {
    let holds = |e: usize| {
        let equation = &model.equations[e];
        std::iter::once(&equation.balance)
            .chain(equation.terms.iter().map(|t| &t.of))
            .any(|n| n.any(&|s| s == Symbol::Acceleration(coordinate)))
    };
    let own = Some(coordinate).filter(|e| model.equations.len() == model.coordinates.len() && holds(*e));
    own.or_else(|| (0..model.equations.len()).find(|e| holds(*e)))
}

/// Every candidate that the model does not hold as a term already. `speed` is each coordinate's rms velocity; `moves[i]` says whether
/// coordinate i is a length or an angle, `gravity[i]` is its coefficient of sin x over its inertia, s⁻².
pub fn candidates(
    model: &ModelFile,
    omega: f64,
    speed: &[f64],
    moves: &[bool],
    gravity: &[Option<f64>],
) -> Vec<Candidate> {
    let mut out = Vec::new();
    for (i, c) in model.coordinates.iter().enumerate() {
        let Some(equation) = equation_of(model, i) else { continue };
        let held: Vec<Node> = model.equations[equation].terms.iter().map(|t| model.in_seconds(&t.of, omega)).collect();
        let (x, v) = (symbol(Symbol::Coordinate(i)), symbol(Symbol::Rate(i)));
        for (rank, effect) in EFFECTS.iter().enumerate() {
            if (effect.circle && c.space != Space::Circle) || (effect.mechanical && !moves[i]) {
                continue;
            }
            for (shape, columns) in
                (effect.forms)(&Sizes { speed: speed[i], gravity: gravity[i], shape: None }, x.clone(), v.clone())
            {
                if columns.iter().any(|c| held.iter().any(|h| multiple(h, c).is_some())) {
                    continue;
                }
                out.push(Candidate { effect, rank, at: c.name.clone(), equation, shape, columns });
            }
        }
    }
    out
}

/// For each coordinate, the coefficient of sin x over the inertia in its equation, for coefficients by name; none where there is no such term
/// or where it does not pull back.
pub fn gravity(model: &ModelFile, omega: f64, coefficient: &dyn Fn(&str) -> f64) -> Vec<Option<f64>> {
    (0..model.coordinates.len())
        .map(|i| {
            let equation = &model.equations[equation_of(model, i)?];
            let at_rest = |n: &Node| {
                model.in_seconds(n, omega).derivative(Symbol::Acceleration(i)).map_or(0.0, |d| d.value(&|_| 0.0))
            };
            let terms = || equation.terms.iter().map(|t| (coefficient(&t.name), &t.of));
            let inertia: f64 = terms().map(|(k, of)| k * at_rest(of)).sum::<f64>() - at_rest(&equation.balance);
            let pull = call(Function::Sin, symbol(Symbol::Coordinate(i)));
            let sum: f64 = terms().filter_map(|(k, of)| Some(k * multiple(&model.in_seconds(of, omega), &pull)?)).sum();
            Some(sum / inertia).filter(|g| g.is_finite() && *g > 0.0)
        })
        .collect()
}

/// An effect at a coordinate with a known shape parameter; none where there is no such effect.
pub fn candidate(model: &ModelFile, id: &str, at: &str, shape: Option<f64>, speed: &[f64]) -> Option<Candidate> {
    let (rank, effect) = EFFECTS.iter().enumerate().find(|(_, e)| e.id == id)?;
    let i = model.coordinates.iter().position(|c| c.name == at)?;
    if effect.circle && model.coordinates[i].space != Space::Circle {
        return None;
    }
    let equation = equation_of(model, i)?;
    let (x, v) = (symbol(Symbol::Coordinate(i)), symbol(Symbol::Rate(i)));
    let (shape, columns) =
        (effect.forms)(&Sizes { speed: *speed.get(i)?, gravity: None, shape }, x, v).into_iter().next()?;
    Some(Candidate { effect, rank, at: at.to_owned(), equation, shape, columns })
}

/// For each coordinate, the laws that take energy away and have no shape of their own: v, sign v, v|v|, x² v.
pub fn dissipative(coordinate: usize) -> Vec<Node> {
    let (x, v) = (symbol(Symbol::Coordinate(coordinate)), symbol(Symbol::Rate(coordinate)));
    EFFECTS
        .iter()
        .filter(|e| e.dissipates)
        .flat_map(|e| (e.forms)(&Sizes { speed: 1.0, gravity: Some(1.0), shape: None }, x.clone(), v.clone()))
        .filter_map(|(shape, mut columns)| if shape.is_none() { columns.pop() } else { None })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_model_holds_is_no_candidate() {
        let text = r#"name = "m"
coordinates = [{ name = "q", space = "S1" }]
[[equation]]
balance = "-q''"
terms = { k = "sin(q)", c = "2*q'", d = "sign(q')" }
"#;
        let model = ModelFile::parse(text, std::path::Path::new("m.toml")).unwrap();
        let list = candidates(&model, 1.0, &[2.0], &[true], &[None]);
        let names: Vec<String> = list.iter().map(Candidate::name).collect();
        assert!(!names.contains(&"viscous-friction@q".to_owned()) && !names.contains(&"coulomb-friction@q".to_owned()));
        assert!(names.contains(&"stribeck-friction@q".to_owned()) && names.contains(&"imbalance@q".to_owned()));
        assert!(list.iter().all(|c| c.equation == 0));
        let line = text.replace("S1", "R");
        let model = ModelFile::parse(&line, std::path::Path::new("m.toml")).unwrap();
        assert!(!candidates(&model, 1.0, &[2.0], &[true], &[None]).iter().any(|c| c.effect.id == "cogging"));
        // A voltage has neither dry friction nor drag.
        let text = line.replace(", d = \"sign(q')\"", "");
        let model = ModelFile::parse(&text, std::path::Path::new("m.toml")).unwrap();
        let ids = |moves: bool| -> Vec<&str> {
            candidates(&model, 1.0, &[2.0], &[moves], &[None]).iter().map(|c| c.effect.id).collect()
        };
        assert!(ids(true).contains(&"coulomb-friction") && !ids(false).contains(&"coulomb-friction"));
        assert!(!ids(false).contains(&"quadratic-drag") && ids(false).contains(&"amplitude-dependent-damping"));
    }
}
