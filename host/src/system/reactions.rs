//! What a joint carries, and the force across it: F = Σ (d²/dt² (m c) − m g) over the carried
//! bodies, c the centroid and g gravity's vector.
//!
//! Which bodies a joint carries follows by virtual displacement: the file is read once more with
//! the joint's point displaced by δ; a body carried by it moves with the point, and with a
//! coordinate that the joint adds (a cart on whose centre a pivot sits moves with the point only:
//! it is on the other side). Where only a share s of δ reaches a body, its reaction enters by s.
//!
//! Forces of `[[force]]` on carried bodies are not in F, nor is what energies written out would
//! add.

use toml::de::DeTable;

use super::bodies::{self, Body};
use super::derivative::{by_time, partial};
use super::joints::Joint;
use super::language::{Gravity, Placed, Reader, SystemFile};
use super::polynomial::{Atom, Polynomial};
use crate::model::model_file::expression::Symbol;

/// Name of the displacement: none that a file could write.
const DISPLACEMENT: &str = "displacement of a point";

/// A body that a joint carries, by its number, and its share of the joint's displacement.
pub type Carried = (usize, Polynomial);

/// Enters what every joint carries; nothing where its point is not named, or where a body would
/// turn with the displacement.
pub fn find(r: &Reader<'_>, top: &DeTable<'_>, bodies: &[Placed<Body>], joints: &mut [Joint]) {
    for joint in joints {
        let Some(shares) = joint.at.as_deref().and_then(|point| shares(r, top, point)) else { continue };
        let added = added(&joint.moves.value, r.words.coordinates.len());
        let all = bodies.iter().zip(shares).enumerate();
        joint.carries = all
            .filter(|(_, (body, share))| !share.is_zero() && depends(&body.value, &added))
            .map(|(k, (_, share))| (k, share))
            .collect();
    }
}

/// What part of a displacement of a point each body's end or centroid has; none where a direction
/// has a part of it.
fn shares(r: &Reader<'_>, top: &DeTable<'_>, point: &str) -> Option<Vec<Polynomial>> {
    let mut words = r.words.clone();
    let displacement = Polynomial::atom(Atom::Parameter(words.parameters.len()));
    words.parameters.push(DISPLACEMENT.to_owned());
    words.points.clear();
    let mut displaced = Reader { words, ..Reader::new(r.source) };
    for (name, _, value) in r.table(top, "points", "").ok()? {
        let mut at = displaced.vector(value).ok()?;
        if name == point {
            at[0] = at[0].plus(&displacement);
        }
        displaced.words.points.push((name.to_owned(), at));
    }
    let slope = |p: &Polynomial| partial(p, &Atom::Parameter(displaced.words.parameters.len() - 1)).ok();
    let of = |body: &Placed<Body>| match &body.value {
        Body::Arm { from, along, .. } => {
            let turns = along.iter().any(|u| slope(u).is_none_or(|s| !s.is_zero()));
            if turns { None } else { slope(from.first()?) }
        }
        Body::Free { centroid: Some(c), .. } => slope(c.first()?),
        Body::Free { .. } => Some(Polynomial::default()),
    };
    bodies::read(&displaced, top).ok()?.iter().map(of).collect()
}

/// Coordinates that a joint adds to what it hangs on: those that let its own grow, all of its own
/// where none does.
fn added(moves: &Polynomial, coordinates: usize) -> Vec<usize> {
    let slope = |k: &usize| partial(moves, &Atom::Motion(Symbol::Coordinate(*k))).ok().and_then(|s| s.as_number());
    let with =
        |wanted: fn(f64) -> bool| -> Vec<usize> { (0..coordinates).filter(|k| slope(k).is_none_or(wanted)).collect() };
    let grows = with(|s| s > 0.0);
    if grows.is_empty() { with(|s| s != 0.0) } else { grows }
}

/// Whether a body moves or turns with some of the coordinates.
fn depends(body: &Body, coordinates: &[usize]) -> bool {
    let has = |p: &Polynomial| p.moves(|s| matches!(s, Symbol::Coordinate(k) if coordinates.contains(&k)));
    match body {
        Body::Arm { from, along, .. } => from.iter().chain(along).any(has),
        Body::Free { centroid, turns, .. } => {
            centroid.iter().flatten().any(has) || turns.as_ref().is_some_and(|(angle, _)| has(angle))
        }
    }
}

impl SystemFile {
    /// Gravity's strength: a parameter, or a constant of the file.
    pub fn gravity_strength(&self) -> Polynomial {
        match self.words.parameters.iter().position(|n| n == "g") {
            Some(k) => Polynomial::atom(Atom::Parameter(k)),
            None => Polynomial::number(self.words.constants.iter().find(|c| c.0 == "g").map_or(0.0, |c| c.1)),
        }
    }

    /// Gravity's vector, m/s², of so many components.
    fn pull(&self, components: usize) -> Vec<Polynomial> {
        let mut out = vec![Polynomial::default(); components];
        match &self.gravity {
            None => {}
            Some(Gravity::Along(v)) => out.clone_from(v),
            Some(Gravity::Down) => {
                if let Some(up) = out.last_mut() {
                    *up = self.gravity_strength().scaled(-1.0);
                }
            }
        }
        out
    }

    /// Components of the force, N, that a joint passes on to what it carries, for a motion in a
    /// plane; `omega` is dτ/dt, rad/s. None where it carries nothing, where a mass is not told (a
    /// first moment alone), or where a kinetic energy beside the bodies' hides one. `mass`: that of
    /// the arm nearest to the joint, kg, where it is another than the system's; its first moment
    /// stays.
    pub fn reaction(&self, joint: usize, omega: f64, mass: Option<f64>) -> Option<Vec<Polynomial>> {
        let carries = &self.joints.get(joint)?.carries;
        if carries.is_empty() || self.kinetic.is_some() {
            return None;
        }
        let (n, pull) = (self.coordinates.len(), self.pull(2));
        let mut out = vec![Polynomial::default(); 2];
        for (k, (body, share)) in carries.iter().enumerate() {
            let other = mass.filter(|_| k == 0).map(Polynomial::number);
            let (mass, moment) = mass_and_moment(&self.bodies.get(*body)?.value, other)?;
            if moment.len() != 2 || pull.len() != 2 {
                return None;
            }
            for ((sum, x), g) in out.iter_mut().zip(&moment).zip(&pull) {
                let inertia = by_time(&by_time(x, n, omega).ok()?, n, omega).ok()?;
                let own = inertia.minus(&mass.times(g).ok()?);
                *sum = sum.plus(&own.times(share).ok()?);
            }
        }
        Some(out)
    }

    /// Components of the momentum, kg m/s, of everything that moves in a plane, as far as its
    /// coordinates move it: what a drive alone moves has the drive's own time. None where a mass or
    /// a kinetic energy hides, as in [`SystemFile::reaction`], or where a measured input moves a
    /// body.
    pub fn momentum(&self, omega: f64) -> Option<Vec<Polynomial>> {
        if self.kinetic.is_some() || self.bodies.is_empty() || self.written {
            return None;
        }
        let n = self.coordinates.len();
        let mut out = vec![Polynomial::default(); 2];
        for body in &self.bodies {
            let moment = moment(&body.value)?;
            if moment.len() != 2 {
                return None;
            }
            for (sum, x) in out.iter_mut().zip(&moment) {
                let rate = by_time(x, n, omega).ok()?;
                for (product, c) in rate.terms() {
                    let term = Polynomial::product(product.clone(), c);
                    if term.moves(|s| matches!(s, Symbol::Rate(_))) {
                        *sum = sum.plus(&term);
                    }
                }
            }
        }
        out.iter().any(|p| !p.is_zero()).then_some(out)
    }
}

/// A body's mass times the position of its centroid, which may lack what does not move with a
/// coordinate: where an arm's end moves with none its mass need not be told.
fn moment(body: &Body) -> Option<Vec<Polynomial>> {
    match body {
        Body::Arm { from, along, mass, first_moment, .. } if mass.is_zero() => {
            let moves = |p: &Polynomial| p.moves(|s| matches!(s, Symbol::Coordinate(_)));
            let turns = || along.iter().map(|u| first_moment.times(u).ok()).collect();
            if from.iter().any(moves) { None } else { turns() }
        }
        _ => mass_and_moment(body, None).map(|found| found.1),
    }
}

/// A body's mass, and its mass times the position of its centroid; `other` in place of an arm's.
fn mass_and_moment(body: &Body, other: Option<Polynomial>) -> Option<(Polynomial, Vec<Polynomial>)> {
    match body {
        Body::Arm { from, along, mass, first_moment, .. } => {
            let mass = other.as_ref().unwrap_or(mass);
            let of = |(o, u): (&Polynomial, &Polynomial)| Some(mass.times(o).ok()?.plus(&first_moment.times(u).ok()?));
            let moment = from.iter().zip(along).map(of).collect::<Option<_>>()?;
            (!mass.is_zero()).then(|| (mass.clone(), moment))
        }
        Body::Free { centroid: Some(c), mass, .. } => {
            let moment = c.iter().map(|x| mass.times(x).ok()).collect::<Option<_>>()?;
            Some((mass.clone(), moment))
        }
        Body::Free { .. } => None,
    }
}

#[cfg(test)]
mod tests {
    use crate::system::library;

    fn carried(system: &str, joint: &str) -> Vec<usize> {
        let model = library::read(system, library::text(system).unwrap()).unwrap().model(None, 1.0).unwrap();
        let file = model.mechanism.unwrap().file.clone().unwrap();
        let joint = file.joints.iter().find(|j| j.name == joint).unwrap();
        assert!(joint.carries.iter().all(|(_, share)| share.as_number() == Some(1.0)));
        joint.carries.iter().map(|c| c.0).collect()
    }

    /// What hangs on a joint, and not what it hangs on.
    #[test]
    fn a_joint_carries_what_hangs_on_it() {
        assert_eq!(carried("double-pendulum", "joint1"), [0, 1]);
        assert_eq!(carried("double-pendulum", "joint2"), [1]);
        assert_eq!(carried("triple-pendulum", "joint2"), [1, 2]);
        assert_eq!(carried("cart-pendulum", "pivot"), [1]);
        assert!(carried("cart-pendulum", "rail").is_empty());
    }

    /// A mass that is not told has no weight that could be counted.
    #[test]
    fn a_first_moment_alone_has_no_reaction() {
        let model = library::read("single-pendulum", library::text("single-pendulum").unwrap()).unwrap();
        assert_eq!(model.joints[0].carries.len(), 1);
        assert!(model.reaction(0, 1.0, None).is_none());
    }
}
