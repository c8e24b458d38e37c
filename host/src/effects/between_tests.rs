//! Where forces between two coordinates have a place, and what they add: against differences of
//! their potential, and against the simulated pair of masses, which was written apart.

use core::f64::consts::{PI, TAU};
use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use whirl_hil_sim::plant_oscillator::Oscillator;
use whirl_hil_sim::plant_two_mass::TwoMass;

use super::*;
use crate::effects::catalogue;
use crate::effects::columns::{Action, Span, action, columns};
use crate::effects::written;
use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::{Node, number};
use crate::model::model_file::toml_place::Source;
use crate::system::library;

const SPAN: Span = Span { start_s: 0.0, length_s: 40.0 };
/// Two masses of the simulated pair, each on its spring, and nothing between them.
const CARTS: &str = "name = \"two carts\"\ncoordinates = { x1 = \"length\", x2 = \"length\" }\n\
    parameters = { m1 = \"kg\", m2 = \"kg\", k1 = \"N/m\", k2 = \"N/m\", n = \"N/m^3\" }\n\
    kinetic = \"m1*x1'^2/2 + m2*x2'^2/2\"\npotential = \"k1*x1^2/2 + n*x1^4/4 + k2*x2^2/2\"\n";

fn spring() -> &'static Entry {
    catalogue().iter().find(|e| e.id == "coupling-stiffness").unwrap()
}

fn derived(text: &str) -> ModelFile {
    let source = Source { text: text.to_owned(), path: Path::new("m.toml").to_path_buf() };
    SystemFile::from_source(source).unwrap().model(Some(&[]), 0.0).unwrap()
}

fn written(text: &str) -> ModelFile {
    ModelFile::parse(text, Path::new("m.toml")).unwrap()
}

fn shipped(name: &str) -> ModelFile {
    derived(library::text(name).unwrap())
}

fn places_of(file: &SystemFile) -> Vec<String> {
    pairs(file).into_iter().map(|(i, j)| Place::Between(i, j).name(file)).collect()
}

/// The column of a spring of one.
fn column(m: &Mechanism, pair: (usize, usize), form: &Form, parameters: &[f64]) -> Vec<(usize, Node)> {
    let place = Place::Between(pair.0, pair.1);
    let Some(Action::Force(parts)) = action(spring(), form, place, m, parameters, 0.0, SPAN).unwrap() else {
        panic!("{pair:?}")
    };
    columns(&parts, 1, m, parameters).remove(0)
}

/// A column times the equations' inertias is the slope of ½ (x_i − x_j)², the difference of angles
/// within half a turn.
fn is_the_slope(m: &Mechanism, pair: (usize, usize), form: &Form, parameters: &[f64], inertias: &[f64], turns: bool) {
    let of = column(m, pair, form, parameters);
    let potential = |q: &[f64]| {
        let x = q[pair.0] - q[pair.1];
        let x = if turns { x - TAU * (x / TAU).round() } else { x };
        0.5 * x * x
    };
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let mut compared = 0;
    for _ in 0..200 {
        let q: Vec<f64> = inertias.iter().map(|_| random.random_range(-9.0..9.0)).collect();
        let x = (q[pair.0] - q[pair.1]).rem_euclid(TAU);
        // Where the angle turns over the potential has a corner.
        if turns && (x - PI).abs() < 0.01 {
            continue;
        }
        for (e, inertia) in inertias.iter().enumerate() {
            let (mut low, mut high) = (q.clone(), q.clone());
            (low[e], high[e]) = (q[e] - 1e-4, q[e] + 1e-4);
            let wanted = (potential(&high) - potential(&low)) / 2e-4 / inertia;
            let at = |s: Symbol| if let Symbol::Coordinate(k) = s { q[k] } else { f64::NAN };
            let got: f64 = of.iter().filter(|c| c.0 == e).map(|c| c.1.value(&at)).sum();
            assert!((got - wanted).abs() < 1e-6 * (1.0 + wanted.abs()), "equation {e} at {q:?}: {got} {wanted}");
            compared += usize::from(wanted != 0.0);
        }
    }
    assert!(compared > 300, "{compared}");
}

#[test]
fn pairs_are_of_one_kind_and_no_joint_moves_by_their_difference() {
    for (name, wanted) in [
        ("two-masses", &["x1-x2"][..]),
        ("triple-pendulum", &["phi1-phi3"]),
        ("furuta-pendulum", &["alpha-theta"]),
        // Its second joint moves by phi2 - phi1: a torsion spring there is it.
        ("double-pendulum", &[]),
        ("double-pendulum-free", &[]),
        ("cart-pendulum", &[]),
        ("mass-and-pendulum", &[]),
        ("geared-motor", &[]),
    ] {
        let model = shipped(name);
        assert_eq!(places_of(model.mechanism.unwrap().file.as_ref().unwrap()), wanted, "{name}");
    }
    let joint = "\n[[joint]]\nname = \"damper\"\nmoves = \"x1 - x2\"\n";
    for (text, count) in [(CARTS.to_owned(), 1), (format!("{CARTS}{joint}"), 0)] {
        let model = derived(&text);
        assert_eq!(pairs(model.mechanism.unwrap().file.as_ref().unwrap()).len(), count, "{text}");
    }
    let volts = CARTS.replacen("x2 = \"length\"", "x2 = \"V\"", 1);
    assert!(pairs(derived(&volts).mechanism.unwrap().file.as_ref().unwrap()).is_empty());
}

#[test]
fn a_spring_between_two_bodies_has_a_potential() {
    let m = derived(CARTS).mechanism.unwrap();
    is_the_slope(&m, (0, 1), &Vec::new(), &[2.0, 0.7, 3.0, 4.0, 5.0, 9.81], &[2.0, 0.7], false);
    let m = shipped("triple-pendulum").mechanism.unwrap();
    let parameters: Vec<f64> = (0..m.parameters.len()).map(|k| 0.3 + 0.1 * k as f64).collect();
    let inertias: Vec<f64> = m.scales.iter().map(|s| at(&s.1, &parameters)).collect();
    assert!(inertias[0] != inertias[2]);
    is_the_slope(&m, (0, 2), &Vec::new(), &parameters, &inertias, true);
}

/// A ratio that was found stands in the place of the one that the parameters have.
#[test]
fn a_ratio_of_inertias_replaces_that_of_the_parameters() {
    let m = derived(CARTS).mechanism.unwrap();
    let ratio = vec![(INERTIA_RATIO.to_owned(), 0.25)];
    is_the_slope(&m, (0, 1), &ratio, &[3.0, 0.5, 3.0, 4.0, 5.0, 9.81], &[2.0, 0.5], false);
}

/// The pair of masses that hil-sim has, its middle spring put between two that stand alone.
#[test]
fn a_spring_between_two_masses_is_that_of_the_simulated_pair() {
    let model = derived(CARTS);
    let m = model.mechanism.as_deref().unwrap();
    let parameters = [1.0, 1.0, 1.0, 1.0, 1.0, 9.81];
    let of = column(m, (0, 1), &Vec::new(), &parameters);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..200 {
        let mut any = || random.random_range(-3.0..3.0);
        let state = [any(), any(), any(), any()];
        let rate = TwoMass.rate(0.0, &state);
        let at = |s: Symbol| match s {
            Symbol::Coordinate(k) => state[k],
            Symbol::Rate(k) => state[2 + k],
            Symbol::Acceleration(k) => rate[2 + k],
            _ => f64::NAN,
        };
        for (e, equation) in model.equations.iter().enumerate() {
            let terms = equation.terms.iter().map(|t| m.value(&t.name, &parameters).unwrap() * t.of.value(&at));
            let alone = terms.sum::<f64>() - equation.balance.value(&at);
            let between: f64 = of.iter().filter(|c| c.0 == e).map(|c| c.1.value(&at)).sum();
            assert!((alone + between).abs() < 1e-12, "equation {e} at {state:?}: {alone} {between}");
            assert!(alone.abs() > 1e-9);
        }
    }
}

/// Written equations that share an inertia tell its ratio; those that share nothing do not.
#[test]
fn written_equations_have_a_spring_in_both() {
    let head = "name = \"m\"\ncoordinates = [{ name = \"a\", space = \"S1\" }, { name = \"b\", space = \"S1\" }, { name = \"c\", space = \"S1\" }]\n";
    let coupled = "[[equation]]\nbalance = \"-a''\"\nterms = { B = \"b''*cos(b - a) - b'^2*sin(b - a)\", k = \"sin(a)\" }\n\
        [[equation]]\nbalance = \"-b''\"\nterms = { C = \"a''*cos(b - a) + a'^2*sin(b - a)\", l = \"sin(b)\" }\n";
    let alone = "[[equation]]\nbalance = \"-c''\"\nterms = { h = \"sin(c)\" }\n";
    let model = written(&format!("{head}{coupled}{alone}"));
    let values = [0.5, 1.0, 2.0, 1.0, 3.0];
    let m = written::mechanism(&model, None, 1.0, &values).unwrap();
    let own = written::parameters(&model, None, 1.0, &values).unwrap();
    assert_eq!(m.apart, [(0, 2), (1, 2)]);
    // The pair that is coupled has a joint of its own.
    assert_eq!(places_of(m.file.as_ref().unwrap()), ["a-c", "b-c"]);
    for (place, open) in [(Place::Between(1, 2), true), (Place::Joint(2), false)] {
        assert_eq!(in_written(spring(), place, &m).is_some(), open);
    }
    let ratio = vec![(INERTIA_RATIO.to_owned(), 4.0)];
    // D_c of one stays, and that of the other is a quarter of it.
    is_the_slope(&m, (1, 2), &ratio, &own, &[1.0, 0.25, 1.0], true);
    // With joints that the file names: D_b is a quarter of D_a.
    let joints = "[[joint]]\nname = \"one\"\nmoves = \"a\"\n[[joint]]\nname = \"two\"\nmoves = \"b\"\n[[joint]]\nname = \"three\"\nmoves = \"c\"\n";
    let head = "name = \"m\"\ncoordinates = { a = \"angle\", b = \"angle\", c = \"angle\" }\n";
    let named = derived(&format!("{head}{joints}{coupled}{alone}"));
    let m = written::mechanism(&named, None, 1.0, &values).unwrap();
    assert_eq!(places_of(m.file.as_ref().unwrap()), ["a-b", "a-c", "b-c"]);
    assert!(in_written(spring(), Place::Between(0, 1), &m).is_none());
    is_the_slope(&m, (0, 1), &Vec::new(), &own, &[1.0, 0.25, 1.0], true);
}

/// A play of a metre that is told in millimetres is the same play: four of a length's units are no
/// other length, as four radians are another angle.
#[test]
fn a_state_that_follows_a_length_is_not_wrapped() {
    let play = catalogue().iter().find(|e| e.id == "play").unwrap();
    let m = derived(CARTS).mechanism.unwrap();
    let parameters = vec![1.0; m.parameters.len()];
    let form = play.forms().remove(0);
    let found = action(play, &form, Place::Between(0, 1), &m, &parameters, 0.0, SPAN).unwrap().unwrap();
    let seen = core::cell::Cell::new(0);
    let _ = found.with_memories(&|memory, k| {
        // Behind at ten units it is drawn along.
        let rate = memory.rates()[k].value(&|s| match s {
            Symbol::Coordinate(i) => [10.0, 0.0][i],
            Symbol::Rate(i) => [1.0, 0.0][i],
            Symbol::State(_) => 0.0,
            _ => f64::NAN,
        });
        assert!((rate.abs() - 1.0).abs() < 1e-12, "{rate}");
        seen.set(seen.get() + 1);
        number(0.0)
    });
    assert!(seen.get() > 0);
}
