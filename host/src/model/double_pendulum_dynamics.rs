//! The double pendulum's equations of motion compiled by hand, with analytic partial derivatives.
//!
//! What [`super::model_file::equations_of_motion`] evaluates from the same equations written out,
//! at 0.4 of its time: shooting over 60 s of the shipped rig takes 0.45 s of processor for 1.0 s. A
//! test of [`crate::identify::built_in`] holds both equal.
//!
//! (3.4) in time: with s_i the sign of joint i's relative velocity, Δ = φ2 − φ1, c = cos Δ,
//!
//! φ̈1 + B11 c φ̈2 = B11 φ̇2² sin Δ − Ω² (B12 + B13 cos τ + B14 sin τ) sin φ1 − Ω² C11 s1 + Ω C12
//! (φ̇2 − φ̇1) − Ω C13 φ̇1 + Ω² C14 s2
//!
//! B21 c φ̈1 + φ̈2 = −B21 φ̇1² sin Δ − Ω² (B22 + B23 cos τ + B24 sin τ) sin φ2 − Ω C2 (φ̇2 − φ̇1) −
//! Ω² C4 s2
//!
//! Coordinates φ1, φ2 (rad, absolute); parameters in the order of [`coefficients`]: B11 B12 [B13
//! B14], dampings of the first equation, B21 B22 [B23 B24], dampings of the second. With M a = r,
//! ∂a = M⁻¹ (∂r − ∂M a).
//!
//! Limits: no accelerations where B11 B21 cos² Δ ≥ 1, which no two rigid arms have.

use super::damping::Damping;
use super::double_pendulum::{Base, coefficients};
use super::dynamics::{Dynamics, Here, Linearisation, Switch};
use crate::signal::sin_cos::four;

/// Roles of parameters within an equation: coupling B_i1, gravity B_i2, base motion B_i3 (cosine)
/// and B_i4 (sine), viscous friction of joints 1 and 2, Coulomb friction of joints 1 and 2.
const ROLES: usize = 8;
const COUPLING: usize = 0;
const GRAVITY: usize = 1;
const COSINE: usize = 2;
const SINE: usize = 3;
const VISCOUS: usize = 4;
const COULOMB: usize = 6;

/// The double pendulum's equations of motion.
#[derive(Clone, Debug)]
pub struct DoublePendulum {
    omega: f64,
    /// Equation and role of each parameter.
    roles: Vec<(usize, usize)>,
    /// Which parameter has a role in an equation; beyond all parameters where none has.
    slots: [[usize; ROLES]; 2],
    names: Vec<String>,
    switches: Vec<Switch>,
    /// Joint of each switch.
    joints: Vec<usize>,
}

/// Velocities, sines and cosines at a state.
struct State {
    sin: [f64; 2],
    cos: [f64; 2],
    sin_delta: f64,
    cos_delta: f64,
    cos_tau: f64,
    sin_tau: f64,
    v: [f64; 2],
    /// Signs of the joints' relative velocities.
    signs: [f64; 2],
}

/// Mass matrix' off-diagonal terms, right-hand side, one over the determinant.
struct LinearSystem {
    m: [f64; 2],
    right: [f64; 2],
    reciprocal: f64,
}

impl LinearSystem {
    fn solve(&self, r: [f64; 2]) -> [f64; 2] {
        [(r[0] - self.m[0] * r[1]) * self.reciprocal, (r[1] - self.m[1] * r[0]) * self.reciprocal]
    }
}

impl DoublePendulum {
    /// The equations at angular frequency `omega` (rad/s; 1 for a free system, `driven` false then)
    /// with these dampings.
    pub fn new(omega: f64, driven: bool, dampings: &[&Damping]) -> Self {
        let (mut roles, mut names) = (Vec::new(), Vec::new());
        for (i, equation) in
            coefficients(if driven { Base::Driven } else { Base::Resting }, dampings).into_iter().enumerate()
        {
            for name in equation {
                let damping = dampings.iter().find(|d| d.names[i] == Some(name.as_str()));
                let role = match (damping, name.as_bytes().last()) {
                    (Some(d), _) => {
                        let joint = usize::from(d.id.ends_with("joint2"));
                        if d.viscous { VISCOUS + joint } else { COULOMB + joint }
                    }
                    (None, Some(b'1')) => COUPLING,
                    (None, Some(b'2')) => GRAVITY,
                    (None, Some(b'3')) => COSINE,
                    (None, _) => SINE,
                };
                roles.push((i, role));
                names.push(name);
            }
        }
        let slot = |i: usize, role: usize| roles.iter().position(|r| *r == (i, role)).unwrap_or(usize::MAX);
        let slots = core::array::from_fn(|i| core::array::from_fn(|role| slot(i, role)));
        let joints: Vec<usize> = (0..2).filter(|j| roles.iter().any(|r| r.1 == COULOMB + *j)).collect();
        let weights = |j: &usize| if *j == 0 { vec![1.0, 0.0] } else { vec![-1.0, 1.0] };
        let switches = joints.iter().map(|j| Switch::of_rates(weights(j))).collect();
        Self { omega, roles, slots, names, switches, joints }
    }

    /// Names of the parameters.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    fn state(&self, Here { q, v, at, signs, .. }: Here<'_>) -> State {
        let ([sin1, sin2, sin_tau, _], [cos1, cos2, cos_tau, _]) = four([q[0], q[1], at.tau, 0.0]);
        State {
            sin: [sin1, sin2],
            cos: [cos1, cos2],
            sin_delta: sin2 * cos1 - cos2 * sin1,
            cos_delta: cos2 * cos1 + sin2 * sin1,
            cos_tau,
            sin_tau,
            v: [v[0], v[1]],
            signs: self.held(signs),
        }
    }

    /// Signs of the switches by joint; 0 for one without.
    fn held(&self, given: &[f64]) -> [f64; 2] {
        let mut out = [0.0; 2];
        for (j, s) in self.joints.iter().zip(given) {
            out[*j] = *s;
        }
        out
    }

    /// ∂r/∂p by equation and role: what each parameter multiplies on the right-hand side.
    #[inline]
    fn columns(&self, s: &State) -> [[f64; ROLES]; 2] {
        let (first, second) = (self.omega, self.omega * self.omega);
        let relative = s.v[1] - s.v[0];
        core::array::from_fn(|i| {
            let other = s.v[1 - i];
            let sine = -second * s.sin[i];
            // A torque in joint 2 acts on both arms with opposite signs.
            let side = if i == 0 { 1.0 } else { -1.0 };
            [
                side * other * other * s.sin_delta,
                sine,
                sine * s.cos_tau,
                sine * s.sin_tau,
                -first * s.v[0],
                side * first * relative,
                -second * s.signs[0],
                side * second * s.signs[1],
            ]
        })
    }

    /// The parameters by equation and role; those that the model has not are zero.
    #[inline]
    fn values(&self, p: &[f64]) -> [[f64; ROLES]; 2] {
        core::array::from_fn(|i| core::array::from_fn(|role| p.get(self.slots[i][role]).copied().unwrap_or(0.0)))
    }

    #[inline]
    fn system(values: &[[f64; ROLES]; 2], columns: &[[f64; ROLES]; 2], s: &State) -> LinearSystem {
        let right = core::array::from_fn(|i| values[i].iter().zip(&columns[i]).map(|(p, c)| p * c).sum::<f64>());
        let m = [values[0][COUPLING] * s.cos_delta, values[1][COUPLING] * s.cos_delta];
        LinearSystem { m, right, reciprocal: 1.0 / (1.0 - m[0] * m[1]) }
    }

    fn evaluate(&self, p: &[f64], s: &State, out: &mut [f64]) -> bool {
        let system = Self::system(&self.values(p), &self.columns(s), s);
        out[..2].copy_from_slice(&system.solve(system.right));
        system.reciprocal > 0.0 && out[0].is_finite() && out[1].is_finite()
    }

    fn derivatives(&self, p: &[f64], s: &State, acceleration: &mut [f64], out: &mut [f64]) -> bool {
        let (values, mut columns) = (self.values(p), self.columns(s));
        let system = Self::system(&values, &columns, s);
        let a = system.solve(system.right);
        acceleration[..2].copy_from_slice(&a);
        let (first, second) = (self.omega, self.omega * self.omega);
        let width = 4 + self.roles.len();
        // ∂r − ∂M a for each of q1, q2, v1, v2, both equations.
        let mut by_state = [[0.0; 2]; 4];
        for i in 0..2 {
            let (other, p) = (1 - i, &values[i]);
            let side = if i == 0 { 1.0 } else { -1.0 };
            // ∂Δ = −1 for φ1, +1 for φ2; ∂cos Δ = −sin Δ ∂Δ.
            let v = s.v[other];
            let by_delta = p[COUPLING] * (side * v * v * s.cos_delta + s.sin_delta * a[other]);
            by_state[0][i] -= by_delta;
            by_state[1][i] += by_delta;
            by_state[2 + other][i] += p[COUPLING] * side * 2.0 * v * s.sin_delta;
            by_state[i][i] -= second * s.cos[i] * (p[GRAVITY] + p[COSINE] * s.cos_tau + p[SINE] * s.sin_tau);
            let viscous = side * first * p[VISCOUS + 1];
            by_state[2][i] -= first * p[VISCOUS] + viscous;
            by_state[3][i] += viscous;
            columns[i][COUPLING] -= s.cos_delta * a[other];
        }
        for (k, (i, role)) in self.roles.iter().enumerate() {
            let own = columns[*i][*role];
            let solved = system.solve(if *i == 0 { [own, 0.0] } else { [0.0, own] });
            out[4 + k] = solved[0];
            out[width + 4 + k] = solved[1];
        }
        for (k, r) in by_state.into_iter().enumerate() {
            let solved = system.solve(r);
            out[k] = solved[0];
            out[width + k] = solved[1];
        }
        system.reciprocal > 0.0 && a[0].is_finite() && a[1].is_finite()
    }
}

impl Dynamics for DoublePendulum {
    fn degrees_of_freedom(&self) -> usize {
        2
    }

    fn parameter_count(&self) -> usize {
        self.roles.len()
    }

    fn switches(&self) -> &[Switch] {
        &self.switches
    }

    fn acceleration_held(&self, here: Here<'_>, out: &mut [f64]) -> bool {
        self.evaluate(here.parameters, &self.state(here), out)
    }

    fn linearise_held(&self, here: Here<'_>, out: Linearisation<'_>) -> bool {
        self.derivatives(here.parameters, &self.state(here), out.acceleration, out.partials)
    }
}

#[cfg(test)]
mod tests {
    use super::super::double_pendulum::DAMPINGS;
    use super::super::dynamics::{Instant, differences};
    use super::*;

    #[test]
    fn partials_agree_with_differences() {
        let all: Vec<&Damping> = DAMPINGS.iter().collect();
        for (omega, driven) in [(31.4, true), (1.0, false)] {
            let d = DoublePendulum::new(omega, driven, &all);
            let p: Vec<f64> = (0..d.parameter_count()).map(|k| 0.1 + 0.03 * k as f64).collect();
            let at = Instant { time: 0.0, tau: 0.7, inputs: &[] };
            for (q, v) in [([0.3, 2.0], [1.5, -4.0]), ([-2.0, 7.0], [-3.0, 20.0])] {
                let n = 2 * (4 + p.len());
                let (mut exact, mut near) = (vec![0.0; n], vec![0.0; n]);
                let here = Here { parameters: &p, q: &q, v: &v, at: &at, signs: &d.signs(&q, &v, &[]) };
                let out = Linearisation { acceleration: &mut [0.0; 2], partials: &mut exact };
                assert!(d.linearise_held(here, out));
                assert!(differences(&d, here, &mut near));
                for (a, b) in exact.iter().zip(&near) {
                    assert!((a - b).abs() < 1e-6 * (1.0 + b.abs()) * omega, "{a} {b}");
                }
            }
        }
    }

    #[test]
    fn parameters_stand_in_the_order_of_the_equations() {
        let d = DoublePendulum::new(31.4, true, &[&DAMPINGS[0], &DAMPINGS[1]]);
        assert_eq!(d.names(), ["B11", "B12", "B13", "B14", "C11", "C12", "B21", "B22", "B23", "B24", "C2"]);
        assert_eq!(d.switches(), [Switch::of_rates(vec![1.0, 0.0])]);
    }

    #[test]
    fn energy_is_kept_without_damping_and_drive_and_forces_obey_newton() {
        // dE/dt with E = ½ J1 v1² + ½ J2 v2² + H v1 v2 cos Δ − g S1 cos φ1 − g S2 cos φ2 must
        // vanish at any state.
        let (j1, j2, h, s1, s2, g) = (6e-4, 4e-5, 7e-5, 4e-3, 1e-3, 9.81);
        let d = DoublePendulum::new(1.0, false, &[]);
        let p = [h / j1, g * s1 / j1, h / j2, g * s2 / j2];
        let mut a = [0.0; 2];
        for (q, v) in [([0.3, 2.0], [1.5, -4.0]), ([-2.0, 1.0], [-3.0, 20.0])] {
            assert!(d.acceleration(&p, &q, &v, &Instant::default(), &mut a));
            let (sin, cos) = (q[1] - q[0]).sin_cos();
            let power = j1 * v[0] * a[0] + j2 * v[1] * a[1] + h * (a[0] * v[1] + v[0] * a[1]) * cos
                - h * v[0] * v[1] * sin * (v[1] - v[0])
                + g * s1 * q[0].sin() * v[0]
                + g * s2 * q[1].sin() * v[1];
            assert!(power.abs() < 1e-12, "{power}");
        }
        assert!(!d.acceleration(&[2.0, 0.0, 2.0, 0.0], &[0.0; 2], &[0.0; 2], &Instant::default(), &mut a));
    }
}
