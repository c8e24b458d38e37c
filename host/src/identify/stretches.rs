//! A record in the coordinates and inputs of a model file: unbroken stretches in SI units.

use core::f64::consts::TAU;
use std::sync::Arc;

use super::base_motion::{self, BaseNoise};
use super::held_inputs;
use super::history::History;
use crate::error::{BadInput, Result};
use crate::model::model_file::Space;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::signal::angles::Phase;

/// Coordinates and inputs over one unbroken stretch.
#[derive(Clone, Debug)]
pub struct Stretch {
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Spacing, s.
    pub step_s: f64,
    /// One column for each coordinate, rad or m …, angles unwrapped.
    pub coordinates: Vec<Vec<f64>>,
    /// One column for each input.
    pub inputs: Vec<Vec<f64>>,
    /// Phase of the drive.
    pub phase: Phase,
    /// Commanded amplitude of the base, nm, where the device recorded it.
    pub amplitude_nm: Option<Vec<u32>>,
    /// States of effects that remember, where some are looked for.
    pub history: Option<Arc<History>>,
    /// Noise of the base's channel, where it is measured.
    pub base: Option<Arc<BaseNoise>>,
}

impl Stretch {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.coordinates.first().map_or(0, Vec::len)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
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

    /// A followed state of an effect at `count` samples from `first` on; NaN where nothing is
    /// followed.
    pub fn remembered(&self, number: usize, first: usize, count: usize) -> Vec<f64> {
        let nothing = || vec![f64::NAN; count];
        self.history.as_ref().map_or_else(nothing, |h| h.since(number, self.time(first), count))
    }

    /// The samples first … last as a stretch of their own.
    pub fn part(&self, first: usize, last: usize) -> Self {
        let cut = |list: &[Vec<f64>]| list.iter().map(|x| x[first..last].to_vec()).collect();
        Self {
            start_s: self.time(first),
            step_s: self.step_s,
            coordinates: cut(&self.coordinates),
            inputs: cut(&self.inputs),
            phase: match &self.phase {
                Phase::Device(p) => Phase::Device(p[first..last].to_vec()),
                Phase::Clock(w) => Phase::Clock(*w),
            },
            amplitude_nm: self.amplitude_nm.as_ref().map(|a| a[first..last].to_vec()),
            history: self.history.clone(),
            base: self.base.clone(),
        }
    }

    /// The same with these zeros of the sensors taken off: q − S⁻¹ z.
    pub fn shifted(&self, bound: &ObservedModel, zeros: &[f64]) -> Self {
        let mut out = self.clone();
        for (j, q) in out.coordinates.iter_mut().enumerate() {
            let shift: f64 = zeros.iter().enumerate().map(|(k, z)| bound.coordinates[(j, k)] * z).sum();
            q.iter_mut().for_each(|q| *q -= shift);
        }
        out
    }

    /// What the sensors showed, y = S q.
    pub fn sensors(&self, bound: &ObservedModel) -> Vec<Vec<f64>> {
        mixed(&bound.shown, &self.coordinates)
    }
}

/// The columns M x.
pub fn mixed(matrix: &nalgebra::DMatrix<f64>, x: &[Vec<f64>]) -> Vec<Vec<f64>> {
    (0..matrix.nrows())
        .map(|r| {
            let mut out: Option<Vec<f64>> = None;
            for (k, x) in x.iter().enumerate() {
                let f = matrix[(r, k)];
                if f == 0.0 {
                    continue;
                }
                match &mut out {
                    // A sensor that shows one coordinate shows it as it is.
                    None if f == 1.0 => out = Some(x.clone()),
                    None => out = Some(x.iter().map(|x| f * x).collect()),
                    Some(out) => out.iter_mut().zip(x).for_each(|(o, x)| *o += f * x),
                }
            }
            out.unwrap_or_default()
        })
        .collect()
}

/// Every stretch of a record.
///
/// # Errors
/// A channel in counts for a coordinate on a line, whose counts have no length.
pub fn of(record: &Record, rig: &Rig, bound: &ObservedModel) -> Result<Vec<Stretch>> {
    for (row, &i) in bound.sensors.iter().enumerate() {
        let c = &record.channels[i];
        let mut coordinates = bound.model.coordinates.iter().enumerate();
        let on_line = coordinates.any(|(k, q)| bound.shown[(row, k)] != 0.0 && q.space == Space::Line);
        if on_line && c.unit == "count" && matches!(c.counts_per_turn, Some(0) | None) {
            return Err(BadInput::new("unit \"count\"", "a unit of length").in_file(&rig.path).at("channel"));
        }
    }
    let omega = rig.drive.map_or(0.0, |d| TAU * d.frequency_hz);
    let base = base_motion::of(record, rig, bound);
    let values = |i: usize| record.segments.iter().map(move |s| s.columns[i].angle(&record.channels[i]));
    let held: Vec<bool> = bound
        .inputs
        .iter()
        .map(|&i| {
            let all: Vec<Vec<f64>> = values(i).collect();
            held_inputs::is_held(all.iter().map(Vec::as_slice))
        })
        .collect();
    let measured = record.segments.iter().enumerate();
    Ok(measured
        .filter_map(|(n, s)| {
            let column = |i: usize| s.columns[i].angle(&record.channels[i]);
            let acting = |(k, &i): (usize, &usize)| {
                let recorded = column(i);
                if held[k] { held_inputs::acting(&recorded) } else { recorded }
            };
            let shown: Vec<Vec<f64>> = bound.sensors.iter().map(|&i| column(i)).collect();
            let whole = Stretch {
                start_s: s.start_s,
                step_s: s.step_s,
                coordinates: mixed(&bound.coordinates, &shown),
                inputs: bound.inputs.iter().enumerate().map(acting).collect(),
                phase: match (&s.phase, rig.drive) {
                    (Some(phase), Some(_)) => Phase::Device(phase.clone()),
                    _ => Phase::Clock(omega),
                },
                amplitude_nm: s.amplitude_nm.clone(),
                history: None,
                base: base.as_ref().map(|b| b.noise.clone()),
            };
            let (Some(base), Some(k)) = (&base, bound.base) else { return Some(whole) };
            let acceleration = &base.accelerations[n];
            if acceleration.is_empty() {
                return None;
            }
            let mut part = whole.part(base.trimmed, base.trimmed + acceleration.len());
            part.inputs[k].clone_from(acceleration);
            Some(part)
        })
        .collect())
}
