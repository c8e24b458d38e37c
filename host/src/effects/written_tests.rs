//! Columns of written equations against those of the same pendulum's bodies, effect by effect, on
//! random states.

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::effects::columns::{self, Action};
use crate::effects::entry::Verb;
use crate::effects::{catalogue, places};
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::system::library;

const OMEGA: f64 = 31.4;
const SPAN: Span = Span { start_s: 2.0, length_s: 40.0 };
/// m1, e1, J_1, l1, m2, e2, J_2, a_c, a_s, g of the shipped double pendulum.
const PARAMETERS: [f64; 10] = [0.1362, 0.0127, 4.4e-4, 0.0635, 0.04, 0.0267, 4.033e-5, 0.0155, -0.004, 9.81];

fn file(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

/// Coefficients of equations (3.4) for these parameters.
fn coefficients(model: &ModelFile) -> Vec<f64> {
    let [m1, e1, j1, l1, m2, e2, j2, a_c, a_s, g] = PARAMETERS;
    let (inertia, s, coupling) = ([j1 + m2 * l1 * l1, j2], [m1 * e1 + m2 * l1, m2 * e2], m2 * e2 * l1);
    let of = |name: &str| {
        let digit = |k: usize| name.as_bytes().get(k).map_or(0, |b| usize::from(b - b'0'));
        let e = digit(1).clamp(1, 2) - 1;
        match (name.starts_with('B'), digit(2)) {
            (true, 1) => coupling / inertia[e],
            (true, 2) => s[e] * g / inertia[e] / (OMEGA * OMEGA),
            (true, 3) => -s[e] * a_c / inertia[e],
            (true, _) => -s[e] * a_s / inertia[e],
            _ => 0.0,
        }
    };
    model.coefficients().iter().map(|n| of(n)).collect()
}

/// Places with the names of the written model's joints and arms, and columns of both, at values of
/// the motion.
fn states() -> Vec<impl Fn(Symbol) -> f64> {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    (0..200)
        .map(|_| {
            let mut any = |size: f64| size * (2.0 * random.random::<f64>() - 1.0);
            let (phi, rate, tau, t) = ([any(9.0), any(9.0)], [any(20.0), any(20.0)], any(3.0), 22.0 + any(20.0));
            let acceleration = [any(400.0), any(400.0)];
            move |s: Symbol| match s {
                Symbol::Coordinate(k) => phi[k],
                Symbol::Rate(k) => rate[k],
                Symbol::Acceleration(k) => acceleration[k],
                Symbol::Tau => tau,
                Symbol::Time => t,
                _ => f64::NAN,
            }
        })
        .collect()
}

#[test]
fn effects_on_written_equations_are_those_of_the_bodies() {
    let text = library::text("double-pendulum").unwrap();
    let bodies = library::read("double-pendulum", text).unwrap().model(Some(&[]), OMEGA).unwrap().mechanism.unwrap();
    let rig = Rig::read(file("rigs/double-pendulum-model-file.toml")).unwrap();
    let bound: &ObservedModel = rig.bound.as_ref().unwrap();
    let model = &*bound.model;
    let values = coefficients(model);
    let direction = Some(Direction::Vertical);
    let places_of = mechanism(model, direction, OMEGA, &values).unwrap();
    let own = parameters(model, direction, OMEGA, &values).unwrap();
    let j1 = PARAMETERS[2] + PARAMETERS[4] * PARAMETERS[3] * PARAMETERS[3];
    assert!((own[1] / own[0] / (PARAMETERS[6] / j1) - 1.0).abs() < 1e-9, "{own:?}");
    let a = PARAMETERS[7].hypot(PARAMETERS[8]);
    let names = places_of.file.clone().unwrap();
    let mut compared = 0;
    // What is turned, by angles that are known as well.
    let known = |e: &Entry| {
        let angles: &[f64] = if e.verb == Verb::Turns { &[0.0, 0.03, -0.3] } else { &[0.0] };
        angles.iter().map(|a| e.about(&[*a])).collect::<Vec<_>>()
    };
    let acts = catalogue().iter().filter(|e| !matches!(e.verb, Verb::Reads | Verb::Advances));
    for entry in &acts.flat_map(known).collect::<Vec<_>>() {
        for place in places::of(entry, &names, bound) {
            // Only the part of arm 1 that hangs on it alone would turn, which written equations do
            // not tell.
            if entry.id == "imbalance" && place.name(&names) == "arm1" {
                continue;
            }
            let form = entry.forms().swap_remove(0);
            let loads = entry.names(LOAD);
            // Masses of what hangs on each joint, over the inertia of its arm.
            let hangs = [(PARAMETERS[0] + PARAMETERS[4]) / j1, PARAMETERS[4] / PARAMETERS[6]];
            let mass =
                if let (true, Place::Joint(k)) = (loads, place) { Some((MASS.to_owned(), hangs[k])) } else { None };
            let with_mass: Form = form.iter().cloned().chain(mass).collect();
            let of = |m: &Mechanism, p: &[f64]| -> Vec<Vec<(usize, Node)>> {
                let form = if m.file.as_ref().unwrap().written { &with_mass } else { &form };
                match columns::action(entry, form, place, m, p, OMEGA, SPAN).unwrap().unwrap() {
                    Action::Force(parts) => columns::columns(&parts, entry.strengths.len(), m, p),
                    Action::Changes(all) => super::columns(&all, model, direction, OMEGA, &values),
                    _ => panic!("{}", entry.id),
                }
            };
            let (wanted, got) = (of(&bodies, &PARAMETERS), of(&places_of, &own));
            // A strength of one: a torque over J_o1 and Ω², an angle, the drive's amplitude, a
            // share of it.
            let per = match entry.verb {
                Verb::Force if loads => 1.0 / (OMEGA * OMEGA),
                Verb::Force => j1,
                Verb::Moves if entry.unit.is_none() => a / (OMEGA * OMEGA),
                _ => 1.0 / (OMEGA * OMEGA),
            };
            for at in states() {
                for (k, (wanted, got)) in wanted.iter().zip(&got).enumerate() {
                    for e in 0..2 {
                        // States of what remembers stand in both alike.
                        let of = |n: &Node| n.with_memories(&|_, k| number(0.7 + k as f64)).value(&at);
                        let value = |c: &[(usize, Node)]| c.iter().find(|x| x.0 == e).map_or(0.0, |x| of(&x.1));
                        let (w, g) = (per * value(wanted), value(got));
                        let name = place.name(&names);
                        assert!((w - g).abs() < 1e-9 * (1e-3 + w.abs()), "{}@{name} {k} {e}: {w} {g}", entry.id);
                    }
                }
            }
            compared += 1;
        }
    }
    assert!(compared > 25, "{compared}");
}

#[test]
fn coordinates_without_names_are_places_themselves() {
    let text = "name = \"m\"\ncoordinates = [{ name = \"a\", space = \"S1\" }, { name = \"b\", space = \"S1\" }, { name = \"x\", space = \"R\" }]\n\
        [[equation]]\nbalance = \"-a''\"\nterms = { B = \"b''*cos(b - a) - b'^2*sin(b - a)\", k = \"sin(a)\" }\n\
        [[equation]]\nbalance = \"-b''\"\nterms = { C = \"a''*cos(b - a) + a'^2*sin(b - a)\", l = \"sin(b)\" }\n\
        [[equation]]\nbalance = \"-x''\"\nterms = { h = \"x\" }\n";
    let model = ModelFile::parse(text, Path::new("m.toml")).unwrap();
    let values = [0.5, 1.0, 2.0, 1.0, 3.0];
    let m = mechanism(&model, None, 1.0, &values).unwrap();
    let file = m.file.unwrap();
    let joints: Vec<&str> = file.joints.iter().map(|j| j.name.as_str()).collect();
    assert_eq!(joints, ["a", "b", "x", "b-a"]);
    let Inertias { scales, coupled, springs } = inertias(&model, 1.0, &values).unwrap();
    assert!(springs.is_empty());
    assert_eq!(coupled, [(0, 1)]);
    assert!((scales[1] - 0.25).abs() < 1e-12 && scales[0] == 1.0 && scales[2] == 1.0, "{scales:?}");
    // What no mechanics could be is not coupled.
    let odd = text.replace("a''*cos(b - a)", "a''*sin(b - a)");
    let odd = ModelFile::parse(&odd, Path::new("m.toml")).unwrap();
    assert!(inertias(&odd, 1.0, &values).unwrap().coupled.is_empty());
}

/// A fit of q and β to a pendulum in a frame that leans, about the angle of the round before: by the
/// first order alone q is cos β of what it is and β its tangent; renewed it ends at the rotation.
#[test]
fn a_fit_that_renews_the_angle_ends_at_the_rotation() {
    let text = "name = \"m\"\ncoordinates = [{ name = \"a\", space = \"S1\" }]\n\
        [[equation]]\nbalance = \"-a''\"\nterms = { q = \"sin(a)\" }\n";
    let model = ModelFile::parse(text, Path::new("m.toml")).unwrap();
    let q = 41.9;
    for (id, sign) in [("frame-tilt", -1.0), ("imbalance", 1.0)] {
        let entry = catalogue().iter().find(|e| e.id == id).unwrap();
        for beta in [0.03, -0.3] {
            let states: Vec<f64> = (0..50).map(|k| 0.13 * f64::from(k)).collect();
            let wanted: Vec<f64> = states.iter().map(|a| q * (a + sign * beta).sin()).collect();
            let (mut found, mut first) = ([q, 0.0], None);
            for _ in 0..12 {
                let values = [found[0]];
                let places_of = mechanism(&model, None, 1.0, &values).unwrap();
                let place = if id == "imbalance" { Place::Arm(0) } else { Place::Frame };
                let near = entry.about_found(&found[1..]);
                let file = places_of.file.as_deref().unwrap();
                let all = changes(&near, &Vec::new(), place, file, SPAN, 1.0, 0.0).unwrap();
                let column = super::columns(&all, &model, None, 1.0, &values).remove(0).remove(0).1;
                let at = |a: f64| column.value(&|_| a);
                let sum = |f: &dyn Fn(usize) -> f64| (0..states.len()).map(f).sum::<f64>();
                let (x, y) = (|i: usize| states[i].sin(), |i: usize| at(states[i]));
                let [xx, xy, yy] = [sum(&|i| x(i) * x(i)), sum(&|i| x(i) * y(i)), sum(&|i| y(i) * y(i))];
                let [xw, yw] = [sum(&|i| x(i) * wanted[i]), sum(&|i| y(i) * wanted[i])];
                let determinant = xx * yy - xy * xy;
                found = [(yy * xw - xy * yw) / determinant, (xx * yw - xy * xw) / determinant];
                first = first.or(Some(found[0]));
            }
            assert!((first.unwrap() / q - beta.cos()).abs() < 1e-9, "{first:?}");
            assert!((found[0] / q - 1.0).abs() < 1e-8 && (found[1] - beta).abs() < 1e-8, "{id} {beta}: {found:?}");
        }
    }
}
