//! Hardware quadrature counters, extended to multi-turn counts.
//!
//! embedded-hal 1 has no trait for a quadrature counter, so here is one. Limit: less than 2¹⁵ counts between two
//! readings (at 500 Hz and 4096 counts a turn: 4000 turns a second).

use whirl_shared::encoder::MultiTurn;

/// A 16-bit counter of quadrature edges that wraps.
///
/// Reading cannot fail and takes a constant time: it is the first thing in the sampling interrupt. A counter of more
/// bits gives its low 16.
pub trait QuadratureCounter {
    /// The present count, modulo 2¹⁶.
    fn count(&mut self) -> u16;
}

impl<C: QuadratureCounter + ?Sized> QuadratureCounter for &mut C {
    fn count(&mut self) -> u16 {
        (**self).count()
    }
}

/// An encoder: its counter, and the turns that the counter has forgotten.
#[derive(Debug)]
pub struct Encoder<C> {
    counter: C,
    turns: MultiTurn,
}

impl<C: QuadratureCounter> Encoder<C> {
    /// Zero is where the hardware counter has its zero.
    pub const fn new(counter: C) -> Self {
        Self { counter, turns: MultiTurn::new() }
    }

    /// Reads the hardware alone.
    pub fn latch(&mut self) -> u16 {
        self.counter.count()
    }

    /// Extends a latched reading to the multi-turn position.
    pub fn extend(&mut self, latched: u16) -> i32 {
        self.turns.update(latched)
    }

    /// Calls the place of the last reading zero.
    pub fn zero(&mut self) {
        self.turns.preset(0);
    }

    /// The hardware counter.
    pub fn counter_mut(&mut self) -> &mut C {
        &mut self.counter
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Script<'a>(core::slice::Iter<'a, u16>);

    impl QuadratureCounter for Script<'_> {
        fn count(&mut self) -> u16 {
            self.0.next().copied().unwrap_or(0)
        }
    }

    fn positions(readings: &[u16]) -> std::vec::Vec<i32> {
        let mut encoder = Encoder::new(Script(readings.iter()));
        readings
            .iter()
            .map(|_| {
                let latched = encoder.latch();
                encoder.extend(latched)
            })
            .collect()
    }

    #[test]
    fn follows_the_counter_over_its_wrap_in_both_senses() {
        assert_eq!(positions(&[65_535, 0, 1, 65_530]), [-1, 0, 1, -6]);
        assert_eq!(positions(&[30_000, 60_000, 24_464, 54_464]), [30_000, 60_000, 90_000, 120_000]);
        assert_eq!(positions(&[0, 33_000]), [0, -32_536]);
    }

    #[test]
    fn zero_is_taken_at_the_last_reading() {
        let mut encoder = Encoder::new(Script([500, 510].iter()));
        let first = encoder.latch();
        assert_eq!(encoder.extend(first), 500);
        encoder.zero();
        let second = encoder.latch();
        assert_eq!(encoder.extend(second), 10);
    }
}
