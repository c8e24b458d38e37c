//! The base's motion: a third decoder, or a transducer on the converter.
//!
//! The converter sums 16 conversions of 12 bits, 2 µs each, one right after the other from the
//! moment at which the counters were read: its value is 16 µs late.

use embassy_rp::adc::{Adc, Blocking, Channel};
use whirl_firmware::QuadratureCounter;
use whirl_firmware::base::BaseInput;

use crate::hardware::Decoder;

/// Conversions that are summed.
const CONVERSIONS: u8 = 16;

/// What is connected.
pub enum Base {
    /// Nothing.
    None,
    /// An encoder.
    Encoder(Decoder<2>),
    /// A transducer.
    Converter(Adc<'static, Blocking>, Channel<'static>),
}

impl BaseInput for Base {
    fn latch(&mut self) -> u16 {
        match self {
            Self::None => 0,
            Self::Encoder(decoder) => decoder.count(),
            // A conversion that failed shows the lowest value; 16 · 4095 fit into 16 bits.
            Self::Converter(adc, channel) => {
                (0..CONVERSIONS).map(|_| adc.blocking_read(channel).unwrap_or(0) & 4_095).sum()
            }
        }
    }
}
