//! What happens when nothing can go on: the shaker is silenced first, then the cause is left for
//! the next boot and told, then the watchdog resets.

use core::fmt;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};

use embassy_stm32::pac;
use whirl_board_lasting::{Panicked, tell_once};

/// Half of the converter's range.
const REST: u16 = 2_048;

/// Amplifier off, no more points, set point at rest: by registers, since whoever owns them may be
/// the one who panicked.
fn silence() {
    pac::GPIOB.bsrr().write(|w| w.set_br(10, true));
    pac::TIM7.dier().write(|w| w.set_ude(false));
    pac::DAC1.dhr12r(0).write(|w| w.set_dhr(REST));
}

fn end(cause: impl fmt::Display) -> ! {
    cortex_m::interrupt::disable();
    silence();
    tell_once(&cause, |cause| defmt::error!("{}", defmt::Display2Format(cause)));
    // Interrupts are off: the watchdog is petted no more.
    loop {
        cortex_m::asm::nop();
    }
}

/// Settings are being read: what the flash cannot correct is one of their words.
static READING_SETTINGS: AtomicBool = AtomicBool::new(false);

/// Reads or writes settings, of which a power cut may have torn a word.
pub fn passing_over_torn_words<T>(settings: impl FnOnce() -> T) -> T {
    READING_SETTINGS.store(true, Ordering::SeqCst);
    let out = settings();
    // The last read's error comes before the flag falls.
    cortex_m::asm::dsb();
    READING_SETTINGS.store(false, Ordering::SeqCst);
    out
}

/// A word of the flash that a power cut has torn reads with two wrong bits, which this flash tells by
/// an NMI. Of the settings it is forgotten: their checksum passes the record over. Anywhere else the
/// program is not what was flashed.
#[cfg(chip = "g474re")]
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    let errors = pac::FLASH.eccr().read();
    if (errors.eccd() || errors.eccd2()) && READING_SETTINGS.load(Ordering::SeqCst) {
        // Flags are cleared by writing one.
        pac::FLASH.eccr().write_value(errors);
    } else {
        end(format_args!("an NMI, ECCR {:#010x}", errors.0));
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    end(Panicked(info))
}

/// A fault of the processor ends as a panic does.
#[cortex_m_rt::exception]
unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
    end(format_args!("hard fault at {:#010x}, called from {:#010x}", frame.pc(), frame.lr()))
}
