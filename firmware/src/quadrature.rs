//! Hardware quadrature counters, extended to multi-turn counts.
//!
//! embedded-hal 1 has no trait for a quadrature counter, so here is one. Limit: less than 2¹⁵
//! counts between two readings (at 500 Hz and 4096 counts a turn: 4000 turns a second).

use whirl_shared::encoder::{Direction, MultiTurn};

/// A 16-bit counter of quadrature edges that wraps.
///
/// Reading cannot fail and takes a constant time: it is the first thing in the sampling interrupt.
/// A counter of more bits gives its low 16.
pub trait QuadratureCounter {
    /// The present count, modulo 2¹⁶.
    fn count(&mut self) -> u16;

    /// The count that the hardware held when the encoder's index mark last came, told once.
    /// Counters without a line for the index have none.
    fn index(&mut self) -> Option<u16> {
        None
    }
}

impl<C: QuadratureCounter + ?Sized> QuadratureCounter for &mut C {
    fn count(&mut self) -> u16 {
        (**self).count()
    }

    fn index(&mut self) -> Option<u16> {
        (**self).index()
    }
}

/// An encoder: the turns that its counter has forgotten, and its sense.
#[derive(Clone, Copy, Debug, Default)]
pub struct Encoder {
    turns: MultiTurn,
    reversed: bool,
}

impl Encoder {
    /// The hardware counter's zero is at `position`.
    pub fn new(reversed: bool, position: i32) -> Self {
        let mut turns = MultiTurn::new();
        turns.preset(position);
        Self { turns, reversed }
    }

    fn in_sense(&self, count: u16) -> u16 {
        if self.reversed { count.wrapping_neg() } else { count }
    }

    /// Extends a counter's reading to the multi-turn position.
    pub fn extend(&mut self, latched: u16) -> i32 {
        self.turns.update(self.in_sense(latched))
    }

    /// The multi-turn position of the index mark that the counter held at `seen`, where the encoder
    /// turns up. `latched` is the counter's last reading.
    pub fn index(&self, seen: u16, latched: u16) -> Option<i32> {
        // The mark is less than a tick's motion away.
        let away = self.in_sense(seen).wrapping_sub(self.in_sense(latched)).cast_signed();
        (self.turns.direction() == Direction::Positive).then(|| self.turns.position().wrapping_add(i32::from(away)))
    }

    /// Calls the place of the last reading zero.
    pub fn zero(&mut self) {
        self.turns.preset(0);
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
        let mut encoder = Encoder::new(false, 0);
        readings.iter().map(|latched| encoder.extend(*latched)).collect()
    }

    #[test]
    fn follows_the_counter_over_its_wrap_in_both_senses() {
        assert_eq!(positions(&[65_535, 0, 1, 65_530]), [-1, 0, 1, -6]);
        assert_eq!(positions(&[30_000, 60_000, 24_464, 54_464]), [30_000, 60_000, 90_000, 120_000]);
        assert_eq!(positions(&[0, 33_000]), [0, -32_536]);
    }

    #[test]
    fn zero_is_taken_at_the_last_reading() {
        let mut encoder = Encoder::new(false, 0);
        assert_eq!(encoder.extend(500), 500);
        encoder.zero();
        assert_eq!(encoder.extend(510), 10);
    }

    #[test]
    fn a_reversed_encoder_counts_the_other_way_from_its_position() {
        let mut encoder = Encoder::new(true, 1_000);
        assert_eq!([1, 2, 65_535].map(|latched| encoder.extend(latched)), [999, 998, 1_001]);
    }

    /// Reads 100 counts further each time, with its mark at one place of every turn of 1000.
    struct Marked(u16, Option<u16>);

    impl QuadratureCounter for Marked {
        fn count(&mut self) -> u16 {
            self.0
        }
        fn index(&mut self) -> Option<u16> {
            self.1.take()
        }
    }

    #[test]
    fn a_borrowed_counter_tells_what_the_counter_tells() {
        let mut marked = Marked(10, Some(7));
        let mut borrowed = &mut marked;
        let tells = |counter: &mut dyn QuadratureCounter| (counter.count(), counter.index(), counter.index());
        assert_eq!(tells(&mut borrowed), (10, Some(7), None));
        assert_eq!(marked.1, None);
        // One without a line for the index never has one.
        assert_eq!(tells(&mut Script([3].iter())), (3, None, None));
    }

    #[test]
    fn the_index_is_placed_among_the_turns_and_only_on_the_way_up() {
        for (reversed, from, to, seen, want) in [
            (false, 65_500, 80, 10_u16, Some(10)),
            (false, 65_500, 80, 65_530, Some(-6)),
            (false, 80, 65_500, 10, None),
            (true, 80, 65_500, 10, Some(-10)),
        ] {
            let mut encoder = Encoder::new(reversed, 0);
            encoder.extend(from);
            encoder.extend(to);
            assert_eq!(encoder.index(seen, to), want, "{reversed} {from} {to}");
        }
    }
}
