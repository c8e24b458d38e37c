//! Words of why a candidate is not taken.

use super::OF_A_FAMILY;
use crate::wording::format::significant;

/// That a candidate is not rare enough among all that were tried: the probability by chance, how
/// often as much is expected, and how seldom it would have to be.
pub(super) fn by_chance(p: f64, tests: f64) -> String {
    format!(
        "by chance with probability {}, that is {} times among the {tests} forms that were tried: fewer than {OF_A_FAMILY} would count",
        significant(p, 2),
        significant(p * tests, 2)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_tells_the_number_that_refused_it_and_its_limit() {
        assert_eq!(
            by_chance(1.334e-4, 42.0),
            "by chance with probability 1.3·10⁻⁴, that is 0.0056 times among the 42 forms that were tried: fewer than 0.005 would count"
        );
        assert!(by_chance(0.0053, 365.0).contains("1.9 times among the 365 forms"));
    }
}
