//! A bit of a count that never changes although the counts pass over both of its values.
//!
//! Counts that reach over a range of 2^{k+1} pass k's both values. Of N samples as good as uniform
//! within 2^{k+1} counts, none would show one of them with probability 2^{−N}; samples follow each
//! other closely, so that only counts that cross the place where the bit changes, at least
//! [`FEWEST`] times, are taken.
//!
//! Bits from 0 up that are stuck together make a coarser encoder: k bits at v show c for the 2^k
//! counts from c − v on, the middle of which lies (2^k − 1)/2 − v beyond that of c alone. The
//! record's channel is told so ([`Channel::middle`](crate::rig::Channel::middle)).

use super::trace::{Samples, Trace};
use crate::rig::StuckBits;

/// Crossings of a place at which the bit should have changed.
const FEWEST: u64 = 40;

/// A bit that is stuck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stuck {
    /// Which, from 0.
    pub bit: u32,
    /// Its value.
    pub value: u8,
    /// Whether all bits below are stuck too: the count is coarse, not wrong.
    pub coarse: bool,
}

/// The stuck bits of a channel, lowest first; none for values.
pub fn stuck(trace: &Trace<'_>) -> Vec<Stuck> {
    let (mut all, mut any, mut low, mut high) = (!0_i32, 0_i32, i32::MAX, i32::MIN);
    for s in &trace.stretches {
        let Samples::Counts(x) = s else { return vec![] };
        for &c in *x {
            (all, any, low, high) = (all & c, any | c, low.min(c), high.max(c));
        }
    }
    let range = i64::from(high) - i64::from(low);
    let mut found: Vec<Stuck> = Vec::new();
    for bit in 0..30 {
        if range < 2 << bit {
            break;
        }
        let (one, zero) = (all >> bit & 1 == 1, any >> bit & 1 == 0);
        if (one || zero) && crossings(trace, bit) >= FEWEST {
            let coarse = found.len() == bit as usize;
            found.push(Stuck { bit, value: u8::from(one), coarse });
        }
    }
    found
}

/// The lowest bits that are stuck, where no other is: a coarser count.
pub fn coarse(stuck: &[Stuck]) -> Option<StuckBits> {
    let value = stuck.iter().map(|s| u32::from(s.value) << s.bit).sum();
    (!stuck.is_empty() && stuck.iter().all(|s| s.coarse)).then_some(StuckBits { bits: stuck.len() as u32, value })
}

/// How often the counts pass from one block of 2^{bit+1} to another.
fn crossings(trace: &Trace<'_>, bit: u32) -> u64 {
    let of = |s: &Samples<'_>| match s {
        Samples::Counts(x) => x.windows(2).filter(|w| w[0] >> (bit + 1) != w[1] >> (bit + 1)).count() as u64,
        Samples::Values(_) => 0,
    };
    trace.stretches.iter().map(of).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_that_never_change_are_named() {
        let x: Vec<i32> = (0..8000).map(|i| (700.0 * (0.02 * f64::from(i)).sin()) as i32).collect();
        let of = |f: &dyn Fn(i32) -> i32| {
            stuck(&Trace::new(vec![Samples::Counts(&x.iter().map(|c| f(*c)).collect::<Vec<_>>())]))
        };
        assert_eq!(of(&|c| c), []);
        assert_eq!(of(&|c| c | 4), [Stuck { bit: 2, value: 1, coarse: false }]);
        assert_eq!(of(&|c| c & !64), [Stuck { bit: 6, value: 0, coarse: false }]);
        let low = of(&|c| c & !3);
        assert!(low.len() == 2 && low.iter().all(|s| s.coarse && s.value == 0), "{low:?}");
        // A small motion within one block does not show the bit.
        assert_eq!(of(&|c| c / 100), []);
    }
}
