//! What a frame that gives way adds, against the simulated one, which was written apart.

use core::f64::consts::TAU;
use std::path::Path;

use whirl_hil_sim::plant_oscillator::{Oscillator, record};
use whirl_hil_sim::plant_yielding_frame::{Frame, YieldingFrame, rig};

use std::sync::Arc;

use super::*;
use crate::effects::catalogue;
use crate::effects::columns::{Action, Span, action, columns, quotients};
use crate::effects::entry::read;
use crate::effects::places::Place;
use crate::model::model_file::expression::Expression;
use crate::model::model_file::memory::{Course, Memory};
use crate::model::model_file::toml_place::Source;
use crate::system::library;

const SPAN: Span = Span { start_s: 0.0, length_s: 40.0 };
const STEP_S: f64 = 5e-4;

fn mechanism(system: &str, omega: f64) -> Mechanism {
    let model = library::read(system, library::text(system).unwrap()).unwrap().model(Some(&[]), omega).unwrap();
    (*model.mechanism.unwrap()).clone()
}

/// Parameters of the shipped double pendulum from the plant's.
fn values(m: &Mechanism, plant: &YieldingFrame) -> Vec<f64> {
    let [a1, a2] = plant.arms;
    let of = |name: &str| match name {
        "m1" => a1.mass,
        "e1" => a1.centroid,
        "J_1" => a1.inertia + a1.mass * a1.centroid.powi(2),
        "l1" => plant.l1,
        "m2" => a2.mass,
        "e2" => a2.centroid,
        "J_2" => a2.inertia + a2.mass * a2.centroid.powi(2),
        "a_c" => plant.drive[0],
        "g" => plant.g,
        _ => 0.0,
    };
    m.parameters.iter().map(|p| of(&p.name)).collect()
}

/// Along the plant's own motion, with the states followed along its samples, the columns are
/// (∂P/∂φ_e′)·n s″/J_e: what the frame's acceleration does to each arm.
#[test]
fn the_columns_are_what_the_simulated_frame_does() {
    for (direction, frequency_hz) in [(0.0, 3.0), (0.6, 7.0), (0.25 * TAU, 4.0)] {
        let frame = Frame { mass: 0.9, frequency_hz, damping: 0.06, direction };
        let plant = rig(Some(frame));
        let omega = plant.drive[1];
        let mechanism = mechanism("double-pendulum", omega);
        let parameters = values(&mechanism, &plant);
        let rest = -9.81 * 0.1762 * direction.sin() / (0.9 * (TAU * frequency_hz).powi(2));
        // The drive's own part of the momentum is none of the arms': it is left out of both.
        let plant = YieldingFrame { drive: [0.0, omega], ..plant };
        let motion = record(&plant, [2.4, 1.0, rest, 0.0, 0.0, 0.0], STEP_S, 4000).unwrap();
        let of = |k: usize| motion.iter().map(|y| y[k]).collect::<Vec<f64>>();
        let course = Course::new(vec![of(0), of(1)], vec![of(3), of(4)], STEP_S, vec![true; 2]);

        let entry = catalogue().iter().find(|e| e.id == "resonator").unwrap();
        let form: Form = vec![("f".into(), frequency_hz), ("angle".into(), direction), ("zeta".into(), 0.06)];
        let found = action(entry, &form, Place::Frame, &mechanism, &parameters, omega, SPAN).unwrap().unwrap();
        let memories = std::cell::RefCell::new(Vec::<Arc<Memory>>::new());
        let numbered = found.with_memories(&|memory, k| {
            let mut all = memories.borrow_mut();
            let at = all.iter().position(|m| m == memory).unwrap_or_else(|| {
                all.push(memory.clone());
                all.len() - 1
            });
            Arc::new(Expression::Symbol(Symbol::Memory(2 * at + k)))
        });
        let states: Vec<Vec<f64>> = memories.borrow().iter().flat_map(|m| m.follow(&course).unwrap()).collect();
        assert_eq!(states.len(), 2);
        let Action::Force(parts) = numbered else { panic!("no force") };
        let column = columns(&parts, 3, &mechanism, &parameters).remove(0);
        let [a1, a2] = plant.arms;
        let moments = [a1.mass * a1.centroid + a2.mass * plant.l1, a2.mass * a2.centroid];
        let inertias = [
            a1.inertia + a1.mass * a1.centroid.powi(2) + a2.mass * plant.l1.powi(2),
            a2.inertia + a2.mass * a2.centroid.powi(2),
        ];
        let (mut worst, mut size) = (0.0_f64, 0.0_f64);
        for i in (0..4000).step_by(7) {
            let y = &motion[i];
            let rate = plant.rate(i as f64 * STEP_S, y);
            for (e, of) in &column {
                let got = of.value(&|s| match s {
                    Symbol::Coordinate(k) => y[k],
                    Symbol::Rate(k) => y[3 + k],
                    Symbol::Acceleration(k) => rate[3 + k],
                    Symbol::Memory(k) => states[k][i],
                    other => panic!("{other:?}"),
                }) / frame.mass;
                let lever = moments[*e] * (y[*e] - direction).cos();
                let wanted = lever * rate[5] / inertias[*e];
                worst = worst.max((got - wanted).abs());
                size = size.max(wanted.abs());
            }
        }
        assert!(size > 5.0 && worst < 2e-4 * size, "{direction} {frequency_hz}: {worst} of {size}");
    }
}

/// What stands in front of the terms is fixed but for one common mass: first moments and inertias.
#[test]
fn its_strength_rests_on_ratios_of_first_moments_and_inertias() {
    let mechanism = mechanism("double-pendulum", 31.4);
    let parameters = values(&mechanism, &rig(None));
    let entry = catalogue().iter().find(|e| e.id == "resonator").unwrap();
    let form = entry.forms().remove(0);
    let Some(Action::Force(parts)) = action(entry, &form, Place::Frame, &mechanism, &parameters, 31.4, SPAN).unwrap()
    else {
        panic!("no force")
    };
    let all = quotients(&parts, &mechanism);
    assert!(!all.is_empty() && all.iter().all(|(n, d)| !is_number(n, d)));
    // Masses ten times greater, and inertias with them.
    let heavier: Vec<f64> = mechanism
        .parameters
        .iter()
        .zip(&parameters)
        .map(|(p, x)| if p.name.starts_with(['m', 'J']) { 10.0 * x } else { *x })
        .collect();
    // Mass moved from the first arm to the second: what no motion shows.
    let of = |n: &str| mechanism.parameters.iter().position(|p| p.name == n).unwrap();
    let (mut other, more) = (parameters.clone(), 0.1 * parameters[of("m2")]);
    other[of("m2")] += more;
    other[of("e2")] /= 1.1;
    other[of("e1")] -= more * parameters[of("l1")] / parameters[of("m1")];
    other[of("J_1")] -= more * parameters[of("l1")].powi(2);
    for (n, d) in &all {
        let at = |v: &[f64]| crate::system::mechanism::at(n, v) / crate::system::mechanism::at(d, v);
        let wanted = at(&parameters);
        for v in [&heavier, &other] {
            assert!((at(v) / wanted - 1.0).abs() < 1e-12, "{n:?} over {d:?}");
        }
    }
}

#[test]
fn mistakes_in_a_law_are_told_with_their_line() {
    let head = "[[effect]]\nid = \"m\"\nat = \"frame\"\nstrengths = [\"A\"]\n";
    for (rest, line, told) in [
        ("moves = \"A*z\"\nstates = { z = \"p_up - z\" }", 5, "Multiply by right or up"),
        ("moves = \"A*right\"", 5, "one state as a factor"),
        ("moves = \"A*z*z*right\"\nstates = { z = \"p_up - z\" }", 5, "one state as a factor"),
        ("moves = \"A*z*right\"\nstates = { z = \"p_up*z\" }", 5, "for z"),
        ("moves = \"A*z*right\"\nstates = { z = \"p_up - x\" }", 6, "x"),
        ("moves = \"A*z*right\"\nstates = { z = \"p_up\", y = \"p_up\" }", 6, "does not use"),
        ("turns = \"A*p_up\"", 5, "p_up"),
    ] {
        let source = Source { text: format!("{head}{rest}\n"), path: Path::new("m.toml").to_path_buf() };
        let error = read(&source).unwrap_err().to_string();
        assert!(error.contains(told) && error.contains(&format!("line {line}")), "{rest}: {error}");
    }
}

/// Nothing is known of what written equations or an energy written out would have on a frame.
#[test]
fn it_has_a_place_where_everything_is_told() {
    let has = |system: &str| mechanism(system, 31.4).file.as_deref().is_some_and(carries);
    for system in ["double-pendulum", "double-pendulum-free", "single-pendulum", "cart-pendulum", "triple-pendulum"] {
        assert!(has(system), "{system}");
    }
}
