//! Columns of the catalogue against those of the built-in double pendulum, effect by effect, on random states.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::effects::{catalogue, places};
use crate::explain::effects::{Action as BuiltIn, Context, EFFECTS, Place as BuiltInPlace, Scale};
use crate::model::weak::Sample;
use crate::system::library;

const OMEGA: f64 = 31.4;
const SPAN: Span = Span { start_s: 2.0, length_s: 40.0 };

fn mechanism() -> (std::sync::Arc<Mechanism>, Vec<f64>) {
    let text = library::text("double-pendulum").unwrap();
    let model = library::read("double-pendulum", text).unwrap().model(Some(&[]), OMEGA).unwrap();
    let mechanism = model.mechanism.unwrap();
    let of = |n: &str| match n {
        "m1" => 0.1362,
        "e1" => 0.0127,
        "J_1" => 4.4e-4,
        "l1" => 0.0635,
        "m2" => 0.04,
        "e2" => 0.0267,
        "J_2" => 4.033e-5,
        "a_c" => 0.0155,
        "a_s" => -0.004,
        "g" => 9.81,
        other => panic!("{other}"),
    };
    let p = mechanism.file.as_ref().unwrap().parameters.iter().map(|p| of(&p.name)).collect();
    (mechanism, p)
}

/// The built-in context of the same pendulum.
fn context() -> Context {
    let (j1, j2) = (4.4e-4 + 0.04 * 0.0635 * 0.0635, 4.033e-5);
    let s = [0.1362 * 0.0127 + 0.04 * 0.0635, 0.04 * 0.0267];
    let coupling = 0.04 * 0.0267 * 0.0635;
    let row = |s: f64, j: f64| {
        let per = s / j;
        // y = a_c cos τ + a_s sin τ.
        [coupling / j, 9.81 * per / OMEGA.powi(2), -per * 0.0155, per * 0.004]
    };
    let known = [("J_o2", j2), ("m1e1", 0.1362 * 0.0127), ("m2", 0.04), ("l1", 0.0635), ("e2", 0.0267)];
    Context {
        omega: OMEGA,
        driven: true,
        b: [row(s[0], j1), row(s[1], j2)],
        g: 9.81,
        known: known.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect::<BTreeMap<_, _>>(),
        relative: true,
        span_s: [SPAN.start_s, SPAN.length_s],
    }
}

fn sample(r: &mut ChaCha8Rng) -> (Sample, f64) {
    let mut any = |size: f64| size * (2.0 * r.random::<f64>() - 1.0);
    let (phi, rate, tau) = ([any(9.0), any(9.0)], [any(20.0), any(20.0)], any(3.0));
    let time = 22.0 + any(20.0);
    let s = Sample {
        raw: phi,
        phi,
        rate,
        clear_rate: rate,
        clear_step: [0.0; 2],
        turn: [0.0; 2],
        accel: [any(200.0), any(200.0)],
        sin: phi.map(f64::sin),
        cos: phi.map(f64::cos),
        sin_tau: tau.sin(),
        cos_tau: tau.cos(),
        time,
    };
    (s, tau)
}

#[test]
fn forces_agree_with_the_built_in_ones_on_random_states() {
    let (mechanism, p) = mechanism();
    let file = mechanism.file.clone().unwrap();
    let c = context();
    let of = |place: BuiltInPlace| match place {
        BuiltInPlace::Joint1 => Place::Joint(0),
        BuiltInPlace::Joint2 => Place::Joint(1),
        BuiltInPlace::Arm1 => Place::Arm(0),
        BuiltInPlace::Arm2 => Place::Arm(1),
        BuiltInPlace::Frame => Place::Frame,
        _ => Place::Drive,
    };
    let mut compared = 0;
    for effect in EFFECTS {
        let Some(entry) = catalogue().iter().find(|e| e.id == effect.id) else { continue };
        // The built-in drift leaves the derivatives of t/T out.
        if effect.id == "amplitude-drift" {
            continue;
        }
        for &at in effect.places {
            for variant in (effect.variants)(&c, at) {
                let BuiltIn::Force(series) = &variant.action else { continue };
                let form: Form = variant.shape.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect();
                let action = action(entry, &form, of(at), &mechanism, &p, (OMEGA, SPAN)).unwrap();
                let Some(Action::Force(parts)) = action else { panic!("{}@{}", effect.id, at.name()) };
                let own = columns(&parts, entry.strengths.len(), &mechanism, &p);
                // Strengths of the built-in are torques over J_o2; its equations are over Ω².
                let per = if variant.scale == Scale::Torque { 4.033e-5 } else { 1.0 };
                let told = if let Scale::Plain(f) = variant.scale { f } else { 1.0 };
                let mut random = ChaCha8Rng::seed_from_u64(7);
                for _ in 0..1000 {
                    let (s, tau) = sample(&mut random);
                    for (k, pair) in series.iter().enumerate() {
                        for (e, f) in pair.iter().enumerate() {
                            let wanted = f.as_ref().map_or(0.0, |f| f(&s)) * OMEGA.powi(2) / per / told;
                            let got = own[k].iter().find(|x| x.0 == e).map_or(0.0, |(_, of)| {
                                of.value(&|x| match x {
                                    Symbol::Coordinate(i) => s.phi[i],
                                    Symbol::Rate(i) => s.rate[i],
                                    Symbol::Acceleration(i) => s.accel[i],
                                    Symbol::Tau => tau,
                                    _ => s.time,
                                })
                            });
                            let size = 1e-9 + wanted.abs();
                            assert!(
                                (got - wanted).abs() < 1e-9 * size.max(1.0),
                                "{}@{} {form:?} strength {k} equation {e}: {got} {wanted}",
                                effect.id,
                                at.name()
                            );
                        }
                    }
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 150_000, "{compared}");
    assert!(places::drive(&file).is_some());
}

/// A load is a load over an inertia: what lacks a mass is said to rest on it.
#[test]
fn a_load_rests_on_masses_and_lengths() {
    let (mechanism, p) = mechanism();
    let entry = catalogue().iter().find(|e| e.id == "load-dependent-friction").unwrap();
    let names: Vec<&str> = mechanism.parameters.iter().map(|n| n.name.as_str()).collect();
    for (joint, wanted) in [(1, vec!["l1", "m2", "e2", "a_c", "a_s", "g"]), (0, vec!["m1", "e1", "l1", "m2", "e2"])] {
        let found = action(entry, &Vec::new(), Place::Joint(joint), &mechanism, &p, (OMEGA, SPAN)).unwrap();
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

/// The value of a column in an equation.
fn column_at(column: &[(usize, Node)], equation: usize, s: &Sample, tau: f64) -> f64 {
    let of = |x: Symbol| match x {
        Symbol::Coordinate(i) => s.phi[i],
        Symbol::Rate(i) => s.rate[i],
        Symbol::Acceleration(i) => s.accel[i],
        Symbol::Tau => tau,
        _ => s.time,
    };
    column.iter().find(|c| c.0 == equation).map_or(0.0, |(_, law)| law.value(&of))
}

/// Laws of one line at joint 2, written a second time, on both equations.
#[test]
fn laws_of_a_joint_are_those_of_the_table() {
    let (mechanism, p) = mechanism();
    let wrap = |x: f64| x - core::f64::consts::TAU * (x / core::f64::consts::TAU + 0.5).floor();
    type Law = fn(f64, f64, f64, f64) -> f64;
    let table: [(&str, &[(&str, f64)], &[Law]); 4] = [
        ("friction-drift", &[], &[|_, v, _, share| -share * v.signum()]),
        ("power-law-damping", &[("p", 1.5)], &[|_, v, _, _| -v.abs().powf(1.5) * v.signum()]),
        ("power-law-damping", &[("p", 3.0)], &[|_, v, _, _| -v * v * v]),
        ("stiffness-modulation", &[], &[|x, _, tau, _| -tau.cos() * x, |x, _, tau, _| -tau.sin() * x]),
    ];
    let (j1, j2) = (4.4e-4 + 0.04 * 0.0635 * 0.0635, 4.033e-5);
    for (id, form, laws) in table {
        let entry = catalogue().iter().find(|e| e.id == id).unwrap();
        let form: Form = form.iter().map(|(n, x)| ((*n).to_owned(), *x)).collect();
        let found = action(entry, &form, Place::Joint(1), &mechanism, &p, (OMEGA, SPAN)).unwrap();
        let Some(Action::Force(parts)) = found else { panic!("{id}") };
        let own = columns(&parts, laws.len(), &mechanism, &p);
        let mut random = ChaCha8Rng::seed_from_u64(11);
        for _ in 0..300 {
            let (s, tau) = sample(&mut random);
            let (x, v) = (wrap(s.phi[1] - s.phi[0]), s.rate[1] - s.rate[0]);
            for (column, law) in own.iter().zip(laws) {
                let force = law(x, v, tau, (s.time - SPAN.start_s) / SPAN.length_s);
                // A torque in the joint acts on both arms, on the left-hand sides.
                for (e, wanted) in [(0, force / j1), (1, -force / j2)] {
                    let got = column_at(column, e, &s, tau);
                    assert!((got - wanted).abs() < 1e-9 * (1.0 + wanted.abs()), "{id} {e}: {got} {wanted}");
                }
            }
        }
    }
}

/// Drag along the second arm against the sum over many short pieces of it; exact where the air meets all of it from one side.
#[test]
fn drag_along_an_arm_is_the_sum_over_its_pieces() {
    const PIECES: u32 = 4000;
    let (mechanism, p) = mechanism();
    let entry = catalogue().iter().find(|e| e.id == "distributed-drag").unwrap();
    let (j, length) = ([4.4e-4 + 0.04 * 0.0635 * 0.0635, 4.033e-5], 0.055);
    for arm in [0, 1] {
        let form: Form = vec![("length".to_owned(), length)];
        let found = action(entry, &form, Place::Arm(arm), &mechanism, &p, (OMEGA, SPAN)).unwrap();
        let Some(Action::Force(parts)) = found else { panic!("arm {arm}") };
        let own = columns(&parts, 1, &mechanism, &p);
        // The speeds rest on the base's motion and, for the second arm, on the first one's length.
        let l1 = mechanism.parameters.iter().position(|n| n.name == "l1").unwrap();
        let rests = quotients(&parts, &mechanism).iter().any(|(n, _)| n.any(&|a| *a == Atom::Parameter(l1)));
        assert_eq!(rests, arm == 1);
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for _ in 0..200 {
            let (s, tau) = sample(&mut random);
            let base = OMEGA * (-0.004 * tau.cos() - 0.0155 * tau.sin());
            let at = |d: f64| -> (f64, [f64; 2]) {
                let lever = if arm == 0 { [d, 0.0] } else { [0.0635 * (s.phi[1] - s.phi[0]).cos(), d] };
                (base * s.phi[arm].sin() + lever[0] * s.rate[0] + lever[1] * s.rate[1], lever)
            };
            let mut wanted = [0.0; 2];
            for i in 0..PIECES {
                let (v, lever) = at(length * (f64::from(i) + 0.5) / f64::from(PIECES));
                for (w, d) in wanted.iter_mut().zip(lever) {
                    *w += v * v.abs() * d * length / f64::from(PIECES);
                }
            }
            let one_side = at(0.0).0 * at(length).0 > 0.0;
            let greatest = at(0.0).0.abs().max(at(length).0.abs());
            for (e, w) in wanted.iter().enumerate() {
                let (got, w) = (column_at(&own[0], e, &s, tau), w / j[e]);
                let size = greatest * greatest * 0.06 * length / j[e];
                let bound = if one_side { 1e-6 } else { 1e-2 };
                assert!((got - w).abs() < bound * size, "arm {arm} equation {e}: {got} {w} {size}");
            }
        }
    }
}

/// The first arm reaches to the elbow, the second is a rod of its period.
#[test]
fn lengths_of_arms_follow_from_the_parameters() {
    let (mechanism, p) = mechanism();
    let file = mechanism.file.as_deref().unwrap();
    let length = |k: usize| crate::effects::along_an_arm::length(file, k, &p).unwrap();
    assert!((length(0) - 0.0635).abs() < 1e-12);
    assert!((length(1) - 1.5 * 4.033e-5 / (0.04 * 0.0267)).abs() < 1e-12, "{}", length(1));
}
