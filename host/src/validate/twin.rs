//! A record that the identified model makes itself: the same sensors, rate, drive and inputs, so
//! that every analysis of the measured record has its counterpart.

use core::f64::consts::TAU;
use std::path::PathBuf;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::comparisons::Beginning;
use crate::identify::input_noise;
use crate::identify::remeasured::Sensors;
use crate::identify::stretches::mixed;
use crate::model::flow::{Flow, Outside, Work};
use crate::motion::starts::Starts;
use crate::record::{Column, Losses, Record, Segment};
use crate::rig::measures::ObservedModel;
use crate::signal::angles::Phase;

/// What the model's own record shares with the measured one.
pub struct Twin<'a> {
    /// The measured record, whose channels it copies.
    pub like: &'a Record,
    /// What they measure.
    pub bound: &'a ObservedModel,
    /// Noise of the sensors, uniform and seeded where they do not count.
    pub noise: &'a Sensors,
    /// Its seed.
    pub seed: u64,
}

impl Twin<'_> {
    /// `count` samples from where a stretch begins, which is at `outside`'s origin; inputs are the
    /// stretch's, recorded with their noise once more. None where the equations have no solution that far.
    pub fn record(
        &self,
        starts: &Starts<'_>,
        begin: &Beginning<'_>,
        outside: Outside<'_>,
        count: usize,
    ) -> Option<Record> {
        let Self { like, bound, noise, seed } = *self;
        let stretch = begin.stretch;
        let driven = !matches!(stretch.phase, Phase::Clock(0.0));
        let (tau, omega) = (outside.tau, outside.omega);
        let dynamics = starts.dynamics;
        let flow = Flow::new(dynamics, starts.parameters, outside, starts.step_s);
        let mut work = Work::plain(dynamics);
        work.set(&begin.state);
        let mut coordinates = vec![Vec::with_capacity(count); dynamics.degrees_of_freedom()];
        let good = flow.samples(&mut work, outside.origin, stretch.step_s, count, |_, q| {
            coordinates.iter_mut().zip(q).for_each(|(x, q)| x.push(*q));
        });
        if !good || !coordinates.iter().flatten().all(|x| x.abs() < 1e6) {
            return None;
        }
        let shown = mixed(&bound.shown, &coordinates);
        let mut recorded = stretch.clone();
        input_noise::disturb(&mut recorded, &noise.inputs, 1.0, seed, 0);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut channels = like.channels.clone();
        if let Some(c) = bound.base.and_then(|k| bound.inputs.get(k)).and_then(|&i| channels.get_mut(i)) {
            // The stretch has its acceleration.
            "m/s2".clone_into(&mut c.unit);
        }
        let columns = channels
            .iter()
            .enumerate()
            .map(|(i, c)| {
                let scale = c.scale();
                if let Some(input) = bound.inputs.iter().position(|s| *s == i) {
                    return Column::Values(recorded.inputs[input].iter().take(count).map(|u| u / scale).collect());
                }
                let Some(sensor) = bound.sensors.iter().position(|s| *s == i) else {
                    return Column::Values(vec![0.0; count]);
                };
                let y = &shown[sensor];
                if c.unit == "count" {
                    // At most 10⁶ rad: a count fits 32 bits for any encoder of up to 13 000 counts a
                    // turn, and saturates beyond.
                    Column::Counts(y.iter().map(|y| (y / scale).floor() as i32).collect())
                } else {
                    let width = 2.0 * 3f64.sqrt() * noise.sigma[sensor];
                    Column::Values(y.iter().map(|y| (y + width * (rng.random::<f64>() - 0.5)) / scale).collect())
                }
            })
            .collect();
        let turns = |i: usize| ((tau + omega * i as f64 * stretch.step_s) / TAU).rem_euclid(1.0);
        let phase = driven.then(|| (0..count).map(|i| (turns(i) * 4_294_967_296.0) as u32).collect());
        Some(Record {
            path: PathBuf::from("simulated by the identified model"),
            sample_rate_hz: like.sample_rate_hz,
            channels,
            segments: vec![Segment { phase, ..Segment::new(stretch.start_s, stretch.step_s, columns) }],
            losses: Losses { received: count as u64, ..Losses::default() },
            ..Record::default()
        })
    }
}
