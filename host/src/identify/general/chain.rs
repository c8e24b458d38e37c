//! The bias of the whole chain for a model file: [`crate::identify::chain_bias`] over any number of coordinates.
//!
//! Not for systems with measured inputs, whose noise a solution would take for motion, nor for coefficients of single records, which
//! one set of equations does not hold; their bias is that of [`super::noise`].

use nalgebra::DVector;
use rayon::prelude::*;

use super::noise::{Sensors, measure};
use super::series::System;
use super::stretches::Stretch;
use super::ties;
use crate::identify::chain_bias::{cells, from_solutions, solve, state_at};
use crate::identify::noise_bias::{Bias, REPEATS, places};
use crate::identify::regression::Solution;
use crate::identify::windows::{Plan, Stretches, WindowRows, Windows, rows_planned};
use crate::model::flow::Outside;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::rig::Rig;
use crate::rig::measures::Bound;

/// Measures the bias of a solution's coefficients; `names`: of all columns. `None` where the model cannot be integrated or moves otherwise than the record.
pub fn estimate(
    system: &System<'_>,
    windows: &Windows,
    (rig, bound): (&Rig, &Bound),
    sensors: &Sensors,
    names: &[String],
    solution: &Solution,
) -> Option<Bias> {
    let model = &*bound.model;
    if !bound.inputs.is_empty() {
        return None;
    }
    let motion = EquationsOfMotion::new(model, rig.omega()).ok()?;
    let found = DVector::from_iterator(names.len(), solution.coefficients.iter().flat_map(|c| c.iter().copied()));
    let (own, values, _) = ties::tie(names, &found, &solution.covariance, &solution.metric);
    let value_of = |name: &String| own.iter().position(|n| n == name).map(|i| values[i]);
    let parameters: Vec<f64> = motion.coefficients().iter().map(value_of).collect::<Option<_>>()?;
    let columns: Vec<f64> = names.iter().map(value_of).collect::<Option<_>>()?;
    let motions = motions(&motion, &parameters, system, windows, rig, cells(&sensors.sigma))?;
    let terms: Vec<usize> = system.weak.equations.iter().map(|e| e.terms.len()).collect();
    let plan = Plan::new(system.kernels, windows, system.step_s(0), 1);
    let rows = |stretches: &[Stretch]| -> Vec<WindowRows> {
        rows_planned(&System { stretches, ..*system }, &system.weak.equations, &plan)
    };
    let plain = rows(&motions);
    let measured = (0..REPEATS)
        .map(|r| {
            let seen: Vec<Stretch> =
                motions.iter().enumerate().map(|(i, s)| measure(s, r, bound, sensors, i as u64)).collect();
            rows(&seen)
        })
        .collect();
    from_solutions(motions.len(), plain, measured, &terms, &solution.weights, &DVector::from_vec(columns))
}

/// Solutions over one window each from the smoothed record's states.
pub(crate) fn motions(
    motion: &EquationsOfMotion,
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
    let found: Vec<Stretch> = places(&lengths, system.kernels, windows, system.step_s(0), 1)
        .into_par_iter()
        .map(|(i, first, last)| {
            let record = &system.stretches[i];
            let mut out = record.part(first + reach, last - reach);
            let before = record.coordinates.iter().map(|x| &x[first..first + 2 * reach + 1]);
            let state = state_at(before, system.kernels)?;
            let outside = Outside::drive(out.start_s, out.tau(0), omega);
            let start = (record.time(first + reach), out.step_s, windows.length_s);
            solve((motion, parameters, outside), state, start, cells, &mut out.coordinates).then_some(out)
        })
        .collect::<Option<_>>()?;
    (!found.is_empty()).then_some(found)
}
