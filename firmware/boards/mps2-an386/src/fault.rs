//! What happens when nothing can go on: the plant is told that the shaker is silent, then the emulation ends.

use core::fmt::Write;
use core::panic::PanicInfo;

use whirl_board_mps2_an386::semihosting;

use crate::plant;

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    plant::last_words();
    // The emulation ends in any case.
    let _ = writeln!(semihosting::Console, "{info}");
    semihosting::exit(false)
}

/// A fault of the processor ends as a panic does.
// The attribute makes the function unsafe to be called by others; nobody does.
#[cortex_m_rt::exception]
unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
    panic!("hard fault at {:#010x}", frame.pc());
}
