//! Clocks, pins, watchdog, settings.
//!
//! Encoder 1 A, B, index on GP2, GP3, GP4, encoder 2 on GP6, GP7, GP8, the base's on GP10, GP11,
//! GP12 or its transducer on GP26, shaker and enable on GP16
//! and GP17, the enable line behind the emergency stop on GP18, trigger input and output on GP19
//! and GP20, light on GP25. The crystal has 12 MHz, the processor and the slices 150 MHz of it,
//! TIMER 0 counts its microseconds.

use core::fmt::Write;

use embassy_rp::adc::{self, Adc};
use embassy_rp::clocks::RoscRng;
use embassy_rp::flash::{Blocking, Flash};
use embassy_rp::gpio::{Input, Level, Output, Pull};
use embassy_rp::interrupt::{InterruptExt, Priority};
use embassy_rp::peripherals::{FLASH, PIO0, USB};
use embassy_rp::pio::Pio;
use embassy_rp::pwm::{self, Pwm};
use embassy_rp::watchdog::Watchdog;
use embassy_rp::{bind_interrupts, config, interrupt, otp, pac, peripherals, pio};
use embassy_time::Duration;
use heapless::String;
use static_cell::ConstStaticCell;
use whirl_board_lasting as lasting;
use whirl_board_pico2::decoder;
use whirl_board_pico2::player::{WIDTH, schedule};
use whirl_board_pico2::reset::{RESTARTING, RUNNING, Told, cause};
use whirl_firmware::lines::Pins;
use whirl_firmware::pacing::Schedule;
use whirl_firmware::player::{MOST, Player, Run};
use whirl_firmware::settings::Settings;
use whirl_firmware::store::Store;
use whirl_firmware::sweep::BEYOND;
use whirl_shared::frame::{BaseKind, SettingsSource};

use crate::base_input::Base;
use crate::hardware::{Decoder, POINTS, Registers, TICK};

/// Name of the board in the hello.
pub const NAME: &str = "pico2";
/// The board's flash, bytes.
const FLASH_SIZE: usize = 4 << 20;
/// Where the settings are kept: the last two sectors, bytes from the flash's begin.
const SETTINGS_AT: u32 = (FLASH_SIZE - 2 * embassy_rp::flash::ERASE_SIZE) as u32;
/// The board is reset when nothing has petted the watchdog for this long.
const WATCHDOG: Duration = Duration::from_millis(100);
/// As long as the flash takes to erase a sector, at most 0.4 s, five times.
const WATCHDOG_LONGER: Duration = Duration::from_secs(2);

/// The settings' flash.
pub type SettingsFlash = Flash<'static, FLASH, Blocking, FLASH_SIZE>;

bind_interrupts!(pub struct Irqs {
    PIO0_IRQ_0 => pio::InterruptHandler<PIO0>;
    USBCTRL_IRQ => embassy_rp::usb::InterruptHandler<USB>;
});

/// The board's parts, set up.
pub struct Parts {
    /// The settings in force, and those of the image.
    pub settings: [Settings; 2],
    /// Where settings are kept.
    pub store: Store<SettingsFlash>,
    /// Encoder 1.
    pub encoder1: Decoder<0>,
    /// Encoder 2.
    pub encoder2: Decoder<1>,
    /// What shows the base's motion.
    pub base: Base,
    /// The shaker's set point, at rest.
    pub player: Player<Registers>,
    /// Enable pin of the shaker's amplifier, low.
    pub enable: Output<'static>,
    /// Emergency stop and trigger.
    pub lines: Pins<Input<'static>, Input<'static>, Output<'static>>,
    /// The light.
    pub light: Output<'static>,
    /// USB.
    pub usb: embassy_rp::usb::Driver<'static, USB>,
    /// The chip's number.
    pub serial: String<16>,
    /// How the slices run.
    pub schedule: Schedule,
}

/// The watchdog.
pub struct Dog(Watchdog);

impl Dog {
    /// Running from the first instructions on, by the ring oscillator that the chip boots with: a
    /// crystal that does not start ends in a reset, not in silence. A debugger's halt stops it.
    pub fn watch() -> Self {
        // About a microsecond: the oscillator has 4.6 to 19.6 MHz. With the crystal it is one.
        pac::TICKS.watchdog_cycles().write(|w| w.0 = 12);
        pac::TICKS.watchdog_ctrl().write(|w| w.set_enable(true));
        // SAFETY: the peripheral has no other owner: what `init` gets of it is left alone.
        let mut dog = Watchdog::new(unsafe { peripherals::WATCHDOG::steal() });
        dog.pause_on_debug(true);
        dog.start(WATCHDOG);
        Self(dog)
    }

    /// The board lives.
    pub fn pet(&mut self) {
        self.0.feed(WATCHDOG);
    }

    /// Waits for as long as the flash may take.
    pub fn wait_longer(&mut self) {
        self.0.feed(WATCHDOG_LONGER);
    }

    /// Resets the board, by its own will.
    pub fn restart(&mut self) -> ! {
        pac::WATCHDOG.scratch0().write_value(RESTARTING);
        self.0.trigger_reset();
        loop {
            cortex_m::asm::nop();
        }
    }
}

/// What the chip tells of its reset; from now on the board runs.
fn told() -> Told {
    let reason = pac::WATCHDOG.reason().read();
    let chip = pac::POWMAN.chip_reset().read();
    let told = Told {
        word: pac::WATCHDOG.scratch0().read(),
        timer: reason.timer(),
        force: reason.force(),
        power: chip.had_por() || chip.had_bor(),
        run_pin: chip.had_run_low(),
    };
    pac::WATCHDOG.scratch0().write_value(RUNNING);
    told
}

/// The settings in force, those of the image, and how the slices run.
fn settings(store: &mut Store<SettingsFlash>, number: u64) -> Option<([Settings; 2], Schedule)> {
    let mut noise = [0; 32];
    noise.fill_with(RoscRng::next_u8);
    let boot_id = lasting::boot_id(number.to_le_bytes().into_iter().chain(noise));
    let mut built_in =
        Settings { board: NAME, build: env!("WHIRL_BUILD_ID"), boot_id, base_input: true, ..Settings::default() };
    built_in.boot = lasting::before(Some(cause(&told())));
    let mut settings = built_in.clone();
    if let Some(words) = store.load() {
        settings.boot.settings = SettingsSource::Refused;
        if let Some(mut kept) = settings.with_words(&words)
            && let Some(schedule) = schedule(kept.sample_rate_millihertz)
        {
            kept.boot.settings = SettingsSource::Kept;
            return Some(([kept, built_in], schedule));
        }
    }
    let schedule = schedule(settings.sample_rate_millihertz)?;
    Some(([settings, built_in], schedule))
}

/// Sets the board up. The enable pin is the first thing to be driven.
///
/// `None` where the slices refuse the image's own settings.
pub fn init() -> Option<Parts> {
    static RUNS: ConstStaticCell<[Run; 2]> = ConstStaticCell::new([[0; MOST + BEYOND]; 2]);
    let p = embassy_rp::init(config::Config::default());
    let enable = Output::new(p.PIN_17, Level::Low);
    // It goes on in a debugger's halt.
    pac::TIMER0.dbgpause().write(|w| {
        w.set_dbg0(false);
        w.set_dbg1(false);
    });
    // Nothing comes before the tick.
    interrupt::PWM_IRQ_WRAP_0.set_priority(Priority::P0);
    interrupt::USBCTRL_IRQ.set_priority(Priority::P2);
    interrupt::TIMER0_IRQ_0.set_priority(Priority::P3);

    let number = otp::get_chipid().unwrap_or(0);
    let mut serial = String::new();
    // 64 bits are 16 digits.
    let _ = write!(serial, "{number:016X}");
    let mut store = Store::new(Flash::new_blocking(p.FLASH), SETTINGS_AT);
    let (settings, schedule) = settings(&mut store, number)?;

    let mut points = pwm::Config::default();
    (points.top, points.compare_a, points.enable) = (WIDTH - 1, WIDTH / 2, false);
    let mut tick = pwm::Config::default();
    (tick.top, tick.divider, tick.enable) = (schedule.reload, (schedule.prescaler as u8 + 1).into(), false);
    // A slice that is dropped is stopped, and its pin disconnected.
    core::mem::forget(Pwm::new_output_a(p.PWM_SLICE0, p.PIN_16, points));
    core::mem::forget(Pwm::new_free(p.PWM_SLICE8, tick));

    let Pio { mut common, sm0, sm1, sm2, .. } = Pio::new(p.PIO0, Irqs);
    let program = common.load_program(&decoder::program());
    let encoder1 = Decoder::new(sm0, &mut common, &program, p.PIN_2, p.PIN_3, p.PIN_4);
    let encoder2 = Decoder::new(sm1, &mut common, &program, p.PIN_6, p.PIN_7, p.PIN_8);
    let base = match settings[0].base.kind {
        BaseKind::None => Base::None,
        BaseKind::Encoder => Base::Encoder(Decoder::new(sm2, &mut common, &program, p.PIN_10, p.PIN_11, p.PIN_12)),
        BaseKind::Position | BaseKind::Acceleration => Base::Converter(
            Adc::new_blocking(p.ADC, adc::Config::default()),
            adc::Channel::new_pin(p.PIN_26, Pull::None),
        ),
    };
    core::mem::forget(common);
    Some(Parts {
        settings,
        store,
        encoder1,
        encoder2,
        base,
        player: Player::new(Registers, RUNS.take(), schedule),
        enable,
        lines: Pins {
            enabled: Input::new(p.PIN_18, Pull::Up),
            start: Input::new(p.PIN_19, Pull::Up),
            moving: Output::new(p.PIN_20, Level::Low),
        },
        light: Output::new(p.PIN_25, Level::Low),
        usb: embassy_rp::usb::Driver::new(p.USB, Irqs),
        serial,
        schedule,
    })
}

/// The free clock, µs.
pub fn clock() -> u32 {
    pac::TIMER0.timerawl().read()
}

/// Starts both slices by one write, right behind a step of the free clock; what that shows then. A
/// tick is whole microseconds, so that it stays that far behind: its interrupt never finds the
/// clock a step short.
pub fn start() -> u32 {
    pac::PWM.intr().write(|w| w.0 = 1 << TICK);
    pac::PWM.irq0_inte().write(|w| w.0 = 1 << TICK);
    cortex_m::interrupt::free(|_| {
        loop {
            for slice in [POINTS, TICK] {
                pac::PWM.ch(slice).ctr().write(|w| w.set_ctr(0));
            }
            let before = clock();
            while clock() == before {}
            pac::PWM.en().write(|w| w.0 = 1 << POINTS | 1 << TICK);
            let began = before.wrapping_add(1);
            // A debugger may halt anywhere.
            if clock() == began {
                return began;
            }
            pac::PWM.en().write(|w| w.0 = 0);
        }
    })
}

/// Takes the tick's interrupt.
pub fn clear_tick() {
    pac::PWM.intr().write(|w| w.0 = 1 << TICK);
}
