//! A channel that is renewed at every n-th sample only, and holds its value in between.
//!
//! Its increments are zero but at one phase of n. With K increments that are not zero, all at rows
//! of the same phase, chance would need n^{−K}: K ≥ [`FEWEST`] is beyond any doubt for n = 2, and
//! for every greater n.

use super::trace::Trace;

/// Increments that must be seen: 2⁻⁶⁰ by chance.
const FEWEST: usize = 60;
/// Greatest number of samples held.
const LONGEST: usize = 64;

/// Samples for which a channel holds its value; none where it is renewed at each.
pub fn held(trace: &Trace<'_>) -> Option<usize> {
    let mut common = 0;
    let mut seen = 0;
    for s in &trace.stretches {
        let (mut first, mut here) = (None, 0usize);
        for i in 1..s.len() {
            if s.at(i) != s.at(i - 1) {
                let from = *first.get_or_insert(i);
                common = divisor(common, i - from);
                here += 1;
                if common == 1 {
                    return None;
                }
            }
        }
        seen += here.saturating_sub(1);
    }
    (seen >= FEWEST && (2..=LONGEST).contains(&common)).then_some(common)
}

fn divisor(mut a: usize, mut b: usize) -> usize {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests {
    use super::super::trace::Samples;
    use super::*;

    #[test]
    fn held_samples_are_counted_and_slow_motion_is_not_held() {
        let motion = |i: usize| (300.0 * (0.02 * i as f64).sin()) as i32;
        for n in [2, 3, 8] {
            let x: Vec<i32> = (0..4000).map(|i| motion((i + 1) / n * n)).collect();
            assert_eq!(held(&Trace::new(vec![Samples::Counts(&x)])), Some(n));
        }
        let slow: Vec<i32> = (0..4000).map(|i| (20.0 * (0.003 * f64::from(i)).sin()) as i32).collect();
        assert_eq!(held(&Trace::new(vec![Samples::Counts(&slow)])), None);
        assert_eq!(held(&Trace::new(vec![Samples::Counts(&[3; 500])])), None);
    }
}
