//! Accelerations and their partial derivatives against the equations and against differences.

use std::path::Path;

use super::abreast::{Abreast, Room};
use super::*;
use crate::model::dynamics::{Dynamics, Here, Instant, Linearisation, Switch, differences};
use crate::model::model_file::expression::{Function, add, call, multiply, number, power_whole, symbol};
use crate::model::model_file::tape::ABREAST;

/// The double pendulum's accelerations satisfy its equations, coefficient by coefficient.
#[test]
fn accelerations_satisfy_the_equations() {
    let text = r#"
name = "double pendulum"
coordinates = [{ name = "p", space = "S1" }, { name = "q", space = "S1" }]
inputs = ["u"]
[[equation]]
balance = "u - p''"
terms = { B1 = "q''*cos(q - p) - q'^2*sin(q - p)", B2 = "sin(p)", C = "p' - q'" }
[[equation]]
balance = "-q''"
terms = { B3 = "p''*cos(q - p) + p'^2*sin(q - p)", B4 = "sin(q)*cos(tau)", D = "q' - p'" }
"#;
    let model = ModelFile::parse(text, Path::new("m.toml")).unwrap();
    let motion = EquationsOfMotion::new(&model, 3.0).unwrap();
    assert_eq!(motion.coefficients(), ["B1", "B2", "C", "B3", "B4", "D"]);
    let p = [0.12, 40.0, 0.3, 1.6, 90.0, 0.5];
    let (q, v) = ([0.7, 7.1], [2.0, -3.0]);
    let at = Instant { time: 0.0, tau: 0.4, inputs: &[5.0] };
    let mut a = [0.0; 2];
    assert!(motion.acceleration(&p, &q, &v, &at, &mut a));
    // Primes are by τ = 3 t.
    let (v, a) = (v.map(|x| x / 3.0), a.map(|x| x / 9.0));
    let d = q[1] - q[0];
    let e1 = p[0] * (a[1] * d.cos() - v[1] * v[1] * d.sin()) + p[1] * q[0].sin() + p[2] * (v[0] - v[1]) - 5.0 + a[0];
    let e2 = p[3] * (a[0] * d.cos() + v[0] * v[0] * d.sin())
        + p[4] * q[1].sin() * 0.4_f64.cos()
        + p[5] * (v[1] - v[0])
        + a[1];
    assert!(e1.abs() < 1e-12 && e2.abs() < 1e-12, "{e1:e} {e2:e}");
    assert!(!motion.acceleration(&[f64::NAN; 6], &q, &v, &at, &mut [0.0; 2]));
}

/// Analytic partials against differences, with friction held; switches are found whatever their
/// scale.
#[test]
fn partials_agree_with_differences() {
    let text = r#"
name = "two"
coordinates = [{ name = "x", space = "R" }, { name = "y", space = "S1" }]
inputs = ["u"]
[[equation]]
balance = "u"
terms = { m = "(2 + cos(y))*x'' + y''*sin(y)", k = "x^3", c = "sign(x' - y')*(1 + x^2)", d = "x'*abs(x')" }
[[equation]]
balance = "-2*y''"
terms = { h = "x''*sin(y)", g = "sin(y)", e = "sign(2*y' - 2*x')" }
"#;
    let model = ModelFile::parse(text, Path::new("m.toml")).unwrap();
    let motion = EquationsOfMotion::new(&model, 1.0).unwrap();
    assert_eq!(motion.switches(), [Switch::of_rates(vec![1.0, -1.0])]);
    let p = [3.0, 0.7, 0.2, 0.1, 0.4, 9.0, 0.3];
    let (q, v) = ([0.7, 2.1], [2.0, -3.0]);
    let at = Instant { time: 0.0, tau: 0.0, inputs: &[5.0] };
    let mut analytic = vec![0.0; 2 * 11];
    let here = Here { parameters: &p, q: &q, v: &v, at: &at, signs: &motion.signs(&q, &v, at.inputs) };
    assert!(motion.linearise_held(here, Linearisation { acceleration: &mut [0.0; 2], partials: &mut analytic }));
    let mut near = vec![0.0; 2 * 11];
    assert!(differences(&motion, here, &mut near));
    for (a, d) in analytic.iter().zip(&near) {
        assert!((a - d).abs() < 1e-6 * (1.0 + a.abs()), "{analytic:?} {near:?}");
    }
    // The held sign enters linearly.
    let accel = |sign: f64| {
        let mut out = [0.0; 2];
        assert!(motion.acceleration_held(Here { signs: &[sign], ..here }, &mut out));
        out
    };
    let (a, b, c) = (accel(-1.0), accel(0.0), accel(1.0));
    assert!((a[0] + c[0] - 2.0 * b[0]).abs() < 1e-12 && a[0] != c[0]);
}

/// Two coordinates with a column that is no linear function of accelerations, and the column.
fn loaded() -> (EquationsOfMotion, Node) {
    let text = r#"
name = "two"
coordinates = [{ name = "x", space = "R" }, { name = "y", space = "S1" }]
[[equation]]
balance = "-x''"
terms = { m = "y''*cos(y)", k = "x" }
[[equation]]
balance = "-y''"
terms = { h = "x''*cos(y)", g = "sin(y)" }
"#;
    let model = ModelFile::parse(text, Path::new("m.toml")).unwrap();
    let a = |i| symbol(Symbol::Acceleration(i));
    let load = call(Function::Sqrt, add(power_whole(add(a(0), number(9.0)), 2), power_whole(a(1), 2)));
    let sign = call(Function::Sign, symbol(Symbol::Rate(1)));
    let column = multiply(sign, load);
    let extra = [(1, "mu".to_owned(), column.clone())];
    (EquationsOfMotion::with_columns(&model, 1.0, &extra).unwrap(), column)
}

/// Of three states side by side accelerations and partial derivatives are those of one alone.
#[test]
fn accelerations_inside_functions_are_found_side_by_side() {
    let motion = loaded().0;
    assert!(motion.goes_abreast());
    let p = [0.2, 4.0, 0.5, 20.0, 0.05];
    let states = [[0.7, 2.1, 2.0, -3.0], [-0.4, 0.3, 1.0, 4.0], [1.2, -2.0, -0.5, -1.0]];
    let instant = Instant { time: 0.0, tau: 0.0, inputs: &[] };
    let mut columns = vec![0.0; 4 * ABREAST];
    let mut signs = vec![vec![0.0; ABREAST]; motion.held()];
    for (i, state) in states.iter().enumerate() {
        (0..4).for_each(|c| columns[c * ABREAST + i] = state[c]);
        let own = motion.signs(&state[..2], &state[2..], instant.inputs);
        signs.iter_mut().zip(own).for_each(|(to, sign)| to[i] = sign);
    }
    let at = Abreast { count: 3, states: &columns, times: &[0.0; 3], taus: &[0.0; 3], inputs: &[], signs: &signs };
    let (mut accelerations, mut partials) = (vec![0.0; 2 * ABREAST], vec![0.0; 8 * ABREAST]);
    let mut exists = [true; 3];
    motion.linearise_abreast(&p, &at, &mut Room::default(), &mut accelerations, &mut partials, &mut exists);
    assert_eq!(exists, [true; 3]);
    for (i, state) in states.iter().enumerate() {
        let (q, v) = state.split_at(2);
        let (mut alone, mut slopes) = ([0.0; 2], [0.0; 8]);
        let here = Here { parameters: &p, q, v, at: &instant, signs: &motion.signs(q, v, instant.inputs) };
        assert!(motion.linearise_held(here, Linearisation { acceleration: &mut alone, partials: &mut slopes }));
        let both = alone.iter().chain(&slopes);
        let beside = accelerations.iter().chain(&partials).skip(i).step_by(ABREAST);
        for (k, (x, y)) in both.zip(beside).enumerate() {
            assert!((x - y).abs() < 1e-9 * (1.0 + x.abs()), "{i} {k}: {x} {y}");
        }
    }
    // A law so strong that no pass stands still has no solution.
    motion.linearise_abreast(
        &[0.2, 4.0, 0.5, 20.0, 5.0],
        &at,
        &mut Room::default(),
        &mut accelerations,
        &mut partials,
        &mut exists,
    );
    assert!(!exists[0]);
}

/// What is found satisfies the equations, and so do its partial derivatives.
#[test]
fn accelerations_inside_functions_are_found() {
    let (motion, column) = loaded();
    let p = [0.2, 4.0, 0.5, 20.0, 0.05];
    let (q, v) = ([0.7, 2.1], [2.0, -3.0]);
    let at = Instant { time: 0.0, tau: 0.0, inputs: &[] };
    let mut found = [0.0; 2];
    assert!(motion.acceleration(&p, &q, &v, &at, &mut found));
    let cos = q[1].cos();
    let force = column.value(&|s| match s {
        Symbol::Acceleration(i) => found[i],
        _ => -3.0,
    });
    let first = found[0] + p[0] * found[1] * cos + p[1] * q[0];
    let second = found[1] + p[2] * found[0] * cos + p[3] * q[1].sin() + p[4] * force;
    assert!(first.abs() < 1e-11 && second.abs() < 1e-11, "{first:e} {second:e}");
    let mut analytic = vec![0.0; 2 * 9];
    let here = Here { parameters: &p, q: &q, v: &v, at: &at, signs: &motion.signs(&q, &v, at.inputs) };
    assert!(motion.linearise_held(here, Linearisation { acceleration: &mut [0.0; 2], partials: &mut analytic }));
    for k in 0..9 {
        let arguments = [&q[..], &v, &p].concat();
        let moved = |by: f64| {
            let mut x = arguments.clone();
            x[k] += by;
            let mut out = [0.0; 2];
            assert!(motion.acceleration(&x[4..], &x[..2], &x[2..4], &at, &mut out));
            out
        };
        let (ahead, behind) = (moved(1e-6), moved(-1e-6));
        for i in 0..2 {
            let difference = (ahead[i] - behind[i]) / 2e-6;
            let own = analytic[i * 9 + k];
            assert!((own - difference).abs() < 1e-6 * (1.0 + own.abs()), "{i} {k}: {own} {difference}");
        }
    }
    // A law so strong that no pass stands still has no solution.
    assert!(!motion.acceleration(&[0.2, 4.0, 0.5, 20.0, 5.0], &q, &v, &at, &mut found));
}
