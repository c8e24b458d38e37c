//! Entries whose forms are those of what is there: shape parameters in the size of the motion (rms,
//! in the joint's unit or its rate's) or of the arm (m), a mass that a load rests on (kg), and
//! frequencies (Hz) of lines in what is left of the record.

use std::sync::Arc;

use super::Physical;
use super::Setting;
use crate::effects::columns::{self, Action, LOAD};
use crate::effects::entry::{At, Entry, Form, LENGTH, MASS, Shape, Verb, stand_ins};
use crate::effects::places::Place;
use crate::effects::written::load;
use crate::effects::{along_an_arm, between, kinds, places};
use crate::explain::engine::memory;
use crate::model::model_file::equations_of_motion::wrapped;
use crate::model::model_file::expression::Symbol;
use crate::system::bodies::Body;
use crate::system::language::SystemFile;
use crate::system::mechanism::at;
use crate::system::polynomial::{Atom, Polynomial};

/// Masses of an arm that are tried, in units of S/l, and the largest: centroids from four fifths of
/// the arm's length to a fiftieth.
const MASSES: [f64; 5] = [1.25, 2.0, 3.5, 6.0, 12.0];
const MOST_MASS: f64 = 50.0;

/// An entry with the mass that its load rests on as a shape.
fn with_mass(entry: &Entry, least: f64) -> Option<Arc<Entry>> {
    let grid: Vec<f64> = MASSES.iter().map(|m| m * least).collect();
    let entry = entry.with_shape(MASS, grid, Some([least, MOST_MASS * least]));
    (least > 0.0 && least.is_finite()).then(|| Arc::new(entry))
}

impl Setting<'_> {
    /// An entry with the grid of its shape parameter in the size of what is there: of the motion,
    /// or of the arm that it acts along; none where that is not known, and where a refinement is no
    /// other law than the simpler one, along an arm whose end rests.
    pub(super) fn sized(&self, entry: &Arc<Entry>, place: Place, physical: &Physical) -> Option<Arc<Entry>> {
        let file = self.file()?;
        if let (Place::Arm(k), Verb::Drags) = (place, entry.verb) {
            if entry.refines.is_some() && !along_an_arm::end_moves(file, k) {
                return None;
            }
            let length = along_an_arm::length(file, k, &physical.values)?;
            let mut out = (**entry).clone();
            let grids = out.shapes.iter_mut().filter(|s| s.name == LENGTH).flat_map(|s| &mut s.grid);
            grids.for_each(|x| *x *= length);
            return Some(Arc::new(out));
        }
        if let (Place::Joint(k), true) = (place, entry.names(LOAD)) {
            return self.with_mass(entry, k, physical);
        }
        let entry = self.with_open(&self.as_large_as_the_motion(entry, place, file), place, physical);
        Some(if let Place::Between(i, j) = place { self.between(entry, (i, j), physical) } else { entry })
    }

    /// An entry between two coordinates, with the ratio of their inertias as a shape where that
    /// stays open.
    fn between(&self, entry: Arc<Entry>, (i, j): (usize, usize), physical: &Physical) -> Arc<Entry> {
        let Some(mechanism) = self.mechanism() else { return entry };
        let inertia = |k: usize| between::inertia(mechanism, k);
        let is_open = match (inertia(i), inertia(j)) {
            _ if self.is_written() => mechanism.apart.contains(&(i, j)),
            (Some(first), Some(second)) => physical.openness.is_open(second, first),
            _ => true,
        };
        if is_open { Arc::new(between::with_ratio(&entry)) } else { entry }
    }

    /// An entry that names a load, at a joint: as it is where the load is fixed, otherwise with the
    /// mass m of the nearest arm as a shape. Its first moment S stays, and a centroid within the
    /// arm's length l has m ≥ S/l. In written equations it is the mass of all that hangs on the
    /// joint, over the arm's own inertia.
    fn with_mass(&self, entry: &Arc<Entry>, joint: usize, physical: &Physical) -> Option<Arc<Entry>> {
        let (file, mechanism) = (self.file()?, self.mechanism()?);
        if file.written {
            let hung = load::hung(&file.joints, joint, file.coordinates.len())?;
            let equations = load::Equations {
                model: self.model(),
                direction: self.rig.direction(),
                omega: self.rig.omega(),
                values: &physical.written,
            };
            return with_mass(entry, equations.least_mass(&hung)?);
        }
        let form = entry.forms().into_iter().next()?;
        let action = columns::action(
            entry,
            &form,
            Place::Joint(joint),
            mechanism,
            &physical.values,
            self.rig.omega(),
            self.span,
        );
        let Ok(Some(Action::Force(parts))) = action else { return Some(entry.clone()) };
        if physical.fixes(&parts, mechanism) {
            return Some(entry.clone());
        }
        let (arm, _) = file.joints[joint].carries.first()?;
        let Body::Arm { first_moment, .. } = &file.bodies.get(*arm)?.value else { return None };
        let least = at(first_moment, &physical.values).abs() / along_an_arm::length(file, *arm, &physical.values)?;
        with_mass(entry, least)
    }

    /// An entry whose grid of a shape parameter holds the size of the motion: where it does not, as
    /// of a slow axis in metres, the grid is moved there.
    fn as_large_as_the_motion(&self, entry: &Arc<Entry>, place: Place, file: &SystemFile) -> Arc<Entry> {
        let Some(moves) = place.moves(file).filter(|_| self.shooting) else { return entry.clone() };
        if !entry.states.is_empty() {
            // Distances of what remembers are far below the motion: those of the list are for a
            // motion of about one.
            return of_motion(entry, self.size(&moves, false), self.geometry.period_s, memory::settles_in(self));
        }
        let [shape] = &entry.shapes[..] else { return entry.clone() };
        if shape.within.is_none() {
            return entry.clone();
        }
        let rate = kinds::is_rate(entry, 0);
        // What a law of the velocity alone has beside it is no position: a power.
        if !rate && !entry.names("x") {
            return entry.clone();
        }
        let size = self.size(&moves, rate);
        let moved = factor(&shape.grid, size).map(|by| scaled(entry, &[by]));
        reaching(moved.as_ref().unwrap_or(entry), size)
    }

    /// Rms of a joint's position (within a turn where it is an angle), or of its velocity by
    /// differences over five samples.
    fn size(&self, moves: &Polynomial, rate: bool) -> f64 {
        let node = moves.node();
        let turns = self.file().is_some_and(|f| places::is_angle(f, moves));
        let (mut sum, mut count) = (0.0, 0.0_f64);
        for s in &self.raw {
            let at = |i: usize| node.value(&|x| if let Symbol::Coordinate(k) = x { s.coordinates[k][i] } else { 0.0 });
            for i in (0..s.len().saturating_sub(5)).step_by(5) {
                let x = match (rate, turns) {
                    (true, _) => (at(i + 5) - at(i)) / (5.0 * s.step_s),
                    (false, true) => wrapped(at(i)),
                    (false, false) => at(i),
                };
                sum += x * x;
                count += 1.0;
            }
        }
        (sum / count.max(1.0)).sqrt()
    }
}

/// What a grid is multiplied by for a motion of a size: none where it holds that size well inside,
/// or where its values are of both signs or zero, and so are no size.
fn factor(grid: &[f64], size: f64) -> Option<f64> {
    let (low, high) = grid.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), x| (l.min(*x), h.max(*x)));
    let is_size = low > 0.0 && high.is_finite() && size > 0.0 && size.is_finite();
    (is_size && !(2.0 * low..0.5 * high).contains(&size)).then(|| size / (low * high).sqrt())
}

/// How far beside the motion's size a shape that is a size may be refined, as a factor (by hand).
const REACH: f64 = 1000.0;

/// An entry whose bounds hold a thousandth and a thousand times the motion's size, where its shapes
/// are sizes.
fn reaching(entry: &Arc<Entry>, size: f64) -> Arc<Entry> {
    let mut out = (**entry).clone();
    let is_size = |s: &Shape| s.grid.iter().all(|x| *x > 0.0) && size > 0.0 && size.is_finite();
    for shape in out.shapes.iter_mut().filter(|s| is_size(s)) {
        shape.within = shape.within.map(|[low, high]| [low.min(size / REACH), high.max(REACH * size)]);
    }
    Arc::new(out)
}

/// An entry with its shapes' values and bounds multiplied.
fn scaled(entry: &Arc<Entry>, by: &[f64]) -> Arc<Entry> {
    let mut out = (**entry).clone();
    for (shape, by) in out.shapes.iter_mut().zip(by) {
        shape.grid.iter_mut().for_each(|x| *x *= by);
        shape.within = shape.within.map(|w| w.map(|x| x * by));
    }
    Arc::new(out)
}

/// An entry of a force that remembers for motions of another size and period (s), its shapes
/// multiplied by the powers of those that they have; the entry itself where its laws have no such
/// powers. A time may be refined down to that in which a state has to settle.
fn of_motion(entry: &Arc<Entry>, size: f64, period_s: f64, settles_s: f64) -> Arc<Entry> {
    // Those of the list are for a motion of about one.
    let beside = |x: f64| if (0.1..10.0).contains(&x) || !(x > 0.0 && x.is_finite()) { 1.0 } else { x };
    let (Some(lengths), Some(times)) = (powers(entry, Dimension::Length), powers(entry, Dimension::Time)) else {
        return entry.clone();
    };
    let (size, period) = (beside(size), beside(period_s));
    let by: Vec<f64> = lengths.iter().zip(&times).map(|(l, t)| size.powi(*l) * period.powi(*t)).collect();
    let mut out = (*scaled(entry, &by)).clone();
    for (shape, _) in out.shapes.iter_mut().zip(&times).filter(|(_, t)| **t == 1) {
        shape.within = shape.within.map(|[_, high]| [settles_s, high.max(settles_s)]);
    }
    Arc::new(out)
}

/// What a law is the same for more of.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Dimension {
    /// Positions and velocities grow.
    Length,
    /// Velocities shrink, and rates of states beside them.
    Time,
}

/// Powers of a length or a time in the shapes of a force that remembers: those by which the laws of
/// its states are the same for a motion twice as large or as slow, a state being a length or a
/// number. Frequencies that come from lines have none.
fn powers(entry: &Entry, of: Dimension) -> Option<Vec<i32>> {
    let form = entry.forms().into_iter().next()?;
    let words = stand_ins(&["x", "v"]);
    let (shapes, states) = (form.len(), entry.states.len());
    let [of_x, of_v, of_rates] = if of == Dimension::Length { [1, 1, 0] } else { [0, -1, -1] };
    // Within every shape's bounds, and within half a turn; once where a distance just counts.
    let near = 0.083 + 0.6 * form.first()?.1;
    let rates = |by: f64, shape: &[i32], state: &[i32]| -> Option<Vec<f64>> {
        let moved: Form = form.iter().zip(shape).map(|((n, x), p)| (n.clone(), x * by.powi(*p))).collect();
        let value = |s: Symbol, x: f64| match s {
            Symbol::Coordinate(_) => x * by.powi(of_x),
            Symbol::Rate(_) => 0.61 * by.powi(of_v),
            Symbol::State(k) => 0.083 * (k + 1) as f64 * by.powi(*state.get(k).unwrap_or(&0)),
            _ => f64::NAN,
        };
        let of = |p: &Polynomial, x: f64| p.value(&|a| if let Atom::Motion(s) = a { value(*s, x) } else { f64::NAN });
        Some(entry.rates(&words, &moved).ok()?.iter().flat_map(|p| [of(p, 0.37), of(p, near)]).collect())
    };
    let all = |count: usize, from: i32, to: i32| -> Vec<Vec<i32>> {
        (0..count).fold(vec![Vec::new()], |lists, _| {
            lists.iter().flat_map(|l: &Vec<i32>| (from..=to).map(move |p| [&l[..], &[p]].concat())).collect()
        })
    };
    let (by, before) = (2.0_f64, rates(1.0, &vec![0; shapes], &vec![0; states])?);
    let same = |shape: &[i32], state: &[i32]| {
        let after = rates(by, shape, state)?;
        let grown = |p: &i32| by.powi(p + of_rates);
        let alike = |((a, b), p): ((&f64, &f64), &i32)| (a - b * grown(p)).abs() < 1e-9 * a.abs().max(1e-9);
        after.iter().zip(&before).zip(state.iter().flat_map(|p| [p, p])).all(alike).then_some(())
    };
    let states = all(states, 0, i32::from(of == Dimension::Length));
    // Fewest powers first: what has none stays.
    let mut shapes = all(shapes, -1, 1);
    shapes.sort_by_key(|s| s.iter().filter(|p| **p != 0).count());
    shapes.into_iter().find(|shape| states.iter().any(|state| same(shape, state).is_some()))
}

/// Frequencies, Hz, of lines in what is left of a record: of forces, and at which the frame rings.
#[derive(Clone, Debug, Default)]
pub struct Lines {
    /// Those of forces.
    pub of_forces: Vec<f64>,
    /// The frame's.
    pub of_frame: Vec<f64>,
}

/// How far beyond a line its frequency may be refined (by hand).
const BEYOND: f64 = 1.1;

/// An entry whose forms are those of some lines, where it takes them from there.
pub fn with_lines(entry: Arc<Entry>, lines: &Lines) -> Arc<Entry> {
    if entry.shapes.iter().all(|s| !s.of_lines) {
        return entry;
    }
    let lines = if entry.at == At::Frame { &lines.of_frame } else { &lines.of_forces };
    let mut out = (*entry).clone();
    for s in out.shapes.iter_mut().filter(|s| s.of_lines) {
        // Lines of slow or fast systems lie beyond the bounds of what rigs of some seconds have.
        let holding = |[low, high]: [f64; 2], f: &f64| [low.min(f / BEYOND), high.max(f * BEYOND)];
        s.within = s.within.map(|within| lines.iter().fold(within, holding));
        s.grid.clone_from(lines);
    }
    Arc::new(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::catalogue;

    /// A grid's middle is put at the motion's size where that lies outside; a shape that may have
    /// either sign stays as it is written.
    #[test]
    fn a_grid_follows_the_motion_only_where_it_is_a_size() {
        assert_eq!(factor(&[-1.0, 1.0], 30.0), None);
        assert_eq!(factor(&[0.0, 1.0], 30.0), None);
        assert_eq!(factor(&[4.0, 1.0, 2.0], 100.0), Some(50.0));
        assert_eq!(factor(&[1.0, 3.0, 10.0], 4.0), None);
        assert_eq!(factor(&[1.0, 10.0], f64::NAN), None);
    }

    /// Distances grow with the motion, what is one over a distance shrinks, times and ratios stay.
    #[test]
    fn shapes_of_what_remembers_have_the_powers_of_their_units() {
        for (id, wanted) in [
            ("dahl-friction", vec![("d", 1, 0)]),
            ("lugre-friction", vec![("d", 1, 0), ("v_s", 1, -1), ("r", 0, 0)]),
            ("hysteresis", vec![("b", -1, 0), ("c", 0, 0)]),
            ("play", vec![("b", 1, 0)]),
            ("relaxation", vec![("T_r", 0, 1)]),
        ] {
            let entry = catalogue().iter().find(|e| e.id == id).unwrap();
            let found = [Dimension::Length, Dimension::Time].map(|d| powers(entry, d).unwrap());
            for (name, length, time) in wanted {
                let at = entry.shapes.iter().position(|s| s.name == name).unwrap();
                assert_eq!([found[0][at], found[1][at]], [length, time], "{id} {name}: {found:?}");
            }
        }
        // Of a circuit of 120 Hz.
        let relaxation = catalogue().iter().find(|e| e.id == "relaxation").unwrap();
        let fast = of_motion(&Arc::new(relaxation.clone()), 1.0, 0.008, 4e-4);
        assert_eq!(fast.shapes[0].within, Some([4e-4, 0.08]));
        assert!(fast.shapes[0].grid.iter().any(|t| (2e-3..6e-3).contains(t)), "{:?}", fast.shapes[0].grid);
    }
}
