//! The double pendulum's absolute angles φ1, φ2 (rad, unwrapped) and the drive's phase, segment by
//! segment. A single pendulum is one whose φ2 stays 0.
//!
//! Encoder 1 is absolute, encoder 2 usually measures arm 2 relative to arm 1: φ1 = θ1, φ2 = θ1 +
//! θ2. Channels that measure `phi1`, `phi2` directly are taken as they are. The drive's phase is
//! the device's own where the record has it, otherwise τ = 2π f_e t with the record's t.

use core::f64::consts::TAU;
use std::borrow::Cow;

use crate::error::{BadInput, Result};
use crate::record::Record;
use crate::rig::Rig;

/// Absolute angles over one unbroken segment.
#[derive(Clone, Debug)]
pub struct AngleSegment {
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Spacing, s.
    pub step_s: f64,
    /// φ1 and φ2, rad, unwrapped.
    pub phi: [Vec<f64>; 2],
    /// Phase of the drive.
    pub phase: Phase,
    /// Whether the second sensor measures arm 2 relative to arm 1, so that the first one's noise is
    /// in φ2 as well.
    pub relative: bool,
    /// Size of one count of each sensor, rad; `None` for a sensor that does not count.
    pub count_rad: [Option<f64>; 2],
}

/// Where the phase of the drive comes from.
#[derive(Clone, Debug)]
pub enum Phase {
    /// Recorded by the device, turns · 2⁻³² at each sample.
    Device(Vec<u32>),
    /// τ = Ω t with this Ω, rad/s (0 for a free system).
    Clock(f64),
}

impl AngleSegment {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.phi[0].len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What a sensor measured: φ1 the first; φ2, or φ2 − φ1, the second.
    pub fn sensor(&self, which: usize) -> Cow<'_, [f64]> {
        if which == 1 && self.relative {
            Cow::Owned(self.phi[1].iter().zip(&self.phi[0]).map(|(b, a)| b - a).collect())
        } else {
            Cow::Borrowed(&self.phi[which])
        }
    }

    /// What the two sensors measured.
    pub fn sensors(&self) -> [Vec<f64>; 2] {
        [0, 1].map(|i| self.sensor(i).into_owned())
    }

    /// Time of sample i, s.
    pub fn time(&self, i: usize) -> f64 {
        self.start_s + i as f64 * self.step_s
    }

    /// τ of the drive at sample i, rad.
    pub fn tau(&self, i: usize) -> f64 {
        match &self.phase {
            Phase::Device(turns) => f64::from(turns[i]) * (TAU / 4_294_967_296.0),
            Phase::Clock(omega) => omega * self.time(i),
        }
    }
}

/// The angle of a single pendulum, in every segment of a record, as φ1; φ2 stays 0.
///
/// # Errors
/// The rig must measure `theta1` or `phi1`.
pub fn single_pendulum_angle(record: &Record, rig: &Rig) -> Result<Vec<AngleSegment>> {
    let only = ["theta1", "phi1"].iter().find_map(|n| record.channel_of(n)).ok_or_else(|| {
        BadInput::new("no such channel", "a [[channel]] that measures theta1 or phi1")
            .in_file(&rig.path)
            .at("channel")
            .remedy("The single pendulum needs its angle")
    })?;
    let channel = &record.channels[only];
    let omega = rig.drive.map_or(0.0, |d| TAU * d.frequency_hz);
    let out = record.segments.iter().map(|segment| {
        let phi = segment.columns[only].angle(channel);
        AngleSegment {
            start_s: segment.start_s,
            step_s: segment.step_s,
            phase: match (&segment.phase, rig.drive) {
                (Some(phase), Some(_)) => Phase::Device(phase.clone()),
                _ => Phase::Clock(omega),
            },
            relative: false,
            count_rad: [(channel.unit == "count").then(|| channel.scale()), None],
            phi: [phi.clone(), vec![0.0; phi.len()]],
        }
    });
    Ok(out.collect())
}

/// φ1 and φ2 of every segment of a record.
///
/// # Errors
/// The rig must measure one of `theta1`, `phi1` and one of `theta2`, `phi2`.
pub fn double_pendulum_angles(record: &Record, rig: &Rig) -> Result<Vec<AngleSegment>> {
    let find = |names: [&'static str; 2]| {
        names.iter().find_map(|n| record.channel_of(n).map(|i| (i, *n))).ok_or_else(|| {
            BadInput::new("no such channel", format!("a [[channel]] that measures {} or {}", names[0], names[1]))
                .in_file(&rig.path)
                .at("channel")
                .remedy("The double pendulum needs both of its angles")
        })
    };
    let (first, _) = find(["theta1", "phi1"])?;
    let (second, second_name) = find(["theta2", "phi2"])?;
    let omega = rig.drive.map_or(0.0, |d| TAU * d.frequency_hz);
    let count_rad = [first, second].map(|i| {
        let c = &record.channels[i];
        (c.unit == "count").then(|| c.scale())
    });
    let mut out = Vec::with_capacity(record.segments.len());
    for segment in &record.segments {
        let angle = |i: usize| segment.columns[i].angle(&record.channels[i]);
        let (phi1, mut phi2) = rayon::join(|| angle(first), || angle(second));
        if second_name == "theta2" {
            phi2.iter_mut().zip(&phi1).for_each(|(b, a)| *b += a);
        }
        let phase = match (&segment.phase, rig.drive) {
            (Some(phase), Some(_)) => Phase::Device(phase.clone()),
            _ => Phase::Clock(omega),
        };
        out.push(AngleSegment {
            start_s: segment.start_s,
            step_s: segment.step_s,
            phi: [phi1, phi2],
            phase,
            relative: second_name == "theta2",
            count_rad,
        });
    }
    Ok(out)
}
