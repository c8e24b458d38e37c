//! Forces all along an arm: what a force per length f(v, s) across the arm adds, v the speed across
//! the arm at distance s from its end `from`, that end's own velocity included.
//!
//! Its work on coordinate q is ∫ f(v(s), s) n·∂r/∂q ds from 0 to the length, n the unit vector
//! across the arm: a sum over six points of Gauss and Legendre, exact where f is a polynomial of
//! degree eleven along the arm (where the speed changes its sign on the arm, |v| has a corner, and
//! a thousandth is lost).
//!
//! Lengths on the grid of an entry are in lengths of the arm: from its end to where another arm
//! begins on its line, or, for the last arm, one and a half of the pendulum's reduced length J/S,
//! that of a rod of even thickness; both follow from what a record of an arm that swings
//! determines.

use super::columns::{Law, Part, parts_of};
use super::entry::{Entry, Form, LENGTH};
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::parser::Mistake;
use crate::system::bodies::Body;
use crate::system::derivative::{by_time, partial};
use crate::system::language::SystemFile;
use crate::system::mechanism::{Mechanism, at};
use crate::system::polynomial::{Atom, Polynomial};
use crate::system::words::{Value as Word, Words};

/// Points on [−1, 1] and their weights.
const POINTS: [(f64, f64); 6] = [
    (-0.932_469_514_203_152, 0.171_324_492_379_170_36),
    (-0.661_209_386_466_264_5, 0.360_761_573_048_138_6),
    (-0.238_619_186_083_196_93, 0.467_913_934_572_691_04),
    (0.238_619_186_083_196_93, 0.467_913_934_572_691_04),
    (0.661_209_386_466_264_5, 0.360_761_573_048_138_6),
    (0.932_469_514_203_152, 0.171_324_492_379_170_36),
];
/// Length of a rod over its reduced length as a pendulum.
const ROD: f64 = 1.5;

/// An arm in a plane: its end, the unit vector along it, that across it.
fn arm(file: &SystemFile, k: usize) -> Option<(&[Polynomial], &[Polynomial], [Polynomial; 2])> {
    let Body::Arm { angle: Some(_), from, along, .. } = &file.bodies.get(k)?.value else { return None };
    let [right, up] = &along[..] else { return None };
    (from.len() == 2).then(|| (&from[..], &along[..], [up.scaled(-1.0), right.clone()]))
}

/// Whether the arm's end moves. Where it rests the speed at s is ω s, and a power of it does the
/// work of that power of ω: what acts all along the arm is what acts on the arm.
pub fn end_moves(file: &SystemFile, k: usize) -> bool {
    arm(file, k).is_some_and(|(from, ..)| from.iter().any(|x| x.moves(|_| true)))
}

/// Additions to the left-hand sides; none where there is no such arm.
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
    let Some((from, along, across)) = arm(file, k) else { return Ok(None) };
    let length = form.iter().find(|s| s.0 == LENGTH).map_or(f64::NAN, |s| s.1);
    let n = file.coordinates.len();
    let mut sums = vec![Polynomial::default(); mechanism.scales.len()];
    words.filled = true;
    let before = words.scalars.len();
    for (place, weight) in POINTS {
        let s = 0.5 * length * (1.0 + place);
        let point: Vec<Polynomial> = from.iter().zip(along).map(|(o, u)| o.plus(&u.scaled(s))).collect();
        let Some(speed) = dot(&across, |i| by_time(&point[i], n, omega).ok()) else { return Ok(None) };
        words.scalars.truncate(before);
        words.scalars.push(("s".to_owned(), Polynomial::number(s)));
        // One factor, so that products of speeds are not multiplied out.
        words.scalars.push(("v".to_owned(), Polynomial::product(vec![(Atom::Sum(speed), 1)], 1.0)));
        let Word::Scalar(force) = entry.law(&words, form)? else { return Ok(None) };
        for (sum, (coordinate, _)) in sums.iter_mut().zip(&mechanism.scales) {
            let by = Atom::Motion(Symbol::Coordinate(*coordinate));
            let lever = dot(&across, |i| partial(&point[i], &by).ok());
            let Some(work) = lever.and_then(|l| force.times(&l).ok()) else { return Ok(None) };
            *sum = sum.minus(&work.scaled(0.5 * length * weight));
        }
    }
    let mut out = Vec::new();
    for (equation, sum) in sums.iter().enumerate() {
        parts_of(sum, equation, file.parameters.len(), &Law::of_speeds, &mut out);
    }
    Ok((!out.is_empty()).then_some(out))
}

/// A scalar product with the vector across an arm.
fn dot(across: &[Polynomial; 2], of: impl Fn(usize) -> Option<Polynomial>) -> Option<Polynomial> {
    let [x, y] = [0, 1].map(|i: usize| across[i].times(&of(i)?).ok());
    Some(x?.plus(&y?))
}

/// Length of an arm, m, at values of the parameters: to where another begins on its line, the
/// farthest of them; of the last arm that of a rod of its period.
pub fn length(file: &SystemFile, k: usize, parameters: &[f64]) -> Option<f64> {
    let (from, along, _) = arm(file, k)?;
    let begins = |other: &Body| {
        let Body::Arm { from: other, .. } = other else { return None };
        let way: Vec<Polynomial> = other.iter().zip(from).map(|(b, a)| b.minus(a)).collect();
        // What multiplies the sine of the angle is the length, if the cosine has the same.
        let (_, length) = way.first()?.by_motion().into_iter().next()?;
        let on_line = way.iter().zip(along).all(|(w, u)| u.times(&length).is_ok_and(|l| l == *w));
        on_line.then(|| at(&length, parameters)).filter(|l| *l > 0.0)
    };
    let farthest = file.bodies.iter().filter_map(|b| begins(&b.value)).fold(0.0, f64::max);
    if farthest > 0.0 {
        return Some(farthest);
    }
    let Body::Arm { first_moment, inertia, .. } = &file.bodies.get(k)?.value else { return None };
    Some(ROD * at(inertia, parameters) / at(first_moment, parameters)).filter(|l| *l > 0.0 && l.is_finite())
}
