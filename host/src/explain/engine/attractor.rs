//! Beyond short windows: how long predictions hold, and whether the model's attractor is the
//! record's, before and after.
//!
//! Of systems that turn. *Prediction horizon*: from held-out windows whose initial state was fitted
//! the model runs on freely until any sensor's angle is off by 30°; the median time over the
//! windows. *Poincaré section*: the record at each period of the drive, as points (cos, sin of each
//! sensor's angle, its velocity over its scatter), beside those of some records of the model itself
//! from the record's first state, with coefficients as they may be by their covariance, as the same
//! sensors show them ([`crate::validate::energy_distance`]): a record is as far from the model that
//! was fitted to it as another of the same system would be.

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

use super::prediction::Predictions;
use super::setting::Setting;
use super::shooting::MOST_SAMPLES;
use super::state::State;
use crate::identify::remeasured::Sensors;
use crate::identify::stretches::Stretch;
use crate::validate::energy_distance::{MOST_PERIODS, RECORDS, among};

/// Angle by which a prediction may be off, degrees.
pub const TOLERANCE_DEG: f64 = 30.0;
/// Longest prediction, in horizons of the gap.
pub const LONGEST: f64 = 60.0;
/// Steps of integration in a period of the drive, of records of which each is one of many.
const STEPS: f64 = 50.0;
/// Seed of the noise of the sensors in these.
const SEED: u64 = 1;
/// Samples to either side over which velocities of a section are taken.
const REACH: usize = 2;

/// How far a model follows the record beyond short windows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Attractor {
    /// Median prediction horizon, s.
    pub prediction_horizon_s: f64,
    /// Mean energy distance of the record's Poincaré section from those of records that the model
    /// itself makes; none for a free system or a short record.
    pub section_distance: Option<f64>,
    /// Probability of at least this distance by chance: of a record of the model from the others.
    pub section_p_value: Option<f64>,
}

/// Measures a model with coefficients `x` of some covariance; none where something does not turn or
/// nothing can be predicted.
pub fn measure(
    setting: &Setting<'_>,
    state: &State,
    (x, covariance): (&DVector<f64>, &DMatrix<f64>),
    how: Predictions<'_>,
) -> Option<Attractor> {
    if !setting.circle.iter().all(|c| *c) {
        return None;
    }
    let moving = state.free_motion_of(setting, x, 0)?;
    let model = moving.model(how.step_s);
    let tolerance = vec![TOLERANCE_DEG.to_radians(); setting.bound.sensors.len()];
    state.on_free_track(setting, moving.hidden.clone(), |track| {
        let prediction_horizon_s = model.holds_s(track, how, &tolerance, LONGEST * how.horizon_s)?;
        let longest = (0..state.stretches.len()).max_by_key(|&k| (state.stretches[k].len(), usize::MAX - k))?;
        let test = setting.rig.drive.and_then(|drive| {
            let (stretch, period_s) = (&state.stretches[longest], 1.0 / drive.frequency_hz);
            // Few: the cast cuts the fraction.
            let whole = (MOST_PERIODS * period_s / stretch.step_s).ceil() as usize + 1;
            let count = stretch.len().min(whole).min(MOST_SAMPLES);
            let step_s = how.step_s.unwrap_or(0.0).max(period_s / STEPS);
            let drawn = drawn(setting, state, x, covariance)?;
            let made = model.made(track, (longest, count), how.horizon_s, step_s, &drawn)?;
            let clouds = sections(setting, &state.sensors(setting), stretch, count, made)?;
            among(&clouds[0], &clouds[1..])
        });
        Some(Attractor {
            prediction_horizon_s,
            section_distance: test.map(|t| t.distance),
            section_p_value: test.map(|t| t.p_value),
        })
    })
}

/// Values of the parameters of its equations for coefficients as they may be.
fn drawn(setting: &Setting<'_>, state: &State, x: &DVector<f64>, covariance: &DMatrix<f64>) -> Option<Vec<Vec<f64>>> {
    // What is no number has no eigenvalues to be found.
    if !covariance.iter().all(|c| c.is_finite()) {
        return None;
    }
    let root = covariance.clone().symmetric_eigen();
    let scatter = root.eigenvalues.map(|v| v.max(0.0).sqrt());
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut of = || {
        let z = scatter.map(|s| s * Normal::standard().inverse_cdf(rng.random_range(1e-12..1.0)));
        Some(state.free_motion_of(setting, &(x + &root.eigenvectors * z), 0)?.parameters)
    };
    (0..RECORDS).map(|_| of()).collect()
}

/// Points of a section: cos, sin and velocity of each angle.
type Cloud = Vec<Vec<f64>>;

/// Sections of the first `count` samples of a stretch and of as many of records that were `made`.
fn sections(
    setting: &Setting<'_>,
    sensors: &Sensors,
    stretch: &Stretch,
    count: usize,
    mut made: Vec<Vec<Vec<f64>>>,
) -> Option<Vec<Cloud>> {
    // Where the drive's phase begins a new turn.
    let part = |i: usize| (stretch.tau(i) / core::f64::consts::TAU).rem_euclid(1.0);
    let crossings: Vec<usize> = (1..count).filter(|&i| part(i) < part(i - 1)).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for (k, (grid, sigma)) in sensors.count.iter().zip(&sensors.sigma).enumerate() {
        let half = sigma * 3_f64.sqrt();
        let mut shown = |x: &mut f64| match grid {
            Some(q) => *x = ((*x / q).floor() + 0.5) * q,
            None => *x += half * rng.random_range(-1.0..1.0),
        };
        made.iter_mut().flat_map(|m| &mut m[k]).for_each(&mut shown);
    }
    let measured = stretch.sensors(&setting.bound);
    let all = core::iter::once(&measured).chain(&made);
    let mut clouds: Vec<Cloud> = all.map(|of| cloud(of, &crossings, count, stretch.step_s)).collect();
    for k in 0..measured.len() {
        let all: Vec<f64> = clouds.iter().flatten().map(|p| p[3 * k + 2]).collect();
        let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
        let scatter = (all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / all.len().max(1) as f64).sqrt();
        if scatter > 0.0 {
            clouds.iter_mut().flatten().for_each(|p| p[3 * k + 2] /= scatter);
        }
    }
    clouds.iter().flatten().flatten().all(|v| v.is_finite()).then_some(clouds)
}

/// Points at some samples: cos, sin and velocity of each angle.
fn cloud(angles: &[Vec<f64>], at: &[usize], count: usize, step_s: f64) -> Cloud {
    at.iter()
        .filter(|&&i| i >= REACH && i + REACH < count)
        .map(|&i| {
            let of =
                |x: &Vec<f64>| [x[i].cos(), x[i].sin(), (x[i + REACH] - x[i - REACH]) / (2.0 * REACH as f64 * step_s)];
            angles.iter().flat_map(of).collect()
        })
        .collect()
}
