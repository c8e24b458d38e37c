//! The firmware's traits on the chip's peripherals.

use embassy_stm32::Peri;
use embassy_stm32::gpio::Pull;
use embassy_stm32::pac;
use embassy_stm32::pac::timer::vals::{CcmrInputCcs, FilterValue};
use embassy_stm32::peripherals::{TIM3, TIM4};
use embassy_stm32::timer::TimerPin;
use embassy_stm32::timer::input_capture::{CapturePin, Ch3, Ch4};
use embassy_stm32::timer::qei::{self, Qei};
use whirl_firmware::QuadratureCounter;

/// A level counts when eight samples at a 32nd of the timer's clock agree: 1.5 µs at 170 MHz, 2.8
/// µs at 90 MHz. The shortest time between edges is 12 µs (4096 counts a turn at 20 turns a
/// second).
pub const FILTER: FilterValue = FilterValue::FDTS_DIV32_N8;

/// Inputs are pulled up, so that a line that is not wired, or whose buffer has no supply, is a
/// level and no noise.
pub fn pulled_up() -> qei::Config {
    qei::Config { ch1_pull: Pull::Up, ch2_pull: Pull::Up, ..qei::Config::default() }
}

macro_rules! encoder {
    ($name:ident, $timer:ident, $channel:ident, $index:literal, $text:literal) => {
        #[doc = $text]
        pub struct $name {
            // Keeps pins and clock; what it offers itself has no filter and no index.
            _qei: Qei<'static, $timer>,
        }

        impl $name {
            /// Takes a counter that was set up for its pins, and the pin of the index, on whose
            /// rising edge the timer holds its count.
            pub fn new(qei: Qei<'static, $timer>, index: Peri<'static, impl TimerPin<$timer, $channel>>) -> Self {
                // A pin that is dropped is disconnected.
                core::mem::forget(CapturePin::<'static, $timer, $channel>::new(index, Pull::Up));
                let timer = pac::$timer;
                timer.ccmr_input(0).modify(|w| {
                    w.set_icf(0, FILTER);
                    w.set_icf(1, FILTER);
                });
                timer.ccmr_input(1).modify(|w| {
                    w.set_ccs($index - 2, CcmrInputCcs::TI4);
                    w.set_icf($index - 2, FILTER);
                });
                timer.ccer().modify(|w| w.set_cce($index, true));
                timer.cnt().write(|w| w.set_cnt(0));
                Self { _qei: qei }
            }
        }

        impl QuadratureCounter for $name {
            fn count(&mut self) -> u16 {
                pac::$timer.cnt().read().cnt()
            }

            fn index(&mut self) -> Option<u16> {
                // Reading what was held clears the flag.
                let seen = pac::$timer.sr().read().ccif($index);
                seen.then(|| pac::$timer.ccr($index).read().ccr())
            }
        }
    };
}

encoder!(Encoder1, TIM4, Ch4, 3, "Encoder 1, on TIM4; its index on channel 4.");
encoder!(Encoder2, TIM3, Ch3, 2, "Encoder 2, on TIM3; its index on channel 3.");
