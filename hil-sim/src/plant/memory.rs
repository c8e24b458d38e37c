//! Elements of a joint that remember its motion: torques of a state z that begins at 0.
//!
//! Where z depends on the angle and on the direction of motion alone, it follows a closed curve of
//! the angle from one reversal, or corner of the curve, to the next. Where it depends on time or on
//! the speed, it is integrated with the motion. z in rad, torques in N m; v is the joint's relative
//! velocity.

use core::f64::consts::{PI, TAU};

/// Most elements with a memory in one joint.
pub const MOST: usize = 4;
/// A corner of a curve that is nearer than this counts as reached, rad. It is that of the events'
/// distances.
const REACHED: f64 = 1e-12;

/// An element with a memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Memory {
    /// −k z, dz/dt = v − b (|v| z + c v |z|): Bouc's hysteresis (1967) as Wen generalised it
    /// (1976), of exponent 1. Dahl's friction (1968) of level F and presliding distance d has k =
    /// F/d, b = 1/d, c = 0.
    Hysteresis {
        /// k, N m/rad.
        stiffness: f64,
        /// b, 1/rad: the inverse of the distance over which z saturates.
        rate: f64,
        /// c, −1 to 1: by how much z approaches its bound at another rate than it leaves it.
        shape: f64,
    },
    /// −k z, dz/dt = v where the angle x pushes, s (x − z) ≥ b with s = sign v, and 0 inside the
    /// play. x is counted on through whole turns, from the start's within [−π, π).
    Play {
        /// k, N m/rad.
        stiffness: f64,
        /// b, rad.
        half_width: f64,
    },
    /// −k z, dz/dt = v − z/T: a spring behind a damper (Maxwell's element).
    Relaxation {
        /// k, N m/rad.
        stiffness: f64,
        /// T, s.
        time: f64,
    },
    /// −s0 z − s1 dz/dt, dz/dt = v − |v| z/g, g = d (1 + r exp(−(v/v_s)²)): LuGre friction (Canudas
    /// de Wit, Olsson, Åström, Lischinsky 1995).
    Lugre {
        /// s0, N m/rad.
        stiffness: f64,
        /// s1, N m s/rad.
        damping: f64,
        /// d, rad: s0 d is Coulomb's level.
        distance: f64,
        /// v_s, rad/s.
        stribeck: f64,
        /// r: what the level at v = 0 has beyond Coulomb's, as a share of it.
        excess: f64,
    },
}

/// (1 − exp(−a))/a.
fn mean_decay(a: f64) -> f64 {
    if a.abs() < 1e-8 { 1.0 - 0.5 * a } else { -libm::expm1(-a) / a }
}

impl Memory {
    /// Whether z is integrated with the motion.
    pub(super) fn flows(&self) -> bool {
        matches!(self, Self::Relaxation { .. } | Self::Lugre { .. })
    }

    /// Size of z beside which the error of its integration counts, rad.
    pub(super) fn scale(&self) -> f64 {
        match *self {
            Self::Lugre { distance, .. } => distance.min(1.0),
            _ => 1.0,
        }
    }

    /// dz/dt of a z that is integrated, 0 of another, rad/s; `sign` is the direction of motion.
    pub(super) fn rate(&self, z: f64, v: f64, sign: f64) -> f64 {
        match *self {
            Self::Relaxation { time, .. } => v - z / time,
            Self::Lugre { distance, stribeck, excess, .. } => {
                let ratio = v / stribeck;
                v - sign * v * z / (distance * (1.0 + excess * libm::exp(-ratio * ratio)))
            }
            Self::Hysteresis { .. } | Self::Play { .. } => 0.0,
        }
    }

    fn torque(&self, z: f64, v: f64, sign: f64) -> f64 {
        match *self {
            Self::Hysteresis { stiffness, .. } | Self::Play { stiffness, .. } | Self::Relaxation { stiffness, .. } => {
                -stiffness * z
            }
            Self::Lugre { stiffness, damping, .. } => -stiffness * z - damping * self.rate(z, v, sign),
        }
    }

    /// z a distance after its curve's start. All is counted in the direction of motion; `lag` is
    /// x − z at the start. The curve goes on smoothly beyond its corner, so that a step may
    /// overshoot the corner before it is located.
    fn followed(&self, z: f64, lag: f64, travelled: f64) -> f64 {
        match *self {
            Self::Hysteresis { rate, shape, .. } => {
                // dz/dx = 1 − b (1 ± c) z.
                let decay = rate * (1.0 + if z < -REACHED { -shape } else { shape }) * travelled;
                z * libm::exp(-decay) + travelled * mean_decay(decay)
            }
            Self::Play { half_width, .. } if lag >= half_width - REACHED => z + travelled,
            _ => z,
        }
    }

    /// Distance from a curve's start to where it has a corner, rad; infinite where it has none.
    fn corner(&self, z: f64, lag: f64) -> f64 {
        match *self {
            Self::Hysteresis { rate, shape, .. } if shape != 0.0 && z < -REACHED => {
                // Where z passes 0: exp(a) = 1 − b (1 − c) z at a = b (1 − c) times the distance.
                let rate = rate * (1.0 - shape);
                if -rate * z < REACHED { -z } else { libm::log1p(-rate * z) / rate }
            }
            Self::Play { half_width, .. } if lag < half_width - REACHED => half_width - lag,
            _ => f64::INFINITY,
        }
    }
}

/// What a joint remembers: where its curves started, and z of every element there (of those that
/// are integrated: z now).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Since {
    /// Angle of the joint at the curves' start, rad, whole turns taken out as of the state.
    pub(super) angle: f64,
    /// The same angle, counted on from the start's within [−π, π).
    unwrapped: f64,
    /// Direction of motion since then (±1).
    pub(super) sign: f64,
    /// State z of every element.
    pub(super) states: [f64; MOST],
    /// Distance from there to the first corner of a curve, rad; infinite where there is none.
    pub(super) corner: f64,
}

impl Since {
    /// A joint without a past that moves in a direction.
    pub(super) fn start(memories: &[Memory], angle: f64, sign: f64) -> Self {
        let unwrapped = angle - TAU * libm::floor((angle + PI) / TAU);
        Self { angle, unwrapped, sign, states: [0.0; MOST], corner: 0.0 }.with_corner(memories)
    }

    fn with_corner(self, memories: &[Memory]) -> Self {
        let corners = memories.iter().zip(self.states).map(|(m, z)| m.corner(self.sign * z, self.lag(z)));
        Self { corner: corners.fold(f64::INFINITY, f64::min), ..self }
    }

    /// x − z at the curves' start, in the direction of motion.
    fn lag(&self, z: f64) -> f64 {
        self.sign * (self.unwrapped - z)
    }

    /// Distance in the direction of motion since the curves' start, rad.
    fn travelled(&self, angle: f64) -> f64 {
        self.sign * (angle - self.angle)
    }

    /// Distance that is left to the first corner, rad; negative beyond it.
    pub(super) fn left_to_corner(&self, angle: f64) -> f64 {
        self.corner - self.travelled(angle)
    }

    /// z of an element whose state is `z` in [`Self::states`].
    fn now(&self, memory: &Memory, z: f64, angle: f64) -> f64 {
        self.sign * memory.followed(self.sign * z, self.lag(z), self.travelled(angle))
    }

    /// Torque of the elements, N m.
    pub(super) fn torque(&self, memories: &[Memory], angle: f64, v: f64) -> f64 {
        memories.iter().zip(self.states).map(|(m, z)| m.torque(self.now(m, z, angle), v, self.sign)).sum()
    }

    /// The memory with curves that start at an angle, beyond which the joint moves in the direction
    /// `sign`.
    pub(super) fn restarted(&self, memories: &[Memory], angle: f64, sign: f64) -> Self {
        let mut states = self.states;
        for (z, memory) in states.iter_mut().zip(memories) {
            *z = self.now(memory, *z, angle);
        }
        let unwrapped = self.unwrapped + (angle - self.angle);
        Self { angle, unwrapped, sign, states, corner: 0.0 }.with_corner(memories)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// z of one element along a course of angles, from one reversal to the next.
    fn along(memory: Memory, course: &[f64]) -> Vec<f64> {
        let memories = [memory];
        let mut since = Since::start(&memories, course[0], (course[1] - course[0]).signum());
        let legs = course.windows(2).map(|leg| {
            let sign = (leg[1] - leg[0]).signum();
            since = since.restarted(&memories, leg[0], sign);
            while since.left_to_corner(leg[1]) < 0.0 {
                since = since.restarted(&memories, since.angle + sign * since.corner, sign);
            }
            since.now(&memory, since.states[0], leg[1])
        });
        legs.collect()
    }

    #[test]
    fn play_is_pushed_at_its_ends() {
        let play = Memory::Play { stiffness: 1.0, half_width: 0.1 };
        let close = |course: &[f64], wanted: &[f64]| {
            for (got, wanted) in along(play, course).iter().zip(wanted) {
                assert!((got - wanted).abs() < 1e-12, "{course:?}: {got} {wanted}");
            }
        };
        close(&[0.0, 0.05, -0.05, 0.5, 0.35, 0.0, -9.0, -8.9, -8.7], &[0.0, 0.0, 0.4, 0.4, 0.1, -8.9, -8.9, -8.8]);
        // Outside the play at the start, and a turn away from it.
        close(&[1.2, 1.5, 0.5, 0.2, 0.1, 0.35], &[0.3, 0.3, 0.3, 0.2, 0.25]);
        close(&[TAU - 0.3, TAU - 0.15, TAU, TAU + 0.3], &[0.0, 0.0, 0.2]);
    }

    #[test]
    fn hysteresis_follows_its_equation_through_corners() {
        for (rate, shape) in [(5.0, 0.6), (5.0, 1.0), (5.0, -1.0), (0.0, 0.3), (1e-9, 0.3), (40.0, 0.0)] {
            let course = [0.3, 0.9, 0.8, -0.6, 2.0, 1.9, -1.0];
            let mut z = 0.0_f64;
            let got = along(Memory::Hysteresis { stiffness: 1.0, rate, shape }, &course);
            for (leg, got) in course.windows(2).zip(got) {
                // Heun's rule.
                let h = (leg[1] - leg[0]) / 20_000.0;
                let slope = |z: f64| 1.0 - rate * (h.signum() * z + shape * z.abs());
                for _ in 0..20_000 {
                    let first = slope(z);
                    z += 0.5 * h * (first + slope(z + h * first));
                }
                assert!((z - got).abs() < 1e-7, "{rate} {shape} {leg:?}: {z} {got}");
            }
        }
    }
}
