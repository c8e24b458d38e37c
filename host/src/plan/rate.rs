//! Information of one more record, from records of a length each.
//!
//! Information is the square of a separation or one over a variance. That between two effects adds
//! up over a record: much of it is in rare passages (an arm that goes round), so that short records
//! differ by several times, and long ones have the arithmetic mean of short ones. Standard errors
//! of parameters rest on the few windows whose motion is most sensitive: their scatter between
//! records is the same at every length. Logarithms are taken to be normal.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Probability with which one more record has at least, or at most, what is told.
const PROBABLE: f64 = 0.975;
/// Logarithm of the greatest length that is reckoned with (by hand).
const LONGEST: f64 = 20.0;

/// Information that records have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// Mean of the logarithms, and logarithm of the mean.
    mean_log: f64,
    log_mean: f64,
    /// Standard deviation of the logarithms times Student's quantile.
    half: f64,
    count: f64,
    /// Whether a longer record is the sum of such ones, rather than like one of them.
    adds_up: bool,
}

impl Rate {
    /// Of positive numbers; none where one is not, or there are none.
    pub fn of(all: &[f64], adds_up: bool) -> Option<Self> {
        if all.is_empty() || !all.iter().all(|x| *x > 0.0 && x.is_finite()) {
            return None;
        }
        let count = all.len() as f64;
        let mean_log = all.iter().map(|x| x.ln()).sum::<f64>() / count;
        let square = all.iter().map(|x| (x.ln() - mean_log).powi(2)).sum::<f64>() / (count - 1.0);
        // One alone says nothing of others: what is told of it counts draws, and claims no bound.
        let half = StudentsT::new(0.0, 1.0, count - 1.0).map_or(0.0, |t| t.inverse_cdf(PROBABLE) * square.sqrt());
        Some(Self { mean_log, log_mean: (all.iter().sum::<f64>() / count).ln(), half, count, adds_up })
    }

    /// Information of one more record so many times as long: expected for `side` 0; what it is
    /// above (−1) or below (1) with a probability of 97.5 % (Student's prediction interval); of one
    /// record, what it itself has.
    pub fn at(&self, longer: f64, side: f64) -> f64 {
        let one = if self.adds_up { 1.0 / longer.max(1.0) } else { 1.0 };
        let middle = one * self.mean_log + (1.0 - one) * self.log_mean;
        longer * (middle + side * self.half * (one + 1.0 / self.count).sqrt()).exp()
    }

    /// Times as long that one more record has to be to have some information with that probability.
    pub fn longer(&self, wanted: f64) -> f64 {
        let one = self.at(1.0, -1.0);
        if one >= wanted || !self.adds_up {
            return wanted / one;
        }
        // It grows with the length.
        let (mut low, mut high) = (0.0, LONGEST);
        for _ in 0..60 {
            let middle = f64::midpoint(low, high);
            *(if self.at(middle.exp(), -1.0) < wanted { &mut low } else { &mut high }) = middle;
        }
        high.exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_more_is_within_the_bounds_of_a_prediction() {
        // Of 1, e² and e⁴: logarithms 0, 2, 4; mean 2, sd 2; t of 2 degrees of freedom at 97.5 % is
        // 4.3027.
        let e = core::f64::consts::E;
        let half = 4.302_653 * 2.0 * (4.0_f64 / 3.0).sqrt();
        for adds_up in [false, true] {
            let rate = Rate::of(&[1.0, e.powi(2), e.powi(4)], adds_up).unwrap();
            for side in [-1.0, 0.0, 1.0] {
                assert!((rate.at(1.0, side).ln() - 2.0 - side * half).abs() < 1e-4, "{side}");
            }
            for wanted in [1e-6, 1.0, 50.0] {
                let longer = rate.longer(wanted);
                assert!((rate.at(longer, -1.0) / wanted - 1.0).abs() < 1e-9, "{wanted}: {longer}");
            }
        }
        assert!((Rate::of(&[3.0], true).unwrap().at(2.0, -1.0) - 6.0).abs() < 1e-12);
        assert_eq!(Rate::of(&[3.0, 0.0], false), None);
        assert_eq!(Rate::of(&[], false), None);
    }

    #[test]
    fn a_long_record_has_the_mean_of_short_ones() {
        let [sum, same] = [true, false].map(|adds_up| Rate::of(&[1.0, 1.0, 1.0, 9.0], adds_up).unwrap());
        assert!((sum.at(1e6, 0.0) / 3e6 - 1.0).abs() < 1e-5);
        assert!((same.at(1e6, 0.0) / 1e6 - 9.0_f64.powf(0.25)).abs() < 1e-9);
        // Of a sum of many the mean alone is not certain.
        let spread = |rate: &Rate, longer: f64| (rate.at(longer, 1.0) / rate.at(longer, 0.0)).ln();
        assert!((spread(&sum, 1.0) / spread(&sum, 1e9) - 5.0_f64.sqrt()).abs() < 1e-6);
        assert!((spread(&same, 1.0) - spread(&same, 1e9)).abs() < 1e-9);
    }
}
