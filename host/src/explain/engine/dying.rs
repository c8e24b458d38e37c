//! Motions that die away: more of the same record would tell nothing.

use super::setting::Setting;

/// Whether a motion that nothing drives is over: what its sensors would show after the record's
/// end, however long that went on, is less than a mean one of so many blocks shows of it.
pub fn is_over(setting: &Setting<'_>, blocks: usize) -> bool {
    if setting.rig.drive.is_some() || !setting.bound.inputs.is_empty() {
        return false;
    }
    let Some(longest) = setting.raw.iter().max_by_key(|s| s.len()) else { return false };
    longest.sensors(&setting.bound).iter().all(|x| dies_away(x, blocks))
}

/// The same of what one sensor showed. Squares about the mean of each third fall from the first to
/// the last by a factor, and on by its root from third to third: a geometric series.
fn dies_away(x: &[f64], blocks: usize) -> bool {
    let third = x.len() / 3;
    if third < 2 {
        return false;
    }
    let squares = |k: usize| {
        let part = &x[k * third..(k + 1) * third];
        let mean = part.iter().sum::<f64>() / third as f64;
        part.iter().map(|x| (x - mean).powi(2)).sum::<f64>()
    };
    let [first, middle, last] = [0, 1, 2].map(squares);
    let factor = (last / first).sqrt();
    factor < 1.0 && last * factor / (1.0 - factor) < (first + middle + last) / blocks.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swing_that_has_died_away_is_over_and_one_that_goes_on_is_not() {
        let swing = |damped: &dyn Fn(f64) -> f64| -> Vec<f64> {
            (0..150).map(|i| 1.0 + damped(f64::from(i) / 150.0) * (0.25 * f64::from(i)).sin()).collect()
        };
        // By dry friction, by drag in proportion to the speed, hardly at all.
        assert!(dies_away(&swing(&|t| 1.0 - t), 9));
        assert!(dies_away(&swing(&|t| (-3.0 * t).exp()), 9));
        assert!(!dies_away(&swing(&|t| (-0.3 * t).exp()), 9));
        assert!(!dies_away(&swing(&|t| (0.5 * t).exp()), 9));
        assert!(!dies_away(&[1.0; 9], 9));
    }
}
