//! What happens when nothing can go on: the shaker is silenced first, then the cause is left for
//! the next boot and told, then the watchdog resets.

use core::fmt;
use core::panic::PanicInfo;

use whirl_board_lasting::{Panicked, tell_once};

use crate::hardware;

fn end(cause: impl fmt::Display) -> ! {
    cortex_m::interrupt::disable();
    hardware::silence();
    tell_once(&cause, |cause| defmt::error!("{}", defmt::Display2Format(cause)));
    // Interrupts are off: the watchdog is petted no more.
    loop {
        cortex_m::asm::nop();
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
