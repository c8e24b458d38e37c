//! Forces between two coordinates of one kind: a spring that nobody drew between two masses.
//!
//! Such a force does work on the difference x_i − x_j, and acts in the equations of both with
//! opposite signs. A joint that moves by that difference is the place of such forces by itself: the
//! pair is then none.
//!
//! Equations that have no inertia in common (written ones: and no stiffness) leave the ratio of
//! their inertias open unless masses are known: a record then tells strengths over the inertia of
//! the second coordinate, and the ratio D_j/D_i, [`INERTIA_RATIO`], is found with them.

use super::entry::{Entry, Form};
use super::places::Place;
use crate::model::model_file::expression::Symbol;
use crate::system::language::SystemFile;
use crate::system::mechanism::{Mechanism, at};
use crate::system::polynomial::Polynomial;

/// The shape parameter that stands for the inertia of the second coordinate over that of the first.
pub const INERTIA_RATIO: &str = "inertia_ratio";
/// Ratios that are tried, and their bounds.
const RATIOS: [f64; 3] = [1.0, 0.2, 5.0];
const WITHIN: [f64; 2] = [1e-3, 1e3];

/// Pairs of coordinates of one kind, the earlier first, by whose difference no joint moves.
pub fn pairs(file: &SystemFile) -> Vec<(usize, usize)> {
    let n = file.coordinates.len();
    let all = (0..n).flat_map(|j| (0..j).map(move |i| (i, j)));
    all.filter(|&(i, j)| {
        let x = difference(i, j);
        let moves = |of: &Polynomial| file.joints.iter().any(|joint| joint.moves.value == *of);
        file.coordinates[i].1 == file.coordinates[j].1 && !moves(&x) && !moves(&x.scaled(-1.0))
    })
    .collect()
}

/// What a force between two coordinates depends on.
pub fn difference(i: usize, j: usize) -> Polynomial {
    let coordinate = |k: usize| Polynomial::motion(Symbol::Coordinate(k));
    coordinate(i).minus(&coordinate(j))
}

/// What it does work on where each equation is divided by the inertia that `parameters` say: in
/// the first one as much more as the ratio of inertias is another than theirs.
pub fn works_on((i, j): (usize, usize), form: &Form, mechanism: &Mechanism, parameters: &[f64]) -> Polynomial {
    let coordinate = |k: usize| Polynomial::motion(Symbol::Coordinate(k));
    let size = |k: usize| inertia(mechanism, k).map_or(f64::NAN, |d| at(d, parameters).abs());
    let ratio = form.iter().find(|s| s.0 == INERTIA_RATIO).map(|s| s.1);
    let first = ratio.map_or(1.0, |r| r * size(i) / size(j));
    coordinate(i).scaled(first).minus(&coordinate(j))
}

/// The inertia by which the equation of a coordinate is divided.
pub fn inertia(mechanism: &Mechanism, coordinate: usize) -> Option<&Polynomial> {
    mechanism.scales.iter().find(|s| s.0 == coordinate).map(|s| &s.1)
}

/// An entry with the ratio of inertias as a shape.
#[must_use]
pub fn with_ratio(entry: &Entry) -> Entry {
    entry.with_shape(INERTIA_RATIO, RATIOS.to_vec(), Some(WITHIN))
}

/// The same for a place of written equations, where these leave the ratio open.
pub fn in_written(entry: &Entry, place: Place, mechanism: &Mechanism) -> Option<Entry> {
    let Place::Between(i, j) = place else { return None };
    mechanism.apart.contains(&(i, j)).then(|| with_ratio(entry))
}

#[cfg(test)]
#[path = "between_tests.rs"]
mod tests;
