//! Why candidates are not taken, and its words.

use super::{Field, NEAR, OF_A_FAMILY, Score};
use crate::explain::explanation::{BY_CHANCE, Refused};
use crate::wording::format::significant;

/// Most candidates of which it is told why they were not taken.
const MOST_REFUSED: usize = 8;

impl Field<'_> {
    /// Why candidates that were close are not taken, those that take away most first; `feigned`:
    /// those that the sensors alone give.
    pub(super) fn refusals(&self, order: &[&Score], feigned: &[usize]) -> Vec<Refused> {
        let tests = self.tests();
        let near = order.iter().filter(|s| s.p < NEAR && s.gain > 0.0).take(MOST_REFUSED);
        near.filter_map(|s| {
            let why = if self.feeds(s) {
                below_nothing(self.share(s))
            } else if feigned.contains(&s.index) {
                "records of the model without it, seen by the same sensors, show as much".to_owned()
            } else if s.p * tests >= OF_A_FAMILY {
                by_chance(s.p, tests)
            } else if !self.stands(s) {
                let share = 100.0 * self.share(s);
                let why = if self.is_something(s.gain) { "but not from block to block" } else { "as good as nothing" };
                format!("it takes away {share:.2} % of what is left where it was not fitted, {why}")
            } else {
                return None;
            };
            Some(Refused::new(self.name(s), why))
        })
        .collect()
    }

    /// The same of those that a fit held at nothing, because they come out with the sign of no such
    /// law, and that with this sign would be taken.
    pub(super) fn with_the_other_sign(&self, order: &[&Score], feigned: &dyn Fn(&Score) -> bool) -> Vec<Refused> {
        let held = order.iter().filter(|s| self.feeds(s) && s.p >= NEAR);
        let free = |s: &&Score| {
            let (from, d) = self.places[s.index];
            let columns: Vec<usize> = self.own.iter().copied().chain(from..from + d).collect();
            let free = Score::new(s.index, d, self.evidence.fit_of_either_sign(&columns, d)?, &self.plain);
            let is_clear = free.p * self.tests() < OF_A_FAMILY && self.stands(&free) && self.feeds(&free);
            is_clear.then_some(free)
        };
        let mut found: Vec<Score> = held.filter_map(free).filter(|s| !feigned(s)).collect();
        found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let told = |s: &Score| Refused::new(self.name(s), below_nothing(self.share(s)));
        found.iter().map(told).take(MOST_REFUSED).collect()
    }

    /// Share of the held-out residual power that a candidate takes away.
    pub(super) fn share(&self, s: &Score) -> f64 {
        s.gain * self.blocks / self.total
    }
}

/// That a candidate's strength is below nothing, and what it would take away.
fn below_nothing(share: f64) -> String {
    format!(
        "it would take away {} % of what is left, but with a strength below zero, as a law has that feeds the motion or pushes it away from where it rests",
        significant(100.0 * share, 2)
    )
}

/// That a candidate is not rare enough among all that were tried: the probability by chance, how
/// often as much is expected, and how seldom it would have to be.
fn by_chance(p: f64, tests: f64) -> String {
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
