//! The bias of the whole chain from motion to coefficients, measured on motions of the identified
//! model and taken off.
//!
//! What [`super::noise_bias`] measures on the smoothed record is the sensors' share. The smoothing
//! itself has one more: dry friction bends a velocity where a joint turns back, and a low-pass
//! rounds that off, so that the friction comes out different by some tenths of a per cent at few
//! counts. The smoothed record has lost those bends; a solution of the model has them. So the
//! identified model is integrated over windows like the record's, from its states at their starts,
//! measured by the sensors and identified again (a parametric bootstrap estimate of bias, Efron and
//! Tibshirani 1993, ch. 10):
//!
//! δ = [λ(solution) − λ] + [(1/R) Σ_r λ(sensor_r(solution)) − λ(solution)],   corrected λ − δ
//!
//! Each part is shrunk where it is not larger than its scatter over groups of windows, which goes
//! into the covariance. Every window has a solution of its own, so that a chaotic motion has no
//! time to make a rounding error visible: two ways to write the same equations have the same bias.
//!
//! Measured inputs act between their samples as a band-limited signal does.
//!
//! Limits: the model must be one that can be integrated, and stay finite; a solution leaves the
//! record after some Lyapunov times but keeps to the same kind of motion.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::noise_bias::{Bias, REPEATS, from_rows, places};
use super::regression::{RunSums, Solution};
use super::remeasured::{Sensors, repeat};
use super::series::System;
use super::stretches::Stretch;
use super::ties;
use super::track::ExogenousInputs;
use super::windows::{Kernels, Plan, Stretches, WindowRows, Windows, rows_planned};
use crate::model::dynamics::Dynamics;
use crate::model::flow::{Flow, Inputs, Outside, Work};
use crate::model::integrate;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;

/// Longest step of integration: samples (one where there are measured inputs, which may change in
/// each); under a drive s, and as a share of its period; otherwise as a share of a window, which
/// holds 3 to 10 periods of the motion. What a solution leaves of its equations, its local error
/// over the step, must be far below what the sensors leave; a test holds it.
const STEP_SAMPLES: f64 = 4.0;
const STEP_SAMPLES_OF_INPUTS: f64 = 1.0;
const STEP_S: f64 = 8e-3;
const STEPS: f64 = 25.0;
const STEPS_IN_WINDOW: f64 = 500.0;
/// Time after which a solution is rounded to a grid: s under a drive, otherwise as a share of a
/// window.
const ROUNDED_S: f64 = 0.1;
const ROUNDINGS: f64 = 40.0;
/// A share of a coefficient beyond which the simulated motion is another one than the record's, and
/// nothing is concluded from it.
const ANOTHER_MOTION: f64 = 0.1;
/// Groups of neighbouring windows whose scatter tells that of the bias: neighbours share half of
/// their samples.
const GROUPS: usize = 8;

/// A solution of the weak form with the equations of motion that it belongs to.
pub struct Solved<'a> {
    /// The equations of motion.
    pub motion: &'a dyn Dynamics,
    /// Names of their coefficients.
    pub coefficients: &'a [String],
    /// Names of all columns of the weak form.
    pub columns: &'a [String],
    /// The coefficients of these columns.
    pub solution: &'a Solution,
}

/// Measures the bias of a solution's coefficients. `None` where the model moves otherwise than the
/// record. Under measured inputs a solution takes their noise for motion: then it is no bias, but
/// what it says of the residuals holds.
pub fn estimate(
    system: &System<'_>,
    windows: &Windows,
    rig: &Rig,
    bound: &ObservedModel,
    sensors: &Sensors,
    solved: &Solved<'_>,
) -> Option<Bias> {
    let Solved { motion, coefficients, columns: names, solution } = *solved;
    let found = DVector::from_iterator(names.len(), solution.coefficients.iter().flat_map(|c| c.iter().copied()));
    let (own, values, _) = ties::tie(names, &found, &solution.covariance, &solution.metric);
    let value_of = |name: &String| own.iter().position(|n| n == name).map(|i| values[i]);
    let parameters: Vec<f64> = coefficients.iter().map(value_of).collect::<Option<_>>()?;
    let columns: Vec<f64> = names.iter().map(value_of).collect::<Option<_>>()?;
    let motions = motions(motion, &parameters, system, windows, rig, cells(&sensors.sigma))?;
    let terms: Vec<usize> = system.weak.equations.iter().map(|e| e.terms.len()).collect();
    let plan = Plan::new(system.kernels, windows, system.step_s(0), 1);
    let rows = |stretches: &[Stretch]| -> Vec<WindowRows> {
        rows_planned(&System { stretches, ..*system }, &system.weak.equations, &plan)
    };
    let plain = rows(&motions);
    let measured = (0..REPEATS).map(|r| rows(&repeat(&motions, r, bound, sensors))).collect();
    from_solutions(motions.len(), plain, measured, &terms, &solution.weights, &DVector::from_vec(columns))
}

/// The bias from the rows of `motions` solutions with the parameters `coefficients`, as they are
/// and measured [`REPEATS`] times.
pub(crate) fn from_solutions(
    motions: usize,
    mut plain: Vec<WindowRows>,
    mut measured: Vec<Vec<WindowRows>>,
    terms: &[usize],
    weights: &[Vec<f64>],
    coefficients: &DVector<f64>,
) -> Option<Bias> {
    let n = motions.min(GROUPS);
    for window in plain.iter_mut().chain(measured.iter_mut().flatten()) {
        window.run = window.run * n / motions.max(1);
    }
    let mut bias = from_rows(true, n, &plain, &measured, terms, weights)?;
    let sums = RunSums::new(&plain, n, terms, weights);
    let solve = |without: Option<usize>| Some(sums.solve(without)? - coefficients);
    let all = solve(None)?;
    let mut covariance = DMatrix::zeros(all.len(), all.len());
    for change in (0..n).filter_map(|g| solve(Some(g))).map(|d| d - &all) {
        covariance += &change * change.transpose() * ((n - 1) as f64 / n as f64);
    }
    let largest = |i: usize| coefficients[i].abs() + 3.0 * covariance[(i, i)].max(0.0).sqrt();
    let scale = coefficients.amax();
    if (0..all.len()).any(|i| all[i].abs() > ANOTHER_MOTION * largest(i) + 1e-3 * scale) {
        return None;
    }
    for i in 0..all.len() {
        let square = all[i] * all[i];
        if square > 0.0 {
            bias.value[i] += all[i] * (1.0 - covariance[(i, i)] / square).max(0.0);
        }
    }
    bias.covariance += covariance;
    Some(bias)
}

/// Longest step of integration for samples `spacing` apart and windows of `window_s`, s.
fn step_s(outside: &Outside<'_>, spacing: f64, window_s: f64) -> f64 {
    let omega = outside.omega;
    let most =
        if omega > 0.0 { STEP_S.min(core::f64::consts::TAU / omega / STEPS) } else { window_s / STEPS_IN_WINDOW };
    let samples = if outside.inputs.is_some() { STEP_SAMPLES_OF_INPUTS } else { STEP_SAMPLES };
    most.min(samples * spacing)
}

/// State at the sample in the middle of a kernel's span: each coordinate low-passed, then its rate.
pub(crate) fn state_at<'a>(coordinates: impl Iterator<Item = &'a [f64]>, kernels: &Kernels) -> Option<Vec<f64>> {
    let (mut smooth, mut slope) = (Vec::new(), Vec::new());
    let (mut state, mut rates) = (Vec::new(), Vec::new());
    for x in coordinates {
        kernels.clear.apply(x, &mut smooth, &mut slope);
        state.push(*smooth.first()?);
        rates.push(*slope.first()?);
    }
    state.append(&mut rates);
    Some(state)
}

/// Grid of the states of [`solve`], as cells a radian: a power of two, some hundred times finer
/// than the least noisy sensor.
pub(crate) fn cells(sigma: &[f64]) -> f64 {
    let least = sigma.iter().copied().filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min);
    let least = if least.is_finite() { least } else { 0.0 };
    (300.0 / least.max(f64::MIN_POSITIVE.sqrt())).log2().ceil().clamp(18.0, 1000.0).exp2()
}

/// The samples of a window.
pub(crate) struct SampledWindow {
    /// Time of the first, s.
    pub(crate) start_s: f64,
    /// Time between two, s.
    pub(crate) spacing_s: f64,
    /// Length of the window, s.
    pub(crate) length_s: f64,
}

/// A solution from `state` at the samples of a window, a row for each coordinate of `out`. Every
/// tenth of a second under a drive, forty times a window without, the state is rounded to a grid of
/// `cells` a rad (rad/s), far below any sensor: otherwise a chaotic motion, which grows a rounding
/// error by e in some tenths of a second, would be another one for every way to write the same
/// equations. False where the equations have no solution or it leaves all bounds.
pub(crate) fn solve<D: Dynamics + ?Sized>(
    dynamics: &D,
    parameters: &[f64],
    outside: Outside<'_>,
    mut state: Vec<f64>,
    window: &SampledWindow,
    cells: f64,
    out: &mut [Vec<f64>],
) -> bool {
    let SampledWindow { start_s, spacing_s: spacing, length_s: window_s } = *window;
    let flow = Flow::new(dynamics, parameters, outside, step_s(&outside, spacing, window_s));
    let mut work = Work::plain(dynamics);
    let count = out.first().map_or(0, Vec::len);
    let rounded_s = if outside.omega > 0.0 { ROUNDED_S } else { window_s / ROUNDINGS };
    let part = ((rounded_s / spacing).round() as usize).max(1);
    let mut from = 0;
    while from + 1 < count {
        work.set(&state);
        let samples = part.min(count - 1 - from) + 1;
        let good = flow.samples(&mut work, start_s + from as f64 * spacing, spacing, samples, |k, q| {
            for (x, q) in out.iter_mut().zip(q) {
                x[from + k] = *q;
            }
        });
        state.copy_from_slice(work.state());
        if !good || !state.iter().all(|x| x.abs() < 1e7) {
            return false;
        }
        // A grid finer than the numbers themselves leaves them as they are.
        state.iter_mut().filter(|x| (**x * cells).abs() < 1e15).for_each(|x| *x = (*x * cells).round() / cells);
        from += samples - 1;
    }
    true
}

/// Solutions over one window each from the smoothed record's states.
pub(crate) fn motions(
    motion: &dyn Dynamics,
    parameters: &[f64],
    system: &System<'_>,
    windows: &Windows,
    rig: &Rig,
    cells: f64,
) -> Option<Vec<Stretch>> {
    if system.count() == 0 {
        return None;
    }
    let reach = system.kernels.clear.reach();
    let omega = rig.drive.map_or(0.0, |_| rig.omega());
    let lengths: Vec<usize> = system.stretches.iter().map(Stretch::len).collect();
    let inputs: Vec<ExogenousInputs> = system.stretches.iter().map(|s| ExogenousInputs::new(s, omega)).collect();
    let found: Vec<Stretch> = places(&lengths, system.kernels, windows, system.step_s(0), 1)
        .into_par_iter()
        .map(|(i, first, last)| {
            let record = &system.stretches[i];
            let mut out = record.part(first + reach, last - reach);
            let before = record.coordinates.iter().map(|x| &x[first..first + 2 * reach + 1]);
            let state = state_at(before, system.kernels)?;
            let at = |t: f64, out: &mut [f64]| integrate::Outside::inputs(&inputs[i], t, out);
            let measured = (!record.inputs.is_empty()).then_some(Inputs { count: record.inputs.len(), at: &at });
            let outside = Outside { inputs: measured, ..Outside::drive(out.start_s, out.tau(0), omega) };
            let window = SampledWindow {
                start_s: record.time(first + reach),
                spacing_s: out.step_s,
                length_s: windows.length_s,
            };
            solve(motion, parameters, outside, state, &window, cells, &mut out.coordinates).then_some(out)
        })
        .collect::<Option<_>>()?;
    (!found.is_empty()).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::double_pendulum::{DAMPINGS, DEFAULT_DAMPINGS};
    use crate::model::double_pendulum_dynamics::DoublePendulum;

    /// Over a tenth of a second, at which the states are rounded, steps of this length change
    /// velocities by far less than accelerations do in that time.
    #[test]
    fn steps_are_short_enough() {
        let omega = 31.4;
        let dampings: Vec<_> = DAMPINGS.iter().filter(|d| DEFAULT_DAMPINGS.contains(&d.id)).collect();
        let pendulum = DoublePendulum::new(omega, true, &dampings);
        let parameters = [0.113, 0.0709, -0.1107, 0.0, 1e-3, 3.3e-3, 1.68, 0.263, -0.411, 0.0, 0.0485];
        let flow = |step: f64| {
            let flow = Flow::new(&pendulum, &parameters, Outside::drive(0.0, 0.0, omega), step);
            let mut work = Work::plain(&pendulum);
            let (mut states, mut state) = (Vec::new(), vec![0.3, 2.0, 0.0, 0.0]);
            for k in 0..300 {
                work.set(&state);
                assert!(flow.carry(&mut work, 0.1 * f64::from(k), 0.1));
                states.push((state.clone(), work.state().to_vec()));
                // Both ways go on from the finer one's state.
                let fine = Flow::new(&pendulum, &parameters, Outside::drive(0.0, 0.0, omega), 4e-4);
                work.set(&state);
                assert!(fine.carry(&mut work, 0.1 * f64::from(k), 0.1));
                state.copy_from_slice(work.state());
            }
            states
        };
        let (coarse, fine) = (flow(step_s(&Outside::drive(0.0, 0.0, omega), 2e-3, 4.0)), flow(4e-4));
        let (mut error, mut change) = (0.0, 0.0);
        for ((_, a), (from, b)) in coarse.iter().zip(&fine) {
            for i in 2..4 {
                error += (a[i] - b[i]).powi(2);
                change += (b[i] - from[i]).powi(2);
            }
        }
        let relative: f64 = (error / change).sqrt();
        assert!(relative < 2e-6, "{relative:e}");
    }
}
