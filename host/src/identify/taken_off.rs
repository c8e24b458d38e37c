//! A record's stretches read again with what effects add to sensors and inputs, and what they
//! advance the drive's phase by, taken off.

use core::f64::consts::TAU;
use std::collections::BTreeMap;

use super::stretches::{Stretch, mixed};
use crate::effects::on_a_record::{self, Addition, Samples};
use crate::model::model_file::expression::Node;
use crate::rig::measures::ObservedModel;
use crate::signal::angles::Phase;

/// What effects change of a record alone.
#[derive(Clone, Debug, Default)]
pub struct OfTheRecord {
    /// Additions to what sensors show, by sensor.
    sensors: BTreeMap<usize, Vec<Addition>>,
    /// Additions to what is recorded of inputs, by input.
    inputs: BTreeMap<usize, Vec<Addition>>,
    /// What runs ahead in the drive's phase: laws of time.
    phase: Vec<Addition>,
}

impl OfTheRecord {
    /// Joins additions to what a sensor shows.
    pub fn sensor(&mut self, sensor: usize, laws: impl IntoIterator<Item = Addition>) {
        self.sensors.entry(sensor).or_default().extend(laws.into_iter().filter(|l| l.1 != 0.0));
    }

    /// Joins additions to what is recorded of an input.
    pub fn input(&mut self, input: usize, laws: impl IntoIterator<Item = Addition>) {
        self.inputs.entry(input).or_default().extend(laws.into_iter().filter(|l| l.1 != 0.0));
    }

    /// Joins what runs ahead in the phase.
    pub fn phase(&mut self, laws: impl IntoIterator<Item = Addition>) {
        self.phase.extend(laws.into_iter().filter(|l| l.1 != 0.0));
    }

    /// A stretch freed of all of it.
    #[must_use]
    pub fn taken_off(&self, s: &Stretch, bound: &ObservedModel) -> Stretch {
        let mut out = s.clone();
        if s.is_empty() {
            return out;
        }
        let of = |values: &[f64], laws: &[Addition]| {
            on_a_record::taken_off(&Samples { values, start_s: s.start_s, step_s: s.step_s }, laws)
        };
        if self.sensors.values().any(|laws| !laws.is_empty()) {
            let mut shown = s.sensors(bound);
            for (sensor, laws) in self.sensors.iter().filter(|(_, laws)| !laws.is_empty()) {
                shown[*sensor] = of(&shown[*sensor], laws);
            }
            out.coordinates = mixed(&bound.coordinates, &shown);
        }
        for (input, laws) in self.inputs.iter().filter(|(_, laws)| !laws.is_empty()) {
            out.inputs[*input] = of(&s.inputs[*input], laws);
        }
        if !self.phase.is_empty() {
            out.phase = advanced(s, &self.phase);
        }
        out
    }
}

impl OfTheRecord {
    /// What a small error of each sensor becomes of its readings freed of all of it, rms dx/dy along
    /// the stretches: a sensor that shows (1 + s) x has its noise divided by 1 + s with what it
    /// shows, and what a model leaves is to be weighed by that. `noise`: of each sensor.
    pub fn gains(&self, stretches: &[Stretch], bound: &ObservedModel, noise: &[f64]) -> Vec<f64> {
        let mut gains = vec![1.0; noise.len()];
        for (sensor, laws) in self.sensors.iter().filter(|(_, laws)| !laws.is_empty()) {
            let (mut sum, mut count) = (0.0, 0_usize);
            for s in stretches {
                let shown = s.sensors(bound)[*sensor].clone();
                let off: Vec<f64> = shown.iter().map(|y| y + noise[*sensor]).collect();
                let of = |values: &[f64]| {
                    on_a_record::taken_off(&Samples { values, start_s: s.start_s, step_s: s.step_s }, laws)
                };
                let moved = of(&off).into_iter().zip(of(&shown)).map(|(a, b)| ((a - b) / noise[*sensor]).powi(2));
                sum += moved.sum::<f64>();
                count += shown.len();
            }
            let gain = (sum / count.max(1) as f64).sqrt();
            gains[*sensor] = if gain.is_finite() && gain > 0.0 { gain } else { 1.0 };
        }
        gains
    }
}

/// The phase of a drive that runs ahead of what is recorded.
fn advanced(s: &Stretch, laws: &[Addition]) -> Phase {
    let turns = (0..s.len()).map(|i| {
        let ahead: f64 = laws.iter().map(|(law, strength)| strength * law.value(&|_| s.time(i))).sum();
        // The fraction of a turn in units of 2⁻³²: below 2³² by construction, the cast cuts
        // nothing but the last whole turn.
        (((s.tau(i) + ahead) / TAU).rem_euclid(1.0) * 4_294_967_296.0) as u32
    });
    Phase::Device(turns.collect())
}

/// A strength that moves what a sensor shows by 1e-4 rad at most.
pub fn small_step(stretches: &[Stretch], bound: &ObservedModel, sensor: usize, law: &Node) -> f64 {
    let greatest = stretches.iter().map(|s| {
        let shown = s.sensors(bound);
        on_a_record::greatest(&Samples { values: &shown[sensor], start_s: s.start_s, step_s: s.step_s }, law)
    });
    1e-4 / greatest.fold(1e-9, f64::max)
}
