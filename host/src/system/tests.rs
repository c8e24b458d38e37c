//! Derived equations against those of the textbook and of the program's own engine.

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::library;
use crate::model::double_pendulum::DAMPINGS;
use crate::model::double_pendulum_dynamics::DoublePendulum;
use crate::model::dynamics::{Dynamics, Instant};
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::toml_place::Source;

fn shipped(name: &str, omega: f64) -> ModelFile {
    let text = library::text(name).unwrap();
    library::read(name, text).and_then(|s| s.model(None, omega)).unwrap_or_else(|e| panic!("{e}"))
}

/// Parameters by name, and accelerations at a state.
struct Motion {
    model: ModelFile,
    motion: EquationsOfMotion,
    coefficients: Vec<f64>,
}

impl Motion {
    fn new(name: &str, omega: f64, truth: &[(&str, f64)]) -> Self {
        Self::of(shipped(name, omega), omega, truth)
    }

    fn of(model: ModelFile, omega: f64, truth: &[(&str, f64)]) -> Self {
        let mechanism = model.mechanism.clone().unwrap();
        let given: Vec<f64> = mechanism
            .parameters
            .iter()
            .map(|p| truth.iter().find(|t| t.0 == p.name).unwrap_or_else(|| panic!("{}", p.name)).1)
            .collect();
        let motion = EquationsOfMotion::new(&model, omega).unwrap();
        let coefficients = motion.coefficients().iter().map(|n| mechanism.value(n, &given).unwrap()).collect();
        Self { model, motion, coefficients }
    }

    fn at(&self, q: &[f64], v: &[f64], tau: f64, inputs: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; q.len()];
        assert!(self.motion.acceleration(&self.coefficients, q, v, &Instant { time: 0.0, tau, inputs }, &mut out));
        out
    }
}

fn states(n: usize) -> impl Iterator<Item = (Vec<f64>, Vec<f64>, f64)> {
    let mut r = ChaCha8Rng::seed_from_u64(7);
    (0..1000).map(move |_| {
        let q = (0..n).map(|_| r.random_range(-9.0..9.0)).collect();
        let v = (0..n).map(|_| r.random_range(-8.0..8.0)).collect();
        (q, v, r.random_range(0.0..6.0))
    })
}

/// Every shipped file is read; what it is stands in its first line.
#[test]
fn shipped_systems_are_read() {
    assert!(library::all().len() >= 12);
    for (name, text) in library::all() {
        let model = shipped(name, 31.0);
        assert!(library::about(text).len() > 10, "{name}");
        assert_eq!(model.equations.len(), model.coordinates.len(), "{name}");
        // What is saved with an identification is a model file of its own.
        let again = ModelFile::parse(&model.source.text, Path::new("again.toml")).unwrap();
        assert_eq!(again.equations, model.equations, "{name}");
    }
}

/// A pendulum across the end of an arm that turns about the vertical (the shipped system of alpha
/// and theta), with the angle from hanging: (J_a + m l² + J s²) α̈ + m l e (c θ̈ − s θ̇²) + 2 J s c
/// α̇ θ̇ = k i − b α̇ − τ_c sign α̇, J θ̈ + m l e c α̈ − J s c α̇² + m e g s = −b₂ θ̇.
#[test]
fn rotary_pendulum_has_the_textbook_equations() {
    let (ja, l, m, e, j, k, g) = (2.1e-3, 0.16, 0.127, 0.15, 1.2e-3 + 0.127 * 0.15 * 0.15, 0.07, 9.81);
    let (b, tc, b2) = (2e-3, 1e-3, 3e-4);
    let truth = [
        ("J_a", ja),
        ("l", l),
        ("m", m),
        ("e", e),
        ("J", j),
        ("k_t", k),
        ("g", g),
        ("viscous-friction@hub", b),
        ("coulomb-friction@hub", tc),
        ("viscous-friction@pivot", b2),
    ];
    let (name, _) = library::all().iter().find(|(_, text)| text.contains("coordinates = { alpha")).unwrap();
    let derived = Motion::new(name, 1.0, &truth);
    let mut worst = 0.0_f64;
    for (q, v, current) in states(2) {
        let a = derived.at(&q, &v, 0.0, &[current]);
        let (s, c) = q[1].sin_cos();
        let mass = [[ja + m * l * l + j * s * s, m * l * e * c], [m * l * e * c, j]];
        let right = [
            k * current - b * v[0] - tc * v[0].signum() + m * l * e * s * v[1] * v[1] - 2.0 * j * s * c * v[0] * v[1],
            -b2 * v[1] + j * s * c * v[0] * v[0] - m * e * g * s,
        ];
        let det = mass[0][0] * mass[1][1] - mass[0][1] * mass[1][0];
        let expected = [
            (right[0] * mass[1][1] - right[1] * mass[0][1]) / det,
            (right[1] * mass[0][0] - right[0] * mass[1][0]) / det,
        ];
        let size = expected[0].abs().max(expected[1].abs());
        (0..2).for_each(|i| worst = worst.max((a[i] - expected[i]).abs() / size));
    }
    assert!(worst < 1e-12, "{worst:e}");
}

/// The derived double pendulum against the program's own, coefficients (3.4) from the same physical
/// parameters.
#[test]
fn double_pendulum_has_the_built_in_equations() {
    let omega = 31.4;
    let (m1, e1, j1, l1, m2, e2, j2, ac, a_s, tc, cr, g) =
        (0.1362, 0.0127, 5.0e-4, 0.0635, 0.04, 0.0267, 4.033e-5, 0.0155, -0.004, 6.03e-4, 6.145e-5, 9.81);
    let truth = [
        ("m1", m1),
        ("e1", e1),
        ("J_1", j1),
        ("l1", l1),
        ("m2", m2),
        ("e2", e2),
        ("J_2", j2),
        ("a_c", ac),
        ("a_s", a_s),
        ("g", g),
        ("coulomb-friction@joint1", tc),
        ("viscous-friction@joint2", cr),
    ];
    let derived = Motion::new("double-pendulum", omega, &truth);
    let dampings: Vec<_> =
        DAMPINGS.iter().filter(|d| ["coulomb-friction@joint1", "viscous-friction@joint2"].contains(&d.id)).collect();
    let own = DoublePendulum::new(omega, true, &dampings);
    let (jo1, h, s1, s2, w2) = (j1 + m2 * l1 * l1, m2 * e2 * l1, m1 * e1 + m2 * l1, m2 * e2, omega * omega);
    let parameters: Vec<f64> = own
        .names()
        .iter()
        .map(|n| match n.as_str() {
            "B11" => h / jo1,
            "B12" => g * s1 / (jo1 * w2),
            "B13" => -ac * s1 / jo1,
            "B14" => -a_s * s1 / jo1,
            "C11" => tc / (jo1 * w2),
            "C12" => cr / (jo1 * omega),
            "B21" => h / j2,
            "B22" => g * s2 / (j2 * w2),
            "B23" => -ac * s2 / j2,
            "B24" => -a_s * s2 / j2,
            "C2" => cr / (j2 * omega),
            other => panic!("{other}"),
        })
        .collect();
    let mut worst = 0.0_f64;
    for (q, v, tau) in states(2) {
        let a = derived.at(&q, &v, tau, &[]);
        let mut expected = [0.0; 2];
        assert!(own.acceleration(&parameters, &q, &v, &Instant { time: 0.0, tau, inputs: &[] }, &mut expected));
        let size = expected[0].abs().max(expected[1].abs());
        (0..2).for_each(|i| worst = worst.max((a[i] - expected[i]).abs() / size));
    }
    assert!(worst < 1e-12, "{worst:e}");
    assert_eq!(derived.model.coefficients().len(), 11);
}

/// Lengths that are numbers give the accelerations of lengths that are parameters, and no column
/// holds the acceleration that its equation is solved for.
#[test]
fn lengths_may_be_numbers() {
    let truth = [("J_1", 4e-3), ("S_1", 0.05), ("m2", 0.3), ("e2", 0.08), ("J_2", 2e-3), ("m3", 0.2), ("e3", 0.07)];
    let truth = [&truth[..], &[("J_3", 1e-3), ("l1", 0.2), ("l2", 0.17), ("g", 9.81)]].concat();
    let frictions = [1, 2, 3].map(|k| (format!("viscous-friction@joint{k}"), 1e-3));
    let truth: Vec<(&str, f64)> =
        truth.iter().copied().chain(frictions.iter().map(|(n, v)| (n.as_str(), *v))).collect();
    let parameters = Motion::new("triple-pendulum", 1.0, &truth);
    let text = library::text("triple-pendulum").unwrap();
    let text = text.replace("l1 = \"m\", ", "").replace("l2 = \"m\", ", "");
    let text = text.replace("\n[points]", "constants = { l1 = 0.2, l2 = 0.17 }\n\n[points]");
    let model = library::read("numbers", &text).and_then(|s| s.model(None, 1.0)).unwrap_or_else(|e| panic!("{e}"));
    for (e, equation) in model.equations.iter().enumerate() {
        let own = |s: &Symbol| *s == Symbol::Acceleration(e);
        for term in &equation.terms {
            let mut constant = false;
            for x in [1.0, 2.0] {
                let at = |s: Symbol| if own(&s) { x } else { 0.0 };
                constant |= term.of.value(&at) != 0.0;
            }
            assert!(!constant, "{} in equation {e}", term.name);
        }
    }
    let numbers = Motion::of(model, 1.0, &truth);
    // What numbers tie together is one coefficient.
    assert!(numbers.coefficients.len() <= parameters.coefficients.len());
    for (q, v, tau) in states(3).take(100) {
        let (a, b) = (parameters.at(&q, &v, tau, &[]), numbers.at(&q, &v, tau, &[]));
        (0..3).for_each(|i| assert!((a[i] - b[i]).abs() < 1e-9 * (1.0 + a[i].abs()), "{a:?} {b:?}"));
    }
}

/// A mistake of each kind, told where it stands.
#[test]
fn mistakes_are_told_with_their_place() {
    let good = library::text("double-pendulum").unwrap();
    let mut wrong = Vec::new();
    for (from, to, place, part) in [
        ("name = \"double pendulum\"\n", "", "line 1, column 1", "no key \"name\""),
        ("phi1 = \"angle\"", "phi1 = angle", "line 3, column 24", ""),
        ("phi2 = \"angle\"", "phi1 = \"angle\"", "line 3, column 33", "the key \"phi1\" a second time"),
        ("gravity = \"down\"", "gravity = \"up\"", "line 4, column 12", "the name \"up\""),
        ("l1 = \"m\"", "l1 = \"m^\"", "line 5, column 58", "the unit \"m^\""),
        ("= \"angle\"", "= \"angel\"", "line 3, column 24", "none of angle, length, m, km"),
        ("= \"angle\"", "= \"angel\"", "line 3, column 24", "Did you mean angle?"),
        ("l1 = \"m\"", "l1 = \"metre\"", "line 5, column 58", "and \"metre\" is none of m, km, cm"),
        ("a_s*sin(tau)]", "a_s*sin(tua)]", "line 8, column 36", "the name \"tua\""),
        ("a_s*sin(tau)]", "a_s*sen(tau)]", "line 8, column 32", "the function \"sen\""),
        ("a_s*sin(tau)]", "a_s*sin(tau)", "line 8, column 9", "a \"[\" without its \"]\""),
        ("base + l1*along(phi1)", "base + l1*phi1", "line 9, column 15", "the sum of a number and a vector"),
        ("base + l1*along(phi1)", "base + along(l1*phi1)", "line 9, column 17", "the parameter l1 inside a function"),
        ("from = \"elbow\"", "from = \"elbo\"", "line 21, column 9", "the name \"elbo\""),
        ("mass = \"m2\"", "mas = \"m2\"", "line 23, column 1", "the key \"mas\""),
        ("mass = \"m2\"\n", "", "line 23, column 12", "a centroid without a mass"),
        ("inertia = \"J_2\"\n", "", "line 21, column 8", "an arm without inertia"),
        ("name = \"joint2\"", "name = \"joint1\"", "line 33, column 8", "\"joint1\" a second time"),
        ("at = \"elbow\"", "at = \"knee\"", "line 34, column 6", "the point \"knee\""),
        ("moves = \"phi2 - phi1\"", "moves = \"phi2'' - phi1\"", "line 35, column 10", "phi2''"),
        ("moves = \"phi2 - phi1\"", "moves = \"m2 - m1\"", "line 35, column 9", "a joint that moves \"m2 - m1\""),
        ("theta2 = \"phi2 - phi1\"", "theta2 = \"phi2'\"", "line 39, column 10", "\"phi2'\""),
        ("m1e1 = \"m1*e1\"", "m1e1 = \"m1*phi1\"", "line 44, column 12", "the name \"phi1\""),
        ("m1e1 = \"m1*e1\"", "m1 = \"m1*e1\"", "line 44, column 1", "the name \"m1\" a second time"),
        ("viscous-friction@joint2", "viscose-friction@joint2", "line 49, column 39", "the nominal effect \"viscose"),
        ("viscous-friction@joint2", "viscous-friction@joint3", "line 49, column 39", "the joint \"joint3\""),
        ("viscous-friction@joint2", "coulomb-friction@joint1", "line 49, column 39", "a second time"),
        ("e2 = \"m\",", "e2 = \"m\", e3 = \"m\",", "line 5, column 84", "the parameter e3, which nothing uses"),
        ("from = \"elbow\"", "from = \"[0, 0, 0]\"", "line 21, column 8", "3 components"),
        ("[nominal]", "[[force]]\ndoes_work_on = \"phi1\"\n\n[nominal]", "line 48, column 1", "no key \"value\""),
    ] {
        let text = good.replacen(from, to, 1);
        assert_ne!(text, good, "{from}");
        let source = Source { text, path: Path::new("s.toml").to_path_buf() };
        let message = super::model_of(source, None, 1.0).map(|_| ()).unwrap_err().to_string();
        let right = message.starts_with(&format!("s.toml: {place}: ")) && message.contains(part);
        if !right || message.contains('\n') {
            wrong.push(format!("{to}: {message}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
