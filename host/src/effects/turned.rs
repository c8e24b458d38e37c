//! What is turned by an angle β: an arm's centroid off its line, gravity in a frame.
//!
//! Strengths enter linearly, a rotation does not: u′ = u cos β + n sin β. About a value β₀ it is
//! taken as u + β (n sin β₀ − u (1 − cos β₀))/β₀, which at β = β₀ is the rotation itself; about
//! none it is u + β n. A fit that renews β₀ as it goes ends at the rotation, and what is known is
//! one. (By β n alone a moment q is fitted as q cos β, and the angle as tan β.)
//!
//! An angle of several strengths is taken to first order.

use super::entry::{Entry, Verb};
use crate::model::model_file::expression::Function;
use crate::system::bodies::Body;
use crate::system::language::{Gravity, Placed, SystemFile};
use crate::system::polynomial::{Atom, Polynomial};

/// Largest angle about which a fit takes what is turned, rad: its steps shrink by √(β tan ½β) or
/// so, and an angle that comes out larger belongs to a moment that is hardly known.
const MOST: f64 = 1.0;

impl Entry {
    /// The same near strengths that a fit found, where they do not enter linearly.
    #[must_use]
    pub fn about_found(&self, strengths: &[f64]) -> Self {
        let near: Vec<f64> = strengths.iter().map(|s| s.clamp(-MOST, MOST)).collect();
        self.about(&near)
    }

    /// The same at strengths that are known.
    #[must_use]
    pub fn about(&self, strengths: &[f64]) -> Self {
        let of = if self.verb == Verb::Turns && strengths.iter().all(|s| s.is_finite()) { strengths } else { &[] };
        Self { about: of.get(..self.strengths.len()).unwrap_or_default().to_vec(), ..self.clone() }
    }
}

/// An angle's sine and 1 − cos as far as they are linear in its strengths, near those of the entry.
#[derive(Clone, Debug)]
pub(super) struct Rotation {
    /// sin β.
    pub sine: Polynomial,
    /// 1 − cos β.
    pub versine: Polynomial,
}

impl Rotation {
    /// Of an angle that is linear in the strengths, the parameters from `own` on.
    pub fn of(entry: &Entry, angle: &Polynomial, own: usize) -> Option<Self> {
        let first_order = || Self { sine: angle.clone(), versine: Polynomial::default() };
        let [near] = entry.about[..] else { return Some(first_order()) };
        if near == 0.0 {
            return Some(first_order());
        }
        let strength = Atom::Parameter(own);
        let per = angle.by_parameters().remove(&vec![(strength.clone(), 1)])?;
        let sine = |of: f64| Polynomial::call(Function::Sin, per.scaled(of));
        // Without the loss of digits of 1 − cos β.
        let versine = sine(0.5 * near).power(2).ok()?.scaled(2.0);
        let by = |p: &Polynomial| p.times(&Polynomial::atom(strength.clone())).ok().map(|p| p.scaled(1.0 / near));
        Some(Self { sine: by(&sine(near))?, versine: by(&versine)? })
    }

    /// A direction in the plane, turned anticlockwise.
    fn turned(&self, along: &[Polynomial]) -> Option<Vec<Polynomial>> {
        let [right, up] = along else { return None };
        let across = [up.scaled(-1.0), right.clone()];
        let of = |(u, n): (&Polynomial, &Polynomial)| {
            Some(u.plus(&n.times(&self.sine).ok()?).minus(&u.times(&self.versine).ok()?))
        };
        along.iter().zip(&across).map(of).collect()
    }

    /// The system with an arm's centroid off its line. Its inertia about the joint stays that of
    /// the line.
    pub fn arm(&self, file: &SystemFile, k: usize) -> Option<SystemFile> {
        let mut out = file.clone();
        let Placed { value: Body::Arm { name, angle, from, along, first_moment, .. }, at } = &mut out.bodies[k] else {
            return None;
        };
        // The first moment apart, or a square of what is linear in strengths would be in the energy.
        let (mass, inertia) = Default::default();
        let moment = core::mem::take(first_moment);
        let (name, angle, from, along) = (name.clone(), angle.clone(), from.clone(), self.turned(along)?);
        let value = Body::Arm { name, angle, from, along, mass, first_moment: moment, inertia };
        let off = Placed { value, at: *at };
        out.bodies.push(off);
        Some(out)
    }

    /// The system with gravity turned so that what hangs does so at the positive angle.
    pub fn frame(&self, file: &SystemFile) -> Option<SystemFile> {
        let mut out = file.clone();
        let components = file.words.points.first().map_or(2, |p| p.1.len());
        let g = file.gravity_strength();
        let mut pull = vec![Polynomial::default(); components];
        pull[0] = g.times(&self.sine).ok()?;
        pull[components - 1] = g.times(&self.versine).ok()?.minus(&g);
        out.gravity = Some(Gravity::Along(pull));
        Some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::super::catalogue;
    use super::*;
    use crate::model::model_file::expression::Symbol;

    /// An angle of one strength is turned by itself at that strength whatever its course.
    #[test]
    fn an_angle_that_changes_with_time_is_turned_by_as_well() {
        let own = 3;
        let angle =
            Polynomial::motion(Symbol::Time).scaled(0.5).times(&Polynomial::atom(Atom::Parameter(own))).unwrap();
        let tilt = catalogue().iter().find(|e| e.id == "frame-tilt").unwrap();
        for (near, strength, of) in [(0.3, 0.3, 0.3), (0.0, 0.3, 0.0), (1e-9, 1e-9, 1e-9)] {
            let by = Rotation::of(&tilt.about(&[near]), &angle, own).unwrap();
            for t in [-2.0, 0.0, 1.7] {
                let value = |p: &Polynomial| p.value(&|a| if *a == Atom::Parameter(own) { strength } else { t });
                let beta = 0.5 * t * of;
                let wanted = if near == 0.0 { [0.5 * t * strength, 0.0] } else { [beta.sin(), 1.0 - beta.cos()] };
                let found = [value(&by.sine), value(&by.versine)];
                assert!(
                    found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-15),
                    "{near} {t}: {found:?} {wanted:?}"
                );
            }
        }
    }

    /// A fit does not step about angles from which its steps would not come back.
    #[test]
    fn large_angles_are_kept_to_those_a_fit_can_follow_and_known_ones_are_not() {
        let tilt = catalogue().iter().find(|e| e.id == "frame-tilt").unwrap();
        assert_eq!((tilt.about_found(&[7.0]).about, tilt.about(&[2.0]).about), (vec![MOST], vec![2.0]));
        assert_eq!(tilt.about(&[f64::NAN]).about, tilt.about);
        let drag = catalogue().iter().find(|e| e.id == "quadratic-drag").unwrap();
        assert_eq!(drag.about(&[2.0]), *drag);
    }
}
