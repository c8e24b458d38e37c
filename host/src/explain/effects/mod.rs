//! Physical effects that a model may be missing: one file each, one line in [`EFFECTS`].
//!
//! An effect says how it enters the equations of (3.4), linearly in its strength k: as additions to the left-hand sides
//! (forces, torques, motion of the base) or as what it adds to the sensors' angles. Torques are those that *oppose*: the effect's
//! torque on the arm is −k f, so that the left-hand side of equation i gets + k f/(J_oi Ω²), k in units of torque/J_o2. Definitions of
//! ids and places are the contract's.

mod amplitude_dependent_damping;
mod amplitude_drift;
mod asymmetric_friction;
mod backlash;
mod channel_delay;
mod cogging;
mod constant_force;
mod coulomb_friction;
mod cubic_stiffness;
mod drive_harmonic_2;
mod drive_harmonic_3;
mod eccentricity;
mod frame_tilt;
mod frequency_offset;
mod horizontal_motion;
mod imbalance;
mod load_dependent_friction;
mod quadratic_drag;
mod quadratic_stiffness;
mod scale_error;
mod stribeck_friction;
mod torsion_spring;
mod viscous_friction;
mod zero_offset;

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::model::weak::{Sample, Series};

/// Every effect, in the order of the product's table.
pub static EFFECTS: &[Effect] = &[
    viscous_friction::EFFECT,
    coulomb_friction::EFFECT,
    stribeck_friction::EFFECT,
    load_dependent_friction::EFFECT,
    quadratic_drag::EFFECT,
    asymmetric_friction::EFFECT,
    torsion_spring::EFFECT,
    cubic_stiffness::EFFECT,
    quadratic_stiffness::EFFECT,
    backlash::EFFECT,
    cogging::EFFECT,
    amplitude_dependent_damping::EFFECT,
    imbalance::EFFECT,
    constant_force::EFFECT,
    frame_tilt::EFFECT,
    horizontal_motion::EFFECT,
    drive_harmonic_2::EFFECT,
    drive_harmonic_3::EFFECT,
    amplitude_drift::EFFECT,
    frequency_offset::EFFECT,
    zero_offset::EFFECT,
    scale_error::EFFECT,
    eccentricity::EFFECT,
    channel_delay::EFFECT,
];

/// Where an effect sits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Place {
    /// Between base and arm 1.
    Joint1,
    /// Between the arms.
    Joint2,
    /// Arm 1.
    Arm1,
    /// Arm 2.
    Arm2,
    /// Encoder of joint 1.
    Encoder1,
    /// Encoder of joint 2.
    Encoder2,
    /// The base's motion.
    Drive,
    /// The frame that carries everything.
    Frame,
}

impl Place {
    /// The contract's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Joint1 => "joint1",
            Self::Joint2 => "joint2",
            Self::Arm1 => "arm1",
            Self::Arm2 => "arm2",
            Self::Encoder1 => "encoder1",
            Self::Encoder2 => "encoder2",
            Self::Drive => "drive",
            Self::Frame => "frame",
        }
    }
}

/// What is known of an effect.
pub struct Effect {
    /// Name before the `@`.
    pub id: &'static str,
    /// Places where it can act.
    pub places: &'static [Place],
    /// Unit of its value where the scale is known.
    pub unit: &'static str,
    /// What it adds.
    pub equation: &'static str,
    /// How it shows in residuals.
    pub signature: &'static str,
    /// The laboratory test that would confirm it.
    pub confirm: &'static str,
    /// Its forms at a place; none where it does not apply to this rig.
    pub variants: fn(&Context, Place) -> Vec<Variant>,
}

/// What effects need to know of the model so far.
#[derive(Clone, Debug)]
pub struct Context {
    /// Ω, rad/s.
    pub omega: f64,
    /// Whether the base is driven.
    pub driven: bool,
    /// B_i1 … B_i4 of both equations (B_i3, B_i4 zero when free).
    pub b: [[f64; 4]; 2],
    /// Gravity, m/s².
    pub g: f64,
    /// Known physical quantities.
    pub known: BTreeMap<String, f64>,
    /// Whether encoder 2 measures arm 2 relative to arm 1.
    pub relative: bool,
    /// Time of the record's first sample and its length, s.
    pub span_s: [f64; 2],
}

impl Context {
    /// J_oi/J_o2 of equation i: 1 for the second, B21/B11 for the first.
    pub fn inertia(&self, i: usize) -> f64 {
        if i == 0 { self.b[1][0] / self.b[0][0] } else { 1.0 }
    }

    /// S_i/J_oi, 1/m: from B_i2 = g S_i/(J_oi Ω²).
    pub fn lever(&self, i: usize) -> f64 {
        self.b[i][1] * self.omega * self.omega / self.g
    }
}

/// How strengths become a value and parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compose {
    /// One strength, the value.
    Single,
    /// Two strengths (C, S): value √(C² + S²), the named parameter atan2(S, C).
    AmplitudePhase(&'static str),
    /// Two strengths: the value and the named parameter.
    Components(&'static str),
    /// The value is the form's first parameter; the strength is the named torque coefficient.
    Shape {
        /// Name of the torque coefficient.
        torque: &'static str,
    },
}

/// What turns a strength into the value's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// A torque over J_o2: times J_o2 where that is known, otherwise divided by J_oi/J_o2 of its place.
    Torque,
    /// Already in the value's unit, up to a factor.
    Plain(f64),
}

/// One form of an effect at a place: its columns and how they are read.
#[derive(Clone)]
pub struct Variant {
    /// Parameters that fix its form (order of cogging, v_s).
    pub shape: Vec<(&'static str, f64)>,
    /// What it adds.
    pub action: Action,
    /// How strengths are put together.
    pub compose: Compose,
    /// How a strength is scaled.
    pub scale: Scale,
    /// Makes the form at another value of its first parameter s, with a second strength k·δs that multiplies the
    /// derivative of the first's column with respect to s.
    pub refine: Option<Refine>,
}

/// See [`Variant::refine`].
pub type Refine = fn(&Context, Place, f64) -> Variant;

impl Variant {
    /// A form whose first parameter can be refined by Gauss–Newton steps.
    #[must_use]
    pub fn refined_by(self, refine: Refine) -> Self {
        Self { refine: Some(refine), ..self }
    }
}

/// What an effect of strength one adds to the sensors' angles (rad), from the angles and rates that they show and the time.
pub type SensorLaw = Arc<dyn Fn([f64; 2], [f64; 2], f64) -> [f64; 2] + Send + Sync>;

/// How an effect enters, one entry for each strength.
#[derive(Clone)]
pub enum Action {
    /// Additions to the left-hand sides of both equations.
    Force(Vec<[Option<Series>; 2]>),
    /// Additions to the angles that the sensors show.
    Sensor(Vec<SensorLaw>),
    /// A drive that runs away from its recorded phase by 2π times the strength (Hz), with the change of both left-hand sides
    /// to first order.
    Runaway([Option<Series>; 2]),
}

impl Action {
    /// Number of strengths.
    pub fn len(&self) -> usize {
        match self {
            Self::Force(f) => f.len(),
            Self::Sensor(s) => s.len(),
            Self::Runaway(_) => 1,
        }
    }

    /// Whether strengths are applied to the data and found as increments, since the columns hold to first order only.
    pub fn is_applied(&self) -> bool {
        !matches!(self, Self::Force(_))
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// An angle wrapped to [−π, π).
pub fn wrapped(x: f64) -> f64 {
    let tau = core::f64::consts::TAU;
    x - tau * (x / tau + 0.5).floor()
}

/// Motion of a joint at a sample: wrapped angle, velocity, clear velocity and its change a step.
#[derive(Clone, Copy, Debug)]
pub struct Joint {
    /// Relative angle wrapped to [−π, π), rad.
    pub x: f64,
    /// Relative velocity, rad/s.
    pub v: f64,
    /// Relative velocity in the band that stands clear of noise, rad/s.
    pub clear: f64,
    /// Its change over a sampling step, rad/s.
    pub step: f64,
    /// Change of the angle over a sampling step, rad.
    pub turn: f64,
}

impl Joint {
    /// The joint's motion.
    pub fn of(place: Place, s: &Sample) -> Self {
        if place == Place::Joint1 {
            Self { x: wrapped(s.phi[0]), v: s.rate[0], clear: s.clear_rate[0], step: s.clear_step[0], turn: s.turn[0] }
        } else {
            Self {
                x: wrapped(s.phi[1] - s.phi[0]),
                v: s.rate[1] - s.rate[0],
                clear: s.clear_rate[1] - s.clear_rate[0],
                step: s.clear_step[1] - s.clear_step[0],
                turn: s.turn[1] - s.turn[0],
            }
        }
    }

    /// Mean over a sampling step of an odd function of the wrapped angle, which jumps at half a turn: (F(x + δ/2) − F(x − δ/2))/δ, F its integral, which is even
    /// and so does not jump. Sums over samples then follow the instant of the jump, where the plain value is off by up to half a step.
    pub fn odd(&self, f: impl Fn(f64) -> f64, integral: impl Fn(f64) -> f64) -> f64 {
        let half = 0.5 * self.turn.abs();
        // A quarter of a turn within a step: the sampling no longer follows the motion.
        if self.x.abs() + half < core::f64::consts::PI || half > core::f64::consts::FRAC_PI_2 {
            return f(self.x);
        }
        (integral(wrapped(self.x + half)) - integral(wrapped(self.x - half))) / (2.0 * half)
    }

    /// Mean sign of the velocity over a step.
    pub fn sign(&self) -> f64 {
        crate::model::weak::mean_sign(self.clear, self.step)
    }
}

/// A torque that opposes, in a joint: on arm 1 alone in joint 1, on both arms with opposite signs in joint 2.
pub fn joint_torque(
    c: &Context,
    place: Place,
    f: impl Fn(Joint) -> f64 + Send + Sync + Clone + 'static,
) -> [Option<Series>; 2] {
    let second = c.omega * c.omega;
    let (first, other) = (1.0 / (c.inertia(0) * second), 1.0 / second);
    if place == Place::Joint1 {
        return [Some(Arc::new(move |s| first * f(Joint::of(Place::Joint1, s)))), None];
    }
    let g = f.clone();
    [
        Some(Arc::new(move |s| -first * f(Joint::of(Place::Joint2, s)))),
        Some(Arc::new(move |s| other * g(Joint::of(Place::Joint2, s)))),
    ]
}

/// A joint effect with one strength and no parameters.
pub fn joint_effect(
    c: &Context,
    place: Place,
    f: impl Fn(Joint) -> f64 + Send + Sync + Clone + 'static,
) -> Vec<Variant> {
    vec![torque(vec![joint_torque(c, place, f)], Vec::new(), Compose::Single)]
}

/// A variant whose strengths are torques over J_o2.
pub fn torque(columns: Vec<[Option<Series>; 2]>, shape: Vec<(&'static str, f64)>, compose: Compose) -> Variant {
    Variant { shape, action: Action::Force(columns), compose, scale: Scale::Torque, refine: None }
}

/// A pair of terms, one for each equation, from one function of the equation's index.
pub fn both(f: impl Fn(usize, &Sample) -> f64 + Send + Sync + Clone + 'static) -> [Option<Series>; 2] {
    let g = f.clone();
    [Some(Arc::new(move |s| f(0, s))), Some(Arc::new(move |s| g(1, s)))]
}

/// A variant whose strengths are in the value's own unit.
pub fn plain(columns: Vec<[Option<Series>; 2]>, compose: Compose) -> Vec<Variant> {
    vec![Variant { shape: Vec::new(), action: Action::Force(columns), compose, scale: Scale::Plain(1.0), refine: None }]
}

/// A variant that acts on the sensors.
pub fn sensor(laws: Vec<SensorLaw>, compose: Compose) -> Vec<Variant> {
    vec![Variant { shape: Vec::new(), action: Action::Sensor(laws), compose, scale: Scale::Plain(1.0), refine: None }]
}

/// Index of the sensor at an encoder.
pub fn encoder(place: Place) -> usize {
    usize::from(place == Place::Encoder2)
}

const JOINTS: &[Place] = &[Place::Joint1, Place::Joint2];
const ARMS: &[Place] = &[Place::Arm1, Place::Arm2];
const ENCODERS: &[Place] = &[Place::Encoder1, Place::Encoder2];
const DRIVE: &[Place] = &[Place::Drive];
