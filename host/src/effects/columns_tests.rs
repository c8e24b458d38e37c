//! Columns of the catalogue against the simulated rig, which was written apart: what an effect does
//! to the accelerations of a double pendulum, its base at rest and moving.

use core::f64::consts::{PI, TAU};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use whirl_hil_sim::Effect;
use whirl_hil_sim::Parameters;
use whirl_hil_sim::plant::effects::combine;
use whirl_hil_sim::plant::{Plant, TOLERANCE};
use whirl_hil_sim::shaker::{BaseMotion, Command, Shaker, phase_increment};

use super::*;
use crate::effects::catalogue;
use crate::model::model_file::toml_place::Source;
use crate::system::library;

const OMEGA: f64 = 31.4;
const SPAN: Span = Span { start_s: 2.0, length_s: 40.0 };
/// Time over which velocities are differenced, s.
const SHORT_S: f64 = 1e-6;

/// Effect on the rig, the strengths that it has in the catalogue.
const EFFECTS: [(&str, &[f64]); 34] = [
    ("viscous-friction@joint1=1e-4", &[1e-4]),
    ("coulomb-friction@joint2=1e-4", &[1e-4]),
    ("stribeck-friction@joint1=1e-3,v_s=3", &[1e-3]),
    ("quadratic-drag@arm1=1e-4", &[1e-4]),
    ("quadratic-drag@arm2=1e-5", &[1e-5]),
    ("load-dependent-friction@joint1=1e-4", &[1e-4]),
    ("load-dependent-friction@joint2=1e-4", &[1e-4]),
    ("constant-force@joint2=1e-3", &[1e-3]),
    ("asymmetric-friction@joint1=2e-3", &[2e-3]),
    ("torsion-spring@joint2=1e-3", &[1e-3]),
    ("cubic-stiffness@joint1=1e-3", &[1e-3]),
    ("quadratic-stiffness@joint2=1e-4", &[1e-4]),
    ("quintic-stiffness@joint1=1e-4", &[1e-4]),
    ("friction-ripple@joint1=2e-3,n=7,psi=0.4", &[2e-3 * 0.921_060_994_002_885, 2e-3 * 0.389_418_342_308_650_5]),
    ("backlash@joint2=0.5,k=1e-2", &[1e-2]),
    ("cogging@joint1=2e-3,n=7,psi=0.4", &[2e-3 * 0.921_060_994_002_885, 2e-3 * 0.389_418_342_308_650_5]),
    ("amplitude-dependent-damping@joint1=1e-4", &[1e-4]),
    ("amplitude-dependent-damping@joint2=1e-5", &[1e-5]),
    ("imbalance@arm1=1e-4", &[1e-4]),
    ("imbalance@arm2=1e-4", &[1e-4]),
    ("imbalance@arm1=0.03", &[0.03]),
    ("imbalance@arm1=0.3", &[0.3]),
    ("imbalance@arm2=-0.3", &[-0.3]),
    ("frame-tilt@frame=1e-4", &[1e-4]),
    ("frame-tilt@frame=0.03", &[0.03]),
    ("frame-tilt@frame=-0.3", &[-0.3]),
    ("friction-drift@joint2=1e-3", &[1e-3]),
    ("power-law-damping@joint1=1e-4,p=1.5", &[1e-4]),
    ("power-law-damping@joint2=1e-5,p=0.5", &[1e-5]),
    ("stiffness-modulation@joint1=2e-3,psi=0.4", &[2e-3 * 0.921_060_994_002_885, 2e-3 * 0.389_418_342_308_650_5]),
    ("local-force@joint1=2e-3,x0=-2.9,d=0.3", &[2e-3]),
    ("local-force@joint2=1e-3,x0=0.4,d=0.5", &[1e-3]),
    ("distributed-drag@arm1=0.2,length=0.06", &[0.2]),
    ("distributed-drag@arm2=0.02,length=0.05", &[0.02]),
];

/// A motion of the base as both sides have it.
struct Base {
    motion: BaseMotion,
    /// a_c and a_s of the shipped system.
    amplitudes: [f64; 2],
    tau: f64,
    time_s: f64,
}

impl Base {
    /// At rest, at the record's beginning.
    fn at_rest() -> Self {
        Self { motion: BaseMotion::REST, amplitudes: [0.0; 2], tau: 0.0, time_s: SPAN.start_s }
    }

    /// Three eighths of a period into a motion of 15.5 mm, a quarter into the record.
    fn that_moves() -> Self {
        let (rate_hz, nanometre, psi, passed_s) = (500.0, 15_500_000, 0.25_f64, 0.25 * SPAN.length_s);
        let command = Command {
            phase: 3 << 29,
            phase_increment: phase_increment(OMEGA / TAU, rate_hz).unwrap(),
            amplitude_nanometre: [nanometre; 2],
            ..Command::default()
        };
        let shaker = Shaker { psi, record_s: SPAN.length_s, ..Shaker::default() };
        let a = 1e-9 * f64::from(nanometre);
        Self {
            motion: shaker.motion(command, passed_s, 1.0 / rate_hz),
            amplitudes: [a * psi.cos(), a * psi.sin()],
            tau: 0.75 * PI,
            time_s: SPAN.start_s + passed_s,
        }
    }
}

/// The shipped system with the rig's parameters and the drive's amplitudes.
fn mechanism(p: &Parameters, [a_c, a_s]: [f64; 2]) -> (std::sync::Arc<Mechanism>, Vec<f64>) {
    let text = library::text("double-pendulum").unwrap();
    let model = library::read("double-pendulum", text).unwrap().model(Some(&[]), OMEGA).unwrap();
    let mechanism = model.mechanism.unwrap();
    let of = |n: &str| match n {
        "m1" => p.m1,
        "e1" => p.e1,
        "J_1" => p.j_o1 - p.m2 * p.l1 * p.l1,
        "l1" => p.l1,
        "m2" => p.m2,
        "e2" => p.e2,
        "J_2" => p.j_o2,
        "a_c" => a_c,
        "a_s" => a_s,
        "g" => p.g,
        other => panic!("{other}"),
    };
    let values = mechanism.file.as_ref().unwrap().parameters.iter().map(|p| of(&p.name)).collect();
    (mechanism, values)
}

/// Angular accelerations of the rig at a state.
fn accelerations(p: &Parameters, effects: &[Effect], state: [f64; 4], base: &BaseMotion) -> [f64; 2] {
    let mut plant = Plant::new(p, &combine(effects).unwrap(), state, TOLERANCE).unwrap();
    plant.advance(base, SHORT_S).unwrap();
    let after = plant.state();
    [0, 1].map(|i: usize| (after[2 + i] - state[2 + i]) / SHORT_S)
}

fn place(name: &str) -> Place {
    match name {
        "joint1" => Place::Joint(0),
        "joint2" => Place::Joint(1),
        "arm1" => Place::Arm(0),
        "arm2" => Place::Arm(1),
        _ => Place::Frame,
    }
}

#[test]
fn effects_move_the_pendulum_as_they_move_the_simulated_rig() {
    agree(&Base::at_rest());
}

#[test]
fn effects_move_the_pendulum_as_they_move_the_simulated_rig_on_a_base_that_moves() {
    agree(&Base::that_moves());
}

/// Every effect against the rig on random states.
fn agree(base: &Base) {
    let p = Parameters { tau_c1: 0.0, c_r2: 0.0, ..Parameters::PRINTED };
    let (mechanism, values) = mechanism(&p, base.amplitudes);
    for (text, strengths) in EFFECTS {
        let effect = Effect::parse(text).unwrap();
        let (name, rest) = text.split_once('=').unwrap();
        let (id, at) = name.split_once('@').unwrap();
        let entry = catalogue().iter().find(|e| e.id == id).unwrap();
        let told = |n: &str| -> f64 {
            if entry.value.as_deref() == Some(n) {
                return rest.split(',').next().unwrap().parse().unwrap();
            }
            rest.split(',').find_map(|t| t.strip_prefix(&format!("{n}="))).unwrap().parse().unwrap()
        };
        let form: Form = entry.shapes.iter().map(|s| (s.name.clone(), told(&s.name))).collect();
        let known = entry.about(strengths);
        let action = action(&known, &form, place(at), &mechanism, &values, OMEGA, SPAN).unwrap();
        let Some(Action::Force(parts)) = action else { panic!("{text}") };
        let columns = columns(&parts, strengths.len(), &mechanism, &values);
        // A ripple takes from a level that is there.
        let plant = Parameters { tau_c1: if id == "friction-ripple" { 4e-3 } else { 0.0 }, ..p };
        let mut random = ChaCha8Rng::seed_from_u64(7);
        for _ in 0..200 {
            let mut any = |size: f64| size * (2.0 * random.random::<f64>() - 1.0);
            let state = [any(9.0), any(9.0), any(20.0), any(20.0)];
            // Where a law jumps within the short time nothing is compared.
            if state[2].abs() < 0.01 || (state[3] - state[2]).abs() < 0.01 {
                continue;
            }
            let without = accelerations(&plant, &[], state, &base.motion);
            let with = accelerations(&plant, std::slice::from_ref(&effect), state, &base.motion);
            let mut left = [0.0; 2];
            for (k, column) in columns.iter().enumerate() {
                for (e, of) in column {
                    left[*e] += strengths[k]
                        * of.value(&|s| match s {
                            Symbol::Coordinate(i) => state[i],
                            Symbol::Rate(i) => state[2 + i],
                            Symbol::Acceleration(i) => with[i],
                            Symbol::Tau => base.tau,
                            Symbol::Time => base.time_s,
                            _ => 0.0,
                        });
                }
            }
            // The equations are divided by their own inertias.
            let coupling = p.m2 * p.e2 * p.l1 * (state[1] - state[0]).cos();
            let (m12, m21) = (coupling / p.j_o1, coupling / p.j_o2);
            let determinant = 1.0 - m12 * m21;
            let wanted = [-(left[0] - m12 * left[1]) / determinant, -(left[1] - m21 * left[0]) / determinant];
            for i in 0..2 {
                let got = with[i] - without[i];
                assert!(
                    (got - wanted[i]).abs() < 2e-3 * wanted[i].abs() + 2e-3,
                    "{text} at {state:?}, arm {}: {got} {}",
                    i + 1,
                    wanted[i]
                );
            }
        }
    }
}

/// A load is a load over an inertia: what lacks a mass is said to rest on it.
#[test]
fn a_load_rests_on_masses_and_lengths() {
    let (mechanism, p) = mechanism(&Parameters::PRINTED, [0.0; 2]);
    let entry = catalogue().iter().find(|e| e.id == "load-dependent-friction").unwrap();
    let names: Vec<&str> = mechanism.parameters.iter().map(|n| n.name.as_str()).collect();
    for (joint, wanted) in [(1, vec!["l1", "m2", "e2", "a_c", "a_s", "g"]), (0, vec!["m1", "e1", "l1", "m2", "e2"])] {
        let found = action(entry, &Vec::new(), Place::Joint(joint), &mechanism, &p, OMEGA, SPAN).unwrap();
        let Some(Action::Force(parts)) = found else { panic!("joint {joint}") };
        let quotients = quotients(&parts, &mechanism);
        let holds = |name: &str| {
            let at = names.iter().position(|n| *n == name).unwrap();
            quotients.iter().any(|(n, _)| n.any(&|a| *a == Atom::Parameter(at)))
        };
        assert!(wanted.iter().all(|n| holds(n)), "joint {joint}: {quotients:?}");
        assert_eq!(holds("m1"), joint == 0);
        // Torques act on the equations of both sides.
        assert_eq!(parts.len(), joint + 1);
    }
    assert!(entry.names(LOAD) && !entry.names("loa") && !catalogue()[0].names(LOAD));
}

/// Drag along an arm rests on what moves its end: the drive, and for the second arm the length of
/// the first.
#[test]
fn drag_along_an_arm_rests_on_what_moves_its_end() {
    let (mechanism, p) = mechanism(&Parameters::PRINTED, [0.0155, 0.004]);
    let entry = catalogue().iter().find(|e| e.id == "distributed-drag").unwrap();
    let form: Form = vec![("length".to_owned(), 0.055)];
    for (arm, wanted, others) in [(0, vec!["a_c", "a_s"], vec!["l1"]), (1, vec!["a_c", "a_s", "l1"], vec![])] {
        let found = action(entry, &form, Place::Arm(arm), &mechanism, &p, OMEGA, SPAN).unwrap();
        let Some(Action::Force(parts)) = found else { panic!("arm {arm}") };
        let quotients = quotients(&parts, &mechanism);
        let holds = |name: &&str| {
            let at = mechanism.parameters.iter().position(|n| n.name == *name).unwrap();
            quotients.iter().any(|(n, _)| n.any(&|a| *a == Atom::Parameter(at)))
        };
        assert!(wanted.iter().all(holds) && !others.iter().any(holds), "arm {arm}: {quotients:?}");
        // Its work on the first arm as well.
        assert_eq!(parts.iter().map(|p| p.equation).max(), Some(arm));
        assert!(parts.iter().any(|p| p.equation == 0));
    }
}

/// Where its end rests, the speed along an arm is ω s and drag all along it that of ω |ω|.
#[test]
fn the_end_of_the_first_arm_moves_under_a_drive_only() {
    for (name, wanted) in [("double-pendulum", [true, true]), ("double-pendulum-free", [false, true])] {
        let model = library::read(name, library::text(name).unwrap()).unwrap().model(Some(&[]), OMEGA).unwrap();
        let mechanism = model.mechanism.unwrap();
        let file = mechanism.file.as_deref().unwrap();
        assert_eq!([0, 1].map(|k| along_an_arm::end_moves(file, k)), wanted, "{name}");
    }
}

/// The first arm reaches to the elbow, the second is a rod of its period.
#[test]
fn lengths_of_arms_follow_from_the_parameters() {
    let rig = Parameters::PRINTED;
    let (mechanism, p) = mechanism(&rig, [0.0; 2]);
    let file = mechanism.file.as_deref().unwrap();
    let length = |k: usize| along_an_arm::length(file, k, &p).unwrap();
    assert!((length(0) - rig.l1).abs() < 1e-12);
    assert!((length(1) - 1.5 * rig.j_o2 / (rig.m2 * rig.e2)).abs() < 1e-12, "{}", length(1));
}

/// A force of load and state is the load's own times the state, whose law is that of its place.
#[test]
fn a_state_multiplies_what_stands_beside_it() {
    let (mechanism, p) = mechanism(&Parameters::PRINTED, [0.0; 2]);
    let read = |law: &str| {
        let head = "[[effect]]\nid = \"m\"\nat = \"joint\"\nstrengths = [\"mu\"]\nshape = { d = { grid = [0.2], within = [0.1, 1.0] } }\n";
        let path = std::path::Path::new("m.toml").to_path_buf();
        crate::effects::entry::read(&Source { text: format!("{head}{law}\n"), path }).unwrap().remove(0)
    };
    let of = |entry: &Entry| {
        let form = entry.forms().remove(0);
        let found = action(entry, &form, Place::Joint(1), &mechanism, &p, OMEGA, SPAN).unwrap().unwrap();
        let numbered = found.with_memories(&|memory, k| {
            let rate = memory.rates()[k].value(&|s| match s {
                Symbol::Rate(i) => [0.5, -1.5][i],
                Symbol::State(_) => 0.25,
                _ => f64::NAN,
            });
            assert!((rate - (-2.0 - 2.0 * 0.25) / 0.2).abs() < 1e-12, "{rate}");
            number(0.25)
        });
        let Action::Force(parts) = numbered else { panic!("{}", entry.law) };
        columns(&parts, 1, &mechanism, &p).remove(0)
    };
    let with = of(&read("force = \"-mu*load*z\"\nstates = { z = \"(v - abs(v)*z)/d\" }"));
    let without = of(&read("force = \"-mu*load*d\""));
    assert_eq!(with.len(), 2);
    for ((e, with), (_, without)) in with.iter().zip(&without) {
        let value = |n: &Node| n.value(&|s| if let Symbol::Acceleration(i) = s { 3.0 - i as f64 } else { 0.7 });
        let (with, wanted) = (value(with), value(without) * 0.25 / 0.2);
        assert!(wanted != 0.0 && (with - wanted).abs() < 1e-12 * wanted.abs(), "equation {e}: {with} {wanted}");
    }
}

/// A rotor that hangs on nothing turns as well: drag at 50 times the load's rate is 50³ of its own.
#[test]
fn a_body_that_only_turns_is_an_arm() {
    let text = library::text("geared-motor").unwrap();
    let model = library::read("geared-motor", text).unwrap().model(None, OMEGA).unwrap();
    let mechanism = model.mechanism.as_deref().unwrap();
    let drag = catalogue().iter().find(|e| e.id == "quadratic-drag").unwrap();
    let p = vec![1.0; mechanism.parameters.len()];
    let value = |body: usize| {
        let found = action(drag, &Vec::new(), Place::Arm(body), mechanism, &p, OMEGA, SPAN).unwrap().unwrap();
        let Action::Force(parts) = found else { panic!("{}", drag.law) };
        columns(&parts, 1, mechanism, &p)[0][0].1.value(&|s| if s == Symbol::Rate(0) { -0.3 } else { f64::NAN })
    };
    assert!((value(1) / value(0) / 125_000.0 - 1.0).abs() < 1e-12 && value(0) != 0.0, "{} {}", value(0), value(1));
}
