//! The force across a joint of written equations, of arms that turn in a plane.
//!
//! Equations do not hold it, but what it is made of. Gravity's torque on the arm of φ_e is
//! g S_e sin φ_e, so S_e is the first moment of all that turns with it, and the torque by which the
//! joint's own acceleration turns that arm, S_e l_a (cos φ_e, sin φ_e) · a, tells where the joint
//! is: at Σ l_a (sin φ_a, −cos φ_a). With C what hangs on the joint and m its mass, which no
//! equation tells,
//!
//! F = Σ_C d²/dt² S_e (sin φ_e, −cos φ_e) + m (a_joint + (ẍ_b, ÿ_b) + (0, g)).
//!
//! Everything is in the terms of D_e F_e (see [`super::inertias()`]), so that F times a length is a
//! torque there.

use core::f64::consts::FRAC_PI_2;

use super::left_hand_sides::{STATES, at_rest, of_angles, sides, value};
use super::{Inertias, inertias, told_by};
use crate::model::model_file::expression::{
    Function, Node, Symbol, add, as_number, call, multiply, number, power_whole, symbol,
};
use crate::model::model_file::{ModelFile, Space};
use crate::rig::{Direction, GRAVITY};
use crate::system::derivative::partial;
use crate::system::joints::Joint;
use crate::system::polynomial::Atom;

/// Share of an arm's first moment by which gravity's torque may differ from g S sin φ: rounding.
const UNEVEN: f64 = 1e-6;

/// A joint that arms hang on, by coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Hung {
    /// The nearest arm.
    nearest: usize,
    /// All arms.
    carried: Vec<usize>,
    /// ∂x/∂q of the joint, where it is not nothing.
    slopes: Vec<(usize, f64)>,
}

/// What hangs on a joint that the file names: the arm whose angle it adds, and what hangs on that;
/// none where its coordinate is no difference of two arms' angles, or none alone.
pub fn hung(joints: &[Joint], joint: usize, coordinates: usize) -> Option<Hung> {
    // A joint that the file names stands somewhere in it.
    let moves = |j: &Joint| -> Option<Vec<(usize, f64)>> {
        let slope = |k: usize| partial(&j.moves.value, &Atom::Motion(Symbol::Coordinate(k))).ok()?.as_number();
        let all = (0..coordinates).map(|k| Some((k, slope(k)?))).collect::<Option<Vec<_>>>()?;
        let all: Vec<_> = all.into_iter().filter(|s| s.1 != 0.0).collect();
        let ones = |wanted: f64| all.iter().filter(|s| s.1 == wanted).count();
        (j.moves.at > 0 && ones(1.0) == 1 && ones(1.0) + ones(-1.0) == all.len() && all.len() < 3).then_some(all)
    };
    let slopes = moves(joints.get(joint)?)?;
    let nearest = slopes.iter().find(|s| s.1 > 0.0)?.0;
    let all: Vec<_> = joints.iter().filter_map(moves).collect();
    let mut carried = vec![nearest];
    let mut next = 0;
    while let Some(&arm) = carried.get(next) {
        next += 1;
        for further in all.iter().filter(|s| s.contains(&(arm, -1.0))) {
            let hangs = further.iter().filter(|s| s.1 > 0.0).map(|s| s.0);
            let new: Vec<usize> = hangs.filter(|k| !carried.contains(k)).collect();
            carried.extend(new);
        }
    }
    carried.sort_unstable();
    Some(Hung { nearest, carried, slopes })
}

/// What written equations tell of a joint's load.
struct Told {
    /// D_e.
    scales: Vec<f64>,
    /// First moments S_e of the carried arms.
    moments: Vec<(usize, f64)>,
    /// Inertia of the nearest arm about the joint.
    inertia: f64,
    /// Components right and up of the joint's acceleration by what moves it, without the base's.
    joint: [Node; 2],
    /// The same of the base.
    base: [Node; 2],
}

/// Equations at values of their coefficients.
pub struct Equations<'a> {
    /// The model.
    pub model: &'a ModelFile,
    /// Where the drive moves the base.
    pub direction: Option<Direction>,
    /// dτ/dt, rad/s.
    pub omega: f64,
    /// Values in the order of [`ModelFile::coefficients`].
    pub values: &'a [f64],
}

impl Equations<'_> {
    /// What each equation gains from a law of the load ([`Symbol::State`] 0 in it) that does work
    /// on the joint's coordinate, of a mass in units of the nearest arm's own inertia.
    pub fn columns(&self, at: &Hung, mass: f64, law: &Node) -> Option<Vec<(usize, Node)>> {
        let told = self.told(at)?;
        let unit = told_by(self.model, self.omega, at.nearest, &told.scales);
        let load = told.load(mass / unit);
        let law = law.replace(&|s| if matches!(s, Symbol::State(0)) { load.clone() } else { symbol(s) });
        Some(at.slopes.iter().map(|&(e, s)| (e, multiply(number(-s / told.scales[e]), law.clone()))).collect())
    }

    /// The least mass that may hang on the joint, in units of the nearest arm's own inertia: J ≥
    /// S²/m, whatever the arms look like.
    pub fn least_mass(&self, at: &Hung) -> Option<f64> {
        let told = self.told(at)?;
        let unit = told_by(self.model, self.omega, at.nearest, &told.scales);
        let moment = told.moments.iter().find(|m| m.0 == at.nearest)?.1;
        Some(moment * moment / told.inertia * unit).filter(|m| *m > 0.0 && m.is_finite())
    }

    fn told(&self, at: &Hung) -> Option<Told> {
        let model = self.model;
        // A base whose motion is measured is in no drive's phase.
        if !model.inputs.is_empty() || model.coordinates.iter().any(|c| c.space != Space::Circle) {
            return None;
        }
        let Inertias { scales, .. } = inertias(model, self.omega, self.values)?;
        let rest = at_rest(model, self.omega, self.values);
        let moments = at.carried.iter().map(|&e| Some((e, first_moment(&rest[e][0], e, scales[e])?)));
        let moments = moments.collect::<Option<Vec<_>>>()?;
        let all = sides(model, self.omega, self.values);
        let of = |e: usize, a: usize| all[e].derivative_between_jumps(Symbol::Acceleration(a));
        let e = at.nearest;
        let own = moments.iter().find(|m| m.0 == e)?.1;
        let inertia = scales[e] * value(&of(e, e)?, 0, 0.0);
        let mut joint = [number(0.0), number(0.0)];
        let n = model.coordinates.len();
        for a in (0..n).filter(|a| !at.carried.contains(a)) {
            let coupling = multiply(number(scales[e] / own), of(e, a)?);
            // The arm's centroid moves by S (cos φ, sin φ): at 0 to the right, at a quarter turn up.
            for (sum, angle) in joint.iter_mut().zip([0.0, FRAC_PI_2]) {
                *sum = add(sum.clone(), acceleration(&at_angle(&coupling, e, angle), a, n)?);
            }
        }
        let base = self.base(&rest[e], e);
        Some(Told { scales, moments, inertia, joint, base })
    }

    /// The base's acceleration by what it does to an arm as gravity does, turned where it moves
    /// sideways.
    fn base(&self, [still, driven]: &[Node; 2], arm: usize) -> [Node; 2] {
        let still = of_angles(still);
        let sideways = self.direction == Some(Direction::Horizontal);
        let as_driven = if sideways { turned(&still, arm) } else { still };
        let square: f64 = (0..STATES).map(|s| value(&as_driven, s, 0.0).powi(2)).sum();
        let at = |tau: f64| (0..STATES).map(|s| value(&as_driven, s, 0.0) * value(driven, s, tau)).sum::<f64>();
        let share = |tau: f64| GRAVITY * at(tau) / square;
        let wave = |f, amplitude| multiply(number(amplitude), call(f, symbol(Symbol::Tau)));
        let moves = add(wave(Function::Cos, share(0.0)), wave(Function::Sin, share(FRAC_PI_2)));
        if sideways { [moves, number(0.0)] } else { [number(0.0), moves] }
    }
}

impl Told {
    /// √(F_x² + F_y²) for a mass.
    fn load(&self, mass: f64) -> Node {
        let [right, up] = [Function::Cos, Function::Sin].map(|way| {
            let weight = if way == Function::Sin { number(GRAVITY) } else { number(0.0) };
            let k = usize::from(way == Function::Sin);
            let end = add(add(self.joint[k].clone(), self.base[k].clone()), weight);
            let turns = self.moments.iter().map(|&(e, moment)| {
                let phi = || symbol(Symbol::Coordinate(e));
                let slope = if way == Function::Cos {
                    multiply(number(-1.0), call(Function::Sin, phi()))
                } else {
                    call(Function::Cos, phi())
                };
                let rates = power_whole(symbol(Symbol::Rate(e)), 2);
                let own = add(multiply(call(way, phi()), symbol(Symbol::Acceleration(e))), multiply(slope, rates));
                multiply(number(moment), own)
            });
            power_whole(turns.fold(multiply(number(mass), end), add), 2)
        });
        call(Function::Sqrt, add(right, up))
    }
}

/// S of D ∂V/∂φ = g S sin φ; none where that is not the arm's torque at rest, as where angles are
/// counted from the arm before.
fn first_moment(still: &Node, arm: usize, scale: f64) -> Option<f64> {
    let still = of_angles(still);
    let quarter = at_angle(&still, arm, FRAC_PI_2);
    let moment = scale * as_number(&quarter).unwrap_or_else(|| value(&quarter, 0, 0.0)) / GRAVITY;
    let even = |s: u32| {
        let phi = value(&symbol(Symbol::Coordinate(arm)), s, 0.0);
        (scale * value(&still, s, 0.0) / GRAVITY - moment * phi.sin()).abs() <= UNEVEN * moment.abs()
    };
    (moment > 0.0 && (0..STATES).all(even)).then_some(moment)
}

/// d/dt (L q̇_a), L of `n` coordinates alone.
fn acceleration(l: &Node, a: usize, n: usize) -> Option<Node> {
    let rate = |k: usize| symbol(Symbol::Rate(k));
    (0..n).try_fold(multiply(l.clone(), symbol(Symbol::Acceleration(a))), |sum, k| {
        let slope = l.derivative_between_jumps(Symbol::Coordinate(k))?;
        Some(add(sum, multiply(slope, multiply(rate(k), rate(a)))))
    })
}

fn at_angle(n: &Node, arm: usize, angle: f64) -> Node {
    n.replace(&|s| if s == Symbol::Coordinate(arm) { number(angle) } else { symbol(s) })
}

fn turned(n: &Node, arm: usize) -> Node {
    let by = add(symbol(Symbol::Coordinate(arm)), number(FRAC_PI_2));
    n.replace(&|s| if s == Symbol::Coordinate(arm) { by.clone() } else { symbol(s) })
}
