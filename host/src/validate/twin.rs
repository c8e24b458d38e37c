//! A record that the identified model makes itself: the same sensors, rate and drive, so that every analysis of the measured record has its counterpart.

use core::f64::consts::TAU;
use std::path::PathBuf;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::model::dynamics::Dynamics;
use crate::model::flow::{Flow, Outside, Work};
use crate::record::{Column, Losses, Record, Segment};
use crate::signal::angles::{AngleSegment, Phase};

/// A model's record: `count` samples from `state` at the first sample of `segment`. `like`: the measured record, whose channels it copies; `sigma`: noise of the sensors that do not count (rad),
/// uniform and seeded. None where the equations have no solution that far.
pub fn record<D: Dynamics + ?Sized>(
    dynamics: &D,
    parameters: &[f64],
    like: &Record,
    segment: &AngleSegment,
    state: &[f64],
    omega: f64,
    step_s: f64,
    count: usize,
    sigma: [f64; 2],
    seed: u64,
) -> Option<Record> {
    let tau = segment.tau(0);
    let driven = !matches!(segment.phase, Phase::Clock(0.0));
    let flow = Flow::new(dynamics, parameters, Outside::drive(segment.start_s, tau, omega), step_s);
    let mut work = Work::plain(dynamics);
    work.set(state);
    let mut phi: [Vec<f64>; 2] = [Vec::with_capacity(count), Vec::with_capacity(count)];
    let good = flow.samples(&mut work, segment.start_s, segment.step_s, count, |_, q| {
        phi[0].push(q[0]);
        phi[1].push(q[1]);
    });
    if !good || phi.iter().flatten().any(|x| x.abs() > 1e6) {
        return None;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let columns = like
        .channels
        .iter()
        .map(|c| {
            let sensor = usize::from(c.measures.ends_with('2'));
            let angle = |i: usize| match c.measures.as_str() {
                "theta1" | "phi1" => phi[0][i],
                "theta2" => phi[1][i] - phi[0][i],
                "phi2" => phi[1][i],
                _ => 0.0,
            };
            let scale = c.scale();
            if c.unit == "count" {
                // At most 10⁶ rad: a count fits 32 bits for any encoder of up to 13 000 counts a turn, and saturates beyond.
                Column::Counts((0..count).map(|i| (angle(i) / scale).floor() as i32).collect())
            } else {
                let width = 2.0 * 3f64.sqrt() * sigma[sensor];
                Column::Values((0..count).map(|i| (angle(i) + width * (rng.random::<f64>() - 0.5)) / scale).collect())
            }
        })
        .collect();
    let turns = |i: usize| ((tau + omega * i as f64 * segment.step_s) / TAU).rem_euclid(1.0);
    let phase = driven.then(|| (0..count).map(|i| (turns(i) * 4_294_967_296.0) as u32).collect());
    Some(Record {
        path: PathBuf::from("simulated by the identified model"),
        sample_rate_hz: like.sample_rate_hz,
        channels: like.channels.clone(),
        segments: vec![Segment {
            first_tick: 0,
            start_s: segment.start_s,
            step_s: segment.step_s,
            jitter_s: 0.0,
            columns,
            phase,
            amplitude_nm: None,
        }],
        losses: Losses { received: count as u64, ..Losses::default() },
        warnings: Vec::new(),
        metadata: None,
    })
}
