//! What happens when nothing can go on: the shaker is silenced first, then the cause is left for
//! the next boot and told, then the watchdog resets.

use core::fmt;
use core::panic::PanicInfo;

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

/// A word of the flash that a power cut has torn reads with an error that cannot be corrected, which
/// comes as this exception: the flag is cleared, and the settings' checksum passes the record over.
/// Nothing else ends here but the clock's supervision, which is off.
#[cfg(chip = "g474re")]
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    let errors = pac::FLASH.eccr().read();
    if errors.eccd() || errors.eccd2() {
        // Flags are cleared by writing one.
        pac::FLASH.eccr().write_value(errors);
    } else {
        end("an NMI that is not the flash's");
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
