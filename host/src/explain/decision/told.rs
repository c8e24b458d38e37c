//! Words of why a candidate is not taken.

use super::OF_A_FAMILY;
use crate::explain::explanation::BY_CHANCE;
use crate::wording::format::significant;

/// That a candidate is not rare enough among all that were tried: the probability by chance, how
/// often as much is expected, and how seldom it would have to be.
pub(super) fn by_chance(p: f64, tests: f64) -> String {
    format!(
        "{BY_CHANCE} {}: of the {tests} forms that were tried {} would do as well, and {OF_A_FAMILY} may",
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
            "by chance with probability 1.3·10⁻⁴: of the 42 forms that were tried 0.0056 would do as well, and 0.005 may"
        );
        assert!(by_chance(0.0053, 365.0).contains("of the 365 forms that were tried 1.9 would"));
    }
}
