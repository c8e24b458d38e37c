//! What kind of effect an entry is, by its law: whatever its name, and of a user's own as well.

use super::columns::LOAD;
use super::entry::{At, Entry, Form, Verb, stand_ins};
use crate::model::model_file::expression::Symbol;
use crate::system::polynomial::{Atom, Polynomial};
use crate::system::words::Value as Word;

/// Positions and rates at which laws are compared, of both signs, within half a turn and off any
/// corner of the list.
const POINTS: [[f64; 2]; 6] = [[0.37, 0.61], [-1.9, 2.3], [2.9, -0.113], [-0.71, -7.7], [1.13, -1.7], [-2.3, 0.029]];
/// Factor by which a unit is changed, and its powers that a law may have.
const FACTOR: f64 = 2.0;
const POWERS: core::ops::RangeInclusive<i32> = -4..=4;

/// Whether it is a force by the position of a joint, and by nothing else.
pub fn is_of_position(entry: &Entry) -> bool {
    is_of_position_at_most(entry) && entry.names("x")
}

/// Whether it is a force at a joint that nothing changes.
pub fn is_constant(entry: &Entry) -> bool {
    is_of_position_at_most(entry) && !entry.names("x")
}

fn is_of_position_at_most(entry: &Entry) -> bool {
    let other = ["v", "t", "T", "tau", LOAD];
    entry.at == At::Joint
        && entry.verb == Verb::Force
        && entry.states.is_empty()
        && !other.iter().any(|word| entry.names(word))
}

/// Whether it can but take energy away: a force against the rate, whatever else there is, of
/// strengths that are positive by their nature.
pub fn brakes(entry: &Entry) -> bool {
    let forms = entry.forms();
    let (Some(first), Some(last)) = (forms.first(), forms.last()) else { return false };
    let against =
        |form: &Form| POINTS.iter().all(|&[x, v]| value(entry, form, x, v).is_some_and(|force| force * v <= 0.0));
    entry.verb == Verb::Force
        && entry.states.is_empty()
        && entry.positive.iter().all(|p| *p)
        && against(first)
        && against(last)
}

/// Whether a shape parameter is compared with the rate: in another unit of time the law is the same
/// but for a power of it, in another unit of the position it is not.
pub fn is_rate(entry: &Entry, shape: usize) -> bool {
    let Some(form) = entry.forms().into_iter().next() else { return false };
    let mut other = form.clone();
    let Some(own) = other.get_mut(shape) else { return false };
    own.1 *= FACTOR;
    let same = |by: [f64; 2]| {
        let pairs: Option<Vec<[f64; 2]>> = POINTS
            .iter()
            .map(|&[x, v]| Some([value(entry, &form, x, v)?, value(entry, &other, x * by[0], v * by[1])?]))
            .collect();
        // What is nothing in both units, as an exponential far out, tells nothing.
        let tell: Vec<[f64; 2]> = pairs.unwrap_or_default().into_iter().filter(|p| *p != [0.0; 2]).collect();
        let alike = |n: i32| tell.iter().all(|[a, b]| (b - a * FACTOR.powi(n)).abs() < 1e-9 * b.abs());
        tell.len() > 1 && POWERS.into_iter().any(alike)
    };
    entry.names("v") && same([1.0, FACTOR]) && !same([FACTOR, 1.0])
}

/// Its law at strengths of one for a position (an angle within half a turn) and a rate; all else is
/// some positive number.
fn value(entry: &Entry, form: &Form, x: f64, v: f64) -> Option<f64> {
    let mut words = stand_ins(&["x", "v", "t"]);
    words.scalars.push(("omega".to_owned(), Polynomial::motion(Symbol::Rate(0))));
    words.scalars.push((LOAD.to_owned(), Polynomial::motion(Symbol::Input(0))));
    let Word::Scalar(law) = entry.law(&words, form).ok()? else { return None };
    let at = |a: &Atom| match a {
        Atom::Motion(Symbol::Coordinate(_)) => x,
        Atom::Motion(Symbol::Rate(_)) => v,
        Atom::Motion(_) => 0.3,
        Atom::Parameter(_) => 1.0,
        _ => f64::NAN,
    };
    Some(law.value(&at)).filter(|f| f.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::catalogue;
    use crate::effects::entry::read;
    use crate::model::model_file::toml_place::Source;

    fn ids(of: impl Fn(&Entry) -> bool) -> Vec<&'static str> {
        catalogue().iter().filter(|e| of(e)).map(|e| e.id.as_str()).collect()
    }

    fn own(text: &str) -> Entry {
        let text = format!("[[effect]]\nid = \"own\"\nat = \"joint\"\nstrengths = [\"k\"]\n{text}");
        let source = Source { text, path: "e.toml".into() };
        read(&source).unwrap().remove(0)
    }

    #[test]
    fn laws_of_the_position_alone() {
        let listed = [
            "torsion-spring",
            "cubic-stiffness",
            "quadratic-stiffness",
            "quintic-stiffness",
            "backlash",
            "cogging",
            "local-force",
        ];
        assert_eq!(ids(is_of_position), listed);
        assert_eq!(ids(is_constant), ["constant-force"]);
        assert!(is_of_position(&own("force = \"-k*tanh(3*x)\"")) && !is_of_position(&own("force = \"-k*x*v^2\"")));
    }

    #[test]
    fn forces_that_can_but_brake() {
        let listed = [
            "viscous-friction",
            "coulomb-friction",
            "stribeck-friction",
            "load-dependent-friction",
            "quadratic-drag",
            "asymmetric-friction",
            "power-law-damping",
        ];
        assert_eq!(ids(brakes), listed);
    }

    #[test]
    fn a_shape_is_a_rate_by_what_it_is_compared_with() {
        let rates = |e: &Entry| {
            let is = |k: usize| is_rate(e, k).then(|| e.shapes[k].name.clone());
            (0..e.shapes.len()).filter_map(is).collect::<Vec<_>>()
        };
        let found = catalogue().iter().filter(|e| e.states.is_empty() && e.at == At::Joint);
        let found: Vec<(&str, Vec<String>)> =
            found.map(|e| (e.id.as_str(), rates(e))).filter(|f| !f.1.is_empty()).collect();
        assert_eq!(found, [("stribeck-friction", vec!["v_s".to_owned()])]);
        let shape = |name: &str| format!("shape = {{ {name} = {{ grid = [0.3, 1.0], within = [0.1, 3.0] }} }}");
        for (law, name, wanted) in [
            ("-k*v/(w + abs(v))", "w", true),
            ("-k*x*exp(-(v/limit)^2)", "limit", true),
            ("-k*tanh(t*v/w)", "w", true),
            ("-k*sin(x)*exp(-(x/v_d)^2)", "v_d", false),
            ("-k*x^3*exp(-(x/vast)^2)", "vast", false),
            ("-k*abs(v)^p*sign(v)", "p", false),
        ] {
            assert_eq!(is_rate(&own(&format!("force = \"{law}\"\n{}", shape(name))), 0), wanted, "{law}");
        }
    }
}
