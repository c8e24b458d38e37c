//! Information of one more record, from records of a length each.
//!
//! Information, the square of a separation or one over a variance, grows with the length. Much of it
//! is in the few windows of a record whose motion is most sensitive: how much differs by several
//! times from one record to the next, of whatever length they are. Logarithms are taken to be
//! normal.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Probability with which one more record has at least, or at most, what is told.
const PROBABLE: f64 = 0.975;

/// Information that records have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// Mean of the logarithms.
    middle: f64,
    /// Half of Student's prediction interval.
    half: f64,
}

impl Rate {
    /// Of positive numbers; none where one is not, or there are none.
    pub fn of(all: &[f64]) -> Option<Self> {
        if all.is_empty() || !all.iter().all(|x| *x > 0.0 && x.is_finite()) {
            return None;
        }
        let n = all.len() as f64;
        let middle = all.iter().map(|x| x.ln()).sum::<f64>() / n;
        let square = all.iter().map(|x| (x.ln() - middle).powi(2)).sum::<f64>() / (n - 1.0);
        // One alone says nothing of others.
        let student = StudentsT::new(0.0, 1.0, n - 1.0);
        let half = student.map_or(0.0, |t| t.inverse_cdf(PROBABLE) * (square * (1.0 + 1.0 / n)).sqrt());
        Some(Self { middle, half })
    }

    /// Information of one more record so many times as long: expected for `side` 0; what it is
    /// above (−1) or below (1) with a probability of 97.5 %.
    pub fn at(&self, longer: f64, side: f64) -> f64 {
        longer * (self.middle + side * self.half).exp()
    }

    /// Times as long that one more record has to be to have some information with that probability.
    pub fn longer(&self, wanted: f64) -> f64 {
        wanted / self.at(1.0, -1.0)
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
        let rate = Rate::of(&[1.0, e.powi(2), e.powi(4)]).unwrap();
        let half = 4.302_653 * 2.0 * (4.0_f64 / 3.0).sqrt();
        for side in [-1.0, 0.0, 1.0] {
            assert!((rate.at(1.0, side).ln() - 2.0 - side * half).abs() < 1e-4, "{side}");
        }
        assert!((rate.at(rate.longer(50.0), -1.0) - 50.0).abs() < 1e-9);
        assert!((Rate::of(&[3.0]).unwrap().at(2.0, -1.0) - 6.0).abs() < 1e-12);
        assert_eq!(Rate::of(&[3.0, 0.0]), None);
        assert_eq!(Rate::of(&[]), None);
    }
}
