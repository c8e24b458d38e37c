//! A driven double pendulum whose pivot sits on a frame that gives way along one direction: three
//! degrees of freedom, the absolute angles φ1, φ2 (0 hangs down) and the frame's displacement s.
//!
//! From virtual work, not from the equations of [`crate::plant`]: with the velocities of both
//! centroids ṙ_i = Σ_k j_ik q̇_k + (0, ẏ_b) and their accelerations r̈_i = Σ_k j_ik q̈_k + b_i,
//! ```text
//! Σ_i (m_i j_ik·r̈_i + J_i φ̈_i ∂φ_i/∂q_k) + M_f s̈ δ_ks = Σ_i m_i j_ik·g + Q_k
//! ```
//! Joints have viscous friction, the frame of mass M_f the stiffness M ω² and the damping 2 ζ M ω
//! with M = M_f + m1 + m2: f is what it rings at when the arms are carried, not swung.

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::plant_oscillator::Oscillator;

/// An arm: mass (kg), joint to centroid (m), inertia about the centroid (kg m²).
#[derive(Clone, Copy, Debug)]
pub struct Arm {
    /// Mass, kg.
    pub mass: f64,
    /// Joint to centroid, m.
    pub centroid: f64,
    /// Inertia about the centroid, kg m².
    pub inertia: f64,
}

/// The frame.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Its mass with both arms, kg.
    pub mass: f64,
    /// Natural frequency, Hz.
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Direction in which it gives way, rad from the horizontal.
    pub direction: f64,
}

/// The plant. States φ1, φ2, s, φ̇1, φ̇2, ṡ.
#[derive(Clone, Copy, Debug)]
pub struct YieldingFrame {
    /// Both arms.
    pub arms: [Arm; 2],
    /// Joint 1 to joint 2, m.
    pub l1: f64,
    /// Viscous friction of both joints, N m s.
    pub viscous: [f64; 2],
    /// Vertical drive: amplitude (m) and angular frequency (rad/s).
    pub drive: [f64; 2],
    /// Gravity, m/s².
    pub g: f64,
    /// The frame; none where the pivot is fixed to the drive.
    pub frame: Option<Frame>,
}

impl YieldingFrame {
    /// Columns ∂r_i/∂q_k of the centroids and what of their accelerations no q̈ has, without the
    /// drive's.
    fn motion(&self, y: &[f64; 6]) -> [([Vector2<f64>; 3], Vector2<f64>); 2] {
        let along = |phi: f64| Vector2::new(phi.sin(), -phi.cos());
        let across = |phi: f64| Vector2::new(phi.cos(), phi.sin());
        let [phi1, phi2, _, w1, w2, _] = *y;
        let direction = self.frame.map_or(0.0, |f| f.direction);
        let slide = Vector2::new(direction.cos(), direction.sin());
        let [e1, e2] = self.arms.map(|a| a.centroid);
        [
            ([e1 * across(phi1), Vector2::zeros(), slide], -e1 * w1 * w1 * along(phi1)),
            (
                [self.l1 * across(phi1), e2 * across(phi2), slide],
                -self.l1 * w1 * w1 * along(phi1) - e2 * w2 * w2 * along(phi2),
            ),
        ]
    }
}

impl Oscillator<6> for YieldingFrame {
    fn rate(&self, t: f64, y: &[f64; 6]) -> [f64; 6] {
        let [_, _, s, w1, w2, v] = *y;
        let [a, omega] = self.drive;
        let pull = Vector2::new(0.0, -self.g + a * omega * omega * (omega * t).cos());
        let mut mass = Matrix3::zeros();
        let joint2 = -self.viscous[1] * (w2 - w1);
        let mut force = Vector3::new(-self.viscous[0] * w1 - joint2, joint2, 0.0);
        for (i, (columns, bias)) in self.motion(y).iter().enumerate() {
            let m = self.arms[i].mass;
            mass[(i, i)] += self.arms[i].inertia;
            for k in 0..3 {
                force[k] += m * columns[k].dot(&(pull - bias));
                for l in 0..3 {
                    mass[(k, l)] += m * columns[k].dot(&columns[l]);
                }
            }
        }
        match self.frame {
            Some(frame) => {
                let w = core::f64::consts::TAU * frame.frequency_hz;
                mass[(2, 2)] = frame.mass;
                force[2] -= frame.mass * w * (w * s + 2.0 * frame.damping * v);
            }
            None => {
                for k in 0..2 {
                    (mass[(k, 2)], mass[(2, k)]) = (0.0, 0.0);
                }
                force[2] = 0.0;
            }
        }
        // Positive definite: kinetic energy.
        let q = mass.cholesky().map_or_else(|| Vector3::repeat(f64::NAN), |c| c.solve(&force));
        [w1, w2, v, q[0], q[1], q[2]]
    }

    /// Kinetic energy, that of the frame's spring and, without a drive, that of gravity.
    fn energy(&self, y: &[f64; 6]) -> f64 {
        let [phi1, phi2, s, w1, w2, v] = *y;
        let mut energy = 0.0;
        let rates = [w1, w2, v];
        for (i, (columns, _)) in self.motion(y).iter().enumerate() {
            let velocity: Vector2<f64> = columns.iter().zip(rates).map(|(c, w)| *c * w).sum();
            energy +=
                0.5 * self.arms[i].mass * velocity.norm_squared() + 0.5 * self.arms[i].inertia * rates[i] * rates[i];
        }
        let [a1, a2] = self.arms;
        let heights = [-a1.centroid * phi1.cos(), -self.l1 * phi1.cos() - a2.centroid * phi2.cos()];
        energy += self.g * (a1.mass * heights[0] + a2.mass * heights[1]);
        if let Some(f) = self.frame {
            let w = core::f64::consts::TAU * f.frequency_hz;
            energy += 0.5 * f.mass * w * w * s * s + 0.5 * (f.mass - a1.mass - a2.mass) * v * v;
            energy += self.g * (a1.mass + a2.mass) * s * f.direction.sin();
        }
        energy
    }
}

/// The rig of the dissertation's tables on a vertical drive of 1.55 cm at 5 Hz, each joint with
/// viscous friction.
pub fn rig(frame: Option<Frame>) -> YieldingFrame {
    YieldingFrame {
        arms: [
            Arm { mass: 0.1362, centroid: 0.0127, inertia: 2.4e-4 },
            Arm { mass: 0.040, centroid: 0.0267, inertia: 1.6e-5 },
        ],
        l1: 0.0635,
        viscous: [3e-5, 4e-6],
        drive: [0.0155, core::f64::consts::TAU * 5.0],
        g: 9.81,
        frame,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant_oscillator::record;

    fn free(frame: Option<Frame>) -> YieldingFrame {
        YieldingFrame { viscous: [0.0; 2], drive: [0.0, 1.0], ..rig(frame) }
    }

    #[test]
    fn keeps_its_energy_on_a_frame_without_damping() {
        for direction in [0.0, 0.7, core::f64::consts::FRAC_PI_2] {
            let plant = free(Some(Frame { mass: 0.9, frequency_hz: 4.0, damping: 0.0, direction }));
            let states = record(&plant, [2.0, -1.0, 0.01, 0.0, 5.0, 0.0], 0.01, 1000).unwrap();
            let (start, scale) = (plant.energy(&states[0]), 0.1);
            assert!(states.iter().all(|s| (plant.energy(s) - start).abs() < 1e-8 * scale));
            assert!(states.iter().any(|s| (s[2] - 0.01).abs() > 0.005), "the frame moves");
        }
    }

    /// A frame of very great mass does not feel what it carries, and is none.
    #[test]
    fn a_heavy_frame_is_none_and_a_light_one_rings_at_its_frequency() {
        let heavy = Frame { mass: 1e9, frequency_hz: 4.0, damping: 0.05, direction: 0.0 };
        let start = [1.2, -0.4, 0.0, 0.0, 0.0, 0.0];
        let on = |f: Option<Frame>| record(&rig(f), start, 0.01, 60).unwrap();
        for (a, b) in on(Some(heavy)).iter().zip(&on(None)) {
            assert!((a[0] - b[0]).abs() < 1e-7 && (a[1] - b[1]).abs() < 1e-7);
        }
        // Arms that hang still under a frame that moves up and down are carried.
        let up = Frame { mass: 0.9, frequency_hz: 4.0, damping: 0.0, direction: core::f64::consts::FRAC_PI_2 };
        let rest = (0.1362 + 0.040) * 9.81 / (0.9 * (core::f64::consts::TAU * 4.0).powi(2));
        let states = record(&free(Some(up)), [0.0, 0.0, 0.003 - rest, 0.0, 0.0, 0.0], 0.01, 200).unwrap();
        for (i, s) in states.iter().enumerate() {
            let wanted = 0.003 * (core::f64::consts::TAU * 4.0 * 0.01 * i as f64).cos() - rest;
            assert!((s[2] - wanted).abs() < 1e-8, "{i}: {} {wanted}", s[2]);
        }
    }
}
