//! A force at a body that is a mass at a point, along its velocity: f(|v|) v, v the velocity of its
//! centroid, whose work on coordinate q is f(|v|) v·∂r/∂q.

use super::columns::{Law, Part, parts_of};
use super::entry::{Entry, Form};
use super::places::size_of as size;
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::parser::Mistake;
use crate::system::bodies::Body;
use crate::system::derivative::{by_time, partial};
use crate::system::language::SystemFile;
use crate::system::mechanism::Mechanism;
use crate::system::polynomial::{Atom, Polynomial};
use crate::system::words::{Value as Word, Words};

/// The point where a body's mass is, if it is no arm and turns by no angle of its own.
fn point(file: &SystemFile, k: usize) -> Option<&[Polynomial]> {
    let Body::Free { centroid: Some(point), turns: None, .. } = &file.bodies.get(k)?.value else { return None };
    (!file.written).then_some(&point[..])
}

/// Whether a body is a mass at a point that some coordinate moves.
pub fn moves(file: &SystemFile, k: usize) -> bool {
    point(file, k).is_some_and(|point| moved_by(file, point).is_some())
}

/// The first coordinate that moves a point.
fn moved_by(file: &SystemFile, point: &[Polynomial]) -> Option<usize> {
    (0..file.coordinates.len()).find(|c| point.iter().any(|x| x.moves(|s| s == Symbol::Coordinate(*c))))
}

/// The equation of the first coordinate that moves a body, and that coordinate.
pub fn equation(k: usize, mechanism: &Mechanism) -> Option<(usize, Polynomial)> {
    let file = mechanism.file.as_deref()?;
    let coordinate = moved_by(file, point(file, k)?)?;
    let equation = mechanism.scales.iter().position(|s| s.0 == coordinate)?;
    Some((equation, Polynomial::motion(Symbol::Coordinate(coordinate))))
}

/// Additions to the left-hand sides; none where there is no such body.
///
/// # Errors
/// A law that has no meaning there.
pub fn parts(
    entry: &Entry,
    form: &Form,
    k: usize,
    mechanism: &Mechanism,
    mut words: Words,
    omega: f64,
) -> Result<Option<Vec<Part>>, Mistake> {
    let Some(file) = mechanism.file.as_deref() else { return Ok(None) };
    let Some(point) = point(file, k) else { return Ok(None) };
    let n = file.coordinates.len();
    let Ok(velocity) = point.iter().map(|x| by_time(x, n, omega)).collect::<Result<Vec<_>, _>>() else {
        return Ok(None);
    };
    words.filled = true;
    words.scalars.push(("v".to_owned(), size(&velocity)));
    let Word::Scalar(law) = entry.law(&words, form)? else { return Ok(None) };
    let mut out = Vec::new();
    for (equation, (coordinate, _)) in mechanism.scales.iter().enumerate() {
        let by = Atom::Motion(Symbol::Coordinate(*coordinate));
        let work = point
            .iter()
            .zip(&velocity)
            .try_fold(Polynomial::default(), |sum, (x, v)| Some(sum.plus(&v.times(&partial(x, &by).ok()?).ok()?)));
        let Some(work) = work.and_then(|w| law.times(&w).ok()) else { return Ok(None) };
        parts_of(&work.scaled(-1.0), equation, file.parameters.len(), &Law::of_speeds, &mut out);
    }
    Ok((!out.is_empty()).then_some(out))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::catalogue;
    use crate::effects::columns::{Action, Span, action, columns};
    use crate::effects::places::Place;
    use crate::system::library;
    use crate::system::mechanism::at;

    const TEXT: &str = "name = \"crane\"\ncoordinates = { x = \"length\", theta = \"angle\" }\ngravity = \"down\"\n\
        parameters = { M = \"kg\", m = \"kg\", l = \"m\" }\n[points]\nload = \"[x, 0] + l*along(theta)\"\n\
        [[body]]\nname = \"trolley\"\nmass = \"M\"\ncentroid = \"[x, 0]\"\n\
        [[body]]\nname = \"load\"\nmass = \"m\"\ncentroid = \"load\"\n";

    /// Drag on the load of a crane does work on the trolley as well; that on the trolley on it alone.
    #[test]
    fn drag_on_a_load_is_that_of_its_own_velocity() {
        let model = library::read("crane", TEXT).unwrap().model(Some(&[]), 0.0).unwrap();
        let mechanism = model.mechanism.unwrap();
        let file = mechanism.file.as_deref().unwrap();
        assert_eq!([0, 1, 2].map(|k| moves(file, k)), [true, true, false]);
        let (l, k) = (0.7, 0.03);
        let own = |name: &str| match name {
            "M" => 2.0,
            "m" => 0.4,
            "l" => l,
            _ => 9.81,
        };
        let values: Vec<f64> = file.parameters.iter().map(|p| own(&p.name)).collect();
        let entry = |law: &str| Entry {
            law: law.to_owned(),
            ..catalogue().iter().find(|e| e.id == "body-drag").unwrap().clone()
        };
        let span = Span { start_s: 0.0, length_s: 1.0 };
        let left = |entry: &Entry, body: usize, [theta, v, omega]: [f64; 3]| {
            let found = action(entry, &Vec::new(), Place::Body(body), &mechanism, &values, 0.0, span).unwrap();
            let Some(Action::Force(parts)) = found else { panic!("no force") };
            let mut out = [0.0; 2];
            for (e, of) in &columns(&parts, 1, &mechanism, &values)[0] {
                let value = of.value(&|s| match s {
                    Symbol::Coordinate(1) => theta,
                    Symbol::Rate(0) => v,
                    Symbol::Rate(1) => omega,
                    _ => 0.3,
                });
                out[*e] += k * value * at(&mechanism.scales[*e].1, &values);
            }
            out
        };
        // The catalogue's, and one of a broken power of the speed.
        for (law, power) in [("-k*v", 1.0), ("-k*v^0.5", 0.5)] {
            for [theta, v, omega] in [[0.4, 1.3, -2.0], [-2.5, -0.2, 5.0], [1.0, 0.0, 0.0]] {
                let [along, up] = [v + l * omega * theta.cos(), l * omega * theta.sin()];
                let per = k * along.hypot(up).powf(power);
                let wanted = [per * along, per * l * (along * theta.cos() + up * theta.sin())];
                let trolley = [k * v.abs().powf(power) * v, 0.0];
                for (body, wanted) in [(1, wanted), (0, trolley)] {
                    let got = left(&entry(law), body, [theta, v, omega]);
                    assert!(got.iter().zip(wanted).all(|(g, w)| (g - w).abs() < 1e-12), "{law}: {got:?} {wanted:?}");
                }
            }
        }
    }
}
