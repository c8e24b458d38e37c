//! The base's motion between two ticks: an ideal reconstruction of what the device commands.
//!
//! Along the drive, with θ the device's phase and ψ the shaker's lag,
//! `d(t) = a(t) [cos(θ − ψ) + Σ r cos(n θ − β)]`, and across it `A cos θ + B sin θ` (while the
//! phase advances). The drive is vertical (y_b = d, upward) or horizontal (x_b = a sin(θ − ψ),
//! toward positive angle, that is ψ + π/2 in the place of ψ). The phase advances evenly from tick
//! to tick; the amplitude follows a straight line between ticks, and its corners, which are
//! impulses of the base's velocity of at most the ramp's rate (mm/s), are left out of the
//! acceleration. Of a form of several components each is such a term at its own order, delayed by
//! as much time, and so is a table. Where the frequency has changed from one tick to the next, as it does in a sweep
//! every ten, the impulse of that corner is spread over the tick behind it. Phases in rad, displacements in m, times in s from the tick.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use whirl_shared::excitation::{Form, MOST_COMPONENTS, WHOLE};

use crate::plant::DriveAdditions;

mod hum;
mod spline;

pub use hum::Hum;
pub use spline::CommandShape;
use spline::Spline;

/// Direction of the base's motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// y_b = a cos(τ − ψ), upward.
    #[default]
    Vertical,
    /// x_b = a sin(τ − ψ), toward positive angle.
    Horizontal,
}

/// What a shaker makes of the device's commands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shaker {
    /// Direction.
    pub direction: Direction,
    /// Lag ψ of the base behind the device's phase, rad.
    pub psi: f64,
    /// Harmonics, motion across, drift and frequency offset.
    pub additions: DriveAdditions,
    /// Length of the record to which an amplitude drift refers, s.
    pub record_s: f64,
}

/// What the device commands from one tick to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Phase at the tick, turns · 2⁻³².
    pub phase: u32,
    /// Advance of the phase in one tick, turns · 2⁻³².
    pub phase_increment: u32,
    /// Its advance in the tick before; 0 at rest.
    pub increment_before: u32,
    /// Amplitude at this tick and at the next one, nm.
    pub amplitude_nanometre: [u32; 2],
    /// Shape of the motion.
    pub shape: CommandShape,
}

/// Most terms of the motion along the drive; more are refused when effects are read.
pub(crate) const MAX_TERMS: usize = 8;

/// Places for these and for the components of the drive's form beyond the first.
const PLACES: usize = MAX_TERMS + MOST_COMPONENTS - 1;

/// The base at one instant, and what else a law may depend on beside the state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// Acceleration (ẍ_b, ÿ_b), m/s².
    pub acceleration: [f64; 2],
    /// Velocity, m/s.
    pub velocity: [f64; 2],
    /// The device's phase τ, rad.
    pub phase: f64,
    /// Share of the record that has passed; 0 before it.
    pub share: f64,
    /// Time since the record's start, s; negative before it.
    pub time: f64,
}

impl From<[f64; 2]> for Moment {
    fn from(acceleration: [f64; 2]) -> Self {
        Self { acceleration, ..Self::default() }
    }
}

/// c(t) cos(n θ(t) − β) with c linear in time.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Term {
    order: f64,
    lag: f64,
    share: f64,
}

/// The base's motion over one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseMotion {
    horizontal: bool,
    phase: f64,
    omega: f64,
    /// Amplitude, its rate, and half its second derivative: m, m/s, m/s².
    amplitude: [f64; 3],
    terms: [Term; PLACES],
    used: usize,
    table: Option<Spline>,
    across: [f64; 2],
    /// The corner of the frequency at the tick, spread over it, m/s².
    corner: f64,
    /// Share of the record that has passed, and its rate, 1/s.
    share: [f64; 2],
    /// Time of the tick since the record's start, s.
    time: f64,
    hum: Hum,
}

impl BaseMotion {
    /// A base at rest.
    pub const REST: Self = Self {
        horizontal: false,
        phase: 0.0,
        omega: 0.0,
        amplitude: [0.0; 3],
        terms: [Term { order: 0.0, lag: 0.0, share: 0.0 }; PLACES],
        used: 0,
        table: None,
        across: [0.0; 2],
        corner: 0.0,
        share: [0.0; 2],
        time: 0.0,
        hum: Hum { amplitude_m: 0.0, frequency_hz: 0.0 },
    };

    /// The base at t seconds after the tick; its velocity only where it is asked for.
    pub fn at(&self, t: f64, with_velocity: bool) -> Moment {
        Moment {
            acceleration: self.acceleration(t),
            velocity: if with_velocity { self.velocity(t) } else { [0.0; 2] },
            phase: self.phase + self.omega * t,
            share: self.share[0] + self.share[1] * t,
            time: self.time + t,
        }
    }

    /// Velocity (ẋ_b, ẏ_b) at t seconds after the tick, m/s.
    pub fn velocity(&self, t: f64) -> [f64; 2] {
        let [_, hum, _] = self.hum.at(self.time + t);
        if self.omega == 0.0 {
            return self.both(hum, 0.0);
        }
        let theta = self.phase + self.omega * t;
        let [c0, c1, c2] = self.amplitude;
        let (c, rate) = (c0 + t * (c1 + t * c2), c1 + 2.0 * c2 * t);
        let one = |m: &Term| {
            let (sin, cos) = libm::sincos(m.order * theta - m.lag);
            m.share * (rate * cos - c * m.order * self.omega * sin)
        };
        let mut along: f64 = self.terms[..self.used].iter().map(one).sum();
        if let Some([y, slope, _]) = self.table.map(|table| table.at(theta)) {
            along += rate * y + c * self.omega * slope;
        }
        let (sin, cos) = libm::sincos(theta);
        let across = self.omega * (self.across[1] * cos - self.across[0] * sin);
        self.both(along + hum, across)
    }

    /// Along the drive and across it, as x and y.
    fn both(&self, along: f64, across: f64) -> [f64; 2] {
        if self.horizontal { [along, across] } else { [across, along] }
    }

    /// Acceleration (ẍ_b, ÿ_b) at t seconds after the tick, m/s².
    pub fn acceleration(&self, t: f64) -> [f64; 2] {
        let [.., hum] = self.hum.at(self.time + t);
        if self.omega == 0.0 {
            return self.both(hum, 0.0);
        }
        let theta = self.phase + self.omega * t;
        let [c0, c1, c2] = self.amplitude;
        let c = c0 + t * (c1 + t * c2);
        let rate = c1 + 2.0 * c2 * t;
        let mut along = self.corner;
        if c != 0.0 || rate != 0.0 {
            for term in &self.terms[..self.used] {
                let omega = term.order * self.omega;
                let (sin, cos) = libm::sincos(term.order * theta - term.lag);
                along += term.share * ((2.0 * c2 - c * omega * omega) * cos - 2.0 * rate * omega * sin);
            }
        }
        if let Some([y, slope, bend]) = self.table.map(|table| table.at(theta)) {
            along += 2.0 * c2 * y + 2.0 * rate * self.omega * slope + c * self.omega * self.omega * bend;
        }
        let mut across = 0.0;
        if self.across != [0.0; 2] {
            let (sin, cos) = libm::sincos(theta);
            across = -self.omega * self.omega * (self.across[0] * cos + self.across[1] * sin);
        }
        self.both(along + hum, across)
    }

    /// Displacement (x_b, y_b) at t seconds after the tick, m.
    pub fn displacement(&self, t: f64) -> [f64; 2] {
        let theta = self.phase + self.omega * t;
        let [c0, c1, c2] = self.amplitude;
        let c = c0 + t * (c1 + t * c2);
        let terms = self.terms[..self.used].iter();
        let mut along: f64 = terms.map(|m| c * m.share * libm::cos(m.order * theta - m.lag)).sum();
        if let Some([y, ..]) = self.table.map(|table| table.at(theta)) {
            along += c * y;
        }
        let (sin, cos) = libm::sincos(theta);
        let across = if self.omega == 0.0 { 0.0 } else { self.across[0] * cos + self.across[1] * sin };
        self.both(along + self.hum.at(self.time + t)[0], across)
    }

    /// The same motion, seen from `seconds` later.
    pub fn later(&self, seconds: f64) -> Self {
        let [c0, c1, c2] = self.amplitude;
        let mut later = *self;
        later.phase += self.omega * seconds;
        later.share[0] += self.share[1] * seconds;
        later.time += seconds;
        later.amplitude = [c0 + seconds * (c1 + seconds * c2), c1 + 2.0 * c2 * seconds, c2];
        later
    }
}

impl Shaker {
    /// The base's motion from the tick at `time_s` of the record to the next one, `tick_s` later.
    pub fn motion(&self, command: Command, time_s: f64, tick_s: f64) -> BaseMotion {
        let mut motion = BaseMotion::REST;
        motion.time = time_s;
        motion.hum = self.additions.hum;
        motion.horizontal = self.direction == Direction::Horizontal;
        let offset = self.additions.frequency_offset_hz;
        if command.phase_increment != 0 {
            let turns = f64::from(command.phase_increment) / 4_294_967_296.0;
            motion.omega = TAU * (turns / tick_s + offset);
        }
        motion.phase = TAU * (f64::from(command.phase) / 4_294_967_296.0);
        if offset != 0.0 {
            let turns = offset * time_s;
            motion.phase += TAU * (turns - turns.floor());
        }
        if time_s >= 0.0 && self.record_s > 0.0 {
            motion.share = [time_s / self.record_s, 1.0 / self.record_s];
        }
        let [now, next] = command.amplitude_nanometre.map(|nm| f64::from(nm) * 1e-9);
        let rate = (next - now) / tick_s;
        // Drift: a factor 1 + ε t/T from the record's start on.
        let growth =
            if time_s >= 0.0 && self.record_s > 0.0 { self.additions.amplitude_drift / self.record_s } else { 0.0 };
        let gain = 1.0 + self.additions.gain_error;
        let (now, rate) = (now * gain, rate * gain);
        let factor = 1.0 + growth * time_s.max(0.0);
        motion.amplitude = [now * factor, rate * factor + now * growth, rate * growth];
        let lag = match self.direction {
            Direction::Vertical => self.psi,
            Direction::Horizontal => self.psi + FRAC_PI_2,
        };
        let form = match command.shape {
            CommandShape::Sines(form) => Some(form),
            CommandShape::Table(table) => {
                motion.table = Spline::of(&table, motion.phase, lag);
                None
            }
        };
        for component in form.iter().flat_map(Form::components) {
            let order = f64::from(component.harmonic);
            let ahead = TAU * f64::from(component.phase) / 65_536.0;
            motion.terms[motion.used] =
                Term { order, lag: order * lag - ahead, share: f64::from(component.share) / f64::from(WHOLE) };
            motion.used += 1;
        }
        if command.increment_before != 0 && command.phase_increment != 0 {
            let step = f64::from(command.phase_increment) - f64::from(command.increment_before);
            let rate = TAU * step / 4_294_967_296.0 / tick_s;
            let one = |term: &Term| term.share * term.order * libm::sin(term.order * motion.phase - term.lag);
            let sum: f64 = motion.terms[..motion.used].iter().map(one).sum();
            motion.corner = -motion.amplitude[0] * rate * sum / tick_s;
        }
        for &(order, share, phase) in self.additions.harmonics.iter().take(MAX_TERMS - 1) {
            motion.terms[motion.used] = Term { order, lag: phase, share };
            motion.used += 1;
        }
        motion.across = self.additions.across;
        motion
    }
}

/// Advance of the phase in one tick for a frequency, turns · 2⁻³², rounded to the nearest as the
/// device does it. `None` unless 0 < f < rate/2.
pub fn phase_increment(frequency_hz: f64, sample_rate_hz: f64) -> Option<u32> {
    let turns = frequency_hz / sample_rate_hz;
    let increment = (turns * 4_294_967_296.0).round();
    (turns > 0.0 && turns < 0.5 && (1.0..2_147_483_648.0).contains(&increment)).then_some(increment as u32)
}

/// The angle in [−π, π) of a phase in turns · 2⁻³².
pub fn phase_radians(phase: u32) -> f64 {
    let angle = TAU * (f64::from(phase) / 4_294_967_296.0);
    if angle >= PI { angle - TAU } else { angle }
}

#[cfg(test)]
mod tests;
