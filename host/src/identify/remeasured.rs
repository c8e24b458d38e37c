//! Known motions measured again by every sensor: rows of a record that was smoothed and taken as
//! the truth, for the bias of [`super::noise_bias`] and for what noise leaves in each equation.

use nalgebra::DVector;
use pulp::{Arch, NullaryFnOnce};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::input_noise::{self, Level};
use super::noise_bias::{Bias, REPEATS, STRETCH, from_rows, places};
use super::per_record::Split;
use super::series::System;
use super::stretches::{Stretch, mixed};
use super::windows::{Kernels, Plan, Stretches, WindowRows, Windows, frequency_of_row, rows_planned};
use crate::rig::measures::ObservedModel;

/// One count of each sensor (none for one that does not count) and the noise of each, in SI.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensors {
    /// Size of a count.
    pub count: Vec<Option<f64>>,
    /// Standard deviation.
    pub sigma: Vec<f64>,
    /// Standard error of its square as a share of it; nothing for a sensor that counts, whose noise
    /// is that of its grid.
    pub square_error: Vec<f64>,
    /// Noise of each measured input.
    pub inputs: Vec<Level>,
}

/// Shift of a sensor's grid in a repeat, in counts: each sensor gets every quarter, in one of
/// several orders; further repeats get others, by the golden section of a quarter.
fn shift(repeat: usize, sensor: usize) -> f64 {
    const ORDERS: [[f64; REPEATS]; 4] = [
        [0.125, 0.375, 0.625, 0.875],
        [0.375, 0.875, 0.125, 0.625],
        [0.625, 0.125, 0.875, 0.375],
        [0.875, 0.625, 0.375, 0.125],
    ];
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let (again, repeat) = (repeat / REPEATS, repeat % REPEATS);
    (ORDERS[sensor % 4][repeat] + 0.25 * GOLDEN * again as f64).fract()
}

/// Rows of known motions, as they are and measured again.
pub struct Remeasured {
    stretches: usize,
    plain: Vec<WindowRows>,
    repeats: Vec<Vec<WindowRows>>,
}

impl Remeasured {
    /// Smooths parts of the record, takes them as the truth and measures them again with every
    /// sensor's noise.
    pub fn new(
        system: &System<'_>,
        windows: &Windows,
        bound: &ObservedModel,
        sensors: &Sensors,
        split: &Split,
        record_of: &[usize],
    ) -> Self {
        let (weak, kernels) = (system.weak, system.kernels);
        let (truth, from) = smoothed(system, windows);
        let record_of: Vec<usize> = from.iter().map(|&s| record_of.get(s).copied().unwrap_or(0)).collect();
        let plan = Plan::new(kernels, windows, system.step_s(0), STRETCH);
        let rows = |stretches: &[Stretch]| -> Vec<WindowRows> {
            let mut rows = rows_planned(&System { stretches, ..*system }, &weak.equations, &plan);
            split.spread(&mut rows, &record_of);
            rows
        };
        let plain = rows(&truth);
        let repeats = (0..REPEATS).map(|r| rows(&repeat(&truth, r, bound, sensors))).collect();
        Self { stretches: truth.len(), plain, repeats }
    }

    /// The bias of all coefficients; `None` where it cannot be measured (too few windows).
    pub fn bias(&self, terms: &[usize], weights: &[Vec<f64>]) -> Option<Bias> {
        from_rows(false, self.stretches, &self.plain, &self.repeats, terms, weights)
    }

    /// Noise against signal in the columns of equation `e`, for each frequency: the greatest, over
    /// the columns, of the noise's mean square there over the column's own over all frequencies. It
    /// needs no coefficients, so that weights by it cannot favour small ones.
    pub fn share(&self, e: usize, columns: usize, frequencies: usize) -> Vec<f64> {
        let mut noise = vec![vec![0.0; frequencies + 1]; columns];
        let mut count = vec![0.0_f64; frequencies + 1];
        let (mut signal, mut rows_seen) = (vec![0.0; columns], 0.0_f64);
        for repeat in &self.repeats {
            for (a, b) in self.plain.iter().zip(repeat) {
                let rows = a.equations[e].chunks_exact(columns + 1).zip(b.equations[e].chunks_exact(columns + 1));
                for (r, (x, y)) in rows.enumerate() {
                    let m = frequency_of_row(r);
                    count[m] += 1.0;
                    rows_seen += 1.0;
                    for c in 0..columns {
                        noise[c][m] += (y[c] - x[c]).powi(2);
                        signal[c] += x[c] * x[c];
                    }
                }
            }
        }
        (0..=frequencies)
            .map(|m| {
                (0..columns)
                    .filter(|&c| signal[c] > 0.0)
                    .map(|c| noise[c][m] / count[m].max(1.0) / (signal[c] / rows_seen.max(1.0)))
                    .fold(0.0, f64::max)
            })
            .collect()
    }

    /// Mean square of what the sensors' noise adds to the residuals of equation `e`, for each
    /// frequency.
    pub fn power(&self, e: usize, coefficients: &DVector<f64>, frequencies: usize) -> Vec<f64> {
        let p = coefficients.len();
        let (mut sum, mut count) = (vec![0.0; frequencies + 1], vec![0.0_f64; frequencies + 1]);
        let residual = |row: &[f64]| row[p] - row[..p].iter().zip(coefficients.iter()).map(|(a, b)| a * b).sum::<f64>();
        for repeat in &self.repeats {
            for (a, b) in self.plain.iter().zip(repeat) {
                let rows = a.equations[e].chunks_exact(p + 1).zip(b.equations[e].chunks_exact(p + 1));
                for (r, (x, y)) in rows.enumerate() {
                    let m = frequency_of_row(r);
                    sum[m] += (residual(y) - residual(x)).powi(2) * if r == 0 { 2.0 } else { 1.0 };
                    count[m] += if r == 0 { 2.0 } else { 1.0 };
                }
            }
        }
        sum.iter().zip(&count).map(|(s, n)| s / n.max(1.0)).collect()
    }
}

/// Stretches of a few windows each, smoothed to the clear band and spread evenly over the record,
/// and the stretch that each is from.
pub fn smoothed(system: &System<'_>, windows: &Windows) -> (Vec<Stretch>, Vec<usize>) {
    let kernels: &Kernels = system.kernels;
    if system.count() == 0 {
        return (Vec::new(), Vec::new());
    }
    let reach = kernels.clear.reach();
    let lengths: Vec<usize> = system.stretches.iter().map(Stretch::len).collect();
    let mut unused = Vec::new();
    places(&lengths, kernels, windows, system.step_s(0), STRETCH)
        .into_iter()
        .map(|(i, first, last)| {
            let mut out = system.stretches[i].part(first + reach, last - reach);
            for (to, from) in out.coordinates.iter_mut().zip(&system.stretches[i].coordinates) {
                let mut smooth = Vec::new();
                kernels.clear.apply(&from[first..last], &mut smooth, &mut unused);
                *to = smooth;
            }
            (out, i)
        })
        .unzip()
}

/// Angles as an encoder of `count` rad a count gives them, its grid shifted by `shift` rad.
struct Counts<'a> {
    angles: &'a mut [f64],
    count: f64,
    shift: f64,
}

impl NullaryFnOnce for Counts<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { angles, count, shift } = self;
        angles.iter_mut().for_each(|x| *x = (((*x + shift) / count).floor() + 0.5) * count - shift);
    }
}

/// Known motions as their sensors and the channels of their inputs would measure them in the repeat
/// of a number.
pub fn repeat(truth: &[Stretch], number: usize, bound: &ObservedModel, sensors: &Sensors) -> Vec<Stretch> {
    // Each has a stream of random numbers of its own.
    truth.par_iter().enumerate().map(|(i, s)| measure(s, number, bound, sensors, i as u64)).collect()
}

/// The stretch as its sensors and the channels of its inputs would measure it in a repeat; the noise
/// of every other repeat has the opposite sign.
pub fn measure(truth: &Stretch, repeat: usize, bound: &ObservedModel, sensors: &Sensors, stream: u64) -> Stretch {
    let mut measured = measure_motion(truth, repeat, bound, sensors, stream);
    let sign = if repeat.is_multiple_of(2) { 1.0 } else { -1.0 };
    input_noise::disturb(&mut measured, &sensors.inputs, sign, (repeat / 2) as u64, stream);
    measured
}

/// The same with the inputs as they are, but for a base.
pub fn measure_motion(
    truth: &Stretch,
    repeat: usize,
    bound: &ObservedModel,
    sensors: &Sensors,
    stream: u64,
) -> Stretch {
    let mut shown = truth.sensors(bound);
    let n = shown.len() as u64;
    for (c, sensor) in shown.iter_mut().enumerate() {
        if let Some(count) = sensors.count[c] {
            let shift = shift(repeat, c) * count;
            Arch::new().dispatch(Counts { angles: sensor, count, shift });
        } else {
            let mut rng = ChaCha8Rng::seed_from_u64(0x5eed + (repeat / 2) as u64);
            rng.set_stream(n * stream + c as u64);
            // Uniform with variance σ²: half width σ√3; every other repeat has the opposite sign.
            let width = 2.0 * 3f64.sqrt() * sensors.sigma[c] * if repeat.is_multiple_of(2) { 1.0 } else { -1.0 };
            for x in sensor.iter_mut() {
                *x += width * (rng.random::<f64>() - 0.5);
            }
        }
    }
    let mut measured = Stretch { coordinates: mixed(&bound.coordinates, &shown), ..truth.clone() };
    if let Some(base) = &truth.base
        && let Some(input) = measured.inputs.get_mut(base.input)
    {
        let sign = if repeat.is_multiple_of(2) { 1.0 } else { -1.0 };
        let noise = base.series(input.len(), 0xba5e + (repeat / 2) as u64, stream);
        input.iter_mut().zip(noise).for_each(|(u, n)| *u += sign * n);
    }
    measured
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_repeat_has_a_grid_of_its_own() {
        for sensor in 0..5 {
            let mut all: Vec<f64> = (0..2 * REPEATS).map(|r| shift(r, sensor)).collect();
            assert_eq!(all[0], shift(0, sensor % 4));
            all.sort_by(f64::total_cmp);
            assert!(
                all.iter().all(|x| (0.0..1.0).contains(x)) && all.windows(2).all(|w| w[1] - w[0] > 0.05),
                "{all:?}"
            );
        }
    }
}
