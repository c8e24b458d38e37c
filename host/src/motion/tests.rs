//! Built-in systems in full against their own equations of motion.

use std::collections::BTreeMap;
use std::path::Path;

use super::*;
use crate::model::double_pendulum_dynamics::DoublePendulum;
use crate::model::dynamics::{Dynamics, Instant};
use crate::record::{Column, Record, Segment};

fn rig(model: &str, drive: &str) -> Rig {
    let text = format!(
        "name = \"x\"\nmodel = \"{model}\"\nsample_rate_hz = 500.0\n{drive}\n[[channel]]\nname = \"a\"\nmeasures = \"theta1\"\nunit = \"rad\"\n"
    );
    let second = "[[channel]]\nname = \"b\"\nmeasures = \"theta2\"\nunit = \"rad\"\n";
    let text = if model == "double-pendulum" { text + second } else { text };
    Rig::parse(&text, Path::new("rig.toml")).unwrap()
}

fn parameter(name: &str, value: f64) -> Parameter {
    Parameter { name: name.to_owned(), value, std_error: 1e-4, unit: "1".to_owned() }
}

/// A double pendulum whose coefficients obey no tie, with an effect.
fn double(effects: Vec<AddedEffect>) -> IdentifiedModel {
    let of = [
        ("B11", 0.113),
        ("B12", 0.071),
        ("B13", -0.52),
        ("B14", 0.11),
        ("C11", 0.004),
        ("C12", 0.003),
        ("B21", 1.68),
        ("B22", 0.26),
        ("B23", -0.41),
        ("B24", -0.07),
        ("C2", 0.048),
    ];
    IdentifiedModel {
        name: "x".to_owned(),
        system: System::BuiltIn("double-pendulum".to_owned()),
        method: "explain".to_owned(),
        drive_frequency_hz: Some(5.0),
        nominal: vec!["coulomb-friction@joint1".to_owned(), "viscous-friction@joint2".to_owned()],
        parameters: of.iter().map(|(n, v)| parameter(n, *v)).collect(),
        effects,
        found_with: [("g".to_owned(), 9.81), ("record_s".to_owned(), 40.0)].into(),
    }
}

fn effect(id: &str, at: &str, value: f64, strengths: &[f64], parameters: &[(&str, f64)]) -> AddedEffect {
    AddedEffect {
        id: id.to_owned(),
        at: at.to_owned(),
        value,
        std_error: 0.0,
        unit: String::new(),
        strengths: strengths.to_vec(),
        parameters: parameters.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect::<BTreeMap<_, _>>(),
    }
}

const STATES: [([f64; 2], [f64; 2], f64); 5] = [
    ([0.3, 2.0], [1.5, -4.0], 0.7),
    ([-2.0, 7.0], [-3.0, 20.0], 2.9),
    ([4.1, -5.2], [-11.0, 0.3], -1.2),
    ([0.01, 0.5], [0.2, 0.21], 5.0),
    ([-9.0, 3.3], [14.0, -25.0], 0.1),
];

/// With no effect the double pendulum moves as (3.4) says; what an effect of strength k adds is M⁻¹
/// times its law, told here by hand.
#[test]
fn the_double_pendulum_moves_as_its_own_equations_do() {
    let rig = rig("double-pendulum", "[drive]\ndirection = \"vertical\"\nfrequency_hz = 5.0");
    let dampings: Vec<_> = crate::model::double_pendulum::DAMPINGS
        .iter()
        .filter(|d| ["coulomb-friction@joint1", "viscous-friction@joint2"].contains(&d.id))
        .collect();
    let own = DoublePendulum::new(rig.omega(), true, &dampings);
    // Torques over J_o2 on the arms, for strengths of 1.
    type Law = fn([f64; 2], [f64; 2]) -> [f64; 2];
    let laws: [(AddedEffect, Law); 6] = [
        (effect("viscous-friction", "joint1", 0.0, &[0.4], &[]), |_, v| [-0.4 * v[0], 0.0]),
        (effect("quadratic-drag", "arm2", 0.0, &[0.02], &[]), |_, v| [0.0, -0.02 * v[1] * v[1].abs()]),
        (effect("cubic-stiffness", "joint1", 0.0, &[2.0], &[]), |q, _| [-2.0 * wrapped(q[0]).powi(3), 0.0]),
        (effect("torsion-spring", "joint2", 0.0, &[5.0], &[]), |q, _| {
            let x = wrapped(q[1] - q[0]);
            [5.0 * x, -5.0 * x]
        }),
        (effect("cogging", "joint1", 0.0, &[1.0, -2.0], &[("n", 7.0)]), |q, _| {
            [-(7.0 * q[0]).sin() + 2.0 * (7.0 * q[0]).cos(), 0.0]
        }),
        (effect("stribeck-friction", "joint1", 0.0, &[3.0, 0.0], &[("v_s", 1.3)]), |_, v| {
            [-3.0 * (-(v[0] / 1.3).powi(2)).exp() * v[0].signum(), 0.0]
        }),
    ];
    let none: Law = |_, _| [0.0; 2];
    for (one, law) in std::iter::once((None, none)).chain(laws.into_iter().map(|(e, l)| (Some(e), l))) {
        let model = double(one.into_iter().collect());
        let values: Vec<f64> = own.names().iter().map(|n| model.parameter(n).unwrap().value).collect();
        let b = |n: &str| model.parameter(n).unwrap().value;
        // J_o1/J_o2.
        let inertia = b("B21") / b("B11");
        for m in [Some(&rig), None].map(|r| Motion::of(&model, Path::new("m.toml"), r, 0.0).unwrap()) {
            let name = m.effects.first().map_or_else(String::new, Effect::name);
            let (equations, parameters) = m.equations().unwrap();
            for (q, v, tau) in STATES {
                let at = Instant { time: 7.0, tau, inputs: &[] };
                let (mut wanted, mut got) = ([0.0; 2], [0.0; 2]);
                assert!(own.acceleration(&values, &q, &v, &at, &mut wanted));
                assert!(equations.acceleration(&parameters, &q, &v, &at, &mut got));
                let torque = law(q, v);
                let (t1, t2, c) = (torque[0] / inertia, torque[1], (q[1] - q[0]).cos());
                let (m12, m21) = (b("B11") * c, b("B21") * c);
                let determinant = 1.0 - m12 * m21;
                wanted[0] += (t1 - m12 * t2) / determinant;
                wanted[1] += (t2 - m21 * t1) / determinant;
                for (a, b) in got.iter().zip(wanted) {
                    assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{name}: {got:?} {wanted:?}");
                }
            }
        }
    }
}

fn wrapped(x: f64) -> f64 {
    let tau = core::f64::consts::TAU;
    x - tau * (x / tau + 0.5).floor()
}

#[test]
fn what_has_no_expression_or_belongs_elsewhere_is_refused_with_its_place() {
    let rig = rig("double-pendulum", "[drive]\ndirection = \"vertical\"\nfrequency_hz = 5.0");
    let refusal =
        |e: AddedEffect| Motion::of(&double(vec![e]), Path::new("m.toml"), Some(&rig), 0.0).unwrap_err().to_string();
    assert!(refusal(effect("rust", "joint1", 0.0, &[1.0], &[])).contains("\"rust@joint1\""));
    assert!(refusal(effect("quadratic-drag", "wing", 0.0, &[1.0], &[])).contains("\"quadratic-drag@wing\""));
    assert!(refusal(effect("cogging", "joint1", 0.0, &[1.0], &[("n", 3.0)])).contains("2 strengths"));
    let other = Rig { drive: None, ..rig.clone() };
    let error = Motion::of(&double(Vec::new()), Path::new("m.toml"), Some(&other), 0.0).unwrap_err().to_string();
    assert!(error.starts_with("drive_frequency_hz: found a drive of 5 Hz, expected no drive"), "{error}");
}

#[test]
fn what_acts_on_drive_and_sensors_stands_there() {
    let effects = vec![
        effect("frequency-offset", "drive", 0.01, &[0.01], &[]),
        effect("zero-offset", "encoder2", 0.02, &[0.02], &[]),
        effect("imbalance", "arm2", 0.03, &[0.03], &[]),
    ];
    let motion = Motion::of(&double(effects), Path::new("m.toml"), None, 0.0).unwrap();
    let shown = |sensor: usize| motion.shown(sensor, &Samples { values: &[1.0], start_s: 0.0, step_s: 0.002 })[0];
    assert_eq!(shown(0), 1.0);
    assert!((shown(1) - 1.0 - (0.02 - 0.03)).abs() < 1e-15);
    // After 25 s the drive is a quarter turn ahead.
    let of = |tau: f64, time: f64| {
        let (equations, parameters) = motion.equations().unwrap();
        let mut a = [0.0; 2];
        assert!(equations.acceleration(
            &parameters,
            &[0.3, 0.5],
            &[1.0, 2.0],
            &Instant { time, tau, inputs: &[] },
            &mut a
        ));
        a
    };
    let (ahead, turned) = (of(0.4, 25.0), of(0.4 + core::f64::consts::FRAC_PI_2, 0.0));
    assert!((ahead[0] - turned[0]).abs() < 1e-9 && (ahead[1] - turned[1]).abs() < 1e-9, "{ahead:?} {turned:?}");
}

/// A saved model whose frame leans, or whose arm's centroid is off its line, moves as that says.
#[test]
fn what_a_model_turns_is_turned_by_the_whole_rotation() {
    for (id, at, sign) in [("frame-tilt", "frame", -1.0), ("imbalance", "arm1", 1.0)] {
        for beta in [0.03, -0.3] {
            let model = IdentifiedModel {
                system: System::BuiltIn("single-pendulum".to_owned()),
                drive_frequency_hz: None,
                nominal: vec!["viscous-friction@joint1".to_owned()],
                parameters: vec![parameter("c_r", 0.0), parameter("q_sin", 41.9)],
                found_with: [("record_s".to_owned(), 40.0)].into(),
                ..double(vec![effect(id, at, beta, &[beta], &[])])
            };
            let motion = Motion::of(&model, Path::new("m.toml"), None, 0.0).unwrap();
            let (equations, parameters) = motion.equations().unwrap();
            for (q, v, tau) in STATES {
                let (at, mut got) = (Instant { time: 7.0, tau, inputs: &[] }, [0.0]);
                assert!(equations.acceleration(&parameters, &q[..1], &v[..1], &at, &mut got));
                let wanted = -41.9 * (q[0] + sign * beta).sin();
                assert!((got[0] - wanted).abs() < 1e-9, "{id} {beta}: {got:?} {wanted}");
            }
        }
    }
}

#[test]
fn the_single_pendulum_moves_as_its_own_equation_does() {
    let drive = "[drive]\ndirection = \"horizontal\"\nfrequency_hz = 2.0";
    let rig = rig("single-pendulum", drive);
    let names = ["c_r", "C11", "n_cos", "n_sin", "p_cos", "p_sin", "q_cos", "q_sin"];
    let values = [0.036, 0.01, 0.02, -0.03, -1.52, 0.05, 0.04, 1.44];
    let model = IdentifiedModel {
        system: System::BuiltIn("single-pendulum".to_owned()),
        drive_frequency_hz: Some(2.0),
        nominal: vec!["viscous-friction@joint1".to_owned(), "coulomb-friction@joint1".to_owned()],
        parameters: names.iter().zip(values).map(|(n, v)| parameter(n, v)).collect(),
        found_with: BTreeMap::new(),
        ..double(Vec::new())
    };
    // (2.6), by hand.
    let own = |x: f64, v: f64, tau: f64| {
        let [c_r, c11, n_cos, n_sin, p_cos, p_sin, q_cos, q_sin] = values;
        let (omega, [sin, cos]) = (rig.omega(), [x.sin(), x.cos()]);
        let drive = (n_cos * cos + n_sin * sin) * tau.cos() + (p_cos * cos + p_sin * sin) * tau.sin();
        -omega * c_r * v - omega * omega * (c11 * v.signum() + drive + q_cos * cos + q_sin * sin)
    };
    for motion in [Some(&rig), None].map(|r| Motion::of(&model, Path::new("m.toml"), r, 0.0).unwrap()) {
        let (equations, parameters) = motion.equations().unwrap();
        for (q, v, tau) in STATES {
            let at = Instant { time: 0.0, tau, inputs: &[] };
            let (wanted, mut got) = (own(q[0], v[0], tau), [0.0]);
            assert!(equations.acceleration(&parameters, &q[..1], &v[..1], &at, &mut got));
            assert!((got[0] - wanted).abs() < 1e-10 * (1.0 + wanted.abs()), "{got:?} {wanted:?}");
        }
    }
}

/// A state stands behind the coordinates with the law of its rate; where there is no room for it
/// the effect is refused.
#[test]
fn a_state_of_an_effect_is_followed_or_refused() {
    let rig = rig("double-pendulum", "[drive]\ndirection = \"vertical\"\nfrequency_hz = 5.0");
    let of = |e: AddedEffect| Motion::of(&double(vec![e]), Path::new("m.toml"), Some(&rig), 0.0).unwrap();
    let dahl = of(effect("dahl-friction", "joint1", 3.0, &[3.0], &[("d", 0.1)]));
    let error = dahl.equations().unwrap_err().to_string();
    assert!(error.starts_with("effect 1: found \"dahl-friction@joint1\", which has states of its own"), "{error}");
    let (equations, parameters) = dahl.following().unwrap();
    for (q, v, tau) in STATES {
        let at = Instant { time: 7.0, tau, inputs: &[] };
        let state = equations.with_states(&[q, v].concat(), &[0.4]);
        assert_eq!(state, [q[0], q[1], 0.0, v[0], v[1], 0.4]);
        let mut got = [0.0; 3];
        assert!(equations.acceleration(&parameters, &state[..3], &state[3..], &at, &mut got));
        let rate = (v[0] - v[0].abs() * 0.4) / 0.1;
        // The torque of 3 · 0.4 as that of viscous friction at this rate.
        let viscous = of(effect("viscous-friction", "joint1", 0.0, &[3.0 * 0.4 / v[0]], &[]));
        let (plain, values) = viscous.equations().unwrap();
        let mut wanted = [0.0, 0.0, rate];
        assert!(plain.acceleration(&values, &q, &v, &at, &mut wanted[..2]));
        for (a, b) in got.iter().zip(wanted) {
            assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{got:?} {wanted:?}");
        }
    }
}

/// A record that begins in a motion through a late or eccentric encoder begins in the motion's own
/// state. The encoder shows solutions at half the sampling interval, five of them late: no
/// interpolation makes what is taken off. Off are the shift by 10⁻⁶ of 5 rad, or e⁴ of an
/// eccentricity e = 0.1 rad; of rates that times the record's highest frequencies, some 50 rad/s.
/// A first order in the strengths would miss by d² a/2 and e²/2, 10⁻³ rad and more.
#[test]
fn a_record_through_its_sensors_begins_in_the_motion_s_own_state() {
    let (half_s, late, count) = (0.001, 5_usize, 5000_usize);
    let plain = Motion::of(&double(Vec::new()), Path::new("m.toml"), None, 0.0).unwrap();
    let begin = from_record::Begin {
        time: 0.0,
        tau: 0.0,
        state: vec![0.9, -0.4, 1.0, 2.0],
        inputs: None,
        left_s: 0.0,
        step_s: half_s,
    };
    let fine = simulation::solve(&plain, &begin, 2 * count + late).unwrap().coordinates;
    let own = crate::identify::stretches::mixed(&plain.bound.shown, &fine);
    let (c, s): (f64, f64) = (0.08, -0.06);
    type Shown<'a> = &'a dyn Fn(usize) -> f64;
    let eccentric = |i: usize| own[1][i + late] + c * own[1][i + late].sin() + s * own[1][i + late].cos();
    let cases: [(AddedEffect, Shown<'_>, f64); 2] = [
        (effect("channel-delay", "encoder2", 0.005, &[0.005], &[]), &|i| own[1][i], 5e-6),
        (effect("eccentricity", "encoder2", 0.1, &[c, s], &[]), &eccentric, 1e-4),
    ];
    for (e, shows, off) in cases {
        let motion = Motion::of(&double(vec![e]), Path::new("m.toml"), None, 0.0).unwrap();
        assert!(matches!(motion.effects[0].acts, Acts::Sensor(1, _)));
        let every_second = |of: Shown<'_>| Column::Values((0..count).map(|i| of(2 * i)).collect());
        let start_s = late as f64 * half_s;
        let columns = vec![every_second(&|i| own[0][i + late]), every_second(shows)];
        let record = Record::of("(simulated)", &motion.rig, vec![Segment::new(start_s, 2.0 * half_s, columns)]);
        // Off the record's end, where nothing tells what follows.
        let found = from_record::begin(&motion, &record, Some(start_s + 1.0)).unwrap();
        let at = late + 1000;
        for (k, x) in fine.iter().enumerate() {
            let [a, b, c, d] = [x[at - 2], x[at - 1], x[at + 1], x[at + 2]];
            let rate = (a - 8.0 * b + 8.0 * c - d) / (12.0 * half_s);
            let (dx, dv) = (found.state[k] - x[at], found.state[2 + k] - rate);
            assert!(dx.abs() < off && dv.abs() < 50.0 * off, "{} {k}: {dx:e} {dv:e}", motion.effects[0].name());
        }
    }
}
