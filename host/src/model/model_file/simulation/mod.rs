//! Records of a system that a user wrote down: its equations of motion integrated from `[plant]`'s
//! truth, sampled as its channels would.

pub mod excitation;
pub mod live;
pub mod plant;

use core::f64::consts::TAU;
use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use self::excitation::Signal;
use self::plant::Plant;
use super::equations_of_motion::EquationsOfMotion;
use super::expression::Node;
use crate::effects::columns::Span;
use crate::effects::on_a_record::{self, Addition, Samples};
use crate::effects::put_in;
use crate::error::{BadInput, Result};
use crate::model::integrate::{Outside, Settings, solve};
use crate::record::Column;
use crate::record::values::{column, write_values};
use crate::rig::measures::ObservedModel;
use crate::rig::{MOST_SAMPLES, Rig, check_seconds};
use crate::signal::band_limited::BandLimited;

/// Error of one step.
const TOLERANCE: f64 = 1e-10;
/// Steps within one sampling interval at most: how finely reversals under dry friction are placed.
const FINEST: f64 = 400.0;
/// The same where effects have states: one that settles within less than a third of such a step
/// would swing up instead.
const FINEST_OF_STATES: f64 = 4000.0;

/// What to do about a motion that has no solution.
fn unsolved(settings: &Settings) -> String {
    let remedy = "Correct the coefficients, the initial state or the inputs";
    if settings.finest <= FINEST {
        return remedy.to_owned();
    }
    let least_s = settings.step_s / settings.finest / 3.0;
    format!(
        "{remedy}; states of effects must take more than {least_s:.1e} s to settle: give them a greater distance or time"
    )
}

/// An input as it acts: few sines are summed, many tabled.
enum Acting {
    Exact(Signal),
    Tabled(BandLimited),
}

struct Surroundings {
    inputs: Vec<Acting>,
    omega: f64,
    /// What runs ahead in the phase: law of time, strength.
    advances: Vec<(Node, f64)>,
}

impl Outside for Surroundings {
    fn tau(&self, time: f64) -> f64 {
        self.omega * time + self.advances.iter().map(|(law, k)| k * law.value(&|_| time)).sum::<f64>()
    }

    fn inputs(&self, time: f64, out: &mut [f64]) {
        for (o, i) in out.iter_mut().zip(&self.inputs) {
            *o = match i {
                Acting::Exact(s) => s.value(time),
                Acting::Tabled(b) => b.value(time),
            };
        }
    }
}

/// One column for each channel of the rig, over `seconds` from t = 0 on; `effects` are those of the
/// catalogue, `ID@PLACE=VALUE[,name=value]`, that the plant has beside the model's terms.
///
/// # Errors
/// A plant that is missing or cannot be integrated, seconds out of range.
pub fn columns(rig: &Rig, bound: &ObservedModel, effects: &[String], seconds: f64, seed: u64) -> Result<Vec<Column>> {
    let rate = rig.sample_rate_hz;
    check_seconds(seconds, rate, MOST_SAMPLES)?;
    let model = &*bound.model;
    let plant = Plant::of(rig, model, seconds, seed)?;
    let span = Span { start_s: 0.0, length_s: seconds };
    let put_in = put_in::of(rig, bound, &plant.physical, &plant.coefficients, effects, span)?;
    let motion = EquationsOfMotion::with_columns(model, rig.omega(), &put_in.terms)?;
    let initial = motion.with_states(&plant.initial, &[]);
    let coefficients = [&plant.coefficients[..], &put_in.strengths].concat();
    let step = 1.0 / rate;
    // Both bounded above.
    let settle = (plant.settle_s * rate).round() as usize;
    let count = ((seconds * rate).round() as usize).max(1);
    let start_s = -(settle as f64) * step;
    let table = |s: &Signal| {
        let samples: Vec<f64> = (0..settle + count + 1).map(|i| s.value(start_s + i as f64 * step)).collect();
        BandLimited::new(&samples, start_s, step)
    };
    let surroundings = Surroundings {
        inputs: plant
            .inputs
            .iter()
            .map(|s| if s.is_long() { Acting::Tabled(table(s)) } else { Acting::Exact(s.clone()) })
            .collect(),
        omega: rig.drive.map_or(0.0, |d| TAU * d.frequency_hz),
        advances: put_in.advances,
    };
    let settings = Settings {
        start_s,
        step_s: step,
        count: settle + count,
        tolerance: TOLERANCE,
        inputs: model.inputs.len(),
        finest: if motion.hidden().is_empty() { FINEST } else { FINEST_OF_STATES },
    };
    let mut states = solve(&motion, &coefficients, &initial, &surroundings, &settings).ok_or_else(|| {
        BadInput::new(
            "a motion that leaves the finite numbers, or a singular mass matrix",
            "a plant that can be simulated",
        )
        .in_file(&rig.path)
        .at("[plant]")
        .remedy(unsolved(&settings))
    })?;
    // States of effects are no part of what is shown.
    let (n, all) = (model.coordinates.len(), initial.len() / 2);
    for y in &mut states {
        y.copy_within(all..all + n, n);
        y.truncate(2 * n);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rig.channel
        .iter()
        .enumerate()
        .map(|(k, c)| {
            rng.set_stream(k as u64);
            let shown: Vec<f64> = match bound.inputs.iter().position(|&i| i == k) {
                Some(input) => {
                    let remedy = "[plant] gives the base's acceleration, of which no position is written";
                    bound.refuse_base_position(rig, input, remedy)?;
                    recorded(&surroundings, input, model.inputs.len(), &of(&put_in.records, input), step, count)
                }
                None => {
                    let row = bound.sensors.iter().position(|&i| i == k).unwrap_or(0);
                    shown_with(bound, row, &states, &of(&put_in.reads, row), (start_s, step)).split_off(settle)
                }
            };
            let scale = c.scale();
            let noisy = shown.into_iter().map(|x| x / scale + plant.noise[k] * gauss(&mut rng));
            column(c, noisy).ok_or_else(|| {
                BadInput::new("an angle beyond 32 bits of counts", "fewer turns").in_file(&rig.path).at("[plant]")
            })
        })
        .collect()
}

/// The additions to one sensor or input.
fn of(all: &[(usize, Node, f64)], which: usize) -> Vec<Addition> {
    all.iter().filter(|a| a.0 == which).map(|(_, law, k)| (law.clone(), *k)).collect()
}

/// What a sensor ought to show of a state (coordinates, then rates).
fn shown(bound: &ObservedModel, row: usize, state: &[f64]) -> f64 {
    let n = bound.shown.ncols();
    bound.shown.row(row).iter().zip(&state[..n]).map(|(s, q)| s * q).sum()
}

/// What it shows of states from a time on, with what laws add.
fn shown_with(
    bound: &ObservedModel,
    row: usize,
    states: &[Vec<f64>],
    laws: &[Addition],
    (start_s, step_s): (f64, f64),
) -> Vec<f64> {
    let n = bound.shown.ncols();
    let values: Vec<f64> = states.iter().map(|y| shown(bound, row, y)).collect();
    if laws.is_empty() {
        return values;
    }
    let rates: Vec<f64> = states.iter().map(|y| shown(bound, row, &y[n..])).collect();
    on_a_record::put_on(&Samples { values: &values, start_s, step_s }, Some(&rates), laws)
}

/// What is recorded of an input, with what laws add. It is known at all times: delays shift it.
fn recorded(
    surroundings: &Surroundings,
    input: usize,
    inputs: usize,
    laws: &[Addition],
    step_s: f64,
    count: usize,
) -> Vec<f64> {
    let (delay_s, other) = on_a_record::delay(laws);
    let mut at = vec![0.0; inputs];
    let mut one = |i: usize| {
        surroundings.inputs(i as f64 * step_s - delay_s, &mut at);
        at[input]
    };
    let values: Vec<f64> = (0..count).map(&mut one).collect();
    on_a_record::put_on(&Samples { values: &values, start_s: -delay_s, step_s }, None, &other)
}

/// A standard normal number (Box and Muller).
fn gauss(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
}

/// Simulates a rig and writes its record; the number of samples.
///
/// # Errors
/// As [`columns`]; a file that cannot be written.
pub fn record(
    rig: &Rig,
    bound: &ObservedModel,
    effects: &[String],
    seconds: f64,
    seed: u64,
    output: &Path,
) -> Result<u64> {
    let columns = columns(rig, bound, effects, seconds, seed)?;
    write_values(output, rig, &columns)?;
    Ok(columns.first().map_or(0, Column::len) as u64)
}
