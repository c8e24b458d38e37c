//! The base's motion: a third encoder on TIM1, or a transducer on the converter.
//!
//! The converter sums 16 conversions of 12 bits, one right after the other from the moment at which
//! the counters were read: 14 µs on the G474, 29 µs on the F446, of which half is how late its
//! value is.

use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, SampleTime};
use embassy_stm32::pac;
use embassy_stm32::peripherals::{ADC1, PA0, TIM1};
use embassy_stm32::timer::qei::Qei;
use whirl_firmware::base::BaseInput;
use whirl_shared::frame::BaseKind;

use crate::hardware::FILTER;

/// Conversions that are summed.
const CONVERSIONS: u16 = 16;
/// Looks at a conversion before it is given up: a hundred times its length.
const PATIENCE: u32 = 10_000;

/// Sample and hold: with 12.5 cycles of conversion 0.9 µs of a 42.5 MHz clock.
#[cfg(chip = "g474re")]
const SAMPLE: SampleTime = SampleTime::CYCLES24_5;
/// Sample and hold: with 12 cycles of conversion 1.8 µs of a 22.5 MHz clock.
#[cfg(chip = "f446re")]
const SAMPLE: SampleTime = SampleTime::CYCLES28;

/// What is connected.
pub enum Base {
    /// Nothing.
    None,
    /// An encoder, on TIM1, whose pins and clock are kept.
    Encoder {
        /// What it offers itself has no filter.
        _qei: Qei<'static, TIM1>,
    },
    /// A transducer, on ADC1, which is kept.
    Converter {
        /// What it offers itself sets it up anew each time.
        _adc: Adc<'static, ADC1>,
    },
}

impl Base {
    /// Sets up the one that the settings name; the other's pins are left alone.
    pub fn new(
        kind: BaseKind,
        encoder: impl FnOnce() -> Qei<'static, TIM1>,
        adc: Peri<'static, ADC1>,
        mut pin: Peri<'static, PA0>,
    ) -> Self {
        match kind {
            BaseKind::None => Self::None,
            BaseKind::Encoder => {
                let qei = encoder();
                pac::TIM1.ccmr_input(0).modify(|w| {
                    w.set_icf(0, FILTER);
                    w.set_icf(1, FILTER);
                });
                pac::TIM1.cnt().write(|w| w.set_cnt(0));
                Self::Encoder { _qei: qei }
            }
            BaseKind::Position | BaseKind::Acceleration => {
                #[cfg(chip = "g474re")]
                let mut adc = Adc::new(adc, embassy_stm32::adc::AdcConfig::default());
                #[cfg(chip = "f446re")]
                let mut adc = Adc::new(adc);
                // Sets up channel and sample time, and leaves the converter on.
                adc.blocking_read(&mut pin, SAMPLE);
                Self::Converter { _adc: adc }
            }
        }
    }
}

impl BaseInput for Base {
    fn latch(&mut self) -> u16 {
        match self {
            Self::None => 0,
            Self::Encoder { .. } => pac::TIM1.cnt().read().cnt(),
            // 16 · 4095 fit into 16 bits.
            Self::Converter { .. } => (0..CONVERSIONS).map(|_| conversion()).sum(),
        }
    }
}

/// One conversion.
#[cfg(chip = "g474re")]
fn conversion() -> u16 {
    let adc = pac::ADC1;
    adc.isr().write(|w| {
        w.set_eoc(true);
        w.set_eos(true);
    });
    adc.cr().modify(|w| w.set_adstart(true));
    for _ in 0..PATIENCE {
        if adc.isr().read().eoc() {
            break;
        }
    }
    adc.dr().read().rdata() & 4_095
}

/// One conversion.
#[cfg(chip = "f446re")]
fn conversion() -> u16 {
    let adc = pac::ADC1;
    adc.cr2().modify(|w| w.set_swstart(true));
    for _ in 0..PATIENCE {
        if adc.sr().read().eoc() {
            break;
        }
    }
    adc.dr().read().data() & 4_095
}
