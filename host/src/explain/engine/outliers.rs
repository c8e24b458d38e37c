//! Samples of a sensor that stand alone far from what the model and the samples beside them say: a
//! tracker that took another mark, a disturbance on a line. What a motion lacks shows in many
//! samples one after the other, and no state of a window follows one.
//!
//! In units of the noise, with r_i the residual of a sensor at sample i along the windows' fitted
//! motion and s the greater of 1 and 1.4826 median|r|, sample i is one where |r_i| > `LIMIT` s
//! and |r_i| > `ALONE` max(|r_{i−1}|, |r_{i+1}|).

use super::setting::Setting;
use super::state::State;
use crate::statistics::median;

/// Standard deviations: by chance 10⁻¹⁵ a look.
const LIMIT: f64 = 8.0;
/// Over the residuals beside it.
const ALONE: f64 = 3.0;
/// Standard deviation of Gaussian noise over the median of its size.
const SIGMA: f64 = 1.4826;
/// Greatest share of the samples: what is more is no accident.
const MOST: f64 = 0.01;

/// Such a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outlier {
    /// Record.
    pub record: usize,
    /// Channel of the record.
    pub channel: usize,
    /// Time, s.
    pub time_s: f64,
    /// Measured minus expected, in the channel's unit.
    pub size: f64,
}

/// Least share of the squares above the noise's that they must be: where much else is left, they
/// decide nothing, and the record is not explained again for them.
const MUCH: f64 = 0.5;

/// Samples of a series that stand alone: places.
fn alone(residuals: &[Option<f64>]) -> Vec<usize> {
    let mut sizes: Vec<f64> = residuals.iter().flatten().map(|r| r.abs()).collect();
    let limit = LIMIT * (SIGMA * median(&mut sizes)).max(1.0);
    let is_alone = |w: &[Option<f64>]| match *w {
        [Some(a), Some(r), Some(b)] => r.abs() > limit && r.abs() > ALONE * a.abs().max(b.abs()),
        _ => false,
    };
    residuals.windows(3).enumerate().filter(|(_, w)| is_alone(w)).map(|(i, _)| i + 1).collect()
}

/// All of them where the motion was followed; none where there are too many, or much else is left.
pub fn find(setting: &Setting<'_>, state: &State) -> Vec<Outlier> {
    let Some(settled) = state.followed.as_ref().and_then(|f| f.settled(setting)) else { return Vec::new() };
    let sensors = state.sensors(setting);
    let (mut all, mut theirs, mut above) = (Vec::new(), 0.0, 0.0);
    for (k, stretch) in state.stretches.iter().enumerate() {
        let states: Vec<Option<Vec<f64>>> = (0..stretch.len()).map(|i| settled.at(k, i)).collect();
        for (sensor, shown) in stretch.sensors(&setting.bound).iter().enumerate() {
            let sigma = sensors.sigma[sensor];
            let weights = setting.bound.shown.row(sensor);
            let expected = |x: &Vec<f64>| weights.iter().zip(x).map(|(w, q)| w * q).sum::<f64>();
            let left: Vec<Option<f64>> =
                states.iter().zip(shown).map(|(x, y)| x.as_ref().map(|x| (y - expected(x)) / sigma)).collect();
            let channel = setting.bound.sensors[sensor];
            let of = |i: usize| Outlier {
                record: setting.record_of[k],
                channel,
                time_s: stretch.time(i),
                size: left[i].unwrap_or(0.0) * sigma / setting.rig.channel[channel].scale(),
            };
            let found = alone(&left);
            theirs += found.iter().filter_map(|i| left[*i]).map(|r| r * r).sum::<f64>();
            above += left.iter().flatten().map(|r| r * r - 1.0).sum::<f64>();
            all.extend(found.into_iter().map(of));
        }
    }
    let samples: usize = state.stretches.iter().map(crate::identify::stretches::Stretch::len).sum();
    let few = all.len() as f64 <= MOST * samples as f64;
    if few && theirs >= MUCH * above { all } else { Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_sample_stands_alone_and_what_a_model_misses_does_not() {
        let noise = |i: usize| 2.0 * (43_758.545 * (12.9898 * i as f64).sin()).fract();
        let mut left: Vec<Option<f64>> = (0..400).map(|i| Some(noise(i))).collect();
        assert!(alone(&left).is_empty());
        left[120] = Some(25.0);
        assert_eq!(alone(&left), [120]);
        // A bump of some samples is a motion.
        (200..212).for_each(|i| left[i] = Some(40.0 * (0.26 * (i - 200) as f64).sin()));
        assert_eq!(alone(&left), [120]);
        // Nothing is said beside a gap.
        left[119] = None;
        assert!(alone(&left).is_empty());
    }
}
