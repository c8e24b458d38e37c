//! What effects compile to: torques in a joint, additions to the arms, the base's motion and the
//! encoders.

use core::f64::consts::{PI, TAU};

use super::memory::Memory;
use crate::shaker::{Hum, Moment};

/// Torque in one joint, as a function of its angle x (wrapped to [−π, π)) and its relative velocity
/// v:
/// `constant − Σ (C cos 2πft + S sin 2πft) − viscous v − quadratic_damping x² v − Σ c |v|^p sign v − k1 x − k2 x² − k3 x³ − k5 x⁵ − A cos(τ − ψ) x − backlash(x) − Σ A sin(n x + ψ) − Σ k u exp(−(u/d)²)
/// + dry + remembered`, t the record's time, u the angle from x0, wrapped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointLaw {
    /// Constant torque, N m.
    pub constant: f64,
    /// Viscous friction, N m s.
    pub viscous: f64,
    /// Damping that grows with the squared angle, N m s/rad².
    pub amplitude_damping: f64,
    /// Stiffnesses of first, second and third order, N m/rad, N m/rad², N m/rad³.
    pub stiffness: [f64; 3],
    /// Stiffness of fifth order, N m/rad⁵.
    pub quintic: f64,
    /// Damping by a power of the velocity: strength and power.
    pub power: Vec<(f64, f64)>,
    /// Stiffness that the drive's phase modulates: parts with cos τ and sin τ, N m/rad.
    pub modulation: [f64; 2],
    /// A spring near one angle: stiffness (N m/rad), angle and reach (rad).
    pub local: Vec<(f64, f64, f64)>,
    /// Play: half width of the dead zone (rad) and stiffness beyond it (N m/rad).
    pub backlash: Vec<(f64, f64)>,
    /// Cogging: amplitude (N m), order, phase (rad).
    pub cogging: Vec<(f64, f64, f64)>,
    /// Constant levels of dry friction for v > 0 and for v < 0, N m.
    pub level: [f64; 2],
    /// Stribeck's part of the dry friction: level at v = 0 (N m) and velocity v_s (rad/s).
    pub stribeck: Vec<(f64, f64)>,
    /// Elements with a memory.
    pub memories: Vec<Memory>,
    /// Tones in the laboratory's time: parts with cos 2πft and sin 2πft (N m) and frequency f (Hz).
    pub tones: Vec<(f64, f64, f64)>,
    /// Dry friction per newton of radial force, m.
    pub per_load: f64,
    /// What the level of dry friction gains over the record, N m.
    pub drift: f64,
    /// What the level of dry friction gains with the angle, A sin(n x + ψ): A (N m), n, ψ (rad).
    pub ripple: Vec<(f64, f64, f64)>,
}

impl JointLaw {
    /// Whether the torque depends on the wrapped angle other than periodically, so that it has a
    /// corner at ±π.
    pub(super) fn wraps(&self) -> bool {
        let modulated = self.modulation != [0.0; 2];
        let stiff = self.stiffness != [0.0; 3] || self.quintic != 0.0;
        self.amplitude_damping != 0.0 || stiff || !self.backlash.is_empty() || modulated
    }

    /// Whether there is dry friction.
    pub(super) fn is_dry(&self) -> bool {
        let grows = self.per_load != 0.0 || self.drift != 0.0 || !self.ripple.is_empty();
        self.level != [0.0; 2] || !self.stribeck.is_empty() || grows
    }

    /// Angles inside (−π, π) at which the torque has a corner, ascending.
    pub(super) fn corners(&self) -> Vec<f64> {
        let mut corners: Vec<f64> = self.backlash.iter().flat_map(|&(b, _)| [-b, b]).filter(|b| b.abs() < PI).collect();
        corners.sort_by(f64::total_cmp);
        corners.dedup();
        corners
    }

    /// Torque without dry friction and memory at a moment. `middle` is any angle of the smooth
    /// stretch that x is in: beyond its ends the law is continued smoothly, so that a step may
    /// overshoot a corner before the corner is located.
    pub(super) fn smooth(&self, x: f64, middle: f64, v: f64, moment: &Moment) -> f64 {
        let [k1, k2, k3] = self.stiffness;
        let mut torque = self.constant - (self.viscous + self.amplitude_damping * x * x) * v;
        torque -= x * (k1 + x * (k2 + x * (k3 + x * x * self.quintic)));
        for &(b, k) in &self.backlash {
            if middle > b {
                torque -= k * (x - b);
            } else if middle < -b {
                torque -= k * (x + b);
            }
        }
        for &(amplitude, order, phase) in &self.cogging {
            torque -= amplitude * libm::sin(order * x + phase);
        }
        for &(strength, power) in &self.power {
            torque -= strength * libm::pow(v.abs(), power) * if v < 0.0 { -1.0 } else { 1.0 };
        }
        for &(k, at, reach) in &self.local {
            let u = x - at - 2.0 * PI * libm::floor((x - at + PI) / (2.0 * PI));
            torque -= k * u * libm::exp(-(u / reach) * (u / reach));
        }
        if self.modulation != [0.0; 2] {
            let (sin, cos) = libm::sincos(moment.phase);
            torque -= (self.modulation[0] * cos + self.modulation[1] * sin) * x;
        }
        for &(with_cos, with_sin, frequency) in &self.tones {
            let (sin, cos) = libm::sincos(TAU * frequency * moment.time);
            torque -= with_cos * cos + with_sin * sin;
        }
        torque
    }

    /// Part of the dry friction's level that depends on the angle.
    pub(super) fn ripple_at(&self, x: f64) -> f64 {
        self.ripple.iter().map(|&(amplitude, order, phase)| amplitude * libm::sin(order * x + phase)).sum()
    }

    /// Level of the dry friction that opposes motion in the direction `sign` (±1) at velocity v
    /// under a radial force, after a share of the record, at an angle of this ripple.
    pub(super) fn dry_level(&self, sign: f64, v: f64, load: f64, share: f64, ripple: f64) -> f64 {
        let mut level = self.level[usize::from(sign < 0.0)] + self.per_load * load + self.drift * share + ripple;
        for &(at_rest, v_s) in &self.stribeck {
            let ratio = v / v_s;
            level += at_rest * libm::exp(-ratio * ratio);
        }
        level
    }
}

/// What the base does beside its fundamental.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DriveAdditions {
    /// Harmonics along the drive: order, amplitude ratio, phase β in `r a cos(n τ − β)`.
    pub harmonics: Vec<(f64, f64, f64)>,
    /// Motion across the drive, A cos τ + B sin τ, m.
    pub across: [f64; 2],
    /// Which direction `across` must be, if any effect names one: `true` horizontal.
    pub across_is_horizontal: Option<bool>,
    /// Relative growth of the amplitude over the record.
    pub amplitude_drift: f64,
    /// True amplitude over the commanded one, less 1: an error of the shaker's gain.
    pub gain_error: f64,
    /// True frequency minus recorded frequency, Hz.
    pub frequency_offset_hz: f64,
    /// A tone of the base's own.
    pub hum: Hum,
}

/// What an encoder makes of its angle, in the order in which effects were given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorLaw {
    /// θ + b.
    Offset(f64),
    /// θ + b t/T, t from the record's start, T its length.
    Drift(f64),
    /// (1 + s) θ, of the unwrapped angle.
    Scale(f64),
    /// θ + e sin(θ + ψ).
    Eccentricity(f64, f64),
}

impl SensorLaw {
    /// The angle shown, of the true one, rad, when a share t/T of the record is over.
    pub fn shown(&self, angle: f64, share: f64) -> f64 {
        match *self {
            Self::Offset(b) => angle + b,
            Self::Drift(b) => angle + b * share,
            Self::Scale(s) => (1.0 + s) * angle,
            Self::Eccentricity(e, phase) => angle + e * libm::sin(angle + phase),
        }
    }
}

/// The sum of all effects.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Additions {
    /// Torques in joints 1 and 2.
    pub joints: [JointLaw; 2],
    /// Quadratic drag of each arm, N m s².
    pub drag: [f64; 2],
    /// Drag along each arm, per length: strength (kg/m²) and the length from the arm's joint over
    /// which it acts (m).
    pub air: [Vec<(f64, f64)>; 2],
    /// Angle of each arm's centroid off its line, rad.
    pub imbalance: [f64; 2],
    /// Angle at which the arms would hang, rad.
    pub tilt: f64,
    /// The base.
    pub drive: DriveAdditions,
    /// The encoders.
    pub sensors: [Vec<SensorLaw>; 2],
    /// Delay of encoder 2 behind encoder 1, s.
    pub delay_s: f64,
    /// Share by which a second of the record's time is longer than a second.
    pub clock: f64,
}
