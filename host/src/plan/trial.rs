//! Records that the model makes at a setting, and whether its motion there is chaotic.
//!
//! Chaos: the largest Lyapunov exponent of the model ([`crate::phase_space::model_exponent`]) is
//! above zero by three of its standard errors, for parameters drawn from their standard errors and
//! initial states drawn at random. The share of such draws has the interval of Wilson (1927).

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

use super::moved::{Own, tied};
use crate::error::Result;
use crate::model::dynamics::Dynamics;
use crate::model::flow::{Flow, Outside, Work};
use crate::model::identified::IdentifiedModel;
use crate::motion::from_record::Begin;
use crate::motion::{Motion, simulation};
use crate::phase_space::model_exponent::of_model;
use crate::record::{Column, Record, Segment};

/// Time that a motion is given to come to its attractor, in periods of the drive (by hand).
pub const SETTLE_PERIODS: f64 = 60.0;
/// Periods over which an exponent is measured (by hand).
const PERIODS: usize = 120;
/// Steps of integration, of order 5, in a period (by hand).
const STEPS: f64 = 32.0;
/// Share of what moves to which a record's first second is a solution: far below what sensors show,
/// and of a chaotic motion another solution of the same equations goes on from there (by hand).
const EXACT: f64 = 1e-7;
/// Standard errors above zero from which an exponent is one of chaos (by hand).
const SIGNIFICANT: f64 = 3.0;
/// Exponent a period below which a motion is taken for periodic, however small its standard error
/// is (by hand).
const LEAST: f64 = 0.02;

/// Share of draws whose motion is chaotic, and of those in which an arm goes round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Share {
    /// Draws.
    pub draws: usize,
    /// Of these chaotic.
    pub chaotic: usize,
    /// Of these with a coordinate that turns by more than a turn.
    pub whirling: usize,
    /// 95 % interval of the chaotic share.
    pub interval: [f64; 2],
    /// Mean of the largest Lyapunov exponents, a period of the drive.
    pub exponent: f64,
}

/// Wilson's interval for k of n.
fn wilson(k: usize, n: usize) -> [f64; 2] {
    let (z, n) = (1.959_964_f64, n as f64);
    let p = k as f64 / n;
    let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    [(middle - half).max(0.0), (middle + half).min(1.0)]
}

/// How far from hanging a rig may be when its shaker starts, rad (by hand).
const NEAR_REST: f64 = 0.3;

/// A number of the standard normal distribution.
fn gauss(rng: &mut ChaCha8Rng) -> f64 {
    // The quantile of a uniform number strictly between 0 and 1.
    Normal::standard().inverse_cdf(rng.random_range(1e-12..1.0))
}

/// The model with parameters drawn from their standard errors, its dampings of one strength each;
/// the first draw is the model itself.
pub fn drawn(own: &Own, seed: u64, draw: usize) -> IdentifiedModel {
    let mut out = own.model.clone();
    if draw == 0 {
        return out;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ (0x9e37 * draw as u64));
    out.parameters.iter_mut().for_each(|p| p.value += p.std_error * gauss(&mut rng));
    tied(&own.rig, out)
}

/// A state at rest: in every other draw near where a rig hangs when its shaker starts, in the
/// others angles anywhere on the circle. Where attractors coexist the two may end on different
/// ones.
pub fn start(motion: &Motion, seed: u64, draw: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed.wrapping_add(7919 * draw as u64));
    let circle = motion.file.circle();
    let mut one = |circle: &bool| match (circle, draw % 2) {
        (true, 0) => NEAR_REST * gauss(&mut rng),
        (true, _) => rng.random_range(-core::f64::consts::PI..core::f64::consts::PI),
        (false, _) => 0.1 * gauss(&mut rng),
    };
    let mut out: Vec<f64> = circle.iter().map(&mut one).collect();
    out.extend(circle.iter().map(|_| 0.0));
    out
}

/// The motion of a model without effects that have states of their own.
///
/// # Errors
/// A model that does not move on this rig.
pub fn without_memory(own: &Own, model: &IdentifiedModel) -> Result<Motion> {
    let mut motion = Motion::of(model, &own.rig.path, Some(&own.rig), 0.0)?;
    motion.effects.retain(|e| !e.remembers());
    Ok(motion)
}

/// Which of some draws move chaotically; none for a system without a drive or a model that cannot
/// be integrated.
pub fn share(own: &Own, seed: u64, draws: usize) -> Result<Option<Share>> {
    let Some(drive) = own.rig.drive else { return Ok(None) };
    let period_s = 1.0 / drive.frequency_hz;
    let (mut chaotic, mut whirling, mut sum, mut counted) = (0, 0, 0.0, 0);
    for draw in 0..draws {
        let motion = without_memory(own, &drawn(own, seed, draw))?;
        let (equations, parameters) = motion.equations()?;
        let outside = Outside::drive(0.0, 0.0, own.rig.omega());
        let flow = Flow::new(&equations, &parameters, outside, period_s / STEPS);
        let mut work = Work::plain(&equations);
        work.set(&start(&motion, seed, draw));
        let settle_s = SETTLE_PERIODS * period_s;
        if !flow.carry(&mut work, 0.0, settle_s) {
            continue;
        }
        let mut state = work.state().to_vec();
        let before = state.clone();
        let n = equations.degrees_of_freedom();
        let Some(found) = of_model(&flow, &equations, &mut state, settle_s, period_s, 20, PERIODS) else { continue };
        let turned = |k: usize| (state[k] - before[k]).abs() > core::f64::consts::TAU;
        whirling += usize::from((0..n).zip(motion.file.circle()).any(|(k, circle)| circle && turned(k)));
        chaotic += usize::from(found.per_interval > LEAST.max(SIGNIFICANT * found.std_error));
        sum += found.per_interval;
        counted += 1;
    }
    let share = |_| Share {
        draws: counted,
        chaotic,
        whirling,
        interval: wilson(chaotic, counted),
        exponent: sum / counted as f64,
    };
    Ok((counted > 0).then_some(()).map(share))
}

/// How a record is made.
#[derive(Clone, Debug)]
pub struct Made<'a> {
    /// Its length, s.
    pub seconds: f64,
    /// Angles or lengths at which the system is let go at rest; drawn where none.
    pub pose: Option<&'a [f64]>,
    /// Time that a driven motion is given to come to its attractor, periods.
    pub settle_periods: f64,
    /// Rms noise of the channels that do not count, in their own units.
    pub noise: &'a [f64],
    /// Seed and number of the draw.
    pub seed: (u64, usize),
}

/// A record of the model, as the rig's channels show it; a driven one after the motion has settled.
///
/// # Errors
/// A model that does not move on this rig.
pub fn record(own: &Own, made: &Made<'_>) -> Result<Record> {
    let (seed, draw) = made.seed;
    let motion = Motion::of(&drawn(own, seed, draw), &own.rig.path, Some(&own.rig), 0.0)?;
    let state = match made.pose {
        Some(pose) => {
            pose.iter().copied().chain(core::iter::repeat(0.0)).take(2 * motion.file.circle().len()).collect()
        }
        None => start(&motion, seed, draw),
    };
    let step_s = 1.0 / own.rig.sample_rate_hz;
    let begin = Begin { time: 0.0, tau: 0.0, state, inputs: None, left_s: f64::INFINITY, step_s };
    let settle_s = own.rig.drive.map_or(0.0, |d| made.settle_periods / d.frequency_hz);
    let first = (settle_s / step_s).round() as usize;
    let count = first + (made.seconds / step_s).round().max(1.0) as usize;
    let solution = simulation::solve_to(&motion, &begin, count, EXACT)?;
    let columns = simulation::columns(&motion, &solution, step_s)?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed.wrapping_add(104_729 * (draw as u64 + 1)));
    let cut = |(k, column): (usize, Column)| match column {
        Column::Counts(c) => Column::Counts(c[first..].to_vec()),
        Column::Values(v) => {
            let sigma = made.noise.get(k).copied().unwrap_or(0.0);
            Column::Values(v[first..].iter().map(|x| x + sigma * gauss(&mut rng)).collect())
        }
    };
    let columns: Vec<Column> = columns.into_iter().enumerate().map(cut).collect();
    let segment = Segment { first_tick: first as i64, ..Segment::new(first as f64 * step_s, step_s, columns) };
    Ok(Record::of("(planned)", &own.rig, vec![segment]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_s_interval_as_published() {
        // Newcombe (1998), table I: 81 of 263.
        let [low, high] = wilson(81, 263);
        assert!((low - 0.2553).abs() < 1e-4 && (high - 0.3662).abs() < 1e-4, "{low} {high}");
        assert_eq!(wilson(0, 10)[0], 0.0);
    }
}
