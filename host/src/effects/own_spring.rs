//! A law at a place where the system has a spring of its own.
//!
//! A gap's law, −k (x − sat(x)) with sat x = (|x + b| − |x − b|)/2, holds a spring −k x. Where the
//! system has one, −c x, both stand for the same motion but for the sum k + c, and the gap of a
//! shaft ends at c = 0: the coefficients that tell the inertias on either side are gone. There the
//! law is what it does beside the spring, +k sat(x): the stiffness past the gap is c, the one
//! within c − k.

use super::entry::Entry;
use super::places;
use crate::model::model_file::expression::{Function, multiple};
use crate::system::language::SystemFile;
use crate::system::polynomial::{Atom, Polynomial};

/// What moves at a place, as laws are told it: an angle within a turn.
pub(super) fn displacement(file: &SystemFile, moves: &Polynomial) -> Polynomial {
    if places::is_angle(file, moves) { Polynomial::call(Function::Wrap, moves.clone()) } else { moves.clone() }
}

/// The law without what the system's own spring is; itself where there is none, where it is nothing
/// else, or where it remembers. Strengths are parameters from the file's on.
pub(super) fn beside(entry: &Entry, law: Polynomial, file: &SystemFile, moves: &Polynomial) -> Polynomial {
    let x = displacement(file, moves);
    let Some((first, unit)) = x.terms().next() else { return law };
    let parts = law.by_parameters();
    let mut out = law;
    for k in 0..entry.strengths.len() {
        let strength = Atom::Parameter(file.parameters.len() + k);
        let Some(of) = parts.get(&vec![(strength.clone(), 1)]) else { continue };
        let Some((_, slope)) = of.terms().find(|(product, _)| *product == first) else { continue };
        let spring = x.scaled(slope / unit);
        let is_apart = !of.minus(&spring).is_zero() && entry.states.is_empty();
        if is_apart && has_spring(file, moves, &x) {
            out = spring.times(&Polynomial::atom(strength)).map_or(out.clone(), |s| out.minus(&s));
        }
    }
    out
}

/// Whether a force or the potential of a system is linear in a displacement, by a parameter.
fn has_spring(file: &SystemFile, moves: &Polynomial, x: &Polynomial) -> bool {
    let is_angle = |i: usize| file.coordinates[i].1 == "angle";
    let parts = |p: &Polynomial| {
        let own = p.by_parameters().into_iter().filter(|(product, _)| !product.is_empty());
        own.map(|(_, of)| of).collect::<Vec<_>>()
    };
    let is_like = |a: &Polynomial, b: &Polynomial| multiple(&a.node(), &b.node()).is_some();
    let by_force = file.forces.iter().any(|f| {
        let linear = |of: &Polynomial| is_like(&of.of_whole_angles(&is_angle), x);
        is_like(&f.does_work_on.value, moves) && parts(&f.value.value).iter().any(linear)
    });
    let square = moves.power(2).ok();
    let of_potential = file.potential.iter().flat_map(|p| parts(&p.value));
    by_force || square.is_some_and(|s| of_potential.into_iter().any(|of| is_like(&of, &s)))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::effects::catalogue;
    use crate::effects::columns::{Action, Span, action, columns};
    use crate::effects::places::Place;
    use crate::effects::written;
    use crate::model::model_file::ModelFile;
    use crate::model::model_file::expression::Symbol;
    use crate::system::library;

    const LINE: &str = "name = \"line\"
coordinates = { q1 = \"rad\", q2 = \"rad\" }
parameters = { J1 = \"kg m^2\", J2 = \"kg m^2\", k = \"N m/rad\", c = \"N m s/rad\" }
[[body]]
name = \"motor\"
angle = \"q1\"
inertia = \"J1\"
[[body]]
name = \"load\"
angle = \"q2\"
inertia = \"J2\"
[[joint]]
name = \"shaft\"
moves = \"q2 - q1\"
[[force]]
does_work_on = \"q1\"
value = \"-c*q1'\"
";

    /// What a gap of strength one adds to the first equation, at a twist.
    fn added(spring: &str, twist: f64) -> f64 {
        let model = library::read("line", &format!("{LINE}{spring}")).unwrap().model(None, 31.4).unwrap();
        let mechanism = model.mechanism.clone().unwrap();
        let entry = catalogue().iter().find(|e| e.id == "backlash").unwrap();
        let form = vec![("b".to_owned(), 0.1)];
        let span = Span { start_s: 0.0, length_s: 1.0 };
        let parameters = [2.0, 5.0, 8.0, 0.1];
        let Ok(Some(Action::Force(parts))) = action(entry, &form, Place::Joint(0), &mechanism, &parameters, 31.4, span)
        else {
            panic!("no force")
        };
        let all = columns(&parts, 1, &mechanism, &parameters);
        let (_, of) = all[0].iter().find(|(e, _)| *e == 0).unwrap();
        of.value(&|s| if s == Symbol::Coordinate(1) { twist } else { 0.0 })
    }

    /// Beside the shaft's own spring the gap takes its force away within b; without one it is the contact's force beyond b. Both but for the spring.
    #[test]
    fn a_gap_takes_from_a_spring_that_there_is() {
        let force = "[[force]]\ndoes_work_on = \"q2 - q1\"\nvalue = \"-k*(q2 - q1)\"\n";
        let cubic = "[[force]]\ndoes_work_on = \"q2 - q1\"\nvalue = \"-k*(q2 - q1)^3\"\n";
        let other = "[[force]]\ndoes_work_on = \"q2\"\nvalue = \"-k*q2\"\n";
        let per = added(cubic, 0.3) / (0.3 - 0.1);
        for twist in [-0.3_f64, -0.05, 0.02, 0.3] {
            let beyond = twist - twist.clamp(-0.1, 0.1);
            for without in [cubic, other] {
                assert!((added(without, twist) - per * beyond).abs() < 1e-12 * per.abs(), "{without} {twist}");
            }
            let beside = added(force, twist);
            assert!((beside + per * twist.clamp(-0.1, 0.1)).abs() < 1e-12 * per.abs(), "{twist} {beside}");
        }
    }

    /// The same where equations are written down: the spring is what couples them.
    #[test]
    fn a_gap_takes_from_a_spring_between_written_equations() {
        let added = |term: &str, twist: f64| {
            let text = format!(
                "name = \"m\"\ncoordinates = [{{ name = \"a\", space = \"R\" }}, {{ name = \"b\", space = \"R\" }}]\n\
                 [[equation]]\nbalance = \"-a''\"\nterms = {{ k = \"{term}\" }}\n\
                 [[equation]]\nbalance = \"-b''\"\nterms = {{ l = \"-({term})\" }}\n"
            );
            let model = ModelFile::parse(&text, Path::new("m.toml")).unwrap();
            let values = [3.0, 6.0];
            let mechanism = written::mechanism(&model, None, 1.0, &values).unwrap();
            let parameters = written::parameters(&model, None, 1.0, &values).unwrap();
            let entry = catalogue().iter().find(|e| e.id == "backlash").unwrap();
            let place = Place::Joint(mechanism.file.as_ref().unwrap().joints.len() - 1);
            let (form, span) = (vec![("b".to_owned(), 0.1)], Span { start_s: 0.0, length_s: 1.0 });
            let Ok(Some(Action::Force(parts))) = action(entry, &form, place, &mechanism, &parameters, 1.0, span) else {
                panic!("no force")
            };
            let all = columns(&parts, 2, &mechanism, &parameters);
            let of = |e: usize| &all[0].iter().find(|(own, _)| *own == e).unwrap().1;
            [0, 1].map(|e| of(e).value(&|s| if s == Symbol::Coordinate(1) { twist } else { 0.0 }))
        };
        let coupling = |twist: f64| added("a - b + 0.1*(a - b)^3", twist)[0];
        for twist in [-0.3_f64, -0.05, 0.02, 0.3] {
            let [first, second] = added("a - b", twist);
            assert!((first - twist.clamp(-0.1, 0.1)).abs() < 1e-12, "{twist} {first}");
            // The second has half the inertia of the first.
            assert!((second + 2.0 * first).abs() < 1e-12, "{twist} {second}");
            assert!((coupling(twist) + (twist - twist.clamp(-0.1, 0.1))).abs() < 1e-12, "{twist}");
        }
    }
}
