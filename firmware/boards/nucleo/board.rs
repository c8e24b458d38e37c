//! What differs from board to board: clocks, pins, DMA channels, interrupt names.
//!
//! | | NUCLEO-G474RE | NUCLEO-F446RE |
//! |---|---|---|
//! | crystal | 24 MHz, on the board | 8 MHz, of the ST-LINK |
//! | processor, timers | 170 MHz, 170 MHz | 180 MHz, 90 MHz |
//! | encoder 1 A, B | PA0, PA1 (TIM2) | PB8, PB9 (TIM2) |
//! | encoder 2 A, B | PB2, PC12 (TIM5) | PA0, PA1 (TIM5) |
//! | shaker, enable | PA4, PB10 | PA4, PB10 |
//! | serial port TX, RX | PA2, PA3 | PA2, PA3 |

use embassy_stm32::Config;
use embassy_stm32::gpio::{Level, Output, Speed};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::mode::Async;
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::low_level::Timer;
use embassy_stm32::timer::qei::Qei;
use embassy_stm32::usart::Uart;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{bind_interrupts, dac::DacChannel, dma, interrupt, peripherals, usart};

use crate::hardware::{Dac, Encoder1, Encoder2};

/// Name of the board in the hello.
#[cfg(chip = "g474re")]
pub const NAME: &str = "nucleo-g474re";
/// Name of the board in the hello.
#[cfg(chip = "f446re")]
pub const NAME: &str = "nucleo-f446re";

/// Baud rate of the serial port: what `whirl capture --from serial:…` takes where none is given.
const BAUD: u32 = 115_200;
/// The board is reset when nothing has petted the watchdog for this long, µs.
pub const WATCHDOG_US: u32 = 100_000;

#[cfg(chip = "g474re")]
bind_interrupts!(struct Irqs {
    USART2 => usart::InterruptHandler<peripherals::USART2>;
    DMA1_CHANNEL1 => dma::InterruptHandler<peripherals::DMA1_CH1>;
    DMA1_CHANNEL2 => dma::InterruptHandler<peripherals::DMA1_CH2>;
});

#[cfg(chip = "f446re")]
bind_interrupts!(struct Irqs {
    USART2 => usart::InterruptHandler<peripherals::USART2>;
    DMA1_STREAM6 => dma::InterruptHandler<peripherals::DMA1_CH6>;
    DMA1_STREAM5 => dma::InterruptHandler<peripherals::DMA1_CH5>;
});

/// The board's parts, set up.
pub struct Parts {
    /// Encoder 1.
    pub encoder1: Encoder1,
    /// Encoder 2.
    pub encoder2: Encoder2,
    /// Converter of the shaker's set point.
    pub dac: Dac,
    /// Enable pin of the shaker's amplifier, low.
    pub enable: Output<'static>,
    /// Serial port.
    pub uart: Uart<'static, Async>,
    /// Timer of the tick, not started.
    pub timer: Timer<'static, peripherals::TIM6>,
    /// Watchdog, not started.
    pub watchdog: IndependentWatchdog<'static, peripherals::IWDG>,
}

#[cfg(chip = "g474re")]
fn clocks() -> Config {
    use embassy_stm32::rcc::{Hse, HseMode, Pll, PllMul, PllPreDiv, PllRDiv, PllSource, Sysclk};
    let mut config = Config::default();
    config.rcc.hsi = false;
    config.rcc.hse = Some(Hse { freq: Hertz(24_000_000), mode: HseMode::Oscillator });
    // 24 MHz / 6 · 85 / 2 = 170 MHz
    config.rcc.pll = Some(Pll {
        source: PllSource::HSE,
        prediv: PllPreDiv::DIV6,
        mul: PllMul::MUL85,
        divp: None,
        divq: None,
        divr: Some(PllRDiv::DIV2),
    });
    config.rcc.sys = Sysclk::PLL1_R;
    config.rcc.boost = true;
    config
}

#[cfg(chip = "f446re")]
fn clocks() -> Config {
    use embassy_stm32::rcc::{
        AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllSource, Sysclk,
    };
    let mut config = Config::default();
    config.rcc.hsi = false;
    config.rcc.hse = Some(Hse { freq: Hertz(8_000_000), mode: HseMode::Bypass });
    config.rcc.pll_src = PllSource::HSE;
    // 8 MHz / 4 · 180 / 2 = 180 MHz
    config.rcc.pll =
        Some(Pll { prediv: PllPreDiv::DIV4, mul: PllMul::MUL180, divp: Some(PllPDiv::DIV2), divq: None, divr: None });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV1;
    config.rcc.apb1_pre = APBPrescaler::DIV4;
    config.rcc.apb2_pre = APBPrescaler::DIV2;
    config
}

/// Sets the board up. The enable pin is the first thing to be driven.
///
/// `None` where the serial port refuses its settings.
pub fn init() -> Option<Parts> {
    let p = embassy_stm32::init(clocks());
    let enable = Output::new(p.PB10, Level::Low, Speed::Low);
    // Nothing comes before the tick.
    interrupt::TIM6_DAC.set_priority(Priority::P0);
    interrupt::USART2.set_priority(Priority::P6);
    #[cfg(chip = "g474re")]
    {
        interrupt::DMA1_CHANNEL1.set_priority(Priority::P6);
        interrupt::DMA1_CHANNEL2.set_priority(Priority::P6);
        interrupt::TIM1_BRK_TIM15.set_priority(Priority::P7);
    }
    #[cfg(chip = "f446re")]
    {
        interrupt::DMA1_STREAM5.set_priority(Priority::P6);
        interrupt::DMA1_STREAM6.set_priority(Priority::P6);
        interrupt::TIM8_BRK_TIM12.set_priority(Priority::P7);
    }

    let mut serial = usart::Config::default();
    serial.baudrate = BAUD;
    #[cfg(chip = "g474re")]
    let (encoder1, encoder2, uart) = (
        Qei::new(p.TIM2, p.PA0, p.PA1, Default::default()),
        Qei::new(p.TIM5, p.PB2, p.PC12, Default::default()),
        Uart::new(p.USART2, p.PA3, p.PA2, p.DMA1_CH1, p.DMA1_CH2, Irqs, serial).ok()?,
    );
    #[cfg(chip = "f446re")]
    let (encoder1, encoder2, uart) = (
        Qei::new(p.TIM2, p.PB8, p.PB9, Default::default()),
        Qei::new(p.TIM5, p.PA0, p.PA1, Default::default()),
        Uart::new(p.USART2, p.PA3, p.PA2, p.DMA1_CH6, p.DMA1_CH5, Irqs, serial).ok()?,
    );
    Some(Parts {
        encoder1: Encoder1::new(encoder1),
        encoder2: Encoder2::new(encoder2),
        dac: Dac::new(DacChannel::new_blocking(p.DAC1, p.PA4)),
        enable,
        uart,
        timer: Timer::new(p.TIM6),
        watchdog: IndependentWatchdog::new(p.IWDG, WATCHDOG_US),
    })
}
