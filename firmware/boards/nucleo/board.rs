//! What differs from board to board: clocks, pins, DMA channels, interrupt names.
//!
//! | | NUCLEO-G474RE | NUCLEO-F446RE |
//! |---|---|---|
//! | crystal | 24 MHz, on the board | 8 MHz, of the ST-LINK |
//! | processor, timers | 170 MHz, 170 MHz | 180 MHz, 90 MHz |
//! | settings | pages 126 and 127 of bank 2 | sectors 6 and 7 |
//!
//! Pins are the same on both: encoder 1 A, B, index on PB6, PB7, PB9 (TIM4), encoder 2 on PC6, PC7,
//! PC8 (TIM3), the base's encoder on PA8, PA9 (TIM1) or its transducer on PA0 (ADC1), shaker and
//! enable on PA4 and PB10, the enable line behind the emergency stop on PC1, trigger input and
//! output on PC0 and PB5, light on PA5, serial port on PA2 and PA3. TIM5 is the free clock, TIM7
//! that of the points.

use embassy_stm32::Config;
use embassy_stm32::flash::{Blocking, Flash, MAX_ERASE_SIZE};
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::mode::Async;
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::low_level::Timer;
use embassy_stm32::timer::qei::Qei;
use embassy_stm32::usart::Uart;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{bind_interrupts, dac::DacChannel, dma, interrupt, pac, peripherals, usart};
use static_cell::ConstStaticCell;
use whirl_firmware::lines::Pins;
use whirl_firmware::pacing::Schedule;
use whirl_firmware::player::{self, MOST, Player, Run};
use whirl_firmware::settings::Settings;
use whirl_firmware::store::Store;
use whirl_firmware::sweep::BEYOND;
use whirl_shared::frame::SettingsSource;

use crate::base_input::Base;
use crate::boot;
use crate::fault::passing_over_torn_words;
use crate::hardware::{Encoder1, Encoder2, pulled_up};
use crate::player::Registers;

/// Name of the board in the hello.
#[cfg(chip = "g474re")]
pub const NAME: &str = "nucleo-g474re";
/// Name of the board in the hello.
#[cfg(chip = "f446re")]
pub const NAME: &str = "nucleo-f446re";

/// Where the settings are kept: the last two pages or sectors, bytes from the flash's begin. On the
/// G474 they are in the bank that no program runs from, so that nothing stands still while they are
/// written.
const SETTINGS_AT: u32 = 512 * 1024 - 2 * MAX_ERASE_SIZE as u32;
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

/// What is played and what comes next.
static RUNS: ConstStaticCell<[Run; 2]> = ConstStaticCell::new([[0; MOST + BEYOND]; 2]);

/// The board's parts, set up.
pub struct Parts {
    /// The settings in force, and those of the image.
    pub settings: [Settings; 2],
    /// Where settings are kept.
    pub store: Store<Flash<'static, Blocking>>,
    /// Encoder 1.
    pub encoder1: Encoder1,
    /// Encoder 2.
    pub encoder2: Encoder2,
    /// What shows the base's motion.
    pub base: Base,
    /// Player of the shaker's set point, by DAC1 channel 1, 12 bits.
    pub player: Player<Registers>,
    /// Enable pin of the shaker's amplifier, low.
    pub enable: Output<'static>,
    /// Emergency stop and trigger.
    pub lines: Pins<Input<'static>, Input<'static>, Output<'static>>,
    /// The light.
    pub light: Output<'static>,
    /// Serial port.
    pub uart: Uart<'static, Async>,
    /// Timer of the tick, not started.
    pub timer: Timer<'static, peripherals::TIM6>,
    /// Free clock, not started.
    pub clock: Timer<'static, peripherals::TIM5>,
    /// Clock of the points, not started.
    pub points: Timer<'static, peripherals::TIM7>,
    /// How the timers run.
    pub schedule: Schedule,
}

/// The watchdog, from the first instructions on: a crystal that does not start ends in a reset, not
/// in silence. A debugger's halt stops it, and the points of the shaker with it; the tick, the free
/// clock and the encoders go on.
pub fn watch() -> IndependentWatchdog<'static, peripherals::IWDG> {
    #[cfg(chip = "g474re")]
    pac::DBGMCU.apb1lfzr().modify(|w| {
        w.set_iwdg(true);
        w.set_tim7(true);
    });
    #[cfg(chip = "f446re")]
    pac::DBGMCU.apb1fzr().modify(|w| {
        w.set_iwdg(true);
        w.set_tim7(true);
    });
    // SAFETY: the peripheral has no other owner: what `init` gets of it is left alone.
    let mut watchdog = IndependentWatchdog::new(unsafe { peripherals::IWDG::steal() }, WATCHDOG_US);
    watchdog.unleash();
    watchdog
}

/// Lets the watchdog wait for the time that the flash takes at most (2 s for a sector of the F446,
/// twice that here), or as always.
pub fn watch_longer(longer: bool) {
    use embassy_stm32::pac::iwdg::vals::{Key, Pr};
    let watchdog = pac::IWDG;
    watchdog.kr().write(|w| w.set_key(Key::RESET));
    watchdog.kr().write(|w| w.set_key(Key::ENABLE));
    // 32 kHz by 4: 800 are 100 ms. By 64: 2048 are 4 s.
    watchdog.pr().write(|w| w.set_pr(if longer { Pr::DIVIDE_BY64 } else { Pr::DIVIDE_BY4 }));
    watchdog.rlr().write(|w| w.set_rl(if longer { 2_047 } else { 799 }));
    while watchdog.sr().read().pvu() || watchdog.sr().read().rvu() {}
    watchdog.kr().write(|w| w.set_key(Key::RESET));
}

/// How the timers run at a rate; none where this board cannot.
fn schedule(settings: &Settings) -> Option<Schedule> {
    let timer = embassy_stm32::rcc::frequency::<peripherals::TIM6>();
    player::schedule(timer.0, settings.sample_rate_millihertz)
}

/// The settings in force, those of the image, and how the timers run.
fn settings(store: &mut Store<Flash<'static, Blocking>>) -> Option<([Settings; 2], Schedule)> {
    let mut built_in = Settings {
        board: NAME,
        build: env!("WHIRL_BUILD_ID"),
        boot_id: boot::id(),
        base_input: true,
        ..Settings::default()
    };
    built_in.boot = boot::before();
    let mut settings = built_in.clone();
    if let Some(words) = passing_over_torn_words(|| store.load()) {
        settings.boot.settings = SettingsSource::Refused;
        if let Some(mut kept) = settings.with_words(&words)
            && let Some(schedule) = schedule(&kept)
        {
            kept.boot.settings = SettingsSource::Kept;
            return Some(([kept, built_in], schedule));
        }
    }
    let schedule = schedule(&settings)?;
    Some(([settings, built_in], schedule))
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
/// `None` where the serial port or a timer refuses the image's own settings.
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

    let mut store = Store::new(Flash::new_blocking(p.FLASH), SETTINGS_AT);
    let (settings, schedule) = settings(&mut store)?;
    let mut serial = usart::Config::default();
    serial.baudrate = settings[0].baud;
    serial.rx_pull = Pull::Up;
    #[cfg(chip = "g474re")]
    let uart = Uart::new(p.USART2, p.PA3, p.PA2, p.DMA1_CH1, p.DMA1_CH2, Irqs, serial).ok()?;
    #[cfg(chip = "f446re")]
    let uart = Uart::new(p.USART2, p.PA3, p.PA2, p.DMA1_CH6, p.DMA1_CH5, Irqs, serial).ok()?;
    // Their clocks are on from here; the player sets up what it plays by.
    let (clock, points) = (Timer::new(p.TIM5), Timer::new(p.TIM7));
    // A channel that is dropped is switched off.
    core::mem::forget(DacChannel::new_blocking(p.DAC1, p.PA4));
    let encoder = || Qei::new(p.TIM1, p.PA8, p.PA9, pulled_up());
    let base = Base::new(settings[0].base.kind, encoder, p.ADC1, p.PA0);
    Some(Parts {
        settings,
        store,
        encoder1: Encoder1::new(Qei::new(p.TIM4, p.PB6, p.PB7, pulled_up()), p.PB9),
        encoder2: Encoder2::new(Qei::new(p.TIM3, p.PC6, p.PC7, pulled_up()), p.PC8),
        base,
        player: Player::new(Registers::new(schedule), RUNS.take(), schedule),
        enable,
        lines: Pins {
            enabled: Input::new(p.PC1, Pull::Up),
            start: Input::new(p.PC0, Pull::Up),
            moving: Output::new(p.PB5, Level::Low, Speed::Low),
        },
        light: Output::new(p.PA5, Level::Low, Speed::Low),
        uart,
        timer: Timer::new(p.TIM6),
        clock,
        points,
        schedule,
    })
}
