//! A record of the model itself: its equations integrated from a state, as its rig's channels would
//! show it, without noise.
//!
//! [`crate::model::flow`] integrates: Dormand and Prince's method of order 5 with equal steps,
//! reversals under dry friction placed. The step is halved, from the sampling interval on, until
//! two solutions over the first second differ by less than `EXACT` of what moves; a chaotic motion
//! carries what is left of that on at its own rate.

use super::Motion;
use super::from_record::Begin;
use crate::effects::on_a_record::Samples;
use crate::error::{BadInput, Result};
use crate::identify::stretches::mixed;
use crate::model::flow::{Flow, Inputs, Outside, Work};
use crate::model::integrate::Outside as _;
use crate::record::Column;
use crate::record::values::column;

/// Difference between solutions at two steps that is exact, of the largest size of a coordinate (of
/// 1 at least).
const EXACT: f64 = 1e-11;
/// Halvings of the step at most.
const MOST_HALVINGS: u32 = 10;
/// Below this a difference that no longer falls is rounding.
const ROUNDING: f64 = 1e-9;
/// Time over which the step is sought, s.
const SOUGHT_S: f64 = 1.0;

/// A solution at even times.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// One column for each coordinate.
    pub coordinates: Vec<Vec<f64>>,
    /// Inputs at the samples.
    pub inputs: Vec<Vec<f64>>,
    /// Step of integration, s.
    pub step_s: f64,
    /// Largest difference to a solution with twice the step, over the first second.
    pub difference: f64,
}

/// The solution over `count` samples.
///
/// # Errors
/// A motion that leaves the finite numbers, or a singular mass matrix.
pub fn solve(motion: &Motion, begin: &Begin, count: usize) -> Result<Solution> {
    solve_to(motion, begin, count, EXACT)
}

/// The same with a step over which two solutions differ by less than `exact` of what moves.
///
/// # Errors
/// As [`solve`].
pub fn solve_to(motion: &Motion, begin: &Begin, count: usize, exact: f64) -> Result<Solution> {
    let (equations, parameters) = motion.following()?;
    // States of effects begin at 0.
    let state = equations.with_states(&begin.state, &[]);
    let inputs = motion.file.inputs.len();
    let at = |t: f64, out: &mut [f64]| match &begin.inputs {
        Some(along) => along.inputs(t, out),
        None => out.fill(0.0),
    };
    let outside = Outside {
        origin: begin.time,
        tau: begin.tau,
        omega: motion.omega().unwrap_or(0.0),
        inputs: (inputs > 0).then_some(Inputs { count: inputs, at: &at }),
    };
    let run = |step_s: f64, count: usize| -> Option<Vec<Vec<f64>>> {
        let flow = Flow::new(&equations, &parameters, outside, step_s);
        let mut work = Work::plain(&equations);
        work.set(&state);
        let mut out = vec![Vec::with_capacity(count); motion.file.coordinates.len()];
        let good = flow.samples(&mut work, begin.time, begin.step_s, count, |_, q| {
            out.iter_mut().zip(q).for_each(|(x, q)| x.push(*q));
        });
        (good && out.iter().flatten().all(|x| x.is_finite())).then_some(out)
    };
    let sought = count.min((SOUGHT_S / begin.step_s).ceil() as usize + 1).max(2);
    let (mut step_s, mut difference) = (begin.step_s, f64::INFINITY);
    let mut before = run(step_s, sought);
    for _ in 0..MOST_HALVINGS {
        let finer = run(0.5 * step_s, sought);
        let last = difference;
        difference = apart(before.as_deref(), finer.as_deref());
        (before, step_s) = (finer, 0.5 * step_s);
        if difference < exact || (difference < ROUNDING && difference > 0.5 * last) {
            break;
        }
    }
    let coordinates = run(step_s, count).ok_or_else(|| {
        BadInput::new(
            "a motion that leaves the finite numbers, or a singular mass matrix",
            "a model and a state that can be simulated",
        )
        .remedy("Correct the coefficients or the initial state")
    })?;
    let mut columns = vec![Vec::with_capacity(count); inputs];
    let mut now = vec![0.0; inputs];
    let rows = if inputs > 0 { count } else { 0 };
    for i in 0..rows {
        at(begin.time + i as f64 * begin.step_s, &mut now);
        columns.iter_mut().zip(&now).for_each(|(c, x)| c.push(*x));
    }
    Ok(Solution { coordinates, inputs: columns, step_s, difference })
}

/// Largest difference of two solutions, of the largest size of a coordinate.
fn apart(a: Option<&[Vec<f64>]>, b: Option<&[Vec<f64>]>) -> f64 {
    let (Some(a), Some(b)) = (a, b) else { return f64::INFINITY };
    let mut most = 0.0_f64;
    for (x, y) in a.iter().zip(b) {
        let size = y.iter().fold(1.0_f64, |m, y| m.max(y.abs()));
        most = x.iter().zip(y).fold(most, |m, (x, y)| m.max((x - y).abs() / size));
    }
    most
}

/// One column for each channel of the rig.
///
/// # Errors
/// An angle beyond 32 bits of counts.
pub fn columns(motion: &Motion, solution: &Solution, step_s: f64) -> Result<Vec<Column>> {
    let shown = mixed(&motion.bound.shown, &solution.coordinates);
    let channels = motion.rig.channel.iter().enumerate();
    let too_far =
        || BadInput::new("an angle beyond 32 bits of counts", "fewer turns").remedy("Simulate a shorter time");
    channels
        .map(|(k, c)| {
            let scale = c.scale();
            if let Some(input) = motion.bound.inputs.iter().position(|i| *i == k) {
                let u = &solution.inputs[input];
                let remedy = "What moves the model is the base's acceleration, of which no position can be written";
                motion.bound.refuse_base_position(&motion.rig, input, remedy)?;
                let shown = motion.recorded(input, &Samples { values: u, start_s: 0.0, step_s });
                return column(c, shown.into_iter().map(|u| u / scale)).ok_or_else(too_far);
            }
            let sensor = motion.bound.sensors.iter().position(|i| *i == k).unwrap_or(0);
            let x = motion.shown(sensor, &Samples { values: &shown[sensor], start_s: 0.0, step_s });
            column(c, x.into_iter().map(|x| x / scale)).ok_or_else(too_far)
        })
        .collect()
}
