//! Accelerations of both arms for a given state of the dry friction.
//!
//! With M = [J_o1, H cos Δ; H cos Δ, J_o2] and dry torques f1, f2 in the joints,
//! `M α = q + (f1 − f2, f2)`: where a joint slips its f is known and α follows; where it sticks its
//! relative acceleration is zero and f follows. Gravity and base enter through the apparent gravity
//! γ = g − (ẍ_b, ÿ_b): a mass moment S at angle φ has the torque S γ·(cos φ, sin φ).

use super::State;
use super::contact::{Dry, Mode};
use super::laws::{Additions, JointLaw};
use super::parameters::{ParameterError, Parameters};
use crate::shaker::{BaseMotion, Moment};

/// Parameters and effects, ready for evaluation.
#[derive(Clone, Debug)]
pub(super) struct Mechanics {
    pub(super) joints: [JointLaw; 2],
    pub(super) drag: [f64; 2],
    air: [Vec<(f64, f64)>; 2],
    /// Corners of each joint's torque inside (−π, π).
    pub(super) corners: [Vec<f64>; 2],
    parameters: Parameters,
    h: f64,
    /// cos and sin of each arm's imbalance.
    imbalance: [[f64; 2]; 2],
    gravity: [f64; 2],
    loaded: bool,
}

/// Accelerations and what goes with them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Forces {
    /// φ̈1, φ̈2, rad/s².
    pub(super) alpha: [f64; 2],
    /// Dry friction torque in each joint, N m.
    pub(super) dry: [f64; 2],
    /// Radial force in each joint, N (0 where no law needs it).
    pub(super) load: [f64; 2],
    /// Part of each joint's level of dry friction that depends on its angle, N m.
    pub(super) ripple: [f64; 2],
    /// Share of the record that has passed.
    pub(super) share: f64,
}

/// Sines and cosines of one state.
struct Geometry {
    /// (cos, sin) of φ1, φ2.
    arm: [[f64; 2]; 2],
    /// The same of the arms' centroids.
    centroid: [[f64; 2]; 2],
    cos_delta: f64,
    sin_delta: f64,
}

/// ∫ v |v| ds and ∫ v |v| s ds for v = v0 + w s from 0 to a length: by Simpson's rule on either
/// side of v = 0, where it is exact.
fn moments(v0: f64, w: f64, length: f64) -> [f64; 2] {
    let still = -v0 / w;
    let middle = if still > 0.0 && still < length { still } else { length };
    let mut sums = [0.0; 2];
    for (from, to) in [(0.0, middle), (middle, length)] {
        let at = |s: f64| {
            let v = v0 + w * s;
            [v * v.abs(), v * v.abs() * s]
        };
        let (a, b, c) = (at(from), at(0.5 * (from + to)), at(to));
        for (k, sum) in sums.iter_mut().enumerate() {
            *sum += (to - from) / 6.0 * (a[k] + 4.0 * b[k] + c[k]);
        }
    }
    sums
}

/// (cos, sin) of the sum of two angles.
fn turned(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[1] * b[0] + a[0] * b[1]]
}

impl Mechanics {
    pub(super) fn new(parameters: &Parameters, additions: &Additions) -> Self {
        let mut joints = additions.joints.clone();
        joints[0].level = joints[0].level.map(|level| level + parameters.tau_c1);
        joints[1].viscous += parameters.c_r2;
        let (sin, cos) = libm::sincos(additions.tilt);
        Self {
            corners: [joints[0].corners(), joints[1].corners()],
            loaded: joints.iter().any(|j| j.per_load != 0.0),
            joints,
            drag: additions.drag,
            air: additions.air.clone(),
            parameters: *parameters,
            h: parameters.h(),
            imbalance: additions.imbalance.map(|beta| {
                let (sin, cos) = libm::sincos(beta);
                [cos, sin]
            }),
            gravity: [parameters.g * sin, -parameters.g * cos],
        }
    }

    /// Refuses dry friction that would push.
    pub(super) fn validate(&self) -> Result<(), ParameterError> {
        for (i, joint) in self.joints.iter().enumerate() {
            let at_rest: f64 = joint.stribeck.iter().map(|s| s.0).sum();
            for level in joint.level {
                let ripple: f64 = joint.ripple.iter().map(|r| r.0.abs()).sum();
                let least = level.min(level + at_rest) + joint.drift.min(0.0) - ripple;
                if !(least >= 0.0 && least.is_finite()) {
                    let name = format!("dry friction in joint {}", i + 1);
                    return Err(ParameterError::new(&name, least, "a level of 0 or more in both directions"));
                }
            }
        }
        Ok(())
    }

    fn geometry(&self, y: &State) -> Geometry {
        let (s1, c1) = libm::sincos(y[0]);
        let (s2, c2) = libm::sincos(y[1]);
        let arm = [[c1, s1], [c2, s2]];
        let centroid = [turned(arm[0], self.imbalance[0]), turned(arm[1], self.imbalance[1])];
        let [c2, s2] = centroid[1];
        Geometry { arm, centroid, cos_delta: c1 * c2 + s1 * s2, sin_delta: s2 * c1 - c2 * s1 }
    }

    /// The base at t seconds after the tick, as far as laws need it.
    pub(super) fn moment(&self, base: &BaseMotion, t: f64) -> Moment {
        base.at(t, self.air.iter().any(|a| !a.is_empty()))
    }

    /// Accelerations at a state, on a base that moves so (or has this acceleration (ẍ_b, ÿ_b) in
    /// m/s²).
    pub(super) fn forces(&self, base: impl Into<Moment>, y: &State, mode: &Mode) -> Forces {
        let p = &self.parameters;
        let moment: Moment = base.into();
        let base = moment.acceleration;
        let geometry = self.geometry(y);
        let (w1, w2) = (y[2], y[3]);
        let gamma = [self.gravity[0] - base[0], self.gravity[1] - base[1]];
        let along = |[cos, sin]: [f64; 2]| gamma[0] * cos + gamma[1] * sin;
        let x1 = y[0] - mode.turn[0];
        let x2 = y[1] - y[0] - mode.turn[1];
        let v = [w1, w2 - w1];
        let mut t1 = self.joints[0].smooth(x1, mode.middle[0], v[0], &moment);
        let mut t2 = self.joints[1].smooth(x2, mode.middle[1], v[1], &moment);
        t1 += mode.since[0].torque(&self.joints[0].memories, y[0], v[0]);
        t2 += mode.since[1].torque(&self.joints[1].memories, y[1] - y[0], v[1]);
        let mut q1 = t1 - t2 + self.h * w2 * w2 * geometry.sin_delta;
        q1 += p.m1 * p.e1 * along(geometry.centroid[0]) + p.m2 * p.l1 * along(geometry.arm[0]);
        q1 -= self.drag[0] * mode.drag_sign[0] * w1 * w1;
        let mut q2 = t2 - self.h * w1 * w1 * geometry.sin_delta;
        q2 += p.m2 * p.e2 * along(geometry.centroid[1]);
        q2 -= self.drag[1] * mode.drag_sign[1] * w2 * w2;

        let [a1, a2] = self.air_torques(&geometry, moment.velocity, y);
        (q1, q2) = (q1 + a1, q2 + a2);

        let coupling = self.h * geometry.cos_delta;
        let ripple = [self.joints[0].ripple_at(x1), self.joints[1].ripple_at(x2)];
        let mut forces = Forces { share: moment.share, ripple, ..Forces::default() };
        self.solve(coupling, [q1, q2], &v, mode, &mut forces);
        if self.loaded {
            // Friction depends on the load, the load on the acceleration: a contraction, since the
            // radius at which friction acts is far smaller than an arm. Where it is not one, the
            // bound ends it.
            for _ in 0..60 {
                let load = self.loads(gamma, &geometry, y, forces.alpha);
                let change = (load[0] - forces.load[0]).abs() + (load[1] - forces.load[1]).abs();
                forces.load = load;
                self.solve(coupling, [q1, q2], &v, mode, &mut forces);
                if change <= 1e-14 * (load[0] + load[1]) {
                    break;
                }
            }
        }
        forces
    }

    /// Solves for accelerations and the dry torques of sticking joints, at the loads in `forces`.
    fn solve(&self, coupling: f64, q: [f64; 2], v: &[f64; 2], mode: &Mode, forces: &mut Forces) {
        let (j1, j2) = (self.parameters.j_o1, self.parameters.j_o2);
        let slip = |i: usize, forces: &Forces| match mode.dry[i] {
            Some(Dry::Slip(sign)) => {
                -sign * self.joints[i].dry_level(sign, v[i], forces.load[i], forces.share, forces.ripple[i])
            }
            _ => 0.0,
        };
        let stuck = |i: usize| mode.dry[i] == Some(Dry::Stick);
        match (stuck(0), stuck(1)) {
            (false, false) => {
                let (f1, f2) = (slip(0, forces), slip(1, forces));
                let (r1, r2) = (q[0] + f1 - f2, q[1] + f2);
                let determinant = j1 * j2 - coupling * coupling;
                forces.alpha = [(j2 * r1 - coupling * r2) / determinant, (j1 * r2 - coupling * r1) / determinant];
                forces.dry = [f1, f2];
            }
            (true, false) => {
                let f2 = slip(1, forces);
                let a2 = (q[1] + f2) / j2;
                forces.alpha = [0.0, a2];
                forces.dry = [coupling * a2 - q[0] + f2, f2];
            }
            (false, true) => {
                let f1 = slip(0, forces);
                let a = (q[0] + q[1] + f1) / (j1 + j2 + 2.0 * coupling);
                forces.alpha = [a, a];
                forces.dry = [f1, (coupling + j2) * a - q[1]];
            }
            (true, true) => {
                forces.alpha = [0.0, 0.0];
                forces.dry = [-q[0] - q[1], -q[1]];
            }
        }
    }

    /// Torques of the drag along the arms: at distance s from its joint an arm moves across itself
    /// by v(s) = v(0) + ω s and feels −k v |v| a length, whose work on arm 2 is work on arm 1 as
    /// well, l1 cos Δ for a turn of one.
    fn air_torques(&self, geometry: &Geometry, base: [f64; 2], y: &State) -> [f64; 2] {
        let mut torques = [0.0; 2];
        let across = |[cos, sin]: [f64; 2]| base[0] * cos + base[1] * sin;
        let l1 = self.parameters.l1;
        let [[c1, s1], [c2, s2]] = geometry.arm;
        let lever = l1 * (c1 * c2 + s1 * s2);
        for &(k, length) in &self.air[0] {
            torques[0] -= k * moments(across(geometry.arm[0]), y[2], length)[1];
        }
        for &(k, length) in &self.air[1] {
            let [force, torque] = moments(across(geometry.arm[1]) + lever * y[2], y[3], length);
            torques[0] -= k * lever * force;
            torques[1] -= k * torque;
        }
        torques
    }

    /// Size of the force in each joint across its axis, N: what the arms below need to be moved as
    /// they are.
    fn loads(&self, gamma: [f64; 2], geometry: &Geometry, y: &State, alpha: [f64; 2]) -> [f64; 2] {
        let p = &self.parameters;
        // Acceleration of a point at distance r on a line at (cos, sin): r (α t − ω² n), t = (cos,
        // sin), n = (sin, −cos).
        let point = |r: f64, [cos, sin]: [f64; 2], alpha: f64, w: f64| {
            [r * (alpha * cos - w * w * sin), r * (alpha * sin + w * w * cos)]
        };
        let c1 = point(p.e1, geometry.centroid[0], alpha[0], y[2]);
        let joint2 = point(p.l1, geometry.arm[0], alpha[0], y[2]);
        let c2 = point(p.e2, geometry.centroid[1], alpha[1], y[3]);
        let f2 = [p.m2 * (joint2[0] + c2[0] - gamma[0]), p.m2 * (joint2[1] + c2[1] - gamma[1])];
        let f1 = [p.m1 * (c1[0] - gamma[0]) + f2[0], p.m1 * (c1[1] - gamma[1]) + f2[1]];
        [(f1[0] * f1[0] + f1[1] * f1[1]).sqrt(), (f2[0] * f2[0] + f2[1] * f2[1]).sqrt()]
    }

    /// Kinetic energy and potential energy of gravity, J.
    pub(super) fn energy(&self, y: &State) -> f64 {
        let p = &self.parameters;
        let geometry = self.geometry(y);
        // Height above the joint, measured along −gravity, of a mass moment at (cos, sin): −γ·n.
        let potential = |[cos, sin]: [f64; 2]| -(self.gravity[0] * sin - self.gravity[1] * cos);
        0.5 * p.j_o1 * y[2] * y[2]
            + 0.5 * p.j_o2 * y[3] * y[3]
            + self.h * y[2] * y[3] * geometry.cos_delta
            + p.m1 * p.e1 * potential(geometry.centroid[0])
            + p.m2 * p.l1 * potential(geometry.arm[0])
            + p.m2 * p.e2 * potential(geometry.centroid[1])
    }
}
