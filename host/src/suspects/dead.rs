//! A channel that does not move over the whole record: all of it within one step of its middle.
//!
//! An encoder at rest may flicker by one count; a sensor without steps must be constant to the last
//! digit. A record of fewer than [`FEWEST`] samples says nothing.

use super::trace::{Samples, Trace};

/// Fewest samples for a verdict.
const FEWEST: usize = 64;

/// Where a channel stands; none where it moves.
pub fn dead(trace: &Trace<'_>) -> Option<f64> {
    if trace.len() < FEWEST {
        return None;
    }
    let first = trace.stretches.iter().find(|s| s.len() > 0)?.at(0);
    let (mut low, mut high) = (first, first);
    for s in &trace.stretches {
        for i in 0..s.len() {
            let v = s.at(i);
            (low, high) = (low.min(v), high.max(v));
            if high - low > 2.0 * trace.quantum {
                return None;
            }
        }
    }
    let counts = trace.stretches.iter().all(|s| matches!(s, Samples::Counts(_)));
    (high == low || counts).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_is_dead_and_a_small_motion_is_not() {
        let of = |x: &[i32]| dead(&Trace::new(vec![Samples::Counts(x)]));
        assert_eq!(of(&[7; 100]), Some(7.0));
        let flicker: Vec<i32> = (0..100).map(|i| 7 + i32::from(i % 13 == 0)).collect();
        assert_eq!(of(&flicker), Some(8.0));
        let swing: Vec<i32> = (0..100).map(|i| i % 9).collect();
        assert_eq!(of(&swing), None);
        assert_eq!(of(&[7; 20]), None);
        assert_eq!(dead(&Trace::new(vec![Samples::Values(&[0.25; 100])])), Some(0.25));
    }
}
