//! The base's own motion, read beside the encoders: by a third encoder, or by the board's
//! analogue-to-digital converter from a displacement transducer or an accelerometer.
//!
//! What is sent are counts: an encoder's multi-turn count, a converter's count from the middle of
//! its range (16 bits: 12 bits summed over 16 conversions). What a count is worth, and of what, is
//! a setting ([`whirl_shared::frame::BaseSensor`]) that the hello tells.

use whirl_shared::encoder::MultiTurn;
use whirl_shared::frame::BaseKind;

/// The middle of a converter's 16 bits.
const MIDDLE: i32 = 1 << 15;

/// A board's input for the base's motion: what its counter or its converter shows.
///
/// Reading cannot fail and takes a constant time: it is done with the encoders' counters, first
/// thing in the sampling interrupt.
pub trait BaseInput {
    /// The low 16 bits of an encoder's counter, or the sum of 16 conversions of 12 bits (at the top
    /// of 16 bits, where a converter has others).
    fn latch(&mut self) -> u16;
}

impl<B: BaseInput + ?Sized> BaseInput for &mut B {
    fn latch(&mut self) -> u16 {
        (**self).latch()
    }
}

/// None connected: a converter's lowest count, an encoder that stands.
impl<B: BaseInput> BaseInput for Option<B> {
    fn latch(&mut self) -> u16 {
        self.as_mut().map_or(0, BaseInput::latch)
    }
}

/// The sensor of the base's motion as it is set.
#[derive(Debug)]
pub(crate) struct Base {
    kind: BaseKind,
    turns: MultiTurn,
}

impl Base {
    pub fn new(kind: BaseKind) -> Self {
        Self { kind, turns: MultiTurn::new() }
    }

    /// Whether there is one.
    pub fn is_there(&self) -> bool {
        self.kind != BaseKind::None
    }

    /// The count that a latched reading stands for.
    pub fn extend(&mut self, latched: u16) -> i32 {
        match self.kind {
            BaseKind::None => 0,
            BaseKind::Encoder => self.turns.update(latched),
            BaseKind::Position | BaseKind::Acceleration => i32::from(latched) - MIDDLE,
        }
    }

    /// Calls the place of the last reading zero, where that is an encoder's.
    pub fn zero(&mut self) {
        self.turns.preset(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_an_encoders_or_a_converters() {
        let mut encoder = Base::new(BaseKind::Encoder);
        assert_eq!([65_530, 5].map(|c| encoder.extend(c)), [-6, 5]);
        encoder.zero();
        assert_eq!(encoder.extend(15), 10);
        let mut converter = Base::new(BaseKind::Position);
        assert_eq!([0, 32_768, 65_535].map(|c| converter.extend(c)), [-32_768, 0, 32_767]);
        converter.zero();
        assert_eq!(converter.extend(32_769), 1);
        assert!(converter.is_there() && !Base::new(BaseKind::None).is_there());
    }
}
