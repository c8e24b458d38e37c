//! What is left of records that the model itself makes, seen by the same sensors: the paths of its
//! windows, measured again with shifted grids or other noise, and fitted in the same way (a
//! parametric bootstrap; Davison and Hinkley 1997, section 4.2). Counts that stand while the motion
//! is slow are no white noise, so that a right model does not leave exactly 1. The noise of measured
//! inputs comes through the model, where no sensor's noise is: the inputs are disturbed once more as
//! well.

use nalgebra::DVector;

use super::super::setting::Setting;
use super::super::state::State;
use super::course::{Course, List};
use super::path::Path;
use super::{Followed, present, signs_of};
use crate::explain::decidability::EXCUSED;
use crate::explain::engine::prediction::Range;
use crate::identify::input_noise::{Level, disturb};
use crate::identify::remeasured::measure_motion;
use crate::identify::stretches::Stretch;

/// Records that are made; every other one has its noise with the opposite sign.
pub const RECORDS: usize = 2;

/// Records that are made where inputs are noisy.
const NOISY_RECORDS: usize = 4;

/// The stretch on its path.
fn on_path(s: &Stretch, path: &Path) -> Stretch {
    let n = s.coordinates.len();
    let mut out = s.clone();
    for (k, x) in out.coordinates.iter_mut().enumerate() {
        let along = path.states.iter().skip(k).step_by(2 * n);
        x.iter_mut().skip(path.first).zip(along).for_each(|(x, q)| *x = *q);
    }
    out
}

/// A record that the model made: every followed stretch on its path, measured by the same sensors.
pub fn record(setting: &Setting<'_>, state: &State, followed: &Followed, repeat: usize) -> Vec<Stretch> {
    made(setting, state, followed, repeat, &setting.sensors.inputs)
}

/// The same with so much noise of each input.
fn made(setting: &Setting<'_>, state: &State, followed: &Followed, repeat: usize, noise: &[Level]) -> Vec<Stretch> {
    let sensors = state.sensors(setting);
    let of = |(i, (s, path)): (usize, (&Stretch, &Path))| {
        let mut made = measure_motion(&on_path(s, path), repeat, &setting.bound, &sensors, i as u64);
        // What it leaves comes through a resonance: little of it is independent, and noise of the
        // opposite sign leaves the same.
        disturb(&mut made, noise, 1.0, repeat as u64, i as u64);
        made
    };
    state.stretches.iter().zip(&followed.paths).enumerate().map(of).collect()
}

/// Power over that of the noise in every block of a record that the model made; infinite where the
/// path is not followed under inputs that were measured again.
fn powers(
    setting: &Setting<'_>,
    state: &State,
    followed: &Followed,
    repeat: usize,
    noise: &[Level],
) -> Option<Vec<f64>> {
    let made = made(setting, state, followed, repeat, noise);
    let shown = made.iter().map(|s| s.sensors(&setting.bound)).collect();
    // The paths are those under the inputs as they were; a base that is measured again is another.
    let mut again = state.clone();
    for (s, made) in again.stretches.iter_mut().zip(made) {
        s.inputs = made.inputs;
    }
    let course = Course::new(setting, &again).showing(shown);
    let list = List { x: present(state), further: &[], behind: &[], together: false };
    let signs = signs_of(setting, state, &[], 0);
    let all = followed.kept(setting)?;
    let linear = course.linear(&followed.paths, &all, &list.x)?;
    let mut blocks = course.reduced(&followed.paths, &all, &linear, &list, signs)?;
    let own: Vec<usize> = (0..list.x.len()).collect();
    let fitted = blocks.fit(&own)?.all;
    blocks.weigh(&blocks.misfits(&fitted));
    let fitted: DVector<f64> = blocks.fit(&own)?.all;
    let found: Vec<_> = blocks.places.iter().zip(blocks.misfits(&fitted)).collect();
    let power = |of: &Range| found.iter().find(|(place, _)| *place == of).map_or(f64::INFINITY, |(_, m)| m[0]);
    Some(course.places(&followed.paths, &all).iter().flatten().map(power).collect())
}

/// What records that the model itself makes leave.
pub struct Remade {
    /// Mean power over that of the noise, at least 1.
    pub mean: f64,
    /// Standard error of what one record's power differs by from it: by chance, and because the
    /// noise itself is estimated.
    pub error: f64,
    /// Whether each block is followed in them. Where it is not (a path that comes to rest and
    /// leaves it at another instant), nothing about the model can be told from it.
    pub follows: Vec<bool>,
    /// Whether most of a power that is far above the noise's is that of the inputs' noise.
    pub of_inputs: bool,
}

/// The middle one of some numbers; 0 of none.
fn middle(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(0.0)
}

/// Mean power over that of the noise in such records, in the windows that are followed; in all of
/// them where that is less than half.
pub fn remade(setting: &Setting<'_>, state: &State) -> Option<Remade> {
    let followed = state.followed.as_ref()?;
    let noise = &setting.sensors.inputs;
    let noisy = noise.iter().any(|l| l.sigma() > 0.0);
    let records = if noisy { NOISY_RECORDS } else { RECORDS };
    let all: Vec<Vec<f64>> = (0..records).map(|r| powers(setting, state, followed, r, noise)).collect::<Option<_>>()?;
    // Noise of inputs is in all windows.
    let most = EXCUSED * EXCUSED * middle(all.concat()).max(1.0);
    let mut follows: Vec<bool> = (0..all.first()?.len()).map(|w| all.iter().all(|powers| powers[w] <= most)).collect();
    if 2 * follows.iter().filter(|f| **f).count() < follows.len() {
        follows.fill(true);
    }
    let kept: Vec<f64> =
        all.iter().flat_map(|powers| powers.iter().zip(&follows).filter(|p| *p.1).map(|p| *p.0)).collect();
    let count = kept.len() as f64;
    let windows = count / records as f64;
    let mean = kept.iter().sum::<f64>() / count;
    let variance = kept.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    // A counter may have more noise than its grid.
    let mean = mean.max(1.0);
    let of_noise = setting.sensors.square_error.iter().fold(0.0_f64, |m, e| m.max(*e));
    let mut error = (variance * (1.0 / windows + 1.0 / count)).sqrt().hypot(mean * of_noise);
    if noisy {
        // Windows of one record have the noise of one resonance.
        let means: Vec<f64> = all
            .iter()
            .map(|powers| {
                let own = powers.iter().zip(&follows).filter(|p| *p.1).map(|p| *p.0);
                own.sum::<f64>() * records as f64 / count
            })
            .collect();
        let middle = means.iter().sum::<f64>() / records as f64;
        let between = means.iter().map(|m| (m - middle).powi(2)).sum::<f64>() / (records - 1) as f64;
        error = error.hypot((between * (1.0 + 1.0 / records as f64)).sqrt());
    }
    let without = || powers(setting, state, followed, 0, &[]).map(middle);
    let of_inputs = noisy && mean > EXCUSED * EXCUSED && without().is_some_and(|without| 2.0 * without < mean);
    (mean.is_finite() && error.is_finite()).then_some(Remade { mean, error, follows, of_inputs })
}
