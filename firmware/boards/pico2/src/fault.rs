//! What happens when nothing can go on: the shaker is silenced first, then the cause is left for
//! the next boot and told, then the watchdog resets.

use core::fmt;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use whirl_board_lasting as lasting;
use whirl_firmware::kept::note;

use crate::hardware;

static ENTERED: AtomicBool = AtomicBool::new(false);

fn end(cause: impl fmt::Display) -> ! {
    cortex_m::interrupt::disable();
    hardware::silence();
    // What panics while it tells of a panic is told no more.
    if !ENTERED.swap(true, Relaxed) {
        lasting::leave_note(&note(&cause));
        defmt::error!("{}", defmt::Display2Format(&cause));
    }
    // Interrupts are off: the watchdog is petted no more.
    loop {
        cortex_m::asm::nop();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    match info.location() {
        Some(place) => end(format_args!("{}:{}: {}", place.file(), place.line(), info.message())),
        None => end(info.message()),
    }
}

/// A fault of the processor ends as a panic does.
#[cortex_m_rt::exception]
unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
    end(format_args!("hard fault at {:#010x}, called from {:#010x}", frame.pc(), frame.lr()))
}
