//! The named effects that a rig may have beside its nominal model, with which the simulator hides
//! what an identification must find.
//!
//! [`LIST`] is the registration slice: one file each group, one line each effect. A text such as
//! `quadratic-drag@arm2=2e-6` or `stribeck-friction@joint1=3e-4,v_s=0.8` is read by
//! [`Effect::parse`]; the sum of all effects is [`Additions`] ([`combine`]). Effects of the same id
//! and place add up (scale errors and eccentricities apply one after the other). Units are SI;
//! angles in rad.

mod drive;
mod forces;
mod friction;
mod geometry;
mod memory;
mod parse;
mod sensors;
mod stiffness;

pub use parse::{Effect, EffectError};

use super::laws::Additions;

/// Where an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Joint 1, between base and arm 1.
    Joint1,
    /// Joint 2, between the arms; a torque acts on both with opposite signs.
    Joint2,
    /// Arm 1.
    Arm1,
    /// Arm 2.
    Arm2,
    /// Encoder of arm 1 against the frame.
    Encoder1,
    /// Encoder of arm 2 against arm 1.
    Encoder2,
    /// The shaker.
    Drive,
    /// The frame.
    Frame,
}

impl Place {
    /// All places.
    pub const ALL: [Self; 8] =
        [Self::Joint1, Self::Joint2, Self::Arm1, Self::Arm2, Self::Encoder1, Self::Encoder2, Self::Drive, Self::Frame];

    /// The name used after the `@`.
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

    /// 0 for the first joint, arm or encoder, 1 for the second.
    fn index(self) -> usize {
        usize::from(matches!(self, Self::Joint2 | Self::Arm2 | Self::Encoder2))
    }
}

/// A secondary parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterInfo {
    /// Name before the `=`.
    pub name: &'static str,
    /// Unit, empty for a pure number.
    pub unit: &'static str,
    /// Value where none is given.
    pub default: f64,
    /// What it is.
    pub meaning: &'static str,
    /// What it may be.
    pub range: Range,
}

/// Values that a number may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Least value.
    pub least: f64,
    /// Greatest value.
    pub greatest: f64,
    /// Whether `least` itself is excluded.
    pub above: bool,
    /// Whether it must be a whole number.
    pub whole: bool,
}

impl Range {
    const fn between(least: f64, greatest: f64) -> Self {
        Self { least, greatest, above: false, whole: false }
    }

    /// Any number that the plant can bear.
    const ANY: Self = Self::between(-1e6, 1e6);
    /// 0 or more.
    const NOT_NEGATIVE: Self = Self::between(0.0, 1e6);
    /// Any phase.
    const PHASE: Self = Self::between(-1e3, 1e3);

    /// Whether a value is in the range.
    pub fn contains(&self, value: f64) -> bool {
        value >= self.least
            && value <= self.greatest
            && !(self.above && value == self.least)
            && (!self.whole || value == value.trunc())
    }

    /// The range in words.
    pub fn describe(&self) -> String {
        let kind = if self.whole { "a whole number" } else { "a number" };
        let from = if self.above { "above" } else { "from" };
        format!("{kind} {from} {} to {}", self.least, self.greatest)
    }
}

/// What is known of an effect: one row of the table that `whirl list effects` prints.
#[derive(Clone, Copy, Debug)]
pub struct EffectInfo {
    /// Name before the `@`.
    pub id: &'static str,
    /// Places where it can act.
    pub places: &'static [Place],
    /// Unit of the value.
    pub unit: &'static str,
    /// Secondary parameters.
    pub parameters: &'static [ParameterInfo],
    /// What is added: v the joint's relative velocity, x its angle wrapped to [−π, π), ω an arm's
    /// absolute velocity, θ an encoder's angle, τ the device's phase.
    pub equation: &'static str,
    /// Values that it may have.
    pub range: Range,
    /// Adds it up.
    apply: fn(&mut Additions, Place, f64, &[f64]),
}

const JOINTS: &[Place] = &[Place::Joint1, Place::Joint2];
const ARMS: &[Place] = &[Place::Arm1, Place::Arm2];
const ENCODERS: &[Place] = &[Place::Encoder1, Place::Encoder2];
const DRIVE: &[Place] = &[Place::Drive];

/// A phase in rad, 0 unless given.
const PSI: ParameterInfo =
    ParameterInfo { name: "psi", unit: "rad", default: 0.0, meaning: "phase ψ", range: Range::PHASE };

/// All effects, in the order of the product's table.
pub const LIST: &[EffectInfo] = &[
    friction::VISCOUS,
    friction::COULOMB,
    friction::STRIBECK,
    memory::DAHL,
    friction::LOAD_DEPENDENT,
    friction::QUADRATIC_DRAG,
    friction::ASYMMETRIC,
    stiffness::TORSION_SPRING,
    stiffness::CUBIC,
    stiffness::QUADRATIC,
    stiffness::QUINTIC,
    stiffness::BACKLASH,
    stiffness::COGGING,
    friction::AMPLITUDE_DEPENDENT,
    geometry::IMBALANCE,
    forces::CONSTANT,
    geometry::FRAME_TILT,
    drive::HORIZONTAL,
    drive::VERTICAL,
    drive::HARMONIC_2,
    drive::HARMONIC_3,
    drive::AMPLITUDE_DRIFT,
    drive::FREQUENCY_OFFSET,
    sensors::ZERO_OFFSET,
    sensors::ZERO_DRIFT,
    sensors::SCALE_ERROR,
    sensors::ECCENTRICITY,
    sensors::CHANNEL_DELAY,
    friction::DISTRIBUTED_DRAG,
    friction::DRIFT,
    friction::RIPPLE,
    friction::POWER_LAW,
    stiffness::LOCAL,
    stiffness::MODULATION,
    memory::RELAXATION,
    memory::HYSTERESIS,
    memory::PLAY,
    memory::LUGRE,
    forces::TONE,
    sensors::TIME_BASE,
];

/// Most effects at once; a bound on what a command line can ask for.
pub const MAX_EFFECTS: usize = 32;

/// The sum of effects.
///
/// # Errors
/// More than [`MAX_EFFECTS`] of them, more harmonics of the drive or elements with a memory in a
/// joint than there is room for, motion across the drive in two directions, more than one half of a
/// second of delay in all.
pub fn combine(effects: &[Effect]) -> Result<Additions, EffectError> {
    if effects.len() > MAX_EFFECTS {
        return Err(EffectError::new("effects", &format!("{} of them", effects.len()), "at most 32 at once"));
    }
    let mut additions = Additions::default();
    for effect in effects {
        let values: Vec<f64> = effect.parameters.iter().map(|p| p.1).collect();
        let before = additions.drive.across_is_horizontal;
        (effect.info.apply)(&mut additions, effect.place, effect.value, &values);
        if before.is_some() && before != additions.drive.across_is_horizontal {
            return Err(EffectError::new(&effect.to_string(), "vertical-motion with horizontal-motion", "one of them"));
        }
    }
    if additions.drive.harmonics.len() >= crate::shaker::MAX_TERMS {
        return Err(EffectError::new("drive-harmonic", &additions.drive.harmonics.len().to_string(), "at most 7"));
    }
    if let Some(joint) = additions.joints.iter().find(|j| j.memories.len() > crate::plant::memory::MOST) {
        let found = format!("{} of them", joint.memories.len());
        return Err(EffectError::new("effects with a memory", &found, "at most 4 in a joint"));
    }
    if additions.delay_s.abs() > 0.5 {
        return Err(EffectError::new("channel-delay", &additions.delay_s.to_string(), "at most 0.5 s in all"));
    }
    Ok(additions)
}
