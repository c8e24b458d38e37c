//! The firmware's traits on the chip's peripherals.

use embassy_stm32::dac::{DacChannel, Value};
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac;
use embassy_stm32::pac::timer::vals::FilterValue;
use embassy_stm32::peripherals::{TIM2, TIM5};
use embassy_stm32::timer::qei::Qei;
use whirl_firmware::QuadratureCounter;
use whirl_firmware::dac::Converter;

/// A level counts when eight samples at a 32nd of the timer's clock agree: 1.5 µs at 170 MHz, 2.8 µs at 90 MHz. The shortest
/// time between edges is 12 µs (4096 counts a turn at 20 turns a second).
const FILTER: FilterValue = FilterValue::FDTS_DIV32_N8;

macro_rules! encoder {
    ($name:ident, $timer:ident, $text:literal) => {
        #[doc = $text]
        pub struct $name {
            // Keeps pins and clock; what it offers itself is 16 bits and no filter.
            _qei: Qei<'static, $timer>,
        }

        impl $name {
            /// Takes a counter that was set up for its pins: the whole 32 bits, and the filter.
            pub fn new(qei: Qei<'static, $timer>) -> Self {
                let timer = pac::$timer;
                timer.ccmr_input(0).modify(|w| {
                    w.set_icf(0, FILTER);
                    w.set_icf(1, FILTER);
                });
                timer.arr().write_value(u32::MAX);
                timer.cnt().write_value(0);
                Self { _qei: qei }
            }
        }

        impl QuadratureCounter for $name {
            fn count(&mut self) -> u16 {
                // The low half; the application extends it.
                pac::$timer.cnt().read() as u16
            }
        }
    };
}

encoder!(Encoder1, TIM2, "Encoder 1, on TIM2.");
encoder!(Encoder2, TIM5, "Encoder 2, on TIM5.");

/// DAC1 channel 1, 12 bits.
pub struct Dac(DacChannel<'static, Blocking>);

impl Dac {
    /// Takes the channel, at rest.
    pub fn new(channel: DacChannel<'static, Blocking>) -> Self {
        let mut dac = Self(channel);
        dac.set(REST);
        dac
    }
}

/// Code of rest.
pub const REST: u16 = 2_048;

impl Converter for Dac {
    const MAX: u16 = 4_095;

    fn set(&mut self, code: u16) {
        self.0.set(Value::Bit12Right(code));
    }
}
