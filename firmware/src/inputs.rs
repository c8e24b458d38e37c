//! What a board reads at a tick: its encoders' counters, and the input of the base's motion where
//! it has one.

use whirl_shared::frame::MOST_CHANNELS;

use crate::base::BaseInput;
use crate::quadrature::QuadratureCounter;

/// What the hardware showed at one instant: the encoders' counters, then the base's input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Latched(pub [u16; MOST_CHANNELS]);

/// The inputs of a board.
///
/// Reading cannot fail and takes a constant time: it is the first thing in the sampling interrupt.
pub trait Inputs {
    /// Whether there is an input for the base's motion.
    const BASE: bool = false;

    /// Encoders, at most [`whirl_shared::frame::MOST_ENCODERS`].
    fn encoders(&self) -> usize;

    /// Reads every encoder's counter, one right after the other, into the first places.
    fn latch(&mut self, into: &mut Latched);

    /// The count that the hardware held when an encoder's index mark last came, told once.
    fn index(&mut self, encoder: usize) -> Option<u16>;

    /// Reads the input of the base's motion.
    fn latch_base(&mut self) -> u16 {
        0
    }
}

impl<C: QuadratureCounter, const N: usize> Inputs for [C; N] {
    fn encoders(&self) -> usize {
        N
    }

    fn latch(&mut self, into: &mut Latched) {
        for (place, counter) in into.0.iter_mut().zip(self) {
            *place = counter.count();
        }
    }

    fn index(&mut self, encoder: usize) -> Option<u16> {
        self.get_mut(encoder)?.index()
    }
}

impl<C1: QuadratureCounter, C2: QuadratureCounter> Inputs for (C1, C2) {
    fn encoders(&self) -> usize {
        2
    }

    fn latch(&mut self, into: &mut Latched) {
        (into.0[0], into.0[1]) = (self.0.count(), self.1.count());
    }

    fn index(&mut self, encoder: usize) -> Option<u16> {
        match encoder {
            0 => self.0.index(),
            1 => self.1.index(),
            _ => None,
        }
    }
}

/// Encoders, and an input for the base's motion beside them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WithBase<I, B> {
    /// The encoders.
    pub encoders: I,
    /// The base's.
    pub base: B,
}

impl<I: Inputs, B: BaseInput> Inputs for WithBase<I, B> {
    const BASE: bool = true;

    fn encoders(&self) -> usize {
        self.encoders.encoders()
    }

    fn latch(&mut self, into: &mut Latched) {
        self.encoders.latch(into);
    }

    fn index(&mut self, encoder: usize) -> Option<u16> {
        self.encoders.index(encoder)
    }

    fn latch_base(&mut self) -> u16 {
        self.base.latch()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Counter(u16);

    impl QuadratureCounter for Counter {
        fn count(&mut self) -> u16 {
            self.0
        }

        fn index(&mut self) -> Option<u16> {
            Some(self.0 + 1)
        }
    }

    struct Converter;

    impl BaseInput for Converter {
        fn latch(&mut self) -> u16 {
            9
        }
    }

    fn read(mut inputs: impl Inputs, encoders: usize) -> (Latched, [Option<u16>; 4], u16) {
        let mut latched = Latched::default();
        inputs.latch(&mut latched);
        let indices = [0, 1, 2, 3].map(|i| inputs.index(i));
        assert_eq!(indices.iter().flatten().count(), encoders);
        (latched, indices, inputs.latch_base())
    }

    #[test]
    fn every_encoder_has_its_place() {
        let (latched, indices, base) = read((Counter(5), Counter(7)), 2);
        assert_eq!((latched.0[..3].to_vec(), indices[1], base), (std::vec![5, 7, 0], Some(8), 0));
        let (latched, indices, base) = read(WithBase { encoders: [1, 2, 3].map(Counter), base: Converter }, 3);
        assert_eq!((latched.0[..4].to_vec(), indices[2], base), (std::vec![1, 2, 3, 0], Some(4), 9));
    }
}
