//! What happens when nothing can go on: the shaker is silenced first, then the cause is told, then the watchdog resets.

use core::panic::PanicInfo;

use embassy_stm32::pac;

use crate::hardware::REST;

/// Amplifier off, set point at rest: by registers, since whoever owns them may be the one who panicked.
fn silence() {
    pac::GPIOB.bsrr().write(|w| w.set_br(10, true));
    pac::DAC1.dhr12r(0).write(|w| w.set_dhr(REST));
}

fn halt() -> ! {
    // Interrupts are off: the watchdog is petted no more.
    loop {
        cortex_m::asm::nop();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    silence();
    defmt::error!("{}", defmt::Display2Format(info));
    halt()
}

/// A fault of the processor ends as a panic does.
#[cortex_m_rt::exception]
unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
    cortex_m::interrupt::disable();
    silence();
    defmt::error!("hard fault at {=u32:#010x}", frame.pc());
    halt()
}
