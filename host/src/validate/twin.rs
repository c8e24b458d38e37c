//! A record that the identified model makes itself: the same sensors, rate, drive and inputs, so
//! that every analysis of the measured record has its counterpart.

use core::f64::consts::TAU;
use std::path::PathBuf;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::identify::remeasured::Sensors;
use crate::identify::stretches::{Stretch, mixed};
use crate::model::dynamics::Dynamics;
use crate::model::flow::{Flow, Outside, Work};
use crate::record::{Column, Losses, Record, Segment};
use crate::rig::measures::Bound;
use crate::signal::angles::Phase;

/// A model's record: `count` samples from `state` at the first sample of `stretch`, which is at
/// `outside`'s origin. `like`: the measured record, whose channels it copies; inputs are the
/// stretch's; `noise`: of the sensors, uniform and seeded where they do not count. None where the
/// equations have no solution that far.
pub fn record<D: Dynamics + ?Sized>(
    (dynamics, parameters, step_s): (&D, &[f64], f64),
    like: &Record,
    (stretch, bound): (&Stretch, &Bound),
    state: &[f64],
    outside: Outside<'_>,
    count: usize,
    noise: &Sensors,
    seed: u64,
) -> Option<Record> {
    let driven = !matches!(stretch.phase, Phase::Clock(0.0));
    let (tau, omega) = (outside.tau, outside.omega);
    let flow = Flow::new(dynamics, parameters, outside, step_s);
    let mut work = Work::plain(dynamics);
    work.set(state);
    let mut coordinates = vec![Vec::with_capacity(count); dynamics.degrees_of_freedom()];
    let good = flow.samples(&mut work, outside.origin, stretch.step_s, count, |_, q| {
        coordinates.iter_mut().zip(q).for_each(|(x, q)| x.push(*q));
    });
    if !good || !coordinates.iter().flatten().all(|x| x.abs() < 1e6) {
        return None;
    }
    let shown = mixed(&bound.shown, &coordinates);
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
                return Column::Values(stretch.inputs[input].iter().take(count).map(|u| u / scale).collect());
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
        segments: vec![Segment {
            first_tick: 0,
            boot: 0,
            start_s: stretch.start_s,
            step_s: stretch.step_s,
            jitter_s: 0.0,
            columns,
            phase,
            amplitude_nm: None,
        }],
        losses: Losses { received: count as u64, ..Losses::default() },
        warnings: Vec::new(),
        metadata: None,
        numbering: None,
    })
}
